//! A foreign robot in all functions of hilrig for robots.

use std::fs;
use std::path::{Path, PathBuf};

use hilrig::capture::decode::transcript::{Said, Transcript};
use hilrig::capture::{self, Limits, Recording};
use hilrig::prelude::*;
use hilrig::show::folder;

fn arc() -> (Scenario, Source) {
    outside::register();
    Scenario::read(Path::new("arc.toml")).expect("sound")
}

/// A fresh folder of the test `name`.
fn place(name: &str) -> PathBuf {
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&place);
    fs::create_dir_all(&place).expect("can be made");
    place
}

fn run(scenario: (Scenario, Source)) -> Outcome {
    let run = Run::new(scenario.0, &scenario.1, None).expect("can be wired");
    run.finish()
}

fn find<'a>(outcome: &'a Outcome, name: &str) -> &'a Check {
    let check = outcome.checks.iter().find(|check| check.name == name);
    check.unwrap_or_else(|| panic!("no {name} in {:#?}", outcome.checks))
}

/// Pose, rules and the robot's own checker, with a noisy line and a dark lamp.
#[test]
fn it_gets_a_verdict() {
    let outcome = run(arc());
    outcome.assert_passed();
    assert_eq!(find(&outcome, "slow-enough").status, Status::Pass);
    assert_eq!(find(&outcome, "pose-rms").status, Status::Pass);
    assert!(
        outcome.counters["bad packets"] > 0,
        "{:?}",
        outcome.counters
    );
    let rules: Vec<_> = outcome
        .events
        .iter()
        .map(|logged| logged.event.rule)
        .collect();
    assert!(
        rules.contains(&"dark") && rules.contains(&"light"),
        "{rules:?}"
    );
    // The car drove more than two metres of the arc, and the map is its own.
    let (_, end) = outcome.truth.last().expect("a way");
    assert!(end.y > 1.5, "{end:?}");
    let map = outcome.map.as_ref().expect("a map").view();
    // 6 m and 4.8 m, from a start at 3.2 m in both directions, in steps of 6.4 m.
    assert_eq!((map.width(), map.height()), (128, 128));
}

/// The same car with a lower speed limit than its speed: the checker reports it.
#[test]
fn its_own_checker_can_fail() {
    struct Never;
    impl Checker for Never {
        fn observe(&mut self, _: &Look<'_>) {}
        fn verdict(&self) -> Check {
            Check::new("never", false, "whatever it does")
        }
    }
    let (scenario, source) = arc();
    let mut run = Run::new(scenario, &source, None).expect("can be wired");
    run.add_checker(Box::new(Never));
    assert!(!run.finish().passed());
}

#[test]
fn its_result_folder_shows_its_panels_axes_verdicts_and_map() {
    let (outcome, place) = (run(arc()), place("folder"));
    folder::write(&place, &outcome, Duration::ZERO).expect("can be written");
    let report = fs::read_to_string(place.join("report.html")).expect("a report");
    for part in [
        "The robot at the end",
        "<td>steering</td><td>set-point 12 deg</td>",
        "<summary>servo board</summary>",
        "<td>ok</td><td>slow-enough</td>",
        "<td>packets</td>",
        "\"name\":\"ahead\"",
    ] {
        assert!(report.contains(part), "no {part:?} in the report");
    }
    let map = fs::read(place.join("map.pgm")).expect("a map");
    assert!(map.starts_with(b"P5\n128 128\n"), "{:?}", &map[..14]);
    let junit = fs::read_to_string(place.join("junit.xml")).expect("verdicts");
    assert!(junit.contains("slow-enough"));
    // The saved case contains the random damage, and repeats the same run.
    let case = Scenario::read(&place.join("case.toml")).expect("sound");
    assert_eq!(run(case).trace_hash, outcome.trace_hash);
}

#[test]
fn its_capture_is_told_in_its_words() {
    let (scenario, source) = arc();
    let path = place("capture").join("arc.pcapng");
    let section = capture::about(&scenario);
    let mut run = Run::new(scenario, &source, None).expect("can be wired");
    let tap = Recording::create(&path, &run.rig, section, Limits::default()).expect("a file");
    run.rig.add_tap(Box::new(tap));
    while !run.is_over() {
        run.step();
    }
    run.rig.finish_taps().expect("written");

    let capture = Capture::read(&path).expect("a capture");
    let mut transcript = Transcript::new(hilrig::codec::find("turret"));
    for record in &capture.records {
        let link = &capture.links[record.link];
        if link.name == "turret" {
            transcript.record(record, link);
        }
    }
    let said: Vec<Said> = transcript.finish().map(|entry| entry.said).collect();
    // The first beam points along x from (1, 1) to the wall at 5 m.
    assert_eq!(said[0], Said::Frame("0 deg: 4000 mm".to_owned()));
    assert!(said.len() > 7000, "{}", said.len());
    assert!(said.iter().any(|one| matches!(one, Said::Bad(..))));
}

/// The format keeps the laws that the fuzzer checks for every decoder.
#[test]
fn its_format_keeps_the_laws() {
    outside::register();
    let target = hilrig::codec::target("turret").expect("a target");
    for seed in 0..=255_u8 {
        let data: Vec<u8> = (0..200_u8).map(|n| n.wrapping_mul(seed) ^ seed).collect();
        let stream = (target.stream)(&data);
        assert_eq!((target.check)(&stream), Ok(()));
    }
}

/// The same devices, driven by hand: the board answers any client of its port.
#[test]
fn its_ports_can_be_read_and_written() {
    use std::io::{Read as _, Write as _};
    let (scenario, source) = arc();
    let bench = Bench::new(scenario, &source).expect("can be wired");
    let mut board = bench.port("board").expect("a port");
    for _ in 0..10 {
        board
            .write_all(&outside::board::command(b'D', 40))
            .expect("room");
        bench.sleep(Duration::from_millis(100));
    }
    let mut reports = vec![0; 6 * 50];
    board
        .read_exact(&mut reports)
        .expect("fifty reports a second");
    let last = reports.last_chunk::<6>().expect("fifty");
    assert!(last[0] == b'E' && last[1] > 20, "{last:?}");
    assert!(bench.run().rig.world.speed() > 0.2);
}
