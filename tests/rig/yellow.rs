//! The robot yellow in whole runs: its four shipped scenarios over a few seeds, and the effect of a
//! fielded law or a dead PC on them.

use std::path::Path;

use hilrig::run::{Outcome, Run};
use hilrig::scenario::{Scenario, Source};
use hilrig::show::render;

use super::{failures, shipped};
use crate::thorough::few;

fn judged(name: &str, seed: u64, change: impl FnOnce(&mut Scenario)) -> Vec<String> {
    let (mut scenario, source) = shipped(name);
    scenario.seed = seed;
    change(&mut scenario);
    let run = Run::new(scenario, &source, None).expect("can be wired");
    failures(&run.finish())
}

fn passes(name: &str, seeds: impl IntoIterator<Item = u64>) {
    for seed in few(1, seeds) {
        assert_eq!(judged(name, seed, |_| {}), [""; 0], "{name}, seed {seed}");
    }
}

/// Acceptance YE6: 19 of 20 seeds leave the labyrinth, none touches a wall.
#[test]
fn ye6_nineteen_of_twenty_leave_the_labyrinth_by_infrared_alone() {
    let (seeds, mut out) = (few(5, 0..20), 0);
    for &seed in &seeds {
        let failed = judged("yellow-reactive", seed, |_| {});
        let is_contact = |check: &&String| check.starts_with("no-collision");
        assert_eq!(failed.iter().find(is_contact), None, "seed {seed}");
        out += usize::from(failed.is_empty());
    }
    assert!(out + 1 >= seeds.len(), "{out} of {}", seeds.len());
}

/// YR-01, the published law: the robot touches walls at corners that it passes with the shipped
/// law, at a harmful speed.
#[test]
fn ye6_the_published_law_runs_into_corners() {
    let fielded = |scenario: &mut Scenario| {
        let law = toml::Spanned::new(0..0, "YR-01".to_owned());
        scenario.program.defects.push(law);
    };
    let failed = judged("yellow-reactive", 1, fielded);
    let is_contact = |check: &String| check.starts_with("no-collision-at-speed");
    assert!(failed.iter().any(is_contact), "{failed:?}");
}

/// A case repeats the mission's waits: maps, paths and targets are all equal.
#[test]
fn the_case_of_a_mission_that_waits_is_that_mission() {
    for name in few(1, ["yellow-map", "yellow-alike"]) {
        let (scenario, source) = shipped(name);
        let run = Run::new(scenario, &source, None).expect("can be wired");
        let outcome = run.finish();
        let again = Run::new(outcome.case.clone(), &source, None)
            .expect("can be wired")
            .finish();
        let checks = |outcome: &Outcome| {
            let checks = outcome.checks.iter();
            checks.map(ToString::to_string).collect::<Vec<_>>()
        };
        assert_eq!(again.trace_hash, outcome.trace_hash, "{name}");
        assert_eq!(checks(&again), checks(&outcome), "{name}");
    }
}

#[test]
fn ye10_a_labyrinth_with_forks_is_mapped_to_its_last_edge() {
    passes("yellow-map", [1, 2]);
}

#[test]
fn ye11_a_place_that_looks_like_others_is_told_and_found_from_elsewhere() {
    passes("yellow-alike", [1, 2]);
}

/// The pose that the PC sets after localising, 1.7 m away, is no motion of the wheels.
#[test]
fn a_pose_from_another_source_is_no_motion() {
    let (_, source) = shipped("yellow-alike");
    let safety = "violations_max = 0\n[expect.safety]\nmotion_within_percent = 5\n";
    let text = source.text.replace("violations_max = 0\n", safety);
    let (scenario, source) = Scenario::parse(&source.path, text).expect("sound");
    let outcome = Run::new(scenario, &source, None)
        .expect("can be wired")
        .finish();
    let mut checks = outcome.checks.iter();
    let motion = checks
        .find(|check| check.name == "motion-true")
        .expect("asked for");
    assert_eq!(motion.status, hilrig::run::check::Status::Pass, "{motion}");
}

/// Acceptance YE12: within 5 cm of four targets, one after the other, without a contact. Seed 4 saw
/// a wall in mid-air. Seed 6 ran into one after a long stretch by odometry alone. Seed 103 stood 33
/// mm beside a target, and the mission did not wait for it after the repeated order.
#[test]
fn ye12_targets_are_reached_within_5_cm_while_a_third_of_the_commands_is_lost() {
    passes("yellow-lost-commands", [4, 6, 103]);
}

