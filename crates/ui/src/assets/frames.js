// ---- received frames, in words and bytes

let framesAsked = 0, framesBusy = false, framesTold = [], frameChosen = null;

function beginFrames(stage) {
  framesTold = [];
  frameChosen = null;
  const lanes = stage.links.flatMap((link, index) => ["to-master", "to-device"].map((way, side) =>
    make("option", `${link.name} ${way}`, { value: String(2 * index + side) })));
  $("frames-lane").replaceChildren(make("option", "all", { value: "" }), ...lanes);
  $("frame").replaceChildren();
}

// Requests the newest frames up to the displayed time, as long as the panel is visible.
function showFrames(atOnce = false) {
  if ($("panel-wire").hidden || hilrig.stage.kind !== "rig") return;
  const time = performance.now(), at_ns = seen().now.at_ns, lane = $("frames-lane").value;
  const key = `${at_ns} ${lane}`;
  if (framesBusy || shown.frames === key || !atOnce && time - framesAsked < 400) return;
  [framesBusy, framesAsked, shown.frames] = [true, time, key];
  fetch(`/frames${query(`&at_ns=${at_ns}${lane === "" ? "" : `&lane=${lane}`}`)}`)
    .then((reply) => reply.json())
    .then(({ frames }) => { framesTold = frames; listFrames(); })
    .catch(() => refuse("the rig does not answer the request for frames"))
    .finally(() => { framesBusy = false; requestDraw(); });
}

const spaced = (hex) => hex.replace(/../g, "$& ").trim();

function listFrames() {
  const filter = $("frames-filter").value.trim().toLowerCase(), list = $("frames");
  const hex = /^[0-9a-f ]+$/.test(filter) ? filter.replaceAll(" ", "") : null;
  const fits = (one) => (!$("frames-bad").checked || one.is_bad || one.is_hit)
    && (`${one.link} ${one.words}`.toLowerCase().includes(filter)
      || hex !== null && one.bytes.includes(hex));
  const atEnd = list.scrollTop + list.clientHeight >= list.scrollHeight - 20;
  list.replaceChildren(...framesTold.filter(fits).map(frameItem));
  if (atEnd) list.scrollTop = list.scrollHeight;
}

const keyOf = ({ at_ns, link, way, bytes }) => `${at_ns} ${link} ${way} ${bytes}`;

function frameItem(one) {
  const item = make("li"), classes = [one.is_bad && "bad", one.is_hit && "hit"].filter(Boolean);
  item.className = classes.join(" ");
  item.setAttribute("aria-current", String(keyOf(one) === frameChosen));
  item.append(make("span", clockText(one.at_ns / 1e9), { className: "when" }),
    make("span", `${one.link} ${one.way}`), make("span", one.words));
  item.onclick = () => chooseFrame(one);
  return item;
}

function chooseFrame(one) {
  frameChosen = keyOf(one);
  for (const item of $("frames").children) item.setAttribute("aria-current", "false");
  const go = jump(one.at_ns / 1e9);
  // Eight bytes in a line fit the width of the column.
  const lines = (one.bytes.match(/.{1,16}/g) ?? []).map((line, index) => {
    const text = line.match(/../g).map((pair) => parseInt(pair, 16))
      .map((byte) => byte >= 32 && byte < 127 ? String.fromCharCode(byte) : ".").join("");
    return `${(8 * index).toString(16).padStart(4, "0")}  ${spaced(line).padEnd(23)}  ${text}`;
  });
  const words = make("p", `${one.link} ${one.way}: ${one.words}`);
  const damage = one.is_hit
    ? [make("p", "A fault hit these bytes, or lost the bytes before them.")] : [];
  $("frame").replaceChildren(go, words, ...damage, make("pre", lines.join("\n")));
  listFrames();
  // The detail has made the list shorter.
  $("frames").querySelector("[aria-current=true]")?.scrollIntoView({ block: "nearest" });
}

// The up and down keys go from frame to frame.
$("frames").onkeydown = (event) => {
  const by = { ArrowDown: 1, ArrowUp: -1 }[event.key], items = [...$("frames").children];
  if (!by || items.length === 0) return;
  event.preventDefault();
  const now = items.findIndex((item) => item.getAttribute("aria-current") === "true");
  const next = now < 0 ? items.length - 1 : Math.min(Math.max(now + by, 0), items.length - 1);
  items[next].click();
};
$("frames-lane").onchange = () => showFrames(true);
for (const id of ["frames-filter", "frames-bad"]) $(id).oninput = listFrames;
