// The live page: what the server tells goes into `hilrig`, what is in there is drawn, what somebody
// does is sent. Everything that comes from a wire is shown as text, never as markup.
"use strict";
const hilrig = window.hilrig = {
  connected: false, stage: null, now: null, slow: null, scan: null, maps: {},
  samples: [], events: [], refused: "", messages: 0, bytes: 0, past: null,
  errors: [], folded: new Set(), overlays: [], hidden: new Set(),
};
window.addEventListener("error", (event) => hilrig.errors.push(event.message));
const $ = (id) => document.getElementById(id);
const view = hilrigView;
const canvas = $("world"), lanes = $("lanes");
const EVENTS_SHOWN = 200;
let socket = null, images = {}, dirty = {}, drag = null, frame = null, shown = {};

function send(command) {
  hilrig.refused = "";
  $("refused").textContent = "";
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(command));
  else refuse("not connected to the rig");
}

function refuse(why) {
  hilrig.refused = why;
  $("refused").textContent = why;
}

// ---- what the server tells

function open() {
  socket = new WebSocket(`ws://${location.host}/ws`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => { hilrig.connected = true; showLink(); };
  socket.onclose = () => {
    hilrig.connected = false;
    hilrig.stage = null;
    stopDriving();
    showLink();
    setTimeout(open, 500);
  };
  socket.onmessage = (event) => {
    hilrig.messages += 1;
    hilrig.bytes += event.data.byteLength ?? event.data.length;
    if (typeof event.data === "string") hear(JSON.parse(event.data));
    else putRows(new Uint8Array(event.data), hilrig.maps);
  };
}

function hear(message) {
  switch (message.type) {
    case "stage": begin(message); break;
    case "now": hilrig.now = message; if (message.scene) hilrig.stage.scene = message.scene; break;
    case "slow": hilrig.slow = message; break;
    case "scan": hilrig.scan = message; break;
    case "overlays":
      hilrig.overlays = message.overlays;
      view.offerOverlays($("overlays"), message.overlays, hilrig.hidden, requestDraw);
      break;
    case "samples": hilrig.samples.splice(message.from, Infinity, ...message.samples); break;
    case "events":
      hilrig.events.splice(message.from, Infinity, ...message.events);
      showEvents();
      break;
    case "refused": refuse(message.why); break;
  }
  requestDraw();
}

function begin(stage) {
  Object.assign(hilrig, {
    stage, now: null, slow: null, scan: null, maps: {}, samples: [], events: [], past: null,
    overlays: [],
  });
  $("overlays").replaceChildren();
  images = {};
  shown = {};
  document.title = `${stage.name} - hilrig`;
  $("name").textContent = stage.name;
  $("about").textContent = stage.seed === null ? stage.description
    : `${stage.description} (seed ${stage.seed})`;
  document.body.classList.toggle("pc", stage.kind === "pc");
  document.body.classList.toggle("no-pc", !stage.pc);
  document.body.classList.toggle("no-pace", !stage.pace);
  if (stage.seed !== null) $("seed").value = stage.seed;
  if (stage.kind === "pc") $("map").value = "pc";
  fill($("fault-link"), stage.links.map((link) => {
    const option = document.createElement("option");
    option.textContent = link.name;
    return option;
  }));
  offerModes(stage.modes ?? []);
  $("drive").hidden = !stage.keys;
  $("events").replaceChildren();
  lanes.height = (2 * stage.links.length + 1) * view.laneHeight;
  goLive();
  showLink();
}

// Rows of maps: layer u8, row u16, length u16, then pairs of count and value.
function putRows(bytes, maps) {
  const data = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes[0] !== 1) return;
  for (let at = 1; at + 5 <= bytes.length;) {
    const layer = bytes[at], y = data.getUint16(at + 1, true), size = data.getUint16(at + 3, true);
    const rows = maps[layer] ??= { rows: new Map() };
    rows.rows.set(y, bytes.slice(at + 5, at + 5 + size));
    at += 5 + size;
  }
}

// The newest rows become cells when the map's size is known.
function unpack(maps, heads) {
  heads.forEach((head, index) => {
    const got = maps[index];
    if (!got || !head.width) return;
    let map = maps[head.name];
    if (!map || map.width !== head.width || map.height !== head.height) {
      const cells = new Uint8Array(head.width * head.height).fill(127);
      map = maps[head.name] = { ...head, cells };
    }
    map.resolution_m = head.resolution_m;
    map.origin_m = head.origin_m;
    if (got.rows.size) dirty[head.name] = true;
    for (const [y, code] of got.rows) {
      let x = y * map.width;
      const end = x + map.width;
      for (let i = 0; i + 1 < code.length; i += 2) {
        const next = Math.min(x + code[i], end);
        map.cells.fill(code[i + 1], x, next);
        x = next;
      }
    }
    got.rows.clear();
  });
}

