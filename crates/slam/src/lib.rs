//! The mapper for logs of scans and odometry from any recorder: CARMEN logs, our captures, MCAP
//! files, bags of ROS 2. The settings are the same for every log. The mapper is the robot's own
//! ([`survey`](mod@survey)), or the one for buildings ([`mapping`](mod@mapping), used by
//! [`tour`](mod@tour)), which closes loops.
//!
//! ```text
//! file -> Log: scans, each with the motion since the one before -> survey -> way, map, timing
//! ```

pub mod bag;
pub mod carmen;
pub mod finding;
pub mod folder;
pub mod look;
pub mod map;
pub mod mapping;
mod messages;
pub mod motion;
mod stamps;
pub mod survey;
pub mod tour;
pub mod trust;
pub mod tuning;
pub mod wire;

use emulators::world::Pose;
use firmware_core::pose::Point;
use firmware_core::scan::BEAMS;

pub use finding::Findings;

/// One scan of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Time of the scan, seconds of the log's clock; the number of the scan if that clock is
    /// unusable.
    pub at_s: f64,
    /// Odometry since the previous scan: metres and radians, in the frame of the previous pose.
    pub moved: Pose,
    /// Whether odometry was available; if not, the motion is unknown and small.
    pub is_measured: bool,
    /// End points of the beams in the robot's frame.
    pub points: Vec<Point>,
}

/// The content of a file of scans.
#[derive(Clone, Debug, Default)]
pub struct Log {
    /// Start pose of the path in the log: metres and radians.
    pub start: Pose,
    /// The usable scans in order.
    pub shots: Vec<Shot>,
    /// The unusable parts.
    pub findings: Findings,
    /// Assumptions, each as a sentence.
    pub notes: Vec<String>,
}

/// Minimum and maximum plausible range, metres.
pub(crate) const NEAREST_M: f64 = 0.05;
pub(crate) const FARTHEST_M: f64 = 50.0;
/// Maximum number of beams of a scan; a larger number is implausible.
pub(crate) const BEAMS_MAX: usize = 8192;

/// End points of beams with these ranges (m) and bearings (rad); `laser` is the pose of the laser
/// in the robot's frame at each beam. Ranges without a return are left out; if the mapper's limit
/// is exceeded, points are thinned evenly. The second value is the number of implausible ranges.
pub(crate) fn end_points(
    ranges: impl Iterator<Item = f64>,
    bearing: impl Fn(usize) -> f64,
    laser: impl Fn(usize) -> Pose,
    farthest_m: f64,
) -> (Vec<Point>, u32) {
    let mut absurd = 0;
    let mut points = Vec::new();
    for (index, range) in ranges.enumerate() {
        if !range.is_finite() || range < 0.0 {
            absurd += u32::from(!range.is_infinite() || range < 0.0);
            continue;
        }
        if range < NEAREST_M || range >= farthest_m.min(FARTHEST_M) {
            continue;
        }
        let laser = laser(index);
        let angle = laser.theta + bearing(index);
        let x_m = laser.x + range * libm::cos(angle);
        let y_m = laser.y + range * libm::sin(angle);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "metres of a room in single precision"
        )]
        points.push(Point::new((x_m * 1000.0) as f32, (y_m * 1000.0) as f32));
    }
    if points.len() > BEAMS {
        let all = points.len();
        points = (0..BEAMS)
            .map(|index| points[index * all / BEAMS])
            .collect();
    }
    (points, absurd)
}
