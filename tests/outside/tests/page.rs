//! The page of a foreign robot in a real browser.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Maximum number of checks of the page, each a second or longer: on a busy machine one in twenty
/// shows the panels.
const LOOKS: usize = 200;

/// Ends the server with the test, whatever its result.
struct Served(Child);

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The page at `url` after its scripts had four seconds of the browser's time.
fn shown(url: &str) -> Option<String> {
    let profile = Path::new(env!("CARGO_TARGET_TMPDIR")).join("chromium");
    let _ = fs::remove_dir_all(&profile);
    let browser = Command::new("chromium")
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
        ])
        .args(["--no-first-run", "--disable-background-networking"])
        .args(["--disable-component-update", "--disable-sync"])
        .arg(format!("--user-data-dir={}", profile.display()))
        .args(["--virtual-time-budget=4000", "--dump-dom", url])
        .stderr(Stdio::null())
        .output();
    match browser {
        Ok(output) => Some(String::from_utf8_lossy(&output.stdout).into_owned()),
        Err(_) if std::env::var_os("CI").is_some() => {
            panic!("CI without chromium: tests/run.sh installs it")
        }
        Err(_) => {
            eprintln!("SKIPPED: chromium is not installed, nothing was seen in a browser");
            None
        }
    }
}

#[test]
fn its_panels_and_axes_are_on_the_page() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outside"));
    command.args(["ui", "arc.toml", "--port", "0"]);
    let child = command.stdout(Stdio::piped()).spawn().expect("is built");
    let mut server = Served(child);
    let stdout = server.0.stdout.take().expect("is piped");
    let mut line = String::new();
    BufReader::new(stdout)
        .read_line(&mut line)
        .expect("says where it is");
    let url = line.trim().strip_prefix("page at ").expect("an address");
    // The browser's time does not wait for the run's: the page is checked until it shows them.
    let parts = ["servo board", "bad packets", "steering", "deg"];
    let mut page = String::new();
    for _ in 0..LOOKS {
        let Some(now) = shown(url) else { return };
        page = now;
        if parts.iter().all(|part| page.contains(part)) {
            break;
        }
    }
    for part in parts {
        assert!(page.contains(part), "no {part:?} on the page:\n{page}");
    }
    // A robot without a station has no buttons for modes.
    assert!(!page.contains("data-mode"), "{page}");
}
