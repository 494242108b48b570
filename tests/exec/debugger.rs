//! `hilrig debug`: gdb stops a program, virtual time stands still, and the run does not change.

mod languages;
mod left;
mod points;

use core::time::Duration;
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{Shutdown, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};

use hilrig::realtime::clock::{Clock as _, WallClock};

use crate::guest::compiled;
use crate::support::{Ended, ended_in, folder, run_in};
use crate::thorough::{few, is_thorough};

/// "mm=700" each 100 ms at 9600 baud for three seconds.
const SONAR: &str = include_str!("programs/sonar.toml");
/// A program with threads, a signal, children, and code that all of them share.
const DEBUGGED: &str = include_str!("programs/debugged.c");

/// A program that waits for a debugger.
struct Debugged {
    folder: PathBuf,
    /// The process; `None` only after its end.
    child: Option<Child>,
    stderr: BufReader<ChildStderr>,
    /// The output until now.
    said: String,
    port: u16,
}

impl Debugged {
    /// Starts `hilrig debug` in a new folder, until the program waits for a debugger.
    fn start(name: &str, command: &str, files: &[(&str, &str)], more: &[&str]) -> Self {
        let folder = folder(&format!("debug-{name}"));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("a fresh folder");
        for (file, text) in files {
            fs::write(folder.join(file), text).expect("a fresh file");
        }
        let mut child = Command::new(env!("CARGO_BIN_EXE_hilrig"))
            .current_dir(&folder)
            .args([
                "debug",
                "sonar.toml",
                "--exec-needs",
                "sonar",
                "--out",
                "out",
            ])
            .args(["--exec", command, "--port", "0"])
            .args(more)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the binary is built");
        let stderr = BufReader::new(child.stderr.take().expect("a pipe"));
        let mut new = Self {
            folder,
            child: Some(child),
            stderr,
            said: String::new(),
            port: 0,
        };
        new.port = new.hear_port();
        new
    }

    /// Reads the output up to the port on which the program waits.
    fn hear_port(&mut self) -> u16 {
        loop {
            let mut line = String::new();
            let len = self.stderr.read_line(&mut line).expect("text");
            self.said += &line;
            assert!(len > 0, "no port is named: {}", self.said);
            if let Some((_, port)) = line.trim().split_once("localhost:") {
                return port.parse().expect("a number");
            }
        }
    }

    /// The output of gdb for `script`; `None`, with a visible message, if gdb is missing.
    fn gdb(&self, program: Option<&Path>, script: &str) -> Option<String> {
        let begin = format!(
            "set pagination off\nset confirm off\nset debuginfod enabled off\n\
             target remote :{}\n",
            self.port
        );
        let file = self.folder.join("script.gdb");
        fs::write(&file, begin + script).expect("a fresh file");
        // The replies of the rig are written to the error output: in one stream they are in order.
        let log = fs::File::create(self.folder.join("gdb.log")).expect("a fresh file");
        let gdb = Command::new("gdb")
            .args(["-nx", "-batch"])
            .args(program)
            .arg("-x")
            .arg(&file)
            .stdin(Stdio::null())
            .stdout(log.try_clone().expect("a descriptor"))
            .stderr(log)
            .spawn();
        match gdb {
            Ok(gdb) => {
                await_gdb(gdb);
                let said = fs::read(self.folder.join("gdb.log")).expect("it is there");
                Some(String::from_utf8_lossy(&said).into_owned())
            }
            Err(error) => {
                assert!(std::env::var_os("CI").is_none(), "gdb: {error}");
                eprintln!("SKIPPED: {}: no gdb: {error}", self.folder.display());
                None
            }
        }
    }

    /// A client that speaks the bare protocol.
    fn connect(&self) -> TcpStream {
        TcpStream::connect(("localhost", self.port)).expect("it listens")
    }

    fn end(mut self) -> Ended {
        let mut rest = String::new();
        self.stderr.read_to_string(&mut rest).expect("text");
        let child = self.child.take().expect("it ends once");
        let output = child.wait_with_output().expect("it ends");
        let mut ended = ended_in(&self.folder, output);
        ended.said += &self.said;
        ended.said += &rest;
        ended
    }

