use super::Defects;
use crate::pose::Pose;

/// Settings of the robot before it starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Pose of the robot at power-on: its odometry starts there.
    pub start: Pose,
    /// Enabled defects of the fielded program, see [`Config::with_defect`].
    pub defects: Defects,
}

impl Config {
    /// The robot at the origin, without a defect. A constant, so that the robot can be a `static`.
    pub const DEFAULT: Self = Self {
        start: Pose {
            x_mm: 0.0,
            y_mm: 0.0,
            heading: 0.0,
        },
        defects: Defects::NONE,
    };
}

impl Default for Config {
    fn default() -> Self {
        Self::DEFAULT
    }
}
