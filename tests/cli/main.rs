//! The command line from a user's view: exit codes, messages, files.

mod anywhere;
mod bugs;
mod campaign;
mod campaign_against;
mod campaign_folder;
mod campaign_store;
mod cookbook;
mod decode;
mod described;
mod docs;
mod errors;
mod experiment;
mod fidelity;
mod fuzz;
mod json;
mod mutated;
mod nodes;
mod outputs;
mod prepared;
mod results;
mod robots;
mod schema;
mod shrink;
mod verbs;
mod wireshark;

#[path = "../support/captures.rs"]
mod captures;
#[path = "../support/thorough.rs"]
mod thorough;

use core::time::Duration;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use hilrig::realtime::clock::{Clock as _, WallClock};

/// Maximum time to wait for an expected event, on a busy machine. Only a failing test waits that
/// long.
const PATIENCE: Duration = Duration::from_secs(120);

/// Waits until `holds`.
fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let clock = WallClock::start();
    while !holds() {
        let waited = clock.now() - protocols::Instant::ZERO;
        assert!(waited < PATIENCE, "waited in vain: {what}");
        clock.sleep_until(clock.now() + Duration::from_millis(2));
    }
}

/// The command, in its own empty folder, which is removed afterwards.
struct Session {
    folder: PathBuf,
}

impl Session {
    fn new(name: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("cli-{name}"));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).expect("the target folder can be written");
        Self { folder }
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.folder.join(name), text).expect("the target folder can be written");
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.folder.join(name)).expect("the command wrote it")
    }

    fn hilrig(&self, arguments: &[&str]) -> Output {
        self.command(arguments)
            .output()
            .expect("the command starts")
    }

    /// The command, not yet started; its output is captured.
    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
        command.args(arguments).current_dir(&self.folder);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// A shipped scenario's text.
fn shipped(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenarios/{name}.toml"));
    std::fs::read_to_string(path).expect("shipped")
}

fn text(bytes: &[u8]) -> &str {
    core::str::from_utf8(bytes).expect("the command speaks UTF-8")
}
