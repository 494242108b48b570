//! Wire formats of small serial robots.
//!
//! No function here allocates, reads a clock or does I/O. A protocol is one file. It has the frame
//! layout as a diagram, a checked [`Frame`](xv11::Frame) that keeps every bit, and the meaning of a
//! frame as a second type. It has an encoder into the caller's buffer, and a decoder that is one
//! [`Format`] for the shared [`Decoder`].
//!
//! | module | wire |
//! |---|---|
//! | [`xv11`] | Neato XV-11 lidar: 22-byte packets (firmware 2.4, 2.6), 1446-byte turns (2.1) |
//! | [`avr`] | register bus of the AVR base, and its register map |
//! | [`pcui`] | robot to PC link: framing, map rows, waypoints, state |
//! | [`car_board`] | board of a model car: a byte a command, frames without a checksum |
//! | [`odometer`] | text lines of a microcontroller that measures distance and heading |
//! | [`panel`] | touch panel: drawing commands, pen reports |
//! | [`perception`] | rows of depths, scans and markers as messages of a network |
//! | [`peripherals`] | a microcontroller's hardware without a serial port: counters, PWM, ADC |
//! | [`rle`] | run-length code of the map rows |
//! | [`rplidar`] | RPLIDAR A1 lidar: requests, answers, standard and express scans |
//! | [`hc06`] | AT command set of the HC-06 radio |
//! | [`telemetry`] | robot yellow and its PC: framing with its defects, protobuf messages |
//! | [`line`](mod@line) | line coding and byte time |
//! | [`tty`] | changes of input by a terminal driver |
//!
//! To add a protocol: one file here that implements [`Format`], one file of tests in `tests/wire`.
#![no_std]

pub mod avr;
pub mod car_board;
mod decode;
pub mod hc06;
pub mod line;
pub mod odometer;
pub mod panel;
pub mod pcui;
pub mod perception;
pub mod peripherals;
pub mod rle;
pub mod rplidar;
#[cfg(feature = "telemetry")]
pub mod telemetry;
mod time;
pub mod tty;
pub mod xv11;

pub use decode::{Candidate, Decode, Decoder, Format, FrameError, Frames};
pub use line::{LineConfig, LineEvent, Parity, Port};
pub use time::Instant;
