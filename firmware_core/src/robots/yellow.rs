//! The robot yellow, a course's robot of spring 2019.

#[cfg(feature = "host")]
pub mod pc;
