// Draws the report from the JSON in #run: world, map and ways at the time that is chosen, wires.
"use strict";
(() => {
  const run = JSON.parse(document.getElementById("run").textContent);
  const view = hilrigView;
  const at = (id) => document.getElementById(id);
  const world = at("world"), lanes = at("lanes"), time = at("time");

  // How many of the sorted `times` are not after `now`.
  function until(times, now) {
    let low = 0, high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] <= now) low = middle + 1; else high = middle;
    }
    return low;
  }

  // The last of `samples` that is not after `now`.
  function latest(samples, now) {
    const count = until(samples.map((sample) => sample.at), now);
    return count > 0 ? samples[count - 1] : null;
  }

  // Places and last pose of a way up to `now`.
  function wayUntil(way, now) {
    const count = until(way.at, now), path = [];
    for (let i = 0; i < count; i++) path.push(way.poses[3 * i], way.poses[3 * i + 1]);
    return { path, pose: count > 0 ? way.poses.slice(3 * count - 3, 3 * count) : null };
  }

  const images = new Map(), hidden = new Set();
  // Maps besides the robot's own are as they were in the end.
  function otherImage(map, layer) {
    const key = `${map.name} ${layer}`;
    if (!images.has(key)) {
      const cells = view.cells(view.bytes(map.runs), map.width * map.height);
      images.set(key, view.mapImage({ ...map, cells }, layer));
    }
    return images.get(key);
  }

  function mapImage(sample, layer) {
    const key = `${sample.at} ${layer}`;
    if (!images.has(key)) {
      const count = run.map.width * run.map.height;
      const cells = sample.runs ? view.cells(view.bytes(sample.runs), count)
        : view.shades(view.bytes(sample.shades), count);
      images.set(key, view.mapImage({ ...run.map, cells }, layer));
    }
    return images.get(key);
  }

  function bounds() {
    const [x0, y0, x1, y1] = run.scene.bounds;
    if (!run.map) return run.scene.bounds;
    const [left, low] = run.map.origin_m;
    const wide = left + run.map.width * run.map.resolution_m;
    const high = low + run.map.height * run.map.resolution_m;
    return [Math.min(x0, left), Math.min(y0, low), Math.max(x1, wide), Math.max(y1, high)];
  }

  function drawWay(context, frame, way, colour, now) {
    const { path, pose } = wayUntil(way, now);
    view.drawPath(context, frame, path, colour);
    if (pose) view.drawRobot(context, frame, pose, run.footprint, colour);
  }

  function draw() {
    const now = Number(time.value), context = world.getContext("2d");
    const frame = view.fit(world, bounds()), layer = at("layer").value;
    const shows = (what) => at(`show-${what}`).checked;
    at("at").textContent = `${now.toFixed(2)} s`;
    view.clear(context);
    const other = run.layers.find((map) => map.name === at("map").value);
    const map = latest(run.maps, now);
    if (other && layer) view.drawMap(context, frame, other, otherImage(other, layer));
    else if (map && layer) view.drawMap(context, frame, run.map, mapImage(map, layer));
    if (shows("world")) view.drawWorld(context, frame, run.scene);
    if (shows("truth")) drawWay(context, frame, run.truth, view.colours.truth, now);
    if (shows("believed")) drawWay(context, frame, run.believed, view.colours.belief, now);
    const scan = latest(run.scans, now);
    if (scan && shows("scan")) view.drawScan(context, frame, scan.points);
    for (const overlay of latest(run.overlays, now)?.overlays ?? []) {
      if (!hidden.has(overlay.name)) view.drawOverlay(context, frame, overlay);
    }
    if (shows("waypoints")) view.drawWaypoints(context, frame, run.waypoints);
    const wires = lanes.getContext("2d");
    view.clear(wires);
    view.drawLanes(wires, run.lanes, 0, run.end, run.marks, now);
  }

  function go(seconds) {
    time.value = String(seconds);
    draw();
  }

  lanes.height = (run.lanes.length + 1) * view.laneHeight;
  time.max = String(Math.ceil(run.end * 20) / 20);
  time.addEventListener("input", draw);
  for (const { overlays } of run.overlays) {
    view.offerOverlays(at("overlays"), overlays, hidden, draw);
  }
  at("maps").hidden = run.layers.length === 0;
  for (const { name } of run.layers) {
    const option = document.createElement("option");
    option.value = option.textContent = name;
    at("map").append(option);
  }
  for (const field of document.querySelectorAll(".bar select, .bar [type=checkbox]")) {
    field.addEventListener("change", draw);
  }
  lanes.addEventListener("click", (event) => {
    const box = lanes.getBoundingClientRect();
    const x = (event.clientX - box.left) * lanes.width / box.width;
    go(view.pixelToTime(lanes, 0, run.end, x));
  });
  document.addEventListener("click", (event) => {
    const jump = event.target.closest(".jump");
    if (!jump) return;
    go(Number(jump.dataset.at));
    world.scrollIntoView({ block: "nearest" });
  });
  if (run.display) {
    const canvas = at("display"), { width, height, runs } = run.display;
    view.drawPicture(canvas, width, height, view.bytes(runs));
  }
  go(run.end);
})();