// ---- drawing

let drawn = true;
function requestDraw() {
  if (drawn) { drawn = false; requestAnimationFrame(draw); }
}

function draw() {
  drawn = true;
  if (!hilrig.stage || !hilrig.now) return;
  unpack(hilrig.maps, hilrig.now.maps);
  offerMaps(hilrig.now.maps);
  drawWorld();
  drawScreen();
  if (hilrig.stage.kind === "rig") drawWires();
  showNow();
  if (hilrig.slow) showSlow();
}

const metres = (list) => list.flatMap(([x, y]) => [x / 1000, y / 1000]);

function bounds(map) {
  const scene = hilrig.stage.scene;
  const [x, y] = map?.origin_m ?? [0, 0];
  const size = map
    ? [x, y, x + map.width * map.resolution_m, y + map.height * map.resolution_m] : null;
  if (!scene) return size ?? [0, 0, 3, 3];
  const [a, b, c, d] = scene.bounds;
  return size ? [Math.min(a, size[0]), Math.min(b, size[1]), Math.max(c, size[2]), Math.max(d, size[3])]
    : scene.bounds;
}

// Maps that only some robots have.
function offerMaps(heads) {
  const options = [...$("map").options];
  for (const { name } of heads) {
    if (name === "display" || options.some((option) => option.value === name)) continue;
    const option = document.createElement("option");
    option.value = option.textContent = name;
    $("map").append(option);
  }
}

function mapPicture(name, map, past) {
  const layer = $("layer").value, key = `${name} ${layer}`;
  if (past) return past.images[key] ??= view.mapImage(map, layer);
  if (dirty[name] || !images[key]) {
    for (const old of Object.keys(images)) if (old.startsWith(`${name} `)) delete images[old];
    images[key] = view.mapImage(map, layer);
    dirty[name] = false;
  }
  return images[key];
}

function drawWorld() {
  const context = canvas.getContext("2d"), past = hilrig.past, name = $("map").value;
  const map = (past?.maps ?? hilrig.maps)[name];
  frame = view.fit(canvas, bounds(map));
  view.clear(context);
  if (map) view.drawMap(context, frame, map, mapPicture(name, map, past));
  if ($("show-world").checked && hilrig.stage.scene) {
    view.drawWorld(context, frame, hilrig.stage.scene);
  }
  const until = past ? past.index + 1 : hilrig.samples.length;
  if ($("show-ways").checked) {
    const way = (slot) => {
      const path = [];
      for (let i = 0; i < until; i++) {
        const pose = hilrig.samples[i][slot];
        if (pose) path.push(pose[0], pose[1]);
      }
      return path;
    };
    view.drawPath(context, frame, way(1), view.colours.truth);
    view.drawPath(context, frame, way(2), view.colours.belief);
  }
  if (!past && $("show-scan").checked && hilrig.scan) {
    view.drawScan(context, frame, hilrig.scan.points);
  }
  for (const overlay of past ? [] : hilrig.overlays) {
    if (!hilrig.hidden.has(overlay.name)) view.drawOverlay(context, frame, overlay);
  }
  const [truth, believed] = past ? hilrig.samples[past.index].slice(1)
    : [hilrig.now.truth, hilrig.now.believed];
  const footprint = hilrig.stage.footprint;
  if (truth) view.drawRobot(context, frame, truth, footprint, view.colours.truth);
  if (believed) view.drawRobot(context, frame, believed, footprint, view.colours.belief);
  if ($("show-waypoints").checked && hilrig.now.pc) {
    view.drawWaypoints(context, frame, metres(dragged(hilrig.now.pc.waypoints)));
  }
}

