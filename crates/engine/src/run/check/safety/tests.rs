//! Verdicts of the safety checkers on single moments; whole runs are in `tests/rig/safety.rs`.

use core::time::Duration;
use std::sync::Arc;

use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use emulators::{Event, EventKind};

use super::*;
use crate::robots::Figure;
use crate::robots::checker::{Look, Status};
use crate::robots::instruments::Unknown;

/// A robot that reported `told` while the true value is `truth`.
struct Telling {
    told: f64,
    truth: f64,
}

impl Instruments for Telling {
    fn figures(&self, rig: &Rig) -> Vec<Figure> {
        vec![Figure {
            name: "the battery, V",
            at: rig.now(),
            told: self.told,
            truth: self.truth,
            tolerance: 0.5,
            wrong_min: Figure::CHANGING,
        }]
    }
}

fn nowhere() -> Scenario {
    let text = "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"60s\"\n\
        [world]\nstart = { x_m = 1, y_m = 1, heading_deg = 0 }\n";
    Scenario::from_text(text).expect("sound").0
}

fn rig() -> Rig {
    let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("empty");
    let body = BodyConfig::default().ideal();
    Rig::new(World::new(scene, body, Pose::default(), 1).expect("free"))
}

fn observed(checker: &mut dyn Checker, looks: u64) -> Check {
    let mut rig = rig();
    for look in 1..=looks {
        rig.run_until(Instant::from_millis(10 * look));
        checker.observe(&Look {
            rig: &rig,
            axes: &[],
            contacts: &[],
        });
    }
    checker.verdict()
}

/// Half a volt is within the tolerance. The first report has no earlier true value; three wrong
/// reports in a row are a failure, so the fourth update decides.
#[test]
fn three_wrong_reports_in_a_row_are_a_failure() {
    let told = |told, looks| {
        let telling = Telling { told, truth: 12.0 };
        observed(
            &mut TelemetryTrue::new(Arc::new(telling), Calm::default()),
            looks,
        )
    };
    assert_eq!(told(12.5, 9).status, Status::Pass);
    assert_eq!(told(12.6, 3).status, Status::Pass);
    let wrong = told(12.6, 4);
    assert_eq!(wrong.status, Status::Fail);
    let detail = "at 0.040000 s the battery, V is reported as 12.60, the true value is 12.00";
    assert_eq!(wrong.detail, detail);
    let none = observed(
        &mut TelemetryTrue::new(Arc::new(Unknown), Calm::default()),
        9,
    );
    assert_eq!(none.status, Status::NotObserved);
}

/// A robot without needed links is not judged, and the verdict names the missing key.
#[test]
fn nothing_is_observed_without_links() {
    let within = Duration::from_secs(1);
    let mut rests = RestsAfterSilence::new(Vec::new(), Vec::new(), Calm::default(), within);
    let check = observed(&mut rests, 3);
    assert_eq!(check.status, Status::NotObserved);
    assert!(check.detail.ends_with("set rests_without"));
    let unknown: Arc<dyn Instruments> = Arc::new(Unknown);
    let mut says = NoticesSilence::listening(&nowhere(), &mut rig(), &unknown, within);
    assert_eq!(observed(&mut says, 3).status, Status::NotObserved);
}

/// Two queues overflowed; a wrong baud rate does not count. Notes count as well, because a device
/// that only notes an overflow has also lost bytes.
#[test]
fn queues_that_overflowed_are_counted() {
    let mut rig = rig();
    for (kind, rule) in [
        (EventKind::Violation, "fifo-overflow"),
        (EventKind::Violation, "baud"),
        (EventKind::Note, "overrun"),
    ] {
        let event = Event {
            at: Instant::from_millis(5),
            kind,
            rule,
            detail: "64 bytes".to_owned(),
            bytes: Vec::new(),
        };
        rig.log("radio", event);
    }
    let judged = |most| overruns(most, &rig, rig.events());
    assert_eq!(judged(2).status, Status::Pass);
    let check = judged(1);
    assert_eq!(check.status, Status::Fail);
    assert!(
        check
            .detail
            .starts_with("2 queues overflowed, at most 1; first: "),
        "{}",
        check.detail
    );
    assert!(check.detail.contains("fifo-overflow"), "{}", check.detail);
}

fn in_a_room(duration: &str, more: &str) -> String {
    format!(
        "schema = 1\nname = \"r\"\nrobot = \"rescue\"\nduration = \"{duration}\"\n{more}\
         [mission]\nto_the_end = true\nwaypoints_m = [[1.5, 2.2], [0.8, 1.5]]\n\
         [world]\nstart = {{ x_m = 0.8, y_m = 1.4, heading_deg = 90 }}\n[[world.wall]]\n\
         path_m = [[0.2, 0.2], [2.8, 0.2], [2.8, 2.8], [0.2, 2.8], [0.2, 0.2]]\n"
    )
}

fn named(outcome: crate::run::Outcome, name: &str) -> Check {
    let mut checks = outcome.checks.into_iter();
    let found = checks.find(|check| check.name == name);
    found.expect("it is asked for")
}

