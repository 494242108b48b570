//! Maps of buildings from a planar lidar and wheel odometry.
//!
//! ```text
//! scan -> cloud (spots, normals) -> laid onto the walls seen lately -> keyframe, edge
//!      -> places seen again -> edges -> poses that agree best
//! ```
//!
//! Memory: a keyframe has up to 360 spots of 20 bytes, each 0.3 m of new way or 17 degrees of new
//! turn; where three saw the same more than 50 m of way ago, no more are kept. While the sheet is
//! drawn it takes two bytes a cell where beams went, 800 a square metre at 50 mm, and one in its
//! box.
//!
//! Equal input gives equal output, on every host: no clock, no thread, trigonometry of `libm`.

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
pub use track::{Localiser, Mapper, Outcome, Settings, WallPoint};

/// One scan, and the way to it.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// Odometry since the previous scan: metres and radians, in the frame of the previous pose.
    pub moved: Pose,
    /// Whether odometry was available; if not, the robot may be anywhere nearby.
    pub is_measured: bool,
    /// Ends of the beams in the robot's frame, metres, in the order of their bearings.
    pub ends: &'a [[f32; 2]],
}
