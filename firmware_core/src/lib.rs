//! The robots' programs for the microcontroller.
//!
//! No heap, no clock, no I/O: a robot is one struct with four main methods ([`Master`]). The same
//! struct runs in the rig, as a process of its own, and on the board. The parts of a program that
//! run on a PC and need a heap are behind the feature `host`, which no board enables.
#![no_std]

#[cfg(feature = "host")]
extern crate alloc;

pub mod ackermann;
#[cfg(feature = "host")]
pub mod astar;
pub mod base_link;
#[cfg(feature = "host")]
pub mod cell_map;
#[cfg(feature = "host")]
pub mod costmap;
#[cfg(feature = "display")]
pub mod display;
pub mod fifo;
#[cfg(feature = "host")]
pub mod frontier;
pub mod grid;
#[cfg(feature = "host")]
pub mod growing_map;
pub mod gyro;
#[cfg(feature = "host")]
pub mod lattice;
pub mod lidar_motor;
pub mod lines;
#[cfg(feature = "host")]
pub mod local_map;
#[cfg(feature = "host")]
pub mod localise;
pub mod map_view;
mod master;
pub mod memory;
pub mod navigation;
pub mod odometry;
pub mod packets;
#[cfg(feature = "host")]
pub mod particles;
pub mod pc_link;
pub mod pose;
#[cfg(feature = "host")]
pub mod prm;
pub mod radio_setup;
mod random;
pub mod robots;
pub mod scan;
pub mod slam;
#[cfg(feature = "host")]
pub mod walls;
pub mod waypoints;

pub use master::{Inspect, Master, Work};