    /// Interrupts the command, as Ctrl-C does.
    fn interrupt(self) -> Ended {
        let pid = self.child.as_ref().expect("it runs").id().to_string();
        let sent = Command::new("kill").args(["-INT", &pid]).status();
        assert!(sent.expect("kill is everywhere").success());
        self.end()
    }
}

/// Ends debugger and program also after a failed test.
impl Drop for Debugged {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Waits for gdb to end; a gdb that hangs fails the test.
fn await_gdb(mut gdb: Child) {
    /// Maximum number of checks: five minutes.
    const LOOKS: u32 = 6000;
    let clock = WallClock::start();
    for _ in 0..LOOKS {
        if gdb.try_wait().expect("it is ours").is_some() {
            return;
        }
        clock.sleep_until(clock.now() + Duration::from_millis(50));
    }
    let _ = gdb.kill();
    let _ = gdb.wait();
    panic!("gdb does not end");
}

/// The trace of the same program without a debugger.
fn undisturbed(name: &str, command: &str, files: &[(&str, &str)]) -> String {
    undisturbed_by(name, command, files, &[])
}

/// The trace of the same program with these options, without a debugger.
fn undisturbed_by(name: &str, command: &str, files: &[(&str, &str)], more: &[&str]) -> String {
    let folder = folder(&format!("undisturbed-{name}"));
    let ended = run_in(&folder, files, command, &[&["--virtual"], more].concat());
    ended.trace()
}

fn count(text: &str, word: &str) -> usize {
    text.matches(word).count()
}

/// More than fifty stops: breakpoints in code that two threads and two children run, a watchpoint,
/// a signal, conditions that gdb judges. Symbols are found in a position-independent program and in
/// a static one.
const MANY_STOPS: &str = "\
break count
commands
silent
printf \"count of %d\\n\", who
continue
end
watch millimetres
commands
silent
printf \"watched %d\\n\", millimetres
continue
end
break on_signal
commands
silent
printf \"handler of %d\\n\", number
continue
end
handle SIGUSR1 stop print pass
break beat if number == 9
continue
bt 1
continue
info threads
stepi
next
detach
";

#[test]
fn a_run_with_fifty_stops_has_the_bytes_of_a_run_without() {
    let pie = &["-g", "-O0", "-pthread"][..];
    let runs = [
        ("pie", pie, &[][..]),
        // A stop draws no random number.
        ("pie-3", pie, &["--schedule", "3"]),
        ("static", &["-g", "-O0", "-pthread", "-static"], &[]),
        ("pie-4", pie, &["--schedule", "4"]),
    ];
    for (name, flags, more) in few(2, runs) {
        let Some(program) = compiled(&format!("debugged-{name}"), "cc", DEBUGGED, flags) else {
            return;
        };
        let command = program.to_str().expect("a plain path");
        let files = [("sonar.toml", SONAR)];
        let expected = undisturbed_by(name, command, &files, more);
        let debugged = Debugged::start(name, command, &files, more);
        let Some(said) = debugged.gdb(Some(&program), MANY_STOPS) else {
            debugged.interrupt();
            return;
        };
        let ended = debugged.end();
        assert_eq!(ended.trace(), expected, "{name}\n{said}");
        assert_eq!(ended.code, Some(0), "{}", ended.said);
        // By hand: beat 9 comes after 2 s, with a line of the sonar each 100 ms and a count of the
        // worker each 70 ms before it.
        let (worker, main) = (count(&said, "count of 1"), count(&said, "count of 2"));
        assert!(worker >= 25 && main >= 18, "{name}\n{said}");
        if more.is_empty() {
            assert_eq!(count(&said, "watched "), main, "{name}\n{said}");
        }
        assert!(count(&said, "handler of 10") == 1, "{name}\n{said}");
        assert!(said.contains("received signal SIGUSR1"), "{name}\n{said}");
        assert!(said.contains("beat (port=3, number=9)"), "{name}\n{said}");
        let waits = said.contains("waits in clock_nanosleep");
        assert!(waits || !more.is_empty(), "{name}\n{said}");
        // The child does not stop at its count, and the child's work is complete.
        assert!(!said.contains("count of 3"), "{name}\n{said}");
    }
}

/// A typical session: inspect, step, change a variable, query the rig, kill.
const SESSION: &str = "\
break understand
continue
bt
print line
next
next
step
step
info registers rip
finish
up
monitor wires sonar 2
monitor until 0.5s
delete
continue
monitor time
set var scale = 100
hbreak beat
continue
print number
print scale
x/i $pc
monitor state
monitor verdict
monitor until visited
monitor until 0.1s
monitor wires nowhere
monitor fault add kind=cut
monitor dance
monitor help
kill
";

#[test]
fn a_session_looks_steps_changes_and_asks_the_rig() {
    let Some(program) = compiled(
        "debugged-session",
        "cc",
        DEBUGGED,
        &["-g", "-O0", "-pthread"],
    ) else {
        return;
    };
    let command = program.to_str().expect("a plain path");
    let debugged = Debugged::start("session", command, &[("sonar.toml", SONAR)], &[]);
    let Some(said) = debugged.gdb(Some(&program), SESSION) else {
        debugged.interrupt();
        return;
    };
    for expected in [
        "understand (line=",
        "mm=700",
        "in main () at",
        "count (who=2)",
        "to-master  0a",
        "the next continue stops at 0.500000 s",
        "[hilrig] 0.5",
        "rig 0.5",
        "beat (port=3",
        "$3 = 100",
        "pose 0.000 m",
        "bytes-conserved",
        // The checks of the program are among the verdicts.
        "program-alive",
        "program-goes-on",
        "error: until visited: expected a time such as 12.3s",
        "error: until 0.1s: the rig is at 0.",
        "error: wires nowhere: expected a link of sonar",
        "error: fault add",
        "error: dance: unknown; expected time, until",
        "monitor verdict",
    ] {
        assert!(said.contains(expected), "{expected}\n{said}");
    }
    let ended = debugged.end();
    // The exit code is that of a run ended by SIGTERM.
    assert_eq!(ended.code, Some(143), "{}", ended.said);
    assert_eq!(ended.failed(), ["ran-to-its-end"], "{}", ended.said);
}

/// A thread reads, another one writes; the interpreter's own threads and locks are at work.
const PYTHON: &str = "\
import os, threading, time
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
got = 0
def reader():
    global got
    while True:
        got += len(os.read(fd, 100))
threading.Thread(target=reader, daemon=True).start()
while True:
    time.sleep(0.1)
    os.write(fd, b'ping\\r\\n')
    print(got, flush=True)
";

#[test]
fn breakpoints_in_an_interpreter_with_threads_change_no_byte() {
    let files = [("sonar.toml", SONAR), ("program.py", PYTHON)];
    let expected = undisturbed("python", "python3 program.py", &files);
    let debugged = Debugged::start("python", "python3 program.py", &files, &["--at", "1s"]);
    let script = "break write\ncommands\nsilent\necho stop\\n\ncontinue\nend\ncontinue\ncontinue\n";
    let Some(said) = debugged.gdb(None, script) else {
        debugged.interrupt();
        return;
    };
    let ended = debugged.end();
    assert_eq!(ended.trace(), expected, "{said}");
    // From 1 s to the end, once each 100 ms.
    assert!(count(&said, "stop\n") >= 18, "{said}");
    assert!(
        said.contains("the run is over; continue ends the program"),
        "{said}"
    );
    assert_eq!(ended.code, Some(0), "{}", ended.said);
}

/// Any bytes may arrive at the port: none of them advances time or ends the run.
#[test]
fn clients_that_misbehave_leave_the_program_standing() {
    let files = [("sonar.toml", SONAR), ("program.py", PYTHON)];
    let mut debugged = Debugged::start("hostile", "python3 program.py", &files, &[]);
    for words in [
        &b"GET / HTTP/1.1\r\n\r\n"[..],
        b"$m0,ffffffff#zz",
        b"$\x00\xff#00",
        b"$vCont;c",
    ] {
        let mut client = debugged.connect();
        client.write_all(words).expect("it reads");
        client.shutdown(Shutdown::Write).expect("it is open");
        let mut answer = Vec::new();
        let _ = client.read_to_end(&mut answer);
        debugged.port = debugged.hear_port();
    }
    // A second client is rejected, and the first client is still served.
    let mut first = debugged.connect();
    first.write_all(b"+$?#3f").expect("it reads");
    let mut answer = [0; 4];
    first.read_exact(&mut answer).expect("it answers");
    assert_eq!(&answer, b"+$T0");
    let mut second = debugged.connect();
    let mut rest = Vec::new();
    assert!(
        second.read_to_end(&mut rest).is_err() || rest.is_empty(),
        "{rest:?}"
    );
    // The client continues the program and disconnects while the program runs.
    first.write_all(b"+$vCont;c#a8").expect("it reads");
    drop(first);
    debugged.port = debugged.hear_port();
    // Another client disconnects correctly: the run continues to its end and is judged.
    debugged.connect().write_all(b"$D#44").expect("it reads");
    let expected = undisturbed("hostile", "python3 program.py", &files);
    let ended = debugged.end();
    assert_eq!(ended.trace(), expected, "{}", ended.said);
    assert_eq!(count(&ended.said, "the debugger is gone; time stands"), 5);
}

/// Ctrl-C of gdb stops a program that computes without end. This is no error in a debugged program.
#[test]
fn an_interrupt_stops_a_thread_that_computes() {
    let source = "#include <fcntl.h>\n#include <stdlib.h>\n#include <unistd.h>\n\
                  int main(void) { char byte; volatile long n = 0;\n\
                  int port = open(getenv(\"HILRIG_PORT_SONAR\"), O_RDWR | O_NOCTTY);\n\
                  if (read(port, &byte, 1) != 1) return 3;\n\
                  for (;;) n = n + 1; }\n";
    let Some(program) = compiled("debugged-spin", "cc", source, &["-g", "-O0"]) else {
        return;
    };
    let command = program.to_str().expect("a plain path");
    let more = ["--spin-max", "1h", "--schedule", "3", "--call-cost", "2us"];
    let debugged = Debugged::start("spin", command, &[("sonar.toml", SONAR)], &more);
    let mut client = debugged.connect();
    client.write_all(b"+$vCont;c#a8").expect("it reads");
    let mut answer = [0; 1];
    client.read_exact(&mut answer).expect("it takes the order");
    client.write_all(b"\x03").expect("it reads");
    let mut answer = [0; 4];
    client.read_exact(&mut answer).expect("it answers");
    assert_eq!(&answer, b"$T02");
    client.write_all(b"+$k#6b").expect("it reads");
    assert_eq!(debugged.end().code, Some(143));
}

/// No program to debug, no free port, no command: each gets one sentence with the fix.
#[test]
fn what_cannot_be_debugged_is_said() {
    let taken = std::net::TcpListener::bind(("localhost", 0)).expect("a free port");
    let port = taken.local_addr().expect("bound").port().to_string();
    let folder = folder("debug-refused");
    fs::create_dir_all(&folder).expect("a fresh folder");
    fs::write(folder.join("sonar.toml"), SONAR).expect("a fresh file");
    for (args, code, expected) in [
        (
            &["--exec", "true", "--port", &port][..],
            2,
            "expected a free port of this machine",
        ),
        (
            &["--exec", ":", "--port", "0"],
            2,
            "no program was started that could be debugged; the command started ",
        ),
        (
            &["--exec", "sleep 4", "--port", "0", "--program", "sleeep"],
            2,
            "sleep: expected the name of one of these",
        ),
        (
            &["--exec", "sleep 1", "--port", "0", "--at", "1min"],
            2,
            "expected an earlier --at",
        ),
        (&["--port", "0"], 2, "--exec: is missing"),
        // The options of the program work without --virtual.
        (
            &["--schedule", "3", "--call-cost", "2us", "--spin-max", "5s"],
            2,
            "--exec: is missing",
        ),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_hilrig"))
            .current_dir(&folder)
            .args(["debug", "sonar.toml", "--out", "out"])
            .args(args)
            .output()
            .expect("the binary is built");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(said.contains(expected), "{args:?}: {said}");
        assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
    }
}

/// A fault stops the program before the signal is delivered; afterwards the run is judged as usual.
#[test]
fn a_crash_is_seen_where_it_happens() {
    let source = "#include <unistd.h>\nstatic void fall(int *place) { *place = 1; }\n\
                  int main(void) { sleep(1); fall((int *)8); return 0; }\n";
    let Some(program) = compiled("debugged-crash", "cc", source, &["-g", "-O0"]) else {
        return;
    };
    let command = program.to_str().expect("a plain path");
    let mut debugged = Debugged::start("crash", command, &[("sonar.toml", SONAR)], &[]);
    // A debugger that dies at its breakpoint leaves no breakpoint to the next debugger.
    let dies = "break fall\ncontinue\nshell kill -9 $PPID\n";
    if debugged.gdb(Some(&program), dies).is_none() {
        debugged.interrupt();
        return;
    }
    debugged.port = debugged.hear_port();
    let script = "continue\nbt\nprint place\ncontinue\n";
    let Some(said) = debugged.gdb(Some(&program), script) else {
        debugged.interrupt();
        return;
    };
    for expected in [
        "received signal SIGSEGV, Segmentation fault.\n",
        "fall (place=0x8)",
        "terminated with signal SIGSEGV",
    ] {
        assert!(said.contains(expected), "{expected}\n{said}");
    }
    let ended = debugged.end();
    assert_eq!(ended.code, Some(1), "{}", ended.said);
    assert!(ended.failed().contains(&"program-alive"), "{}", ended.said);
}

/// A session backwards sees the same states as the session forwards, in reverse order: the rig's
/// time, the number of the position, variables, registers. Afterwards the run is the same.
const FORTH_AND_BACK: &str = "\
break understand
commands
silent
printf \"seen %d %d %d %lx %lx\\n\", millimetres, counted[1], counted[2], $rsp, $rax
monitor time
end
FORTH
stepi
printf \"at %lx %lx\\n\", $pc, $rsp
stepi
printf \"at %lx %lx\\n\", $pc, $rsp
reverse-stepi
printf \"at %lx %lx\\n\", $pc, $rsp
BACK
delete
handle SIGUSR1 nostop noprint pass
watch millimetres
continue
print millimetres
bt 1
reverse-continue
print millimetres
continue
print millimetres
delete
monitor until 800ms
continue
break understand if millimetres < 0
reverse-continue
delete
monitor until 1s
continue
monitor back 300ms
reverse-continue
monitor time
detach
";

#[test]
fn the_way_back_is_the_way_forth() {
    let Some(program) = compiled("debugged-back", "cc", DEBUGGED, &["-g", "-O0", "-pthread"])
    else {
        return;
    };
    let command = program.to_str().expect("a plain path");
    let files = [("sonar.toml", SONAR)];
    let expected = undisturbed("back", command, &files);
    let debugged = Debugged::start("back", command, &files, &[]);
    let stops = if is_thorough() { 5 } else { 3 };
    let script = FORTH_AND_BACK
        .replace("FORTH\n", &"continue\n".repeat(stops))
        .replace("BACK\n", &"reverse-continue\n".repeat(stops));
    let Some(said) = debugged.gdb(Some(&program), &script) else {
        debugged.interrupt();
        return;
    };
    let ended = debugged.end();
    assert_eq!(ended.trace(), expected, "{said}");
    // The lines alternate: one of the program, one of the rig.
    let lines: Vec<&str> = said.lines().collect();
    let seen: Vec<[&str; 2]> = lines
        .windows(2)
        .filter(|pair| pair[0].starts_with("seen "))
        .map(|pair| [pair[0], pair[1]])
        .collect();
    let (forth, back) = seen.split_at(stops.min(seen.len()));
    let mut reversed = forth.to_vec();
    reversed.reverse();
    assert_eq!(back, &reversed[..], "{said}");
    assert!(forth[stops - 1][1].starts_with("rig 0."), "{said}");
    let at: Vec<&str> = lines
        .iter()
        .copied()
        .filter(|it| it.starts_with("at "))
        .collect();
    assert!(at.len() == 3 && at[0] == at[2] && at[0] != at[1], "{said}");
    // The watched variable changes forwards, backwards, and forwards again.
    let values: Vec<&str> = lines
        .iter()
        .copied()
        .filter(|it| it.starts_with('$'))
        .collect();
    let value = |index: usize| values[index].split_once(" = ").map(|(_, value)| value);
    assert_eq!(value(0), value(2), "{said}");
    assert_ne!(value(0), value(1), "{said}");
    assert!(
        said.contains("the next reverse-continue goes back to 0.7"),
        "{said}"
    );
    // Each false condition of a breakpoint is one step back.
    assert!(said.contains("[hilrig] 5 steps back, now at"), "{said}");
    assert!(
        lines.iter().any(|line| line.starts_with("rig 0.7")),
        "{said}"
    );
}

/// The second run stops before the bytes that break a check, or at the end of a program that ends.
#[test]
fn on_fail_stops_in_the_function_with_the_defect() {
    let sound = DEBUGGED;
    let wrong = "    if (write(port, text, (size_t)len) != len) exit(3);";
    let talks = DEBUGGED.replace(
        wrong,
        "    if (number == 6) nonsense(port);\n    (void)port;",
    );
    let talks = talks.replace(
        "static void beat(",
        "static void nonsense(int port) {\n    if (write(port, \"nonsense\\r\\n\", 10) != 10) exit(3);\n}\n\
         static void beat(",
    );
    let ends = DEBUGGED.replace(
        wrong,
        "    if (number == 6) exit(9);\n    if (write(port, text, (size_t)len) != len) exit(3);",
    );
    let crashes = DEBUGGED.replace(wrong, "    if (number == 6) *(volatile int *)8 = 1;");
    assert!(talks != sound && ends != sound && crashes != sound);
    let strict = SONAR.to_owned() + "\n[expect]\nviolations_max = 0\n";
    let of_c = |name: &str, source: &str| {
        let flags = ["-g", "-O0", "-pthread"];
        compiled(&format!("debugged-{name}"), "cc", source, &flags)
    };
    let in_beat = "beat (port=3, number=6)";
    let runs = [
        (
            "crashes",
            of_c("crashes", &crashes),
            SONAR,
            ["program-alive fails at", in_beat],
        ),
        (
            "talks",
            of_c("talks", &talks),
            &*strict,
            ["violations fails at", "nonsense (port=3)"],
        ),
        (
            "ends",
            of_c("ends", &ends),
            SONAR,
            ["program-alive fails at", in_beat],
        ),
        // Each throws or panics when it steers for the sixth time.
        (
            "throws",
            languages::program("c++"),
            SONAR,
            ["program-alive fails at", "Rover::steer (this="],
        ),
        (
            "panics",
            languages::program("rustc"),
            SONAR,
            ["program-alive fails at", "program::steer"],
        ),
    ];
    for (name, program, scenario, expected) in few(3, runs) {
        let Some(program) = program else { continue };
        let sixth = match name {
            "throws" | "panics" => " 6",
            _ => "",
        };
        let command = &format!("{}{sixth}", program.display());
        let debugged = Debugged::start(name, command, &[("sonar.toml", scenario)], &["--on-fail"]);
        let Some(said) = debugged.gdb(Some(&program), "bt\nkill\n") else {
            debugged.interrupt();
            return;
        };
        let said = said + &debugged.end().said;
        for expected in expected {
            assert!(said.contains(expected), "{name}: {expected}\n{said}");
        }
    }
}
