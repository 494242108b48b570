//! The decoder of the car's own program, with its defects.

use super::frame::{FRAME_LEN, Frame, SYNC};

/// Waits for `00`, takes the next byte for the rest of the sync or starts again, then takes eleven
/// bytes for a frame, whatever they are.
///
/// Defects, kept on purpose: of `00 00 0F` the second `00` is used up by the first, so the frame is
/// lost; a sync inside a frame is as good as any other; nothing is checked. It never says that it
/// is wrong, which is why this is no [`Decode`](crate::Decode).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FieldedDecoder {
    bytes: [u8; FRAME_LEN],
    len: usize,
}

impl FieldedDecoder {
    /// Takes one byte; a frame if it was the last of one.
    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        if SYNC.get(self.len).is_some_and(|sync| *sync != byte) {
            self.len = 0;
            return None;
        }
        self.bytes[self.len] = byte;
        self.len += 1;
        if self.len < FRAME_LEN {
            return None;
        }
        self.len = 0;
        Frame::from_bytes(self.bytes)
    }
}
