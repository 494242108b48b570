//! `hilrig fuzz --exec` with a foreign program in its own process on a pseudo-terminal, and
//! `--dut-dir` with one that already runs.
//!
//! The wall clock is only a limit in these tests: a correct program has far more time than it
//! needs. Timing of answers, and hangs, are judged in virtual time.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread;

use hilrig::capture::Capture;
use hilrig::realtime::clock::{Clock, WallClock};
use hilrig::realtime::transport::{PortDir, Pty, Transport, wait};

use rustix::process::{Pid, Signal, kill_process};

use crate::client::{BUG, Client};
use crate::support::{LINE, fresh_path, wait_until};

const SCENARIO: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/own-slave.toml");
const HILRIG: &str = env!("CARGO_BIN_EXE_hilrig");

/// The command that starts the client: this test binary, as another test of it.
fn client() -> String {
    let exe = std::env::current_exe().expect("it runs");
    let name = "client::the_client_of_other_tests_ends_only_when_its_port_does";
    format!("'{}' --exact {name} --nocapture", exe.display())
}

/// Exit code and output of `command` with a client with this bug.
fn run(command: &mut Command, bug: &str) -> (Option<i32>, String) {
    let output = command.env(BUG, bug).output().expect("the command starts");
    let [stdout, stderr] = [output.stdout, output.stderr].map(String::from_utf8);
    let said = [stdout, stderr].map(|said| said.expect("the command speaks UTF-8"));
    (output.status.code(), said.concat())
}

const ON_LINK: [&str; 2] = ["--link", "gripper"];

/// Searches, and returns the folder, the names of the findings, and the output.
fn search(bug: &str, more: &[&str]) -> (PathBuf, Vec<String>, String) {
    let out = fresh_path(&format!("fuzz-{bug}"));
    let found = search_in(&out, &client(), bug, &[&ON_LINK, more].concat());
    (out, found.0, found.1)
}

/// Whether the shell command `build` succeeds; it may fail outside CI only.
fn is_built(build: &str) -> bool {
    let built = Command::new("sh").args(["-c", build]).output();
    let built = built.expect("a shell starts");
    if !built.status.success() && std::env::var_os("CI").is_none() {
        eprintln!("SKIPPED: {}", String::from_utf8_lossy(&built.stderr));
        return false;
    }
    assert!(built.status.success(), "{built:?}");
    true
}

/// The names of the findings in `out`.
fn names_in(out: &Path) -> Vec<String> {
    let folders = std::fs::read_dir(out.join("findings"));
    let entries = folders.into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .map(|entry| entry.file_name().into_string().expect("plain"))
        .collect();
    names.sort();
    names
}

/// Searches in `out` with a program that `exec` starts.
fn search_in(out: &Path, exec: &str, bug: &str, more: &[&str]) -> (Vec<String>, String) {
    let mut command = Command::new(HILRIG);
    command.args(["fuzz", "--exec", exec, "--scenario", SCENARIO]);
    // On a busy machine the answers of a correct program may arrive late.
    let is_virtual = more.contains(&"--virtual");
    let alive = if is_virtual { "1s" } else { "60s" };
    command.args(["--case", "300ms", "--alive", alive]);
    command.args(more).arg("--out").arg(out);
    let (code, said) = run(&mut command, bug);
    let names = names_in(out);
    assert_eq!(code, Some(i32::from(!names.is_empty())), "{said}");
    (names, said)
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).expect("the command wrote it")
}

