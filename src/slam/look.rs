//! A log while it is mapped, for whoever looks on.

use emulators::world::Pose;

use super::Shot;
use super::mapping::Sheet;
use super::survey::{Jump, Sureness};

/// What is known after a scan.
#[derive(Clone, Copy)]
pub struct Look<'a> {
    /// Scans done.
    pub done: usize,
    /// The last of them.
    pub shot: &'a Shot,
    /// Where it was put: metres and radians in the log's frame.
    pub pose: Pose,
    /// How sure that is, of a mapper that says.
    pub sureness: Option<Sureness>,
    /// How far that is from where the wheels had put it, if it is far.
    pub jump: Option<Jump>,
    /// What the mapper has made of all scans so far.
    pub so_far: &'a dyn SoFar,
}

/// What a mapper has made of the scans so far.
pub trait SoFar {
    /// Where each was taken, by what is known now: metres and radians in the log's frame.
    fn way(&self) -> Vec<Pose>;

    /// The map of cells with this edge, metres, or of the edge that the mapper itself has.
    fn map(&self, cell_m: f64) -> Sheet;

    /// Keyframes.
    fn keyframes(&self) -> usize {
        0
    }

    /// Places seen again: where the robot was both times.
    fn loops(&self) -> Vec<[Pose; 2]> {
        Vec::new()
    }
}
