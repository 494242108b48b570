// ---- world and map: layers, zoom, pan, waypoints by mouse

const canvas = $("world");
let drag = null, frame = null;
// The visible section, in metres; `null` is the whole.
let camera = null;

function beginStage() {
  camera = null;
}

const metres = (list) => list.flatMap(([x, y]) => [x / 1000, y / 1000]);

function bounds(map) {
  const { scene } = hilrig.stage;
  const [x, y] = map?.origin_m ?? [0, 0];
  const size = map
    ? [x, y, x + map.width * map.resolution_m, y + map.height * map.resolution_m] : null;
  if (!scene) return size ?? [0, 0, 3, 3];
  const [a, b, c, d] = scene.bounds;
  if (!size) return scene.bounds;
  const [left, low, right, high] = size;
  return [Math.min(a, left), Math.min(b, low), Math.max(c, right), Math.max(d, high)];
}

// Maps that only some robots have.
function offerMaps(heads) {
  const options = [...$("map").options];
  for (const { name } of heads) {
    if (name === "display" || options.some((option) => option.value === name)) continue;
    $("map").append(make("option", name, { value: name }));
  }
  // Maps that this robot lacks are not offered and not selected.
  const there = (name) => name === "" || heads.some((head) => head.name === name && head.width);
  for (const option of $("map").options) option.hidden = !there(option.value);
  const none = heads.every(({ name, width }) => name === "display" || !width);
  $("map").parentElement.hidden = $("layer").parentElement.hidden = none;
}

function mapPicture(name, map) {
  const layer = $("layer").value, key = `${name} ${layer} ${view.colours.isDark}`;
  if (hilrig.past) return hilrig.past.images[key] ??= view.mapImage(map, layer);
  if (dirty[name] || !images[key]) {
    for (const old of Object.keys(images)) if (old.startsWith(`${name} `)) delete images[old];
    images[key] = view.mapImage(map, layer);
    dirty[name] = false;
  }
  return images[key];
}

// Gives the canvas as many pixels as the screen shows.
function fitCanvas() {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth, clientHeight } = canvas;
  const [width, height] = [clientWidth, clientHeight].map((size) => Math.round(size * ratio));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  return ratio;
}

// The whole, as large as possible and not under the list of layers: in the middle, or to the right
// of the list.
function fitBeside(bounds, ratio) {
  const margin = 24 * ratio, whole = view.fit(canvas, bounds, margin);
  const { offsetLeft, offsetTop, offsetWidth, offsetHeight } = $("layers");
  const [right, low] = [offsetLeft + offsetWidth, offsetTop + offsetHeight].map((at) => at * ratio);
  const [left, top] = view.toPixel(whole, bounds[0], bounds[3]);
  const taken = Math.max(right - 16 * ratio, 0);
  if (left >= right || top >= low || taken > canvas.width / 2) return whole;
  const { width, height } = canvas;
  const beside = view.fit({ width: width - taken, height }, bounds, margin);
  return { ...beside, x: beside.x - taken / beside.scale };
}

function drawWorld() {
  if (hilrig.stage.body === false) return;
  const ratio = fitCanvas(), context = canvas.getContext("2d");
  const { now, maps, scan, overlays } = seen(), name = $("map").value, map = maps[name];
  frame = camera ? { ...camera, height: canvas.height } : fitBeside(bounds(map), ratio);
  view.clear(context);
  if (map) view.drawMap(context, frame, map, mapPicture(name, map));
  if ($("show-grid").checked) view.drawGrid(context, frame, ratio);
  const scene = now.scene ?? hilrig.stage.scene;
  if ($("show-world").checked && scene) view.drawWorld(context, frame, scene);
  drawGhost(context);
  drawWays(context, now);
  if ($("show-scan").checked && scan?.points) view.drawScan(context, frame, scan.points);
  for (const overlay of overlays) {
    if (!hilrig.hidden.has(overlay.name)) view.drawOverlay(context, frame, overlay);
  }
  if ($("show-waypoints").checked) {
    const goals = seen().slow?.goals ?? [];
    if (now.pc) view.drawWaypoints(context, frame, metres(dragged(now.pc.waypoints)), [], marked);
    else {
      const reached = goals.map(({ visited }) => visited !== null);
      view.drawWaypoints(context, frame, goals.flatMap(({ at }) => at), reached, marked);
    }
  }
  const { footprint } = hilrig.stage;
  // Both poses at the time of the estimate, so that their distance shows error and not age.
  const truth = now.gap?.truth ?? now.truth;
  if (truth) view.drawRobot(context, frame, truth, footprint, view.colours.truth);
  if (now.believed) view.drawRobot(context, frame, now.believed, footprint, view.colours.belief);
  if (drag?.act) {
    const pose = [...drag.start.metres, lookedAt(drag)];
    view.drawRobot(context, frame, pose, footprint, view.colours.waypoint);
  }
}