/// The client ends by SIGABRT at a frame of more than 64 bytes of data. The minimised case still
/// makes it crash, by the one command line in the finding.
#[test]
fn a_crash_is_found_and_its_command_repeats_it() {
    let (out, names, said) = search("crash", &["--cases", "1", "--shrink", "12"]);
    assert_eq!(names, ["01-crash-sigabrt"], "{said}");
    let finding = out.join("findings/01-crash-sigabrt");
    let cause = read(&finding.join("cause.txt"));
    assert!(
        cause.starts_with("crash-sigabrt *** buffer overflow detected ***\n"),
        "{cause}"
    );
    assert!(cause.contains(" left of "), "{cause}");
    assert!(read(&finding.join("stderr.txt")).contains("buffer overflow"));
    let capture = Capture::read(&finding.join("capture.pcapng")).expect("readable");
    assert_eq!((capture.broken, capture.cut), (None, 0));

    let repeat = read(&finding.join("repeat.txt"));
    let repeat = repeat.replacen("hilrig", HILRIG, 1);
    let (code, said) = run(
        Command::new("sh")
            .args(["-c", &repeat])
            .current_dir(&finding),
        "crash",
    );
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("seen again: crash-sigabrt"), "{said}");
    // The fixed program passes the same case.
    let (code, said) = run(
        Command::new("sh")
            .args(["-c", &repeat])
            .current_dir(&finding),
        "none",
    );
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("not seen again: crash-sigabrt"), "{said}");
}

/// The client hangs after two start bytes in a row, alive and with its port open.
#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn a_hang_is_found_and_told_from_a_crash() {
    let (out, names, said) = search("hang", &["--virtual", "--cases", "4", "--shrink", "2"]);
    assert_eq!(names, ["01-hang"], "{said}");
    let cause = read(&out.join("findings/01-hang/cause.txt"));
    assert!(
        cause.contains("it answers nothing that it used to"),
        "{cause}"
    );
}

/// The client compares the low byte of the checksum only.
#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn an_accepted_damaged_frame_is_found_and_told_from_a_crash() {
    let (_, names, said) = search("accept", &["--virtual", "--cases", "1", "--shrink", "4"]);
    assert_eq!(names, ["01-accepts-corrupt-frame"], "{said}");
}

/// A driver that gives up after five tries, and its version that ignores the checksum of replies:
/// with two requests in turn, with one and the same, and with one that only a counter tells apart.
#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn a_driver_that_accepts_damaged_replies_is_told_from_a_sound_one() {
    let folder = fresh_path("fuzz-careless");
    std::fs::create_dir_all(&folder).expect("a fresh folder");
    let file = |name: &str| folder.join(name).display().to_string();
    let sources = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fuzz_programs/scale");
    let driver = format!("gcc -Wall -Wextra -Werror '{sources}/driver.c'");
    let build = format!(
        "cd '{}' && for way in TURNS POLLS COUNTS; do {driver} -D$way -o sound-$way && \
         {driver} -D$way -DCARELESS -o careless-$way || exit 1; done",
        folder.display()
    );
    if !is_built(&build) {
        return;
    }
    let ways = ["TURNS", "POLLS", "COUNTS"].map(|way| [("sound", way), ("careless", way)]);
    for (kind, way) in ways.into_iter().flatten() {
        let version = &format!("{kind}-{way}");
        let found: &[&str] = match kind {
            "sound" => &[],
            _ => &["01-accepts-corrupt-frame"],
        };
        let exec = format!("exec '{}' \"$HILRIG_DIR/scale\"", file(version));
        let out = folder.join(format!("{version}-out"));
        let mut command = Command::new(HILRIG);
        command.args(["fuzz", "--exec", &exec, "--virtual", "--description"]);
        command.arg(format!("{sources}/scale.toml"));
        command.args(["--cases", "8", "--shrink", "0"]);
        let (_, said) = run(command.arg("--out").arg(&out), "none");
        assert_eq!(names_in(&out), found, "{said}");
        let given_up = said.contains("conversations ended after") && kind == "sound";
        assert!(given_up || kind == "careless", "{said}");
    }
    let finding = folder.join("careless-TURNS-out/findings/01-accepts-corrupt-frame");
    let repeat = read(&finding.join("repeat.txt")).replacen("hilrig", HILRIG, 1);
    let (code, said) = run(
        Command::new("sh")
            .args(["-c", &repeat])
            .current_dir(&finding),
        "none",
    );
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("seen again: accepts-corrupt-frame scale"),
        "{said}"
    );
}

