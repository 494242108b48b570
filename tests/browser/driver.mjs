// A browser without a window, driven through chromedriver, and a rig to look at. No packages.
import { spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

const ELEMENT = "element-6066-11e4-a52e-4f735466cecf";

// Starts a command; the rest of the first line of its output that begins with `head`.
function start(command, args, head) {
  const child = spawn(command, args, { stdio: ["ignore", "pipe", "inherit"] });
  const line = new Promise((resolve, reject) => {
    let said = "";
    child.stdout.on("data", (piece) => {
      said += piece;
      const found = said.split("\n").slice(0, -1).find((line) => line.includes(head));
      if (found) resolve(found.slice(found.indexOf(head) + head.length));
    });
    child.on("error", reject);
    child.on("exit", (code) => reject(new Error(`${command} ended with ${code}: ${said}`)));
  });
  return line.then((rest) => ({ rest, end: () => child.kill() }));
}

// `hilrig ui` with these arguments, standing still: its address, and how to end it.
export async function rig(...args) {
  const hilrig = process.env.HILRIG ?? "target/debug/hilrig";
  const { rest, end } = await start(hilrig, ["ui", "--paused", ...args], "page at ");
  return { url: rest.trim(), end };
}

export class Browser {
  static async start() {
    const browser = new Browser();
    browser.profile = mkdtempSync(join(tmpdir(), "hilrig-browser-"));
    const head = "started successfully on port ";
    const { rest, end } = await start("chromedriver", ["--port=0"], head);
    browser.end = end;
    browser.base = `http://127.0.0.1:${rest.trim().replace(/\.$/, "")}`;
    const args = ["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run",
      "--hide-scrollbars", "--disable-background-networking", "--disable-component-update",
      "--proxy-server=http://127.0.0.1:9", `--user-data-dir=${browser.profile}`];
    const wishes = { capabilities: { alwaysMatch: { "goog:chromeOptions": { args } } } };
    const made = await browser.ask("POST", "/session", wishes, "");
    browser.session = `/session/${made.sessionId}`;
    return browser;
  }

  async ask(method, path, body, session = this.session) {
    const answer = await fetch(this.base + session + path, {
      method, body: body === undefined ? undefined : JSON.stringify(body),
      headers: { "content-type": "application/json" },
    });
    const { value } = await answer.json();
    if (value?.error) throw new Error(`${path}: ${value.error}: ${value.message}`);
    return value;
  }

  go(url) { return this.ask("POST", "/url", { url }); }

  // The value of an expression in the page.
  value(expression) {
    return this.ask("POST", "/execute/sync", { script: `return ${expression};`, args: [] });
  }

  async wait(expression, seconds = 60) {
    for (const until = Date.now() + seconds * 1000; Date.now() < until;) {
      if (await this.value(`Boolean(${expression})`)) return;
      await new Promise((resolve) => setTimeout(resolve, 50));
    }
    throw new Error(`never: ${expression}`);
  }

  async element(css) {
    return (await this.ask("POST", "/element", { using: "css selector", value: css }))[ELEMENT];
  }

  async click(css) { await this.ask("POST", `/element/${await this.element(css)}/click`, {}); }

  async keys(...values) {
    const actions = values.flatMap((value) =>
      [{ type: "keyDown", value }, { type: "keyUp", value }]);
    await this.ask("POST", "/actions", { actions: [{ type: "key", id: "keys", actions }] });
  }

  // Presses the mouse at one place of the window and releases it at another.
  async drag([x, y], [toX, toY]) {
    const move = (...place) => {
      const [x, y] = place.map(Math.round);
      return { type: "pointerMove", duration: 50, x, y };
    };
    const actions = [move(x, y), { type: "pointerDown", button: 0 },
      move((x + toX) / 2, (y + toY) / 2), move(toX, toY), { type: "pointerUp", button: 0 }];
    await this.ask("POST", "/actions", { actions: [{ type: "pointer", id: "mouse", actions }] });
  }

  // Turns the wheel at a place of the window, down if positive.
  async wheel([x, y], deltaY) {
    const [left, top] = [x, y].map(Math.round);
    const turn = { type: "scroll", duration: 0, x: left, y: top, deltaX: 0, deltaY };
    const over = { type: "pointerMove", duration: 0, x: left, y: top };
    await this.ask("POST", "/actions", { actions: [
      { type: "pointer", id: "mouse", actions: [over, { type: "pause", duration: 0 }] },
      { type: "wheel", id: "wheel", actions: [{ type: "pause", duration: 0 }, turn] },
    ] });
  }

  chrome(cmd, params = {}) { return this.ask("POST", "/goog/cdp/execute", { cmd, params }); }

  // The size of the window in CSS pixels, and light or dark.
  async look(width, height, scheme = "light") {
    await this.chrome("Emulation.setDeviceMetricsOverride",
      { width, height, deviceScaleFactor: 1, mobile: width < 600 });
    await this.chrome("Emulation.setEmulatedMedia",
      { features: [{ name: "prefers-color-scheme", value: scheme }] });
  }

  // A picture of the window, WebP: a third of a PNG.
  async picture() {
    const params = { format: "webp", quality: 80 };
    return Buffer.from((await this.chrome("Page.captureScreenshot", params)).data, "base64");
  }

  // The page as it would be printed on A4.
  async printed() {
    const params = { paperWidth: 8.27, paperHeight: 11.69 };
    return Buffer.from((await this.chrome("Page.printToPDF", params)).data, "base64");
  }

  async stop() {
    await this.ask("DELETE", "", undefined).catch(() => {});
    this.end();
    rmSync(this.profile, { recursive: true, force: true, maxRetries: 5 });
  }
}
