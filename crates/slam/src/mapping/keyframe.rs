//! Keyframes.

use crate::mapping::cloud::Cloud;

/// A stored scan.
#[derive(Clone, Debug)]
pub(crate) struct Keyframe {
    pub(crate) cloud: Cloud,
    /// Length of the path from the first keyframe, metres.
    pub(crate) path_m: f64,
    /// Share of the scan that lay on known walls, 0 to 1; the pose of a poor keyframe is uncertain.
    pub(crate) quality: f64,
    /// Number of the scan.
    pub(crate) scan: usize,
    /// Rotation and length of the path by odometry only, radians and metres.
    pub(crate) turned: f64,
    pub(crate) wheels_m: f64,
    /// Share of the odometry in the rotation since the previous keyframe, 0 to 1.
    pub(crate) by_odometry: f64,
    /// Part of the map, as the index of its first keyframe.
    pub(crate) part: usize,
}
