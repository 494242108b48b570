//! The contract of every decoder, and its one implementation.

use core::fmt;

/// Turns bytes into frames, however the bytes are cut into pieces.
///
/// - Total: any bytes, no panic. Every byte pushed ends in a frame, is discarded and counted, or is
///   pending.
/// - Indifferent to chunking: the frames depend on the bytes and on the calls of
///   [`idle`](Self::idle), never on how the bytes were cut.
/// - A rejected candidate costs one byte, so a frame that begins inside it is still found.
pub trait Decode {
    /// The decoded frame: verified, with every bit kept.
    type Frame;

    /// Takes bytes from the front of `input` until there is a result.
    ///
    /// `None` means that `input` is empty and that the pending bytes give no further result. An
    /// `Err` reports a rejected candidate, which cost exactly one byte; decoding continues.
    fn step(&mut self, input: &mut &[u8]) -> Option<Result<Self::Frame, FrameError>>;

    /// Reports a quiet line: an unfinished candidate will not be finished.
    ///
    /// Complete frames inside the discarded bytes come out of the next [`step`](Self::step) or
    /// [`push`](Self::push), even without further bytes. A second call is harmless.
    fn idle(&mut self);

    /// Bytes taken but not yet judged.
    fn pending(&self) -> usize;

    /// Number of bytes discarded since the decoder was made.
    fn discarded(&self) -> u64;

    /// Feeds `bytes`; iterating yields frames and errors. Dropping the iterator early still feeds
    /// the rest.
    fn push<'a>(&'a mut self, bytes: &'a [u8]) -> Frames<'a, Self>
    where
        Self: Sized,
    {
        Frames {
            decoder: self,
            input: bytes,
        }
    }
}

/// Iterator of [`Decode::push`].
#[derive(Debug)]
pub struct Frames<'a, D: Decode> {
    decoder: &'a mut D,
    input: &'a [u8],
}

impl<D: Decode> Iterator for Frames<'_, D> {
    type Item = Result<D::Frame, FrameError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.decoder.step(&mut self.input)
    }
}

impl<D: Decode> Drop for Frames<'_, D> {
    fn drop(&mut self) {
        while self.next().is_some() {}
    }
}

/// Reason for rejecting a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FrameError {
    /// The computed checksum differs from the received one.
    Checksum {
        /// Computed from the frame.
        expected: u32,
        /// Sent with the frame.
        found: u32,
    },
    /// The length field announces more than the format allows.
    Length {
        /// Most payload bytes that are allowed.
        max: u32,
        /// Value of the length field.
        found: u32,
    },
    /// The line went quiet, or the next frame began, before the frame was complete.
    Truncated {
        /// Bytes that had arrived.
        found: u32,
    },
    /// An escape byte before a byte that needs no escape.
    Escape {
        /// The byte behind the escape byte.
        found: u8,
    },
    /// An implausible value, in a format without a checksum.
    Implausible {
        /// Index of its first byte in the frame; behind the frame if no frame follows.
        at: u32,
        /// The value.
        found: u32,
    },
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Checksum { expected, found } => {
                write!(f, "checksum is {found:#06x}, expected {expected:#06x}")
            }
            Self::Length { max, found } => write!(f, "length is {found}, at most {max} allowed"),
            Self::Truncated { found } => write!(f, "line went quiet after {found} bytes"),
            Self::Escape { found } => write!(f, "escaped byte is {found:#04x}, it needs no escape"),
            Self::Implausible { at, found } => {
                write!(f, "value at byte {at} is {found}, implausible")
            }
        }
    }
}

impl core::error::Error for FrameError {}

/// State of the bytes at the front of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Candidate {
    /// The first byte cannot begin a frame.
    Noise,
    /// Valid so far; at least one more byte is needed.
    Incomplete,
    /// A rejected candidate.
    Rejected(FrameError),
    /// The first `n` bytes are a verified frame.
    Complete(usize),
}

/// A frame format: everything that [`Decoder`] needs of a protocol.
pub trait Format {
    /// The value decoded from a verified frame.
    type Frame;

