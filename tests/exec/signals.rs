//! Signals to hilrig: the run so far is judged, and no process stays behind.

use core::time::Duration;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStderr, Command, Output, Stdio};

use hilrig::realtime::clock::{Clock, WallClock};
use rustix::process::{Pid, Signal, kill_process};

use crate::support::*;

/// Starts `command`, sends `signal` once its output contains `word`, and waits for its end.
fn interrupted(command: &mut Command, word: &str, signal: Signal) -> Output {
    interrupted_at(command, signal, |stderr, said| {
        while !said.contains(word) {
            let len = stderr.read_line(said).expect("text");
            assert!(len > 0, "no {word:?} in:\n{said}");
        }
    })
}

/// Starts `command`, sends `signal` when `wait` is over, and waits for its end.
fn interrupted_at(
    command: &mut Command,
    signal: Signal,
    wait: impl FnOnce(&mut BufReader<ChildStderr>, &mut String),
) -> Output {
    let mut child: Child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary is built");
    let mut stderr = BufReader::new(child.stderr.take().expect("piped"));
    let mut said = String::new();
    wait(&mut stderr, &mut said);
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    kill_process(pid.expect("a pid"), signal).expect("still there");
    stderr.read_to_string(&mut said).expect("text");
    let mut output = child.wait_with_output().expect("our own child");
    output.stderr = said.into_bytes();
    output
}

const READER: &str = "fd = port()\nwhile True:\n    os.read(fd, 100)\n";

#[test]
fn an_interrupted_run_is_judged_and_its_program_ended() {
    for (name, signal, code) in [("int", Signal::INT, 130), ("term", Signal::TERM, 143)] {
        let bench = Bench::new(name, "600s", READER);
        let output = interrupted(&mut bench.command(&[]), "rig time runs", signal);
        let ended = bench.ended(output);
        assert_eq!(ended.failed(), ["ran-to-its-end"], "{}", ended.said);
        let detail = ended.check("ran-to-its-end").1;
        let sign = format!("ended by SIG{}", name.to_uppercase());
        assert!(detail.starts_with(&sign), "{detail}");
        assert_eq!(ended.code, Some(code), "{}", ended.said);
    }
}

#[test]
fn an_interrupted_run_without_a_program_leaves_its_folder_too() {
    let bench = Bench::new("alone", "600s", "");
    let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    command.current_dir(&bench.folder);
    command.args(["run", "sonar.toml", "--realtime", "--out", "out"]);
    // Without a terminal it prints nothing until it ends, but it records.
    let capture = bench.folder.join("out/capture.pcapng");
    let output = interrupted_at(&mut command, Signal::INT, |_, _| {
        let clock = WallClock::start();
        while capture.metadata().map_or(0, |file| file.len()) == 0 {
            clock.sleep_until(clock.now() + Duration::from_millis(1));
        }
    });
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(130), "{said}");
    let result = std::fs::read_to_string(bench.folder.join("out/result.json")).expect("written");
    assert!(result.contains("ran-to-its-end"), "{result}");
}

#[test]
fn up_judges_when_it_ends_if_it_is_told_where_to() {
    let bench = Bench::new("up", "600s", "");
    let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    command.current_dir(&bench.folder);
    command.args(["up", "sonar.toml", "--dir", "ports", "--out", "out"]);
    let output = interrupted(&mut command, "running until", Signal::INT);
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("FAIL sonar"), "{said}");
    assert!(said.contains("no port was used"), "{said}");
    for name in ["result.json", "junit.xml", "capture.pcapng"] {
        assert!(bench.folder.join("out").join(name).exists(), "{name}");
    }

    let bench = Bench::new("up-over", "1s", "");
    let output = Command::new(env!("CARGO_BIN_EXE_hilrig"))
        .current_dir(&bench.folder)
        .args(["up", "sonar.toml", "--dir", "ports", "--out", "out"])
        .arg("--until-over")
        .output()
        .expect("the binary is built");
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "no client came: {said}");
    assert!(said.contains("1.0 s simulated"), "{said}");
}
