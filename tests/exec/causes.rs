//! Programs that hang, sleep, never open, never read, print and exit, or send wrong bytes: none
//! passes, and the line "probable cause" names the defect of each. Correct programs beside them
//! pass.
//!
//! All run in virtual time, where nothing depends on the machine; eleven also run in real time, six
//! of them at a landing.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::thread;

use crate::support::{Ended, ended_in};
use crate::thorough::{every, few};

/// A slave that answers requests, beside a sonar that sends unsolicited lines.
const BENCH: &str = r#"
schema = 1
name = "bench"
robot = "none"
duration = "6s"

[device.grip.registers]
baud = 115200
register = [
    { address = 0, name = "number", width = "u32", initial = 286461187 },
    { address = 8, name = "wanted", width = "u8", access = "write" },
]

[device.sonar.text]
baud = 9600
periodic = { line = "mm=700", period = "100ms" }
command = [{ request = "ping", reply = "pong" }]
"#;

/// Frames of the slave: AB, register, count with bit 7 for a write, data, byte sum low byte first.
const BEGIN: &str = "\
import fcntl, os, select, sys, termios, time, tty
def opened(name, baud=termios.B115200, change=None):
    fd = os.open(os.environ['HILRIG_PORT_' + name], os.O_RDWR | os.O_NOCTTY)
    tty.setraw(fd)
    mode = termios.tcgetattr(fd)
    mode[4] = mode[5] = baud
    if change:
        change(mode)
    termios.tcsetattr(fd, termios.TCSANOW, mode)
    return fd
def frame(head):
    return head + (sum(head) & 0xFFFF).to_bytes(2, 'little')
ASK = frame(bytes([0xAB, 0, 4]))
def reply(fd, seconds=0.2):
    got = b''
    while len(got) < 9 and select.select([fd], [], [], seconds)[0]:
        got += os.read(fd, 9 - len(got))
    return got
def asks(fd, times=None):
    for _ in range(times or 1000):
        os.write(fd, ASK)
        # Of so many each is answered, if late: what follows is to find nothing unread.
        reply(fd, 30 if times else 0.2)
        time.sleep(0.1)
";

/// A program, the port that it needs, and the required words of the line.
type Case = (&'static str, &'static str, &'static str, &'static str);

