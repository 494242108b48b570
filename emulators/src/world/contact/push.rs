//! Pushes: motion of the body by hand, besides its wheels.

use core::time::Duration;

use crate::world::body::STEP_S;
use crate::world::geometry::{Point, Pose};

/// Speed limits of a push.
const PUSH_MAX_M_S: f64 = 5.0;
const TWIST_MAX_RAD_S: f64 = 20.0;

/// Hands that move the robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::world) struct Push {
    /// Speed and turn rate of the push.
    rate: Pose,
    steps_left: u64,
}

impl Push {
    pub(in crate::world) fn add(&mut self, by: Pose, over: Duration) {
        assert!(by.is_finite(), "a push by a distance that is not finite");
        let left = steps_f64(self.steps_left) * STEP_S;
        let total = Pose::new(
            by.x + self.rate.x * left,
            by.y + self.rate.y * left,
            by.theta + self.rate.theta * left,
        );
        let way = Point::default().distance(total.point());
        let least_s = (way / PUSH_MAX_M_S).max(total.theta.abs() / TWIST_MAX_RAD_S);
        let seconds = over.as_secs_f64().max(least_s).max(STEP_S);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates"
        )]
        let steps = (seconds / STEP_S).ceil() as u64;
        let span = steps_f64(steps) * STEP_S;
        self.rate = Pose::new(total.x / span, total.y / span, total.theta / span);
        self.steps_left = steps;
    }

    /// Speed and turn rate that the push adds to the next step.
    pub(in crate::world) fn step(&mut self) -> (Point, f64) {
        if self.steps_left == 0 {
            return (Point::default(), 0.0);
        }
        self.steps_left -= 1;
        (self.rate.point(), self.rate.theta)
    }
}

#[expect(
    clippy::cast_precision_loss,
    reason = "exact for the first 285,000 years"
)]
fn steps_f64(steps: u64) -> f64 {
    steps as f64
}
