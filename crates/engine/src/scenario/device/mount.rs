//! Pose of a device on its robot.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::BuildContext;
use crate::scenario::ScenarioError;

/// Pose of a sensor on the robot, in the robot's own axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MountSpec {
    /// Position ahead of the middle of the robot, metres, -10 to 10; negative behind it.
    #[schemars(range(min = -10.0, max = 10.0))]
    pub x_m: f64,
    /// Position to the left of the middle of the robot, metres, -10 to 10; negative to the right.
    #[schemars(range(min = -10.0, max = 10.0))]
    pub y_m: f64,
    /// Rotation, degrees counter-clockwise seen from above, -360 to 360.
    #[schemars(range(min = -360.0, max = 360.0))]
    pub heading_deg: f64,
}

impl MountSpec {
    /// Whether all figures are in their ranges.
    pub(super) fn check(self, context: &BuildContext<'_>) -> Result<(), ScenarioError> {
        context.within("mount.x_m", Some(self.x_m), -10.0..=10.0)?;
        context.within("mount.y_m", Some(self.y_m), -10.0..=10.0)?;
        context.within("mount.heading_deg", Some(self.heading_deg), -360.0..=360.0)
    }
}
