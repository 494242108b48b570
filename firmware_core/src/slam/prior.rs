//! Likelihood of a candidate by odometry: how unlikely its distance from the prediction is.

use super::settings::MotionNoise;
use super::window::{REACH_MAX, Window};
use crate::pose::{Pose, PoseChange, normalised};

/// Motion reported since the last scan, and the predicted pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prior {
    pub(super) predicted: Pose,
    /// One over the variance of the position, per square millimetre.
    per_mm2: f32,
    /// One over the variance of the heading, per square radian.
    per_rad2: f32,
    pub(super) cost: f32,
    pub(super) cost_max: f32,
}

/// Distance and turns since the last scan.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Travel {
    distance_mm: f32,
    turned: f32,
    unseen_mm: f32,
    unseen_rad: f32,
}

impl Travel {
    /// No travel.
    pub(super) const NONE: Self = Self {
        distance_mm: 0.0,
        turned: 0.0,
        unseen_mm: 0.0,
        unseen_rad: 0.0,
    };
}

impl Travel {
    pub(super) fn add(&mut self, change: PoseChange) {
        self.distance_mm += change.distance_mm();
        self.turned += change.turn.abs();
    }

    /// Adds standard deviations of motion that the odometry did not see.
    pub(super) fn doubt(&mut self, unseen_mm: f32, unseen_rad: f32) {
        self.unseen_mm += unseen_mm;
        self.unseen_rad += unseen_rad;
    }

    /// Whether there may be more motion than the odometry saw.
    pub(super) fn is_vague(&self) -> bool {
        self.unseen_mm > 0.0 || self.unseen_rad > 0.0
    }
}

impl Prior {
    pub(super) fn new(predicted: Pose, travel: Travel, noise: &MotionNoise, cell_mm: f32) -> Self {
        let mm = noise.rest_cells * cell_mm
            + noise.per_mm * travel.distance_mm
            + noise.mm_per_rad * travel.turned
            + travel.unseen_mm;
        let rad = noise.rest_rad
            + noise.per_rad * travel.turned
            + noise.rad_per_mm * travel.distance_mm
            + travel.unseen_rad;
        Self {
            predicted,
            per_mm2: 1.0 / (mm * mm),
            per_rad2: 1.0 / (rad * rad),
            cost: noise.cost,
            cost_max: noise.cost_max,
        }
    }

    /// A prior without odometry, around `predicted`.
    pub(super) const fn none(predicted: Pose) -> Self {
        Self {
            predicted,
            per_mm2: 0.0,
            per_rad2: 0.0,
            cost: 0.0,
            cost_max: 0.0,
        }
    }

    /// The same prior without the bound for pushed robots.
    pub(super) const fn firm(&self) -> Self {
        Self {
            cost_max: f32::MAX,
            ..*self
        }
    }

    /// The same uncertainty around another pose, which won against the odometry.
    pub(super) const fn around(&self, predicted: Pose) -> Self {
        Self { predicted, ..*self }
    }

    /// The poses within three standard deviations.
    pub(super) fn window(&self, cell_mm: f32, turn_step: f32) -> Window {
        let steps = |variance_inverse: f32, step: f32| {
            #[expect(clippy::cast_possible_truncation, reason = "clamped")]
            let steps =
                libm::ceilf(3.0 / libm::sqrtf(variance_inverse) / step).clamp(1.0, 24.0) as i32;
            steps
        };
        Window {
            reach: steps(self.per_mm2, cell_mm).min(REACH_MAX),
            turns: steps(self.per_rad2, turn_step),
            turn_step,
        }
    }

    /// Mean map value that `pose` must gain to justify its distance from the prediction.
    #[inline]
    pub(super) fn uncapped_cost(&self, pose: Pose) -> f32 {
        let deviations = self.deviation_x(pose.x_mm)
            + self.deviation_y(pose.y_mm)
            + self.deviation_heading(pose.heading);
        deviations * self.cost
    }

