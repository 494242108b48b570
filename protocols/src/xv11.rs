//! Neato XV-11 lidar stream, firmware 2.4 and 2.6: 22-byte packets, 90 to a revolution, no length
//! field, no escaping. Firmware 2.1 sends whole turns instead: see [`turn`].
//!
//! ```text
//! | FA | index A0..=F9 | speed u16 | reading 4 x 4 bytes | checksum u16 |      little-endian
//! ```
//!
//! Facts: public reverse engineering of the sensor (XV-11 wiki, Xevel/NXV11), checked against the
//! 11,451 packets of Xevel's "hand in box" capture.

mod reading;
pub mod turn;

pub use reading::{RawReading, Reading};

use crate::{Candidate, Format, FrameError};

/// Bytes in a packet.
pub const FRAME_LEN: usize = 22;
/// Packets in a revolution.
pub const FRAMES_PER_TURN: usize = 90;
/// Readings in a packet, one degree apart.
pub const READINGS_PER_FRAME: usize = 4;
/// The sensor's fixed line rate.
pub const BAUD: u32 = 115_200;

/// First byte of every packet.
pub const START: u8 = 0xFA;
/// Index byte of the packet that holds degrees 0 to 3.
pub const FIRST_INDEX: u8 = 0xA0;
/// Index byte of the packet that holds degrees 356 to 359.
pub const LAST_INDEX: u8 = 0xF9;

mod field {
    use core::ops::Range;

    pub(super) const INDEX: usize = 1;
    pub(super) const SPEED: Range<usize> = 2..4;
    pub(super) const READINGS: Range<usize> = 4..20;
    pub(super) const CHECKSUM: Range<usize> = 20..22;
}

/// Rotation speed as sent: 64ths of a turn per minute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SpeedWord(pub u16);

impl SpeedWord {
    /// Turns per minute.
    pub fn rpm(self) -> f32 {
        f32::from(self.0) / 64.0
    }
}

/// A packet whose start, index and checksum were verified. Keeps every bit of the original.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame([u8; FRAME_LEN]);

impl Frame {
    /// Makes the packet `index` (0 to 89, larger values wrap) from its parts.
    pub fn new(index: u8, speed: SpeedWord, readings: [RawReading; READINGS_PER_FRAME]) -> Self {
        let mut bytes = [0; FRAME_LEN];
        bytes[0] = START;
        bytes[field::INDEX] = FIRST_INDEX + index % 90;
        bytes[field::SPEED].copy_from_slice(&speed.0.to_le_bytes());
        for (slot, reading) in bytes[field::READINGS].chunks_exact_mut(4).zip(readings) {
            slot.copy_from_slice(&reading.0);
        }
        let checksum = checksum(&bytes);
        bytes[field::CHECKSUM].copy_from_slice(&checksum.to_le_bytes());
        Self(bytes)
    }

    /// Position in the turn, 0 to 89; the first reading lies at four times as many degrees.
    pub const fn index(&self) -> u8 {
        self.0[field::INDEX] - FIRST_INDEX
    }

    /// Rotation speed.
    pub const fn speed(&self) -> SpeedWord {
        SpeedWord(u16::from_le_bytes([self.0[2], self.0[3]]))
    }

    /// Turns per minute.
    pub fn speed_rpm(&self) -> f32 {
        self.speed().rpm()
    }

    /// The four readings as sent.
    pub fn raw_readings(&self) -> [RawReading; READINGS_PER_FRAME] {
        let mut readings = [RawReading([0; 4]); READINGS_PER_FRAME];
        for (reading, bytes) in readings
            .iter_mut()
            .zip(self.0[field::READINGS].chunks_exact(4))
        {
            reading.0.copy_from_slice(bytes);
        }
        readings
    }

    /// Meaning of the four readings.
    pub fn readings(&self) -> [Reading; READINGS_PER_FRAME] {
        self.raw_readings().map(Reading::from)
    }

    /// The packet as it was, or is to be, on the wire.
    pub const fn as_bytes(&self) -> &[u8; FRAME_LEN] {
        &self.0
    }
}

