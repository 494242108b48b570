//! Every command under adverse conditions: a closed pipe, a full disk, a read-only folder, Ctrl-C.
//! No command may panic or leave half a file, and each one reports the problem in one line.

use core::time::Duration;
use std::io::Read as _;
use std::process::{Child, Output, Stdio};

use rustix::process::{Pid, Signal, kill_process};

use super::thorough::every;
use super::verbs::{Bench, VERBS, wait};
use super::{text, wait_until};

/// The errors that the command printed; it must not have panicked.
fn complaints(line: &str, stderr: &[u8]) -> Vec<String> {
    let said = String::from_utf8_lossy(stderr).into_owned();
    assert!(!said.contains("panicked"), "{line}: {said}");
    let is_one = |line: &&str| line.starts_with("error: ") || line.starts_with("cannot write");
    said.lines().filter(is_one).map(str::to_owned).collect()
}

/// `hilrig .. 2>&1 | head -c 1`: the closed pipe changes neither the results nor the exit code.
#[test]
fn a_reader_that_goes_ends_nothing() {
    let bench = Bench::new("reader-goes");
    for verb in every(3, 0, &VERBS) {
        bench.clear();
        let mut command = bench.command(verb.line);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("starts");
        // Both pipes are closed before the command prints anything.
        drop((child.stdout.take(), child.stderr.take()));
        let code = child.wait().expect("ends").code();
        assert_eq!(code, Some(verb.code), "{}", verb.line);
        assert_eq!(bench.files().is_empty(), !verb.writes, "{}", verb.line);
    }
    // A pipe that is closed in the middle of a long output.
    let mut command = bench.command("decode base/capture.pcapng");
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("starts");
    let mut first = [0];
    let mut reader = child.stdout.take().expect("piped");
    reader.read_exact(&mut first).expect("it speaks");
    drop(reader);
    let output = child.wait_with_output().expect("ends");
    assert_eq!(output.status.code(), Some(0));
    assert!(complaints("decode", &output.stderr).is_empty());
}

/// Standard output is a file on a full disk: the error is reported once, and the results are
/// complete.
#[test]
fn an_output_that_is_full_is_told_once() {
    let bench = Bench::new("full-output");
    for verb in every(3, 1, &VERBS) {
        bench.clear();
        let full = std::fs::File::options().write(true).open("/dev/full");
        let mut command = bench.command(verb.line);
        command.stdout(full.expect("Linux has it"));
        let output = command.output().expect("starts");
        let mut told = complaints(verb.line, &output.stderr);
        if verb.code == 2 {
            // The command's own error is printed as well.
            told.retain(|line| line.contains("os error 28"));
        }
        // The rig's list of faults is empty, and so are the output of a program and the draft of a
        // dump of an unknown format. Nothing is printed then.
        let expected = usize::from(!["fault", "with", "learn"].contains(&verb.name));
        assert_eq!(told.len(), expected, "{}: {told:?}", verb.line);
        let code = if expected > 0 && verb.code == 0 {
            2
        } else {
            verb.code
        };
        assert_eq!(output.status.code(), Some(code), "{}", verb.line);
        assert!(
            told.iter().all(|line| line.contains("os error 28")),
            "{told:?}"
        );
        assert_eq!(bench.files().is_empty(), !verb.writes, "{}", verb.line);
    }
}

/// `hilrig .. > log 2>&1` with the log on a full disk: the results are complete, and the exit code
/// is not 0 (S8).
#[test]
fn a_full_disk_below_both_outputs_ends_nothing() {
    let bench = Bench::new("full-both");
    let full = || std::fs::File::options().write(true).open("/dev/full");
    for line in ["run s.toml --out o/run", "schema", "nonsense", "--help"] {
        bench.clear();
        let mut command = bench.command(line);
        command.stdout(full().expect("Linux has it"));
        command.stderr(full().expect("Linux has it"));
        let code = command.status().expect("starts").code();
        assert_eq!(code, Some(2), "{line}");
        assert_eq!(bench.files().is_empty(), !line.starts_with("run"), "{line}");
    }
}

