//! Firmware without a board: an ELF file, unmodified, on a simulated microcontroller.
//!
//! ```text
//! boards/NAME.toml --> Board --settings--> node program hilrig-simavr <-- nodes/simavr, built once
//! ```
//!
//! A board is data: its chip and clock, the names of its UARTs and buses, where its pins are. The
//! node program knows chips alone and is told all of that in its greeting. It links simavr, whose
//! licence is the GPL, and is a process of its own.

mod board;
mod program;
mod wiring;

pub use board::{Board, BoardError, Pin, check_name, names};
pub use program::{BuildError, program};
pub use wiring::{PortKind, Unit, WiringError};
