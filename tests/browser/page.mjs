// Each function of the live page, on any robot's run, at any size.
import { holds, step } from "./tally.mjs";

// Nothing may be wider than the window.
export const fitsAcross = "document.documentElement.scrollWidth <= window.innerWidth";
const fitsDown = "document.documentElement.scrollHeight <= window.innerHeight";
const settled = "wanted === null && !asking";
const unfocus = "(document.activeElement.blur(), true)";
const UP = "\uE013", RIGHT = "\uE014", ESCAPE = "\uE00C";

export const showTab = (browser, name) => browser.value(`(showTab('${name}'), true)`);

// What the page sends from here on is kept in `sent`.
export const listen = (browser) => browser.value("(window.sent = [], window.toRig ??= "
  + "socket.send.bind(socket), socket.send = (text) => { sent.push(JSON.parse(text)); "
  + "toRig(text); }, true)");

export async function functions(browser, { robot, size }) {
  const wide = size !== "phone", at = (what) => `${robot}, ${size}: ${what}`;
  const page = { browser, wide, at, value: (text) => browser.value(text),
    wait: (text) => browser.wait(text, 20) };
  holds(at("nothing is wider than the window"), await page.value(fitsAcross));
  if (size === "wide") holds(at("one screen without scrolling"), await page.value(fitsDown));
  const verdict = await page.value("$('verdict').textContent");
  holds(at(`a verdict is shown: ${verdict}`), /PASS|FAIL|nothing/.test(verdict));
  await listen(browser);
  // Without a robot there is no map, no station and no place.
  const isBare = await page.value("hilrig.stage.body === false");
  const parts = isBare ? [clock, talk, past, checks, frames, log]
    : [clock, stage, past, checks, frames, log];
  for (const part of parts) await part(page);
  if (wide) {
    for (const part of isBare ? [line, faults, branch, keys] : [line, faults, station, branch, keys]) {
      await part(page);
    }
  }
  const errors = await page.value("JSON.stringify(hilrig.errors)");
  holds(at(`no errors of its own: ${errors}`), errors === "[]");
}

async function clock({ browser, at, value, wait }) {
  await step(at("pause"), async () => {
    await browser.click("#play");
    await wait("hilrig.now.paused");
  });
  await step(at("step"), async () => {
    const before = await value("hilrig.now.at_ns");
    await browser.click("#step");
    await wait(`hilrig.now.at_ns === ${before + 100e6}`);
  });
}

async function stage({ browser, wide, at, value, wait }) {
  await step(at("zoom, pan, fit"), async () => {
    const before = await value("(fitAll(), draw(), frame.scale)");
    await browser.click("#zoom-in");
    await wait(`frame.scale > 1.3 * ${before}`);
    const x = await value("frame.x");
    await value("(canvas.focus(), true)");
    await browser.keys(RIGHT);
    await wait(`frame.x > ${x}`);
    await browser.click("#zoom-fit");
    await wait(`Math.abs(frame.scale - ${before}) < 1e-6`);
  });
  const middle = await value("(() => { const box = canvas.getBoundingClientRect();"
    + "return [box.left + box.width * 0.6, box.top + box.height * 0.4]; })()");
  await step(at("the wheel zooms at the pointer"), async () => {
    const before = await value("frame.scale");
    const place = (x, y) => value("(() => { const box = canvas.getBoundingClientRect(); "
      + "return view.toWorld(frame, " + `(${x} - box.left) * canvas.width / box.width, `
      + `(${y} - box.top) * canvas.height / box.height); })()`);
    const there = await place(...middle);
    await browser.wheel(middle, -240);
    await wait(`frame.scale > 1.3 * ${before}`);
    const still = await place(...middle);
    const off = Math.hypot(there[0] - still[0], there[1] - still[1]);
    holds(at(`the place under the pointer stays, ${off} m`), off < 0.02);
    const words = await value("$('where').textContent");
    const [x] = words.split(" ").map(Number);
    if (wide) holds(at(`the cursor's place is told: ${words}`), Math.abs(x - still[0]) < 0.02);
  });
  await step(at("a drag pans"), async () => {
    const x = await value("frame.x");
    await browser.drag(middle, [middle[0] - 60, middle[1]]);
    await wait(`frame.x > ${x}`);
    await browser.keys("0");
    await wait("camera === null");
  });
  await step(at("the layers are switches"), async () => {
    await value("($('layers').open = true, draw(), true)");
    const boxes = await value("[...$('layers').querySelectorAll('input')]"
      + ".filter((box) => box.offsetParent && box.id !== 'show-waypoints').length");
    const picture = "(draw(), canvas.toDataURL())";
    let changed = 0;
    for (let index = 0; index < boxes; index++) {
      const box = "[...$('layers').querySelectorAll('input')]"
        + `.filter((box) => box.offsetParent && box.id !== 'show-waypoints')[${index}]`;
      const before = await value(picture);
      await value(`(${box}.click(), true)`);
      if (await value(picture) !== before) changed += 1;
      await value(`(${box}.click(), true)`);
    }
    // What is not there yet, a plan or a guess, changes nothing.
    holds(at(`${changed} of ${boxes} layers change the picture`), changed >= 3);
    await value("($('layers').open = !small.matches, true)");
  });
}