/// The sensor's checksum over the first twenty bytes: ten little-endian words, each shifted by one
/// more bit, folded to 15 bits. The fold *drops* a carry out of bit 14. About 3 % of real packets
/// produce it (350 of 11,451 in the capture), so an end-around carry is wrong.
pub fn checksum(bytes: &[u8; FRAME_LEN]) -> u16 {
    let words = bytes[..20]
        .chunks_exact(2)
        .map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
    // Largest possible value is 0x03FE_FC01, so nothing overflows.
    let sum = words.fold(0_u32, |sum, word| (sum << 1) + u32::from(word));
    let folded = (sum & 0x7FFF) + (sum >> 15);
    u16::try_from(folded & 0x7FFF).expect("masked to 15 bits")
}

/// The packet format, for [`crate::Decoder`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Packets;

/// Finds packets in the byte stream. Boot text and cut packets cost only their own length, never a
/// whole packet that follows.
pub type Decoder = crate::Decoder<Packets, 64>;

impl Format for Packets {
    type Frame = Frame;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        if bytes[0] != START {
            return Candidate::Noise;
        }
        match bytes.get(field::INDEX) {
            Some(FIRST_INDEX..=LAST_INDEX) => {}
            Some(_) => return Candidate::Noise,
            None => return Candidate::Incomplete,
        }
        let Some(frame) = bytes.first_chunk::<FRAME_LEN>() else {
            return Candidate::Incomplete;
        };
        let expected = checksum(frame);
        let found = u16::from_le_bytes([frame[20], frame[21]]);
        if expected == found {
            Candidate::Complete(FRAME_LEN)
        } else {
            Candidate::Rejected(FrameError::Checksum {
                expected: u32::from(expected),
                found: u32::from(found),
            })
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

    /// First whole packet of the "hand in box" capture (offset 710): 297.219 rpm and
    /// 295, 295, 294, 294 mm.
    const PLAIN: [u8; FRAME_LEN] = [
        0xFA, 0xA0, 0x4E, 0x4A, 0x27, 0x01, 0x05, 0x04, 0x27, 0x01, 0xD7, 0x03, 0x26, 0x01, 0x29,
        0x04, 0x26, 0x01, 0xF0, 0x03, 0x3C, 0x5C,
    ];

    /// The word 4A4E is 19,022, in 64ths of a turn a minute.
    #[test]
    fn a_speed_word_counts_64ths_of_a_turn_a_minute() {
        assert!((SpeedWord(0x4A4E).rpm() - 297.218_75).abs() < 1e-4);
        assert!(SpeedWord(0).rpm().abs() < 1e-6);
    }

    #[test]
    fn a_captured_packet_decodes_to_what_the_box_measured() {
        let mut decoder = Decoder::default();
        let frame = decoder
            .push(&PLAIN)
            .next()
            .expect("complete")
            .expect("valid");

        assert_eq!(frame.index(), 0);
        assert_eq!(frame.speed(), SpeedWord(0x4A4E));
        let range = |distance_mm, strength| Reading::Range {
            distance_mm,
            strength,
            weak: false,
        };
        assert_eq!(
            frame.readings(),
            [
                range(295, 1029),
                range(295, 983),
                range(294, 1065),
                range(294, 1008)
            ]
        );
    }

    #[test]
    fn a_packet_built_from_its_parts_is_the_captured_one() {
        let raw = |distance_mm, strength| Reading::Range {
            distance_mm,
            strength,
            weak: false,
        };
        let readings = [
            raw(295, 1029),
            raw(295, 983),
            raw(294, 1065),
            raw(294, 1008),
        ];
        let frame = Frame::new(0, SpeedWord(0x4A4E), readings.map(RawReading::from));
        assert_eq!(frame.as_bytes(), &PLAIN);
    }

    /// A restart cuts a packet after 7 bytes; the next packet must not be lost with it.
    #[test]
    fn a_cut_packet_does_not_take_the_next_one_with_it() {
        let mut decoder = Decoder::default();
        assert_eq!(decoder.push(&PLAIN[..7]).count(), 0);
        assert_eq!(decoder.push(&PLAIN).filter(Result::is_ok).count(), 1);
        assert_eq!((decoder.discarded(), decoder.pending()), (7, 0));
    }

    /// Packet 7 has the index byte 7 + A0 = A7. A speed of 297.21875 rpm is 4A4E, 19,022 in 64ths.
    #[test]
    fn a_packet_says_where_it_belongs_and_how_fast_the_sensor_turns() {
        let frame = Frame::new(7, SpeedWord(0x4A4E), [RawReading([0; 4]); 4]);
        assert_eq!((frame.as_bytes()[1], frame.index()), (0xA7, 7));
        assert!((frame.speed_rpm() - 297.218_75).abs() < 1e-4);
    }
}