function wayOf(samples, slot, from, until) {
  const path = [];
  for (const sample of samples) {
    if (sample[0] < from) continue;
    if (sample[0] > until) break;
    if (sample[slot]) path.push(sample[slot][0], sample[slot][1]);
  }
  return path;
}

function drawWays(context, now) {
  const until = now.at_ns / 1e6;
  const way = (id, slot, colour) => {
    if ($(id).checked) {
      view.drawPath(context, frame, wayOf(hilrig.samples, slot, 0, until), colour);
    }
  };
  way("show-truth", 1, view.colours.truth);
  way("show-belief", 2, view.colours.belief);
}

// The path of the earlier run after the time of the branch.
function drawGhost(context) {
  if (!hilrig.ghost || !$("show-truth").checked) return;
  context.setLineDash([3, 5]);
  const way = wayOf(hilrig.ghost.samples, 1, hilrig.ghost.at, Infinity);
  view.drawPath(context, frame, way, view.colours.dim);
  context.setLineDash([]);
}

// ---- zoom and pan

function zoomAt(px, py, factor) {
  if (!frame) return;
  const [x, y] = view.toWorld(frame, px, py);
  const scale = Math.min(Math.max(frame.scale * factor, 2), 20000);
  camera = { scale, x: x - px / scale, y: y - (canvas.height - py) / scale };
  requestDraw();
}

const zoomMiddle = (factor) => zoomAt(canvas.width / 2, canvas.height / 2, factor);

function pan(px, py) {
  if (!frame) return;
  const { scale, x, y } = frame;
  camera = { scale, x: x - px / scale, y: y + py / scale };
  requestDraw();
}

function fitAll() {
  camera = null;
  requestDraw();
}

$("zoom-in").onclick = () => zoomMiddle(1.4);
$("zoom-out").onclick = () => zoomMiddle(1 / 1.4);
$("zoom-fit").onclick = fitAll;
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  const { px, py } = place(event);
  zoomAt(px, py, Math.exp(-Math.max(-1, Math.min(1, event.deltaY / 240)) * 0.6));
}, { passive: false });
canvas.addEventListener("keydown", (event) => {
  const step = canvas.width / 12;
  const by = {
    ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step],
  };
  if (driving !== null || !by[event.key]) return;
  event.preventDefault();
  pan(...by[event.key]);
});

// ---- waypoints by mouse

const place = (event) => {
  const box = canvas.getBoundingClientRect();
  const px = (event.clientX - box.left) * canvas.width / box.width;
  const py = (event.clientY - box.top) * canvas.height / box.height;
  const metres = view.toWorld(frame, px, py);
  return { px, py, metres, mm: metres.map((value) => Math.round(value * 1000)) };
};

// Direction from the press to the pointer, radians; 0 if the pointer was not moved.
const lookedAt = ({ start, last, moved }) =>
  moved ? Math.atan2(start.py - last.py, last.px - start.px) : 0;

// The list, with the dragged waypoint at the pointer.
function dragged(list) {
  if (!drag || drag.index === null || !drag.moved) return list;
  return list.map((place, index) => index === drag.index ? drag.to : place);
}

// Index of the waypoint under the pointer, on the map or in the list.
let marked = null;

