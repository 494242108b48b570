//! What the odometry says about a candidate: how unlikely its way from the prediction is.

use super::settings::MotionNoise;
use super::window::{REACH_MAX, Window};
use crate::pose::{Pose, PoseChange, normalised};

/// Motion reported since the last scan, and where it leads.
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

/// Way and turns since the last scan.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Travel {
    distance_mm: f32,
    turned: f32,
    unseen_mm: f32,
    unseen_rad: f32,
}

impl Travel {
    /// Not moved.
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

    /// Standard deviations of what the odometry did not see.
    pub(super) fn doubt(&mut self, unseen_mm: f32, unseen_rad: f32) {
        self.unseen_mm += unseen_mm;
        self.unseen_rad += unseen_rad;
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

    /// Nothing is known but where to look.
    pub(super) const fn none(predicted: Pose) -> Self {
        Self {
            predicted,
            per_mm2: 0.0,
            per_rad2: 0.0,
            cost: 0.0,
            cost_max: 0.0,
        }
    }

    /// The same without the bound for robots that were pushed.
    pub(super) const fn firm(&self) -> Self {
        Self {
            cost_max: f32::MAX,
            ..*self
        }
    }

    /// The same distrust around another pose: for one that won against the odometry.
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

    /// Mean map value that `pose` must win to be worth its way from the prediction.
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
