// The live page: messages of the server update `hilrig`, the page draws `hilrig`, and the
// operator's actions are sent. All text from a wire is shown as text, never as markup. The parts
// that follow share this scope: stage (world and map), timeline, robot, checks, faults, frames, exchanges, controls.
"use strict";
const hilrig = window.hilrig = {
  connected: false, stage: null, now: null, slow: null, scan: null, checks: null, maps: {},
  samples: [], series: [], events: [], refused: "", messages: 0, bytes: 0, past: null, ghost: null,
  errors: [], folded: new Set(), overlays: [], hidden: new Set(), talk: null, plots: [],
};
window.addEventListener("error", (event) => hilrig.errors.push(event.message));
window.addEventListener("unhandledrejection", (event) => hilrig.errors.push(String(event.reason)));
const $ = (id) => document.getElementById(id);
const view = hilrigView, clockText = hilrigLanes.clock;
let socket = null, images = {}, dirty = {}, shown = {};

// The displayed moment: a recorded one, or the newest.
const seen = () => hilrig.past ?? hilrig;

function send(command) {
  refuse("");
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(command));
  else refuse("not connected to the rig");
}

function refuse(why) {
  hilrig.refused = why;
  say("refused", why);
}

// ---- messages of the server

// Every request contains the token from the page's own address.
const query = (rest = "") =>
  `?token=${new URLSearchParams(location.search).get("token") ?? ""}${rest}`;

function open() {
  socket = new WebSocket(`ws://${location.host}/ws${query()}`);
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
    case "checks": hilrig.checks = message; break;
    case "series": hilrig.series = message.series; offerSeries(); break;
    case "overlays":
      hilrig.overlays = message.overlays;
      view.offerOverlays($("overlays"), message.overlays, hilrig.hidden, requestDraw);
      break;
    case "samples": hilrig.samples.splice(message.from, Infinity, ...message.samples); break;
    case "events":
      hilrig.events.splice(message.from, Infinity, ...message.events);
      break;
    case "refused": refuse(message.why); break;
  }
  requestDraw();
}

function begin(stage) {
  // After a branch, the path of the earlier run stays visible.
  const ghost = stage.branched_ns ? { at: stage.branched_ns / 1e6, samples: hilrig.samples } : null;
  Object.assign(hilrig, {
    stage, now: null, slow: null, scan: null, checks: null, maps: {}, samples: [], series: [],
    events: [], past: null, overlays: [], believes: false, ghost, talk: null, plots: [],
  });
  $("overlays").replaceChildren();
  images = {};
  shown = {};
  document.title = `${stage.name} - hilrig`;
  $("name").textContent = stage.seed === null ? stage.name : `${stage.name} seed ${stage.seed}`;
  $("about").textContent = stage.description;
  for (const kind of ["pc", "log"]) document.body.classList.toggle(kind, stage.kind === kind);
  document.body.classList.toggle("no-pc", !stage.pc);
  document.body.classList.toggle("bare", stage.body === false);
  document.body.classList.toggle("no-goals", Boolean(stage.pc) || !stage.goals?.length);
  $("stage").setAttribute("aria-label",
    stage.body === false ? "Requests and replies" : "World and map");
  say("tab-robot", stage.body === false ? "Devices" : "Robot");
  document.body.classList.toggle("no-pace", !stage.pace);
  if (stage.seed !== null) $("seed").value = stage.seed;
  if (stage.kind !== "rig") $("map").value = stage.kind === "pc" ? "pc" : "mapper";
  for (const part of [beginStage, beginRobot, beginFaults, beginFrames, beginLine]) part(stage);
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

// ---- the past

let wanted = null, asking = false;

function goLive() {
  wanted = null;
  hilrig.past = null;
  $("live").disabled = $("branch").disabled = true;
  document.body.classList.remove("past");
  requestDraw();
}

// Shows the newest moment recorded up to a time, milliseconds. While a request is on its way, only
// the last further request is kept.
function goTo(at_ms) {
  wanted = Math.max(at_ms, 0);
  if (!asking) ask();
}

async function ask() {
  asking = true;
  while (wanted !== null) {
    const at = wanted;
    wanted = null;
    try {
      const reply = await fetch(`/moment${query(`&at_ns=${Math.round(at * 1e6)}`)}`);
      if (!reply.ok) throw new Error(await reply.text());
      showMoment(new Uint8Array(await reply.arrayBuffer()));
    } catch (error) {
      refuse(`the recorded moment cannot be had: ${error.message}`);
    }
  }
  asking = false;
}

// | length of the JSON u32 | JSON | rows |
function showMoment(bytes) {
  const size = new DataView(bytes.buffer).getUint32(0, true);
  const told = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + size)));
  if (!hilrig.stage || told.now.run !== undefined && told.now.run > hilrig.stage.run) return;
  const past = { ...told, overlays: told.overlays.overlays ?? [], maps: {}, images: {} };
  putRows(bytes.subarray(4 + size), past.maps);
  unpack(past.maps, past.now.maps);
  hilrig.past = past;
  $("live").disabled = $("branch").disabled = false;
  document.body.classList.add("past");
  requestDraw();
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
  drawLine();
  showNow();
  showRobot();
  if (seen().checks) showChecks();
  if (seen().slow?.lanes) showSlow();
}

// ---- words

// Changes a text only if it differs, so that a screen reader does not repeat it.
function say(id, text) {
  const node = $(id);
  if (node.textContent !== text) node.textContent = text;
}

// Rebuilds a part of the page only when its data has changed, and never while a finger is on it.
function once(id, value, build) {
  const key = JSON.stringify(value ?? null);
  if (shown[id] === key || $(id).contains(document.activeElement)) return;
  shown[id] = key;
  $(id).replaceChildren(...build());
}

// An element with text and properties.
function make(name, text = "", properties = {}) {
  const node = Object.assign(document.createElement(name), properties);
  if (text !== "") node.textContent = text;
  return node;
}

function row(cells, bad = []) {
  const line = make("tr");
  cells.forEach((cell, index) => {
    const isBad = bad.includes(index) && cell > 0;
    line.append(make("td", String(cell), isBad ? { className: "bad" } : {}));
  });
  return line;
}

function button(text, label, action) {
  const node = make("button", text, { type: "button", onclick: action });
  node.setAttribute("aria-label", label);
  return node;
}

// A button that goes to a time, seconds.
function jump(at) {
  const node = button(clockText(at), `go to ${clockText(at)}`, () => goTo(at * 1000 + 1));
  node.className = "jump";
  return node;
}

function showLink() {
  $("link").classList.toggle("ok", hilrig.connected);
  say("link", hilrig.connected ? "connected" : "the rig does not answer");
}

function showNow() {
  const { now } = seen(), { stage } = hilrig;
  say("play", hilrig.now.paused ? "Play" : "Pause");
  const speed = $("speed");
  if (document.activeElement !== speed) {
    const value = String(hilrig.now.speed);
    // A speed that was set elsewhere.
    if (![...speed.options].some((option) => option.value === value)) {
      speed.append(make("option", `${value} x`, { value }));
    }
    speed.value = value;
  }
  const whole = stage.duration_ns ? ` / ${clockText(stage.duration_ns / 1e9, 0)}` : "";
  const state = hilrig.past ? ", recorded" : now.over ? ", ended" : now.paused ? ", paused" : "";
  say("at", `${clockText(now.at_ns / 1e9)}${whole}${state}`);
}
