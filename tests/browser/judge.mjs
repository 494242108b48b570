// Every function of page and report by WebDriver, at three sizes; axe-core on all pages, light and
// dark; what fails is said, and the exit code is 1.
import { spawnSync } from "node:child_process";
import {
  copyFileSync, mkdirSync, mkdtempSync, readFileSync, rmSync, statSync, writeFileSync,
} from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { Browser, rig } from "./driver.mjs";

const SIZES = { wide: [1400, 900], narrow: [1024, 768], phone: [390, 844] };
const ROBOTS = { rescue: "rescue-flat", yellow: "yellow-map", apollo13: "apollo13-gates" };
const AXE = readFileSync(process.env.AXE, "utf8");
const PICTURES = process.argv.includes("--pictures") ? "docs/img" : null;
const failures = [];
let count = 0;

function holds(what, is) {
  count += 1;
  if (is) return;
  failures.push(what);
  console.log(`FAIL ${what}`);
}

async function step(what, act) {
  try {
    await act();
    count += 1;
  } catch (error) {
    failures.push(what);
    console.log(`FAIL ${what}: ${error.message}`);
  }
}

// Texts whose contrast axe-core measured, those that it cannot, and the least contrast.
const contrast = { measured: 0, undecided: 0, least: Infinity };

function measureContrast({ passes, incomplete }) {
  const nodes = (found) => found.filter(({ id }) => id === "color-contrast")
    .flatMap((rule) => rule.nodes);
  contrast.undecided += nodes(incomplete).length;
  for (const { any } of nodes(passes)) {
    const ratio = any[0]?.data?.contrastRatio;
    if (!ratio) continue;
    contrast.measured += 1;
    contrast.least = Math.min(contrast.least, ratio);
  }
}

// Contrast of two colours, #rrggbb, as WCAG 2 defines it.
function contrastOf(one, other) {
  const light = (colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255)
    .map((part) => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4)
    .reduce((sum, part, index) => sum + part * [0.2126, 0.7152, 0.0722][index], 0);
  const [dim, bright] = [light(one), light(other)].sort((a, b) => a - b);
  return (bright + 0.05) / (dim + 0.05);
}

// What is drawn on a canvas is no text: three to one.
const DRAWN = ["truth", "belief", "scan", "waypoint", "sensed", "planned", "guess", "faults",
  "shape", "possible", "mark", "load", "errors", "cursor", "dim", "ink"];

async function drawnContrast(browser, what) {
  const colours = await browser.value("view.colours");
  const ratios = DRAWN.map((name) => [contrastOf(colours[name], colours.paper), name]);
  const [least, name] = ratios.sort(([a], [b]) => a - b)[0];
  holds(`${what}: ${name} has a contrast of ${least.toFixed(2)}`, least >= 3);
}

// What axe-core finds serious or critical; what it cannot decide is no fault.
async function accessible(browser, what) {
  await browser.ask("POST", "/execute/sync", { script: `${AXE}; return true;`, args: [] });
  const found = await browser.ask("POST", "/execute/async", {
    script: "axe.run(document, { resultTypes: ['violations', 'passes', 'incomplete'] })"
      + ".then(arguments[0]);",
    args: [],
  });
  measureContrast(found);
  const grave = ["serious", "critical"];
  const bad = found.violations.filter(({ impact }) => grave.includes(impact));
  for (const { id, nodes } of bad) {
    const where = nodes.slice(0, 3).map((node) => `${node.target} ${node.failureSummary ?? ""}`);
    console.log(`     ${id}: ${where.join(" | ").replace(/\s+/g, " ")}`);
  }
  holds(`${what}: ${bad.length} serious accessibility faults`, bad.length === 0);
}

// Nothing may be wider than the window.
const fitsAcross = "document.documentElement.scrollWidth <= window.innerWidth";
const fitsDown = "document.documentElement.scrollHeight <= window.innerHeight";
const tab = (browser, name) => browser.value(`(showTab('${name}'), true)`);
const settled = "wanted === null && !asking";
const picture = "document.getElementById('world').toDataURL()";

