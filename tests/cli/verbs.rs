//! Every command once, with a short run: its command line, and the files that it writes into the
//! folder `o`.

use core::time::Duration;
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};

use hilrig::realtime::clock::{Clock as _, WallClock};

use super::{Session, wait_until};

/// A command with its expected result.
pub(crate) struct Verb {
    /// Name of the command.
    pub(crate) name: &'static str,
    /// The whole command line; the command writes into `o`.
    pub(crate) line: &'static str,
    /// Expected exit code.
    pub(crate) code: i32,
    /// Whether the command writes files into `o`.
    pub(crate) writes: bool,
}

const fn verb(name: &'static str, line: &'static str) -> Verb {
    Verb {
        name,
        line,
        code: 0,
        writes: true,
    }
}

impl Verb {
    /// Expects a failed check.
    const fn fails(self) -> Self {
        Self { code: 1, ..self }
    }

    /// Expects an error after the command has written its files.
    const fn errs(self) -> Self {
        Self { code: 2, ..self }
    }

    /// Expects that the command writes only to its standard output.
    const fn reads_only(self) -> Self {
        Self {
            writes: false,
            ..self
        }
    }
}

/// All commands. `base` is the folder of an earlier run; a rig runs in `live`.
pub(crate) const VERBS: [Verb; 34] = [
    verb("demo", "demo --out o/demo"),
    verb("run", "run s.toml --out o/run --junit o/junit.xml"),
    // A shell without another program cannot be debugged.
    verb("debug", "debug s.toml --exec : --port 0 --out o/debug").errs(),
    verb("new", "new o/new"),
    // The ports stay unused, which is judged.
    verb("up", "up s.toml --dir ports --out o/up --duration 200ms").fails(),
    verb("dut", "dut --dir live --duration 200ms").reads_only(),
    verb("fault", "fault --dir live list").reads_only(),
    verb("with", "with --dir live -- true").reads_only(),
    verb("ui", "ui s.toml --duration 200ms --save o/ui.toml"),
    verb(
        "link",
        "link a=pty:a b=pty:b --fault drop,byte=1 -o o/link.pcapng --duration 100ms",
    ),
    verb(
        "record",
        "record --tap a=pty:a b=pty:b -o o/recorded.pcapng --duration 100ms",
    ),
    verb("replay", "replay base/capture.pcapng --expect").reads_only(),
    verb("case", "case from base/capture.pcapng -o o/case.toml"),
    verb(
        "import",
        "import dump --format raw --baud 115200 -o o/imported.pcapng",
    ),
    verb("export", "export base -o o/exported.csv"),
    verb("decode", "decode base/capture.pcapng").reads_only(),
    verb("describe", "describe modbus-meter -o o/meter.md"),
    // The bytes have no known format.
    verb("learn", "learn dump").reads_only().fails(),
    // There is no such device at the port.
    verb(
        "talk",
        "talk --rig live lidar --description modbus-meter --timeout 100ms read voltage",
    )
    .reads_only()
    .fails(),
    verb("conform", "conform --description cobs-sensor").reads_only(),
    // The program exits before it answers.
    verb("node", "node check false").reads_only().fails(),
    verb("bugs", "bugs PU-01").reads_only(),
    verb("bench", "bench s.toml --rounds 1 --no-instructions").reads_only(),
    verb("campaign", "campaign s.toml --seeds 0..2 --out o/campaign"),
    verb("fuzz", "fuzz pcui --cases 100 --out o/fuzz"),
    verb("shrink", "shrink bad.toml --out o/shrunk"),
    verb(
        "fidelity",
        "fidelity xv11 --capture base/capture.pcapng --against none",
    )
    .reads_only(),
    verb(
        "experiment",
        "experiment tries --seeds 1 --out o/experiment",
    ),
    verb("slam", "slam base --out o/slam"),
    verb("map", "map diff base base --picture o/diff.png"),
    verb("schema", "schema").reads_only(),
    verb("wireshark", "wireshark --install --dir o/wireshark"),
    verb("completions", "completions bash").reads_only(),
    verb("man", "man o/man"),
];