const CASES: [Case; 28] = [
    (
        "never-opens",
        "grip",
        "time.sleep(600)\n",
        "never opened grip: it sleeps",
    ),
    (
        "prints-and-exits",
        "grip",
        "print('done')\n",
        "never opened grip: it ended with exit code 0",
    ),
    (
        "opens-and-exits",
        "grip",
        "fd = opened('GRIP')\nprint('done')\n",
        "exit code 0",
    ),
    (
        "never-reads",
        "sonar",
        "fd = opened('SONAR', termios.B9600)\ntime.sleep(600)\n",
        "port sonar was opened, and none of the ",
    ),
    (
        "opens-and-sleeps",
        "grip",
        "fd = opened('GRIP')\ntime.sleep(600)\n",
        "sent nothing",
    ),
    (
        "asks-and-sleeps",
        "grip",
        "fd = opened('GRIP')\nasks(fd, 3)\ntime.sleep(600)\n",
        "it sleeps",
    ),
    (
        "blocks-in-a-read",
        "grip",
        "fd = opened('GRIP')\nasks(fd, 3)\nos.read(fd, 1)\n",
        "blocked in a read of port grip without a timeout",
    ),
    (
        "blocks-in-select",
        "grip",
        "fd = opened('GRIP')\nasks(fd, 3)\nselect.select([fd], [], [])\n",
        "blocked in a poll or select without a timeout",
    ),
    (
        "is-held-up-in-a-read",
        "grip",
        "sonar = opened('SONAR', termios.B9600)\nfd = opened('GRIP')\nasks(fd, 3)\nos.read(fd, 1)\n",
        "blocked in a read of port grip without a timeout",
    ),
    (
        "is-held-up-in-select",
        "grip",
        "sonar = opened('SONAR', termios.B9600)\nfd = opened('GRIP')\nos.read(sonar, 99)\nasks(fd, 3)\n\
         select.select([fd], [], [])\n",
        "blocked in a poll or select of port grip without a timeout",
    ),
    (
        "waits-to-be-asked",
        "grip",
        "fd = opened('GRIP')\nwhile True:\n    os.write(fd, os.read(fd, 1))\n",
        "here the program is the master and must send the first request",
    ),
    (
        "waits-for-a-line",
        "grip",
        "fd = opened('GRIP')\nasks(fd, 3)\nfcntl.ioctl(fd, 0x545C, 0x20)\n",
        "waits for a modem line of port grip",
    ),
    (
        "wrong-rate",
        "grip",
        "asks(opened('GRIP', termios.B9600))\n",
        "the client of port grip is at 9600 baud",
    ),
    (
        "ends-at-a-wrong-rate",
        "grip",
        "asks(opened('GRIP', termios.B9600), 3)\n",
        "the client of port grip is at 9600 baud",
    ),
    (
        "canonical",
        "grip",
        "def cooked(mode):\n    mode[3] |= termios.ICANON\n\
         fd = opened('GRIP', change=cooked)\nos.write(fd, ASK)\nos.read(fd, 9)\n",
        "ICANON",
    ),
    (
        "swapped-sum",
        "grip",
        "fd = opened('GRIP')\nwhile True:\n    os.write(fd, ASK[:3] + ASK[:2:-1])\n    \
         reply(fd)\n    time.sleep(0.1)\n",
        "bad-checksum",
    ),
    (
        "other-frames",
        "grip",
        "fd = opened('GRIP')\nwhile True:\n    os.write(fd, b'READ 0\\n')\n    reply(fd)\n    \
         time.sleep(0.1)\n",
        "stray-bytes",
    ),
    (
        "other-words",
        "sonar",
        "fd = opened('SONAR', termios.B9600)\nfor _ in range(9):\n    os.write(fd, b'PING\\r\\n')\n    \
         os.read(fd, 99)\n    time.sleep(0.1)\nsys.exit(3)\n",
        "unknown-request",
    ),
    (
        "crashes",
        "grip",
        "fd = opened('GRIP')\nasks(fd, 3)\nos.kill(os.getpid(), 11)\n",
        "killed by SIGSEGV",
    ),
    (
        "deadlocks",
        "grip",
        "import threading\nfd = opened('GRIP')\nasks(fd, 3)\nlock = threading.Lock()\n\
         lock.acquire()\nlock.acquire()\n",
        "it waits for a lock or another thread",
    ),
    (
        "loses-its-reader",
        "sonar",
        "import threading\nfd = opened('SONAR', termios.B9600)\ndef reads():\n    \
         print(os.read(fd, 99), flush=True)\n    raise ValueError('no distance')\n\
         threading.Thread(target=reads).start()\ntime.sleep(600)\n",
        "its last words: ValueError: no distance",
    ),
    (
        "waits-for-a-pipe",
        "grip",
        "fd = opened('GRIP')\nasks(fd, 3)\nos.read(os.pipe()[0], 1)\n",
        "it waits in a read of a pipe",
    ),
    (
        "waits-for-a-socket",
        "grip",
        "import socket\nfd = opened('GRIP')\nasks(fd, 3)\nserver = socket.socket()\n\
         server.bind(('127.0.0.1', 0))\nserver.listen()\nserver.accept()\n",
        "it waits for a socket",
    ),
    (
        "opens-another-path",
        "grip",
        "os.open('/dev/ttyNone', os.O_RDWR)\n",
        "its last words: FileNotFoundError",
    ),
    (
        "says-nothing",
        "sonar",
        "fd = opened('SONAR', termios.B9600)\nwhile True:\n    os.read(fd, 99)\n",
        "nothing was observed of the program",
    ),
    (
        "closes-and-sleeps",
        "grip",
        "fd = opened('GRIP')\nasks(fd, 3)\nos.close(fd)\ntime.sleep(600)\n",
        "the program fell silent",
    ),
    (
        "waits-for-a-greeting",
        "grip",
        "fd = opened('GRIP')\nos.read(fd, 1)\n",
        "blocked in a read of port grip without a timeout",
    ),
    (
        "seven-bits",
        "grip",
        "def short(mode):\n    mode[2] = mode[2] & ~termios.CSIZE | termios.CS7\n\
         asks(opened('GRIP', change=short))\n",
        "fewer than 8 bits",
    ),
];

/// Programs that also run in real time. Programs whose result depends on the load of the machine
/// are excluded.
const REAL: [&str; 11] = [
    "prints-and-exits",
    "opens-and-exits",
    "opens-and-sleeps",
    "asks-and-sleeps",
    "blocks-in-a-read",
    "blocks-in-select",
    "wrong-rate",
    "canonical",
    "deadlocks",
    "says-nothing",
    "opens-another-path",
];