// ---- the live page

// The run stands still at this time, however fast machine and browser are; only a later one is
// left where it is.
async function at(browser, seconds) {
  await browser.wait("hilrig.connected && hilrig.now && hilrig.stage");
  const now = await browser.value("hilrig.now.at_ns / 1e9");
  const ms = Math.round((seconds - now) * 1000);
  if (ms > 0) await browser.value(`(send({ do: 'step', ms: ${ms} }), true)`);
  await browser.wait(`hilrig.now.paused && hilrig.now.at_ns >= ${seconds}e9`);
}

async function functions(browser, size) {
  const wide = size !== "phone", at = (what) => `page, ${size}: ${what}`;
  const value = (text) => browser.value(text), wait = (text) => browser.wait(text, 20);
  holds(at("nothing is wider than the window"), await value(fitsAcross));
  if (wide) holds(at("one screen without scrolling"), await value(fitsDown));
  const verdict = await value("$('verdict').textContent");
  holds(at(`a verdict is shown: ${verdict}`), verdict.includes("PASS"));
  await step(at("pause"), async () => {
    await browser.click("#play");
    await wait("hilrig.now.paused");
  });
  await step(at("step"), async () => {
    const before = await value("hilrig.now.at_ns");
    await browser.click("#step");
    await wait(`hilrig.now.at_ns === ${before + 100e6}`);
  });
  await step(at("zoom, pan, fit"), async () => {
    const before = await value("(draw(), frame.scale)");
    await browser.click("#zoom-in");
    await wait(`frame.scale > 1.3 * ${before}`);
    const x = await value("frame.x");
    await value("(canvas.focus(), true)");
    await browser.keys("\uE014");
    await wait(`frame.x > ${x}`);
    await browser.click("#zoom-fit");
    await wait(`Math.abs(frame.scale - ${before}) < 1e-6`);
  });
  await step(at("back in time and live"), async () => {
    const now = await value("hilrig.now.at_ns");
    await value("(goTo(hilrig.now.at_ns / 2e6), true)");
    await wait(`hilrig.past && ${settled}`);
    holds(at("another time"), await value(`hilrig.past.now.at_ns < ${now / 2} + 1`));
    await browser.click("#live");
    await wait("hilrig.past === null");
  });
  await step(at("click on the time line"), async () => {
    await browser.click("#lanes");
    await wait(`hilrig.past && ${settled}`);
    await browser.click("#live");
  });
  await step(at("checks"), async () => {
    if (wide) await browser.click("#tab-checks"); else await tab(browser, "checks");
    await wait("document.querySelectorAll('#checks li').length > 3");
    const told = await value("Boolean(document.querySelector('#checks small'))");
    holds(at("checks are explained"), told);
  });
  await step(at("frames, filter, words and bytes"), async () => {
    if (wide) await browser.click("#tab-wire"); else await tab(browser, "wire");
    await wait("document.querySelectorAll('#frames li').length > 5");
    // A row that lies behind a phone's time line is scrolled to by a finger, not by WebDriver.
    await value("(document.querySelector('#frames li:last-child').click(), true)");
    await wait("document.querySelector('#frame pre')");
    const all = await value("document.querySelectorAll('#frames li').length");
    await value("($('frames-filter').value = 'no such words', listFrames(), true)");
    holds(at("a filter filters"), all > 0
      && await value("document.querySelectorAll('#frames li').length") === 0);
    await value("($('frames-filter').value = '', listFrames(), true)");
    await value("(document.querySelector('#frame .jump').click(), true)");
    await wait(`hilrig.past && ${settled}`);
    await value("(goLive(), true)");
  });
  await step(at("events"), async () => {
    await tab(browser, "log");
    await wait("document.querySelectorAll('#events li').length > 0");
  });
  if (!wide) return;
  await step(at("a plot"), async () => {
    const before = await value("lanes.height");
    await browser.click("#plots summary");
    await wait("document.querySelectorAll('#series input').length > 3");
    await browser.click("#series fieldset:first-child label");
    await wait(`lanes.height > ${before}`);
    await browser.click("#plots summary");
  });
  await step(at("every kind of fault can be asked for"), async () => {
    await browser.click("#tab-faults");
    const kinds = await value("hilrig.stage.faults.kinds.length");
    const offered = new Set();
    const places = await value("document.querySelectorAll('#wiring button').length");
    for (let i = 0; i < places; i++) {
      const names = await value(`(document.querySelectorAll('#wiring button')[${i}].click(), `
        + "[...$('fault-kind').options].map((option) => option.value))");
      for (const name of names) offered.add(name);
    }
    holds(at(`${offered.size} of ${kinds} kinds`), offered.size === kinds);
  });
  await step(at("a fault by click"), async () => {
    await browser.click("#wiring button");
    await value("($('fault-kind').value = 'drop', $('fault-kind').onchange(), true)");
    await browser.click("#inject");
    await wait("hilrig.slow.faults.length > 0");
    await wait("document.querySelector('#faults button, #faults progress')");
    await browser.click("#faults button");
    await wait("hilrig.slow.faults.every((fault) => fault.state === 'over')");
  });
  await step(at("a fault that waits for a place"), async () => {
    await browser.click("#wiring button");
    await value("($('fault-kind').value = 'drop', $('fault-kind').onchange(), true)");
    await value("($('fault-times').open = true, $('fault-waits').value = '2', "
      + "$('fault-waits').onchange(), true)");
    await value("(document.querySelector('#fault-condition [name=near_m]').value = '9, 9', "
      + "document.querySelector('#fault-condition [name=within_m]').value = '0.2', true)");
    await browser.click("#inject");
    const is = "fault.fault.when?.near_m[1] === 9 && fault.fault.lasting && !fault.fault.until";
    await wait(`hilrig.slow.faults.some((fault) => ${is})`);
    holds(at("it was not refused"), await value("hilrig.refused === ''"));
  });
  await step(at("a branch"), async () => {
    const run = await value("hilrig.stage.run");
    await value("(goTo(hilrig.now.at_ns / 2e6), true)");
    await wait(`hilrig.past && ${settled}`);
    await browser.click("#branch");
    await wait(`hilrig.stage?.run === ${run + 1} && hilrig.now?.paused`);
  });
  await step(at("keys"), async () => {
    await value("(document.activeElement.blur(), true)");
    for (const [index, name] of ["robot", "checks", "faults", "wire", "log"].entries()) {
      await browser.keys(String(index + 1));
      await wait(`!$('panel-${name}').hidden`);
      await value("(document.activeElement.blur(), true)");
    }
    await browser.keys("?");
    await wait("$('keys').open");
    await browser.click("#keys button");
    await browser.keys(" ");
    await wait("!hilrig.now.paused");
  });
  holds(at("no errors of its own"), (await value("JSON.stringify(hilrig.errors)")) === "[]");
}

