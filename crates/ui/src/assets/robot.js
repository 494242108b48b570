// ---- the robot: its orders and state, its panels, its display, its station

// A name of a scenario in plain words.
const words = (name) => hilrig.stage?.mode_words?.[name]
  ?? (name[0].toUpperCase() + name.slice(1)).replaceAll("-", " ");

function beginRobot(stage) {
  const modes = (stage.modes ?? []).map((mode) => {
    const node = make("button", words(mode), { type: "button" });
    node.dataset.mode = mode;
    node.onclick = () => { stopDriving(); send({ do: "mode", mode }); };
    return node;
  });
  $("modes").replaceChildren(...modes);
  $("acts").replaceChildren(...(stage.place_acts ?? []).map((act) => {
    const node = make("button", words(act.mode), { type: "button", title: act.about });
    node.dataset.act = act.mode;
    node.onclick = () => aim(aiming === act ? null : act);
    return node;
  }));
  $("drive").hidden = !stage.keys;
  aim(null);
}

// The act of the station to which the next press on the map belongs; `null`: waypoints.
let aiming = null;

function aim(act) {
  aiming = act;
  for (const node of $("acts").children) {
    node.setAttribute("aria-pressed", String(node.dataset.act === act?.mode));
  }
  $("aim").hidden = act === null;
  $("aim-heading").hidden = !act?.heading;
  say("aim-about", act ? act.about : "");
  say("aim-go", act ? words(act.mode) : "Go");
  requestDraw();
}

// Performs an act at a place in metres with a heading in radians.
function perform(act, [x, y], radians) {
  const degrees = Math.round(radians * 1800 / Math.PI) / 10;
  const figures = act.heading ? [x, y, degrees] : [x, y];
  stopDriving();
  send({ do: "mode", mode: `${act.mode} ${figures.map((value) => +value.toFixed(3)).join(" ")}` });
  aim(null);
}

$("aim").onsubmit = (event) => {
  event.preventDefault();
  const [x, y, degrees] = ["aim-x", "aim-y", "aim-deg"].map((id) => Number($(id).value));
  perform(aiming, [x, y], degrees * Math.PI / 180);
};

function showRobot() {
  const { now } = seen(), { stage } = hilrig, { pc, gap } = now;
  for (const id of ["connect", "drive", "clear"]) $(id).disabled = Boolean(hilrig.past);
  for (const node of $("acts").children) node.disabled = Boolean(hilrig.past);
  for (const node of $("modes").children) {
    node.disabled = Boolean(hilrig.past);
    node.setAttribute("aria-pressed", String(node.dataset.mode === pc?.state?.mode));
  }
  // A program outside the rig does not report its estimate.
  hilrig.believes ||= Boolean(now.believed);
  $("show-belief").parentElement.hidden = !hilrig.believes;
  showFacts(now);
  $("show-waypoints").parentElement.hidden = !stage.pc && !stage.goals?.length;
  if (!stage.pc || !pc) return;
  say("connect", pc.connection === "closed" ? "Connect" : "Disconnect");
  say("confirmed", pc.waypoints.length ? (pc.confirmed ? "confirmed" : "on their way") : "");
  once("waypoints", [pc.waypoints, Boolean(hilrig.past)],
    () => unmarked(pc.waypoints).map(waypointItem));
}

// Rows of names and values; a value that this robot lacks has no row.
function showFacts({ mode, pc, gap, trouble, truth }) {
  const { stage } = hilrig, facts = [];
  const degrees = (value) => `${value}\u00b0`;
  // A heading from 0 to 360 degrees, with one decimal.
  const heading = (value) => degrees(Math.round((value % 360 + 360) % 360 * 10) / 10);
  const doing = mode ?? pc?.state?.mode;
  const told = pc?.state?.to.length ? `, set-points ${pc.state.to.join(", ")}` : "";
  if (doing) facts.push(["activity", `${stage.mode_words?.[doing] ?? doing}${told}`]);
  if (stage.pc && pc) {
    const silent = pc.heard_ms > 1500 ? `, silent for ${(pc.heard_ms / 1000).toFixed(0)} s` : "";
    facts.push(["PC", `${pc.connection}${silent}${trouble ? `: ${trouble}` : ""}`]);
    facts.push(["reported pose",
      pc.pose ? `${pc.pose[0]} mm, ${pc.pose[1]} mm, ${heading(pc.pose[2])}` : "none yet"]);
    // Not for a robot that sends no map.
    if (pc.rows_missing !== null || pc.size_mm) {
      facts.push(["map rows missing", pc.rows_missing === null ? "all" : String(pc.rows_missing)]);
    }
  }
  if (truth && stage.body !== false) {
    const [x, y] = truth.map((value) => Math.round(value * 1000));
    facts.push(["true pose", `${x} mm, ${y} mm, ${heading(truth[2] * 180 / Math.PI)}`]);
  }
  if (gap) {
    facts.push(["position error", `${gap.error_mm} mm`], ["heading error", degrees(gap.error_deg)],
      ["age of the estimate", `${gap.lag_ms} ms, ${gap.went_mm} mm driven since`]);
  }
  const node = $("facts");
  if (node.children.length !== 2 * facts.length) {
    node.replaceChildren(...facts.flatMap(() => [make("dt"), make("dd")]));
  }
  facts.flat().forEach((text, index) => {
    const cell = node.children[index];
    if (cell.textContent !== text) cell.textContent = text;
  });
}

