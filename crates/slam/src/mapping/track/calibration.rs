//! Calibration of the odometry against the laser, learned along the path: the scale of distances,
//! and the pose of the laser relative to the centre of rotation (Censi et al. 2013).
//!
//! A log rarely tells them. A scale error of 3 % stretches each corridor of the map. A laser 0.1 m
//! ahead of the centre of rotation moves sideways by 5 cm in a turn by 30 degrees.

use emulators::world::{Pose, wrap_angle};

use super::{Mapper, POOR, RARE};
use crate::mapping::Shot;
use crate::mapping::align::{Fit, Prior};
use crate::mapping::graph::bent;
use crate::mapping::matrix::{Matrix, ZERO, applied, diagonal, inverse, product, sum, transposed};
use crate::mapping::motion::{between, moved};

/// Systematic errors of the odometry.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Calibration {
    /// Scale error of distances, position of the laser ahead of the centre of rotation (metres),
    /// and heading of the laser to the right (radians).
    errors: [f64; 3],
    /// Normal equations of these errors.
    information: Matrix,
    right: [f64; 3],
}

/// The motion between two keyframes.
pub(super) struct Step {
    /// Poses found by alignment, and the odometry between them.
    pub(super) before: Pose,
    pub(super) after: Pose,
    pub(super) wheels: Pose,
    /// Information of the walls about the second pose, in the axes of the world.
    pub(super) walls: Matrix,
    /// Information of the odometry.
    pub(super) held: Matrix,
}

/// Standard deviations of the errors before any motion has taught them.
const UNTAUGHT: [f64; 3] = [0.02, 0.05, 0.01];
/// Scale error that the alignment itself could have. Good odometry has less, and over a building
/// each per mille counts.
const HIDDEN: f64 = 0.004;
/// Standard deviation of a step, metres; larger deviations have a lower weight.
const STEP_M: f64 = 0.03;
/// Squared deviations at which the weight falls to a quarter.
const FREE: f64 = 4.0;
/// Difference of heading above which the wheels have slipped, radians.
const SLIP_RAD: f64 = 0.1;
/// Minimum share of the walls in a position, in every direction. Along a corridor the odometry
/// determines the position, so a step there would only confirm the errors that were assumed.
const BY_WALLS: f64 = 0.7;

impl Calibration {
    /// The motion of the laser if the odometry says `by`.
    pub(super) fn corrected(&self, by: Pose) -> Pose {
        let [x, y, _] = applied(&transposed(&slopes(by)), self.errors);
        Pose::new(by.x + x, by.y + y, by.theta)
    }

    /// Learns from a step.
    pub(super) fn learn(&mut self, step: &Step) {
        let way = between(step.before, step.after);
        let turn = wrap_angle(way.theta - step.wheels.theta);
        let Some(gain) = gain(step).filter(|_| turn.abs() < SLIP_RAD) else {
            return;
        };
        // A wrong turn of the odometry grows along the step, so it bends the step by its half.
        let by = moved(Pose::new(0.0, 0.0, turn / 2.0), step.wheels);
        let by = Pose {
            theta: way.theta,
            ..by
        };
        let assumed = self.corrected(by);
        let off = [way.x - assumed.x, way.y - assumed.y, 0.0];
        let soft = 1.0 + (off[0] * off[0] + off[1] * off[1]) / (STEP_M * STEP_M * FREE);
        let weight = 1.0 / (STEP_M * STEP_M * soft * soft);
        // The alignment corrects only the share of an error that the walls show.
        let slopes = product(&slopes(by), &transposed(&gain));
        let seen = applied(&transposed(&slopes), self.errors);
        let seen = [0, 1, 2].map(|axis| weight * (off[axis] + seen[axis]));
        let right = applied(&slopes, seen);
        let weights = diagonal([weight, weight, 0.0]);
        let information = product(&product(&slopes, &weights), &transposed(&slopes));
        self.information = sum(&self.information, &information);
        (0..3).for_each(|error| self.right[error] += right[error]);
        let untaught = diagonal(UNTAUGHT.map(|deviation| 1.0 / (deviation * deviation)));
        if let Some(variance) = inverse(&sum(&self.information, &untaught)) {
            let [scale, ahead, heading] = applied(&variance, self.right);
            self.errors = [shrunk(scale, variance[0][0]), ahead, heading];
        }
    }
}

/// A scale error without the part that noise of this variance or the alignment may have caused.
fn shrunk(scale: f64, variance: f64) -> f64 {
    let squared = scale * scale;
    scale * squared / (squared + variance + HIDDEN * HIDDEN)
}

/// Change of the position behind a motion, by each of the errors; a row for each.
fn slopes(by: Pose) -> Matrix {
    let (sin, cos) = (libm::sin(by.theta), libm::cos(by.theta));
    [[by.x, by.y, 0.0], [cos - 1.0, sin, 0.0], [-by.y, by.x, 0.0]]
}

