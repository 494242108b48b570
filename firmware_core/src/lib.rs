//! The robots' programs: what runs on the microcontroller.
//!
//! No heap, no clock, no I/O: a robot is one struct with four verbs ([`Master`]), and the same
//! struct runs in the rig, as a process of its own, and on the board.
#![no_std]

mod master;
pub mod grid;
pub mod odometry;
pub mod pose;
pub mod scan;
pub mod slam;

pub use master::{Inspect, Master, Work};