// The waypoints of the mission, if no PC shows its own list.
function showGoals({ goals = [] }) {
  const next = goals.findIndex(({ visited }) => visited === null);
  once("goals", goals, () => unmarked(goals).map(({ at, visited }, index) => {
    const item = make("li", `${at.map((value) => value.toFixed(2)).join(" m, ")} m: `);
    if (visited !== null) item.append("visited at ", jump(visited));
    else item.append(index === next ? "next" : "not visited");
    item.onpointerenter = () => markWaypoint(index);
    item.onpointerleave = () => markWaypoint(null);
    return item;
  }));
}

function waypointItem(place, index) {
  const item = make("li"), past = Boolean(hilrig.past);
  const number = (axis) => {
    const input = make("input", "", { type: "number", value: place[axis], disabled: past });
    input.setAttribute("aria-label", `${"xy"[axis]} of waypoint ${index + 1}, mm`);
    input.onchange = () => {
      const to = [...place];
      to[axis] = Math.round(Number(input.value));
      input.blur();
      send({ do: "move", index, from: place, to });
    };
    return input;
  };
  const gone = button("Delete", `delete waypoint ${index + 1}`, (event) => {
    event.target.blur();
    send({ do: "delete", index, at: place });
  });
  gone.disabled = past;
  item.append(number(0), " ", number(1), " ", gone);
  item.onpointerenter = () => markWaypoint(index);
  item.onpointerleave = () => markWaypoint(null);
  item.addEventListener("focusin", () => markWaypoint(index));
  item.addEventListener("focusout", () => markWaypoint(null));
  return item;
}

// The robot's values, the traffic on its wires, and the events.
function showSlow() {
  const { slow } = seen();
  once("axes", slow.axes, () => (slow.axes ?? []).map(axisRow));
  once("panels", slow.panels, () => (slow.panels ?? []).map(panelItem));
  once("counters", slow.counters, () => slow.counters.map(([name, value]) => row([name, value])));
  $("counters-box").hidden = slow.counters.length === 0;
  showGoals(slow);
  once("wires", slow.lanes, () => slow.lanes.flatMap(wireRows));
  showFaults(slow.faults);
  showEvents();
  showFrames();
  showTalk();
}

// The set-point of an axis, its actual value, and its limit.
function axisRow({ name, unit, set_point, limit, actual }) {
  const figure = (value) => String(Math.round(value * 1000) / 1000 + 0);
  const told = `set-point ${figure(set_point)}`
    + (actual === null ? "" : `, actual ${figure(actual)}`);
  const most = limit === null ? "" : `, limit ${figure(limit)}`;
  return row([name, `${told}${unit && ` ${unit}`}${most}`]);
}

// A panel of the robot: values that belong together, folded by a click. A click on the name of a
// number plots it.
function panelItem({ name: group, rows }) {
  const item = make("details"), table = make("table"), body = make("tbody");
  item.open = !hilrig.folded.has(group);
  item.addEventListener("toggle", () => hilrig.folded[item.open ? "delete" : "add"](group));
  body.append(...rows.map(({ name, address, value, unit }) =>
    row([address === null ? name : `${address} ${name}`, `${value} ${unit}`])));
  table.append(body);
  item.append(make("summary", group), table);
  return item;
}

function wireRows(lane) {
  return ["to-master", "to-device"].map((way) => {
    const { load, tally } = lane[way];
    const name = `${lane.name} ${way}`;
    return row([name, `${(load * 100).toFixed(1)} %`, tally.bytes, tally.frames, tally.errors,
      tally.faults], [4, 5]);
  });
}

