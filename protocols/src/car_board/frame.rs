//! Frames with the sensors' values, and the decoder that finds them without a checksum.

use crate::{Candidate, Format, FrameError};

/// First bytes of every frame.
pub const SYNC: [u8; 2] = [0x00, 0x0F];
/// Bytes of a frame.
pub const FRAME_LEN: usize = 13;
/// Maximum range of an ultrasonic sensor: its default range of 11.008 m.
pub const ULTRASONIC_MAX_CM: u16 = 1_100;
/// Minimum and maximum voltage of a battery that the board can run from, millivolts. A guess on
/// both sides: the electronics need 6.8 V, a charged pack has 8.4 V.
pub const BATTERY_MV: [u16; 2] = [4_000, 10_000];

/// A frame with its sync; keeps every bit and checks none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame([u8; FRAME_LEN]);

impl Frame {
    /// A frame from its bytes; `None` without sync.
    pub fn from_bytes(bytes: [u8; FRAME_LEN]) -> Option<Self> {
        (bytes[..2] == SYNC).then_some(Self(bytes))
    }

    /// The frame as on the wire.
    pub const fn as_bytes(&self) -> &[u8; FRAME_LEN] {
        &self.0
    }

    /// Its content.
    pub const fn readings(&self) -> Readings {
        let [_, _, f0, f1, r0, r1, l0, l1, line, h0, h1, b0, b1] = self.0;
        Readings {
            front_cm: u16::from_le_bytes([f0, f1]),
            right_cm: u16::from_le_bytes([r0, r1]),
            left_cm: u16::from_le_bytes([l0, l1]),
            line,
            hall: u16::from_le_bytes([h0, h1]),
            battery_mv: u16::from_le_bytes([b0, b1]),
        }
    }
}

/// The values of all sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Readings {
    /// Ultrasonic range ahead; 0 means no new measurement.
    pub front_cm: u16,
    /// Ultrasonic range to the right; 0 means no new measurement.
    pub right_cm: u16,
    /// Ultrasonic range to the left; 0 means no new measurement.
    pub left_cm: u16,
    /// 1 over a line on the floor, otherwise 0.
    pub line: u8,
    /// Pulses of the wheel's magnets since the start; wraps.
    pub hall: u16,
    /// Voltage of the battery.
    pub battery_mv: u16,
}

impl Readings {
    /// The frame with these readings.
    pub const fn encode(&self) -> Frame {
        let ([f0, f1], [r0, r1]) = (self.front_cm.to_le_bytes(), self.right_cm.to_le_bytes());
        let ([l0, l1], [h0, h1]) = (self.left_cm.to_le_bytes(), self.hall.to_le_bytes());
        let [b0, b1] = self.battery_mv.to_le_bytes();
        let [s0, s1] = SYNC;
        Frame([s0, s1, f0, f1, r0, r1, l0, l1, self.line, h0, h1, b0, b1])
    }
}

/// Format of frames with plausible sensor values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameFormat {
    /// Minimum and maximum voltage of the battery, millivolts.
    pub battery_mv: [u16; 2],
}

impl Default for FrameFormat {
    /// With [`BATTERY_MV`].
    fn default() -> Self {
        Self {
            battery_mv: BATTERY_MV,
        }
    }
}

/// Finds frames. A complete frame is returned when the next one begins or the line is idle.
pub type Decoder = crate::Decoder<FrameFormat, { FRAME_LEN + SYNC.len() }>;

impl FrameFormat {
    /// The first implausible value in `bytes`, and its index. The values are checked in their order
    /// on the line, so the result does not depend on how the bytes are cut.
    fn implausible(self, bytes: &[u8]) -> Option<(usize, u16)> {
        let word = |at: usize, [least, greatest]: [u16; 2]| {
            let word = u16::from_le_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]);
            (!(least..=greatest).contains(&word)).then_some((at, word))
        };
        let range = |at: usize| word(at, [0, ULTRASONIC_MAX_CM]);
        let line = bytes.get(8).filter(|line| **line > 1);
        range(2)
            .or_else(|| range(4))
            .or_else(|| range(6))
            .or(line.map(|line| (8, u16::from(*line))))
            .or_else(|| word(11, self.battery_mv))
    }
}

impl Format for FrameFormat {
    type Frame = Frame;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        let verdict = self.judge_last(bytes);
        if !matches!(verdict, Candidate::Complete(_)) {
            return verdict;
        }
        let behind = &bytes[FRAME_LEN..];
        let same = behind
            .iter()
            .zip(SYNC)
            .take_while(|(byte, sync)| *byte == sync);
        let same = same.count();
        if same == SYNC.len() {
            verdict
        } else if same == behind.len() {
            Candidate::Incomplete
        } else {
            rejected(FRAME_LEN + same, behind[same].into())
        }
    }

    fn judge_last(&self, bytes: &[u8]) -> Candidate {
        if bytes.iter().zip(SYNC).any(|(byte, sync)| *byte != sync) {
            return Candidate::Noise;
        }
        match self.implausible(bytes) {
            Some((at, found)) => rejected(at, found),
            None if bytes.len() < FRAME_LEN => Candidate::Incomplete,
            None => Candidate::Complete(FRAME_LEN),
        }
    }

    fn frame(&self, bytes: &[u8]) -> Frame {
        let frame = bytes.try_into().ok().and_then(Frame::from_bytes);
        frame.unwrap_or_else(|| Readings::default().encode())
    }
}

fn rejected(at: usize, found: u16) -> Candidate {
    Candidate::Rejected(FrameError::Implausible {
        at: u32::try_from(at).unwrap_or(u32::MAX),
        found: found.into(),
    })
}
