//! Robot to PC link: framing. The messages are in [`message`].
//!
//! ```text
//! | "PCUI_MSG" | length u16 | checksum u32 | id 3 x ASCII | payload |      little-endian
//! ```
//!
//! The checksum is the plain sum of the payload bytes: neither id nor length is covered. Seed
//! report 2015 allows 65536 bytes of payload and lists of 100 waypoints, which take 902 bytes. That
//! is the limit here. Both fielded ends accept at most 511. Free debug text may share the line.

pub mod diagnosis;
mod error;
pub mod message;

pub use error::MessageError;
pub use message::Message;

use crate::{Candidate, Format, FrameError};

/// First bytes of every frame.
pub const MAGIC: [u8; 8] = *b"PCUI_MSG";
/// Bytes before the payload.
pub const HEADER_LEN: usize = 17;
/// Maximum number of payload bytes: a list of 100 waypoints, or, with the feature `large`, a row of
/// 2829 cells and its header.
pub const PAYLOAD_MAX: usize = if cfg!(feature = "large") { 2832 } else { 902 };
/// Maximum number of payload bytes that the fielded ends accept.
pub const FIELDED_PAYLOAD_MAX: usize = 511;
/// The longest frame.
pub const FRAME_MAX: usize = HEADER_LEN + PAYLOAD_MAX;
/// Line rate between robot and radio.
pub const BAUD: u32 = 460_800;

mod field {
    use core::ops::Range;

    pub(super) const LENGTH: Range<usize> = 8..10;
    pub(super) const CHECKSUM: Range<usize> = 10..14;
    pub(super) const ID: Range<usize> = 14..17;
}

/// A frame whose start, length and checksum were verified. The checksum does not cover the id.
#[derive(Clone, PartialEq, Eq)]
pub struct Frame {
    bytes: [u8; FRAME_MAX],
    len: usize,
}

impl Frame {
    /// Three ASCII characters that name the message.
    pub fn id(&self) -> [u8; 3] {
        *self.bytes[field::ID].first_chunk().expect("three bytes")
    }

    /// The payload.
    pub fn payload(&self) -> &[u8] {
        &self.bytes[HEADER_LEN..self.len]
    }

    /// The frame as on the wire.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

impl core::fmt::Debug for Frame {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "pcui::Frame({}, {:02X?})",
            self.id().escape_ascii(),
            self.payload()
        )
    }
}

/// Sum of the payload bytes, unsigned.
pub fn checksum(payload: &[u8]) -> u32 {
    payload.iter().map(|&byte| u32::from(byte)).sum()
}

/// Puts the header in front of a payload that already lies in `frame[17..]`; returns the length of
/// the whole frame. `None` if the payload is longer than 902 bytes or than the space behind it.
pub fn seal(frame: &mut [u8], id: [u8; 3], payload_len: usize) -> Option<usize> {
    if payload_len > PAYLOAD_MAX {
        return None;
    }
    let len = HEADER_LEN + payload_len;
    let sum = checksum(frame.get(HEADER_LEN..len)?);
    let length = u16::try_from(payload_len).expect("at most 902");
    frame[..8].copy_from_slice(&MAGIC);
    frame[field::LENGTH].copy_from_slice(&length.to_le_bytes());
    frame[field::CHECKSUM].copy_from_slice(&sum.to_le_bytes());
    frame[field::ID].copy_from_slice(&id);
    Some(len)
}

/// The frame format, for [`crate::Decoder`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Framing;

/// Finds frames in the byte stream, between debug text if need be.
pub type Decoder = crate::Decoder<Framing, FRAME_MAX>;

impl Format for Framing {
    type Frame = Frame;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        let seen = bytes.len().min(MAGIC.len());
        if bytes[..seen] != MAGIC[..seen] {
            return Candidate::Noise;
        }
        let Some(header) = bytes.first_chunk::<HEADER_LEN>() else {
            return Candidate::Incomplete;
        };
        let length = u16::from_le_bytes([header[8], header[9]]);
        if usize::from(length) > PAYLOAD_MAX {
            let max = u32::try_from(PAYLOAD_MAX).expect("902");
            return Candidate::Rejected(FrameError::Length {
                max,
                found: u32::from(length),
            });
        }
        let end = HEADER_LEN + usize::from(length);
        let Some(payload) = bytes.get(HEADER_LEN..end) else {
            return Candidate::Incomplete;
        };
        let found = u32::from_le_bytes([header[10], header[11], header[12], header[13]]);
        let expected = checksum(payload);
        if expected == found {
            Candidate::Complete(end)
        } else {
            Candidate::Rejected(FrameError::Checksum { expected, found })
        }
    }

    fn frame(&self, bytes: &[u8]) -> Frame {
        let mut frame = Frame {
            bytes: [0; FRAME_MAX],
            len: bytes.len(),
        };
        frame.bytes[..bytes.len()].copy_from_slice(bytes);
        frame
    }
}
