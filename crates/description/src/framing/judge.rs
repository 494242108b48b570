//! Recognition of frames: the described formats for the common decoder.

use std::sync::Arc;

use protocols::{Candidate, Decoder, Format, FrameError};

use super::before::Before;
use super::{Cut, FRAME_MAX, FrameBytes, Framing, Length};
use crate::schema::message::From;
use crate::schema::wire::Stuffing;

/// The frame formats of a description, which of them are tried, and the context of the bytes.
#[derive(Clone, Debug)]
pub struct Frames(pub(crate) Arc<Vec<Framing>>, Unused, Looked, Context);

/// The context on which the judgement of bytes depends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Context {
    /// The byte before the first one.
    pub(super) before: Before,
    /// The end that sends the bytes.
    pub(super) from: From,
}

impl Default for Context {
    fn default() -> Self {
        Self {
            before: Before::default(),
            from: From::Both,
        }
    }
}

/// The number of formats that are tried.
#[derive(Clone, Copy, Debug)]
enum Looked {
    /// Only the format with this index.
    One(usize),
    Many,
}

/// Formats that are skipped, one bit each; formats beyond the last bit are always tried.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Unused {
    bits: u64,
    /// Whether the formats are tried after the others instead.
    are_last: bool,
}

impl Unused {
    /// Adds the format with this index.
    pub(crate) fn with(self, index: usize) -> Self {
        let bit = u32::try_from(index)
            .ok()
            .and_then(|bit| 1_u64.checked_shl(bit));
        Self {
            bits: self.bits | bit.unwrap_or(0),
            ..self
        }
    }

    /// The same set of formats, to be tried after the others.
    pub(crate) const fn last(self) -> Self {
        Self {
            are_last: true,
            ..self
        }
    }

    fn has(self, index: usize) -> bool {
        self.with(index) == self && index < 64
    }
}

/// A frame with correct checksums.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Index of the frame's format.
    pub format: usize,
    /// All bytes of the frame.
    pub bytes: FrameBytes,
}

/// The decoder of a description's frames.
pub type Cutter = Decoder<Frames, { FRAME_MAX + 48 }>;

/// An empty decoder.
pub(crate) fn cutter(frames: Frames) -> Cutter {
    Decoder::with_format(frames)
}

impl Frames {
    /// The first format that accepts the bytes. An incomplete frame blocks later formats, so that
    /// the result does not depend on the chunks in which bytes arrive.
    fn verdict(&self, bytes: &[u8], is_last: bool) -> (usize, Candidate) {
        if let Looked::One(index) = self.2 {
            let found = match self.0[index].judge(bytes, is_last, self.3) {
                Candidate::Incomplete if is_last => Candidate::Rejected(FrameError::Truncated {
                    found: len_u32(bytes.len()),
                }),
                found => found,
            };
            return (index, found);
        }
        let mut rejected = None;
        for (index, framing) in self.used() {
            match framing.judge(bytes, is_last, self.3) {
                Candidate::Noise => {}
                Candidate::Rejected(error) => {
                    rejected.get_or_insert((index, Candidate::Rejected(error)));
                }
                Candidate::Incomplete if is_last => {
                    let found = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
                    let error = FrameError::Truncated { found };
                    rejected.get_or_insert((index, Candidate::Rejected(error)));
                }
                found => return (index, found),
            }
        }
        rejected.unwrap_or((0, Candidate::Noise))
    }
}

impl Frames {
    /// All of these formats.
    pub(crate) fn of(formats: Arc<Vec<Framing>>) -> Self {
        let context = Context::default();
        Self(formats, Unused::default(), Looked::Many, context).without(Unused::default())
    }

    /// The same formats in bytes that `from` sends.
    pub(crate) fn sent_by(mut self, from: From) -> Self {
        self.3.from = from;
        self
    }

    /// The formats that are tried, with their indices.
    fn used(&self) -> impl Iterator<Item = (usize, &Framing)> {
        let all = || self.0.iter().enumerate();
        let first = all().filter(|(index, _)| !self.1.has(*index));
        let last = all().filter(|(index, _)| self.1.are_last && self.1.has(*index));
        first.chain(last)
    }

