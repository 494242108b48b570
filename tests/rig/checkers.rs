//! Whole-run checkers, each with a mutant that it catches. The checker of stopped motors is in
//! `silence`, that of the recovery in `faults::schedule`.

use hilrig::robots::{Axis, instruments::Unknown};
use hilrig::run::Outcome;
use hilrig::run::check::{self, Look, Status};

use super::{failures, in_a_room, run_to_end, start};

const EXPLORES: &str = "start_mode = \"exploration\"\n";

/// The verdict called `name`, of a program that explores with `defects`, in a scenario with `more`.
fn verdict(name: &str, defects: &str, more: &str) -> (Status, String) {
    let text = format!("[program]\n{EXPLORES}defects = [{defects}]\n{more}");
    verdict_of(name, &run_to_end(in_a_room("12s", &text)))
}

fn verdict_of(name: &str, outcome: &Outcome) -> (Status, String) {
    let found = outcome.checks.iter().find(|check| check.name == name);
    let check = found.expect("a checker of every run");
    (check.status, check.detail.clone())
}

/// In the middle of a run, the verdicts are those that the run would get if it ended then, also the
/// verdict on its map.
#[test]
fn the_verdicts_so_far_are_those_of_the_end() {
    let walls = "[expect]\nwall_overlap_min = 0.1\n";
    let mut run = start(in_a_room("5s", &format!("[program]\n{EXPLORES}{walls}")));
    while !run.is_over() {
        run.step();
    }
    let so_far: Vec<String> = run.checks().iter().map(ToString::to_string).collect();
    let outcome = run.judge();
    let in_the_end: Vec<String> = outcome.checks.iter().map(ToString::to_string).collect();
    assert_eq!(so_far, in_the_end);
    assert_eq!(verdict_of("wall-overlap", &outcome).0, Status::Pass);
}

/// A blind lidar, and a robot that treats missing distances as free space (XV-11). The robot drives
/// into the wall at its travelling speed; the correct program stands still.
#[test]
fn a_robot_that_drives_blind_is_caught_at_the_wall() {
    let dark =
        "[[fault]]\nkind = \"device\"\ndevice = \"lidar\"\nfault = \"dark\"\nfrom = \"5s\"\n";
    let (status, said) = verdict("no-collision-at-speed", "\"XV-11\"", dark);
    assert_eq!(status, Status::Fail, "{said}");
    assert!(said.contains("the first harmful one at"), "{said}");
    let (status, said) = verdict("no-collision-at-speed", "", dark);
    assert_eq!(status, Status::Pass, "{said}");
}

/// The checksum of each reply is written one element after the end of the caller's array (MA-01).
#[test]
fn a_write_beside_a_buffer_is_caught_though_no_byte_on_the_wire_tells() {
    let (status, said) = verdict("memory-intact", "\"MA-01\"", "");
    assert_eq!(status, Status::Fail);
    assert!(said.contains("beside the reply buffer"), "{said}");
    assert_eq!(verdict("memory-intact", "", "").0, Status::Pass);
}

/// A byte on the radio's line in the first millisecond ends the fielded program (PU-16).
#[test]
fn a_program_that_ends_is_caught() {
    let after = |defects: &str| {
        let text = format!("[program]\ndefects = [{defects}]\n");
        let mut run = start(in_a_room("1s", &text));
        let radio = run.rig.replace_device("radio").expect("it has one");
        run.rig.inject(radio, b"P");
        verdict_of("program-alive", &run.finish())
    };
    let (status, said) = after("\"PU-16\"");
    assert_eq!(status, Status::Fail);
    assert!(said.starts_with("ended at 0."), "{said}");
    assert_eq!(after("").0, Status::Pass);
}

/// The wheels follow 35 ticks per 40 ms at most (seed report: the register's range).
#[test]
fn a_set_point_beyond_what_the_wheels_can_do_is_caught() {
    let mut run = start(in_a_room("1s", ""));
    let mut after = |set_points: [i16; 2]| {
        let mut checkers = check::standard(&mut run.rig, &Unknown, None);
        let axis = |set_point: i16| Axis {
            name: "wheel".into(),
            unit: "",
            set_point: set_point.into(),
            limit: Some(35.0),
            actual: None,
        };
        let axes = set_points.map(axis);
        for checker in &mut checkers {
            checker.observe(&Look {
                rig: &run.rig,
                axes: &axes,
                contacts: &[],
            });
        }
        let verdicts = checkers.iter().map(|checker| checker.verdict());
        let failed = verdicts.filter(|check| check.status == Status::Fail);
        failed.map(|check| check.name).collect::<Vec<_>>()
    };
    assert_eq!(after([35, -35]), [""; 0]);
    assert_eq!(after([0, -36]), ["set-points-in-range"]);
}

/// A base whose firmware reads the set-points as unsigned (build of 2014): -20 becomes 236, and the
/// regulator follows up to its limit, 35. No frame contained that set-point.
#[test]
fn a_set_point_that_no_frame_told_is_caught() {
    let after = |profile: &str| {
        let turn = "[[mission.step]]\nat = \"2500ms\"\ndo = { drive = [-20, 20] }\n";
        let base = format!("[device.base.avr-base]\nprofile = \"{profile}\"\n");
        let outcome = run_to_end(in_a_room("5s", &format!("{turn}{base}")));
        verdict_of("set-points-as-accepted", &outcome)
    };
    let (status, said) = after("rcj2015-2014");
    assert_eq!(status, Status::Fail);
    assert!(said.starts_with("35, 20 at "), "{said}");
    assert_eq!(after("rcj2015-2015").0, Status::Pass);
}

const MISSION: &str = "[expect]\nvisit_within_mm = 200\nsettle = \"3s\"\n\
    [mission]\nwaypoints_m = [[1.5, 1.8]]\n";

/// The waypoint is visited, and the PC then orders a turn on the spot that never ends. Without this
/// order, the robot would rest, and the run would be over after three seconds of rest.
#[test]
fn a_robot_that_does_not_come_to_rest_is_caught() {
    let rests = run_to_end(in_a_room("30s", MISSION));
    assert_eq!(failures(&rests), [""; 0]);
    assert!(rests.ran.as_secs() < 25, "{:?}", rests.ran);
    let turns = "[[mission.step]]\nat = \"5500ms\"\ndo = { drive = [-6, 6] }\n";
    let outcome = run_to_end(in_a_room("30s", &format!("{MISSION}{turns}")));
    let failed = failures(&outcome);
    assert_eq!(failed, ["settled: at rest for 0.00 s, at least 3s"]);
}

/// A robot that never gets a goal.
#[test]
fn a_mission_that_does_not_succeed_is_caught() {
    let cut = "[[fault]]\nkind = \"cut\"\nlink = \"radio\"\ndirection = \"to-master\"\n";
    let outcome = run_to_end(in_a_room("5s", &format!("{MISSION}{cut}")));
    let failed = failures(&outcome);
    let named = "waypoints-visited: 0 of 1 waypoints within 200 mm";
    assert!(failed.contains(&named.to_owned()), "{failed:?}");
}