/// The client waits for the rest of a cut frame forever, so that the next request is lost.
#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn a_missing_timeout_is_found_in_a_program_that_answers() {
    let (out, names, said) = search("patient", &["--virtual", "--cases", "8", "--shrink", "2"]);
    assert!(names.contains(&"01-no-timeout".to_owned()), "{said}");
    let cause = read(&out.join("findings/01-no-timeout/cause.txt"));
    assert!(
        cause.contains("takes the next frame for the rest of it"),
        "{cause}"
    );
}

/// The correct client answers a wrong checksum with the refusal of the bus, which does not count as
/// acceptance. Two cases run, then the same command continues with the third.
#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn nothing_is_found_in_a_sound_program() {
    let (out, names, said) = search("none", &["--virtual", "--cases", "2"]);
    assert_eq!(names, [""; 0], "{said}");
    assert!(
        said.contains("requests are answered, and are also sent damaged"),
        "{said}"
    );
    assert!(!out.join("ports").exists(), "the ports are removed");
    assert!(read(&out.join("dut.json")).contains("\"next\": 2"));

    let more = ["--virtual", "--link", "gripper", "--cases", "3"];
    let (names, said) = search_in(&out, &client(), "none", &more);
    assert!(names.is_empty() && said.contains("1 cases with "), "{said}");
    let mut other = Command::new(HILRIG);
    other.args(["fuzz", "--exec", "another", "--scenario", SCENARIO]);
    let (code, said) = run(other.arg("--out").arg(&out), "none");
    assert_eq!(code, Some(2), "{said}");
    let expected = "dut.json: is of another program, scenario, link or seed; expected another";
    assert!(said.contains(expected), "{said}");
}

/// The gripper reports the violation: a write to a read-only register. The finding needs no fault,
/// and none is left in it.
#[test]
fn a_broken_rule_of_a_device_is_found() {
    let out = fresh_path("fuzz-meddle");
    let (names, said) = search_in(&out, &client(), "meddle", &["--cases", "1"]);
    assert_eq!(names, ["01-rule-write-read-only"], "{said}");
    let case = read(&out.join("findings/01-rule-write-read-only/case.toml"));
    assert!(!case.contains("[[fault]]"), "{case}");
}

/// Two programs of one line each: one ends with exit code 0, the other never reads its port.
#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn an_early_end_and_a_port_that_is_not_read_are_found() {
    let open = "exec 3<>\"$HILRIG_DIR/gripper\"";
    for (name, exec, found) in [
        ("ends", format!("{open}; sleep 0.5"), "01-ended"),
        ("deaf", format!("{open}; sleep 60"), "01-hang"),
    ] {
        let out = fresh_path(&format!("fuzz-{name}"));
        let more = ["--virtual", "--cases", "1", "--shrink", "0"];
        let more = [&ON_LINK[..], &more].concat();
        let (names, said) = search_in(&out, &exec, "none", &more);
        assert_eq!(names, [found], "{said}");
    }
}

/// In virtual time the repeated case makes the same capture, byte for byte.
#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn a_crash_found_in_virtual_time_is_repeated_to_the_byte() {
    let out = fresh_path("fuzz-virtual");
    let more = ["--virtual", "--cases", "1", "--shrink", "2"];
    let more = [&ON_LINK[..], &more].concat();
    let (names, said) = search_in(&out, &client(), "crash", &more);
    assert_eq!(names, ["01-crash-sigabrt"], "{said}");
    let finding = out.join("findings/01-crash-sigabrt");
    let repeat = read(&finding.join("repeat.txt")).replacen("hilrig", HILRIG, 1);
    assert!(repeat.contains(" --virtual "), "{repeat}");
    let (code, said) = run(
        Command::new("sh")
            .args(["-c", &repeat])
            .current_dir(&finding),
        "crash",
    );
    assert_eq!(code, Some(1), "{said}");
    let bytes = |name: &str| std::fs::read(finding.join(name)).expect("written");
    assert_eq!(bytes("capture.pcapng"), bytes("repeated.pcapng"));
}