// What a station can do with a place and a heading: press, drag, release; and in figures.
async function placeActs(browser, robot) {
  const value = (text) => browser.value(text), at = (what) => `${robot}: ${what}`;
  const acts = await value("hilrig.stage.place_acts.map(({ mode }) => mode)");
  holds(at(`acts with a place: ${acts.join(", ")}`), acts.length > 0);
  // What the page sends is what counts; a robot may refuse a pose that it cannot have.
  await value("(window.sent = [], window.toRig = socket.send.bind(socket), "
    + "socket.send = (text) => { sent.push(JSON.parse(text)); toRig(text); }, true)");
  for (const act of acts) {
    await step(at(act), async () => {
      await tab(browser, "robot");
      await browser.click(`#acts [data-act=${act}]`);
      const [x, y] = await value("(() => { const box = canvas.getBoundingClientRect();"
        + "return [box.left + box.width / 2, box.top + box.height / 2]; })()");
      await value("(sent.length = 0, true)");
      await browser.drag([x, y], [x, y - 60]);
      await browser.wait("sent.length > 0", 20);
      const [name, ...figures] = (await value("sent[0].mode")).split(" ");
      const [px, py] = figures.map(Number);
      const expected = await value("view.toWorld(frame, canvas.width / 2, canvas.height / 2)");
      const near = Math.hypot(px - expected[0], py - expected[1]) < 0.05;
      // Up on the screen is along y.
      holds(at(`${act} ${figures}`), name === act && near && Math.abs(figures[2] - 90) < 2);
    });
  }
  await step(at("a pose in figures"), async () => {
    await browser.click(`#acts [data-act=${acts[0]}]`);
    await value("(sent.length = 0, $('aim-x').value = 0.5, $('aim-y').value = 1.2, "
      + "$('aim-deg').value = -45, true)");
    await browser.click("#aim-go");
    await browser.wait("sent.length > 0", 20);
    holds(at("as it was typed"), await value("sent[0].mode") === `${acts[0]} 0.5 1.2 -45`);
  });
  await value("(socket.send = toRig, true)");
  await browser.wait("hilrig.refused === ''", 5);
}

