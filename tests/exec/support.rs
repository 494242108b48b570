//! Common parts of the tests of this binary: a small rig, foreign programs, the results of their
//! runs.

use core::time::Duration;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use hilrig::realtime::clock::{Clock as _, WallClock};
use protocols::Instant;

/// A sonar that sends its distance ten times a second, and answers "ping".
const RIG: &str = r#"
schema = 1
name = "sonar"
robot = "rescue"
duration = "DURATION"

[device.sonar.text]
baud = 9600
terminator = "\r\n"
unknown = "?"
periodic = { line = "mm={distance}", period = "100ms" }

[[device.sonar.text.variable]]
name = "distance"
source = { range = { angle_deg = 90, max_mm = 3000 } }

[[device.sonar.text.command]]
request = "ping"
reply = "pong {distance}"

[world]
start = { x_m = 1.0, y_m = 1.0, heading_deg = 90 }

[[world.wall]]
path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]
"#;

/// The beginning of every program: it prints its process group, so that a test can check whether
/// the group is gone.
pub(crate) const BEGIN: &str = "\
import os, signal, subprocess, sys, time
print('group', os.getpgrp(), flush=True)
def port():
    return os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
";

/// A folder of one test with its rig and its program.
pub(crate) struct Bench {
    pub(crate) folder: PathBuf,
}

impl Bench {
    /// A rig that runs for `duration` in front of the program `python`.
    pub(crate) fn new(name: &str, duration: &str, python: &str) -> Self {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"))
            .join(format!("exec-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("a fresh folder");
        let rig = RIG.replace("DURATION", duration);
        fs::write(folder.join("sonar.toml"), rig).expect("a fresh file");
        fs::write(folder.join("program.py"), format!("{BEGIN}{python}")).expect("a fresh file");
        Self { folder }
    }

    /// `hilrig run` with the program, ready to be started.
    pub(crate) fn command(&self, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
        command
            .current_dir(&self.folder)
            .args(["run", "sonar.toml", "--out", "out"])
            .args(["--exec", "python3 program.py"])
            .args(more);
        if !more.contains(&"--exec-wait") {
            command.args(["--exec-wait", "60s"]);
        }
        if !more.contains(&"--exec-needs") {
            command.args(["--exec-needs", "sonar"]);
        }
        command
    }

    /// Runs it to its end.
    pub(crate) fn run(&self, more: &[&str]) -> Ended {
        let output = self.command(more).output().expect("the binary is built");
        self.ended(output)
    }

    pub(crate) fn ended(&self, output: Output) -> Ended {
        ended_in(&self.folder, output)
    }
}

/// A folder for a test.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub(crate) fn folder(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()))
}

/// `hilrig run --exec COMMAND` in a fresh folder with these files, among them `sonar.toml`.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub(crate) fn run_in(folder: &Path, files: &[(&str, &str)], command: &str, more: &[&str]) -> Ended {
    let _ = fs::remove_dir_all(folder);
    fs::create_dir_all(folder).expect("a fresh folder");
    for (file, text) in files {
        fs::write(folder.join(file), text).expect("a fresh file");
    }
    let output = Command::new(env!("CARGO_BIN_EXE_hilrig"))
        .current_dir(folder)
        .args(["run", "sonar.toml", "--exec-needs", "sonar", "--out", "out"])
        .args(["--exec", command])
        .args(more)
        .output();
    ended_in(folder, output.expect("the binary is built"))
}

/// Results of a run in `folder`; its program and its ports are gone.
pub(crate) fn ended_in(folder: &Path, output: Output) -> Ended {
    let read = |name: &str| fs::read_to_string(folder.join("out").join(name));
    let log = read("program.log").expect("every run has it");
    let result = read("result.json").expect("every run has it");
    for name in ["junit.xml", "case.toml", "report.html", "capture.pcapng"] {
        assert!(folder.join("out").join(name).exists(), "{name}");
    }
    assert!(!folder.join("out/ports").exists(), "no port is left");
    for line in log.lines().filter_map(|line| line.strip_prefix("group ")) {
        let group = line.parse().expect("a number");
        // A killed process disappears when the machine has time for it. A surviving one would live
        // longer.
        let clock = WallClock::start();
        while !members(group).is_empty() && clock.now() < Instant::from_secs(30) {
            clock.sleep_until(clock.now() + Duration::from_millis(2));
        }
        assert_eq!(members(group), Vec::<u32>::new(), "{log}");
    }
    Ended {
        code: output.status.code(),
        said: String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr),
        log,
        result: serde_json::from_str(&result).expect("JSON"),
        folder: folder.to_owned(),
    }
}

/// Results of a run.
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) said: String,
    pub(crate) log: String,
    result: serde_json::Value,
    folder: PathBuf,
}

impl Ended {
    /// The folder of the run, with its results in `out`.
    #[cfg(all(target_os = "linux", target_arch = "x86_64"))]
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Events of the devices, one per line.
    pub(crate) fn events(&self) -> String {
        fs::read_to_string(self.folder.join("out/events.txt")).unwrap_or_default()
    }

    /// The saved case.
    #[cfg(all(target_os = "linux", target_arch = "x86_64"))]
    pub(crate) fn case(&self) -> String {
        fs::read_to_string(self.folder.join("out/case.toml")).expect("every run has it")
    }

    /// The fingerprint of all bytes on all lines.
    #[cfg(all(target_os = "linux", target_arch = "x86_64"))]
    pub(crate) fn trace(&self) -> String {
        let mut lines = self.said.lines();
        let line = lines.find_map(|line| line.trim().strip_prefix("trace "));
        line.unwrap_or_else(|| panic!("{}", self.said)).to_owned()
    }

    /// Status and detail of a check.
    pub(crate) fn check(&self, name: &str) -> (String, String) {
        let checks = self.result["checks"].as_array().expect("a list");
        let mut found = checks.iter().filter(|check| check["name"] == name);
        let check = found.next().unwrap_or_else(|| panic!("no {name}"));
        assert!(found.next().is_none(), "{name} twice");
        let text = |key: &str| check[key].as_str().expect("text").to_owned();
        (text("status"), text("detail"))
    }

    /// The exit code is that of a failed run: 1, or 3 on a host so busy that the rig itself was
    /// late, which the output then says.
    pub(crate) fn assert_is_failure(&self) {
        let was_late = self.said.contains("the rig itself was late");
        let expected = if was_late { 3 } else { 1 };
        assert_eq!(self.code, Some(expected), "{}", self.said);
    }

    /// The checks that failed.
    pub(crate) fn failed(&self) -> Vec<&str> {
        let checks = self.result["checks"].as_array().expect("a list");
        let failed = checks.iter().filter(|check| check["status"] == "fail");
        failed.filter_map(|check| check["name"].as_str()).collect()
    }
}

/// The living members of a process group.
pub(crate) fn members(group: i32) -> Vec<u32> {
    let entries = fs::read_dir("/proc").expect("Linux").flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    pids.filter(|pid| {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let fields = stat.rsplit_once(')').map(|(_, fields)| fields.to_owned());
        let fields = fields.unwrap_or_default();
        let mut fields = fields.split_ascii_whitespace();
        let is_alive = fields.next().is_some_and(|state| !"ZX".contains(state));
        is_alive && fields.nth(1) == Some(&group.to_string())
    })
    .collect()
}

/// Path of a scenario of the other tests.
pub(crate) fn short() -> &'static Path {
    Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/transport/short.toml"
    ))
}
