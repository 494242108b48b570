//! The decoder of the car's own program, with its defects.

use super::frame::{FRAME_LEN, Frame, SYNC};

/// Waits for `00`. If the next byte completes the sync, takes eleven bytes of any value as a frame;
/// otherwise starts again.
///
/// Defects, kept on purpose. In `00 00 0F` the first `00` uses up the second, so the frame is lost.
/// A sync inside a frame counts like any other. No value is checked. It reports no errors, so it
/// does not implement [`Decode`](crate::Decode).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FieldedDecoder {
    bytes: [u8; FRAME_LEN],
    len: usize,
}

impl FieldedDecoder {
    /// Takes one byte; returns the frame that it completes, if any.
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
