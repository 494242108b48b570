//! A robot defined only by data, driven by a Python program that knows only its wires. The lidar is
//! 5 cm ahead of the axle and turned by 30 degrees, so its reading 60 points ahead.

use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use crate::support::{Ended, ended_in};

/// Ports, frames of the wheels' registers, and the distance ahead.
const WIRES: &str = "\
import os, struct, sys, termios, time, tty
print('group', os.getpgrp(), flush=True)
def opened(name):
    fd = os.open(os.environ['HILRIG_PORT_' + name], os.O_RDWR | os.O_NOCTTY)
    tty.setraw(fd)
    mode = termios.tcgetattr(fd)
    mode[4] = mode[5] = termios.B115200
    termios.tcsetattr(fd, termios.TCSANOW, mode)
    return fd
def drive(left, right):
    head = bytes([0xAB, 1, 0x82]) + struct.pack('bb', left, right)
    os.write(wheels, head + struct.pack('<H', sum(head)))
    got = b''
    while len(got) < 5:
        got += os.read(wheels, 5 - len(got))
stream = b''
def ahead_mm():
    global stream
    stream += os.read(lidar, 4096)
    seen = None
    while len(stream) >= 22:
        if stream[0] == 0xFA and stream[1] == 0xA0 + 60 // 4:
            low, high = stream[4], stream[5]
            seen = low | (high & 0x3F) << 8 if high < 0x80 else None
        stream = stream[22 if stream[0] == 0xFA else 1:]
    return seen
";

/// 3 m to the wall, 2.2 m to drive, 5 cm from the axle to the lidar.
const GOOD: &str = "\
lidar, wheels = opened('LIDAR'), opened('WHEELS')
goes = True
while True:
    ahead = ahead_mm()
    if ahead is not None and ahead <= 3000 - 2200 - 50:
        goes = False
    drive(*([25, 25] if goes else [0, 0]))
";
const INTO_THE_WALL: &str = "\
lidar, wheels = opened('LIDAR'), opened('WHEELS')
while True:
    ahead_mm()
    drive(25, 25)
";
const HANGS: &str = "\
lidar, wheels = opened('LIDAR'), opened('WHEELS')
time.sleep(600)
";
const EXITS_3: &str = "\
lidar, wheels = opened('LIDAR'), opened('WHEELS')
drive(25, 25)
sys.exit(3)
";
/// The program sends something to the lidar, which ignores it: the rig then no longer waits for
/// further ports.
const NEVER_OPENS_THE_WHEELS: &str = "\
lidar = opened('LIDAR')
os.write(lidar, b'?')
while True:
    ahead_mm()
";

fn folder_of(name: &str) -> PathBuf {
    let folder = format!("exec-custom-{name}-{}", std::process::id());
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(folder)
}

/// In virtual time where it is supported: a program that drives must keep pace with its robot.
const DRIVES: &[&str] = match cfg!(all(target_os = "linux", target_arch = "x86_64")) {
    true => &["--virtual"],
    false => &[],
};

/// In real time.
const REAL: &[&str] = &[];

const SCENARIO: &str = include_str!("../../scenarios/custom-robot.toml");

fn start(name: &str, duration: &str, program: &str, more: &[&str]) -> Child {
    start_in(&SCENARIO.replace("\"20s\"", duration), name, program, more)
}