/// A room that is completely visible from one position.
const ROOM: &str = r#"
schema = 1
name = "by-hand"
robot = "yellow"
duration = "40s"
[[mission.step]]
at = "1s"
do = { mode = "map" }
[[mission.step]]
when = { event = { rule = "map-done", source = "pc" } }
do = { mode = "go-to 1 0.9 90" }
[[mission.step]]
when = { event = { rule = "navigate-done", source = "pc" } }
do = { mode = "set-pose 5 -5 180" }
[world]
start = { x_m = 0.5, y_m = 0.5, heading_deg = 0 }
[[world.wall]]
path_m = [[0, 0], [1.5, 0], [1.5, 1.4], [0, 1.4], [0, 0]]
"#;

/// D2: a target with an orientation, within 5 cm and 0.06 rad, 3.4 degrees; and a pose set by hand,
/// which the robot accepts.
#[test]
fn d2_a_target_has_an_orientation_and_a_pose_can_be_given_by_hand() {
    let (scenario, source) = Scenario::parse(Path::new("<test>"), ROOM.to_owned()).expect("sound");
    let outcome = Run::new(scenario, &source, None)
        .expect("can be wired")
        .finish();
    let pair = outcome.pairs.last().expect("it drove");
    let [x, y] = [pair.truth.x - 1.0, pair.truth.y - 0.9];
    assert!(x.abs().max(y.abs()) < 0.05, "{:?}", pair.truth);
    let turned = (pair.truth.theta.to_degrees() - 90.0).abs();
    assert!(turned < 3.4, "{:?}", pair.truth);
    let believed = pair.estimate;
    assert!(
        (believed.x - 5.0).abs() < 0.01 && (believed.y + 5.0).abs() < 0.01,
        "{believed:?}"
    );
}

/// The speed behind the mode: from the order at 1 s the drivers need 0.6 s, so 3.4 s remain. In a
/// room of 8 m nothing ahead slows the robot.
#[test]
fn y056_the_reactive_drive_has_the_speed_of_its_order() {
    for speed in [0.1, 0.2, 0.5] {
        let text = format!(
            "schema = 1\nname = \"straight\"\nrobot = \"yellow\"\nduration = \"5s\"\n\
             [[mission.step]]\nat = \"1s\"\ndo = {{ mode = \"reactive {speed}\" }}\n[world]\n\
             start = {{ x_m = 0.5, y_m = 1, heading_deg = 0 }}\n[[world.wall]]\n\
             path_m = [[0, 0], [8, 0], [8, 2], [0, 2], [0, 0]]\n"
        );
        let (scenario, source) = Scenario::parse(Path::new("<straight>"), text).expect("sound");
        let run = Run::new(scenario, &source, None).expect("can be wired");
        let outcome = run.finish();
        let driven = outcome.pairs.last().expect("it drove").truth.x - 0.5;
        let seconds = driven / speed;
        assert!((3.2..3.6).contains(&seconds), "{speed} m/s: {driven} m");
    }
}

/// A labyrinth with a loop and a dead end, corridors of 0.6 m, and `more` before its world.
fn labyrinth(folder: &Path, seed: u64, more: &str) -> (Scenario, Source) {
    let text = format!(
        "schema = 1\nname = \"known-map\"\nrobot = \"yellow\"\nduration = \"120s\"\nseed = {seed}\n\
         {more}\n[world]\nstart = {{ x_m = 0.35, y_m = 0.35, heading_deg = 0 }}\n\
         [[world.wall]]\n\
         path_m = [[0.05, 0.05], [2.45, 0.05], [2.45, 1.85], [0.05, 1.85], [0.05, 0.05]]\n\
         [[world.wall]]\npath_m = [[1.85, 0.65], [0.65, 0.65], [0.65, 1.25]]\n\
         [[world.wall]]\npath_m = [[1.25, 1.25], [1.25, 1.85]]\n"
    );
    Scenario::parse(&folder.join("known-map.toml"), text).expect("sound")
}