// Requests and replies in place of a map.
async function talk({ at, value, wait }) {
  await step(at("requests and replies"), async () => {
    await wait("document.querySelectorAll('#exchanges tr').length > 5");
    holds(at("no map"), !await value("canvas.checkVisibility()"));
    holds(at("the last one is in sight"), await value("(() => { const box = $('exchanges-box'); "
      + "box.scrollTop = box.scrollHeight; return document.querySelector('#exchanges tr:last-child')"
      + ".getBoundingClientRect().bottom <= box.getBoundingClientRect().bottom + 1; })()"));
  });
}

async function past({ browser, wide, at, value, wait }) {
  await step(at("back in time and live"), async () => {
    const now = await value("hilrig.now.at_ns");
    await value("(goTo(hilrig.now.at_ns / 2e6), true)");
    await wait(`hilrig.past && ${settled}`);
    holds(at("another time"), await value(`hilrig.past.now.at_ns < ${now / 2} + 1`));
    if (wide) await browser.click("#live"); else await value("(goLive(), true)");
    await wait("hilrig.past === null");
  });
  await step(at("click on the time line"), async () => {
    await browser.click("#lanes");
    await wait(`hilrig.past && ${settled}`);
    await value("(goLive(), true)");
  });
  await step(at("a step back by its key"), async () => {
    await value(unfocus);
    await browser.keys(",");
    await wait(`hilrig.past && ${settled}`);
    await browser.keys("l");
    await wait("hilrig.past === null");
  });
}

async function checks({ browser, wide, at, value, wait }) {
  await step(at("checks"), async () => {
    if (wide) await browser.click("#tab-checks"); else await showTab(browser, "checks");
    await wait("document.querySelectorAll('#checks li').length > 1");
    const told = await value("Boolean(document.querySelector('#checks small'))");
    holds(at("checks are explained"), told);
  });
}

async function frames({ browser, wide, at, value, wait }) {
  await step(at("frames, filter, words and bytes"), async () => {
    if (wide) await browser.click("#tab-wire"); else await showTab(browser, "wire");
    await wait("document.querySelectorAll('#frames li').length > 5");
    // A row that lies behind a phone's time line is scrolled to by a finger, not by WebDriver.
    await value("(document.querySelector('#frames li:last-child').click(), true)");
    await wait("document.querySelector('#frame pre')");
    const list = "document.querySelectorAll('#frames li').length";
    const all = await value(list);
    await value("($('frames-filter').value = 'no such words', listFrames(), true)");
    holds(at("a filter filters"), all > 0 && await value(list) === 0);
    await value("($('frames-filter').value = '', listFrames(), true)");
    await value("($('frames').focus(), true)");
    const chosen = await value("frameChosen");
    await browser.keys(UP);
    await wait(`frameChosen !== ${JSON.stringify(chosen)}`);
    await value("(document.querySelector('#frame .jump').click(), true)");
    await wait(`hilrig.past && ${settled}`);
    await value("(goLive(), true)");
  });
}

async function log({ browser, at, value, wait }) {
  await step(at("events"), async () => {
    await showTab(browser, "log");
    // Nothing need have happened; then it says so.
    await wait("document.querySelectorAll('#events li').length > 0");
    const happened = await value("hilrig.events.length > 0");
    const words = await value("$('events').textContent");
    holds(at(`the log: ${words.slice(0, 60)}`), happened || words === "nothing happened yet");
  });
}