// The robot's display: a row is the upper bytes of its pixels (RGB565), then the lower ones.
let screenShown = null;
function drawScreen() {
  const display = (hilrig.past?.maps ?? hilrig.maps).display;
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

// The list with the waypoint that is being dragged where the pointer is.
function dragged(list) {
  if (!drag || drag.index === null || !drag.moved) return list;
  return list.map((place, index) => index === drag.index ? drag.to : place);
}

function drawWires() {
  const count = Math.min(hilrig.samples.length, 301);
  const last = hilrig.past ? hilrig.past.index + 1 : hilrig.samples.length;
  const samples = hilrig.samples.slice(Math.max(0, last - count), last);
  if (samples.length < 2) return;
  const context = lanes.getContext("2d");
  view.clear(context);
  const from = samples[0][0] / 1000, to = samples[samples.length - 1][0] / 1000;
  const rows = hilrig.stage.links.flatMap((link, index) => ["<", ">"].map((way, side) => {
    const lane = { name: `${link.name} ${way}`, load: [], errors: [], faults: [] };
    for (let i = 1; i < samples.length; i++) {
      const [a, b] = [samples[i - 1], samples[i]].map((sample) => sample[3][2 * index + side]);
      const seconds = (samples[i][0] - samples[i - 1][0]) / 1000;
      lane.load.push((b[0] - a[0]) * 10 / link.baud / seconds);
      lane.errors.push(b[2] - a[2]);
      lane.faults.push(b[3] - a[3]);
    }
    return lane;
  }));
  const marks = hilrig.events.filter((event) => event.at >= from && event.at <= to)
    .slice(-500).map((event) => ({
      at: event.at,
      kind: event.violation ? "violation" : event.source === "rig" ? "fault" : "event",
    }));
  view.drawLanes(context, rows, from, to, marks, hilrig.past ? to : null);
}

// ---- words

// Puts text where it differs: a page that is read aloud stays quiet otherwise.
function say(id, text) {
  const node = $(id);
  if (node.textContent !== text) node.textContent = text;
}

function fill(parent, children) {
  parent.replaceChildren(...children);
}

// Rebuilds a part of the page only when what it shows has changed, and never under the fingers.
function once(id, value, build) {
  const key = JSON.stringify(value);
  if (shown[id] === key || $(id).contains(document.activeElement)) return;
  shown[id] = key;
  fill($(id), build());
}

function row(cells, bad = []) {
  const line = document.createElement("tr");
  cells.forEach((cell, index) => {
    const box = document.createElement("td");
    box.textContent = cell;
    if (bad.includes(index) && cell > 0) box.className = "bad";
    line.append(box);
  });
  return line;
}

function button(text, label, action) {
  const node = document.createElement("button");
  node.type = "button";
  node.textContent = text;
  node.setAttribute("aria-label", label);
  node.onclick = action;
  return node;
}

function showLink() {
  $("link").classList.toggle("ok", hilrig.connected);
  say("link", hilrig.connected ? "connected" : "the rig does not answer");
}

function showNow() {
  const { now, stage } = hilrig, pc = now.pc;
  const seconds = now.at_ns / 1e9;
  say("play", now.paused ? "Play" : "Pause");
  if (document.activeElement !== $("speed")) $("speed").value = String(now.speed);
  const slider = $("time");
  slider.max = String(hilrig.samples.length ? hilrig.samples[hilrig.samples.length - 1][0] : 0);
  if (!hilrig.past) {
    slider.value = slider.max;
    say("at", `${seconds.toFixed(1)} s${now.paused ? ", paused" : ""}`);
  }
  if (!stage.pc || !pc) { say("pc-state", "on a port"); say("mode", now.mode ?? ""); return; }
  const silent = pc.heard_ms > 1500 ? `, silent for ${(pc.heard_ms / 1000).toFixed(0)} s` : "";
  say("pc-state", `${pc.connection}${silent}${now.trouble ? `: ${now.trouble}` : ""}`);
  say("connect", pc.connection === "closed" ? "Connect" : "Disconnect");
  const ticks = pc.state ? `, ${pc.state.to} ticks` : "";
  say("mode", `${now.mode ?? pc.state?.mode ?? "unknown"}${ticks}`);
  say("pose", pc.pose ? `${pc.pose[0]} mm, ${pc.pose[1]} mm, ${pc.pose[2]}\u00b0` : "not told yet");
  say("rows", pc.rows_missing === null ? "no map yet" : String(pc.rows_missing));
  say("confirmed", pc.waypoints.length ? (pc.confirmed ? "confirmed" : "on their way") : "");
  once("waypoints", pc.waypoints, () => pc.waypoints.map(waypointItem));
}

function waypointItem(place, index) {
  const item = document.createElement("li");
  const number = (axis) => {
    const input = document.createElement("input");
    input.type = "number";
    input.value = place[axis];
    input.setAttribute("aria-label", `${"xy"[axis]} of waypoint ${index + 1}, mm`);
    input.onchange = () => {
      const to = [...place];
      to[axis] = Math.round(Number(input.value));
      input.blur();
      send({ do: "move", index, from: place, to });
    };
    return input;
  };
  item.append(number(0), " ", number(1), " ",
    button("Delete", `delete waypoint ${index + 1}`, (event) => {
      event.target.blur();
      send({ do: "delete", index, at: place });
    }));
  return item;
}

function showSlow() {
  const slow = hilrig.slow;
  once("wires", slow.lanes, () => slow.lanes.flatMap(wireRows));
  once("axes", slow.axes, () => (slow.axes ?? []).map(axisRow));
  once("panels", slow.panels, () => (slow.panels ?? []).map(panelItem));
  once("counters", slow.counters, () => slow.counters.map(([name, value]) => row([name, value])));
  once("faults", slow.faults, () => slow.faults.slice(-30).map(faultItem));
}

// What an axis is told, what it does, and its limit.
function axisRow({ name, unit, set_point, limit, actual }) {
  const told = actual === null ? `${set_point}` : `${set_point}, is ${actual}`;
  return row([name, `${told} ${unit}${limit === null ? "" : ` (at most ${limit})`}`]);
}

// A panel of the robot's: values that belong together, folded by a click.
function panelItem({ name, rows }) {
  const item = document.createElement("details"), head = document.createElement("summary");
  const table = document.createElement("table"), body = document.createElement("tbody");
  item.open = !hilrig.folded.has(name);
  item.addEventListener("toggle", () => hilrig.folded[item.open ? "delete" : "add"](name));
  head.textContent = name;
  fill(body, rows.map(({ name, address, value, unit }) =>
    row([address === null ? name : `${address} ${name}`, `${value} ${unit}`])));
  table.append(body);
  item.append(head, table);
  return item;
}

function wireRows(lane) {
  return ["to-master", "to-device"].map((way) => {
    const { load, tally } = lane[way];
    const name = `${lane.name} ${way === "to-master" ? "<" : ">"}`;
    return row([name, `${(load * 100).toFixed(1)} %`, tally.bytes, tally.frames, tally.errors,
      tally.faults], [4, 5]);
  });
}

function faultItem({ id, state, fault }) {
  const item = document.createElement("li");
  const what = fault.byte !== undefined ? `byte ${fault.byte}`
    : fault.rate !== undefined ? `${fault.rate} a byte` : "";
  const until = fault.until ? ` until ${fault.until}` : "";
  const place = fault.link ? `${fault.link} ${fault.direction}`
    : fault.device ?? fault.devices.join(", ");
  item.append(`${fault.kind} on ${place} ${what}${until}: ${state} `);
  if (state !== "over") {
    item.append(button("End", `end fault ${id}`, (event) => {
      event.target.blur();
      send({ do: "end-fault", id });
    }));
  }
  return item;
}

function showEvents() {
  const list = $("events");
  const atEnd = list.scrollTop + list.clientHeight >= list.scrollHeight - 20;
  fill(list, hilrig.events.slice(-EVENTS_SHOWN).map((event) => {
    const item = document.createElement("li");
    item.textContent = `${event.at.toFixed(3)} ${event.source} ${event.rule} ${event.detail}`;
    if (event.violation) item.className = "violation";
    return item;
  }));
  if (atEnd) list.scrollTop = list.scrollHeight;
}

// ---- the past

function goLive() {
  hilrig.past = null;
  $("live").disabled = true;
  canvas.classList.remove("past");
  requestDraw();
}

$("time").oninput = () => {
  const at = Number($("time").value), samples = hilrig.samples;
  let index = samples.findIndex((sample) => sample[0] > at) - 1;
  if (index < 0) index = samples.length - 1;
  if (index < 0) return;
  const past = hilrig.past = { index, maps: hilrig.past?.maps ?? {}, images: {} };
  $("live").disabled = false;
  canvas.classList.add("past");
  say("at", `${(samples[index][0] / 1000).toFixed(1)} s, recorded`);
  requestDraw();
  fetch(`/map?at_ms=${Math.round(samples[index][0])}`)
    .then((reply) => reply.ok ? reply.arrayBuffer() : null)
    .then((rows) => {
      if (!rows || hilrig.past !== past) return;
      past.maps = {};
      putRows(new Uint8Array(rows), past.maps);
      unpack(past.maps, hilrig.now.maps);
      past.images = {};
      requestDraw();
    }).catch(() => refuse("the recorded map cannot be had"));
};
$("live").onclick = goLive;

// ---- waypoints by mouse

const place = (event) => {
  const box = canvas.getBoundingClientRect();
  const px = (event.clientX - box.left) * canvas.width / box.width;
  const py = (event.clientY - box.top) * canvas.height / box.height;
  return { px, py, mm: view.toWorld(frame, px, py).map((metres) => Math.round(metres * 1000)) };
};

// The waypoint under the pointer, the topmost first.
function waypointAt({ px, py }) {
  const list = hilrig.now?.pc?.waypoints ?? [];
  for (let index = list.length - 1; index >= 0; index--) {
    const [x, y] = view.toPixel(frame, list[index][0] / 1000, list[index][1] / 1000);
    if (Math.hypot(px - x, py - y) <= 12) return index;
  }
  return null;
}

canvas.onpointerdown = (event) => {
  if (event.button !== 0 || hilrig.past || !frame || !hilrig.stage?.pc) return;
  const start = place(event), index = waypointAt(start);
  canvas.setPointerCapture(event.pointerId);
  const from = index === null ? null : hilrig.now.pc.waypoints[index];
  drag = { start, index, from, to: start.mm, moved: false };
};
canvas.onpointermove = (event) => {
  if (!frame) return;
  const at = place(event);
  say("where", `${at.mm[0]} mm, ${at.mm[1]} mm`);
  if (!drag) return;
  drag.to = at.mm;
  drag.moved ||= Math.hypot(at.px - drag.start.px, at.py - drag.start.py) > 4;
  requestDraw();
};
canvas.onpointerup = (event) => {
  if (!drag) return;
  const { index, from, moved } = drag, to = place(event).mm;
  drag = null;
  if (index === null && !moved) send({ do: "add", at: to });
  else if (index !== null && moved) send({ do: "move", index, from, to });
  requestDraw();
};
canvas.onpointercancel = () => { drag = null; requestDraw(); };
canvas.oncontextmenu = (event) => {
  event.preventDefault();
  if (hilrig.past || !frame) return;
  const index = waypointAt(place(event));
  if (index !== null) send({ do: "delete", index, at: hilrig.now.pc.waypoints[index] });
};

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

// ---- modes and driving

// A button for each mode that the robot's station can order.
function offerModes(modes) {
  $("modes").replaceChildren(...modes.map((mode) => {
    const node = document.createElement("button");
    node.type = "button";
    node.dataset.mode = mode;
    node.textContent = mode[0].toUpperCase() + mode.slice(1);
    node.onclick = () => { stopDriving(); send({ do: "mode", mode }); };
    return node;
  }));
}
$("connect").onclick = () =>
  send({ do: hilrig.now?.pc?.connection === "closed" ? "connect" : "disconnect" });

const keys = new Set();
let driving = null;
const directions = {
  ArrowUp: ["ahead", 1], KeyW: ["ahead", 1], ArrowDown: ["ahead", -1], KeyS: ["ahead", -1],
  ArrowLeft: ["left", 1], KeyA: ["left", 1], ArrowRight: ["left", -1], KeyD: ["left", -1],
};

// What the pressed keys come to, a set-point for each axis.
function axes() {
  const { limit, ...adds } = hilrig.stage.keys;
  return limit.map((most, axis) => {
    let sum = 0;
    for (const key of keys) sum += adds[directions[key][0]][axis] * directions[key][1];
    return Math.max(-most, Math.min(most, sum));
  });
}

// Said again and again: a robot whose page is gone has to stop.
function startDriving() {
  keys.clear();
  $("drive").setAttribute("aria-pressed", "true");
  send({ do: "drive", axes: axes() });
  driving = setInterval(() => send({ do: "drive", axes: axes() }), 250);
}

function stopDriving() {
  if (driving === null) return;
  clearInterval(driving);
  driving = null;
  keys.clear();
  $("drive").setAttribute("aria-pressed", "false");
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

// ---- clock and faults

$("play").onclick = () => send({ do: hilrig.now?.paused ? "play" : "pause" });
$("step").onclick = () => send({ do: "step", ms: Number($("step-ms").value) });
$("speed").onchange = () => send({ do: "speed", x: Number($("speed").value) });
$("restart").onclick = () => {
  const seed = $("seed").value === "" ? null : Math.max(0, Math.round(Number($("seed").value)));
  send({ do: "restart", seed });
};
$("fault").onsubmit = (event) => {
  event.preventDefault();
  const kind = $("fault-kind").value, seconds = Number($("fault-s").value);
  const fault = { link: $("fault-link").value, direction: $("fault-way").value, kind };
  if (kind !== "cut") fault.rate = Number($("fault-rate").value);
  send({ do: "fault", fault, for_ms: seconds > 0 ? Math.round(seconds * 1000) : null });
};
for (const id of ["map", "layer", "show-world", "show-scan", "show-ways", "show-waypoints"]) {
  $(id).onchange = requestDraw;
}

open();
