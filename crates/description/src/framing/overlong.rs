//! The rest of a frame that is longer than allowed.

use protocols::FrameError;

use super::{Cut, Frame, Frames};
use crate::schema::wire::Stuffing;

/// Whether the bytes belong to a frame that is too long and whose end has not come yet. The decoder
/// rejects each further byte of such a frame; all of them are one error.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Overlong(bool);

impl Overlong {
    /// Whether an outcome of the decoder belongs to a frame whose error is known already.
    pub(crate) fn swallows(
        &mut self,
        outcome: &Result<Frame, FrameError>,
        formats: &Frames,
    ) -> bool {
        let all = &formats.0;
        match outcome {
            Ok(frame) => {
                let is_rest = all
                    .get(frame.format)
                    .is_some_and(|of| is_without_start(&of.cut));
                core::mem::take(&mut self.0) && is_rest
            }
            Err(FrameError::Length { max, found }) => {
                // A length field can exceed the maximum by any number.
                let is_open = *found == *max + 1
                    && all
                        .iter()
                        .any(|of| is_open(&of.cut) && of.max == *max as usize);
                let was_open = self.0;
                self.0 |= is_open;
                was_open && is_open
            }
            Err(_) => self.0 && all.iter().any(|of| is_without_start(&of.cut)),
        }
    }

    /// Ends the frame, because of a pause.
    pub(crate) const fn end(&mut self) {
        self.0 = false;
    }
}

/// Whether only a marker or a silence ends the frame.
const fn is_open(cut: &Cut) -> bool {
    matches!(cut, Cut::Marked { .. } | Cut::Silence { lengths: None })
}

/// Whether a frame can begin with any byte, so that the rest of a frame seems to be a frame.
fn is_without_start(cut: &Cut) -> bool {
    match cut {
        Cut::Marked {
            start,
            end,
            stuffing,
            ..
        } => start.is_empty() || *stuffing == Stuffing::None && start == end,
        Cut::Silence { lengths: None } => true,
        _ => false,
    }
}