async function line({ browser, at, value, wait }) {
  await step(at("a plot"), async () => {
    const before = await value("lanes.height");
    await browser.click("#plots summary");
    await wait("document.querySelectorAll('#series input').length > 0");
    await browser.click("#series fieldset:last-child label:last-child");
    await wait(`lanes.height !== ${before}`);
    await browser.click("#plots summary");
  });
  await step(at("the wheel zooms in time"), async () => {
    const place = await value("(() => { const box = lanes.getBoundingClientRect();"
      + "return [box.left + box.width / 2, box.top + 20]; })()");
    await browser.wheel(place, -240);
    await wait("span !== null");
    await browser.click("#all-time");
    await wait("span === null");
  });
  await step(at("its height"), async () => {
    const before = await value("$('line').clientHeight");
    await value("($('grip').focus(), true)");
    await browser.keys(UP);
    await wait(`$('line').clientHeight > ${before}`);
    await value("(document.documentElement.style.removeProperty('--low'), true)");
  });
}

async function faults({ browser, at, value, wait }) {
  await step(at("every kind of fault that fits can be asked for"), async () => {
    await browser.click("#tab-faults");
    const told = await value(`(() => {
      const offered = new Map();
      for (const place of document.querySelectorAll('#wiring button')) {
        place.click();
        for (const { value } of [...$('fault-kind').options]) {
          $('fault-kind').value = value;
          showKind();
          const fields = [...$('fault-keys').querySelectorAll('[name]')].map(({ name }) => name);
          offered.set(value, { fields, about: $('fault-about').textContent });
        }
      }
      const { links, faults } = hilrig.stage;
      const fits = ({ place, links: kinds }) => !place.includes('link')
        || links.some(({ kind }) => kinds.includes(kind));
      const expected = faults.kinds.filter(fits);
      return { offered: offered.size, expected: expected.length,
        without: expected.filter(({ name, keys }) => !offered.get(name)?.about
          || keys.some((key) => !offered.get(name).fields.includes(key))).map(({ name }) => name) };
    })()`);
    holds(at(`${told.offered} of ${told.expected} kinds`), told.offered === told.expected);
    holds(at(`kinds without settings or words: ${told.without}`), told.without.length === 0);
  });
  await step(at("a fault by click"), async () => {
    await browser.click("#wiring button");
    await value("($('fault-kind').selectedIndex = 0, $('fault-kind').onchange(), true)");
    await value("(document.querySelector('#fault-keys [name=rate]').value = '0.001', true)");
    await browser.click("#inject");
    await wait("hilrig.slow.faults.length > 0");
    await wait("document.querySelector('#faults button, #faults progress')");
    await browser.click("#faults button");
    await wait("hilrig.slow.faults.every((fault) => fault.state === 'over')");
  });
  if (await value("hilrig.stage.body === false")) return;
  await step(at("a fault that waits for a place"), async () => {
    await browser.click("#wiring button");
    await value("($('fault-kind').selectedIndex = 0, $('fault-kind').onchange(), true)");
    const choice = "hilrig.stage.faults.when.findIndex(({ keys }) => keys.includes('near_m'))";
    await value(`($('fault-times').open = true, $('fault-waits').value = String(${choice}), `
      + "$('fault-waits').onchange(), true)");
    await value("(document.querySelector('#fault-condition [name=near_m]').value = '9, 9', "
      + "document.querySelector('#fault-condition [name=within_m]').value = '0.2', true)");
    await browser.click("#inject");
    const is = "fault.fault.when?.near_m[1] === 9 && fault.fault.lasting && !fault.fault.until";
    await wait(`hilrig.slow.faults.some((fault) => ${is})`);
    holds(at("it was not refused"), await value("hilrig.refused === ''"));
  });
}

// What is done from the PC: modes, waypoints, driving; a robot without one has none of it.
async function station({ browser, at, value, wait }) {
  await showTab(browser, "robot");
  const { pc, drives, modes } = await value("({ pc: Boolean(hilrig.stage.pc), "
    + "drives: Boolean(hilrig.stage.keys), modes: hilrig.stage.modes ?? [] })");
  holds(at("buttons only with a PC to press them"),
    pc === await value("$('connect').offsetParent !== null"));
  if (!pc) return;
  for (const mode of modes) {
    await step(at(`mode ${mode}`), async () => {
      await value("(sent.length = 0, true)");
      await browser.click(`#modes [data-mode="${mode}"]`);
      await wait(`sent.some((one) => one.do === 'mode' && one.mode === '${mode}')`);
    });
  }
  await step(at("a waypoint in figures"), async () => {
    const before = await value("hilrig.now.pc.waypoints.length");
    await value(unfocus);
    await browser.keys("w");
    await wait("document.activeElement === $('add-x')");
    await value("($('add-x').value = '1200', $('add-y').value = '900', true)");
    await browser.click("#add button");
    await wait(`hilrig.now.pc.waypoints.length === ${before + 1} || hilrig.refused`);
    await browser.click("#clear");
    await wait("hilrig.now.pc.waypoints.length === 0");
  });
  if (drives) {
    await step(at("drive by keys"), async () => {
      await value(unfocus);
      await value("(sent.length = 0, true)");
      await browser.keys("d");
      await wait("$('drive').getAttribute('aria-pressed') === 'true'");
      await browser.keys(UP);
      await wait("sent.some((one) => one.do === 'drive' && one.axes.some((axis) => axis !== 0))");
      await browser.click("#drive");
      await wait("driving === null");
    });
  }
}