/// B10 of the report: a map is saved and loaded. The first run maps the labyrinth; the second one
/// knows that map. Its robot is told a wrong pose, 2.7 m off and turned by 90 degrees, finds the
/// right one to 5 cm by one look, and drives to two goals, within 10 cm, without mapping. Its saved
/// case repeats it from another folder.
#[test]
fn y060_a_map_of_one_run_is_known_to_another() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("yellow-known-map");
    std::fs::create_dir_all(&folder).expect("a folder");
    let map = "[[mission.step]]\nat = \"1s\"\ndo = { mode = \"map\" }\n[[mission.step]]\n\
        when = { event = { rule = \"map-done\", source = \"pc\" } }\ndo = { mode = \"stop\" }\n";
    let (scenario, source) = labyrinth(&folder, 1, map);
    let run = Run::new(scenario, &source, None).expect("can be wired");
    let kept = run.finish().map.expect("it mapped");
    let image = render::ros_image(kept.view()).pgm();
    std::fs::write(folder.join("map.pgm"), image).expect("written");
    let yaml = render::ros_yaml(kept.view(), "map.pgm");
    std::fs::write(folder.join("map.yaml"), yaml).expect("written");

    let known = "[program]\nmap = \"map.yaml\"\n[[mission.step]]\nat = \"1s\"\n\
        do = { mode = \"set-pose 2.15 2.35 90\" }\n[[mission.step]]\nat = \"2s\"\n\
        do = { mode = \"localise\" }\n[[mission.step]]\n\
        when = { event = { rule = \"localise-done\", source = \"pc\" } }\n\
        do = { mode = \"navigate\" }\n[[mission.step]]\nwhen = { visited = 2 }\n\
        do = { mode = \"stop\" }\n[mission]\nwaypoints_m = [[2.15, 1.25], [0.35, 1.55]]\n\
        [expect]\nvisit_within_mm = 100\nviolations_max = 0\n";
    for seed in few(1, [2, 3, 4]) {
        let (scenario, source) = labyrinth(&folder, seed, known);
        let outcome = Run::new(scenario, &source, None)
            .expect("can be wired")
            .finish();
        assert_eq!(failures(&outcome), [""; 0], "seed {seed}");
        let rules: Vec<&str> = outcome
            .events
            .iter()
            .map(|logged| logged.event.rule)
            .collect();
        assert!(!rules.contains(&"map-done"), "{rules:?}");
        let pair = outcome.pairs.last().expect("it drove");
        let [x, y] = [
            pair.truth.x - pair.estimate.x,
            pair.truth.y - pair.estimate.y,
        ];
        assert!(x.abs().max(y.abs()) < 0.05, "seed {seed}: {pair:?}");

        let case = Path::new("/elsewhere/case.toml");
        let (case, source) = Scenario::parse(case, outcome.case.to_toml()).expect("sound");
        let again = Run::new(case, &source, None)
            .expect("can be wired")
            .finish();
        assert_eq!(again.trace_hash, outcome.trace_hash);
    }
}

/// The rule of the votes can be chosen: with the votes of the report, added, and with those of the
/// fielded program, the same robot takes another course; `multiplied` is the defect YP-11.
#[test]
fn y051_the_votes_of_a_localisation_can_be_chosen() {
    let folder = Path::new("votes");
    let hash = |program: &str| {
        let more = format!(
            "{program}\n[[mission.step]]\nat = \"1s\"\ndo = {{ mode = \"map\" }}\n\
             [[mission.step]]\nwhen = {{ event = {{ rule = \"map-done\", source = \"pc\" }} }}\n\
             do = {{ mode = \"localise\" }}\n[[mission.step]]\n\
             when = {{ event = {{ rule = \"localise-done\", source = \"pc\" }} }}\n\
             do = {{ mode = \"stop\" }}\n"
        );
        let (scenario, source) = labyrinth(folder, 1, &more);
        let run = Run::new(scenario, &source, None).expect("can be wired");
        run.finish().trace_hash
    };
    let usual = hash("");
    assert_eq!(hash("[program]\nvotes = \"best\""), usual);
    let added = hash("[program]\nvotes = \"added\"");
    let multiplied = hash("[program]\nvotes = \"multiplied\"");
    assert_eq!(hash("[program]\ndefects = [\"YP-11\"]"), multiplied);
    assert!(
        added != usual && multiplied != usual,
        "{added} {multiplied}"
    );
}
