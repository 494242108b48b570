// ---- the time line: lanes, faults, events, plots, and the displayed time

const lanes = $("lanes");
// The visible range, seconds; `null` is the whole run, and grows with it.
let span = null, lineDrawn = 0, lineDrag = null;
// The plotted series, by group and name.
const plotted = new Set(["error position error"]);

function beginLine() {
  span = null;
  $("series").replaceChildren();
}

const nameOf = ({ group, name }) => `${group} ${name}`;

// A box for each series.
function offerSeries() {
  const groups = new Map();
  for (const one of hilrig.series) {
    const set = groups.get(one.group) ?? make("fieldset");
    if (!groups.has(one.group)) set.append(make("legend", one.group));
    groups.set(one.group, set);
    const box = make("input", "", { type: "checkbox", checked: plotted.has(nameOf(one)) });
    box.onchange = () => {
      plotted[box.checked ? "add" : "delete"](nameOf(one));
      drawLine(true);
    };
    const label = make("label");
    label.append(box, ` ${one.name}${one.unit ? ` (${one.unit})` : ""}`);
    set.append(label);
  }
  $("series").replaceChildren(...groups.values());
}

function wireLinks(at, bars) {
  const { samples, stage } = hilrig;
  const wayOn = (link, index, side) => {
    const direction = side ? "to-device" : "to-master";
    const damage = bars.filter((bar) => bar.link === link.name && bar.direction === direction)
      .map((bar) => [bar.from, bar.to]);
    const lane = { at, load: [], errors: [], faults: [], damage };
    let before = [0, 0, 0, 0], time = 0;
    for (const sample of samples) {
      const counts = sample[3][2 * index + side], seconds = Math.max(sample[0] - time, 1) / 1000;
      lane.load.push((counts[0] - before[0]) * 10 / link.baud / seconds);
      lane.errors.push(counts[2] - before[2]);
      lane.faults.push(counts[3] - before[3]);
      [before, time] = [counts, sample[0]];
    }
    return lane;
  };
  return stage.links.map((link, index) =>
    ({ name: link.name, ways: [0, 1].map((side) => wayOn(link, index, side)) }));
}

// A duration of a scenario, such as `1.5s` or `200ms`, in seconds.
function seconds(text) {
  const units = { ns: 1e-9, us: 1e-6, ms: 1e-3, s: 1, min: 60, h: 3600 };
  const [, number, unit] = /^\s*([\d.]+)\s*([a-z]+)$/.exec(text ?? "") ?? [];
  return unit in units ? Number(number) * units[unit] : null;
}

const placeOf = (fault) => fault.link ?? fault.device ?? (fault.devices ?? []).join(", ");

// The time of a fault's end, if it is known.
function endOf({ from, until, lasting, every }) {
  const ends = lasting && !every ? (seconds(from) ?? 0) + seconds(lasting) : null;
  return seconds(until) ?? ends;
}

function model() {
  const { samples, stage } = hilrig, now = hilrig.now.at_ns / 1e9;
  const at = samples.map((sample) => sample[0] / 1000);
  // Faults of a single byte are marks in its lane instead.
  const lasting = (hilrig.slow?.faults ?? []).filter(({ fault }) => fault.byte === undefined);
  const bars = lasting.map(({ fault, state }) => ({
    link: fault.link, direction: fault.direction,
    name: `${fault.kind} ${placeOf(fault)}`,
    from: seconds(fault.from) ?? 0,
    to: endOf(fault),
    isOver: state === "over",
  })).filter((bar) => bar.from <= now);
  const marks = hilrig.events.slice(-2000).map((event) => ({
    at: event.at,
    kind: event.violation ? "violation" : event.rule.startsWith("fault-") ? "fault" : "event",
  }));
  for (const check of hilrig.checks?.checks ?? []) {
    const time = check.state === "fail" ? firstTime(check.detail) : null;
    if (time !== null) marks.push({ at: time, kind: "fail" });
  }
  const plots = hilrig.series.flatMap((one, index) => plotted.has(nameOf(one))
    ? [{ name: one.name, unit: one.unit, at, values: samples.map((sample) => sample[4][index]) }]
    : []).concat(hilrig.plots);
  const [from, to] = span ?? [0, Math.max(now, 1)];
  const cursor = seen().now.at_ns / 1e9;
  const wires = stage.kind === "rig" ? wireLinks(at, bars) : [];
  return { from, to, links: wires, bars, marks, plots, cursor };
}