fn start_in(scenario: &str, name: &str, program: &str, more: &[&str]) -> Child {
    let folder = folder_of(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a fresh folder");
    fs::write(folder.join("robot.toml"), scenario).expect("a fresh file");
    fs::write(folder.join("robot.py"), format!("{WIRES}{program}")).expect("a fresh file");
    Command::new(env!("CARGO_BIN_EXE_hilrig"))
        .current_dir(&folder)
        .args(["run", "robot.toml", "--out", "out", "--exec-wait", "60s"])
        .args(["--exec", "python3 robot.py"])
        .args(more)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary is built")
}

/// The verdict is right for a correct program and for four defective ones, each with another
/// defect.
#[test]
fn a_robot_of_data_gets_the_verdict_that_its_program_deserves() {
    let programs = [
        ("good", "\"20s\"", GOOD, DRIVES),
        ("wall", "\"9s\"", INTO_THE_WALL, DRIVES),
        ("hangs", "\"5s\"", HANGS, DRIVES),
        ("exits", "\"5s\"", EXITS_3, REAL),
        ("never", "\"2s\"", NEVER_OPENS_THE_WHEELS, REAL),
    ];
    let started =
        programs.map(|(name, duration, program, more)| start(name, duration, program, more));
    let names = programs.map(|(name, ..)| name);
    let mut ended: Vec<Ended> = Vec::new();
    for (name, child) in names.into_iter().zip(started) {
        let output = child.wait_with_output().expect("it ends");
        ended.push(ended_in(&folder_of(name), output));
    }
    let [good, wall, hangs, exits, never] = &ended[..] else {
        panic!("five");
    };
    assert_eq!(good.failed(), Vec::<&str>::new(), "{}", good.said);
    assert_eq!(good.code, Some(0), "{}", good.said);
    assert_eq!(good.check("no-collision-at-speed").0, "pass");
    assert_eq!(good.check("waypoints-visited").0, "pass");

    assert_eq!(wall.failed(), ["no-collision-at-speed"], "{}", wall.said);
    assert!(hangs.failed().contains(&"program-reads"), "{}", hangs.said);
    assert!(exits.failed().contains(&"program-alive"), "{}", exits.said);
    let (_, detail) = exits.check("program-alive");
    assert!(detail.contains("exit code 3"), "{detail}");
    let (status, detail) = never.check("program-connected");
    assert_eq!(status, "fail", "{}", never.said);
    assert!(detail.contains("wheels"), "{detail}");
    for failing in [wall, hangs, exits, never] {
        failing.assert_is_failure();
    }
}

/// The lidar is cut off at 4 s, and the watchdog of the wheels lets them turn for 5 s without a
/// command: a program that sends none keeps the robot moving.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_robot_that_gets_no_commands_any_more_is_seen_to_move() {
    let scenario = format!(
        "{SCENARIO}\n[expect.safety]\nrests_within = \"1s\"\n\
         [[fault]]\nlink = \"lidar\"\ndirection = \"to-master\"\nkind = \"cut\"\nfrom = \"4s\"\n"
    );
    let scenario = scenario
        .replace("\"20s\"", "\"9s\"")
        .replace("\"500ms\"", "\"5s\"");
    for (name, silent, status) in [
        ("leaves-it", "continue", "fail"),
        ("stops-it", "speed = 0", "pass"),
    ] {
        let program = format!(
            "import select\nlidar, wheels = opened('LIDAR'), opened('WHEELS')\nwhile True:\n    \
             speed = 10\n    if select.select([lidar], [], [], 0.3)[0]:\n        ahead_mm()\n    \
             else:\n        {silent}\n    drive(speed, speed)\n"
        );
        let child = start_in(&scenario, name, &program, DRIVES);
        let ended = ended_in(&folder_of(name), child.wait_with_output().expect("it ends"));
        let (found, _) = ended.check("rests-after-silence");
        assert_eq!(found, status, "{name}\n{}", ended.said);
    }
}

/// Safety checks of a program at ports. Its lidar is cut off for 2 s: a program that waits for it
/// does not feed its wheels meanwhile. Another one sends bytes that are no frame.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn the_lines_of_a_program_at_ports_are_judged() {
    let scenario = format!(
        "{SCENARIO}\n[expect.safety]\nsends_within = \"1s\"\nsound_frames = true\n\
         [[fault]]\nlink = \"lidar\"\ndirection = \"to-master\"\nkind = \"cut\"\nfrom = \"7s\"\n\
         until = \"9s\"\n"
    );
    let scenario = scenario.replace("\"20s\"", "\"10s\"");
    let rests = |wait: &str, more: &str| {
        format!(
            "import select\nlidar, wheels = opened('LIDAR'), opened('WHEELS')\nwhile True:\n    \
             if select.select([lidar], [], [], {wait})[0]:\n        ahead_mm()\n    {more}drive(0, 0)\n"
        )
    };
    for (name, wait, more, expected) in [
        (
            "fed",
            "0.05",
            "",
            [("sends-on", "pass"), ("sends-sound-frames", "pass")],
        ),
        (
            "starved",
            "None",
            "",
            [("sends-on", "fail"), ("sends-sound-frames", "pass")],
        ),
        (
            "junk",
            "0.05",
            "os.write(wheels, b'~~~~~~~~')\n    ",
            [("sends-on", "pass"), ("sends-sound-frames", "fail")],
        ),
    ] {
        let child = start_in(&scenario, name, &rests(wait, more), DRIVES);
        let ended = ended_in(&folder_of(name), child.wait_with_output().expect("it ends"));
        for (check, status) in expected {
            assert_eq!(
                ended.check(check).0,
                status,
                "{name} {check}\n{}",
                ended.said
            );
        }
    }
}
