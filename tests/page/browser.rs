//! A real browser without a window, driven through its own driver.

use std::io::{BufRead, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

use core::time::Duration;

use fantoccini::actions::{
    InputSource, KeyAction, KeyActions, MOUSE_BUTTON_LEFT, MOUSE_BUTTON_RIGHT, MouseActions,
    PointerAction,
};
use fantoccini::{Client, ClientBuilder, Locator};
use hyper_util::client::legacy::connect::HttpConnector;
use serde_json::{Value, json};
use tokio::runtime::{Builder, Runtime};

use super::server::{Server, folder};

/// All tests of this process share one browser, one after the other: it takes seconds to start.
static ONE: Mutex<Option<Chrome>> = Mutex::new(None);

/// Interval and maximum number of the checks of a condition: a minute on an idle machine, more on a
/// busy one. This limit only ends a hanging test; it measures nothing.
const LOOK_EVERY: Duration = Duration::from_millis(100);
const LOOKS_MAX: u32 = 900;

/// Starts the driver, and ends it, its browser and its files when this process is gone, which the
/// end of the script's input shows.
const DRIVER: &str = "chromedriver --port=0 & exec >/dev/null; cat; trap '' TERM; kill -- -$$; \
                      wait; for _ in 1 2 3 4 5; do rm -rf -- \"$1\" && exit; sleep 1; done";

/// A browser and its driver.
struct Chrome {
    runtime: Runtime,
    client: Client,
    /// Host and port of the driver.
    host: String,
    profile: PathBuf,
    /// Held open until this process ends.
    _driver: Child,
}

/// The browser, with a page of this test.
pub(crate) struct Browser {
    chrome: MutexGuard<'static, Option<Chrome>>,
    /// Number of lines that earlier tests have left on the console.
    console: usize,
}

impl Chrome {
    /// Starts the browser. It can connect to this machine only. Returns `None` with a message on a
    /// machine without a browser; CI must have one.
    fn start() -> Option<Self> {
        let profile = folder(&format!("profile-{}", std::process::id()));
        let mut command = Command::new("sh");
        command.args(["-c", DRIVER, "sh"]).arg(&profile);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let driver = command.stderr(Stdio::null()).process_group(0).spawn();
        let mut driver = driver.expect("a shell starts");
        let out = BufReader::new(driver.stdout.take().expect("piped"));
        let port = out.lines().map_while(Result::ok).find_map(|line| {
            let port = line.split_once("started successfully on port ")?.1;
            Some(port.trim_end_matches('.').to_owned())
        });
        let Some(port) = port else {
            assert!(
                std::env::var_os("CI").is_none(),
                "CI without chromedriver: tests/run.sh installs chromium and chromium-driver"
            );
            // Its input ends here.
            drop(driver.stdin.take());
            let _ = driver.wait();
            eprintln!("SKIPPED: chromedriver is not installed, nothing was seen in a browser");
            return None;
        };
        let runtime = Builder::new_current_thread().enable_all().build();
        let runtime = runtime.expect("a runtime");
        let arguments = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--disable-dev-shm-usage",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--enable-precise-memory-info",
            "--js-flags=--expose-gc",
            // No proxy listens at the port of "discard"; connections to this machine need none.
            "--proxy-server=http://127.0.0.1:9",
            "--window-size=1280,1040",
        ];
        let mut arguments: Vec<String> = arguments.map(str::to_owned).to_vec();
        arguments.push(format!("--user-data-dir={}", profile.display()));
        let wishes = json!({"goog:chromeOptions": {"args": arguments}});
        let wishes = wishes.as_object().expect("made as one").clone();
        let host = format!("127.0.0.1:{port}");
        let mut builder = ClientBuilder::new(HttpConnector::new());
        builder.capabilities(wishes);
        let client = runtime.block_on(builder.connect(&format!("http://{host}")));
        Some(Self {
            runtime,
            client: client.expect("the browser starts"),
            host,
            profile,
            _driver: driver,
        })
    }

    /// Lines on the console.
    fn console(&self) -> Vec<String> {
        let log = self.profile.join("chrome_debug.log");
        let said = std::fs::read_to_string(&log).unwrap_or_default();
        let lines = said.lines().filter(|line| line.contains("CONSOLE"));
        lines.map(str::to_owned).collect()
    }
}

