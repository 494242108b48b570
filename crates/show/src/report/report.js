// Draws the report from the JSON in #run: world, map and paths at the selected time, links.
"use strict";
(() => {
  const run = JSON.parse(document.getElementById("run").textContent);
  const view = hilrigView, line = hilrigLanes;
  const at = (id) => document.getElementById(id);
  const world = at("world"), lanes = at("lanes"), time = at("time");
  const dark = window.matchMedia("(prefers-color-scheme: dark)");

  // Number of the sorted `times` that are not after `now`.
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
  // The picture of a map, made once.
  function picture(key, map, layer, cells) {
    const name = `${key} ${layer} ${view.colours.isDark}`;
    if (!images.has(name)) images.set(name, view.mapImage({ ...map, cells: cells() }, layer));
    return images.get(name);
  }

  // Maps other than the robot's own show the state at the end.
  const otherImage = (map, layer) => picture(map.name, map, layer,
    () => view.cells(view.bytes(map.runs), map.width * map.height));

  function mapImage(sample, layer) {
    const count = run.map.width * run.map.height;
    return picture(sample.at, run.map, layer, () => sample.runs
      ? view.cells(view.bytes(sample.runs), count) : view.shades(view.bytes(sample.shades), count));
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

  function drawWorld(now) {
    if (at("view").hidden) return;
    const context = world.getContext("2d"), layer = at("layer").value;
    const frame = view.fit(world, bounds());
    const shows = (what) => at(`show-${what}`).checked;
    view.clear(context);
    const other = run.layers.find((map) => map.name === at("map").value);
    const map = latest(run.maps, now);
    if (other && layer) view.drawMap(context, frame, other, otherImage(other, layer));
    else if (map && layer) view.drawMap(context, frame, run.map, mapImage(map, layer));
    view.drawGrid(context, frame, 1);
    if (shows("world")) view.drawWorld(context, frame, run.scene);
    if (shows("truth")) drawWay(context, frame, run.truth, view.colours.truth, now);
    if (shows("believed")) drawWay(context, frame, run.believed, view.colours.belief, now);
    const scan = latest(run.scans, now);
    if (scan && shows("scan")) view.drawScan(context, frame, scan.points);
    for (const overlay of latest(run.overlays, now)?.overlays ?? []) {
      if (!hidden.has(overlay.name)) view.drawOverlay(context, frame, overlay);
    }
    if (shows("waypoints")) view.drawWaypoints(context, frame, run.waypoints);
  }

  // ---- the time line

  const lanesOf = run.lanes.map((lane) => ({
    ...lane,
    at: lane.load.map((_, i) => (i + 1) * run.bin),
    damage: run.bars.filter((bar) => bar.lane === lane.name).map((bar) => [bar.from, bar.to]),
  }));
  // Both directions of a link come one after the other.
  const links = lanesOf.filter((_, i) => i % 2 === 0).map((lane, i) =>
    ({ name: lane.name.replace(/ to-master$/, ""), ways: lanesOf.slice(2 * i, 2 * i + 2) }));
  const plots = run.error.at.length
    ? [{ name: "position error", unit: "mm", at: run.error.at, values: run.error.mm }] : [];
  plots.push(...run.plots ?? []);
  const bars = run.bars.map((bar) => ({ ...bar, isOver: bar.to !== null && bar.to < run.end }));
  let span = [0, run.end];

  function draw() {
    const now = Number(time.value), [from, to] = span;
    at("at").textContent = line.clock(now, 2);
    time.setAttribute("aria-valuetext", line.clock(now, 2));
    drawWorld(now);
    const model = { from, to, links, bars, marks: run.marks, plots, cursor: now };
    const wide = lanes.clientWidth || 960;
    const high = line.draw(lanes, model, wide, window.devicePixelRatio || 1);
    lanes.style.height = `${high}px`;
  }

  function show(from, to) {
    span = [Math.max(from, 0), Math.min(Math.max(to, from + 0.05), run.end)];
    draw();
  }

  function go(seconds) {
    time.value = String(seconds);
    draw();
  }

  // Shows the two seconds before the shown time, and half a second after it.
  function near() {
    const now = Number(time.value);
    show(now - 2, now + 0.5);
  }

  // ---- playing: a minute takes twelve seconds, a short run plays in real time

  let playing = null;
  function stop() {
    playing = null;
    at("play").textContent = "Play";
  }
  function play() {
    if (playing !== null) return stop();
    // The slider has steps: its last one may lie before the end.
    if (Number(time.value) > run.end - 0.1) time.value = "0";
    const begun = performance.now(), from = Number(time.value);
    const speed = Math.max(run.end / 60, 1) * (run.end > 20 ? 5 : 1);
    const mine = playing = {};
    at("play").textContent = "Pause";
    const frame = (now) => {
      if (playing !== mine) return;
      const seconds = from + (now - begun) / 1000 * speed;
      go(Math.min(seconds, run.end));
      if (seconds >= run.end) stop(); else requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  time.max = String(Math.ceil(run.end * 20) / 20);
  time.addEventListener("input", () => { stop(); draw(); });
  at("play").addEventListener("click", play);
  at("near").addEventListener("click", near);
  at("all").addEventListener("click", () => show(0, run.end));
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

  const timeAt = (event) => {
    const box = lanes.getBoundingClientRect(), [from, to] = span;
    return line.toTime({ from, to }, box.width, event.clientX - box.left);
  };
  let drag = null;
  lanes.addEventListener("pointerdown", (event) => {
    lanes.setPointerCapture(event.pointerId);
    drag = { x: event.clientX, span, moved: false };
  });
  lanes.addEventListener("pointermove", (event) => {
    if (!drag) return;
    const [from, to] = drag.span, by = (event.clientX - drag.x) / lanes.clientWidth * (to - from);
    drag.moved ||= Math.abs(event.clientX - drag.x) > 4;
    if (drag.moved) show(Math.min(Math.max(from - by, 0), run.end - (to - from)), to - by);
  });
  lanes.addEventListener("pointerup", (event) => {
    if (drag && !drag.moved) { stop(); go(Math.min(Math.max(timeAt(event), 0), run.end)); }
    drag = null;
  });
  lanes.addEventListener("wheel", (event) => {
    event.preventDefault();
    const pivot = timeAt(event), [from, to] = span;
    const factor = Math.exp(Math.max(-1, Math.min(1, event.deltaY / 240)) * 0.6);
    show(pivot + (from - pivot) * factor, pivot + (to - pivot) * factor);
  }, { passive: false });

  document.addEventListener("click", (event) => {
    const jump = event.target.closest(".jump");
    if (!jump) return;
    stop();
    go(Number(jump.dataset.at));
    (at("view").hidden ? lanes : world).scrollIntoView({ block: "nearest" });
  });
  if (run.display) {
    const canvas = at("display"), { width, height, runs } = run.display;
    view.drawPicture(canvas, width, height, view.bytes(runs));
  }

  function theme(isDark) {
    view.setDark(isDark);
    draw();
  }
  dark.addEventListener("change", () => theme(dark.matches));
  window.addEventListener("resize", draw);
  // Printed with the light theme, because paper is white.
  window.addEventListener("beforeprint", () => theme(false));
  window.addEventListener("afterprint", () => theme(dark.matches));

  time.value = String(run.failed ?? run.end);
  view.setDark(dark.matches);
  if (run.failed === null) draw(); else near();
})();
