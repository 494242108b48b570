//! Finds frames in the byte stream, optionally with the defects of the fielded ends.

use super::{ESCAPE, FLIP, Frame, PAYLOAD_MAX, START, checksum};
use crate::{Decode, FrameError};

/// Enabled defects of both fielded ends of the link; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// A wrong checksum sets the state ERROR, which DONE overwrites: the frame is delivered.
    pub deliver_corrupt: bool,
    /// A start byte inside a frame is taken for data, so one lost byte costs two frames.
    pub ignore_start: bool,
    /// Bytes between a frame and [`Decoder::read_done`] are discarded.
    pub deaf_while_done: bool,
}

/// Finds frames in the byte stream. A start byte always begins a frame, so a damaged frame costs
/// only itself.
#[derive(Clone, Debug)]
pub struct Decoder {
    defects: Defects,
    state: State,
    /// Whether the candidate's next byte is escaped.
    escaped: bool,
    /// As announced; valid once the payload begins.
    length: u16,
    payload: [u8; PAYLOAD_MAX],
    len: usize,
    /// Bytes of the candidate as on the wire.
    pending: usize,
    discarded: u64,
    /// Result of a candidate that a start byte or a pause ended.
    cut: Option<FrameError>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// No start byte yet.
    Hunt,
    LengthHigh,
    LengthLow,
    Payload,
    Checksum,
    /// A frame waits to be read; only with [`Defects::deaf_while_done`].
    Done,
}

impl Decoder {
    /// A decoder with these defects.
    pub const fn new(defects: Defects) -> Self {
        Self {
            defects,
            state: State::Hunt,
            escaped: false,
            length: 0,
            payload: [0; PAYLOAD_MAX],
            len: 0,
            pending: 0,
            discarded: 0,
            cut: None,
        }
    }

    /// Reports that the owner has read the last frame. Until then a decoder with
    /// [`Defects::deaf_while_done`] discards arriving bytes; any other ignores this call.
    pub fn read_done(&mut self) {
        if self.state == State::Done {
            self.state = State::Hunt;
        }
    }

    /// Decodes one byte.
    fn push_byte(&mut self, byte: u8) -> Option<Result<Frame, FrameError>> {
        if matches!(self.state, State::Hunt | State::Done) {
            if byte == START && self.state == State::Hunt {
                self.begin();
            } else {
                self.discarded += 1;
            }
            return None;
        }
        if byte == START && !self.defects.ignore_start {
            let found = self.give_up();
            self.begin();
            return Some(Err(FrameError::Truncated { found }));
        }
        self.pending += 1;
        if byte == ESCAPE && !self.escaped {
            self.escaped = true;
            return None;
        }
        let is_escaped = core::mem::take(&mut self.escaped);
        let plain = if is_escaped { byte ^ FLIP } else { byte };
        // The fielded ends take any byte behind an escape; only two of them can be sound.
        let is_strict = !self.defects.deliver_corrupt && !self.defects.ignore_start;
        if is_escaped && is_strict && !matches!(plain, START | ESCAPE) {
            self.give_up();
            return Some(Err(FrameError::Escape { found: byte }));
        }
        self.push_plain(plain)
    }

    /// Decodes one byte after unescaping.
    fn push_plain(&mut self, byte: u8) -> Option<Result<Frame, FrameError>> {
        match self.state {
            State::Hunt | State::Done => {}
            State::LengthHigh => {
                self.length = u16::from(byte) << 8;
                self.state = State::LengthLow;
            }
            State::LengthLow => {
                self.length |= u16::from(byte);
                self.state = match self.length {
                    0 => State::Checksum,
                    _ => State::Payload,
                };
                if usize::from(self.length) > PAYLOAD_MAX {
                    self.give_up();
                    let found = u32::from(self.length);
                    let max = u32::try_from(PAYLOAD_MAX).expect("3200");
                    return Some(Err(FrameError::Length { max, found }));
                }
            }
            State::Payload => {
                self.payload[self.len] = byte;
                self.len += 1;
                if self.len == usize::from(self.length) {
                    self.state = State::Checksum;
                }
            }
            State::Checksum => return Some(self.finish(byte)),
        }
        None
    }

    fn finish(&mut self, found: u8) -> Result<Frame, FrameError> {
        let expected = checksum(&self.payload[..self.len]);
        if expected != found && !self.defects.deliver_corrupt {
            self.give_up();
            return Err(FrameError::Checksum {
                expected: u32::from(expected),
                found: u32::from(found),
            });
        }
        self.pending = 0;
        self.state = match self.defects.deaf_while_done {
            true => State::Done,
            false => State::Hunt,
        };
        Ok(Frame {
            payload: self.payload,
            len: self.len,
            checksum: found,
        })
    }

    /// Begins a candidate at a start byte.
    fn begin(&mut self) {
        self.state = State::LengthHigh;
        self.escaped = false;
        self.len = 0;
        self.pending = 1;
    }

    /// Discards the candidate; returns its length. It contains no start byte, so no frame begins in
    /// it, unless start bytes are ignored anyway.
    fn give_up(&mut self) -> u32 {
        let found = core::mem::take(&mut self.pending);
        self.discarded += found as u64;
        self.state = State::Hunt;
        u32::try_from(found).unwrap_or(u32::MAX)
    }
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new(Defects::default())
    }
}

impl Decode for Decoder {
    type Frame = Frame;

    /// Like every step, except that a rejected candidate is discarded as a whole: see `give_up`.
    fn step(&mut self, input: &mut &[u8]) -> Option<Result<Frame, FrameError>> {
        if let Some(error) = self.cut.take() {
            return Some(Err(error));
        }
        while let Some((&byte, rest)) = input.split_first() {
            *input = rest;
            if let Some(outcome) = self.push_byte(byte) {
                return Some(outcome);
            }
        }
        None
    }

    fn idle(&mut self) {
        if self.pending > 0 {
            let found = self.give_up();
            self.cut = Some(FrameError::Truncated { found });
        }
    }

    fn pending(&self) -> usize {
        self.pending
    }

    fn discarded(&self) -> u64 {
        self.discarded
    }
}
