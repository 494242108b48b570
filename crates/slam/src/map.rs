//! Maps in common file formats, and the comparison of two maps.
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
