//! Maps as others keep them, and how two of them differ.
//!
//! ```text
//! map.yaml + picture -> RosMap; two of them -> alignment -> overlap, wall error, picture
//! ```

pub mod diff;
mod distance;
mod ros;

pub use ros::{CellState, MapError, RosMap};
