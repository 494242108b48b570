//! One program per robot, built from the shared modules.

pub mod apollo13;
#[cfg(any(feature = "rescue", feature = "yellow"))]
pub mod board_settings;
#[cfg(feature = "rescue")]
pub mod rescue;
#[cfg(feature = "yellow")]
pub mod yellow;
