//! Turns of a lidar from the bytes of its link, for page and export.

/// A beam with a measured distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Counter-clockwise from straight ahead of the robot, radians.
    pub bearing: f64,
    /// From the middle of the robot, metres.
    pub distance_m: f64,
}

impl Beam {
    /// The same from the middle of the robot, measured by a lidar that sits at `x_m`, `y_m` on the
    /// robot.
    pub(super) fn seen_from(self, [x_m, y_m]: [f64; 2]) -> Self {
        if [x_m, y_m] == [0.0; 2] {
            return self;
        }
        let x = x_m + self.distance_m * libm::cos(self.bearing);
        let y = y_m + self.distance_m * libm::sin(self.bearing);
        Self {
            bearing: libm::atan2(y, x),
            distance_m: libm::hypot(x, y),
        }
    }
}

/// Assembles whole turns from a lidar's bytes.
pub trait ScanDecoder: Send {
    /// Takes more bytes; the last turn that they completed, if any.
    fn push(&mut self, bytes: &[u8]) -> Option<Vec<Beam>>;
}
