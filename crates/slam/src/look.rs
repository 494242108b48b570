//! The state of a log while it is mapped, for observers such as the page.

use emulators::world::Pose;
use firmware_core::pose::{Pose as RobotPose, normalised};
use serde::Serialize;

use super::Shot;
use super::mapping::Sheet;

/// What is known after a scan.
#[derive(Clone, Copy)]
pub struct Look<'a> {
    /// Scans done.
    pub done: usize,
    /// The last of them.
    pub shot: &'a Shot,
    /// Where it was put: metres and radians in the log's frame.
    pub pose: Pose,
    /// How sure that is, of a mapper that says.
    pub sureness: Option<Sureness>,
    /// How far that is from where the wheels had put it, if it is far.
    pub jump: Option<Jump>,
    /// What the mapper has made of all scans so far.
    pub so_far: &'a dyn SoFar,
}

/// What a mapper has made of the scans so far.
pub trait SoFar {
    /// Where each was taken, by what is known now: metres and radians in the log's frame.
    fn way(&self) -> Vec<Pose>;

    /// The map of cells with this edge, metres, or of the edge that the mapper itself has.
    fn map(&self, cell_m: f64) -> Sheet;

    /// Keyframes.
    fn keyframes(&self) -> usize {
        0
    }

    /// Loop closures: both positions of the robot.
    fn loops(&self) -> Vec<[Pose; 2]> {
        Vec::new()
    }
}

/// A scan that the mapper put far from where the wheels had: half a metre, or a quarter of a right
/// angle. Either the wheels slipped, or the mapper is wrong from there on.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Jump {
    /// Time of the scan, seconds.
    pub at_s: f64,
    /// How far, metres.
    pub far_m: f64,
    /// How far turned, degrees.
    pub turned_deg: f64,
}

/// Less than this is no jump.
const JUMP_MM: f32 = 500.0;
const JUMP_RAD: f32 = core::f32::consts::FRAC_PI_8;

impl Jump {
    /// From where the wheels put the scan of `at_s` to where the mapper did.
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

/// How sure the pose of a scan is.
#[derive(Clone, Copy, Debug)]
pub struct Sureness {
    /// Part of the scan that lies on walls known before, 0 to 1.
    pub quality: f64,
    /// Standard deviations against those walls: metres along x and y, radians.
    pub deviation: [f64; 3],
    /// Whether the wheels were believed instead.
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
        // 0.4 rad, across half a turn: 22.9 degrees.
        let turned = to(1000.0, -2.883_185).expect("a jump");
        assert!((turned.turned_deg - 22.918).abs() < 0.01, "{turned:?}");
    }
}