impl Browser {
    /// Opens a browser that shows `server`'s page, connected; a paused run continues. Returns
    /// `None` with a message on a machine without a browser.
    pub(crate) fn at(server: &Server) -> Option<Self> {
        let browser = Self::paused_at(server)?;
        if browser.value("hilrig.now.paused") == true {
            browser.click("#play");
            browser.wait("!hilrig.now.paused || hilrig.now.over");
        }
        Some(browser)
    }

    /// The same; a paused run stays paused.
    pub(crate) fn paused_at(server: &Server) -> Option<Self> {
        let browser = Self::start()?;
        browser.go(&server.url());
        browser.wait("hilrig.connected && hilrig.now && hilrig.stage");
        Some(browser)
    }

    /// Takes the browser without a page.
    pub(crate) fn start() -> Option<Self> {
        let mut chrome = ONE.lock().unwrap_or_else(PoisonError::into_inner);
        if chrome.is_none() {
            *chrome = Chrome::start();
        }
        let console = chrome.as_ref()?.console().len();
        let browser = Self { chrome, console };
        browser.look([1280, 1040]);
        Some(browser)
    }

    fn chrome(&self) -> &Chrome {
        self.chrome.as_ref().expect("it was started")
    }

    fn client(&self) -> &Client {
        &self.chrome().client
    }

    /// Waits for an answer of the driver.
    fn block_on<F: Future>(&self, answer: F) -> F::Output {
        self.chrome().runtime.block_on(answer)
    }

    /// Sets the size of the window; a phone has a narrow one.
    pub(crate) fn look(&self, [width, height]: [u32; 2]) {
        let size = json!({"width": width, "height": height, "deviceScaleFactor": 1,
                          "mobile": width < 600});
        let body = json!({"cmd": "Emulation.setDeviceMetricsOverride", "params": size});
        let (host, body) = (&self.chrome().host, body.to_string());
        let session = self.block_on(self.client().session_id());
        let session = session.expect("the driver answers").expect("a session");
        let mut socket = TcpStream::connect(host).expect("the driver listens");
        let request = format!(
            "POST /session/{session}/goog/cdp/execute HTTP/1.1\r\nHost: {host}\r\n\
             Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
            body.len()
        );
        socket.write_all(request.as_bytes()).expect("is read");
        // The driver keeps the connection open; the status comes first.
        let mut answer = [0; 64];
        let len = socket.read(&mut answer).expect("an answer");
        let answer = String::from_utf8_lossy(&answer[..len]);
        assert!(answer.contains(" 200 "), "{answer}");
    }

    /// Opens another address.
    pub(crate) fn go(&self, url: &str) {
        let gone = self.block_on(self.client().goto(url));
        gone.expect("the page loads");
    }

    /// This test's lines on the console until `last` appeared.
    pub(crate) fn console(&self, last: &str) -> Vec<String> {
        for _ in 0..LOOKS_MAX {
            let lines = self.chrome().console().split_off(self.console);
            if let Some(end) = lines.iter().position(|line| line.contains(last)) {
                return lines[..end].to_vec();
            }
            let pause = async { tokio::time::sleep(LOOK_EVERY).await };
            self.block_on(pause);
        }
        panic!("never on the console: {last}");
    }

    /// Loads the page again.
    pub(crate) fn reload(&self) {
        let again = self.block_on(self.client().refresh());
        again.expect("the page loads again");
        self.wait("hilrig.connected && hilrig.now && hilrig.stage");
    }

    /// The value of an expression in the page.
    pub(crate) fn value(&self, expression: &str) -> Value {
        let script = format!("return {expression};");
        let value = self.block_on(self.client().execute(&script, vec![]));
        value.unwrap_or_else(|error| panic!("{expression}: {error}"))
    }

    /// Waits until an expression in the page is true.
    pub(crate) fn wait(&self, expression: &str) {
        for _ in 0..LOOKS_MAX {
            assert_eq!(
                self.value("hilrig.errors"),
                json!([]),
                "the page's own errors"
            );
            if self.value(&format!("Boolean({expression})")) == true {
                return;
            }
            let pause = async { tokio::time::sleep(LOOK_EVERY).await };
            self.block_on(pause);
        }
        let state = self.value("JSON.stringify([hilrig.now, hilrig.refused])");
        panic!("never: {expression}; {state}");
    }

    /// Clicks the element that `css` finds.
    pub(crate) fn click(&self, css: &str) {
        let clicked = self.block_on(async {
            let element = self.client().find(Locator::Css(css)).await?;
            element.click().await
        });
        clicked.unwrap_or_else(|error| panic!("{css}: {error}"));
    }

