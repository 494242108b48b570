//! The robot yellow in whole runs: its four shipped scenarios over a few seeds, and what a fielded
//! law or a dead PC does to them.

use hilrig::run::Run;
use hilrig::scenario::Scenario;

use super::{failures, shipped};

fn judged(name: &str, seed: u64, change: impl FnOnce(&mut Scenario)) -> Vec<String> {
    let (mut scenario, source) = shipped(name);
    scenario.seed = seed;
    change(&mut scenario);
    let run = Run::new(scenario, &source, None).expect("can be wired");
    failures(&run.finish())
}

fn passes(name: &str, seeds: impl IntoIterator<Item = u64>) {
    for seed in seeds {
        assert_eq!(judged(name, seed, |_| {}), [""; 0], "{name}, seed {seed}");
    }
}

/// Acceptance YE6: of 20 seeds 19 leave the labyrinth, none touches a wall.
#[test]
fn ye6_nineteen_of_twenty_leave_the_labyrinth_by_infrared_alone() {
    let mut out = 0;
    for seed in 0..20 {
        let failed = judged("yellow-reactive", seed, |_| {});
        let is_contact = |check: &&String| check.starts_with("no-collision");
        assert_eq!(failed.iter().find(is_contact), None, "seed {seed}");
        out += u32::from(failed.is_empty());
    }
    assert!(out >= 19, "{out} of 20");
}

/// YR-01, the published law: it touches walls at the corners that ours passes, faster than a touch
/// that does no harm.
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

#[test]
fn ye10_a_labyrinth_with_forks_is_mapped_to_its_last_edge() {
    passes("yellow-map", [1, 2]);
}

#[test]
fn ye11_a_place_that_looks_like_others_is_told_and_found_from_elsewhere() {
    passes("yellow-alike", [1, 2]);
}

/// Acceptance YE12: within 5 cm of four targets, one after the other, without a contact. Seed 4 saw
/// a wall in mid-air, 6 ran into one after a long stretch by odometry alone, 103 stood 33 mm beside
/// a target and was not waited for when it was told again.
#[test]
fn ye12_targets_are_reached_within_5_cm_while_a_third_of_the_commands_is_lost() {
    passes("yellow-lost-commands", [4, 6, 103]);
}
