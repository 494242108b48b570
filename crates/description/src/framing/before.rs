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
    /// Whether a frame can begin here without its start marker, because the end marker of the
    /// previous frame serves as one.
    pub(super) fn may_share(self, marker: &[u8]) -> bool {
        match self {
            Self::Nothing => true,
            Self::Frame(byte) | Self::Discarded(byte) => marker.last() == Some(&byte),
        }
    }
}