    /// Judges the non-empty `bytes` from their first one. Must return `Noise`, `Rejected` or
    /// `Complete` at the latest when `bytes` fills the decoder's buffer. More bytes must never turn
    /// `Noise` or `Rejected` into another result.
    fn judge(&self, bytes: &[u8]) -> Candidate;

    /// Judges the non-empty `bytes` at the end of the input. A format with few check bits waits in
    /// [`judge`](Self::judge) for the bytes behind a frame; here it decides without them.
    /// `Incomplete` counts as cut off.
    fn judge_last(&self, bytes: &[u8]) -> Candidate {
        self.judge(bytes)
    }

    /// Makes the frame; called only with bytes that were judged complete.
    fn frame(&self, bytes: &[u8]) -> Self::Frame;

    /// Notes bytes that leave the buffer: a frame, or one discarded byte. A format whose frames may
    /// begin without a marker needs them to know whether a frame can begin at the next byte.
    fn passed(&mut self, _bytes: &[u8], _is_frame: bool) {}
}

/// The decoder of every format: a buffer of `N` bytes, at least the longest frame.
#[derive(Clone, Debug)]
pub struct Decoder<F, const N: usize> {
    format: F,
    buf: [u8; N],
    /// The pending bytes are `buf[start..end]`.
    start: usize,
    end: usize,
    discarded: u64,
    quiet: bool,
    /// Whether the pending bytes were judged incomplete. They are not judged again until more come,
    /// the line falls silent, or the format changes.
    is_incomplete: bool,
}

impl<F: Format, const N: usize> Decoder<F, N> {
    /// An empty decoder of `format`.
    pub const fn with_format(format: F) -> Self {
        Self {
            format,
            buf: [0; N],
            start: 0,
            end: 0,
            discarded: 0,
            quiet: false,
            is_incomplete: false,
        }
    }

    /// The format.
    pub(crate) const fn format(&self) -> &F {
        &self.format
    }

    /// The format, for changes that apply to pending and later bytes: some protocols announce the
    /// next frame in the current one.
    pub(crate) const fn format_mut(&mut self) -> &mut F {
        self.is_incomplete = false;
        &mut self.format
    }

    /// The frame that consists of all `bytes`, if no bytes are pending. Feeding the bytes, in any
    /// pieces, would give this frame with the last of them, and nothing else. With `None` nothing
    /// has changed.
    pub fn whole(&mut self, bytes: &[u8]) -> Option<F::Frame> {
        let is_free = self.start == self.end && !bytes.is_empty() && bytes.len() <= N;
        if !is_free || self.format.judge(bytes) != Candidate::Complete(bytes.len()) {
            return None;
        }
        let frame = self.format.frame(bytes);
        self.format.passed(bytes, true);
        Some(frame)
    }

    /// Judges the pending bytes. `Some` if there is a result; skipped noise alone is none.
    fn settle(&mut self) -> Option<Result<F::Frame, FrameError>> {
        if self.is_incomplete {
            return None;
        }
        while self.start < self.end {
            let bytes = &self.buf[self.start..self.end];
            let verdict = if self.quiet {
                self.format.judge_last(bytes)
            } else {
                self.format.judge(bytes)
            };
            match verdict {
                Candidate::Noise => self.discard_one(),
                Candidate::Rejected(error) => {
                    self.discard_one();
                    return Some(Err(error));
                }
                Candidate::Complete(len) => {
                    let frame = self.format.frame(&bytes[..len]);
                    self.format.passed(&bytes[..len], true);
                    self.start += len;
                    return Some(Ok(frame));
                }
                // A full buffer that is still incomplete breaks the format's contract; giving a
                // byte up keeps even that from standing still.
                Candidate::Incomplete if self.quiet || bytes.len() == N => {
                    let found = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
                    self.discard_one();
                    return Some(Err(FrameError::Truncated { found }));
                }
                Candidate::Incomplete => {
                    self.is_incomplete = true;
                    return None;
                }
            }
        }
        self.quiet = false;
        None
    }

