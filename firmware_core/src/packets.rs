//! Parser of the lidar's packets: correct, or with the defects of the fielded program.
//!
//! The fielded parser searches a start byte, takes 22 bytes, and expects the next start byte behind
//! them; it accepts any byte there. It computes the checksum without clearing the sum between
//! packets, so its developers finally commented the comparison out. It uses the index unchecked.

use protocols::xv11::{self, FIRST_INDEX, FRAME_LEN, Frame, RawReading, START, SpeedWord};
use protocols::{Decode, FrameError};

use crate::memory::StrayWrites;
use crate::scan::BEAMS;

/// Lidar defects of the fielded program; all off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The checksum's sum continues from packet to packet (XV-01).
    pub sum_is_never_cleared: bool,
    /// No checksum is compared (XV-02).
    pub unchecked: bool,
    /// The index selects an array element without a check (XV-03).
    pub any_index: bool,
    /// All 22 bytes are consumed in any case. A repeating false start byte is therefore kept
    /// forever (XV-04), and one lost byte costs packets with wrong indices (XV-05).
    pub keeps_alignment: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        sum_is_never_cleared: false,
        unchecked: false,
        any_index: false,
        keeps_alignment: false,
    };

    /// Defects of the final fielded program.
    pub const FIELDED: Self = Self {
        sum_is_never_cleared: false,
        unchecked: true,
        any_index: true,
        keeps_alignment: true,
    };
}

/// Extracts packets from the stream.
#[derive(Clone, Debug)]
pub struct Packets {
    decoder: xv11::Decoder,
    defects: Defects,
    hunter: Hunter,
}

impl Packets {
    /// Packets of a correct program.
    pub const fn new() -> Self {
        Self::with_defects(Defects::NONE)
    }

    /// Packets of a program with the given defects.
    pub const fn with_defects(defects: Defects) -> Self {
        Self {
            decoder: xv11::Decoder::with_format(xv11::Packets),
            defects,
            hunter: Hunter::new(),
        }
    }

    /// Takes bytes from the front of `input` until a packet is complete or a candidate rejected.
    pub fn step(&mut self, input: &mut &[u8]) -> Option<Result<Frame, FrameError>> {
        if self.defects == Defects::NONE {
            return self.decoder.step(input);
        }
        while let Some((&byte, rest)) = input.split_first() {
            *input = rest;
            if let Some(outcome) = self.hunter.take(byte, &self.defects) {
                return Some(outcome);
            }
        }
        None
    }

    /// Notes that the line is quiet, which the fielded program did not notice.
    pub fn idle(&mut self) {
        self.decoder.idle();
    }

    /// Bytes taken but not yet checked.
    pub fn pending(&self) -> usize {
        if self.defects == Defects::NONE {
            self.decoder.pending()
        } else {
            self.hunter.len
        }
    }

    /// Writes that would have missed the array of 360 distances; offsets are in elements.
    pub const fn stray_writes(&self) -> StrayWrites {
        self.hunter.stray
    }
}

impl Default for Packets {
    fn default() -> Self {
        Self::new()
    }
}

/// The fielded parser.
#[derive(Clone, Debug)]
struct Hunter {
    bytes: [u8; FRAME_LEN],
    len: usize,
    sum: u32,
    stray: StrayWrites,
}

impl Hunter {
    const fn new() -> Self {
        Self {
            bytes: [0; FRAME_LEN],
            len: 0,
            sum: 0,
            stray: StrayWrites::NONE,
        }
    }

    fn take(&mut self, byte: u8, defects: &Defects) -> Option<Result<Frame, FrameError>> {
        if self.len == 0 && byte != START {
            return None;
        }
        self.bytes[self.len] = byte;
        self.len += 1;
        if self.len < FRAME_LEN {
            return None;
        }
        let outcome = self.judge(defects);
        if outcome.is_some_and(|outcome| outcome.is_err()) && !defects.keeps_alignment {
            self.rescan();
        } else {
            self.len = 0;
        }
        outcome
    }

    /// Continues at the next start byte within the rejected bytes.
    fn rescan(&mut self) {
        let next = self.bytes[1..].iter().position(|byte| *byte == START);
        let from = next.map_or(FRAME_LEN, |at| at + 1);
        self.bytes.copy_within(from.., 0);
        self.len = FRAME_LEN - from;
    }

    fn judge(&mut self, defects: &Defects) -> Option<Result<Frame, FrameError>> {
        let found = u16::from_le_bytes([self.bytes[20], self.bytes[21]]);
        let expected = self.checksum(defects);
        if expected != found && !defects.unchecked {
            let (expected, found) = (u32::from(expected), u32::from(found));
            return Some(Err(FrameError::Checksum { expected, found }));
        }
        let index = self.bytes[1].wrapping_sub(FIRST_INDEX);
        if usize::from(index) >= BEAMS / 4 {
            if !defects.any_index {
                let (max, found) = (89, u32::from(index));
                return Some(Err(FrameError::Length { max, found }));
            }
            // The array index is kept in 16 bits without sign.
            let place = (i32::from(self.bytes[1]) - i32::from(FIRST_INDEX)) * 4;
            self.stray.note(place.rem_euclid(0x1_0000));
            return None;
        }
        let speed = SpeedWord(u16::from_le_bytes([self.bytes[2], self.bytes[3]]));
        let readings = self.bytes[4..20].as_chunks().0;
        let readings = core::array::from_fn(|at| RawReading(readings[at]));
        Some(Ok(Frame::new(index, speed, readings)))
    }

