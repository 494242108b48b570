//! Lines of text, and the decoder that finds their ends.

use core::fmt;

use super::float::print_float;
use crate::{Candidate, Format, FrameError};

/// The longest line, with its end.
pub const LINE_MAX: usize = 160;

/// A line with its end, or the beginning of one.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Text {
    bytes: [u8; LINE_MAX],
    len: usize,
}

impl Text {
    /// All bytes.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }

    /// Content before the end of the line.
    pub fn content(&self) -> &[u8] {
        let line = self.as_bytes();
        let line = line.strip_suffix(b"\n").unwrap_or(line);
        line.strip_suffix(b"\r").unwrap_or(line)
    }

    /// A figure with two decimals and the `*` behind it.
    pub(super) fn field(&mut self, figure: f32) {
        let _ = print_float(self, figure, 2).and_then(|()| fmt::Write::write_char(self, '*'));
    }
}

impl Default for Text {
    /// An empty text.
    fn default() -> Self {
        Self {
            bytes: [0; LINE_MAX],
            len: 0,
        }
    }
}

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Text({})", self.as_bytes().escape_ascii())
    }
}

impl fmt::Write for Text {
    /// An error if there is no room; no byte is written then.
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let end = self.len + text.len();
        let room = self.bytes.get_mut(self.len..end).ok_or(fmt::Error)?;
        room.copy_from_slice(text.as_bytes());
        self.len = end;
        Ok(())
    }
}

/// Lines that end in LF, CR LF, or (behind a terminal driver that makes LF of CR) LF LF, which is
/// an empty line more.
#[derive(Clone, Copy, Debug, Default)]
pub struct TextFormat;

/// Finds lines; [`Dialect::read`](super::Dialect::read) reads their content.
pub type Decoder = crate::Decoder<TextFormat, LINE_MAX>;

impl Format for TextFormat {
    type Frame = Text;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        match bytes.iter().position(|byte| *byte == b'\n') {
            Some(end) => Candidate::Complete(end + 1),
            None if bytes.len() < LINE_MAX => Candidate::Incomplete,
            None => Candidate::Rejected(FrameError::Length {
                max: u32::try_from(LINE_MAX).unwrap_or(u32::MAX),
                found: u32::try_from(bytes.len()).unwrap_or(u32::MAX),
            }),
        }
    }

    fn frame(&self, bytes: &[u8]) -> Text {
        let mut text = Text::default();
        let len = bytes.len().min(LINE_MAX);
        text.bytes[..len].copy_from_slice(&bytes[..len]);
        text.len = len;
        text
    }
}