    /// Chooses or types `value` in the field that `css` finds.
    pub(crate) fn set(&self, css: &str, value: &str) {
        self.value(&format!(
            "(() => {{ const field = document.querySelector({css:?}); field.value = {value:?}; \
             field.dispatchEvent(new Event('input')); field.dispatchEvent(new Event('change')); \
             return field.value; }})()"
        ));
    }

    /// Converts a position on the map, mm, to window coordinates.
    fn in_window(&self, [x, y]: [i32; 2]) -> [f64; 2] {
        self.value("document.getElementById('world').scrollIntoView()");
        let place = self.value(&format!(
            "(() => {{ const box = canvas.getBoundingClientRect(); \
             const [x, y] = hilrigView.toPixel(frame, {x} / 1000, {y} / 1000); \
             return [box.left + x * box.width / canvas.width, \
                     box.top + y * box.height / canvas.height]; }})()"
        ));
        [0, 1].map(|axis: usize| place[axis].as_f64().expect("a number"))
    }

    fn mouse(&self, actions: Vec<PointerAction>) {
        let mouse = MouseActions::new("mouse".to_owned());
        let mouse = actions.into_iter().fold(mouse, MouseActions::then);
        let done = self.block_on(self.client().perform_actions(mouse));
        done.expect("the mouse moves");
    }

    fn to(&self, place: [i32; 2]) -> PointerAction {
        let [x, y] = self.in_window(place);
        PointerAction::MoveTo {
            duration: Some(Duration::from_millis(20)),
            x,
            y,
        }
    }

    /// Clicks a position on the map.
    pub(crate) fn click_map(&self, place: [i32; 2]) {
        let button = MOUSE_BUTTON_LEFT;
        self.mouse(vec![
            self.to(place),
            PointerAction::Down { button },
            PointerAction::Up { button },
        ]);
    }

    /// Moves the pointer to a position on the map.
    pub(crate) fn hover_map(&self, place: [i32; 2]) {
        self.mouse(vec![self.to(place)]);
    }

    /// Clicks a position on the map with the other button.
    pub(crate) fn right_click_map(&self, place: [i32; 2]) {
        let button = MOUSE_BUTTON_RIGHT;
        self.mouse(vec![
            self.to(place),
            PointerAction::Down { button },
            PointerAction::Up { button },
        ]);
    }

    /// Drags from one position on the map to another.
    pub(crate) fn drag_map(&self, from: [i32; 2], to: [i32; 2]) {
        let button = MOUSE_BUTTON_LEFT;
        self.mouse(vec![
            self.to(from),
            PointerAction::Down { button },
            self.to(to),
            PointerAction::Up { button },
        ]);
    }

    /// Presses or releases a key.
    pub(crate) fn key(&self, action: KeyAction) {
        let keys = KeyActions::new("keys".to_owned()).then(action);
        let done = self.block_on(self.client().perform_actions(keys));
        done.expect("the key moves");
    }

    /// Pauses the run; returns its time once everything on the page belongs to that time.
    pub(crate) fn pause(&self) -> u64 {
        // The check and the click are one script: a run that ended between them would be continued.
        self.value("(hilrig.now.paused || document.getElementById('play').click(), true)");
        self.wait("hilrig.now.paused && hilrig.now.at_ns === hilrig.now.looked_ns");
        // Draws the last received state.
        self.value("(draw(), true)");
        self.value("hilrig.now.at_ns").as_u64().expect("a time")
    }

    /// Pauses the run at a time at which an expression in the page is true.
    pub(crate) fn pause_when(&self, expression: &str) -> u64 {
        // The condition is checked and the button clicked in one script. The run may still advance
        // until it pauses; then the condition is tried again at a later time.
        let click = "(hilrig.now.paused || document.getElementById('play').click(), true)";
        self.wait(&format!("({expression}) && {click}"));
        let mut at_ns = self.pause();
        self.set("#step-ms", "1000");
        for _ in 0..LOOKS_MAX {
            if self.value(&format!("Boolean({expression})")) == true {
                return at_ns;
            }
            self.click("#step");
            self.wait(&format!("hilrig.now.at_ns === {}", at_ns + 1_000_000_000));
            at_ns = self.pause();
        }
        panic!("never, when the run stands: {expression}");
    }
}

impl Drop for Browser {
    /// Leaves the page, so that its run loses its viewer; the browser stays for the next test.
    fn drop(&mut self) {
        let _ = self.block_on(self.client().goto("about:blank"));
    }
}
