//! XV-11 firmware 2.1 (3.3 V pre-production units): one frame holds a whole turn, unprotected.
//!
//! ```text
//! | 5A A5 00 C0 | period u16 LE | reading 360 x 4 bytes |
//! ```
//!
//! Seen in the SparkFun "no shield" logic traces: 21 headers exactly 1446 bytes apart.

use super::{RawReading, Reading};
use crate::{Candidate, Format};

/// Bytes in a frame.
pub const FRAME_LEN: usize = 1446;

/// First bytes of a frame.
pub const HEADER: [u8; 4] = [0x5A, 0xA5, 0x00, 0xC0];
const READINGS_AT: usize = 6;

/// One turn. There is no checksum: only the header was verified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame([u8; FRAME_LEN]);

impl Frame {
    /// Makes a frame from its parts.
    pub fn new(period: u16, readings: &[RawReading; 360]) -> Self {
        let mut bytes = [0; FRAME_LEN];
        bytes[..4].copy_from_slice(&HEADER);
        bytes[4..6].copy_from_slice(&period.to_le_bytes());
        for (slot, reading) in bytes[READINGS_AT..].chunks_exact_mut(4).zip(readings) {
            slot.copy_from_slice(&reading.0);
        }
        Self(bytes)
    }

    /// Time per degree in units of 10 ns, so larger is slower: 0xD194 is 310.7 rpm. The unit is
    /// inferred from one driver.
    pub const fn period(&self) -> u16 {
        u16::from_le_bytes([self.0[4], self.0[5]])
    }

    /// The reading at `degree` (0 to 359, larger values wrap) as sent.
    pub fn raw_reading(&self, degree: usize) -> RawReading {
        let at = READINGS_AT + 4 * (degree % 360);
        RawReading([self.0[at], self.0[at + 1], self.0[at + 2], self.0[at + 3]])
    }

    /// Meaning of the reading at `degree`.
    pub fn reading(&self, degree: usize) -> Reading {
        self.raw_reading(degree).into()
    }

    /// The frame as on the wire.
    pub const fn as_bytes(&self) -> &[u8; FRAME_LEN] {
        &self.0
    }
}

/// The frame format, for [`crate::Decoder`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Turns;

/// Finds turns in the byte stream.
pub type Decoder = crate::Decoder<Turns, FRAME_LEN>;

impl Format for Turns {
    type Frame = Frame;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        let seen = bytes.len().min(HEADER.len());
        if bytes[..seen] != HEADER[..seen] {
            Candidate::Noise
        } else if bytes.len() < FRAME_LEN {
            Candidate::Incomplete
        } else {
            Candidate::Complete(FRAME_LEN)
        }
    }

    fn frame(&self, bytes: &[u8]) -> Frame {
        Frame(*bytes.first_chunk().expect("judged complete"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Decode;

    /// D194, 310.7 rpm; each reading its own degree, byte by byte.
    #[test]
    fn a_turn_is_laid_out_by_hand() {
        let readings = core::array::from_fn(|degree| {
            let [low, high] = u16::try_from(degree).expect("below 360").to_le_bytes();
            RawReading([low, high, 0x10, 0x20])
        });
        let frame = Frame::new(0xD194, &readings);
        assert_eq!(frame.as_bytes()[..6], [0x5A, 0xA5, 0x00, 0xC0, 0x94, 0xD1]);
        assert_eq!(frame.as_bytes()[1442..], [0x67, 0x01, 0x10, 0x20]);
        assert_eq!(frame.period(), 0xD194);
        assert_eq!(frame.raw_reading(0), RawReading([0x00, 0x00, 0x10, 0x20]));
        assert_eq!(frame.raw_reading(359), RawReading([0x67, 0x01, 0x10, 0x20]));
        assert_eq!(frame.raw_reading(361), RawReading([0x01, 0x00, 0x10, 0x20]));
    }

    /// A turn is there with its last byte, not before, and behind anything.
    #[test]
    fn a_turn_is_whole_or_not_there() {
        let frame = Frame::new(0xD194, &[RawReading([1, 2, 3, 4]); 360]);
        let mut decoder = Decoder::default();
        assert_eq!(decoder.push(&[0x5A, 0x00]).count(), 0);
        let (most, last) = frame.as_bytes().split_at(FRAME_LEN - 1);
        assert_eq!(decoder.push(most).count(), 0);
        assert!(decoder.push(last).eq([Ok(frame)]));
        assert_eq!(decoder.discarded(), 2);
    }
}
