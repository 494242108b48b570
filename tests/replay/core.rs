//! Replay of a capture to the robot's program in virtual time.

use core::time::Duration;
use std::path::Path;

use hilrig::capture::replay::{Recorded, Replay, Replayed, Voice, scenario_of};
use hilrig::capture::{Capture, Kind};
use hilrig::rig::Logged;
use hilrig::rig::line::Direction;
use protocols::Instant;

use crate::support::*;

/// Damage on the lines must be in the capture for an exact replay: damage of every kind, and a late
/// line.
const FAULTS: &str = r#"
[link.base]
latency = "300us"
[[fault]]
link = "base"
direction = "to-master"
kind = "flip"
rate = 0.01
[[fault]]
link = "base"
direction = "to-device"
kind = "drop"
rate = 0.01
[[fault]]
link = "lidar"
direction = "to-master"
kind = "insert"
rate = 0.002
[[fault]]
link = "radio"
direction = "to-master"
kind = "duplicate"
rate = 0.01
"#;

fn replayed(capture: &Capture, voice: Voice) -> Replayed {
    let scenario = scenario_of(capture, Path::new("<capture>")).expect("readable");
    let (scenario, source) = scenario.expect("a run says what it ran");
    let recorded = Recorded::of(capture, None);
    let replay = Replay::new(&recorded, &scenario, &source, voice).expect("wired");
    replay.finish()
}

fn violations(events: &[Logged]) -> Vec<String> {
    let own = events.iter().filter(|event| event.is_violation());
    own.map(Logged::to_string).collect()
}

/// The same program with the same bytes at the same nanoseconds sends the same bytes at the same
/// nanoseconds. The devices find the same violations. A second replay is equal.
#[test]
fn a_runs_own_capture_replays_without_a_difference() {
    let path = folder("own").join("capture.pcapng");
    let (capture, events) = captured(in_a_room("12s", FAULTS), &path, |_| {});
    let first = replayed(&capture, Voice::Program);
    assert_eq!(first.divergence().map(|one| one.to_string()), None);
    assert_eq!(first.largest_shift(), Duration::ZERO);
    assert!(
        first.heard > 100_000 && first.sent() > 5_000,
        "{} {}",
        first.heard,
        first.sent()
    );
    let found: Vec<String> = first.violations.iter().map(Logged::to_string).collect();
    assert_eq!(found, violations(&events));
    assert!(!found.is_empty(), "the faults make the base complain");
    let second = replayed(&capture, Voice::Program);
    assert_eq!(first.trace_hash, second.trace_hash);
    // Without the program: the devices judge the recorded bytes.
    let judged = replayed(&capture, Voice::Capture);
    let found: Vec<String> = judged.violations.iter().map(Logged::to_string).collect();
    assert_eq!(found, violations(&events));
}

/// A suspended recorder, or a changed clock, in the middle of a run: the program does not run
/// through a whole day of silence, and a note says so.
#[test]
fn a_day_of_silence_in_a_capture_is_played_as_a_minute() {
    let folder = folder("day");
    let path = folder.join("capture.pcapng");
    let (mut capture, _) = captured(in_a_room("2s", ""), &path, |_| {});
    let (middle, day) = (Instant::from_secs(1), Duration::from_secs(86_400));
    let late = capture.records.iter_mut();
    late.filter(|record| record.at > middle)
        .for_each(|record| record.at += day);
    let mut bytes = Vec::new();
    capture.sections[0].write(&mut bytes);
    capture.links.iter().for_each(|link| link.write(&mut bytes));
    for record in &capture.records {
        let link = u32::try_from(record.link).expect("few links");
        record.write(link, &mut bytes);
    }
    std::fs::write(&path, bytes).expect("writable");
    for command in [
        &["replay", "capture.pcapng"][..],
        &["export", "capture.pcapng", "-o", "way.tum"],
        &["case", "from", "capture.pcapng", "-o", "case.toml"],
    ] {
        let (_, said, told) = hilrig(&folder, command);
        if command[0] != "export" {
            let expected = "capture.pcapng: the silence of 86400 s at ";
            assert!(told.contains(expected), "{command:?}: {said}{told}");
            assert!(told.contains("s is played as 60 s"), "{told}");
        }
    }
    // Poses after the silence keep the capture's own times.
    let way = std::fs::read_to_string(folder.join("way.tum")).expect("written");
    let last = way.lines().last().and_then(|line| line.split(' ').next());
    let last: f64 = last.and_then(|at| at.parse().ok()).expect("a time");
    assert!(last > 86_400.0, "{last}");
    let case = std::fs::read_to_string(folder.join("case.toml")).expect("written");
    let end = case.lines().find_map(|line| line.strip_prefix("end_ns = "));
    let end: u64 = end.and_then(|end| end.parse().ok()).expect("a number");
    assert!((61_000_000_000..63_000_000_000).contains(&end), "{end}");
}

/// The capture has one changed byte in the middle of the bytes to the base.
#[test]
fn one_changed_byte_is_told_at_its_place() {
    let path = folder("changed").join("capture.pcapng");
    let (mut capture, _) = captured(in_a_room("6s", ""), &path, |_| {});
    let base = capture
        .links
        .iter()
        .position(|link| link.name == "base")
        .expect("there");
    let is_sent = |r: &&mut capture::Record| {
        r.link == base && r.direction == Direction::ToDevice && r.kind == Kind::Data
    };
    let mut before = 0;
    let mut records = capture.records.iter_mut().filter(is_sent);
    let record = records.find(|record| {
        before += record.bytes.len();
        before > 800
    });
    let record = record.expect("six seconds are longer");
    let mut bytes = record.bytes.to_vec();
    let byte = bytes.last_mut().expect("not empty");
    let (was, is) = (*byte, *byte ^ 0x10);
    *byte = is;
    record.bytes = bytes.into();
    let at = record.at;

    let divergence = replayed(&capture, Voice::Program)
        .divergence()
        .expect("one byte");
    assert_eq!(
        (&*divergence.link, divergence.direction),
        ("base", Direction::ToDevice)
    );
    assert_eq!((divergence.byte, divergence.at), (before - 1, at));
    assert_eq!((divergence.expected, divergence.got), (Some(is), Some(was)));
    assert_ne!(divergence.frames[0], divergence.frames[1]);
}