/// Correct programs in several styles.
const HONEST: [(&str, &str, &str, &[&str]); 4] = [
    ("asks", "grip", "asks(opened('GRIP'))\n", &[]),
    (
        "listens",
        "sonar",
        "fd = opened('SONAR', termios.B9600)\nwhile True:\n    print(os.read(fd, 99), flush=True)\n",
        &[],
    ),
    (
        "ends-early",
        "grip",
        "fd = opened('GRIP')\nasks(fd, 3)\n",
        &["--exec-may-end"],
    ),
    (
        "rests-when-done",
        "grip",
        "fd = opened('GRIP')\nasks(fd, 3)\ntime.sleep(600)\n",
        &["--exec-may-idle"],
    ),
];

fn run(name: &str, port: &str, python: &str, more: &[&str]) -> Ended {
    run_in(BENCH, name, port, python, more)
}

fn run_in(bench: &str, name: &str, port: &str, python: &str, more: &[&str]) -> Ended {
    let folder = format!("exec-causes-{name}-{}", std::process::id());
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(folder);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a fresh folder");
    // In real time on a busy machine a program is slow, and counts as silent only after two
    // seconds.
    let duration = if more.contains(&"--virtual") {
        "6s"
    } else {
        "12s"
    };
    let bench = bench.replace("\"6s\"", &format!("\"{duration}\""));
    fs::write(folder.join("bench.toml"), bench).expect("a fresh file");
    fs::write(folder.join("program.py"), format!("{BEGIN}{python}")).expect("a fresh file");
    let output = Command::new(env!("CARGO_BIN_EXE_hilrig"))
        .current_dir(&folder)
        .args(["run", "bench.toml", "--out", "out", "--exec-needs", port])
        .args(["--exec", "python3 program.py"])
        .args(more)
        .stdin(Stdio::null())
        .output();
    ended_in(&folder, output.expect("the binary is built"))
}

/// A board divides 16 MHz and meets 115200 baud by 2.1 %: a UART reads all of it.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_rate_that_a_uart_tolerates_is_no_fault() {
    let bench = BENCH.replace("baud = 115200", "baud = 117647");
    let ended = run_in(
        &bench,
        "near-rate",
        "grip",
        "asks(opened('GRIP'))\n",
        &["--virtual"],
    );
    assert_eq!(ended.code, Some(0), "{}", ended.said);
}

/// A cut wire lets the watchdog of a device fire; the program goes on and gives up later. Without
/// the cut, a pause of the program is the cause.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_watchdog_that_a_fault_let_fire_is_not_the_cause() {
    let bench = BENCH
        .replace("baud = 115200", "baud = 115200\nwatchdog = \"300ms\"")
        .replace("access = \"write\"", "access = \"write\", safe = 0");
    let cut = "[[fault]]\nlink = \"grip\"\ndirection = \"to-device\"\nkind = \"cut\"\n\
               from = \"1s\"\nuntil = \"1500ms\"\n";
    let program = |pause: &str| {
        format!(
            "fd = opened('GRIP')\ntime.sleep(0.1)\nfor turn in range(60):\n    \
             os.write(fd, frame(bytes([0xAB, 8, 0x81, 5])))\n    time.sleep(0.01)\n    os.write(fd, ASK)\n    \
             reply(fd)\n    time.sleep({pause})\nraise SystemExit(3)\n"
        )
    };
    for (name, bench, pause, words) in [
        ("cut", format!("{bench}\n{cut}"), "0.05", "exit code 3"),
        (
            "pause",
            bench.clone(),
            "1 if turn == 9 else 0.05",
            "the watchdog of grip fired once",
        ),
    ] {
        let name = format!("watchdog-{name}");
        let ended = run_in(&bench, &name, "grip", &program(pause), &["--virtual"]);
        assert_eq!(flaw(&ended, &name, words), None);
    }
}

/// The error of a verdict on a program that must not pass; its cause must contain `words`.
fn flaw(ended: &Ended, name: &str, words: &str) -> Option<String> {
    if ended.code == Some(0) {
        return Some(format!("{name} passed\n{}", ended.said));
    }
    let mut lines = ended.said.lines().map(str::trim);
    let cause = lines.find_map(|line| line.strip_prefix("probable cause: "));
    let is_named = cause.is_some_and(|cause| cause.contains(words));
    (!is_named).then(|| format!("{name}: {cause:?} lacks {words:?}\n{}", ended.said))
}

