//! Scans that are kept.

use crate::mapping::cloud::Cloud;

/// A scan that is kept.
#[derive(Clone, Debug)]
pub(crate) struct Keyframe {
    pub(crate) cloud: Cloud,
    /// Way to it from the first, metres.
    pub(crate) path_m: f64,
    /// Part of it that lay on walls known before, 0 to 1; a poor one may stand elsewhere.
    pub(crate) quality: f64,
    /// Number of its scan.
    pub(crate) scan: usize,
    /// Turn and length of the way to it by the wheels alone, radians and metres.
    pub(crate) turned: f64,
    pub(crate) wheels_m: f64,
    /// Part of the map that it belongs to: the number of that part's first keyframe.
    pub(crate) part: usize,
}
