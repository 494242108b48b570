//! How a guess moves: as the odometry says, with noise.

use core::f64::consts::PI;

use crate::ackermann::{CarPose, Motion, wrapped};
use crate::random::Pcg32;

/// Noise of a motion that is taken as a turn, a way and another turn; the roots of these figures
/// are the standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Of a turn by turning, per square radian.
    pub turn_by_turn: f64,
    /// Of a turn by the way, square radians per square metre.
    pub turn_by_way: f64,
    /// Of the way by the way.
    pub way_by_way: f64,
    /// Of the way by turning, square metres per square radian.
    pub way_by_turn: f64,
}

impl Default for Noise {
    /// As seed 003 set `amcl` up.
    fn default() -> Self {
        Self {
            turn_by_turn: 2.0,
            turn_by_way: 1.0,
            way_by_way: 0.5,
            way_by_turn: 0.5,
        }
    }
}

impl Noise {
    /// No noise.
    pub const NONE: Self = Self {
        turn_by_turn: 0.0,
        turn_by_way: 0.0,
        way_by_way: 0.0,
        way_by_turn: 0.0,
    };

    /// What a motion and its noise are, whichever guess makes it.
    pub(super) fn of(self, motion: Motion) -> Noisy {
        let way = libm::hypot(motion.ahead_m, motion.left_m);
        // The direction of a short way is nothing but noise.
        let first = match way < 0.01 {
            true => 0.0,
            false => libm::atan2(motion.left_m, motion.ahead_m),
        };
        let last = wrapped(motion.turn_rad - first);
        // Backwards is no turn round.
        let size = |turn: f64| turn.abs().min(PI - turn.abs());
        let (first_size, last_size) = (size(first), size(last));
        let by_way = way * way;
        let turned =
            |size: f64| libm::sqrt(self.turn_by_turn * size * size + self.turn_by_way * by_way);
        let sizes = first_size * first_size + last_size * last_size;
        Noisy {
            first,
            way,
            last,
            sigmas: [
                turned(first_size),
                libm::sqrt(self.way_by_way * by_way + self.way_by_turn * sizes),
                turned(last_size),
            ],
        }
    }
}

/// A motion as a turn, a way and another turn, and the standard deviation of each.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noisy {
    first: f64,
    way: f64,
    last: f64,
    sigmas: [f64; 3],
}

impl Noisy {
    /// The pose after the motion and its noise.
    pub(super) fn moved(self, pose: CarPose, random: &mut Pcg32) -> CarPose {
        let [first, way, last] = self.sigmas.map(|sigma| random.normal(sigma));
        let first = wrapped(self.first - first);
        let (sin, cos) = libm::sincos(pose.heading_rad + first);
        let way = self.way - way;
        CarPose {
            x_m: pose.x_m + way * cos,
            y_m: pose.y_m + way * sin,
            heading_rad: wrapped(pose.heading_rad + first + self.last - last),
        }
    }
}