/// The share of the walls in a position, in the axes of the pose before the step; `None` if the
/// odometry determines a direction of it.
fn gain(step: &Step) -> Option<Matrix> {
    let walls = super::seen_from(step.before, &step.walls);
    let gain = product(&inverse(&sum(&walls, &step.held))?, &walls);
    let mut shares = ZERO;
    for (row, shares) in shares.iter_mut().take(2).enumerate() {
        shares[..2].copy_from_slice(&gain[row][..2]);
    }
    // The smaller eigenvalue of the symmetric part.
    let (xx, yy) = (shares[0][0], shares[1][1]);
    let xy = (shares[0][1] + shares[1][0]) / 2.0;
    let least = (xx + yy) / 2.0 - libm::hypot((xx - yy) / 2.0, xy);
    (least > BY_WALLS).then_some(shares)
}

impl Mapper {
    /// The pose of a scan predicted by odometry, with its uncertainty.
    pub(super) fn predicted(&self, shot: &Shot<'_>) -> Prior {
        let way = libm::hypot(shot.moved.x, shot.moved.y);
        let turn = shot.moved.theta.abs();
        let mut metres = 0.02 + 0.08 * way + 0.05 * turn;
        let mut radians = 0.01 + 0.03 * way + 0.10 * turn;
        if !shot.is_measured {
            metres += 0.1;
            radians += 0.1;
        }
        let noise = self.settings.noise;
        let [far, turned] = self.wheels.map(|wheels| wheels.max(RARE));
        let by = bent(shot.moved, self.bend.told());
        Prior {
            pose: moved(self.pose, self.calibration.corrected(by)),
            deviation: [
                (metres * far * noise).min(0.6),
                (radians * turned * noise).min(0.35),
            ],
        }
    }

    /// Learns the calibration of the odometry from the motion since the last keyframe, whose pose
    /// `fit` has aligned. Single scans would not do: until the next keyframe is drawn, all of them
    /// are aligned with the walls as the last one saw them, which holds them back.
    pub(super) fn calibrate(&mut self, fit: &Fit, held: Matrix) {
        let (from, wheels) = self.by_wheels.moved_since_stand();
        if fit.explained > POOR && self.by_wheels.is_whole {
            self.calibration.learn(&Step {
                before: moved(self.graph.poses[self.at], from),
                after: self.pose,
                wheels,
                walls: fit.information,
                held,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Odometry that reports 3 % too much, of a laser 0.1 m ahead that looks 0.01 rad to the right.
    const TRUE: [f64; 3] = [-0.03, 0.1, 0.01];

    /// 1,200 steps of 0.4 m, turning left and right, with these shares of walls along and across.
    /// An alignment leaves the rest of the error of the corrected odometry.
    fn taught(along: f64, across: f64) -> [f64; 3] {
        let mut calibration = Calibration::default();
        let shares = [along, across];
        for number in 0..1200 {
            let turn = [0.3, 0.0, -0.4, 0.1, -0.1][number % 5];
            let wheels = Pose::new(0.4, 0.4 * turn / 2.0, turn);
            let [x, y, _] = applied(&transposed(&slopes(wheels)), TRUE);
            let truth = Pose::new(wheels.x + x, wheels.y + y, turn);
            let assumed = calibration.corrected(wheels);
            let part = |share: f64, truth: f64, assumed: f64| assumed + share * (truth - assumed);
            calibration.learn(&Step {
                before: Pose::default(),
                after: Pose::new(
                    part(along, truth.x, assumed.x),
                    part(across, truth.y, assumed.y),
                    turn,
                ),
                wheels,
                walls: diagonal([
                    shares[0] / (1.0 - shares[0]),
                    shares[1] / (1.0 - shares[1]),
                    1.0,
                ]),
                held: diagonal([1.0, 1.0, 0.0]),
            });
        }
        calibration.errors
    }

    #[test]
    fn the_errors_of_the_odometry_are_learned_between_walls() {
        for (along, across) in [(0.99, 0.99), (0.8, 0.95)] {
            let errors = taught(along, across);
            for (error, truth) in errors.iter().zip(TRUE) {
                assert!((error - truth).abs() < 0.1 * truth.abs(), "{errors:?}");
            }
        }
    }

    #[test]
    fn a_corridor_teaches_nothing() {
        assert_eq!(taught(0.3, 0.99), [0.0; 3]);
    }

    /// In a turn by a quarter on the spot, a laser 0.1 m ahead moves 0.1 m back and 0.1 m to the
    /// left.
    #[test]
    fn a_laser_ahead_moves_in_a_turn_on_the_spot() {
        let calibration = Calibration {
            errors: [-0.03, 0.1, 0.0],
            ..Calibration::default()
        };
        let quarter = core::f64::consts::FRAC_PI_2;
        let moved = calibration.corrected(Pose::new(0.0, 0.0, quarter));
        assert!((moved.x + 0.1).abs() < 1e-12 && (moved.y - 0.1).abs() < 1e-12);
        let moved = calibration.corrected(Pose::new(1.0, 0.0, 0.0));
        assert!((moved.x - 0.97).abs() < 1e-12 && moved.y.abs() < 1e-12);
    }
}
