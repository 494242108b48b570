//! Telemetry link of the robot yellow: framing between PC and robot, in both directions. The
//! payload is a protocol buffers message, which this module does not read.
//!
//! ```text
//! | 7E | length u16 | payload | checksum u8 |      big-endian
//! ```
//!
//! Length and checksum are those of the payload before escaping; the checksum is FF less the sum of
//! the payload. Behind the start byte, 7E and 7D are sent as 7D, byte ^ 20 (as the XBee radios do),
//! so that 7E is always a start.
//!
//! The link runs at 38400 8N1 through a WiFi radio. Source: published code of the robot,
//! `SerialServer` and `SerialEncoder`, whose three defects are [`Defects`].

mod decoder;
pub mod message;
#[cfg(test)]
mod tests;

use core::fmt;

pub use decoder::{Decoder, Defects};

/// Rate of the link, 8N1.
pub const BAUD: u32 = 38_400;
/// First byte of a frame, and nowhere else.
pub const START: u8 = 0x7E;
/// Comes before a byte that was changed.
pub const ESCAPE: u8 = 0x7D;
/// Change of an escaped byte.
const FLIP: u8 = 0x20;
/// Most payload bytes: the buffers of the robot.
pub const PAYLOAD_MAX: usize = 3_200;
/// The longest frame: every byte but the first is escaped.
pub const FRAME_MAX: usize = 1 + 2 * (2 + PAYLOAD_MAX + 1);

/// A payload and its received checksum.
#[derive(Clone, PartialEq, Eq)]
pub struct Frame {
    payload: [u8; PAYLOAD_MAX],
    len: usize,
    checksum: u8,
}

impl Frame {
    /// The payload, without escapes.
    pub fn payload(&self) -> &[u8] {
        &self.payload[..self.len]
    }

    /// Whether the checksum holds. Only a decoder with [`Defects::deliver_corrupt`] returns frames
    /// with a wrong checksum.
    pub fn is_sound(&self) -> bool {
        checksum(self.payload()) == self.checksum
    }

    /// Writes the frame as it was on the wire; see [`encode`].
    ///
    /// # Errors
    /// If `out` is too short.
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, EncodeError> {
        write(self.payload(), self.checksum, out)
    }
}

impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { checksum, .. } = self;
        write!(
            f,
            "telemetry::Frame({:02X?}, {checksum:02X})",
            self.payload()
        )
    }
}

/// Reason why a frame was not written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum EncodeError {
    /// The payload is longer than [`PAYLOAD_MAX`].
    TooLong {
        /// Bytes of the payload.
        found: usize,
    },
    /// The frame is longer than the space for it.
    NoRoom {
        /// Bytes of the space.
        room: usize,
    },
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::TooLong { found } => {
                write!(
                    f,
                    "payload has {found} bytes, at most {PAYLOAD_MAX} allowed"
                )
            }
            Self::NoRoom { room } => write!(f, "frame does not fit into {room} bytes"),
        }
    }
}

impl core::error::Error for EncodeError {}

/// FF less the sum of the payload, modulo 256.
pub fn checksum(payload: &[u8]) -> u8 {
    payload
        .iter()
        .fold(0xFF, |sum, byte| sum.wrapping_sub(*byte))
}

/// Writes the frame of `payload` to the front of `out`; returns its length. [`FRAME_MAX`] bytes are
/// always enough.
///
/// # Errors
/// If the payload is longer than 3200 bytes, or the frame longer than `out`. Then `out` holds no
/// valid frame.
pub fn encode(payload: &[u8], out: &mut [u8]) -> Result<usize, EncodeError> {
    write(payload, checksum(payload), out)
}

fn write(payload: &[u8], checksum: u8, out: &mut [u8]) -> Result<usize, EncodeError> {
    let found = payload.len();
    let length = u16::try_from(found).ok().filter(|_| found <= PAYLOAD_MAX);
    let Some(length) = length else {
        return Err(EncodeError::TooLong { found });
    };
    let room = out.len();
    let mut slots = out.iter_mut();
    let mut put = |byte| match slots.next() {
        Some(slot) => {
            *slot = byte;
            Ok(1)
        }
        None => Err(EncodeError::NoRoom { room }),
    };
    let mut len = put(START)?;
    let bytes = length.to_be_bytes();
    for &byte in bytes.iter().chain(payload).chain([&checksum]) {
        len += match byte {
            START | ESCAPE => put(ESCAPE)? + put(byte ^ FLIP)?,
            _ => put(byte)?,
        };
    }
    Ok(len)
}
