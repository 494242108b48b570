//! Minimum evidence for recognising a format.

/// Minimum evidence for recognising a format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Floor {
    /// Bits of a frame that other bytes match only by chance: start, length, checksum, impossible
    /// values.
    pub check_bits: u8,
    /// Minimum share of the bytes that is in frames, per cent.
    pub share: u8,
    /// Minimum number of frames.
    pub frames: u16,
    /// Minimum share of the frames that begin directly after another frame, per cent.
    pub joined: u8,
}

impl Floor {
    /// A format with a checksum: one frame is enough if there are no other bytes; otherwise two.
    pub const CHECKED: Self = Self {
        check_bits: 18,
        share: 0,
        frames: 1,
        joined: 0,
    };

    /// A format without a checksum.
    pub const UNCHECKED: Self = Self {
        check_bits: 8,
        share: 75,
        frames: 4,
        joined: 75,
    };
}