    /// Squared standard deviations from the predicted x.
    #[inline]
    pub(super) fn deviation_x(&self, x_mm: f32) -> f32 {
        let way = x_mm - self.predicted.x_mm;
        way * way * self.per_mm2
    }

    /// Squared standard deviations from the predicted y.
    #[inline]
    pub(super) fn deviation_y(&self, y_mm: f32) -> f32 {
        let way = y_mm - self.predicted.y_mm;
        way * way * self.per_mm2
    }

    /// Squared standard deviations from the predicted heading.
    #[inline]
    pub(super) fn deviation_heading(&self, heading: f32) -> f32 {
        let turn = normalised(heading - self.predicted.heading);
        turn * turn * self.per_rad2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: distances of the two motions 30 mm and hypot(12, 16) = 20 mm; turns 0.3 and 0.2
    /// rad; unseen motion 10 mm and 0.02 rad. Deviation of the position: 0.5 * 50 + 0.1 * 50 + 20 *
    /// 0.5 + 10 = 50 mm. Deviation of the heading: 0.01 + 0.2 * 0.5 + 0.001 * 50 + 0.02 = 0.18 rad.
    fn prior(cell_mm: f32) -> Prior {
        let noise = MotionNoise {
            rest_cells: 25.0 / cell_mm,
            per_mm: 0.1,
            mm_per_rad: 20.0,
            rest_rad: 0.01,
            per_rad: 0.2,
            rad_per_mm: 0.001,
            cost: 2.0,
            cost_max: 15.0,
        };
        let mut travel = Travel::NONE;
        let change = PoseChange {
            forward_mm: 30.0,
            left_mm: 0.0,
            turn: -0.3,
        };
        travel.add(change);
        let change = PoseChange {
            forward_mm: -12.0,
            left_mm: 16.0,
            turn: 0.2,
        };
        travel.add(change);
        travel.doubt(4.0, 0.01);
        travel.doubt(6.0, 0.01);
        Prior::new(Pose::new(1_000.0, 2_000.0, 3.1), travel, &noise, cell_mm)
    }

    /// By hand, squares of offset over deviation: distances of 30 mm and 40 mm give 0.36 and 0.64.
    /// A turn of 0.0832 rad across pi, with a deviation of 0.18, gives 0.2136. The cost is twice
    /// the sum.
    #[test]
    fn leaving_the_prediction_costs_by_the_square() {
        let prior = prior(50.0);
        let near = |one: f32, other: f32| (one - other).abs() < 1e-3;
        assert!(near(prior.deviation_x(970.0), 0.36) && near(prior.deviation_y(2_040.0), 0.64));
        assert!(near(prior.deviation_heading(-3.1), 0.2136));
        let cost = prior.uncapped_cost(Pose::new(1_030.0, 1_960.0, -3.1));
        assert!(near(cost, 2.0 * 1.2136), "{cost}");
        assert_eq!((prior.cost_max, prior.firm().cost_max), (15.0, f32::MAX));
        let around = prior.around(Pose::new(0.0, 0.0, 0.0));
        assert!(near(around.deviation_x(50.0), 1.0));
        let none = Prior::none(prior.predicted);
        assert_eq!(none.uncapped_cost(Pose::new(0.0, 0.0, 0.0)), 0.0);
    }

    /// Three deviations are 150 mm and 0.54 rad: 2.7 cells of 55 mm, 10.8 steps of 0.05 rad; at
    /// most 15 and 24, at least one.
    #[test]
    fn the_window_holds_three_standard_deviations() {
        let window = |cell_mm, turn_step| {
            let window = prior(cell_mm).window(cell_mm, turn_step);
            assert_eq!(window.turn_step, turn_step);
            (window.reach, window.turns)
        };
        assert_eq!(window(55.0, 0.05), (3, 11));
        assert_eq!(window(5.0, 0.01), (15, 24));
        assert_eq!(window(400.0, 1.0), (1, 1));
    }
}
