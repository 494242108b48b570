//! Firmware without a board: an ELF file, unmodified, on a simulated microcontroller.
//!
//! ```text
//! boards/NAME.toml --> Board --settings--> node program hilrig-simavr <-- nodes/simavr, built once
//! ```
//!
//! A board is data: its chip and clock, the names of its UARTs and buses, and the positions of its
//! pins. The node program only knows chips; its greeting contains the board. It links simavr, whose
//! licence is the GPL, and is a separate process. Boards with a Cortex-M run in QEMU: see
//! [`Machine`].

mod board;
mod program;
mod qemu;
mod wiring;

pub use board::{Board, BoardError, Pin, check_name, names};
pub use program::{BuildError, program};
pub use qemu::{Machine, Tier, check_image};
pub use wiring::{PortKind, Unit, WiringError};