    /// Whether the format with this index is tried.
    pub(crate) fn looks_for(&self, format: usize) -> bool {
        self.used().any(|(index, _)| index == format)
    }

    /// The same selection of other formats.
    pub(crate) fn with_formats(&self, formats: Arc<Vec<Framing>>) -> Self {
        Self(formats, self.1, self.2, self.3)
    }

    /// The same formats without the `unused` ones.
    pub(crate) fn without(&self, unused: Unused) -> Self {
        let mut frames = Self(self.0.clone(), unused, Looked::Many, self.3);
        let only = {
            let mut used = frames.used().map(|(index, _)| index);
            used.next().filter(|_| used.next().is_none())
        };
        if let Some(only) = only {
            frames.2 = Looked::One(only);
        }
        frames
    }

    /// Whether a silence ends frames.
    pub(crate) fn ends_with_silence(&self) -> bool {
        self.used()
            .any(|(_, framing)| matches!(framing.cut, Cut::Silence { .. }))
    }

    /// Whether only a silence shows the end of some frames.
    pub(crate) fn ends_with_unknown_silence(&self) -> bool {
        self.used()
            .any(|(_, framing)| matches!(framing.cut, Cut::Silence { lengths: None }))
    }

    /// Decodes all of `bytes`, which a silence ended, as one frame.
    pub(crate) fn whole(&self, bytes: &[u8]) -> Result<Frame, FrameError> {
        let cut_off = FrameError::Truncated {
            found: len_u32(bytes.len()),
        };
        let (format, framing) = self.used().next().ok_or(cut_off)?;
        if bytes.len() <= framing.trailer {
            return Err(cut_off);
        }
        if bytes.len() > framing.max {
            let (max, found) = (len_u32(framing.max), len_u32(bytes.len()));
            return Err(FrameError::Length { max, found });
        }
        match framing.whole(bytes) {
            Candidate::Rejected(error) => Err(error),
            _ => Ok(Frame {
                format,
                bytes: bytes.into(),
            }),
        }
    }

    /// Inverts the last checksum of a frame.
    pub(crate) fn spoil(&self, format: usize, frame: &mut Vec<u8>) {
        if let Some(framing) = self.0.get(format) {
            framing.spoil(frame);
        }
    }
}

impl Format for Frames {
    type Frame = Frame;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        match self.2 {
            Looked::One(index) => self.0[index].judge(bytes, false, self.3),
            Looked::Many => self.verdict(bytes, false).1,
        }
    }

    fn judge_last(&self, bytes: &[u8]) -> Candidate {
        self.verdict(bytes, true).1
    }

    fn frame(&self, bytes: &[u8]) -> Frame {
        let format = match self.2 {
            Looked::One(format) => format,
            Looked::Many => self.verdict(bytes, true).0,
        };
        let bytes = bytes.into();
        Frame { format, bytes }
    }

    fn passed(&mut self, bytes: &[u8], is_frame: bool) {
        if let Some(&last) = bytes.last() {
            self.3.before = match is_frame {
                true => Before::Frame(last),
                false => Before::Discarded(last),
            };
        }
    }
}

pub(super) fn len_u32(bytes: usize) -> u32 {
    u32::try_from(bytes).unwrap_or(u32::MAX)
}

impl Framing {
    /// Checks whether a frame begins at the first byte; `is_last` if no more bytes will come.
    #[inline]
    pub(super) fn judge(&self, bytes: &[u8], is_last: bool, context: Context) -> Candidate {
        match self.sound(bytes) {
            Some(found) => found,
            None => self.judge_all(bytes, is_last, context),
        }
    }

