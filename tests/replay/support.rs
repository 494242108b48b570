//! Common parts of all tests of this binary: a separate folder, clients of ports, processes.

use core::time::Duration;
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};

use hilrig::capture::{Capture, Limits, Recording, about};
use hilrig::realtime::clock::{Clock, WallClock};
use hilrig::rig::{Logged, Rig};
use hilrig::run::Run;
use hilrig::scenario::{Scenario, Source};
use protocols::Instant;
use rustix::process::{Pid, Signal, kill_process};
use serialport::TTYPort;

/// Maximum time that a test waits for an event. Only a failing test waits that long.
const PATIENCE: Duration = Duration::from_secs(20);
/// Time that a client waits for one more byte.
const QUIET: Duration = Duration::from_millis(20);

/// An empty folder that no other test and no other test run uses.
pub(crate) fn folder(name: &str) -> PathBuf {
    let name = format!("replay-{name}-{}", std::process::id());
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).expect("the target folder can be written");
    path
}

/// Retries until `done`, at most for `PATIENCE`.
pub(crate) fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let clock = WallClock::start();
    while !done() {
        assert!(
            clock.now() < Instant::ZERO + PATIENCE,
            "waited in vain for {what}"
        );
        clock.sleep_until(clock.now() + Duration::from_millis(1));
    }
}

/// A typical client: raw mode, exclusive use, 115200 baud.
pub(crate) fn client(path: &Path) -> TTYPort {
    let mut opened = None;
    wait_until("a port", || {
        let builder = serialport::new(path.to_string_lossy(), 115_200).timeout(QUIET);
        opened = TTYPort::open(&builder).ok();
        opened.is_some()
    });
    opened.expect("waited for")
}

/// Appends the bytes that the client can read now to `all`.
pub(crate) fn read_some(client: &mut TTYPort, all: &mut Vec<u8>) {
    let mut buf = [0; 1024];
    if let Ok(len) = client.read(&mut buf) {
        all.extend_from_slice(&buf[..len]);
    }
}

/// A running command, killed when dropped.
pub(crate) struct Running(pub(crate) Option<Child>);

impl Running {
    pub(crate) fn start(arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
        command.args(arguments);
        Self::of(command)
    }

    pub(crate) fn of(mut command: Command) -> Self {
        let command = command.stdin(Stdio::null()).stdout(Stdio::piped());
        let child = command.stderr(Stdio::piped()).spawn();
        Self(Some(child.expect("the command starts")))
    }

    pub(crate) fn signal(&self, signal: Signal) {
        let id = self.0.as_ref().expect("running").id();
        let pid = Pid::from_raw(id.cast_signed()).expect("a running process");
        kill_process(pid, signal).expect("it is our own process");
    }

    /// Waits for the end; returns status and output.
    pub(crate) fn end(mut self) -> (ExitStatus, String, String) {
        let mut child = self.0.take().expect("ended once");
        wait_until("the end of the command", || {
            child.try_wait().expect("our own child").is_some()
        });
        let output = child.wait_with_output().expect("our own child");
        said(output)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Runs the command to its end in `folder`.
pub(crate) fn hilrig(folder: &Path, arguments: &[&str]) -> (ExitStatus, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    let output = command.args(arguments).current_dir(folder).output();
    said(output.expect("the command starts"))
}

fn said(output: Output) -> (ExitStatus, String, String) {
    let [out, err] = [output.stdout, output.stderr]
        .map(|bytes| String::from_utf8(bytes).expect("the command speaks UTF-8"));
    assert!(!err.contains("panicked"), "{err}");
    (output.status, out, err)
}

/// The rescue robot in a square room of 2.4 m that drives from the start, with `more` TOML.
pub(crate) fn in_a_room(duration: &str, more: &str) -> (Scenario, Source) {
    let text = format!(
        "schema = 1\nname = \"room\"\nrobot = \"rescue\"\nduration = \"{duration}\"\n\
         [program]\nstart_mode = \"exploration\"\n{more}\n\
         [world]\nstart = {{ x_m = 1.5, y_m = 1.2, heading_deg = 90 }}\n[[world.wall]]\n\
         path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n"
    );
    Scenario::parse(Path::new("<test>"), text).expect("sound")
}

/// Runs for the scenario's duration and writes the capture; `prepare` may change the rig first.
pub(crate) fn captured(
    (scenario, source): (Scenario, Source),
    path: &Path,
    prepare: impl FnOnce(&mut Rig),
) -> (Capture, Vec<Logged>) {
    let mut run = Run::new(scenario, &source, None).expect("wired");
    prepare(&mut run.rig);
    let about = about(run.scenario());
    let recording = Recording::create(path, &run.rig, about, Limits::default());
    run.rig
        .add_tap(Box::new(recording.expect("can be written")));
    let end = run.scenario().duration.instant();
    run.go_on_until(end);
    run.rig.finish_taps().expect("all was written");
    let outcome = run.judge();
    (Capture::read(path).expect("readable"), outcome.events)
}
