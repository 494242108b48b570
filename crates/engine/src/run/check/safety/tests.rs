//! What the checkers of safety make of single moments; whole runs are in `tests/rig/safety.rs`.

use core::time::Duration;
use std::rc::Rc;

use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use emulators::{Event, EventKind};

use super::*;
use crate::robots::Figure;
use crate::robots::checker::{Look, Status};
use crate::robots::instruments::Unknown;

/// A robot that reported `told`, though it has `truth`.
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
        }]
    }
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

/// Half a volt is within the tolerance. The first report has no earlier truth beside it; three
/// wrong ones in a row are a failure, so the fourth look decides.
#[test]
fn three_wrong_reports_in_a_row_are_a_failure() {
    let told = |told, looks| {
        let telling = Telling { told, truth: 12.0 };
        observed(&mut TelemetryTrue::new(Rc::new(telling)), looks)
    };
    assert_eq!(told(12.5, 9).status, Status::Pass);
    assert_eq!(told(12.6, 3).status, Status::Pass);
    let wrong = told(12.6, 4);
    assert_eq!(wrong.status, Status::Fail);
    let detail = "at 0.040000 s the battery, V is reported as 12.60, it is 12.00";
    assert_eq!(wrong.detail, detail);
    let none = observed(&mut TelemetryTrue::new(Rc::new(Unknown)), 9);
    assert_eq!(none.status, Status::NotObserved);
}

/// A robot that names no link that it needs is not judged, and its verdict says which key is
/// missing.
#[test]
fn nothing_is_observed_without_links() {
    let within = Duration::from_secs(1);
    let mut rests = RestsAfterSilence::new(Vec::new(), Vec::new(), within);
    let check = observed(&mut rests, 3);
    assert_eq!(check.status, Status::NotObserved);
    assert!(check.detail.ends_with("set rests_without"));
    let mut says = NoticesSilence::new(&[], within);
    assert_eq!(observed(&mut says, 3).status, Status::NotObserved);
}

/// Two queues were full, and a wrong baud rate is none. Notes count as well: a device that only
/// notes it has lost bytes all the same.
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
