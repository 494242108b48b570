//! The program of the car of seed 003: an Ackermann chassis, two serial boards, ultrasound, gyro,
//! depth camera, a phone as remote.
//!
//! In the seed the program runs on a PC under ROS. Its numbers are therefore doubles, and the parts
//! with a heap (gates, and the planner and localisation beside this folder) are behind the feature
//! `host`.

pub mod arbiter;
pub mod board_odometry;
pub mod camera_watch;
#[cfg(feature = "host")]
pub mod floor;
#[cfg(feature = "host")]
pub mod follower;
#[cfg(feature = "host")]
pub mod gates;
pub mod gyro_odometry;
pub mod gyro_watch;
pub mod odometer_watch;
#[cfg(feature = "host")]
pub mod pilot;
#[cfg(feature = "host")]
mod program;
pub mod raw_lines;
pub mod slip;
pub mod steering;
#[cfg(feature = "host")]
pub mod survey;
pub mod wall;
pub mod witness;

#[cfg(feature = "host")]
pub use program::{Apollo13, Config, Defects};
