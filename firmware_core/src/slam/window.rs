//! Which poses a search looks at: what the prior asks for and the correlation walks through.

/// Cells to each side that the lanes of a row can hold.
pub(super) const REACH_MAX: i32 = 15;

/// Which poses a search looks at, around its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    /// Cells to each side along x and y, at most [`REACH_MAX`].
    pub(super) reach: i32,
    /// Heading steps to each side.
    pub(super) turns: i32,
    /// Radians per heading step.
    pub(super) turn_step: f32,
}
