//! Frames that a silence ends.

use protocols::{Candidate, FrameError};

use super::Framing;
use super::judge::len_u32;
use crate::schema::message::From;

/// Possible lengths of a frame that begins with these bytes and comes from this end, the most
/// probable one first. Empty if more bytes are needed, `None` if the length is unknown.
pub(crate) type Lengths = fn(&[u8], From) -> Option<Vec<usize>>;

impl Framing {
    /// Checks whether a frame begins at the first byte; `is_last` if a silence follows the bytes.
    pub(super) fn judge_silence(
        &self,
        bytes: &[u8],
        is_last: bool,
        lengths: Option<(Lengths, From)>,
    ) -> Candidate {
        let known = lengths.and_then(|(lengths, from)| lengths(bytes, from));
        if let Some(known) = known {
            return self.judge_lengths(bytes, is_last, &known);
        }
        // Without known lengths only the silence ends a frame.
        if is_last {
            return match self.whole(bytes) {
                Candidate::Rejected(_) if bytes.len() < self.least() => Candidate::Noise,
                found => found,
            };
        }
        if bytes.len() >= self.max {
            let (max, found) = (len_u32(self.max), len_u32(self.max + 1));
            return Candidate::Rejected(FrameError::Length { max, found });
        }
        Candidate::Incomplete
    }

    /// Checks the possible lengths of a frame, the most probable one first. The CRC of a sound
    /// frame that ends with 0 also holds without its last byte, so a less probable length must wait
    /// for the bytes of the more probable ones.
    fn judge_lengths(&self, bytes: &[u8], is_last: bool, known: &[usize]) -> Candidate {
        let mut damaged = None;
        for &len in known {
            let Some(frame) = bytes.get(..len) else {
                match is_last {
                    true => continue,
                    false => return Candidate::Incomplete,
                }
            };
            match (self.whole(frame), damaged) {
                // A frame with a damaged last byte, if the silence follows it.
                (Candidate::Complete(_), Some((longer, error)))
                    if longer == bytes.len() && longer == len + 1 =>
                {
                    return match is_last {
                        true => error,
                        false => Candidate::Incomplete,
                    };
                }
                (found @ Candidate::Complete(_), _) => return found,
                (error, None) => damaged = Some((len, error)),
                _ => {}
            }
        }
        match damaged {
            Some((_, error)) => error,
            None => Candidate::Incomplete,
        }
    }
}
