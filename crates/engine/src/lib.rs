//! The rig of hilrig: devices, lines and a robot's program under one clock, in virtual time.
//!
//! | module | is |
//! |---|---|
//! | [`run`] | a run watched and judged |
//! | [`robots`] | devices, links and program of each robot |
//! | [`scenario`] | a run as data; floor plans |
//! | [`codec`] | bytes in words |
//! | [`rig`] | nodes and lines under one clock, faults on the way |
//! | [`picture`] | pixels, read from files and written to them |
//!
//! Each module depends only on those below it. A test in another crate uses the crate `hilrig`,
//! whose prelude names all of this.

pub mod codec;
pub mod hex;
pub mod picture;
mod registry;
pub mod rig;
pub mod robots;
pub mod run;
pub mod scenario;
mod shared;
pub mod workers;

pub use registry::NameTaken;
pub use shared::Shared;
pub use span::near;

/// Name of the tool as written into results.
pub const TOOL: &str = "hilrig";