/// A link that was never needed, or never silent, proves nothing. A lidar that falls silent while
/// the robot drives does. A PC that only manual driving needs is not named.
#[test]
fn only_silences_of_needed_links_are_observed() {
    let judged = |fault: &str| {
        let safety = "[expect.safety]\nrests_within = \"1s\"\n";
        let text = in_a_room("9s", &format!("{fault}{safety}"));
        named(
            crate::run::judge(&text).expect("sound"),
            "rests-after-silence",
        )
    };
    let calm = judged("");
    assert_eq!(calm.status, Status::NotObserved, "{}", calm.detail);
    let cut = "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\n\
        from = \"5s\"\n";
    let dark = judged(cut);
    assert_eq!(dark.status, Status::Pass, "{}", dark.detail);
    assert!(
        dark.detail.ends_with("silences of lidar"),
        "{}",
        dark.detail
    );
}

/// The mode of a foreign program is unknown, and so are the links that only some modes need.
#[test]
fn what_a_mode_needs_is_unknown_without_a_mode() {
    let rows = [
        (Need::always("a"), [true, true, true]),
        (Need::always("a").only(&["x"]), [true, false, false]),
        (Need::always("a").except(&["x"]), [false, true, false]),
    ];
    for (need, expected) in rows {
        let needed = [Some("x"), Some("y"), None].map(|mode| need.is_needed(mode));
        assert_eq!(needed, expected, "{need:?}");
    }
}

/// Along a wall the car needs its board, and not its camera.
#[test]
fn a_car_along_a_wall_needs_its_board() {
    let text = include_str!("../../../../../../scenarios/apollo13-wall.toml");
    for (link, expected) in [("car", Status::Pass), ("scan", Status::NotObserved)] {
        let text = format!(
            "{text}\n[expect.safety]\nrests_within = \"1s\"\n[[fault]]\nkind = \"cut\"\n\
             link = \"{link}\"\ndirection = \"to-master\"\nfrom = \"3s\"\n"
        );
        let (mut scenario, source) = Scenario::from_text(&text).expect("sound");
        scenario.duration = crate::scenario::Span::from_millis(6_000);
        let run = crate::run::Run::new(scenario, &source, None).expect("sound");
        let check = named(run.finish(), "rests-after-silence");
        assert_eq!(check.status, expected, "{link}: {}", check.detail);
    }
}

/// A lidar that was never at work has not fallen silent. Garbage before a silence is already
/// counted.
#[test]
fn only_a_device_at_work_falls_silent() {
    let cut = |from: &str| {
        format!(
            "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\n\
             from = \"{from}\"\n"
        )
    };
    let garbage = "[[fault]]\nkind = \"device\"\ndevice = \"lidar\"\nfault = \"garbage\"\n";
    let rows = [
        (cut("4s"), Status::Pass),
        (
            format!("{garbage}from = \"4s\"\n{}", cut("6500ms")),
            Status::Pass,
        ),
        (
            format!("{garbage}from = \"0s\"\n{}", cut("6500ms")),
            Status::NotObserved,
        ),
    ];
    for (faults, expected) in rows {
        let text = in_a_room(
            "10s",
            &format!("{faults}[expect.safety]\nsays_within = \"3s\"\n"),
        );
        let outcome = crate::run::judge(&text).expect("sound");
        let check = named(outcome, "notices-silence");
        assert_eq!(check.status, expected, "{faults}{}", check.detail);
    }
}

/// A lidar whose head stops again and again from its start sends valid frames, but no turn with a
/// distance. It was never at work, so the cut of its cable is no new failure.
#[test]
fn a_lidar_that_was_never_at_work_cannot_fall_silent() {
    let judged = |faults: &str| {
        let safety = "[expect.safety]\nsays_within = \"3s\"\n";
        let text = in_a_room("20s", &format!("{faults}{safety}"));
        let outcome = crate::run::judge(&text).expect("sound");
        named(outcome, "notices-silence")
    };
    let cut =
        "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\nfrom = \"12s\"\n";
    let stuck = "[[fault]]\nkind = \"stuck\"\ndevice = \"lidar\"\nfrom = \"661ms\"\n\
                 lasting = \"265ms\"\nevery = \"736ms\"\n";
    for (faults, expected) in [
        (cut.to_owned(), Status::Pass),
        (format!("{stuck}{cut}"), Status::NotObserved),
    ] {
        let check = judged(&faults);
        assert_eq!(check.status, expected, "{faults}{}", check.detail);
    }
}

/// The program sends nothing to this lidar. Bytes that come back to it for six seconds are an echo:
/// when it ends, no line of the program has fallen silent.
#[test]
fn an_echo_is_no_line_at_work() {
    let echo = "[[fault]]\nkind = \"echo\"\nlink = \"lidar\"\ndirection = \"to-master\"\n\
                from = \"2s\"\nuntil = \"8s\"\n";
    let safety = "[expect.safety]\nalive_for = \"4s\"\nalive_without = [\"radio\", \"pc\"]\n";
    let text = in_a_room("16s", &format!("{echo}{safety}"));
    let check = named(crate::run::judge(&text).expect("sound"), "alive-at-the-end");
    let is_blamed = check.detail.contains("lidar to-device");
    assert!(
        check.status != Status::NotObserved && !is_blamed,
        "{}",
        check.detail
    );
}