const EVENTS_SHOWN = 300;
function showEvents() {
  const until = seen().now.at_ns / 1e9, past = hilrig.past ? until : "live";
  const list = $("events");
  const key = `${hilrig.events.length} ${past}`;
  if (shown.events === key || $("panel-log").hidden && shown.events) return;
  shown.events = key;
  const atEnd = list.scrollTop + list.clientHeight >= list.scrollHeight - 20;
  const all = hilrig.past ? hilrig.events.filter((event) => event.at <= until) : hilrig.events;
  const items = all.slice(-EVENTS_SHOWN).map((event) => {
    const item = make("li", "", event.violation ? { className: "violation" } : {});
    item.append(jump(event.at), ` ${event.source} ${event.rule} ${event.detail}`);
    return item;
  });
  list.replaceChildren(...items.length ? items : [make("li", "nothing happened yet")]);
  if (atEnd) list.scrollTop = list.scrollHeight;
}

// The robot's display: a row is the upper bytes of its pixels (RGB565), then the lower ones.
let screenShown = null;
function drawScreen() {
  const { display } = seen().maps;
  $("display").hidden = !display;
  if (!display || (display === screenShown && !dirty.display)) return;
  screenShown = display;
  dirty.display = false;
  const width = display.width / 2, image = new ImageData(width, display.height);
  for (let y = 0, at = 0; y < display.height; y++) {
    for (let x = 0; x < width; x++, at += 4) {
      const high = display.cells[y * display.width + x];
      const low = display.cells[y * display.width + width + x];
      const red = high >> 3, green = (high & 7) << 3 | low >> 5, blue = low & 31;
      image.data[at] = red << 3 | red >> 2;
      image.data[at + 1] = green << 2 | green >> 4;
      image.data[at + 2] = blue << 3 | blue >> 2;
      image.data[at + 3] = 255;
    }
  }
  $("screen").getContext("2d").putImageData(image, 0, 0);
}

$("screen").onclick = (event) => {
  if (hilrig.past) return;
  const screen = event.currentTarget, box = screen.getBoundingClientRect();
  const pixel = (at, from, span, all) =>
    Math.max(0, Math.min(all - 1, Math.floor((at - from) * all / span)));
  send({ do: "tap", place: [
    pixel(event.clientX, box.left, box.width, screen.width),
    pixel(event.clientY, box.top, box.height, screen.height),
  ] });
};

$("add").onsubmit = (event) => {
  event.preventDefault();
  send({ do: "add", at: [Number($("add-x").value), Number($("add-y").value)].map(Math.round) });
};
$("clear").onclick = () => send({ do: "clear" });
$("connect").onclick = () =>
  send({ do: hilrig.now?.pc?.connection === "closed" ? "connect" : "disconnect" });

// ---- driving by keys

const keys = new Set();
let driving = null;
const directions = {
  ArrowUp: ["ahead", 1], KeyW: ["ahead", 1], ArrowDown: ["ahead", -1], KeyS: ["ahead", -1],
  ArrowLeft: ["left", 1], KeyA: ["left", 1], ArrowRight: ["left", -1], KeyD: ["left", -1],
};

// The set-point of each axis for the pressed keys.
function axes() {
  const { limit, ...adds } = hilrig.stage.keys;
  return limit.map((most, axis) => {
    let sum = 0;
    for (const key of keys) sum += adds[directions[key][0]][axis] * directions[key][1];
    return Math.max(-most, Math.min(most, sum));
  });
}

// Sent repeatedly, because a robot whose page is gone has to stop.
function startDriving() {
  keys.clear();
  $("drive").setAttribute("aria-pressed", "true");
  $("driving").hidden = false;
  send({ do: "drive", axes: axes() });
  driving = setInterval(() => send({ do: "drive", axes: axes() }), 250);
}

function stopDriving() {
  if (driving === null) return;
  clearInterval(driving);
  driving = null;
  keys.clear();
  $("drive").setAttribute("aria-pressed", "false");
  $("driving").hidden = true;
}

$("drive").onclick = () => {
  if (driving === null) startDriving();
  else { stopDriving(); send({ do: "drive", axes: axes() }); }
};
document.addEventListener("keydown", (event) => {
  if (driving === null || !(event.code in directions)) return;
  event.preventDefault();
  if (!keys.has(event.code)) { keys.add(event.code); send({ do: "drive", axes: axes() }); }
});
document.addEventListener("keyup", (event) => {
  if (driving !== null && keys.delete(event.code)) send({ do: "drive", axes: axes() });
});
window.addEventListener("blur", () => {
  if (driving !== null && keys.size) { keys.clear(); send({ do: "drive", axes: axes() }); }
});