    fn discard_one(&mut self) {
        self.format
            .passed(&self.buf[self.start..=self.start], false);
        self.start += 1;
        self.discarded += 1;
    }

    /// Takes input until the buffer is full.
    fn fill(&mut self, input: &mut &[u8]) {
        if self.start == self.end {
            (self.start, self.end) = (0, 0);
        } else if self.end == N {
            self.buf.copy_within(self.start.., 0);
            (self.start, self.end) = (0, self.end - self.start);
        }
        let (taken, rest) = input.split_at(input.len().min(N - self.end));
        self.buf[self.end..self.end + taken.len()].copy_from_slice(taken);
        self.end += taken.len();
        self.is_incomplete = false;
        *input = rest;
    }
}

impl<F: Format, const N: usize> Decode for Decoder<F, N> {
    type Frame = F::Frame;

    fn step(&mut self, input: &mut &[u8]) -> Option<Result<F::Frame, FrameError>> {
        loop {
            // Bytes pending at an idle line are settled before new bytes join them.
            if let Some(outcome) = self.settle() {
                return Some(outcome);
            }
            if input.is_empty() {
                return None;
            }
            self.fill(input);
        }
    }

    fn idle(&mut self) {
        self.quiet = self.start < self.end;
        self.is_incomplete = false;
    }

    fn pending(&self) -> usize {
        self.end - self.start
    }

    fn discarded(&self) -> u64 {
        self.discarded
    }
}

impl<F: Format + Default, const N: usize> Default for Decoder<F, N> {
    fn default() -> Self {
        Self::with_format(F::default())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString as _;

    use super::*;

    #[test]
    fn what_was_found_and_what_was_expected_are_told() {
        let told = [
            (
                FrameError::Checksum {
                    expected: 0x1234,
                    found: 1,
                },
                "checksum is 0x0001, expected 0x1234",
            ),
            (
                FrameError::Length { max: 8, found: 9 },
                "length is 9, at most 8 allowed",
            ),
            (
                FrameError::Truncated { found: 3 },
                "line went quiet after 3 bytes",
            ),
            (
                FrameError::Escape { found: 0x41 },
                "escaped byte is 0x41, it needs no escape",
            ),
            (
                FrameError::Implausible {
                    at: 2,
                    found: 1_101,
                },
                "value at byte 2 is 1101, implausible",
            ),
        ];
        for (error, text) in told {
            assert_eq!(error.to_string(), text);
        }
    }

    /// A format that breaks the contract on purpose: it waits forever once it saw a 1; any 2 is a
    /// frame.
    struct Undecided;

    impl Format for Undecided {
        type Frame = u8;

        fn judge(&self, bytes: &[u8]) -> Candidate {
            match bytes[0] {
                1 => Candidate::Incomplete,
                2 => Candidate::Complete(1),
                _ => Candidate::Noise,
            }
        }

        fn frame(&self, bytes: &[u8]) -> u8 {
            bytes[0]
        }
    }

    /// A full buffer must not stop the stream, whatever the format returns.
    #[test]
    fn a_format_that_never_decides_costs_one_byte_per_full_buffer() {
        let mut decoder: Decoder<_, 4> = Decoder::with_format(Undecided);
        let truncated = Err(FrameError::Truncated { found: 4 });
        let mut outcomes = decoder.push(&[1, 2, 0, 0, 1, 2, 2, 2, 2]);
        assert_eq!(outcomes.next(), Some(truncated));
        assert_eq!(outcomes.next(), Some(Ok(2)));
        assert_eq!(outcomes.next(), Some(truncated));
        assert_eq!(outcomes.by_ref().filter(|one| *one == Ok(2)).count(), 4);
        drop(outcomes);
        assert_eq!((decoder.pending(), decoder.discarded()), (0, 4));
    }

    /// The iterator is lazy: its drop feeds the remaining bytes.
    #[test]
    fn dropping_the_iterator_feeds_the_rest() {
        let mut decoder: Decoder<_, 4> = Decoder::with_format(Undecided);
        drop(decoder.push(&[0, 0, 1]));
        assert_eq!((decoder.pending(), decoder.discarded()), (1, 2));
    }
}