/// The results are to be written into the kernel's own file system, which no user can write: one
/// line names the path, and the exit code is that of a wrong set-up.
#[test]
fn a_folder_that_cannot_be_written_is_one_line() {
    let bench = Bench::new("read-only");
    for verb in every(2, 0, VERBS.iter().filter(|verb| verb.writes)) {
        bench.clear();
        let line = verb.line.replace(" o/", " /sys/o/");
        let output = bench.command(&line).output().expect("starts");
        let told = complaints(&line, &output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {output:?}");
        assert_eq!(told.len(), 1, "{line}: {told:?}");
        assert!(told[0].contains("/sys/o"), "{line}: {told:?}");
    }
}

/// Whether a file is complete, by its last bytes.
fn is_whole(name: &str, bytes: &[u8]) -> bool {
    let ends = |end: &str| bytes.ends_with(end.as_bytes());
    match name.rsplit('.').next().unwrap_or_default() {
        "json" => serde_json::from_slice::<serde_json::Value>(bytes).is_ok(),
        "toml" => toml::from_str::<toml::Table>(&String::from_utf8_lossy(bytes)).is_ok(),
        "html" => ends("</html>\n"),
        "xml" => ends("</testsuites>\n") || ends("</testsuites>"),
        // IEND and its checksum.
        "png" => ends("IEND\u{AE}B`\u{82}") || bytes.ends_with(b"IEND\xAEB`\x82"),
        "part" | "new" => false,
        _ => true,
    }
}

/// No file can be longer than 4 KiB: each one is complete or missing. Only a capture keeps the part
/// that was recorded, and the command reports this.
#[test]
fn a_full_disk_leaves_no_torn_file() {
    let bench = Bench::new("full-disk");
    for verb in every(2, 1, VERBS.iter().filter(|verb| verb.writes)) {
        bench.clear();
        let line = format!("trap '' XFSZ; ulimit -f 4; exec \"$0\" {}", verb.line);
        let mut command = std::process::Command::new("bash");
        command.args(["-c", &line, env!("CARGO_BIN_EXE_hilrig")]);
        command.current_dir(&bench.session.folder);
        let output = command.stdin(Stdio::null()).output().expect("starts");
        let told = complaints(verb.line, &output.stderr);
        let code = output.status.code();
        match code {
            Some(2) => assert_eq!(told.len(), 1, "{}: {told:?}", verb.line),
            // All output of the command fits.
            _ => assert_eq!(code, Some(verb.code), "{}: {output:?}", verb.line),
        }
        for (name, bytes) in bench.files() {
            assert!(is_whole(&name, &bytes), "{}: {name}", verb.line);
        }
    }
}

/// Commands that run until they are stopped, and their exit code after Ctrl-C. A command that does
/// not catch the signal ends as the shell expects.
const ENDLESS: [(&str, &str, Option<i32>); 10] = [
    (
        "run long.toml --out o/run",
        "o/run/capture.pcapng",
        Some(130),
    ),
    (
        "run long.toml --realtime --out o/run",
        "o/run/capture.pcapng",
        Some(130),
    ),
    (
        "up long.toml --dir ports --out o/up",
        "ports/control",
        Some(1),
    ),
    ("ui long.toml --save o/ui.toml", "", Some(0)),
    ("dut --dir live", "", Some(0)),
    ("link a=pty:a b=pty:b -o o/l.pcapng", "o/l.pcapng", Some(0)),
    (
        "record --tap a=pty:a b=pty:b -o o/r.pcapng",
        "o/r.pcapng",
        Some(0),
    ),
    ("decode base/capture.pcapng --follow", "", Some(0)),
    (
        "campaign s.toml --seeds 0..100000 --out o/campaign",
        "o/campaign",
        Some(130),
    ),
    ("fuzz pcui --for 1h --out o/fuzz", "o/fuzz", Some(0)),
];

#[test]
fn ctrl_c_ends_each_with_whole_files() {
    let bench = Bench::new("ctrl-c");
    for (line, begun, code) in ENDLESS {
        bench.clear();
        let mut command = bench.command(line);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let child = command.spawn().expect("starts");
        if !begun.is_empty() {
            bench.wait_for(begun);
        }
        // A signal that arrives before its handler is installed ends the process at once.
        wait_until(line, || catches_interrupt(&child));
        // Time for some work.
        wait(Duration::from_millis(100));
        let output = interrupted(child);
        assert_eq!(
            output.status.code(),
            code,
            "{line}: {}",
            text(&output.stderr)
        );
        assert!(complaints(line, &output.stderr).is_empty(), "{line}");
        for (name, bytes) in bench.files() {
            assert!(is_whole(&name, &bytes), "{line}: {name}");
        }
    }
}

/// Whether the process catches SIGINT, as the system lists it: bit 1 of a mask.
fn catches_interrupt(child: &Child) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{}/status", child.id()));
    let status = status.unwrap_or_default();
    let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
    let caught = caught.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    caught.is_some_and(|mask| mask & 0b10 != 0)
}

fn interrupted(child: Child) -> Output {
    let id = i32::try_from(child.id()).expect("a process");
    kill_process(Pid::from_raw(id).expect("not 0"), Signal::INT).expect("it lives");
    child.wait_with_output().expect("it ends")
}
