//! Waits, signals, queues, locks, clocks and random numbers, each in a small C program: the result
//! is that of Linux, and the same in both runs. Exceptions are named.

use crate::guest::{compiled, run};
use crate::support::Ended;

const PROBES: &str = include_str!("programs/probes.c");
/// A character at 9600 baud takes 1.0417 ms, a line comes every 100 ms.
const SONAR: &str = include_str!("programs/sonar.toml");

/// Signals as in signal(7), also in real time.
const SIGNALS: [(&str, &str); 20] = [
    ("rt-raise", "1"),
    ("rt-highest", "1"),
    ("rt-value", "7 1"),
    ("rt-held-while-handled", "2 times, 1 deep"),
    ("rt-nodefer", "2 times, 2 deep"),
    ("rt-altstack", "1 0"),
    ("rt-restart", "1 read, 1"),
    ("rt-interrupts", "-1 Interrupted system call, 1"),
    ("rt-ignored", "goes on"),
    ("rt-waited", "1 5"),
    ("rt-registers", "1 1122334455667788 0"),
    ("rt-longjmp", "3"),
    ("rt-timer", "5 times, 9 1"),
    ("rt-suspend", "-1, 1 after 50 ms, held 1"),
    ("rt-ppoll", "-1 1 1"),
    ("rt-file", "1 8 7"),
    ("cancel", "1 1"),
    ("drops-rights", "0"),
    ("stops", "19, then 5"),
    ("int-0x80", "1"),
];
/// The rest: mq_overview(7), sysvipc(7), pthread_mutexattr_setprotocol(3), vdso(7). Times are
/// rounded to 10 ms. Reading a clock costs 1 us. The calendar begins at 2026-01-01, the uptime at
/// 1000 s.
const REST: [(&str, &str); 46] = [
    ("rt-default", "1"),
    ("mq", "6 3 after 50 ms"),
    ("mq-times-out", "-1 1 after 30 ms"),
    ("mq-full", "0 after 50 ms"),
    ("msg", "8 2 after 50 ms"),
    ("msg-nowait", "-1 1"),
    ("msg-full", "0 after 50 ms"),
    ("msg-removed", "-1 1"),
    ("sem", "0 after 50 ms, flags 0"),
    ("sem-times-out", "-1 1 after 30 ms"),
    ("sem-zero", "0 after 50 ms, then 1"),
    ("sem-undone", "0 after 40 ms"),
    ("pi-thread", "1 0 after 90 ms"),
    ("pi-process", "0 after 40 ms"),
    ("pi-times-out", "1 after 20 ms"),
    ("pi-robust", "1 0 0"),
    ("pi-condition", "after 50 ms"),
    ("event", "1 after 50 ms"),
    ("socket-times-out", "-1 1 after 30 ms"),
    ("timer-file", "3"),
    ("looks", "1000 1000 1000"),
    ("calendar", "1 1"),
    ("processor-time", "0 1 0"),
    ("uptime", "1 1"),
    ("unique", "37 4 0"),
    ("terminal", "1"),
    ("asks", "1 1 1"),
    ("pipe-ends", "1 0, 1 0"),
    ("replaced", "0 1 y"),
    ("epoll", "1 1 1, 0 1"),
    ("reopened", "1 0 1"),
    ("file-of-others", "0 1 1"),
    ("wrong-way", "9 4 1 0"),
    ("scans", "1 1"),
    ("asynchronous", "1 1 0"),
    ("asynchronous-copy", "1 1 0"),
    ("asynchronous-rt", "1 1 1"),
    ("poll-shared", "1 1, 77 0"),
    ("kernel-reads", "1 1"),
    ("timer-copy", "1 1 x, 8 1 after 20 ms"),
    ("timer-exec", "8"),
    ("timer-child", "8 after 50 ms, 8 after 50 ms"),
    ("timer-kinds", "1 1 1 0 1 0"),
    ("entry", "0 1 1"),
    ("errors", "1"),
    ("yields", "1"),
];

