//! The content of minimised cases: five cases that fail for a known cause, each with irrelevant
//! elements.

use std::path::PathBuf;

use super::{Effort, Judged, scenario};
use crate::campaign;
use engine::scenario::{Scenario, Source};

/// Two rooms, a door of 80 cm at the top, a path through it. Harmless: an occasionally lost byte, a
/// pause, and a table leg in a corner.
const HARMLESS: &str = r#"
schema = 1
name = "known"
robot = "rescue"
duration = "25s"
[mission]
waypoints_m = [[0.8, 1.9], [2.2, 2.2]]
[expect]
visit_within_mm = 200
[world]
start = { x_m = 0.8, y_m = 1.4, heading_deg = 90 }
[[world.wall]]
path_m = [[0.2, 0.2], [2.8, 0.2], [2.8, 2.8], [0.2, 2.8], [0.2, 0.2]]
[[world.wall]]
path_m = [[1.5, 0.2], [1.5, 1.8]]
[[world.wall]]
path_m = [[1.5, 2.6], [1.5, 2.8]]
[[world.pillar]]
at_m = [[0.4, 0.4]]
radius_m = 0.03
[[fault]]
link = "lidar"
direction = "to-master"
kind = "drop"
byte = 9000
[[fault]]
link = "base"
direction = "to-master"
kind = "latency"
by = "1ms"
from = "2s"
until = "3s"
"#;

/// Number of tries for each case: enough to remove irrelevant elements.
const TRIES: u32 = 24;

fn cause_of(case: &Scenario) -> Option<String> {
    let source = Source {
        path: PathBuf::from("known"),
        text: String::new(),
    };
    let (record, _) = campaign::run(case, &source).expect("it can be wired");
    record.cause
}

/// Adds `culprit` to the harmless case, which then fails for a cause that begins with `begins`, and
/// minimises it. The result fails like the first case, and passes after `take_out` has removed the
/// culprit.
fn shrunk(culprit: &str, begins: &str, take_out: impl Fn(&mut Scenario)) -> Scenario {
    let text = format!("{HARMLESS}{culprit}");
    let (start, _) = Scenario::from_text(&text).expect("sound");
    let cause = &*cause_of(&start).expect("it fails");
    assert!(cause.starts_with(begins), "{cause}");
    let judge = |case: &Scenario| Judged::of(cause_of(case).as_deref(), cause);
    let small = scenario(&start, cause, judge, &mut Effort::tries(TRIES));
    assert!(
        small.fault.len() < 3 && small != start,
        "{}",
        small.to_toml()
    );
    assert_eq!(
        cause_of(&small).as_deref(),
        Some(cause),
        "{}",
        small.to_toml()
    );
    let mut cured = small.clone();
    take_out(&mut cured);
    assert_ne!(cured, small, "the culprit is gone: {}", small.to_toml());
    assert_eq!(cause_of(&cured), None, "{}", small.to_toml());
    small
}

/// Whether the whole suite runs, `HILRIG_TESTS=all`. A landing shrinks one failure of a link, one
/// of a device and one of the world.
fn is_whole() -> bool {
    std::env::var("HILRIG_TESTS").is_ok_and(|tests| tests == "all")
}

fn without_faults(case: &mut Scenario) {
    case.fault.clear();
}

#[test]
fn the_harmless_case_passes() {
    let (harmless, _) = Scenario::from_text(HARMLESS).expect("sound");
    assert_eq!(cause_of(&harmless), None);
}

/// The encoders count nothing: the robot turns and drives without measuring it.
#[test]
fn encoders_that_stick_stay_to_blame() {
    if !is_whole() {
        return;
    }
    let stuck = "[[fault]]\nkind = \"stuck\"\ndevice = \"base\"\nfrom = \"1s\"\n";
    let small = shrunk(stuck, "waypoints-visited: pose lost", without_faults);
    assert_eq!(small.fault[0].kind.name(), "stuck");
}

/// The robot receives no waypoints.
#[test]
fn a_radio_that_is_cut_for_ever_stays_to_blame() {
    let cut = "[[fault]]\nkind = \"cut\"\nlink = \"radio\"\ndirection = \"to-master\"\n";
    let small = shrunk(cut, "waypoints-visited: never moved", without_faults);
    assert_eq!(small.fault[0].kind.name(), "cut");
}

