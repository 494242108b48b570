//! Errors of a world.

use core::fmt;

use super::body::BodyError;
use super::geometry::Pose;

/// Reason why a world cannot start.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum WorldError {
    /// A figure of the body is out of range.
    Body(BodyError),
    /// The start pose is NaN or infinite.
    StartNotFinite,
    /// At the start the body would stand in a wall.
    StartBlocked {
        /// The given start.
        start: Pose,
        /// Depth of the overlap with the wall.
        overlap_m: f64,
    },
}

impl fmt::Display for WorldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Body(error) => error.fmt(f),
            Self::StartNotFinite => write!(f, "the start pose is not a finite number"),
            Self::StartBlocked { start, overlap_m } => write!(
                f,
                "at its start ({}, {}) m the robot stands {overlap_m:.3} m deep in a surface",
                start.x, start.y
            ),
        }
    }
}

impl core::error::Error for WorldError {}