fn assert_flawless(flaws: &[String]) {
    assert!(flaws.is_empty(), "{}", flaws.join("\n"));
}

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn who_hangs_sleeps_or_speaks_wrongly_never_passes_and_the_cause_is_named() {
    let judge = |(name, port, python, words): Case| {
        let may_end = ["--virtual", "--exec-may-end"];
        let more = match name {
            "opens-and-exits" | "prints-and-exits" | "ends-at-a-wrong-rate" => &may_end[..],
            _ => &may_end[..1],
        };
        let more = [more, &["--exec-wait", "2s"]].concat();
        flaw(&run(name, port, python, &more), name, words)
    };
    let cases: Vec<Case> = every(3, 0, CASES).collect();
    for cases in cases.chunks(4) {
        assert_flawless(&side_by_side(cases, &judge));
    }
}

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn who_works_listens_or_ends_with_its_work_done_passes() {
    for (name, port, python, more) in HONEST {
        let more = [&["--virtual"], more].concat();
        let ended = run(&format!("honest-{name}"), port, python, &more);
        assert_eq!(ended.failed(), Vec::<&str>::new(), "{name}\n{}", ended.said);
        assert!(
            !ended.said.contains("probable cause"),
            "{name}\n{}",
            ended.said
        );
        assert_eq!(ended.code, Some(0), "{name}\n{}", ended.said);
    }
}

/// A sonar sends lines without requests, and its reply to one `ping` is lost. A program that reads
/// on for ever in place of asking again does not pass.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_wait_for_a_lost_reply_is_found_beside_unsolicited_lines() {
    let bench = format!(
        "{BENCH}\n[[fault]]\nlink = \"sonar\"\ndirection = \"to-master\"\nkind = \"drop\"\nrate = 1.0\n\
         from = \"2s\"\nuntil = \"2.4s\"\n"
    );
    let asks = |times: u32, timeout: &str| {
        format!(
            "fd = opened('SONAR', termios.B9600)\n\
             for _ in range({times}):\n    os.write(fd, b'ping\\r\\n')\n    got = b''\n    \
             end = time.monotonic() + {timeout}\n    \
             while b'pong' not in got and time.monotonic() < end:\n        \
             if select.select([fd], [], [], 0.1)[0]:\n            got += os.read(fd, 99)\n    \
             time.sleep(0.1)\n\
             while True:\n    print(os.read(fd, 99), flush=True)\n"
        )
    };
    let judged = |name: &str, python: &str| run_in(&bench, name, "sonar", python, &["--virtual"]);
    let hangs = judged("asks-once", &asks(1000, "1e9"));
    let words = "does not ask again: it sent on sonar last at";
    assert_eq!(flaw(&hangs, "asks-once", words), None);
    assert!(hangs.said.contains("drop on sonar (byte"), "{}", hangs.said);
    for (name, times, timeout) in [("asks-again", 1000, "0.5"), ("only-listens", 3, "0.5")] {
        let sound = judged(name, &asks(times, timeout));
        assert_eq!(sound.code, Some(0), "{name}\n{}", sound.said);
    }
}

/// The lines of a sonar end at 2 s. A program that polls the slave and waits for ever for the next
/// line leaves the slave alone; one that only listens to the sonar may wait.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_wait_for_one_device_does_not_excuse_the_other() {
    let cut = "kind = \"cut\"\nfrom = \"2s\"\n";
    let bench = format!("{BENCH}\n[[fault]]\nlink = \"sonar\"\ndirection = \"to-master\"\n{cut}");
    let program = |polls: &str, wait: &str| {
        format!(
            "sonar = opened('SONAR', termios.B9600)\n{polls}while True:\n    \
             if select.select([sonar], [], [], {wait})[0]:\n        \
             print(os.read(sonar, 99), flush=True)\n"
        ) + if polls.is_empty() {
            ""
        } else {
            "    os.write(grip, ASK)\n    reply(grip)\n"
        }
    };
    let grip = "grip = opened('GRIP')\n";
    for (name, port, polls, wait, passes) in [
        ("polls-and-waits", "grip,sonar", grip, "None", false),
        ("polls-on", "grip,sonar", grip, "0.2", true),
        ("only-listens-on", "sonar", "", "None", true),
    ] {
        let ended = run_in(&bench, name, port, &program(polls, wait), &["--virtual"]);
        let (status, _) = ended.check("program-goes-on");
        assert_eq!(status == "pass", passes, "{name}\n{}", ended.said);
    }
}

