//! Planning for a robot that cannot turn on the spot: a lattice of poses, joined by motions that it
//! can drive. For the part of a program that runs on a PC; feature `host`.
//!
//! ```text
//! pose       cell x, cell y, one of 16 headings
//! primitive  leads from one pose to another by an arc or a straight; costs its time
//! plan       the cheapest chain of primitives along which the outline touches nothing
//! ```
//!
//! A primitive's cost grows with the most expensive cell that the outline sweeps. Facts: the
//! lattice planner of seed 003 (sbpl), its figures and its file of primitives. For the search see
//! [`plan`](Lattice::plan).

mod primitives;
mod search;
mod sweep;
#[cfg(test)]
mod tests;

pub use primitives::{Primitive, PrimitiveSet};
pub use search::{Goal, Limits, NoPlan, Plan};
pub use sweep::{Lattice, Outline};
