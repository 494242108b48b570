//! The robots' programs: what runs on the microcontroller.
//!
//! No heap, no clock, no I/O: a robot is one struct with four verbs ([`Master`]), and the same
//! struct runs in the rig, as a process of its own, and on the board. What belongs to a program but
//! runs on a PC and needs a heap is behind the feature `host`, which no board has.
#![no_std]

#[cfg(feature = "host")]
extern crate alloc;

pub mod base_link;
pub mod display;
pub mod fifo;
pub mod grid;
#[cfg(feature = "host")]
pub mod growing_map;
pub mod lidar_motor;
pub mod lines;
pub mod map_view;
mod master;
pub mod memory;
pub mod navigation;
pub mod odometry;
pub mod packets;
pub mod pc_link;
pub mod pose;
pub mod robots;
pub mod scan;
pub mod slam;
pub mod waypoints;

pub use master::{Inspect, Master, Work};