/// A program of one line that computes endlessly takes no virtual time, but is found.
#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn a_program_that_spins_is_found_in_virtual_time() {
    let out = fresh_path("fuzz-spins");
    let exec = "exec 3<>\"$HILRIG_DIR/gripper\"; sleep 0.5; while :; do :; done";
    let more = ["--virtual", "--cases", "1", "--shrink", "0"];
    let (names, said) = search_in(&out, exec, "none", &[&ON_LINK[..], &more].concat());
    assert_eq!(names, ["01-spins"], "{said}");
}

/// The search detects the counters of a C program, and keeps inputs that reach new code.
#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn a_program_that_counts_what_it_reaches_leads_the_search() {
    let out = fresh_path("fuzz-coverage");
    std::fs::create_dir_all(&out).expect("a fresh folder");
    let nested = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/fuzz_programs/nested/sonar.c"
    );
    let build = format!(
        "cd '{}' && {HILRIG} fuzz --coverage-runtime c.c && gcc -Wall -Wextra -Werror -c c.c && \
         gcc -fsanitize-coverage=trace-pc,trace-cmp -fno-builtin {nested} c.o -o nested",
        out.display()
    );
    if !is_built(&build) {
        return;
    }
    let exec = format!("exec '{}'", out.join("nested").display());
    let more = ["--virtual", "--link", "sonar", "--cases", "1"];
    let (names, said) = search_in(&out, &exec, "none", &more);
    assert_eq!(names, [""; 0], "{said}");
    assert!(
        said.contains("the program counts its covered code"),
        "{said}"
    );
    assert!(read(&out.join("dut.json")).contains("\"pool\""), "{said}");
}

/// An interrupted search leaves no port and no program behind, and prints its result so far.
#[test]
fn an_interrupted_search_ends_its_program() {
    let out = fresh_path("fuzz-interrupted");
    let exec = format!("{BUG}=none {}", client());
    let out_text = out.to_str().expect("plain");
    let args = [
        "fuzz",
        "--exec",
        &exec,
        "--scenario",
        SCENARIO,
        "--out",
        out_text,
    ];
    // The command shows its progress only on a terminal.
    let dir = PortDir::open(&fresh_path("fuzz-screen")).expect("a fresh directory");
    let mut screen = Pty::open(&dir, "screen", LINE).expect("a free name");
    let terminal = File::options().write(true).open(screen.path());
    let mut command = Command::new(HILRIG);
    let times = ["--case", "300ms", "--alive", "60s"];
    command.args([&args[..], &ON_LINK, &times].concat());
    command.stdin(Stdio::null()).stdout(Stdio::piped());
    command.stderr(terminal.expect("the test may open it"));
    let search = command.spawn().expect("the binary is built");
    drop(command);
    let mut shown = String::new();
    let mut buf = [0; 256];
    // After the first case the search knows which frames are answered.
    wait_until(|| {
        let len = screen.read(&mut buf).unwrap_or(0);
        shown += &String::from_utf8_lossy(&buf[..len]);
        let mut told = shown.lines().filter(|line| line.contains(" cases with "));
        told.any(|line| !line.contains(" 0 cases with "))
    });
    let pid = i32::try_from(search.id()).ok().and_then(Pid::from_raw);
    kill_process(pid.expect("a pid"), Signal::INT).expect("still there");
    let output = search.wait_with_output().expect("our own child");
    while let Ok(len @ 1..) = screen.read(&mut buf) {
        shown += &String::from_utf8_lossy(&buf[..len]);
    }
    let said = String::from_utf8_lossy(&output.stdout) + &*shown;
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains(" inputs/s, 0 findings"), "{said}");
    assert!(!out.join("ports").exists(), "{said}");
}

