//! Evidence that bytes have a format, and the minimum evidence for recognising it.
//!
//! Any format matches some bytes of another format by chance. With a checksum this is rare, so few
//! frames are sufficient evidence. A format without a checksum must explain nearly all bytes, with
//! many consecutive frames.

use super::floor::Floor;
use super::row::Codec;

/// Evidence of bytes for a format.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Evidence {
    /// Number of all bytes.
    pub bytes: u64,
    /// Number of bytes in valid frames with plausible values.
    pub framed: u64,
    /// Number of these frames.
    pub frames: u64,
    /// Number of frames that begin where another one ends.
    pub joined: u64,
}

impl Evidence {
    /// The evidence of `bytes` for `codec`.
    pub fn of(codec: &Codec, bytes: &[u8]) -> Self {
        let mut evidence = Self {
            bytes: bytes.len() as u64,
            ..Self::default()
        };
        let mut last_end = None;
        for frame in codec.plausible_frames(bytes) {
            evidence.frames += 1;
            evidence.framed += frame.end - frame.start;
            evidence.joined += u64::from(last_end == Some(frame.start));
            last_end = Some(frame.end);
        }
        evidence
    }

    /// Whether the evidence is sufficient. Each byte is another chance for a random match, so more
    /// bytes need more bits of evidence. If nearly all bytes are explained, fewer bits are needed.
    pub fn is_enough(&self, floor: &Floor) -> bool {
        if self.frames < u64::from(floor.frames).max(1) {
            return false;
        }
        let share = self.framed * 100 / self.bytes.max(1);
        let follow = (self.frames - 1) * u64::from(floor.joined);
        if share < u64::from(floor.share) || self.joined * 100 < follow {
            return false;
        }
        const EXPLAINED: u64 = 90;
        let surprise = if share >= EXPLAINED { 10 } else { 20 };
        let tries = u64::from(u64::BITS - self.bytes.leading_zeros());
        self.frames * u64::from(floor.check_bits) >= tries + surprise
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BUS, CAR_COMMAND, PERIPHERALS};
    use super::*;

    /// The golden read of ten registers, low byte first: 0xAB + 0x24 + 0x0A = 0xD9.
    const READ: [u8; 5] = [0xAB, 0x24, 0x0A, 0xD9, 0x00];

    fn is_enough(codec: &Codec, bytes: &[u8]) -> bool {
        Evidence::of(codec, bytes).is_enough(codec.floor())
    }

    #[test]
    fn a_frame_proves_a_checked_format_if_little_is_beside_it() {
        assert!(is_enough(&BUS, &READ));
        let among = |frames: usize, others: usize| [READ.repeat(frames), vec![2; others]].concat();
        assert!(!is_enough(&BUS, &among(1, 60)));
        assert!(is_enough(&BUS, &among(2, 2_000)));
        assert!(!is_enough(&BUS, &[2; 64]));
        assert!(!is_enough(&BUS, &[]));
    }

    /// Pairs of a motor and a steering byte: many in sequence, and few other bytes.
    #[test]
    fn an_unchecked_format_must_explain_nearly_all() {
        let pair = [0x8C, 0x3A];
        assert!(is_enough(&CAR_COMMAND, &pair.repeat(8)));
        assert!(!is_enough(&CAR_COMMAND, &pair.repeat(3)));
        let apart: Vec<u8> = (0..50).flat_map(|_| [0x8C, 0x3A, 0xFF]).collect();
        assert!(!is_enough(&CAR_COMMAND, &apart));
        let damaged = [pair.repeat(20), vec![0xFF; 6], pair.repeat(20)].concat();
        assert!(is_enough(&CAR_COMMAND, &damaged));
    }

    /// A frame in the format of a sample is no evidence if its counters have more bits than those
    /// of the hardware.
    #[test]
    fn values_that_cannot_be_are_no_evidence() {
        let frame = [
            0x80, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F,
        ];
        let evidence = Evidence::of(&PERIPHERALS, &frame.repeat(20));
        assert_eq!((evidence.frames, evidence.bytes), (0, 240));
    }
}
