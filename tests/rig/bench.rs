//! Ports as `Read` and `Write` in virtual time.

use core::time::Duration;
use std::io::{ErrorKind, Read as _, Write as _};

use hilrig::ports::Bench;

use super::{in_a_room, shipped};

fn own_slave() -> Bench {
    let (scenario, source) = shipped("own-slave");
    Bench::new(scenario, &source).expect("can be wired")
}

/// At 9600 baud a byte takes 1041666 ns: six bytes are sent, eight are received.
#[test]
fn calls_take_the_time_of_their_bytes() {
    let bench = own_slave();
    let mut sonar = bench.port("sonar").expect("a port");
    sonar.write_all(b"ping\r\n").expect("room");
    assert_eq!(bench.now().as_nanos(), 0);
    sonar.flush().expect("sent");
    assert_eq!(bench.now().as_nanos(), 6 * 1_041_666);
    let mut line = [0; 8];
    sonar.read_exact(&mut line).expect("an answer");
    assert_eq!(&line, b"mm=700\r\n");
    let took = bench.now().as_nanos();
    assert!((14 * 1_041_666..20_000_000).contains(&took), "{took}");
}

/// The sonar sends every second: within half a second no bytes come.
#[test]
fn a_read_waits_for_its_timeout_and_no_longer() {
    let bench = own_slave();
    let mut sonar = bench.port("sonar").expect("a port");
    sonar.set_timeout(Duration::from_millis(500));
    let nothing = sonar.read(&mut [0]).map_err(|error| error.kind());
    assert_eq!(nothing, Err(ErrorKind::TimedOut));
    assert_eq!(bench.now().as_millis(), 500);
    assert_eq!(sonar.read(&mut []).expect("nothing is wanted"), 0);
    bench.sleep(Duration::from_secs(1));
    assert_eq!(sonar.available().expect("a run"), 8);
}

/// A program that serves its port without end must stop at some time: at the end of the scenario.
#[test]
fn a_port_is_hung_up_at_the_end_of_the_scenario() {
    let bench = own_slave();
    let mut sonar = bench.port("sonar").expect("a port");
    bench.sleep(Duration::from_secs(59));
    sonar.set_timeout(Duration::from_secs(9));
    let mut all = Vec::new();
    sonar.read_to_end(&mut all).expect("an end");
    assert_eq!(bench.now().as_millis(), 60_000);
    assert!(all.ends_with(b"mm=700\r\n"));
    let refused = sonar.write(b"ping\r\n").map_err(|error| error.kind());
    assert_eq!(refused, Err(ErrorKind::BrokenPipe));
    bench.judge();
    assert!(bench.port("sonar").is_err());
    assert_eq!(
        bench.now().as_millis(),
        60_000,
        "the end, as long as one asks"
    );
}

/// A blocked write also ends with the scenario: of 6000 bytes 960 are sent in the last second, and
/// 4096 wait.
#[test]
fn a_write_that_finds_no_room_ends_with_the_scenario() {
    let bench = own_slave();
    let mut sonar = bench.port("sonar").expect("a port");
    bench.sleep(Duration::from_secs(59));
    let refused = sonar.write_all(&[b' '; 6000]).map_err(|error| error.kind());
    assert_eq!(refused, Err(ErrorKind::BrokenPipe));
    assert_eq!(bench.now().as_millis(), 60_000);
}

#[test]
fn an_unknown_port_is_told_with_the_known_ones() {
    let error = own_slave().port("sonr").expect_err("no such port");
    let known = "no port sonr, expected one of lidar, motor, base, radio, gripper, sonar";
    assert_eq!(error.to_string(), known);
    let names = ["lidar", "motor", "base", "radio", "gripper", "sonar"];
    assert_eq!(own_slave().names(), names);
}

/// Two drivers in turn, one of which writes more than fits: each run is the same to the byte.
#[test]
fn the_same_calls_give_the_same_bytes() {
    let run = || {
        let bench = own_slave();
        let mut gripper = bench.port("gripper").expect("a port");
        let mut sonar = bench.port("sonar").expect("a port");
        let mut reply = [0; 7];
        for _ in 0..20 {
            gripper.write_all(&[0xAB, 4, 2, 0xB1, 0]).expect("room");
            gripper.read_exact(&mut reply).expect("an answer");
            sonar.write_all(b"ping\r\n").expect("room");
            sonar.read_exact(&mut [0; 8]).expect("an answer");
        }
        sonar.write_all(&[b' '; 5000]).expect("it waits");
        assert_eq!(reply, [0xAB, 4, 0x82, 0xA4, 0x06, 0xDB, 0x01]);
        bench.judge()
    };
    let (first, second) = (run(), run());
    assert_eq!(first.trace_hash, second.trace_hash);
    assert!(first.ran > Duration::from_millis(900), "{:?}", first.ran);
}

/// A program that does not drive: the verdict names the failed check.
#[test]
fn a_failed_verdict_panics_in_words() {
    let (scenario, source) = in_a_room("1s", "[expect]\nsettle = \"20s\"\n");
    let outcome = Bench::new(scenario, &source).expect("sound").judge();
    let said = std::panic::catch_unwind(core::panic::AssertUnwindSafe(|| outcome.assert_passed()));
    let said = said.expect_err("it did not pass");
    let said = said.downcast_ref::<String>().expect("words");
    let expected = "test, seed 1, did not pass:\nFAIL settled                   at rest for";
    assert!(said.starts_with(expected), "{said}");
}
