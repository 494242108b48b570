//! The robot's body in physics: a drive train and the colliding parts.
//!
//! ```text
//! command -> chassis: dead zone, full speed, lag -> wheel speed -> encoder counts
//!                                                       |
//!                                 slip, noise, geometry -> speed and turn rate of the body
//! ```
//!
//! | module | is |
//! |---|---|
//! | [`chassis`] | the contract of every drive train, its actuators and commands |
//! | [`differential`] | two driven wheels on one axle |
//! | [`ackermann`] | a car: a driven rear axle and a steering servo |
//! | [`footprint`] | disc or outline that collides |

pub mod ackermann;
pub mod chassis;
pub mod differential;
pub mod footprint;
mod motor;

pub use ackermann::{Ackermann, AckermannConfig, Floor, SteeringLaw};
pub use chassis::{
    Actuator, ActuatorKind, Chassis, Command, CommandError, Encoder, Select, Velocity,
};
pub use differential::{BodyConfig, BodyError, Differential, Wheel};
pub use footprint::{Footprint, FootprintError, Outline};
pub use motor::{Drive, Reversing};

use super::geometry::{Point, Pose};

/// Length of one step of the physics.
pub(super) const STEP_NANOS: u64 = 1_000_000;
/// Length of one step of the physics, seconds.
pub(super) const STEP_S: f64 = 1e-3;
/// Steps for which one draw of the noise holds. Wheel slip changes with the floor, not within a
/// millisecond; drawing seldom also makes it nearly free.
const NOISE_STEPS: u64 = 20;

/// Motion of the body during one step: an arc, and pushes over the floor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    /// Pose at the beginning of the step.
    pub(super) start: Pose,
    /// Forward, m/s.
    pub(super) speed: f64,
    /// Counter-clockwise, rad/s.
    pub(super) turn: f64,
    /// Velocity of a push, m/s, in world axes.
    pub(super) drift: Point,
}

impl Motion {
    /// The motion of a body at rest.
    pub(super) fn rest(start: Pose) -> Self {
        Self {
            start,
            ..Self::default()
        }
    }

    /// The pose after `after` seconds: exact for constant speed and turn rate. The chord of an arc
    /// of angle 2h is shorter than the arc by sin(h) / h. The series ends below rounding here.
    pub(super) fn pose(&self, after: f64) -> Pose {
        if self.speed == 0.0 && self.turn == 0.0 && self.drift == Point::default() {
            return self.start;
        }
        let half = 0.5 * self.turn * after;
        let square = half * half;
        let chord = self.speed * after * (1.0 - square / 6.0 * (1.0 - square / 20.0));
        let (sin, cos) = libm::sincos(self.start.theta + half);
        Pose {
            x: self.start.x + chord * cos + self.drift.x * after,
            y: self.start.y + chord * sin + self.drift.y * after,
            theta: self.start.theta + self.turn * after,
        }
    }

    /// The motion with the same turn and `part` of the distance.
    pub(super) fn slowed(self, part: f64) -> Self {
        let drift = Point::new(self.drift.x * part, self.drift.y * part);
        Self {
            speed: self.speed * part,
            drift,
            ..self
        }
    }

    /// The first `part` of the motion, on the same arc.
    pub(super) fn shortened(self, part: f64) -> Self {
        let turn = self.turn * part;
        Self {
            turn,
            ..self.slowed(part)
        }
    }

    /// Speed over the floor, m/s.
    pub(super) fn floor_speed(&self) -> f64 {
        let (sin, cos) = libm::sincos(self.start.theta);
        let velocity = Point::new(
            self.speed * cos + self.drift.x,
            self.speed * sin + self.drift.y,
        );
        Point::default().distance(velocity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is(found: Pose, x: f64, y: f64, theta: f64) -> bool {
        let way = found.point().distance(Point::new(x, y));
        way < 1e-9 && (found.theta - theta).abs() < 1e-12
    }

    /// A radian a second at 1 m/s is a circle of 1 m: after 0.1 s the body is at (sin, 1 - cos).
    #[test]
    fn a_motion_is_an_arc_and_a_push() {
        let motion = Motion {
            speed: 1.0,
            turn: 1.0,
            ..Motion::rest(Pose::default())
        };
        assert!(is(
            motion.pose(0.1),
            libm::sin(0.1),
            1.0 - libm::cos(0.1),
            0.1
        ));
        let turned = Motion {
            start: Pose::new(1.0, 2.0, core::f64::consts::FRAC_PI_2),
            ..motion
        };
        assert!(is(
            turned.pose(0.1),
            libm::cos(0.1),
            2.0 + libm::sin(0.1),
            1.670_796_326_794_896_6
        ));
        let pushed = Motion {
            drift: Point::new(0.5, -2.0),
            ..Motion::rest(Pose::new(1.0, 2.0, 0.3))
        };
        assert!(is(pushed.pose(0.5), 1.25, 1.0, 0.3));
        let spins = Motion {
            turn: -2.0,
            ..Motion::rest(Pose::new(1.0, 2.0, 0.3))
        };
        assert!(is(spins.pose(0.1), 1.0, 2.0, 0.1));
        assert!(is(
            Motion::rest(Pose::new(1.0, 2.0, 0.3)).pose(9.0),
            1.0,
            2.0,
            0.3
        ));
    }

    #[test]
    fn a_motion_is_slowed_or_shortened() {
        let motion = Motion {
            start: Pose::default(),
            speed: 3.0,
            turn: 1.0,
            drift: Point::new(0.0, 4.0),
        };
        let slowed = motion.slowed(0.5);
        assert_eq!(
            (slowed.speed, slowed.turn, slowed.drift),
            (1.5, 1.0, Point::new(0.0, 2.0))
        );
        let shortened = motion.shortened(0.5);
        assert_eq!((shortened.speed, shortened.turn), (1.5, 0.5));
        assert!((motion.floor_speed() - 5.0).abs() < 1e-12);
        let turned = Motion {
            start: Pose::new(0.0, 0.0, core::f64::consts::FRAC_PI_2),
            ..motion
        };
        assert!((turned.floor_speed() - 7.0).abs() < 1e-12);
    }
}
