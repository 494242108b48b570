//! The board layer: a robot's program on a Cortex-M4 in QEMU, in lockstep with a rig.
//!
//! ```text
//!   hilrig --exchange--> QEMU's standard input  --semihosting--> Board --receive, poll--> Master
//!   hilrig <--reply----- QEMU's standard output <--semihosting-- Board <--transmit------- Master
//! ```
//!
//! QEMU with this firmware is a node program, whose contract is `docs/nodes.md`. Each exchange has
//! the time and the bytes that arrived; the program works; the reply has the bytes that it sends
//! and the time of the next exchange. Time is an argument, so the processor's own clock decides
//! nothing: the trace is that of the same program compiled for the host. The system timer counts
//! instructions, for the report of the load at the end.
//!
//! The command line says what a board is wired to and set to, one word each:
//!
//! | word | means |
//! |---|---|
//! | `port=NAME:PIECE` | the rig's next port is the program's port NAME; PIECE bytes leave at once |
//! | `optional=NAME:PIECE` | the same; the program need not have it |
//! | `cost=SCAN:TRY:POINT` | nanoseconds of computing, see [`firmware_core::Work`] |
//! | `clock=HZ` | clock of the modelled processor, for the load |
//! | `KEY=VALUE` | a setting of the program |
#![no_std]

mod board;
mod load;
mod wire;

pub use board::{Board, Setup};
