//! The manner of a failure, from the robot's motion: one check can fail for many reasons.

use core::time::Duration;

use emulators::world::{Pose, wrap_angle};
use protocols::Instant;

use engine::run::{Outcome, is_of_the_end};

/// The last part of an unfinished mission that is examined.
const END: Duration = Duration::from_secs(15);
/// The time before a contact that is examined.
const BEFORE: Duration = Duration::from_millis(300);
/// A robot is lost if its believed pose differs more than this from its true pose, metres and
/// radians. A waypoint counts as reached within 20 cm.
const LOST_M: f64 = 0.15;
const LOST_RAD: f64 = 0.26;
/// A robot within this range is at rest, metres and radians. A robot that moves more, but less than
/// its own length, makes no progress.
const REST_M: f64 = 0.02;
const REST_RAD: f64 = 0.1;
const TO_AND_FRO_M: f64 = 0.3;

/// The manner in which `outcome` failed `check`; `None` if the check does not concern the robot's
/// motion.
pub(super) fn of(check: &str, outcome: &Outcome) -> Option<&'static str> {
    let end = Instant::ZERO + outcome.ran;
    if is_of_the_end(check) && check != "map-received" && check != "wall-overlap" {
        return Some(match way(outcome, end, END) {
            _ if is_lost(outcome, end) => "pose lost",
            Way::Rest if way(outcome, end, outcome.ran) == Way::Rest => "never moved",
            Way::Rest => "standing still",
            Way::ToAndFro => "to and fro",
            Way::Far => "under way",
        });
    }
    let (true, Some(at)) = (check == "no-collision-at-speed", outcome.collided_at) else {
        return None;
    };
    Some(match way(outcome, at, BEFORE) {
        _ if is_lost(outcome, at) => "pose lost",
        Way::Rest => "standing still",
        _ => "driving",
    })
}

/// Whether the last pose that the program reported before `at` was wrong.
fn is_lost(outcome: &Outcome, at: Instant) -> bool {
    let mut before = outcome.pairs.iter().rev();
    let newest = before.find(|pair| pair.at <= at);
    newest.is_some_and(|pair| {
        pair.error_mm() > LOST_M * 1000.0 || pair.error_deg() > LOST_RAD.to_degrees()
    })
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    Rest,
    ToAndFro,
    Far,
}

/// The robot's motion in the `span` before `until`.
fn way(outcome: &Outcome, until: Instant, span: Duration) -> Way {
    let is_then = |at: Instant| at <= until && until - at <= span;
    let mut poses = outcome.truth.iter().filter(|(at, _)| is_then(*at));
    way_of(poses.by_ref().map(|(_, pose)| *pose))
}

fn way_of(mut poses: impl Iterator<Item = Pose>) -> Way {
    let Some(first) = poses.next() else {
        return Way::Rest;
    };
    let (mut far_m, mut turned) = (0.0_f64, 0.0_f64);
    for pose in poses {
        far_m = far_m.max(pose.point().distance(first.point()));
        turned = turned.max(wrap_angle(pose.theta - first.theta).abs());
    }
    match far_m {
        _ if far_m <= REST_M && turned <= REST_RAD => Way::Rest,
        _ if far_m <= TO_AND_FRO_M => Way::ToAndFro,
        _ => Way::Far,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn way_along(poses: [[f64; 3]; 3]) -> Way {
        way_of(
            poses
                .into_iter()
                .map(|[x, y, theta]| Pose::new(x, y, theta)),
        )
    }

    /// Neither turning on the spot nor moving 10 cm counts as rest.
    #[test]
    fn resting_turning_and_driving_are_told_apart() {
        assert_eq!(
            way_along([[1.0, 1.0, 3.1], [1.0, 1.01, -3.13], [1.0, 1.0, 3.1]]),
            Way::Rest
        );
        assert_eq!(
            way_along([[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [1.0, 1.0, 0.0]]),
            Way::ToAndFro
        );
        assert_eq!(
            way_along([[1.0, 1.0, 0.0], [1.1, 1.0, 0.0], [1.0, 1.0, 0.0]]),
            Way::ToAndFro
        );
        assert_eq!(
            way_along([[1.0, 1.0, 0.0], [1.4, 1.0, 0.0], [1.0, 1.0, 0.0]]),
            Way::Far
        );
    }
}
