// ---- clock, tabs, theme, keys

$("play").onclick = () => {
  goLive();
  send({ do: hilrig.now?.paused ? "play" : "pause" });
};
const stepMs = () => Number($("step-ms").value);
$("step").onclick = () => { goLive(); send({ do: "step", ms: stepMs() }); };
$("speed").onchange = () => send({ do: "speed", x: Number($("speed").value) });
$("again").onsubmit = (event) => {
  event.preventDefault();
  const seed = $("seed").value === "" ? null : Math.max(0, Math.round(Number($("seed").value)));
  send({ do: "restart", seed });
};

// ---- tabs; the address names the open one, so that a link opens the same tab

const TABS = ["robot", "checks", "faults", "wire", "log"];
const narrow = window.matchMedia("(max-width: 599px)");

function showTab(name) {
  const open = TABS.includes(name) ? name : null;
  for (const tab of TABS) {
    const isIt = tab === open;
    $(`tab-${tab}`).setAttribute("aria-selected", String(isIt));
    $(`tab-${tab}`).tabIndex = isIt || open === null && tab === "robot" ? 0 : -1;
    $(`panel-${tab}`).hidden = !isIt;
  }
  const address = open && open !== "robot" ? `#${open}` : " ";
  if (location.hash !== address.trim()) history.replaceState(null, "", address);
  shown.frames = shown.events = undefined;
  requestDraw();
}

for (const tab of TABS) {
  // On a phone all panels are folded at first, and a second press folds a panel again.
  $(`tab-${tab}`).onclick = () =>
    showTab(narrow.matches && !$(`panel-${tab}`).hidden ? null : tab);
}
document.querySelector("[role=tablist]").onkeydown = (event) => {
  const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!by) return;
  const shownTabs = TABS.filter((tab) => $(`tab-${tab}`).offsetParent !== null);
  const index = shownTabs.findIndex((tab) => $(`tab-${tab}`) === document.activeElement);
  const next = shownTabs[(index + by + shownTabs.length) % shownTabs.length];
  event.preventDefault();
  showTab(next);
  $(`tab-${next}`).focus();
};
window.addEventListener("hashchange", () => showTab(location.hash.slice(1) || "robot"));

// ---- light and dark

const THEMES = ["as the system", "light", "dark"];
const systemDark = window.matchMedia("(prefers-color-scheme: dark)");
const kept = { get theme() { try { return localStorage.theme; } catch { return undefined; } } };
let theme = THEMES.includes(kept.theme) ? kept.theme : THEMES[0];

function showTheme() {
  const isDark = theme === "dark" || theme === THEMES[0] && systemDark.matches;
  document.documentElement.toggleAttribute("data-dark", isDark);
  view.setDark(isDark);
  say("theme", `Theme: ${theme}`);
  requestDraw();
}
function nextTheme() {
  theme = THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length];
  // The theme also changes if the browser stores no data.
  try { localStorage.theme = theme; } catch { /* as said */ }
  showTheme();
}
$("theme").onclick = nextTheme;
systemDark.onchange = showTheme;

// ---- keys

$("help").onclick = () => { $("more").open = false; $("keys").showModal(); };
const shortcuts = {
  " ": () => $("play").click(),
  ".": () => $("step").click(),
  ",": () => goTo(seen().now.at_ns / 1e6 - Math.max(stepMs(), 500)),
  "0": fitAll, "+": () => zoomMiddle(1.4), "-": () => zoomMiddle(1 / 1.4),
  l: goLive, b: branch, t: nextTheme,
  f: () => { showTab("faults"); $("fault-kind").focus(); },
  w: () => { showTab("robot"); $("add-x").focus(); },
  m: () => { showTab("robot"); $("modes").firstElementChild?.focus(); },
  Escape: () => aim(null),
  d: () => { if (!$("drive").hidden) $("drive").click(); },
  "?": () => $("help").click(),
};
document.addEventListener("keydown", (event) => {
  const inField = event.target.matches("input:not([type=range], [type=checkbox]), select");
  if (event.ctrlKey || event.altKey || event.metaKey || inField || !hilrig.stage || $("keys").open) {
    return;
  }
  if (driving !== null && event.code in directions) return;
  // The browser itself presses the focused button at a space.
  if (event.key === " " && event.target.matches("button, summary, input, [role=tab]")) return;
  const tab = TABS[Number(event.key) - 1];
  if (tab && $(`tab-${tab}`).offsetParent !== null) {
    event.preventDefault();
    showTab(tab);
  } else if (Object.hasOwn(shortcuts, event.key)) {
    event.preventDefault();
    shortcuts[event.key]();
  }
});
window.addEventListener("resize", requestDraw);
// The switches of a small map are folded.
const small = window.matchMedia("(max-width: 1200px)");
small.onchange = () => { $("layers").open = !small.matches; };
small.onchange();
new ResizeObserver(requestDraw).observe(canvas);

showTheme();
showTab(location.hash.slice(1) || (narrow.matches ? null : "robot"));
open();
