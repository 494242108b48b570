//! The PC program of the robot yellow with a small robot of the tests: an ideal differential drive
//! between walls, with the robot's telemetry in real frames.

mod bench;
mod chance;
mod driving;
mod lines;
mod link;
mod looking;
mod mapping;
mod places;
mod robot;
mod world;