/// The port of the slave is pulled at 2 s and comes back. A program that goes on with the sonar
/// alone does not pass.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_port_that_came_back_is_to_be_opened_again() {
    let pulled = "kind = \"unplugged\"\nfrom = \"2s\"\nlasting = \"500ms\"\n";
    let bench = format!("{BENCH}\n[[fault]]\nlink = \"grip\"\ndirection = \"to-master\"\n{pulled}");
    let again = "os.close(grip)\n        \
                 while not os.path.exists(os.environ['HILRIG_PORT_GRIP']): time.sleep(0.05)\n        \
                 grip = opened('GRIP')";
    let program = |on_error: &str| {
        format!(
            "grip = opened('GRIP')\nsonar = opened('SONAR', termios.B9600)\nwhile True:\n    \
             try:\n        os.write(grip, ASK)\n        \
             if select.select([grip], [], [], 0.1)[0]: os.read(grip, 99)\n    \
             except OSError:\n        {on_error}\n    \
             if select.select([sonar], [], [], 0.1)[0]: print(os.read(sonar, 99), flush=True)\n"
        )
    };
    let judged = |name: &str, on_error: &str| {
        let python = program(on_error);
        run_in(&bench, name, "grip,sonar", &python, &["--virtual"])
    };
    let stays = judged("stays-away", "pass");
    let words = "the program does not open grip again";
    assert_eq!(flaw(&stays, "stays-away", words), None);
    assert!(stays.said.contains("unplugged on grip"), "{}", stays.said);
    let opens = judged("opens-again", again);
    assert_eq!(opens.check("program-goes-on").0, "pass", "{}", opens.said);
}

/// In real time, only the system knows the reason for a program's wait; the cause is named as well.
#[test]
fn in_real_time_the_cause_is_named_as_well() {
    let judge = |(name, port, python, words): Case| {
        let wait = ["--exec-wait", "60s"];
        let ended = run(&format!("real-{name}"), port, python, &wait);
        flaw(&ended, name, words)
    };
    let is_real = |case: &Case| REAL.contains(&case.0);
    let cases: Vec<Case> = CASES.into_iter().filter(is_real).collect();
    assert_eq!(cases.len(), REAL.len());
    assert_flawless(&side_by_side(&few(6, cases), &judge));
}

/// A program that polls an address that no device of the wire has gets no reply for a whole run. It
/// must not pass only because the other devices reply. A search for devices at the start is sound.
/// CRCs as in the serial line specification, computed by the program.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn an_address_of_no_device_is_the_cause() {
    const BUS: &str = r#"
schema = 1
name = "bus"
robot = "none"
duration = "6s"
device.bus = { description = [
  { file = "modbus-meter", name = "kitchen", address = 1 },
  { file = "modbus-meter", name = "cellar", address = 2 },
] }
"#;
    let program = |rounds: &str| {
        format!(
            "def crc(body):\n    \
                 c = 0xFFFF\n    \
                 for b in body:\n        \
                     c ^= b\n        \
                     for _ in range(8): c = c >> 1 ^ (0xA001 if c & 1 else 0)\n    \
                 return body + c.to_bytes(2, 'little')\n\
             fd = opened('BUS', termios.B9600)\n\
             for units in {rounds}:\n    \
                 for unit in units:\n        \
                     os.write(fd, crc(bytes([unit, 4, 0, 10, 0, 2])))\n        \
                     while select.select([fd], [], [], 0.1)[0]: os.read(fd, 99)\n"
        )
    };
    let judged =
        |name: &str, rounds: &str| run_in(BUS, name, "bus", &program(rounds), &["--virtual"]);
    let asks = judged("asks-nine", "[(1, 2, 9)] * 999");
    let words = "the program asked address 9, which no device of this link has (1, 2)";
    assert_flawless(&Vec::from_iter(flaw(&asks, "asks-nine", words)));
    let searches = judged("searches", "[range(1, 6)] + [(1, 2)] * 999");
    assert_eq!(
        searches.check("program-goes-on").0,
        "pass",
        "{}",
        searches.said
    );
    assert!(searches.said.contains("wrong-address"), "{}", searches.said);
}

/// A device's program that fails is the cause, whatever the program under test does then.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_failed_program_of_a_device_is_the_cause() {
    const LOST: &str = r#"
schema = 1
name = "lost"
robot = "none"
duration = "6s"

[device.grip.program]
rate = 9600
exec = "echo no module named grip >&2; exit 3"
"#;
    let ended = run_in(
        LOST,
        "lost-device",
        "grip",
        "asks(opened('GRIP'))\n",
        &["--virtual"],
    );
    let words = "the program that plays a device failed, not the program under test: grip exited \
                 (exit code 3)";
    assert_flawless(&Vec::from_iter(flaw(&ended, "lost-device", words)));
}

/// Results of `judge` for each of `cases`, which wait most of the time.
fn side_by_side(cases: &[Case], judge: &(impl Fn(Case) -> Option<String> + Sync)) -> Vec<String> {
    thread::scope(|scope| {
        let start = |case: &Case| {
            let case = *case;
            scope.spawn(move || judge(case))
        };
        let started: Vec<_> = cases.iter().map(start).collect();
        let ended = started.into_iter();
        ended
            .filter_map(|one| one.join().expect("it does not panic"))
            .collect()
    })
}
