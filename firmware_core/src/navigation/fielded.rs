//! The fielded program's heading: degrees, clockwise, never normalised to one turn.

use super::{Defects, Steering};
use crate::pose::{Pose, normalised};

/// The heading psi with all turns that the robot has made.
#[derive(Clone, Debug)]
pub(super) struct Psi {
    last: Option<f32>,
    psi_deg: f32,
}

impl Psi {
    pub(super) const fn new() -> Self {
        Self {
            last: None,
            psi_deg: 0.0,
        }
    }

    /// Updates psi to the robot's new `pose`.
    pub(super) fn turned(&mut self, pose: Pose) {
        self.psi_deg = match self.last {
            Some(last) => self.psi_deg - normalised(pose.heading - last).to_degrees(),
            None => psi_deg(pose.heading),
        };
        self.last = Some(pose.heading);
    }

    /// Wheel speeds for `way`, a bearing seen from `pose`.
    pub(super) fn steer(
        &self,
        defects: &Defects,
        steering: &Steering,
        pose: Pose,
        way: f32,
    ) -> [i8; 2] {
        let target_deg = psi_deg(pose.heading + way);
        if defects.counts_turns {
            steering.towards_psi(self.psi_deg, target_deg)
        } else if defects.wraps_one_side {
            steering.towards_psi(psi_deg(pose.heading), target_deg)
        } else {
            steering.towards(way)
        }
    }
}

/// Clockwise degrees within half a turn of 0.
fn psi_deg(heading: f32) -> f32 {
    normalised(core::f32::consts::PI - heading).to_degrees()
}
