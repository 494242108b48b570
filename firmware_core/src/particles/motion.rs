//! Motion of a guess: that of the odometry, with noise.

use core::f64::consts::PI;

use crate::ackermann::{CarPose, Motion, wrapped};
use crate::random::Pcg32;

/// Noise of a motion, taken as a turn, a distance and another turn; the square roots of these
/// figures are the standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Variance of a turn from turning, per square radian.
    pub turn_by_turn: f64,
    /// Variance of a turn from the distance, square radians per square metre.
    pub turn_by_way: f64,
    /// Variance of the distance from the distance.
    pub way_by_way: f64,
    /// Variance of the distance from turning, square metres per square radian.
    pub way_by_turn: f64,
}

impl Default for Noise {
    /// The noise of `amcl` in seed 003.
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

    /// Parts of a motion and their noise, equal for all guesses.
    pub(super) fn of(self, motion: Motion) -> Noisy {
        let way = libm::hypot(motion.ahead_m, motion.left_m);
        // The direction of a short motion is only noise.
        let first = match way < 0.01 {
            true => 0.0,
            false => libm::atan2(motion.left_m, motion.ahead_m),
        };
        let last = wrapped(motion.turn_rad - first);
        // Driving backwards is not a turn by pi.
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

/// A motion as a turn, a distance and another turn, and the standard deviation of each.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(noise: Noise, ahead_m: f64, left_m: f64, turn_rad: f64) -> [f64; 6] {
        let noisy = noise.of(Motion {
            ahead_m,
            left_m,
            turn_rad,
        });
        let [first, way, last] = noisy.sigmas;
        [noisy.first, noisy.way, noisy.last, first, way, last]
    }

    fn assert_near(found: [f64; 6], expected: [f64; 6]) {
        let is_near = found
            .iter()
            .zip(expected)
            .all(|(one, other)| (one - other).abs() < 1e-3);
        assert!(is_near, "{found:?}, expected {expected:?}");
    }

    /// By hand: 3 ahead and 4 to the left are a motion of 5 in the direction 0.9273. The whole turn
    /// is 1.0, so 0.0727 remain for the second turn. Standard deviations: first turn
    /// sqrt(2 * 0.9273^2 + 25) = 5.169, second turn sqrt(2 * 0.0727^2 + 25) = 5.001, distance
    /// sqrt(0.5 * 25 + 0.5 * (0.8599 + 0.0053)) = 3.596.
    #[test]
    fn a_motion_is_a_turn_a_way_and_a_turn_with_noise() {
        let seed = Noise::default();
        assert_near(
            parts(seed, 3.0, 4.0, 1.0),
            [0.9273, 5.0, 0.0727, 5.169, 3.596, 5.001],
        );
        // Driving backwards is no turn: only the distance makes noise.
        let back = parts(seed, -2.0, 0.0, 0.0);
        assert_near(back.map(f64::abs), [PI, 2.0, PI, 2.0, 2_f64.sqrt(), 2.0]);
        // A motion of 9 mm has no direction, one of 11 mm has.
        let short = |way| parts(Noise::NONE, 0.0, way, 0.3);
        assert_near(short(0.009), [0.0, 0.009, 0.3, 0.0, 0.0, 0.0]);
        assert_near(
            short(0.011),
            [PI / 2.0, 0.011, 0.3 - PI / 2.0, 0.0, 0.0, 0.0],
        );
        // A turn on the spot by 0.4 rad: variances of 2 * 0.16 for the turn and 0.5 * 0.16 for the
        // distance.
        let spot = parts(seed, 0.0, 0.0, 0.4);
        assert_near(spot, [0.0, 0.0, 0.4, 0.0, 0.08_f64.sqrt(), 0.32_f64.sqrt()]);
    }

    /// 1,000 guesses that move 1 m with a deviation of 0.5 m, and turn by 0.2 rad at the end only:
    /// mean and variance within four standard errors.
    #[test]
    fn guesses_spread_as_the_noise_says() {
        let mut random = Pcg32::new(9);
        let noise = Noise {
            turn_by_turn: 1.0,
            way_by_way: 0.25,
            ..Noise::NONE
        };
        let motion = Motion {
            ahead_m: 1.0,
            left_m: 0.0,
            turn_rad: 0.2,
        };
        let noisy = noise.of(motion);
        let mut sums = [0.0; 4];
        for _ in 0..1_000 {
            let pose = noisy.moved(CarPose::default(), &mut random);
            assert_eq!(pose.y_m, 0.0);
            let (way, turn) = (pose.x_m - 1.0, pose.heading_rad - 0.2);
            for (sum, one) in sums.iter_mut().zip([way, way * way, turn, turn * turn]) {
                *sum += one / 1_000.0;
            }
        }
        let [way, ways, turn, turns] = sums;
        assert!(
            way.abs() < 0.064 && (ways - 0.25_f64).abs() < 0.045,
            "{sums:?}"
        );
        assert!(
            turn.abs() < 0.026 && (turns - 0.04_f64).abs() < 0.0072,
            "{sums:?}"
        );
    }
}