function markWaypoint(index) {
  if (marked === index) return;
  marked = index;
  for (const list of [$("waypoints"), $("goals")]) {
    [...list.children].forEach((item, at) => item.classList.toggle("marked", at === index));
  }
  const isMovable = index !== null && !hilrig.past && Boolean(hilrig.stage?.pc);
  canvas.classList.toggle("on-waypoint", isMovable);
  requestDraw();
}

// A new list of `places` has no mark.
function unmarked(places) {
  markWaypoint(null);
  return places;
}

// The topmost of `places`, metres, under the pointer.
function placeAt({ px, py }, places) {
  return places.findLastIndex(([x0, y0]) => {
    const [x, y] = view.toPixel(frame, x0, y0);
    return Math.hypot(px - x, py - y) <= 12;
  });
}

// The shown waypoint or goal under the pointer.
function shownAt(at) {
  const pc = seen().now.pc, goals = seen().slow?.goals ?? [];
  const places = pc
    ? pc.waypoints.map(([x, y]) => [x / 1000, y / 1000])
    : goals.map((one) => one.at);
  const index = aiming ? -1 : placeAt(at, places);
  return index < 0 ? null : index;
}

// The waypoint under the pointer that can be moved.
function waypointAt(at) {
  return hilrig.past || !hilrig.stage?.pc || !hilrig.now?.pc ? null : shownAt(at);
}

// Two fingers zoom.
const fingers = new Map();
const apart = () => {
  const [a, b] = [...fingers.values()];
  const far = Math.hypot(a.px - b.px, a.py - b.py);
  return { px: (a.px + b.px) / 2, py: (a.py + b.py) / 2, far };
};

canvas.onpointerdown = (event) => {
  if (event.button > 1 || !frame) return;
  const start = place(event), index = waypointAt(start);
  canvas.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, start);
  const from = index === null ? null : hilrig.now.pc.waypoints[index];
  drag = fingers.size === 1 && {
    start, last: start, index, from, to: start.mm, moved: false, act: hilrig.past ? null : aiming,
  };
};
canvas.onpointermove = (event) => {
  if (!frame) return;
  const at = place(event);
  say("where", `${(at.mm[0] / 1000).toFixed(3)} m, ${(at.mm[1] / 1000).toFixed(3)} m`);
  if (fingers.size === 2 && fingers.has(event.pointerId)) {
    const before = apart();
    fingers.set(event.pointerId, at);
    const after = apart();
    if (before.far > 0) zoomAt(after.px, after.py, after.far / before.far);
    return;
  }
  if (!drag) { markWaypoint(shownAt(at)); return; }
  drag.to = at.mm;
  drag.moved ||= Math.hypot(at.px - drag.start.px, at.py - drag.start.py) > 4;
  const pans = drag.index === null && drag.moved && !drag.act;
  if (pans) pan(at.px - drag.last.px, at.py - drag.last.py);
  drag.last = at;
  requestDraw();
};
canvas.onpointerup = (event) => {
  fingers.delete(event.pointerId);
  if (!drag) return;
  const { index, from, moved, act, start } = drag, to = place(event).mm;
  const heading = lookedAt(drag);
  drag = null;
  if (act) { perform(act, start.metres, heading); return; }
  const canSteer = !hilrig.past && hilrig.stage?.pc;
  if (canSteer && index === null && !moved) send({ do: "add", at: to });
  else if (canSteer && index !== null && moved) send({ do: "move", index, from, to });
  requestDraw();
};
canvas.onpointerleave = () => markWaypoint(null);
canvas.onpointercancel = (event) => {
  fingers.delete(event.pointerId);
  drag = null;
  requestDraw();
};
canvas.oncontextmenu = (event) => {
  event.preventDefault();
  if (!frame) return;
  const index = waypointAt(place(event));
  if (index !== null) send({ do: "delete", index, at: hilrig.now.pc.waypoints[index] });
};
canvas.ondblclick = fitAll;

for (const id of ["map", "layer", "show-world", "show-truth", "show-belief", "show-scan",
  "show-waypoints", "show-grid"]) {
  $(id).onchange = requestDraw;
}