/// A pillar in the only door.
#[test]
fn an_obstacle_in_the_door_stays_to_blame() {
    let pillar = "[[world.pillar]]\nat_m = [[1.5, 2.2]]\nradius_m = 0.15\n";
    let is_in_the_door = |at: &[f64; 2]| *at == [1.5, 2.2];
    let small = shrunk(pillar, "waypoints-visited: ", |case| {
        let pillars = &mut case.world.pillar;
        pillars.retain(|pillar| !pillar.get_ref().at_m.iter().any(is_in_the_door));
    });
    // Without the other objects the robot may fail in another manner, so they may stay.
    let mut pillars = small.world.pillar.iter();
    assert!(pillars.any(|pillar| pillar.get_ref().at_m.iter().any(is_in_the_door)));
}

/// A lidar without any return.
#[test]
fn a_blinded_lidar_stays_to_blame() {
    let dark =
        "[[fault]]\nkind = \"device\"\ndevice = \"lidar\"\nfault = \"dark\"\nfrom = \"3s\"\n";
    let small = shrunk(dark, "waypoints-visited: standing still", without_faults);
    assert_eq!(small.fault[0].kind.name(), "device");
}

/// Motors without power.
#[test]
fn a_drive_that_is_off_stays_to_blame() {
    if !is_whole() {
        return;
    }
    let off = "[[fault]]\nkind = \"off\"\ndevice = \"base\"\nfrom = \"3s\"\n";
    let small = shrunk(off, "waypoints-visited: standing still", without_faults);
    assert_eq!(small.fault[0].kind.name(), "off");
}

/// A rule whose `after` lies behind the new end is never observed there. A sound program must pass
/// the small case, so the case does not require it; the rule of the failure stays required.
#[test]
fn rules_behind_the_new_end_are_not_required() {
    let rules = "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\nfrom = \"2s\"\n\
        [[expect.rule]]\nname = \"late\"\nafter = { visited = 1 }\n\
        always = { robot = { of = \"speed-m-s\", op = \"<\", value = 9 } }\n\
        [[expect.rule]]\nname = \"broken\"\nafter = { visited = 1 }\n\
        always = { robot = { of = \"speed-m-s\", op = \"<\", value = 9 } }\n";
    let text = format!("{HARMLESS}{rules}");
    let (start, _) = Scenario::from_text(&text).expect("sound");
    for (check, required) in [
        ("memory-intact", &[][..]),
        ("rule-broken", &["rule-broken"]),
    ] {
        let has_rules = |case: &Scenario| case.expect.rules().count() == 2;
        let judge = |case: &Scenario| match !case.fault.is_empty() && has_rules(case) {
            true => Judged::FailsAlike,
            false => Judged::Passes,
        };
        let cause = format!("{check}: broken");
        let small = scenario(&start, &cause, judge, &mut Effort::tries(TRIES));
        assert!(small.duration < start.duration, "{check}");
        let rules = small.expect.rules();
        let strict = rules.filter(|rule| rule.must_be_observed());
        let strict: Vec<String> = strict.map(engine::scenario::RuleSpec::check_name).collect();
        assert_eq!(strict, required);
    }
}

/// In a shorter run a lidar that is healed later is silent at the end, so the time is kept. If the
/// run fails for another reason, it need not be alive at the end.
#[test]
fn a_run_that_must_be_alive_keeps_its_time() {
    let culprit = "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\n\
        from = \"9s\"\n[expect.safety]\nalive_for = \"3s\"\n";
    let text = format!("{HARMLESS}{culprit}").replace("duration = \"25s\"", "duration = \"16s\"");
    let text = text.replace("[mission]\n", "[mission]\nto_the_end = true\n");
    let text = text.replace("visit_within_mm = 200\n", "");
    let (start, _) = Scenario::from_text(&text).expect("sound");
    let cause = "alive-at-the-end: silent";
    let fails = |case: &Scenario| match case.expect.safety.as_ref()?.alive_for {
        Some(_) if !case.fault.is_empty() => Some(cause),
        _ => None,
    };
    let judge = |case: &Scenario| Judged::of(fails(case), cause);
    let small = scenario(&start, cause, judge, &mut Effort::tries(TRIES));
    assert_eq!(small.duration, start.duration);
    assert!(
        small
            .expect
            .safety
            .is_some_and(|safety| safety.alive_for.is_some())
    );

    let other = "program-alive: stops";
    let judge = |case: &Scenario| match case.fault.is_empty() {
        true => Judged::Passes,
        false => Judged::FailsAlike,
    };
    let small = scenario(&start, other, judge, &mut Effort::tries(TRIES));
    assert!(small.duration < start.duration);
    assert!(
        small
            .expect
            .safety
            .is_none_or(|safety| safety.alive_for.is_none())
    );
}
