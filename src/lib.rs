//! hilrig: a hardware-in-the-loop rig for small serial robots.
//!
//! Follow a byte: a device makes it ([`emulators`]), a [`line`](mod@line) carries it, damages it by its
//! [`fault`]s and shows it to the [`trace`], the [`rig`] hands it to the robot's program
//! ([`firmware_core`]) and carries the answer back.

pub mod cpu;
pub mod fault;
pub mod line;
pub mod plan;
pub mod resample;
pub mod rig;
pub mod scenario;
pub mod trace;
