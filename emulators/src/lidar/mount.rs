//! Mounting position of a lidar on its robot, and direction of rotation.

/// Mounting position of the sensor on the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Metres ahead of the middle of the robot.
    pub x_m: f64,
    /// Metres to the left of it.
    pub y_m: f64,
    /// Bearing of the sensor's angle 0, degrees counter-clockwise from ahead.
    pub yaw_deg: f64,
}

impl Mount {
    /// At this place, turned by this angle counter-clockwise from where angle 90 looks ahead.
    pub const fn turned(x_m: f64, y_m: f64, heading_deg: f64) -> Self {
        let yaw_deg = heading_deg - 90.0;
        Self { x_m, y_m, yaw_deg }
    }
}

impl Default for Mount {
    /// In the middle, angle 90 ahead: the bearing of angle k is k - 90 degrees.
    fn default() -> Self {
        Self::turned(0.0, 0.0, 0.0)
    }
}

/// Direction of rotation of the head, seen from above.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// The direction that all sources give, except one.
    #[default]
    CounterClockwise,
    /// The opposite direction, which one source gives.
    Clockwise,
}
