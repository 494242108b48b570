//! What the odometry says about a candidate: how unlikely its way from the prediction is.

use super::settings::MotionNoise;
use crate::pose::{Pose, PoseChange, normalised};

/// Motion reported since the last scan, and where it leads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prior {
    pub(super) predicted: Pose,
    /// One over the variance of the position, per square millimetre.
    pub(super) per_mm2: f32,
    /// One over the variance of the heading, per square radian.
    pub(super) per_rad2: f32,
    cost: f32,
    cost_max: f32,
}

/// Way and turns since the last scan.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Travel {
    distance_mm: f32,
    turned: f32,
}

impl Travel {
    pub(super) fn add(&mut self, change: PoseChange) {
        self.distance_mm += change.distance_mm();
        self.turned += change.turn.abs();
    }
}

impl Prior {
    pub(super) fn new(predicted: Pose, travel: Travel, noise: &MotionNoise) -> Self {
        let mm = noise.rest_mm + noise.per_mm * travel.distance_mm;
        let rad =
            noise.rest_rad + noise.per_rad * travel.turned + noise.rad_per_mm * travel.distance_mm;
        Self {
            predicted,
            per_mm2: 1.0 / (mm * mm),
            per_rad2: 1.0 / (rad * rad),
            cost: noise.cost,
            cost_max: noise.cost_max,
        }
    }

    /// Mean map value that `pose` must win to be worth its way from the prediction.
    #[inline]
    pub(super) fn cost(&self, pose: Pose) -> f32 {
        let (dx, dy) = (
            pose.x_mm - self.predicted.x_mm,
            pose.y_mm - self.predicted.y_mm,
        );
        let turn = normalised(pose.heading - self.predicted.heading);
        let deviations = (dx * dx + dy * dy) * self.per_mm2 + turn * turn * self.per_rad2;
        (deviations * self.cost).min(self.cost_max)
    }
}