// A scenario that does not end while it is looked at, however slow the machine.
function endless(folder, scenario) {
  const text = readFileSync(`scenarios/${scenario}.toml`, "utf8");
  const path = join(folder, `${scenario}.toml`);
  writeFileSync(path, text.replace("[mission]\n", "[mission]\nto_the_end = true\n")
    .replace(/duration = "\w+"/, 'duration = "2h"'));
  return path;
}

async function livePage(browser, folder) {
  for (const [robot, scenario] of Object.entries(ROBOTS)) {
    for (const [size, [width, height]] of Object.entries(SIZES)) {
      const { url, end } = await rig(endless(folder, scenario));
      await browser.look(width, height);
      await browser.go(url);
      await at(browser, 9);
      await browser.value("(send({ do: 'speed', x: 0.5 }), send({ do: 'play' }), true)");
      await browser.wait("hilrig.now.speed === 0.5 && !hilrig.now.paused");
      if (robot === "rescue") await functions(browser, size);
      else if (size === "wide") await placeActs(browser, robot);
      for (const scheme of ["light", "dark"]) {
        await browser.look(width, height, scheme);
        if (size === "wide" && robot === "rescue") await drawnContrast(browser, `lines, ${scheme}`);
        const across = await browser.value(fitsAcross);
        holds(`${robot}, ${size}, ${scheme}: nothing is wider than the window`, across);
        for (const name of ["robot", "checks", "faults", "wire", "log"]) {
          if (name !== "robot" && robot !== "rescue") continue;
          await tab(browser, name);
          await browser.wait("drawn");
          await accessible(browser, `${robot}, ${size}, ${scheme}, ${name}`);
        }
      }
      end();
    }
  }
}

// ---- report.html and campaign.html

const FAILING = "\n[[fault]]\nlink = \"lidar\"\ndirection = \"to-master\"\nkind = \"flip\"\n"
  + "rate = 0.002\n[[fault]]\nlink = \"base\"\ndirection = \"to-master\"\nkind = \"cut\"\n"
  + "from = \"20s\"\nuntil = \"24s\"\n[expect]\nwall_overlap_min = 1.0\nviolations_max = 0\n";

