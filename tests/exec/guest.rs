//! A user's program in virtual time: the same bytes each time, whatever language it is written in
//! and however busy the machine is, and clear messages about programs that misbehave.

use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use crate::support::{Ended, ended_in, short};
use crate::thorough::is_thorough;

/// "mm=700" and its line end every 100 ms; a character at 9600 baud takes 1.0417 ms; no robot.
const SONAR: &str = include_str!("programs/sonar.toml");

fn folder(name: &str) -> PathBuf {
    let folder = format!("guest-{name}-{}", std::process::id());
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(folder)
}

/// `hilrig run --exec COMMAND --virtual` in a fresh folder with these files.
fn start(name: &str, command: &str, files: &[(&str, &str)], more: &[&str]) -> Child {
    let folder = folder(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a fresh folder");
    fs::write(folder.join("sonar.toml"), SONAR).expect("a fresh file");
    for (file, text) in files {
        fs::write(folder.join(file), text).expect("a fresh file");
    }
    let mut run = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    run.current_dir(&folder);
    if more.iter().all(|word| !word.ends_with(".toml")) {
        run.args(["run", "sonar.toml", "--exec-needs", "sonar"]);
    }
    run.args(more)
        .args(["--exec", command, "--virtual", "--out", "out"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary is built")
}

fn end(name: &str, child: Child) -> Ended {
    let output = child.wait_with_output().expect("it ends");
    ended_in(&folder(name), output)
}

pub(crate) fn run(name: &str, command: &str, files: &[(&str, &str)], more: &[&str]) -> Ended {
    end(name, start(name, command, files, more))
}

/// The fingerprint of all bytes on all lines.
pub(crate) fn trace(ended: &Ended) -> String {
    let line = ended
        .said
        .lines()
        .find_map(|line| line.trim().strip_prefix("trace "));
    line.expect("each run says it").to_owned()
}

/// The robot's own program, a Rust program with threads on pollable ports, drives its mission. Two
/// concurrent runs, each of which loads the other's machine, give the same bytes.
#[test]
fn the_robots_own_program_makes_the_same_bytes_on_a_busy_machine() {
    let mission = fs::read_to_string(short()).expect("it is there");
    let near = mission.replace("[[1.2, 1.2], [2.2, 1.2]]", "[[1.1, 1.2]]");
    assert!(near != mission, "{mission}");
    let mission = if is_thorough() { &mission } else { &near };
    let files = [("mission.toml", mission.as_str())];
    let command = format!("{} dut --dir \"$HILRIG_DIR\"", env!("CARGO_BIN_EXE_hilrig"));
    let names = ["dut-a", "dut-b"];
    let started = names.map(|name| start(name, &command, &files, &["run", "mission.toml"]));
    let mut ended = names
        .into_iter()
        .zip(started)
        .map(|(name, child)| end(name, child));
    let (one, other) = (ended.next().expect("two"), ended.next().expect("two"));
    assert_eq!(
        one.failed(),
        Vec::<&str>::new(),
        "{}\n{}",
        one.said,
        one.log
    );
    assert_eq!(one.code, Some(0), "{}", one.said);
    assert!(!one.said.contains("last words"), "{}", one.said);
    assert_eq!(trace(&one), trace(&other));
}

/// One thread reads, another one sleeps and writes; all time stamps are virtual, so they are exact.
const THREADS: &str = "\
import os, threading, time
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
begin, got = time.monotonic(), b''
def reader():
    global got
    while True:
        got += os.read(fd, 100)
threading.Thread(target=reader, daemon=True).start()
for beat in range(4):
    os.write(fd, b'ping\\r\\n')
    time.sleep(0.5)
    print(round(time.monotonic() - begin, 2), flush=True)
print(got.count(b'pong'), 'pongs', os.urandom(8), hash('word'), time.time() < 1.8e9, flush=True)
time.sleep(60)
";

#[test]
fn a_python_program_with_a_reader_thread_is_the_same_twice() {
    let files = [("program.py", THREADS)];
    let ended = run("threads", "python3 program.py", &files, &["--check"]);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    let (_, detail) = ended.check("deterministic");
    assert!(
        detail.starts_with("both runs gave the same bytes"),
        "{detail}"
    );
    let first: Vec<&str> = ended.log.lines().take(4).collect();
    assert_eq!(first, ["0.5", "1.0", "1.5", "2.0"], "{}", ended.log);
    assert!(ended.log.contains("4 pongs"), "{}", ended.log);
    // The calendar begins at the same moment in each run: 2026-01-01.
    assert!(ended.log.contains("True"), "{}", ended.log);
}

/// Whether a compiler is installed; prints a visible message if not.
pub(crate) fn compiled(
    name: &str,
    compiler: &str,
    source: &str,
    flags: &[&str],
) -> Option<PathBuf> {
    let folder = folder(&format!("{name}-build"));
    fs::create_dir_all(&folder).expect("a fresh folder");
    let (file, optimised) = match compiler {
        "c++" => ("program.cpp", "-O1"),
        "rustc" => ("program.rs", "-Copt-level=1"),
        _ => ("program.c", "-O1"),
    };
    let file = folder.join(file);
    fs::write(&file, source).expect("a fresh file");
    let program = folder.join("program");
    let mut command = Command::new(compiler);
    command
        .arg(optimised)
        .arg("-o")
        .arg(&program)
        .arg(&file)
        .args(flags);
    match command.status() {
        Ok(status) => {
            assert!(status.success(), "{compiler} {flags:?}");
            Some(program)
        }
        Err(error) => {
            eprintln!("SKIPPED: {name}: no {compiler}: {error}");
            None
        }
    }
}

/// Each poll times out after 30 ms without bytes: the sonar sends for 8.3 ms of each 100 ms, so
/// three polls time out in each gap.
const POLL: &str = include_str!("programs/poll.c");

/// Linked for the machine, and static, where no library of ours could be loaded: 2 s are 19 whole
/// lines after the port was opened, and three time-outs in each of 20 gaps, except at the edges.
#[test]
fn a_c_program_on_poll_hears_the_same_static_or_not() {
    let mut traces = Vec::new();
    for (name, flags) in [("poll", &[][..]), ("static", &["-static"][..])] {
        let Some(program) = compiled(name, "cc", POLL, flags) else {
            return;
        };
        let ended = run(name, &program.display().to_string(), &[], &["--check"]);
        assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
        let said = ended.log.lines().find(|line| line.contains("timeouts"));
        let said = said.expect("it says so");
        let figures: Vec<i32> = said
            .split(|c: char| !c.is_ascii_digit())
            .filter_map(|word| word.parse().ok())
            .collect();
        assert!(
            (55..=63).contains(&figures[0]) && (18..=20).contains(&figures[1]),
            "{said}"
        );
        traces.push(trace(&ended));
    }
    assert_eq!(traces[0], traces[1]);
}

/// Three threads: one reads and notifies, one waits for the notification with a time limit, one
/// sleeps.
const CONDITION: &str = include_str!("programs/condition.cpp");

/// Between two lines, 100 ms apart, the waiting thread times out twice and is notified once: two of
/// three.
#[test]
fn three_cpp_threads_and_a_condition_variable_are_the_same_twice() {
    let Some(program) = compiled("condition", "c++", CONDITION, &["-pthread"]) else {
        return;
    };
    let ended = run(
        "condition",
        &program.display().to_string(),
        &[],
        &["--check"],
    );
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    let said = ended
        .log
        .lines()
        .find(|line| line.contains("timeouts"))
        .expect("it says so");
    assert!(said.starts_with("1000 ms"), "{said}");
    let timeouts = ["26 timeouts", "27 timeouts", "28 timeouts"];
    assert!(timeouts.iter().any(|count| said.contains(count)), "{said}");
}

#[test]
fn two_processes_of_a_shell_pipeline_are_the_same_twice() {
    let command = "while read line; do echo \"$line\"; done < \"$HILRIG_PORT_SONAR\" | \
                   sed -u s/mm/MM/";
    let ended = run("pipeline", command, &[], &["--check"]);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    assert!(
        ended
            .log
            .lines()
            .filter(|line| line.starts_with("MM=700"))
            .count()
            >= 25
    );
}

const BEGIN: &str = "\
import os, signal, subprocess, sys, time
print('group', os.getpgrp(), flush=True)
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
";

/// Each program gets a clear message, and no process remains: `ended_in` looks for their groups.
#[test]
fn programs_that_misbehave_end_with_a_clear_word() {
    let cases = [
        (
            "spins",
            "while True: pass",
            "program-yields",
            "computes without a call",
        ),
        (
            "killed",
            "os.kill(os.getpid(), signal.SIGSEGV)",
            "program-alive",
            "SIGSEGV",
        ),
        (
            "exits",
            "time.sleep(1); sys.exit(3)",
            "program-alive",
            "exit code 3",
        ),
        (
            "keeps",
            "child = subprocess.Popen(['sleep', '77'], pass_fds=[fd])\ntime.sleep(1); sys.exit(0)",
            "no-children-left",
            "sleep 77",
        ),
        (
            "forks",
            "os.fork() and os._exit(0)\ntime.sleep(77)",
            "program-alive",
            "exit code 0",
        ),
    ];
    let mut started = Vec::new();
    for (name, program, ..) in cases {
        let program = format!("{BEGIN}{program}\n");
        let files = [("program.py", program.as_str())];
        let more = ["--spin-max", "1s"];
        started.push(start(name, "exec python3 program.py", &files, &more));
    }
    for ((name, _, check, word), child) in cases.into_iter().zip(started) {
        let ended = end(name, child);
        let (_, detail) = ended.check(check);
        assert!(detail.contains(word), "{name}: {detail}\n{}", ended.said);
        assert_eq!(ended.code, Some(1), "{name}: {}", ended.said);
    }
}

/// A timer's signal interrupts a read every quarter of a second; the end of the run is also a
/// signal.
#[test]
fn signals_come_at_their_virtual_time() {
    let program = "\
beats = []
signal.signal(signal.SIGALRM, lambda *_: beats.append(round(time.monotonic() - begin, 2)))
def over(*_):
    print(beats[:4], flush=True)
    os._exit(0)
signal.signal(signal.SIGTERM, over)
begin = time.monotonic()
signal.setitimer(signal.ITIMER_REAL, 0.25, 0.25)
while True:
    os.read(fd, 1)
";
    let program = format!("{BEGIN}{program}");
    let files = [("program.py", program.as_str())];
    let ended = run("signals", "python3 program.py", &files, &[]);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    assert!(
        ended.log.contains("[0.25, 0.5, 0.75, 1.0]"),
        "{}",
        ended.log
    );
}

/// Two kinds of busy waiting: queries of the number of bytes with a look at the clock in between,
/// and reads that find nothing. Each takes some thousand stops of the rig for a second, where calls
/// of 1 us would make a million. Bytes are seen when they arrive: a line every 100 ms.
#[test]
fn a_program_that_asks_over_and_over_waits() {
    let program = "\
import fcntl, struct, termios
os.set_blocking(fd, False)
begin = time.time()
got = b''
while time.time() - begin < 1:
    there, = struct.unpack('i', fcntl.ioctl(fd, termios.FIONREAD, bytes(4)))
    if there >= 8:
        got += os.read(fd, there)
begin = time.time()
while time.time() - begin < 1:
    try:
        got += os.read(fd, 100)
    except BlockingIOError:
        pass
print('lines', 16 < got.count(b'mm') < 22, flush=True)
time.sleep(60)
";
    let program = format!("{BEGIN}{program}");
    let files = [("program.py", program.as_str())];
    let ended = run("asks", "exec python3 program.py", &files, &[]);
    assert!(ended.log.contains("lines True"), "{}", ended.log);
    let stops = ended.said.lines().find_map(|line| {
        let (count, _) = line.trim().split_once(" stopped calls")?;
        count.parse().ok()
    });
    let stops: u32 = stops.unwrap_or_else(|| panic!("no count: {}", ended.said));
    assert!(stops < 30_000, "{stops}");
}

/// An unsupported call is named once, however often the program makes it: io_uring is refused, as
/// by an older kernel. An impossible file is left to the kernel.
#[test]
fn a_call_that_is_not_handled_is_named_once() {
    let program = format!(
        "{BEGIN}for _ in range(3): ctypes.CDLL(None).syscall(425, 4, bytes(120))\n\
         ctypes.CDLL(None).read(-1, bytes(8), 1)\n\
         time.sleep(60)\n"
    );
    let program = format!("import ctypes\n{program}");
    let files = [("program.py", program.as_str())];
    let ended = run("unhandled", "exec python3 program.py", &files, &[]);
    let named = ended
        .said
        .matches("leaves virtual time: io_uring is not available");
    assert_eq!(named.count(), 1, "{}", ended.said);
}

/// A killed child is gone before its parent continues, an awaited signal arrives at its time, and
/// the processor's counter is the clock: 2 ms of sleep are 2,000,000 of its steps plus those of the
/// calls. A second run has the same values.
#[test]
fn kills_awaited_signals_and_the_processors_counter_are_in_virtual_time() {
    let source = include_str!("programs/kills.c");
    let Some(program) = compiled("kills", "cc", source, &[]) else {
        return;
    };
    let program = program.display().to_string();
    let ended = run("kills", &program, &[], &["--check"]);
    let (status, detail) = ended.check("deterministic");
    assert_eq!(status, "pass", "{detail}");
    // The alarm is set one call before the first clock reading, and ends the wait one call before
    // the second.
    let first = ended.log.lines().next();
    assert_eq!(first, Some("1 1 -1 1 2000"), "{}", ended.said);
}

/// Process numbers are not virtual: a program that sleeps for its own number differs from its
/// second run.
#[test]
fn a_program_that_is_not_the_same_twice_is_told_where_it_parts() {
    let program = format!(
        "{BEGIN}time.sleep(0.1 + os.getpid() % 1000 / 1e4)\nos.write(fd, b'ping\\r\\n')\ntime.sleep(60)\n"
    );
    let files = [("program.py", program.as_str())];
    let ended = run("parts", "exec python3 program.py", &files, &["--check"]);
    let (status, detail) = ended.check("deterministic");
    assert_eq!(status, "fail", "{}", ended.said);
    assert!(
        detail.contains("at call") && detail.contains("nanosleep"),
        "{detail}"
    );
}

/// A lidar's adapter runs the motor while DTR is low. Opening the port raises it. The client lowers
/// it, requests a scan, and raises it again: nodes arrive only in between. The lines read back as
/// they were set.
#[test]
fn dtr_reaches_the_motor_of_a_lidar() {
    let lidar = "\
schema = 1
name = \"sonar\"
robot = \"custom\"
duration = \"8s\"
device.sonar.rplidar = { profile = \"fw1.29\", motor = \"dtr\" }
[world]
start = { x_m = 1.0, y_m = 1.4, heading_deg = 0 }
[[world.wall]]
path_m = [[0, 0], [2.6, 0], [2.6, 2.2], [0, 2.2], [0, 0]]
";
    let program = "\
import fcntl, struct, termios
def lines():
    return struct.unpack('I', fcntl.ioctl(fd, termios.TIOCMGET, bytes(4)))[0]
def dtr(request):
    fcntl.ioctl(fd, request, struct.pack('I', termios.TIOCM_DTR))
os.set_blocking(fd, False)
def heard(seconds):
    end, count = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        try:
            count += len(os.read(fd, 4096))
        except BlockingIOError:
            time.sleep(0.01)
    return count
print('high', bool(lines() & termios.TIOCM_DTR), bool(lines() & termios.TIOCM_CTS))
os.write(fd, b'\\xa5\\x20')
print('stands', heard(1) < 10)
dtr(termios.TIOCMBIC)
print('low', bool(lines() & termios.TIOCM_DTR))
print('turns', heard(3) > 5000)
dtr(termios.TIOCMBIS)
heard(2)
print('ends', heard(0.5) < 10, flush=True)
time.sleep(60)
";
    let program = format!("{BEGIN}{program}");
    let files = [("program.py", program.as_str()), ("sonar.toml", lidar)];
    let ended = run("dtr", "python3 program.py", &files, &[]);
    let said: Vec<&str> = ended.log.lines().skip(1).collect();
    let wanted = [
        "high True True",
        "stands True",
        "low False",
        "turns True",
        "ends True",
    ];
    assert_eq!(said, wanted, "{}", ended.said);
}

/// A capture of a program is played to it again, and as a case: the same bytes each time. A program
/// that sends nothing is distinguished.
#[test]
fn a_capture_and_a_case_of_it_are_played_in_virtual_time() {
    let program = "exec 3<> \"$HILRIG_PORT_SONAR\"\n\
        while read -r line <&3; do case $line in mm*) printf 'ping\\r\\n' >&3 ;; esac; done\n";
    let files = [("program.sh", program)];
    let ended = run("played", "exec sh program.sh", &files, &[]);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    let again = |words: &[&str], exec: &str| {
        let mut again = Command::new(env!("CARGO_BIN_EXE_hilrig"));
        let again = again.current_dir(folder("played")).args(words);
        let output = again.args(["--exec", exec, "--virtual"]).output();
        let output = output.expect("the binary is built");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        (output.status.code(), said)
    };
    let replay = ["replay", "out/capture.pcapng", "--expect"];
    let (code, said) = again(&replay, "exec sh program.sh");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("no divergence"), "{said}");
    assert_eq!(said, again(&replay, "exec sh program.sh").1);
    let from = ["case", "from", "out/capture.pcapng", "-o", "case.toml"];
    let (code, said) = again(&from, "exec sh program.sh");
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = again(&["run", "case.toml"], "exec sh program.sh");
    assert_eq!(code, Some(0), "{said}");
    let silent = "exec 3<> \"$HILRIG_PORT_SONAR\"; cat <&3 > /dev/null";
    let (code, said) = again(&["run", "case.toml"], silent);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("FAIL talks-sonar"), "{said}");
}
