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

#[cfg(test)]
mod tests {
    use super::*;

    /// Speed along x, turn rate, and number of the steps of a push.
    fn steps(push: &mut Push) -> (f64, f64, usize) {
        let mut count = 0;
        let mut rate = (0.0, 0.0);
        while push.steps_left > 0 {
            let (point, turn) = push.step();
            rate = (point.x, turn);
            count += 1;
        }
        assert_eq!(push.step(), (Point::default(), 0.0));
        (rate.0, rate.1, count)
    }

    fn pushed(x: f64, theta: f64, millis: u64) -> (f64, f64, usize) {
        let mut push = Push::default();
        push.add(Pose::new(x, 0.0, theta), Duration::from_millis(millis));
        steps(&mut push)
    }

    /// A metre and half a radian in half a second. A push is not faster than 5 m/s and 20 rad/s,
    /// and not shorter than a step.
    #[test]
    fn a_push_lasts_as_long_as_its_limits_need() {
        assert_eq!(pushed(1.0, 0.5, 500), (2.0, 1.0, 500));
        assert_eq!(pushed(10.0, 0.0, 1_000), (5.0, 0.0, 2_000));
        assert_eq!(pushed(0.0, -40.0, 1_000), (0.0, -20.0, 2_000));
        assert_eq!(pushed(0.001, 0.0, 0), (1.0, 0.0, 1));
    }

    /// Half of a metre is left after 250 of 500 steps; with half a metre more it is a metre, in the
    /// time of the second push.
    #[test]
    fn a_second_push_adds_to_the_rest_of_the_first() {
        let mut push = Push::default();
        push.add(Pose::new(1.0, 0.0, 0.5), Duration::from_millis(500));
        for _ in 0..250 {
            push.step();
        }
        push.add(Pose::new(0.5, 0.0, 0.0), Duration::from_secs(1));
        let (speed, turn, count) = steps(&mut push);
        assert!(
            (speed - 1.0).abs() < 1e-9 && (turn - 0.25).abs() < 1e-9,
            "{speed} {turn}"
        );
        assert_eq!(count, 1_000);
    }
}
