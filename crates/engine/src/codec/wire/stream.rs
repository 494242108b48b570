use super::{Choices, Wire};
use crate::hex;

/// Maximum number of frames, pieces and damages of a session.
const ITEMS_MAX: usize = 64;

/// Bytes as a line delivers them: in pieces, with pauses.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stream {
    bytes: Vec<u8>,
    /// Ends of the pieces in their order, and whether the line was idle after each.
    marks: Vec<(usize, bool)>,
}

/// A part of a [`Stream`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Piece<'a> {
    /// Bytes that arrive at once.
    Bytes(&'a [u8]),
    /// The line is quiet.
    Idle,
}

/// A line of a stream's text that is not valid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StreamError {
    /// Line number, from 1.
    pub line: usize,
    /// Text of the line.
    pub found: String,
}

impl core::fmt::Display for StreamError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { line, found } = self;
        write!(
            f,
            "line {line}: \"{found}\", expected hexadecimal pairs or \"idle\""
        )
    }
}

impl core::error::Error for StreamError {}

impl Stream {
    /// `bytes` in one piece.
    pub fn raw(bytes: &[u8]) -> Self {
        Self {
            bytes: bytes.to_vec(),
            marks: Vec::new(),
        }
    }

    /// The stream that consists of `pieces`.
    pub fn of<'a>(pieces: impl IntoIterator<Item = Piece<'a>>) -> Self {
        let mut stream = Self::default();
        let mut is_open = false;
        for piece in pieces {
            let at = stream.bytes.len();
            match piece {
                Piece::Idle => stream.marks.push((at, true)),
                Piece::Bytes(bytes) => {
                    if is_open {
                        stream.marks.push((at, false));
                    }
                    stream.bytes.extend(bytes);
                }
            }
            is_open = matches!(piece, Piece::Bytes(_));
        }
        stream
    }

    /// All bytes, without piece boundaries.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Bytes and pauses in their order.
    pub fn pieces(&self) -> impl Iterator<Item = Piece<'_>> {
        let mut start = 0;
        let ends = self.marks.iter().copied();
        let ends = ends.chain(core::iter::once((self.bytes.len(), false)));
        ends.flat_map(move |(end, idle)| {
            let bytes = Piece::Bytes(&self.bytes[core::mem::replace(&mut start, end)..end]);
            core::iter::once(bytes).chain(idle.then_some(Piece::Idle))
        })
    }

    /// Bytes between pauses.
    pub(super) fn stretches(&self) -> impl Iterator<Item = &[u8]> {
        let mut start = 0;
        let pauses = self
            .marks
            .iter()
            .filter(|(_, idle)| *idle)
            .map(|mark| mark.0);
        pauses
            .chain(core::iter::once(self.bytes.len()))
            .map(move |end| &self.bytes[core::mem::replace(&mut start, end)..end])
    }

    /// The session that `data` describes: valid frames, cut ones, noise and damage, up to 64 of
    /// them. The first byte determines whether checksums are repaired after damage.
    ///
    /// Any bytes describe a session, and any session can be described: `0B` and a length copy the
    /// bytes behind them unchanged.
    pub fn session<W: Wire>(data: &[u8]) -> Self {
        let mut choices = Choices::new(data);
        let repairs = choices.byte() & 1 == 1;
        let mut session = Self::default();
        let mut last = 0;
        for _ in 0..ITEMS_MAX {
            if choices.is_empty() {
                break;
            }
            match choices.byte() % 16 {
                0..10 => {
                    last = session.bytes.len();
                    W::build(&mut choices, &mut session.bytes);
                }
                10 => {
                    last = session.bytes.len();
                    W::build(&mut choices, &mut session.bytes);
                    let kept = choices.below(session.bytes.len() - last);
                    session.bytes.truncate(last + kept);
                }
                11 => {
                    last = session.bytes.len();
                    let len = usize::from(choices.byte());
                    session.bytes.extend(choices.take(len));
                }
                12 => session.mark(choices.byte() & 1 == 1, &mut last),
                damage => {
                    session.damage(damage, last, &mut choices);
                    if repairs {
                        W::repair(&mut session.bytes[last..]);
                    }
                }
            }
        }
        session
    }

    /// Ends a piece at the current position.
    fn mark(&mut self, idle: bool, last: &mut usize) {
        *last = self.bytes.len();
        self.marks.push((*last, idle));
    }

    /// Damages a byte at or after `from`.
    fn damage(&mut self, kind: u8, from: usize, choices: &mut Choices<'_>) {
        let len = self.bytes.len() - from;
        if len == 0 {
            return;
        }
        let at = from + choices.below(len);
        match kind {
            13 => self.bytes[at] ^= 1 << (choices.byte() % 8),
            14 => drop(self.bytes.remove(at)),
            _ => self.bytes.insert(at, choices.byte()),
        }
    }

    /// The stream as text: a piece a line in hexadecimal pairs, `idle` for a pause.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        for piece in self.pieces() {
            match piece {
                Piece::Bytes([]) => continue,
                Piece::Idle => text.push_str("idle"),
                Piece::Bytes(bytes) => text += &hex::pairs(bytes),
            }
            text.push('\n');
        }
        text
    }

    /// Reads the text of [`to_text`](Self::to_text); `#` begins a comment. A line that ends in `\`
    /// continues in the next one.
    pub fn parse(text: &str) -> Result<Self, StreamError> {
        let mut stream = Self::default();
        let mut goes_on = true;
        for (line, whole) in (1..).zip(text.lines()) {
            let said = whole.split('#').next().unwrap_or_default().trim();
            let wrong = |found: &str| StreamError {
                line,
                found: found.to_owned(),
            };
            if said == "idle" {
                stream.marks.push((stream.bytes.len(), true));
                goes_on = true;
                continue;
            }
            if said.is_empty() {
                continue;
            }
            if !core::mem::replace(&mut goes_on, said.ends_with('\\')) {
                stream.marks.push((stream.bytes.len(), false));
            }
            for pair in said.trim_end_matches('\\').split_whitespace() {
                let byte = hex::byte(pair.as_bytes());
                stream.bytes.push(byte.ok_or_else(|| wrong(pair))?);
            }
        }
        Ok(stream)
    }

    /// Data from which [`session`](Self::session) makes this stream, limited to 64 items: it turns
    /// a readable stream into the start of a fuzzer's corpus.
    pub fn to_data(&self) -> Vec<u8> {
        let mut data = vec![0];
        for piece in self.pieces() {
            match piece {
                Piece::Idle => data.extend([12, 1]),
                Piece::Bytes(bytes) => {
                    for part in bytes.chunks(255) {
                        data.extend([11, u8::try_from(part.len()).expect("at most 255")]);
                        data.extend(part);
                    }
                    data.extend([12, 0]);
                }
            }
        }
        data
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::Xv11;
    use super::*;

    #[test]
    fn a_stream_is_read_as_it_is_written() {
        let text = "AB 24\nidle\nFF\n00 01\nidle\n";
        let stream = Stream::parse(text).expect("a stream");
        assert_eq!(stream.bytes(), [0xAB, 0x24, 0xFF, 0x00, 0x01]);
        assert_eq!(stream.to_text(), text);
    }

    #[test]
    fn a_stream_is_the_sum_of_its_pieces() {
        let stream = Stream::parse("AB 24\nFF\nidle\nidle\n00 01\n").expect("a stream");
        assert_eq!(Stream::of(stream.pieces()).to_text(), stream.to_text());
    }

    #[test]
    fn a_word_that_is_no_byte_is_named_with_its_line() {
        for (text, line, found) in [("AB\nXY", 2, "XY"), ("ABC", 1, "ABC"), ("+1", 1, "+1")] {
            let found = found.to_owned();
            assert_eq!(Stream::parse(text), Err(StreamError { line, found }));
        }
    }

    #[test]
    fn a_readable_stream_can_be_given_to_a_fuzzer() {
        let stream = Stream::parse("FA A0\nidle\n01 02 # noise\n").expect("a stream");
        let again = Stream::session::<Xv11>(&stream.to_data());
        assert_eq!(again.to_text(), stream.to_text());
    }
}