    /// The sound frame at the beginning of `bytes`, or an incomplete one, if that takes no search:
    /// most frames have a known size and plain checksums. `None` decides nothing.
    #[inline]
    fn sound(&self, bytes: &[u8]) -> Option<Candidate> {
        let plain = self.plain.as_deref()?;
        let is_begun = match self.sync[..] {
            [] => true,
            [one] => bytes.first() == Some(&one),
            _ => {
                let mut begin = bytes.iter().zip(&self.sync);
                begin.all(|(found, sync)| found == sync)
            }
        };
        if !is_begun {
            return None;
        }
        let size = match &self.cut {
            Cut::Fixed(size) => *size,
            Cut::Table { at, sizes } => sizes[usize::from(*bytes.get(*at)?)].into(),
            Cut::Sized { head, size } => {
                let size = size.of(bytes.get(..*head)?);
                size.filter(|size| *size >= self.least())?
            }
            Cut::Length(_) | Cut::Marked { .. } | Cut::Silence { .. } => return None,
        };
        if !(1..=self.max).contains(&size) {
            return None;
        }
        let Some(frame) = bytes.get(..size) else {
            return Some(Candidate::Incomplete);
        };
        let is_sound = (self.end.is_empty() || frame.ends_with(&self.end))
            && match plain {
                [only] => only.holds(frame),
                all => all.iter().all(|check| check.holds(frame)),
            };
        is_sound.then_some(Candidate::Complete(size))
    }

    /// Like [`judge`](Self::judge), for every format. Not inlined: a sound frame needs none of it.
    #[inline(never)]
    pub(super) fn judge_all(&self, bytes: &[u8], is_last: bool, context: Context) -> Candidate {
        let before = context.before;
        if let Cut::Marked { start, end, .. } = &self.cut {
            // The end marker of a rejected frame could also begin a frame, but none has come.
            let is_end = start == end && start == bytes && matches!(before, Before::Discarded(_));
            return match is_last && is_end {
                true => Candidate::Noise,
                false => self.judge_marked(bytes, before),
            };
        }
        // For a few bytes a loop is faster than a call.
        if bytes
            .iter()
            .zip(&self.sync)
            .any(|(found, sync)| found != sync)
        {
            return Candidate::Noise;
        }
        let too_long = |found: usize| {
            Candidate::Rejected(FrameError::Length {
                max: len_u32(self.max),
                found: len_u32(found),
            })
        };
        let size = match &self.cut {
            Cut::Marked { .. } => return Candidate::Noise,
            Cut::Fixed(size) => *size,
            Cut::Length(length) => match length.size(bytes) {
                None => return Candidate::Incomplete,
                Some(size) => match usize::try_from(size) {
                    // Checked before the repeated length, which may come in a later chunk.
                    Ok(size) if size >= self.least() && size <= self.max => {
                        if length.is_contradicted(bytes) {
                            let at = length.again.unwrap_or(0);
                            let found = bytes.get(at).copied().unwrap_or(0).into();
                            let at = len_u32(at);
                            return Candidate::Rejected(FrameError::Implausible { at, found });
                        }
                        size
                    }
                    _ => return too_long(usize::try_from(size).unwrap_or(0)),
                },
            },
            Cut::Sized { head, size } => match bytes.get(..*head) {
                None => return Candidate::Incomplete,
                Some(head) => match size.of(head) {
                    Some(size) if size >= self.least() => size,
                    _ => return Candidate::Noise,
                },
            },
            Cut::Table { at, sizes } => match bytes.get(*at) {
                None => return Candidate::Incomplete,
                Some(&byte) => match usize::from(sizes[usize::from(byte)]) {
                    0 => return Candidate::Noise,
                    size => size,
                },
            },
            Cut::Silence { lengths } => {
                return self.judge_silence(bytes, is_last, lengths.zip(Some(context.from)));
            }
        };
        if size > self.max {
            return too_long(size);
        }
        match bytes.get(..size) {
            None => Candidate::Incomplete,
            Some(frame) => self.whole(frame),
        }
    }

    /// Minimum number of bytes of the content.
    pub(crate) fn least(&self) -> usize {
        let holes: usize = self.holes.iter().map(|(_, len)| len).sum();
        (holes + self.trailer).max(usize::from(!self.has_blank))
    }

