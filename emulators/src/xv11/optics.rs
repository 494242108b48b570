//! Where the sensor sits, how its optics are built, and the laws its readings follow.
//!
//! Figures marked (A) are from the 2.4 "hand in box" capture, (B) from the 2.1 "no shield" ones.

/// Where the sensor sits on the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Metres ahead of the middle of the robot.
    pub x_m: f64,
    /// Metres to the left of it.
    pub y_m: f64,
    /// Bearing of the sensor's angle 0, degrees counter-clockwise from ahead.
    pub yaw_deg: f64,
}

impl Default for Mount {
    /// In the middle, angle 90 ahead: the bearing of angle k is k - 90 degrees.
    fn default() -> Self {
        Self {
            x_m: 0.0,
            y_m: 0.0,
            yaw_deg: -90.0,
        }
    }
}

/// Which way the head turns, seen from above.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// As every report but one says.
    #[default]
    CounterClockwise,
    /// As that one says.
    Clockwise,
}

/// Geometry of the optics. Nobody has documented it with certainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Angle of the first reading to the axis of the housing, degrees; the wiki says -10 or 0.
    pub index0_deg: f64,
    /// Distance between laser beam and axis, millimetres; reports say 0 to 25.
    pub beam_offset_mm: f64,
    /// Which way the head turns.
    pub direction: Direction,
    /// Distance between laser and camera, millimetres. Before a near object that comes into view
    /// (A) and (B) show one to three readings without a dot: the camera, ahead of the beam in
    /// the sense of rotation, does not see the far dot past the near edge.
    pub baseline_mm: f64,
}

impl Default for Optics {
    fn default() -> Self {
        Self {
            index0_deg: 0.0,
            beam_offset_mm: 0.0,
            direction: Direction::CounterClockwise,
            baseline_mm: 38.0,
        }
    }
}

/// Beyond this there is no dot.
pub const RANGE_MAX_MM: f64 = 6_000.0;
/// Nearer than this the dot is too wide: the runs of 0x03 in (A) and (B) begin and end at 144 to
/// 154 mm.
pub const RANGE_MIN_MM: f64 = 145.0;
/// Strength warning: below this strength at this distance, never beyond the last (A, B).
const WARNING: [(f64, f64); 9] = [
    (160.0, 300.0),
    (200.0, 230.0),
    (240.0, 230.0),
    (300.0, 150.0),
    (340.0, 150.0),
    (400.0, 85.0),
    (460.0, 60.0),
    (540.0, 50.0),
    (650.0, 50.0),
];

/// Standard deviation of a range, millimetres: fit over (A) and (B), extrapolated beyond 3.3 m.
pub fn range_sigma_mm(distance_mm: f64) -> f64 {
    (2.0e-6 * distance_mm * distance_mm).max(0.3)
}

/// Mean strength of a return from a white surface, 1.0e8 / d^2: fit over (A) and (B).
pub fn strength_mean(distance_mm: f64) -> f64 {
    1.0e8 / (distance_mm * distance_mm)
}

/// Whether a return of this strength at this distance carries the strength warning.
pub fn is_weak(distance_mm: f64, strength: f64) -> bool {
    let after = WARNING.partition_point(|&(mm, _)| mm <= distance_mm);
    let threshold = match after {
        0 => WARNING[0].1,
        n if n == WARNING.len() => return false,
        n => {
            let ((x0, y0), (x1, y1)) = (WARNING[n - 1], WARNING[n]);
            y0 + (y1 - y0) * (distance_mm - x0) / (x1 - x0)
        }
    };
    strength < threshold
}