/// Three seconds of a robot in a room: a short run with all kinds of results.
const SHORT: &str = r#"
schema = 1
name = "short"
description = "three seconds in a room"
robot = "rescue"
duration = "3s"

[mission]
waypoints_m = [[2.0, 2.0]]

[world]
start = { x_m = 1.0, y_m = 1.0, heading_deg = 90 }

[[world.wall]]
path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]
"#;

/// A folder with all files that the commands need.
pub(crate) struct Bench {
    pub(crate) session: Session,
    /// The rig in `live`. It ends when this input is closed.
    rig: Child,
    lease: Option<ChildStdin>,
}

impl Bench {
    pub(crate) fn new(name: &str) -> Self {
        let session = Session::new(name);
        session.write("s.toml", SHORT);
        // The robot does not reach the goal in 300 ms.
        let bad = SHORT.replace("\"3s\"", "\"300ms\"");
        let bad = format!("{bad}\n[expect]\nvisit_within_mm = 100\n");
        session.write("bad.toml", &bad);
        let long = SHORT.replace("\"3s\"", "\"6h\"");
        let long = long.replace("[mission]", "[mission]\nto_the_end = true");
        session.write("long.toml", &long);
        session.write("dump", "bytes of no form");
        std::fs::create_dir(session.path("o")).expect("can be made");
        let made = session.hilrig(&["run", "s.toml", "--out", "base"]);
        assert_eq!(made.status.code(), Some(0), "{made:?}");
        let mut command = command(&session, "up s.toml --dir live --until-eof");
        command.stdin(Stdio::piped()).stderr(Stdio::null());
        let mut rig = command.stdout(Stdio::null()).spawn().expect("starts");
        let lease = rig.stdin.take();
        let bench = Self {
            session,
            rig,
            lease,
        };
        // The last file that the rig creates: all its ports exist then.
        bench.wait_for("live/.hilrig-scenario.toml");
        bench
    }

    /// Waits until the file exists; only a failing test waits long.
    pub(crate) fn wait_for(&self, name: &str) {
        let path = self.session.path(name);
        wait_until(name, || path.exists());
    }

    /// A command in the folder; its output is discarded.
    pub(crate) fn command(&self, line: &str) -> Command {
        command(&self.session, line)
    }

    /// Empties `o`.
    pub(crate) fn clear(&self) {
        let o = self.session.path("o");
        let _ = std::fs::remove_dir_all(&o);
        std::fs::create_dir(&o).expect("can be made");
    }

    /// All files below `o` with their contents.
    pub(crate) fn files(&self) -> Vec<(String, Vec<u8>)> {
        let mut files = Vec::new();
        collect(&self.session.path("o"), &mut files);
        files.sort();
        files
    }
}

impl Drop for Bench {
    /// The rig must detect by itself that its last user has closed the input.
    fn drop(&mut self) {
        drop(self.lease.take());
        let ended = self.rig.wait().expect("it was started");
        if !std::thread::panicking() {
            assert_eq!(ended.code(), Some(0));
            assert!(!self.session.path("live/lidar").exists());
        }
    }
}

/// Waits with the only clock that tests may use.
pub(crate) fn wait(span: Duration) {
    let clock = WallClock::start();
    clock.sleep_until(clock.now() + span);
}

fn command(session: &Session, line: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    command.args(line.split(' ')).current_dir(&session.folder);
    command.stdin(Stdio::null());
    command
}

fn collect(folder: &Path, files: &mut Vec<(String, Vec<u8>)>) {
    for entry in std::fs::read_dir(folder).expect("is there") {
        let path = entry.expect("readable").path();
        match path.is_dir() {
            true => collect(&path, files),
            false => {
                let bytes = std::fs::read(&path).expect("readable");
                files.push((path.display().to_string(), bytes));
            }
        }
    }
}
