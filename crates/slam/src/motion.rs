//! Poses and motions in double precision: metres and radians.

use emulators::world::Pose;
use firmware_core::pose::PoseChange;

pub use crate::mapping::motion::{between, moved};

/// A motion in the units of the robot's program.
#[expect(
    clippy::cast_possible_truncation,
    reason = "the program works in single precision"
)]
pub fn change(by: Pose) -> PoseChange {
    PoseChange {
        forward_mm: (by.x * 1000.0) as f32,
        left_mm: (by.y * 1000.0) as f32,
        turn: by.theta as f32,
    }
}