function made(folder) {
  const text = readFileSync("scenarios/rescue-flat.toml", "utf8");
  const failing = text.replace(/\[expect\][^[]*/, "") + FAILING;
  writeFileSync(join(folder, "failing.toml"), failing);
  const run = (...args) => spawnSync(process.env.HILRIG, args, { encoding: "utf8" });
  run("run", join(folder, "failing.toml"), "--out", join(folder, "failing"));
  run("run", "scenarios/rescue-flat.toml", "--out", join(folder, "passing"));
  const out = join(folder, "campaign");
  run("campaign", join(folder, "failing.toml"), "--seeds", "1..3", "--out", out);
}

async function reports(browser, folder) {
  const text = readFileSync(join(folder, "failing/case.toml"), "utf8");
  const strikes = text.split("byte = ").length - 1;
  const size = statSync(join(folder, "failing/report.html")).size;
  console.log(`     a failing run of ${strikes} strikes: report of ${size} bytes`);
  holds("a report of 600 strikes has at most 1,000,000 bytes", strikes >= 600 && size <= 1e6);
  for (const name of ["failing/report.html", "passing/report.html", "campaign/campaign.html"]) {
    for (const [width, height] of Object.values(SIZES)) {
      for (const scheme of ["light", "dark"]) {
        await browser.look(width, height, scheme);
        await browser.go(`file://${folder}/${name}`);
        const what = `${name} ${width} ${scheme}`;
        holds(`${what}: nothing is wider than the window`, await browser.value(fitsAcross));
        await accessible(browser, what);
      }
    }
  }
  await browser.look(1400, 900);
  await browser.go(`file://${folder}/failing/report.html`);
  const long = "document.documentElement.scrollHeight / window.innerHeight";
  const screens = await browser.value(long);
  console.log(`     ${screens.toFixed(2)} screens long`);
  holds("a failing report is at most three screens long", screens <= 3);
  const low = "document.querySelector('#cause').getBoundingClientRect().bottom";
  holds("its first screen names the cause", await browser.value(`${low} < 450`));
  const world = "document.getElementById('world').getBoundingClientRect().top";
  holds("and shows the world", await browser.value(`${world} < 450`));
  const before = await browser.value(picture);
  await browser.click("#all");
  await browser.click("#play");
  const time = "Number(document.getElementById('time').value)";
  await browser.wait(`${time} > 0.5 && ${time} < 50`, 5);
  await browser.click("#play");
  holds("a time line that plays", await browser.value(picture) !== before);
  await browser.go(`file://${folder}/campaign/campaign.html`);
  const drawn = "document.querySelectorAll('.causes .moment .truth polyline').length";
  const cards = "document.querySelectorAll('.causes li').length";
  holds("each cause has the picture of its smallest case",
    await browser.value(`${cards} > 0 && ${drawn} === ${cards}`));
  holds("a square for each run", await browser.value(
    "document.querySelectorAll('.strip rect').length === 2"));
  await browser.go(`file://${folder}/failing/report.html`);
  const pages = (await browser.printed()).toString("latin1").match(/\/Type\s*\/Page\b/g).length;
  console.log(`     ${pages} pages on A4`);
  holds("a failing report prints on A4", pages >= 1 && pages <= 6);
}

// ---- pictures of the docs

async function pictures(browser, folder) {
  mkdirSync(PICTURES, { recursive: true });
  const save = async (name) => writeFileSync(join(PICTURES, name), await browser.picture());
  for (const [robot, scenario] of Object.entries(ROBOTS)) {
    const { url, end } = await rig(`scenarios/${scenario}.toml`);
    await browser.look(1400, 900);
    await browser.go(url);
    await at(browser, 24);
    await browser.wait("hilrig.scan");
    for (const scheme of robot === "rescue" ? ["light", "dark"] : ["light"]) {
      await browser.look(1400, 900, scheme);
      await browser.wait("drawn");
      const name = robot === "rescue" ? "page" : `page-${robot}`;
      await save(scheme === "light" ? `${name}.webp` : `${name}-dark.webp`);
    }
    end();
  }
  await browser.go(`file://${folder}/failing/report.html`);
  await browser.look(1400, 900);
  await browser.wait("document.getElementById('lanes').height > 100");
  await save("report.webp");
  copyFileSync(join(folder, "passing/display.png"), join(PICTURES, "display.png"));
}

const folder = mkdtempSync(join(tmpdir(), "hilrig-judge-"));
const browser = await Browser.start();
try {
  made(folder);
  if (PICTURES) await pictures(browser, folder);
  else {
    await livePage(browser, folder);
    await reports(browser, folder);
  }
} finally {
  await browser.stop();
  rmSync(folder, { recursive: true, force: true });
}
if (!PICTURES) {
  const { measured, least, undecided } = contrast;
  console.log(`contrast: ${measured} texts measured, at least ${least.toFixed(2)}, `
    + `${undecided} on a picture`);
}
console.log(`${count} looked at, ${failures.length} failed`);
process.exitCode = failures.length ? 1 : 0;
