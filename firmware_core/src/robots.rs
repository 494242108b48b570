//! One program per robot, built from the shared modules.

pub mod rescue;
pub mod yellow;