async function branch({ browser, at, value, wait }) {
  await step(at("a branch"), async () => {
    const run = await value("hilrig.stage.run");
    await value("(goTo(hilrig.now.at_ns / 2e6), true)");
    await wait(`hilrig.past && ${settled}`);
    await browser.click("#branch");
    await wait(`hilrig.stage?.run === ${run + 1} && hilrig.now?.paused`);
  });
  await step(at("the session is a case"), async () => {
    await value("(window.saved = null, fetch('/case.toml' + query()).then((reply) => reply.text())"
      + ".then((text) => { saved = text; }), true)");
    await wait("saved?.includes('schema = 1')");
  });
}

async function keys({ browser, at, value, wait }) {
  await step(at("keys"), async () => {
    await value(unfocus);
    for (const [index, name] of ["robot", "checks", "faults", "wire", "log"].entries()) {
      await browser.keys(String(index + 1));
      await wait(`!$('panel-${name}').hidden`);
      await value(unfocus);
    }
    await browser.keys("f");
    await wait("document.activeElement === $('fault-kind')");
    await value(unfocus);
    const dark = await value("document.documentElement.hasAttribute('data-dark')");
    for (const expected of [true, false]) {
      await value(`(theme = THEMES[THEMES.indexOf('${expected ? "light" : "dark"}')], true)`);
      await browser.keys("t");
      if (expected) await wait("document.documentElement.hasAttribute('data-dark')");
      else await wait(`document.documentElement.hasAttribute('data-dark') === ${dark}`);
    }
    await browser.keys("?");
    await wait("$('keys').open");
    await browser.keys(ESCAPE);
    await wait("!$('keys').open");
    await value(unfocus);
    await browser.keys(" ");
    await wait("!hilrig.now.paused");
  });
}

// What a station can do with a place and a heading: press, drag, release; and in figures.
export async function placeActs(browser, { robot, size }) {
  const value = (text) => browser.value(text), at = (what) => `${robot}, ${size}: ${what}`;
  const acts = await value("(hilrig.stage.place_acts ?? []).map(({ mode, heading }) => [mode, heading])");
  if (acts.length === 0) return;
  // What the page sends is what counts; a robot may refuse a pose that it cannot have.
  await listen(browser);
  for (const [act, heading] of acts) {
    await step(at(act), async () => {
      await showTab(browser, "robot");
      await browser.click(`#acts [data-act=${act}]`);
      const [x, y] = await value("(() => { canvas.scrollIntoView(); "
        + "const box = canvas.getBoundingClientRect();"
        + "return [box.left + box.width / 2, box.top + box.height / 2]; })()");
      await value("(sent.length = 0, true)");
      await browser.drag([x, y], [x, y - 60]);
      await browser.wait("sent.length > 0", 20);
      const [name, ...figures] = (await value("sent[0].mode")).split(" ");
      const [px, py] = figures.map(Number);
      const expected = await value("view.toWorld(frame, canvas.width / 2, canvas.height / 2)");
      const near = Math.hypot(px - expected[0], py - expected[1]) < 0.05;
      // Up on the screen is along y.
      const turned = !heading || Math.abs(figures[2] - 90) < 2;
      holds(at(`${act} ${figures}`), name === act && near && turned);
    });
  }
  const [act, heading] = acts[0];
  await step(at("a pose in figures"), async () => {
    await browser.click(`#acts [data-act=${act}]`);
    await value("(sent.length = 0, $('aim-x').value = 0.5, $('aim-y').value = 1.2, "
      + "$('aim-deg').value = -45, true)");
    await browser.click("#aim-go");
    await browser.wait("sent.length > 0", 20);
    holds(at("as it was typed"), await value("sent[0].mode")
      === `${act} 0.5 1.2${heading ? " -45" : ""}`);
  });
}
