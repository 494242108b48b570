//! Maps as others keep them, and how two of them differ.
//!
//! ```text
//! map.yaml + picture -> RosMap; two of them -> alignment -> overlap, wall error, picture
//! ```

pub mod diff;
mod distance;
pub mod pcd;
mod ros;
mod walls;

pub use ros::{CellState, MapError, RosMap};
pub use walls::walls;