// Redraws at a limited rate, or at once while the operator moves the slider.
function drawLine(atOnce = false) {
  const slider = $("time"), end = Math.ceil(hilrig.now.at_ns / 1e6);
  slider.max = String(end);
  const at = seen().now.at_ns / 1e6;
  if (document.activeElement !== slider || !hilrig.past) slider.value = String(Math.round(at));
  slider.setAttribute("aria-valuetext", clockText(at / 1000));
  const time = performance.now();
  if (!atOnce && !hilrig.past && !hilrig.now.paused && time - lineDrawn < 150) return;
  lineDrawn = time;
  const high = hilrigLanes.draw(lanes, model(), lanes.clientWidth, window.devicePixelRatio || 1);
  lanes.style.height = `${high}px`;
}

$("time").oninput = () => {
  const at = Number($("time").value);
  if (at >= Number($("time").max)) goLive(); else goTo(at);
};
$("live").onclick = goLive;
$("branch").onclick = branch;
$("all-time").onclick = () => { span = null; drawLine(true); };

function branch() {
  if (hilrig.past) send({ do: "branch", at_ns: hilrig.past.now.at_ns });
}

// ---- by mouse: click goes there, drag pans, wheel zooms at the pointer

const timeAt = (event) => {
  const box = lanes.getBoundingClientRect(), { from, to } = model();
  return hilrigLanes.toTime({ from, to }, box.width, event.clientX - box.left);
};

lanes.addEventListener("wheel", (event) => {
  if (event.shiftKey || !hilrig.now) return;
  event.preventDefault();
  const at = timeAt(event), { from, to } = model(), now = hilrig.now.at_ns / 1e9;
  const factor = Math.exp(Math.max(-1, Math.min(1, event.deltaY / 240)) * 0.6);
  const [a, b] = [from, to].map((edge) => at + (edge - at) * factor);
  span = b - a >= now ? null : [Math.max(a, 0), Math.max(Math.min(b, now + 1), a + 0.05)];
  drawLine(true);
}, { passive: false });
lanes.onpointerdown = (event) => {
  if (event.button !== 0 || !hilrig.now) return;
  lanes.setPointerCapture(event.pointerId);
  lineDrag = { x: event.clientX, span: span && [...span], moved: false };
};
lanes.onpointermove = (event) => {
  if (!lineDrag) return;
  const by = event.clientX - lineDrag.x;
  lineDrag.moved ||= Math.abs(by) > 4;
  if (!lineDrag.moved || !lineDrag.span) return;
  const [a, b] = lineDrag.span;
  const width = hilrigLanes.toPixel({ from: a, to: b }, lanes.clientWidth, b)
    - hilrigLanes.toPixel({ from: a, to: b }, lanes.clientWidth, a);
  const shift = Math.max(-by / width * (b - a), -a);
  span = [a + shift, b + shift];
  drawLine(true);
};
lanes.onpointerup = (event) => {
  if (lineDrag && !(lineDrag.moved && lineDrag.span)) goTo(timeAt(event) * 1000);
  lineDrag = null;
};
lanes.onpointercancel = () => { lineDrag = null; };

// ---- its height

function setHeight(pixels) {
  const high = Math.round(Math.min(Math.max(pixels, 80), window.innerHeight * 0.7));
  document.documentElement.style.setProperty("--low", `${high}px`);
  $("grip").setAttribute("aria-valuenow", String(high));
  requestDraw();
}
$("grip").onpointerdown = (event) => $("grip").setPointerCapture(event.pointerId);
$("grip").onpointermove = (event) => {
  if (event.buttons) setHeight(window.innerHeight - event.clientY);
};
$("grip").onkeydown = (event) => {
  const by = { ArrowUp: 24, ArrowDown: -24 }[event.key];
  if (by) { event.preventDefault(); setHeight($("line").clientHeight + by); }
};
