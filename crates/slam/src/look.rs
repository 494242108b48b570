//! The state of a log while it is mapped, for observers such as the page.

use emulators::world::Pose;
use firmware_core::pose::{Pose as RobotPose, normalised};
use serde::Serialize;

use super::Shot;
use super::mapping::Sheet;

/// The state after a scan.
#[derive(Clone, Copy)]
pub struct Look<'a> {
    /// Number of processed scans.
    pub done: usize,
    /// The last scan.
    pub shot: &'a Shot,
    /// The pose of the last scan: metres and radians in the log's frame.
    pub pose: Pose,
    /// The uncertainty of the pose, if the mapper computes it.
    pub sureness: Option<Sureness>,
    /// The difference from the odometry, if it is large.
    pub jump: Option<Jump>,
    /// The result so far.
    pub so_far: &'a dyn SoFar,
}

/// The result of a mapper so far.
pub trait SoFar {
    /// The current estimate of each scan's pose: metres and radians in the log's frame.
    fn way(&self) -> Vec<Pose>;

    /// The map with cells of this edge, metres, or of the mapper's own resolution.
    fn map(&self, cell_m: f64) -> Sheet;

    /// Number of keyframes.
    fn keyframes(&self) -> usize {
        0
    }

    /// Loop closures, as pairs of robot poses.
    fn loops(&self) -> Vec<[Pose; 2]> {
        Vec::new()
    }
}

/// A scan for which mapper and odometry differ by half a metre or a quarter of a right angle.
/// Either the wheels slipped, or the mapper is wrong from there on.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Jump {
    /// Time of the scan, seconds.
    pub at_s: f64,
    /// Distance, metres.
    pub far_m: f64,
    /// Difference in heading, degrees.
    pub turned_deg: f64,
}

/// Minimum difference of a jump.
const JUMP_MM: f32 = 500.0;
const JUMP_RAD: f32 = core::f32::consts::FRAC_PI_8;

impl Jump {
    /// The difference between the odometry and the mapper for the scan at `at_s`, if it is a jump.
    pub(super) fn between(at_s: f64, wheels: RobotPose, mapper: RobotPose) -> Option<Self> {
        let far_mm = wheels.position().distance_mm(mapper.position());
        let turned_rad = normalised(mapper.heading - wheels.heading);
        (far_mm >= JUMP_MM || turned_rad.abs() >= JUMP_RAD).then(|| Self {
            at_s,
            far_m: f64::from(far_mm) / 1000.0,
            turned_deg: f64::from(turned_rad).to_degrees(),
        })
    }
}

/// The uncertainty of a scan's pose.
#[derive(Clone, Copy, Debug)]
pub struct Sureness {
    /// Share of the scan that lies on known walls, 0 to 1.
    pub quality: f64,
    /// Standard deviations relative to those walls: x and y in metres, heading in radians.
    pub deviation: [f64; 3],
    /// Whether the odometry was used instead.
    pub is_doubtful: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_metre_or_an_eighth_of_half_a_turn_is_a_jump() {
        let wheels = RobotPose::new(1000.0, 1000.0, 3.0);
        let to = |x, heading| Jump::between(7.0, wheels, RobotPose::new(x, 1000.0, heading));
        assert!(to(1499.0, 3.0).is_none() && to(1000.0, 3.39).is_none());
        let far = to(1500.0, 3.0).expect("a jump");
        assert!((far.at_s - 7.0).abs() < 1e-9 && (far.far_m - 0.5).abs() < 1e-6);
        // 0.4 rad across the discontinuity at half a turn: 22.9 degrees.
        let turned = to(1000.0, -2.883_185).expect("a jump");
        assert!((turned.turned_deg - 22.918).abs() < 0.01, "{turned:?}");
    }
}
