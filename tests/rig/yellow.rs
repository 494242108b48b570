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
fn nineteen_of_twenty_leave_the_labyrinth_by_infrared_alone() {
    let mut out = 0;
    for seed in 0..20 {
        let failed = judged("yellow-reactive", seed, |_| {});
        let is_contact = |check: &&String| check.starts_with("no-collision");
        assert_eq!(failed.iter().find(is_contact), None, "seed {seed}");
        out += u32::from(failed.is_empty());
    }
    assert!(out >= 19, "{out} of 20");
}

#[test]
fn a_labyrinth_with_forks_is_mapped_to_its_last_edge() {
    passes("yellow-map", [1, 2]);
}

#[test]
fn a_place_that_looks_like_others_is_told_and_found_from_elsewhere() {
    passes("yellow-alike", [1, 2]);
}

/// Not steady yet: of the first six seeds three end beside the last target, find no way, or touch
/// a wall while they map. It is to become all of them; it must not become fewer.
#[test]
fn targets_are_reached_while_a_third_of_the_commands_is_lost_on_half_of_the_seeds() {
    let passed = (1..=6).filter(|seed| judged("yellow-lost-commands", *seed, |_| {}).is_empty());
    let passed = passed.count();
    assert!(passed >= 3, "{passed} of 6");
}
