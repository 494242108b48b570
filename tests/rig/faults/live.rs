//! Faults added to, and removed from, a running run.

use core::time::Duration;
use std::path::Path;

use hilrig::rig::fault::FaultId;
use hilrig::run::{FaultState, Run};
use hilrig::scenario::{DirectionSpec, FaultSpec, Scenario};
use protocols::Instant;

use crate::{in_a_room, run_to_end, start};

const DRIVES: &str = "[program]\nstart_mode = \"exploration\"\n";

/// A fault from its keys, as a client requests it.
fn asked(keys: &str) -> FaultSpec {
    toml::from_str(keys).expect("a fault")
}

fn cut() -> FaultSpec {
    asked("link = \"base\"\ndirection = \"to-device\"\nkind = \"cut\"\n")
}

fn states(run: &Run) -> Vec<FaultState> {
    run.faults().map(|report| report.state).collect()
}

fn is_driving(run: &Run) -> bool {
    run.rig.world.is_moving()
}

/// The bus is cut while the robot drives, and mended later: the base stops the robot (its watchdog
/// of 1 s), and the robot drives again.
#[test]
fn a_fault_added_to_a_running_rig_acts_from_now_on_until_withdrawn() {
    let mut run = start(in_a_room("60s", DRIVES));
    run.go_on_until(Instant::from_secs(10));
    assert!(is_driving(&run));
    let id = run.inject(cut()).expect("sound");
    assert_eq!(states(&run), [FaultState::Active]);
    run.go_on_until(Instant::from_secs(13));
    assert!(!is_driving(&run));
    run.withdraw(id).expect("active");
    assert_eq!(states(&run), [FaultState::Over]);
    run.go_on_until(Instant::from_secs(16));
    assert!(is_driving(&run));

    let window = run.case().fault[0].window();
    assert_eq!(window.from, Instant::from_nanos(10_000_000_001));
    assert_eq!(window.until, Instant::from_nanos(13_000_000_001));
}

/// Faults added by a person leave a case that needs no person: it gives the same bytes and the same
/// faults, in virtual time.
#[test]
fn a_case_with_faults_added_by_hand_runs_again_as_it_ran() {
    let mut run = start(in_a_room("20s", DRIVES));
    run.go_on_until(Instant::from_secs(5));
    let rate = "link = \"lidar\"\ndirection = \"to-master\"\nkind = \"flip\"\nrate = 0.001\n";
    let flips = run.inject(asked(rate)).expect("sound");
    run.go_on_until(Instant::from_millis(8_003));
    run.inject(cut()).expect("sound");
    run.go_on_until(Instant::from_millis(8_500));
    run.withdraw(FaultId(1)).expect("active");
    run.withdraw(flips).expect("active");
    let outcome = run.finish();
    assert!(outcome.case.fault.len() > 5, "the dice must have fallen");

    let saved = outcome.case.to_toml();
    let again = run_to_end(Scenario::parse(Path::new("case.toml"), saved).expect("sound"));
    assert_eq!(again.trace_hash, outcome.trace_hash);
    assert_eq!(again.case.fault, outcome.case.fault);
}

/// By hand: the lidar's line has 22 bytes a packet and some 9,900 bytes a second. Within 10 s it
/// has not sent byte 100,000, so the flip is still planned and stays in the case.
#[test]
fn damage_that_is_still_to_come_stays_in_the_case() {
    let mut run = start(in_a_room("10s", DRIVES));
    let mut strike = asked("link = \"lidar\"\ndirection = \"to-master\"\nkind = \"drop\"\n");
    strike.byte = Some(10_000_000);
    run.inject(strike.clone()).expect("sound");
    run.go_on_until(Instant::from_secs(1));
    assert_eq!(states(&run), [FaultState::Planned]);
    assert_eq!(run.case().fault, [strike.clone()]);
    run.withdraw(FaultId(0)).expect("to come");
    assert_eq!(run.case().fault, []);

    strike.byte = Some(0);
    let flaw = run.inject(strike).expect_err("has passed");
    assert_eq!(flaw.key, "byte");
    assert!(flaw.message.starts_with("is 0, expected a later byte: "));
}

#[test]
fn a_fault_that_makes_no_sense_changes_nothing() {
    let mut run = start(in_a_room("10s", ""));
    run.rig.run_for(Duration::from_secs(1));
    let mut fault = cut();
    fault.link = Some("bus".to_owned());
    let flaw = run.inject(fault).expect_err("no such link").to_string();
    let expected = "link: is \"bus\", expected one of lidar, motor, base";
    assert!(flaw.starts_with(expected), "{flaw}");
    let mut fault = cut();
    fault.direction = Some(DirectionSpec::ToMaster);
    fault.until = Some("1s".parse().expect("a span"));
    assert_eq!(run.inject(fault).expect_err("in the past").key, "until");
    assert_eq!(run.withdraw(FaultId(0)).expect_err("none").key, "id");
    assert_eq!(run.faults().count(), 0);
}
