//! The set of poses of a search: the prior defines it, the correlation walks through it.

/// Maximum number of cells to each side for the lanes of a row.
pub(super) const REACH_MAX: i32 = 15;

/// The poses of a search, around its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    /// Cells to each side along x and y, at most [`REACH_MAX`].
    pub(super) reach: i32,
    /// Heading steps to each side.
    pub(super) turns: i32,
    /// Radians per heading step.
    pub(super) turn_step: f32,
}
