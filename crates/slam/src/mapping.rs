//! Maps of buildings from a planar lidar and wheel odometry.
//!
//! ```text
//! scan -> cloud (spots, normals) -> aligned with the recent walls -> keyframe, edge
//!      -> places seen again -> edges -> poses that agree best
//! ```
//!
//! Memory: a keyframe has up to 360 spots of 20 bytes. A keyframe is added for each 0.3 m of path
//! or 17 degrees of rotation, but not where three keyframes saw the same walls more than 50 m of
//! path ago. While the sheet is drawn, it takes two bytes per cell that beams crossed (800 per
//! square metre at 50 mm), and one byte per cell of its bounding box.
//!
//! Equal input gives equal output on every host: no clock, no thread, trigonometry of `libm`.

mod align;
mod branch;
pub mod building;
mod cloud;
mod correlate;
mod free;
mod graph;
mod keyframe;
mod matrix;
pub mod motion;
mod sheet;
mod sparse;
mod surfels;
mod track;

use emulators::world::Pose;

pub use cloud::Cloud;
pub use graph::{Edge, Graph, Kind};
pub use matrix::Matrix;
pub use sheet::{Sheet, UNKNOWN};
pub use track::{Accuracy, Localiser, Mapper, Outcome, Settings, WallPoint};

/// One scan, and the motion to it.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// Odometry since the previous scan: metres and radians, in the frame of the previous pose.
    pub moved: Pose,
    /// Whether odometry was available; if not, the motion is unknown and small.
    pub is_measured: bool,
    /// End points of the beams in the robot's frame, metres, in order of bearing.
    pub ends: &'a [[f32; 2]],
}
