//! One sample of a standard scan.

use crate::FrameError;

/// Bytes of a node.
pub const NODE_LEN: usize = 5;

/// A sample whose check bits hold. Keeps every bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node([u8; NODE_LEN]);

/// State of the check bits in the first two bytes of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Head {
    /// Not all of them are there yet.
    Unknown,
    /// Both hold; whether this is the first node of a turn.
    Sound { starts_turn: bool },
    /// The two start bits are equal: no node begins here.
    NoStart,
    /// The check bit is 0.
    NoCheck,
}

impl Node {
    /// The node of these parts. `quality` is cut to 6 bits and `angle_q6` to 15.
    pub fn new(starts_turn: bool, quality: u8, angle_q6: u16, distance_q2: u16) -> Self {
        let flags = if starts_turn { 0b01 } else { 0b10 };
        let [angle_low, angle_high] = (angle_q6 << 1 | 1).to_le_bytes();
        let [near, far] = distance_q2.to_le_bytes();
        Self([quality << 2 | flags, angle_low, angle_high, near, far])
    }

    /// The node with these bytes.
    ///
    /// # Errors
    /// If the start bits are equal or the check bit is 0; the bits are given as a checksum.
    pub fn parse(bytes: [u8; NODE_LEN]) -> Result<Self, FrameError> {
        match head(&bytes) {
            Head::Sound { .. } => Ok(Self(bytes)),
            _ => Err(check_bits(&bytes)),
        }
    }

    /// Makes it from bytes that were already judged.
    pub(super) const fn from_judged(bytes: [u8; NODE_LEN]) -> Self {
        Self(bytes)
    }

    /// Whether the node is the first of a turn.
    pub const fn starts_turn(self) -> bool {
        self.0[0] & 1 != 0
    }

    /// Strength of the return, 0 to 63.
    pub const fn quality(self) -> u8 {
        self.0[0] >> 2
    }

    /// Angle in 64ths of a degree, clockwise from ahead; the format holds up to 511 degrees.
    pub const fn angle_q6(self) -> u16 {
        u16::from_le_bytes([self.0[1], self.0[2]]) >> 1
    }

    /// Distance in quarters of a millimetre; 0 is no measurement.
    pub const fn distance_q2(self) -> u16 {
        u16::from_le_bytes([self.0[3], self.0[4]])
    }

    /// Angle in degrees, clockwise from ahead.
    pub fn angle_deg(self) -> f32 {
        f32::from(self.angle_q6()) / 64.0
    }

    /// Distance in millimetres; `None`: no measurement.
    pub fn distance_mm(self) -> Option<f32> {
        let distance = self.distance_q2();
        (distance != 0).then(|| f32::from(distance) / 4.0)
    }

    /// The node as on the wire.
    pub const fn as_bytes(&self) -> &[u8; NODE_LEN] {
        &self.0
    }
}

/// Judges the check bits of a possible node.
pub(super) const fn head(bytes: &[u8]) -> Head {
    match *bytes {
        [] => Head::Unknown,
        [first, ..] if first & 1 == first >> 1 & 1 => Head::NoStart,
        [_] => Head::Unknown,
        [_, second, ..] if second & 1 == 0 => Head::NoCheck,
        [first, ..] => Head::Sound {
            starts_turn: first & 1 != 0,
        },
    }
}

/// The three check bits of a node (!S S C, expected 101 or 011) as a wrong checksum. If the start
/// bits are wrong, the third bit counts as right, because it may not have arrived yet.
pub(super) fn check_bits(bytes: &[u8]) -> FrameError {
    let first = bytes.first().copied().unwrap_or_default();
    let (start, not_start) = (u32::from(first & 1), u32::from(first >> 1 & 1));
    FrameError::Checksum {
        expected: (start ^ 1) << 2 | start << 1 | 1,
        found: not_start << 2 | start << 1 | u32::from(start == not_start),
    }
}
