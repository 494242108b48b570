//! The byte in front of a candidate.

/// The byte before the first byte that is judged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Before {
    /// None: the stream begins.
    #[default]
    Nothing,
    /// The last byte of a frame.
    Frame(u8),
    /// A byte that was discarded.
    Discarded(u8),
}

impl Before {
    /// Whether a frame without its start marker, which is that of the previous frame's end, can
    /// begin here.
    pub(super) fn may_share(self, marker: &[u8]) -> bool {
        match self {
            Self::Nothing => true,
            Self::Frame(byte) | Self::Discarded(byte) => marker.last() == Some(&byte),
        }
    }
}