const MORE_PROBES: &str = include_str!("programs/more_probes.c");
/// signal(7), pidfd_send_signal(2), termios(3), futex(2), sched_setaffinity(2),
/// timer_getoverrun(2), prctl(2); the processor is always the first one, a child's time 0.
const MORE: [(&str, &str); 13] = [
    ("pidfd-signals", "-1 1 after 50 ms"),
    ("pidfd-kills", "9 after 0 ms"),
    ("orphan-killed", "0 after 50 ms"),
    ("pty-interrupt", "2 after 50 ms"),
    ("pty-size", "-1 1 after 50 ms"),
    ("pty-hangup", "1 after 0 ms"),
    ("mq-tells", "-1 1 after 50 ms"),
    ("futex-op", "2 2 5"),
    ("futex-many", "-1 1"),
    ("processor", "0 0 0, 1 1"),
    ("affinity", "0 1, -1 1"),
    ("timer-overrun", "1 4 4 1, 1 0 after 10 ms"),
    ("child-times", "3 0 0 0"),
];

fn assert_said(ended: &Ended, wanted: &[(&str, &str)]) {
    for (name, answer) in wanted {
        let line = ended
            .log
            .lines()
            .find_map(|line| line.strip_prefix(name)?.strip_prefix(": "));
        let line = line.unwrap_or_else(|| panic!("no {name}:\n{}\n{}", ended.said, ended.log));
        assert!(
            line.starts_with(answer),
            "{name}: {line}, expected {answer}"
        );
    }
}

#[test]
fn probes_are_answered_right_and_the_same_twice() {
    let Some(program) = compiled("probes", "cc", PROBES, &["-pthread", "-lrt"]) else {
        return;
    };
    let rig = SONAR.replace("\"3s\"", "\"20s\"");
    let files = [("sonar.toml", rig.as_str())];
    let program = program.display().to_string();
    let ended = run("probes", &program, &files, &["--check", "--exec-may-end"]);
    assert_said(&ended, &SIGNALS);
    assert_said(&ended, &REST);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    // Only this is left to the kernel.
    let leaves: Vec<&str> = ended
        .said
        .lines()
        .filter_map(|line| line.trim().strip_prefix("leaves virtual time: "))
        .collect();
    assert_eq!(leaves, ["makes calls as a 32-bit program does (int 0x80)"]);
}

#[test]
fn more_probes_are_answered_right_and_the_same_twice() {
    let flags = ["-pthread", "-lrt", "-lutil"];
    let Some(program) = compiled("more-probes", "cc", MORE_PROBES, &flags) else {
        return;
    };
    let rig = SONAR.replace("\"3s\"", "\"10s\"");
    let files = [("sonar.toml", rig.as_str())];
    let more = ["--check", "--exec-may-end", "--exec-may-idle"];
    let ended = run("more-probes", &program.display().to_string(), &files, &more);
    assert_said(&ended, &MORE);
    assert_eq!(ended.check("deterministic").0, "pass", "{}", ended.said);
    let refused = "leaves virtual time: futex_waitv is not available";
    assert!(ended.said.contains(refused), "{}", ended.said);
}

/// With modem lines alone, a program is under supervision in real time, too.
#[test]
fn signals_of_all_numbers_reach_a_program_in_real_time() {
    let Some(program) = compiled("probes-rt", "cc", PROBES, &["-pthread", "-lrt"]) else {
        return;
    };
    let folder = crate::support::folder("probes-realtime");
    let rig = SONAR.replace("\"3s\"", "\"60s\"");
    let command = format!("{} rt cancel drops stops int", program.display());
    let files = [("sonar.toml", rig.as_str())];
    let ended = crate::support::run_in(&folder, &files, &command, &["--exec-may-end"]);
    // Durations depend on the machine.
    let timeless: Vec<(&str, &str)> = SIGNALS
        .iter()
        .filter(|(name, _)| !matches!(*name, "rt-timer" | "rt-suspend"))
        .copied()
        .collect();
    assert_said(&ended, &timeless);
}