/// A board that is already running: a client in a thread, behind a terminal that the test created.
#[test]
fn a_program_behind_a_port_is_asked_as_well() {
    let dir = PortDir::open(&fresh_path("fuzz-board")).expect("a fresh directory");
    let mut board = Pty::open(&dir, "gripper", LINE).expect("a free name");
    let over = Arc::new(AtomicBool::new(false));
    let is_over = Arc::clone(&over);
    let board = thread::spawn(move || {
        let (mut client, clock, mut buf) = (Client::with("accept"), WallClock::start(), [0; 256]);
        let (idle, mut heard_at) = (Duration::from_millis(15), clock.now());
        while !is_over.load(Ordering::Relaxed) {
            let mut fds = Vec::new();
            board.readiness(&mut fds);
            // An answer is sent at once, and silence ends a partial frame.
            wait(&fds, idle).expect("poll works");
            let len = board.read(&mut buf).unwrap_or(0);
            while board.next_event().is_some() {}
            if len > 0 || clock.now() - heard_at >= idle {
                let reply = client.hears(&buf[..len]);
                board.write(&reply);
                heard_at = clock.now();
            }
        }
    });
    let out = fresh_path("fuzz-board-out");
    let mut command = Command::new(HILRIG);
    command.args([
        "fuzz",
        "--scenario",
        SCENARIO,
        "--link",
        "gripper",
        "--dut-dir",
    ]);
    command.arg(dir.path()).arg("--out").arg(&out);
    // One case shows it, unless the machine is busy for the 60 ms in which an answer counts.
    let (code, said) = run(command.args(["--cases", "4", "--case", "100ms"]), "none");
    over.store(true, Ordering::Relaxed);
    board.join().expect("the board lives");
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("-accepts-corrupt-frame: "), "{said}");
}

/// Set-up errors: the error, the expected value, exit code 2.
#[test]
fn programs_that_cannot_be_fuzzed_are_named_with_the_reason() {
    let out = fresh_path("fuzz-cannot");
    let out = out.to_str().expect("plain");
    let said = |more: &[&str]| {
        let mut command = Command::new(HILRIG);
        let (code, said) = run(command.args(["fuzz", "--out", out]).args(more), "none");
        assert_eq!(code, Some(2), "{said}");
        said.replace(out, "OUT").replace(SCENARIO, "S")
    };
    let on = ["--scenario", SCENARIO];
    let ports = "lidar, motor, base, radio, pc, gripper, sonar";
    let exec = |command: &str, more: &[&str]| said(&[&["--exec", command], more, &on].concat());
    assert_eq!(
        said(&["--exec", "true"]),
        "error: --scenario is missing, expected a scenario with the program's devices, \
         --description of its device, or --corpus with bytes of a device\n"
    );
    assert_eq!(
        exec("echo no port >&2; exit 3", &[]),
        format!(
            "error: --exec 'echo no port >&2; exit 3': ended with exit code 3 before it opened a \
             port, saying: no port; expected it to open one of {ports} in OUT/ports\n"
        )
    );
    // Shells differ in their message for a missing program.
    let missing = exec("no-such-robot", &[]);
    assert!(
        missing.contains("ended with exit code 127 before it opened a port"),
        "{missing}"
    );
    assert_eq!(
        exec("sleep 9", &["--start", "400ms"]),
        format!(
            "error: --exec 'sleep 9': opened no port within 0.4 s; expected it to open one of \
             {ports} in OUT/ports\n"
        )
    );
    assert_eq!(
        exec("true", &["--link", "arm"]),
        format!("error: --link arm: no port of the program, expected one of {ports}\n")
    );
    assert_eq!(
        said(&[&["--dut-dir", "/dev/null"], &on[..]].concat()),
        format!("error: --dut-dir /dev/null: no port there, expected one of {ports}\n")
    );
    assert_eq!(
        said(&["--exec", "true", "--repeat", "/dev"]),
        "error: /dev: is no finding, expected a folder with case.toml and told.toml\n"
    );
    let both = said(&["--exec", "true", "--dut-dir", "."]);
    assert!(
        both.contains("'--exec <CMD>' cannot be used with '--dut-dir <DIR>'"),
        "{both}"
    );
}