    fn checksum(&mut self, defects: &Defects) -> u16 {
        if !defects.sum_is_never_cleared {
            return xv11::checksum(&self.bytes);
        }
        for pair in self.bytes[..20].as_chunks::<2>().0 {
            let word = u32::from(u16::from_le_bytes(*pair));
            self.sum = (self.sum << 1).wrapping_add(word);
        }
        self.sum = ((self.sum & 0x7FFF) + (self.sum >> 15)) & 0x7FFF;
        u16::try_from(self.sum).expect("masked to 15 bits")
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    fn packet(index: u8) -> [u8; FRAME_LEN] {
        let mut bytes = *Frame::new(
            index % 90,
            SpeedWord(300 * 64),
            [RawReading([0xE8, 3, 200, 0]); 4],
        )
        .as_bytes();
        bytes[1] = FIRST_INDEX.wrapping_add(index);
        bytes
    }

    fn outcomes(defects: Defects, bytes: &[u8]) -> (usize, usize, StrayWrites) {
        let mut packets = Packets::with_defects(defects);
        let (mut input, mut good, mut bad) = (bytes, 0, 0);
        while let Some(outcome) = packets.step(&mut input) {
            *if outcome.is_ok() { &mut good } else { &mut bad } += 1;
        }
        (good, bad, packets.stray_writes())
    }

    /// Field defect XV-01: the first packet passes, the second (3028 computed, 519B sent) and all
    /// later ones do not.
    #[test]
    fn a_sum_that_is_never_cleared_passes_the_first_packet_only() {
        let defects = Defects {
            sum_is_never_cleared: true,
            ..Defects::NONE
        };
        let mut packets = Packets::with_defects(defects);
        let (first, second) = (packet(0), packet(1));
        assert!(matches!(packets.step(&mut &first[..]), Some(Ok(_))));
        let error = FrameError::Checksum {
            expected: 0x3028,
            found: 0x519B,
        };
        assert_eq!(packets.step(&mut &second[..]), Some(Err(error)));
    }

    /// Field defect XV-03: the index bytes FA, FF, 00 and 9F, which are all invalid.
    #[test]
    fn an_unchecked_index_leaves_the_array() {
        for (index, place) in [(0xFA, 360), (0xFF, 380), (0x00, 64_896), (0x9F, 65_532_i32)] {
            let bytes = packet(u8::wrapping_sub(index, FIRST_INDEX));
            let (good, bad, stray) = outcomes(Defects::FIELDED, &bytes);
            assert_eq!((good, bad, stray.count, stray.first), (0, 0, 1, place));
            let (good, _, stray) = outcomes(Defects::NONE, &bytes);
            assert_eq!((good, stray), (0, StrayWrites::NONE));
        }
    }

    #[test]
    fn a_sound_stream_is_the_same_to_both() {
        let bytes: [[u8; FRAME_LEN]; 90] =
            core::array::from_fn(|n| packet(u8::try_from(n).unwrap()));
        let sound = outcomes(Defects::NONE, bytes.as_flattened());
        assert_eq!(sound, (90, 0, StrayWrites::NONE));
        assert_eq!(outcomes(Defects::FIELDED, bytes.as_flattened()), sound);
    }

    /// Two streams: a packet that starts three bytes behind a false start; and 22 rejected bytes
    /// without another start, followed by a packet. Every packet is found.
    #[test]
    fn a_rejected_packet_costs_no_other() {
        let defects = Defects {
            any_index: true,
            ..Defects::NONE
        };
        let stream = [&[START, 0, 0][..], &packet(7), &packet(8)].concat();
        let (good, bad, _) = outcomes(defects, &stream);
        assert_eq!((good, bad), (2, 1));
        let mut noise = [1; FRAME_LEN];
        noise[0] = START;
        let stream = [&noise[..], &packet(7)].concat();
        let (good, bad, _) = outcomes(defects, &stream);
        assert_eq!((good, bad), (1, 1));
        let mut packets = Packets::with_defects(defects);
        assert_eq!(packets.step(&mut &[0, 1, START, 2][..]), None);
        assert_eq!(packets.pending(), 2);
    }

    /// 0xFA occurs within the first packet: the parser never searches bytes it has taken, whether
    /// the packet was valid, or invalid and accepted to keep its position.
    #[test]
    fn a_packet_that_was_taken_is_not_searched() {
        let within = |mut bytes: [u8; FRAME_LEN]| {
            bytes[6] = START;
            let sum = xv11::checksum(&bytes).to_le_bytes();
            bytes[20..].copy_from_slice(&sum);
            bytes
        };
        let indices = |defects, bytes: &[u8]| {
            let mut packets = Packets::with_defects(defects);
            let mut input = bytes;
            let mut found = [None; 4];
            for slot in &mut found {
                let outcome = packets.step(&mut input);
                *slot = outcome.map(|outcome| outcome.map_or(99, |frame| frame.index()));
            }
            found
        };
        let three = [within(packet(1)), within(packet(2)), within(packet(3))].concat();
        let any_index = Defects {
            any_index: true,
            ..Defects::NONE
        };
        assert_eq!(
            indices(any_index, &three),
            [Some(1), Some(2), Some(3), None]
        );
        let mut wrong = three.clone();
        wrong[10] ^= 1;
        let keeps_alignment = Defects {
            keeps_alignment: true,
            ..Defects::NONE
        };
        assert_eq!(
            indices(keeps_alignment, &wrong),
            [Some(99), Some(2), Some(3), None]
        );
    }
}