/// A wait that the supervisor does not know does not keep virtual time, and is named.
#[test]
fn an_unknown_wait_is_named_and_time_goes_on() {
    let Some(program) = compiled("outside", "cc", PROBES, &["-pthread", "-lrt"]) else {
        return;
    };
    let command = format!("{} outside", program.display());
    let ended = run("outside", &command, &[], &["--exec-may-end"]);
    assert_said(&ended, &[("outside-lock", "has it")]);
    let note = "leaves virtual time: waits in the kernel in fcntl";
    assert!(ended.said.contains(note), "{}", ended.said);
}

const UNTRACED: &str = "\
#define _GNU_SOURCE
#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>
static int child(void *with)
{
    (void)with;
    signal(SIGTERM, SIG_IGN);
    setsid();
    for (;;) pause();
}
int main(void)
{
    char *stack = malloc(1 << 16);
    int pid = clone(child, stack + (1 << 16), CLONE_UNTRACED | SIGCHLD, 0);
    int port = open(getenv(\"HILRIG_PORT_SONAR\"), O_RDWR | O_NOCTTY);
    struct termios raw;
    char byte;
    tcgetattr(port, &raw);
    cfmakeraw(&raw);
    tcsetattr(port, TCSANOW, &raw);
    read(port, &byte, 1);
    printf(\"untraced %d\\n\", pid);
    usleep(10000);
    return 0;
}
";

/// A child that hides from its parent's tracer is nevertheless found, named and ended.
#[test]
fn a_child_cannot_leave_the_supervision() {
    let Some(program) = compiled("untraced", "cc", UNTRACED, &[]) else {
        return;
    };
    let command = program.display().to_string();
    let ended = run("untraced", &command, &[], &["--exec-may-end"]);
    assert_eq!(ended.failed(), ["no-children-left"], "{}", ended.said);
    let pid = ended
        .log
        .lines()
        .find_map(|line| line.strip_prefix("untraced "));
    // Ended: gone, or waiting for the system to collect its exit code.
    let status = format!("/proc/{}/status", pid.expect("it says so"));
    let status = std::fs::read_to_string(status).unwrap_or_default();
    assert!(
        status.is_empty() || status.contains("Z (zombie)"),
        "{status}"
    );
}

#[test]
fn a_program_that_says_something_else_each_time_is_told_apart() {
    let program = "\
import os, time
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
print('I am one')
print('and my number is', os.getpid(), flush=True)
";
    let files = [("program.py", program)];
    let more = ["--check", "--exec-may-end"];
    let ended = run("words", "exec python3 program.py", &files, &more);
    let (status, detail) = ended.check("deterministic");
    assert_eq!(status, "fail", "{detail}");
    let word = "other output of the program: line 2 is \"and my number is ";
    assert!(detail.contains(word), "{detail}");
}

/// Two runs make the same calls, but the fifth byte differs: it counts the runs in a file. The byte
/// arrives 5 characters of 1.0417 ms after the first write.
#[test]
fn a_byte_that_differs_is_named_with_its_place() {
    let program = "\
import os, time
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
os.write(fd, b'abc')
with open('runs', 'ab') as runs:
    runs.write(b'.')
os.write(fd, b'd%c' % os.path.getsize('runs'))
time.sleep(0.1)
";
    let files = [("program.py", program)];
    let more = ["--check", "--exec-may-end"];
    let ended = run("byte", "exec python3 program.py", &files, &more);
    let (status, detail) = ended.check("deterministic");
    assert_eq!(status, "fail", "{detail}");
    let words = "the two runs differ: sonar to-device, byte 4: 0x01 at ";
    let at = detail
        .strip_prefix(words)
        .and_then(|rest| rest.split_once(" s, then 0x02 at "));
    let (at, rest) = at.unwrap_or_else(|| panic!("{detail}"));
    assert!(at.starts_with("0.005"), "{detail}");
    assert_eq!(rest, format!("{at} s; the same calls and answers"));
}