    /// Checks a frame of complete length.
    pub(super) fn whole(&self, frame: &[u8]) -> Candidate {
        if !self.end.is_empty() && !frame.ends_with(&self.end) {
            let found = frame.last().copied().unwrap_or(0).into();
            let at = len_u32(frame.len().saturating_sub(1));
            return Candidate::Rejected(FrameError::Implausible { at, found });
        }
        match self.checked(frame) {
            Ok(()) => Candidate::Complete(frame.len()),
            Err(error) => Candidate::Rejected(error),
        }
    }

    fn judge_marked(&self, bytes: &[u8], before: Before) -> Candidate {
        let Cut::Marked {
            start,
            end,
            stuffing,
            tail,
        } = &self.cut
        else {
            return Candidate::Noise;
        };
        let seen = start.len().min(bytes.len());
        let has_start = bytes[..seen] == start[..seen];
        // Two adjacent frames may share a marker. Within a frame, whose first byte may be damaged,
        // none begins.
        let may_lack_start = start == end && before.may_share(end);
        if !has_start && !may_lack_start {
            return Candidate::Noise;
        }
        if has_start && seen < start.len() {
            return Candidate::Incomplete;
        }
        let from = if has_start { start.len() } else { 0 };
        let reject = |error| match has_start || matches!(before, Before::Frame(_)) {
            true => Candidate::Rejected(error),
            // Behind a discarded marker, this frame was rejected with its marker already.
            false => Candidate::Noise,
        };
        let inner = &bytes[from..];
        let is_line = start.is_empty() && *stuffing == Stuffing::None && !self.has_blank;
        if is_line && inner.first().is_some_and(|byte| b"\r\n".contains(byte)) && !self.is_text(end)
        {
            return Candidate::Noise;
        }
        let found = match stuffing.end(inner, end) {
            Ok(found) => found,
            Err(error) => return reject(error),
        };
        let Some(found) = found else {
            // At least one byte is missing.
            let found = len_u32(self.max + 1);
            return match bytes.len() >= self.max {
                true => reject(FrameError::Length {
                    max: len_u32(self.max),
                    found,
                }),
                false => Candidate::Incomplete,
            };
        };
        let len = from + found + end.len() + tail;
        if len > self.max {
            // As for bytes that come one by one.
            let (max, found) = (len_u32(self.max), len_u32(self.max + 1));
            return reject(FrameError::Length { max, found });
        }
        if found == 0 && *tail == 0 && !self.has_blank {
            return Candidate::Noise;
        }
        let Some(frame) = bytes.get(..len) else {
            return Candidate::Incomplete;
        };
        let content = match self.content(frame) {
            Ok(content) => content,
            Err(_) if *stuffing == Stuffing::Cobs => return Candidate::Noise,
            Err(error) => return reject(error),
        };
        if content.len() < self.least() {
            let found = len_u32(content.len());
            return reject(FrameError::Truncated { found });
        }
        if !content.ends_with(&self.end) {
            let found = content.last().copied().unwrap_or(0).into();
            let at = len_u32(len - 1);
            return reject(FrameError::Implausible { at, found });
        }
        match self.checked(&content) {
            Ok(()) => Candidate::Complete(len),
            Err(error) => reject(error),
        }
    }

    /// Whether the end marker contains no line end: line ends may then begin a frame.
    fn is_text(&self, end: &[u8]) -> bool {
        !end.iter().any(|byte| b"\r\n".contains(byte))
    }
}

impl Length {
    /// Whether the repeated length differs.
    fn is_contradicted(&self, bytes: &[u8]) -> bool {
        let len = usize::from(self.number.bytes);
        let again = self.again.and_then(|at| bytes.get(at..at + len));
        again.is_some_and(|again| bytes.get(self.at..self.at + len) != Some(again))
    }

    /// The size of the frame from its length field; `None` if the field is incomplete.
    fn size(&self, bytes: &[u8]) -> Option<i64> {
        let field = bytes.get(self.at..self.at + usize::from(self.number.bytes))?;
        let value = (self.number.bits(field) & self.mask) >> self.mask.trailing_zeros();
        let value = i64::try_from(value).unwrap_or(i64::MAX);
        Some(value.saturating_mul(self.unit).saturating_add(self.base))
    }
}
