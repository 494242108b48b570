//! The first bytes of a program: whatever opens the port, and whenever, the device receives each
//! byte at the time of its write, plus its time on the line.

use hilrig::capture::Capture;
use hilrig::rig::line::Direction;
use protocols::LineConfig;

use crate::guest::{compiled, run, trace};
use crate::support::Ended;

const BEGIN: &str = include_str!("programs/begin.c");
/// A line of 9600 baud, 10 bits a character.
const SONAR: &str = include_str!("programs/sonar.toml");
const CHARACTER: u64 = 1_041_666;

/// The same writes in Python, from a thread, with a pause before the port is opened.
const PYTHON: &str = "\
import os, threading, time
def send():
    begin = time.monotonic_ns()
    for letter, pause in zip(b'abcdefg', (1, 3, 7, 1, 3, 7, 0)):
        os.write(fd, bytes([letter]))
        print(chr(letter), time.monotonic_ns() - begin)
        time.sleep(pause / 1000)
time.sleep(0.123)
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
thread = threading.Thread(target=send)
thread.start()
thread.join()
time.sleep(0.05)
";

/// Expected arrival of each byte after the first, by hand: a byte leaves when it is written and the
/// line is free. The program prints a time that it reads in the call after the write.
fn expected(ended: &Ended) -> Vec<(char, u64)> {
    let lines = ended.log.lines().filter_map(|line| line.split_once(' '));
    let writes = lines.map(|(letter, at)| (letter, at.parse::<u64>().expect("nanoseconds")));
    let (mut arrivals, mut first, mut free) = (Vec::new(), None, 0);
    for (letter, at) in writes {
        free = free.max(at - *first.get_or_insert(at)) + CHARACTER;
        arrivals.extend(letter.chars().map(|it| (it, free - CHARACTER)));
    }
    arrivals
}

/// When the device received each byte, from the capture.
fn arrived(ended: &Ended) -> Vec<(char, u64)> {
    let capture = Capture::read(&ended.folder().join("out/capture.pcapng"));
    let capture = capture.expect("every run has it");
    let records = capture.records.iter();
    let records = records.filter(|record| record.direction == Direction::ToDevice);
    let chunks = records.flat_map(|record| record.chunks(LineConfig::new_8n1(9600)));
    let bytes = chunks.flat_map(|(at, bytes)| bytes.iter().map(move |byte| (*byte, at)));
    let bytes = bytes.map(|(byte, at)| (char::from(byte), at.as_nanos()));
    bytes.collect()
}

/// Compares the times after the first byte.
fn check(ended: &Ended, name: &str) {
    let (expected, arrived) = (expected(ended), arrived(ended));
    let told = format!("{name}: {expected:?}, {arrived:?}");
    assert_eq!(arrived.len(), 7, "{told}");
    for (&(letter, at), (expected, wanted)) in arrived.iter().zip(expected) {
        assert_eq!(letter, expected, "{told}");
        // Each character's fraction of a nanosecond is cut off, and the program reads its clock
        // two calls of 1 us after the write.
        let late = (at - arrived[0].1).abs_diff(wanted);
        assert!(late <= 2_000, "{letter}: {told}");
    }
}

#[test]
fn the_first_bytes_arrive_at_their_times() {
    let files = [("sonar.toml", SONAR), ("program.py", PYTHON)];
    let program = compiled("begin", "cc", BEGIN, &["-w", "-pthread"]);
    let mut commands = vec!["python3 program.py".to_owned()];
    if let Some(program) = program {
        let ways = [
            "early",
            "early spin",
            "late",
            "raw",
            "twice spin",
            "both",
            "fork",
            "child",
            "thread",
        ];
        commands.extend(ways.map(|way| format!("{} {way}", program.display())));
    }
    for (index, command) in commands.iter().enumerate() {
        let name = format!("begin-{index}");
        let page = run(&name, command, &files, &["--exec-may-end"]);
        check(&page, command);
        let words = ["--exec-may-end", "--trace-calls", "calls.txt"];
        let stopped = run(&name, command, &files, &words);
        assert_eq!(trace(&page), trace(&stopped), "{command}");
    }
}
