//! Frame formats: cutting frames out of bytes, and building a frame from a body.
//!
//! The *content* of a frame is its bytes without markers and stuffing. The *body* is the content
//! without sync bytes, length field and checksums; messages decode the body.

mod before;
mod bytes;
mod cut;
mod head;
mod judge;
mod overlong;
mod plain;
mod silence;

use core::time::Duration;
use std::borrow::Cow;

use protocols::FrameError;

use crate::checksum::Algorithm;
use crate::number::Number;
use crate::schema::wire::Stuffing;

pub use bytes::FrameBytes;
pub(crate) use cut::{DLE, hex_bytes, hex_text};
pub(crate) use head::HeadSize;
pub use judge::{Cutter, Frame, Frames};
pub(crate) use judge::{Unused, cutter};
pub(crate) use overlong::Overlong;
pub(crate) use plain::Plain;
use silence::Lengths;

/// Maximum number of bytes of a frame.
pub(crate) const FRAME_MAX: usize = 2_000;

/// A frame format.
#[derive(Clone, Debug)]
pub(crate) struct Framing {
    pub(crate) name: String,
    pub(crate) cut: Cut,
    /// First bytes of the content.
    pub(crate) sync: Vec<u8>,
    /// Whether the content is written as hexadecimal digits.
    pub(crate) is_hex: bool,
    pub(crate) checks: Vec<Check>,
    /// The same checksums with computed places, if all of them are plain.
    pub(crate) plain: Option<Box<[Plain]>>,
    /// Parts of the content that are not body, except the end: offset and length, in order.
    pub(crate) holes: Vec<(usize, usize)>,
    /// Number of bytes at the end of the content that are not body.
    pub(crate) trailer: usize,
    /// Last bytes of the content of a frame of known length.
    pub(crate) end: Vec<u8>,
    /// Whether an empty line, or a line of line ends only, is a message.
    pub(crate) has_blank: bool,
    /// Maximum number of bytes on the wire.
    pub(crate) max: usize,
    /// Idle time after which a partial frame is discarded.
    pub(crate) idle: Duration,
}

/// The rule that finds the end of a frame.
#[derive(Clone, Debug)]
pub(crate) enum Cut {
    Marked {
        start: Vec<u8>,
        end: Vec<u8>,
        stuffing: Stuffing,
        tail: usize,
    },
    Length(Length),
    Fixed(usize),
    /// By an expression over the first bytes.
    Sized {
        head: usize,
        size: HeadSize,
    },
    /// By the value of one byte.
    Table {
        at: usize,
        sizes: Box<[u16; 256]>,
    },
    /// By a silence; `lengths` is given if lengths follow from the bytes.
    Silence {
        lengths: Option<Lengths>,
    },
}

/// A length field.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Length {
    pub(crate) at: usize,
    pub(crate) number: Number,
    /// The frame has value * unit + base bytes.
    pub(crate) unit: i64,
    pub(crate) base: i64,
    pub(crate) mask: u64,
    /// Offset of a second field with the same value.
    pub(crate) again: Option<usize>,
}

/// A checksum of a frame.
#[derive(Clone, Debug)]
pub(crate) struct Check {
    pub(crate) algorithm: Algorithm,
    /// Number of bytes of the checksum's value.
    pub(crate) width: u8,
    pub(crate) is_little: bool,
    pub(crate) is_hex: bool,
    pub(crate) separator: Vec<u8>,
    pub(crate) extra: Vec<u8>,
    pub(crate) before: Vec<u8>,
    pub(crate) from: i64,
    pub(crate) to: Option<i64>,
    /// Offset of the separator before the checksum; a negative offset counts from the end.
    pub(crate) at: i64,
}

/// Resolves an offset; a negative one counts from the end.
fn place(at: i64, len: usize) -> Option<usize> {
    let from_start = if at < 0 {
        at + i64::try_from(len).ok()?
    } else {
        at
    };
    usize::try_from(from_start).ok().filter(|at| *at <= len)
}

impl Check {
    /// Number of bytes of the value in the content.
    pub(crate) fn value_len(&self) -> usize {
        usize::from(self.width) * if self.is_hex { 2 } else { 1 }
    }

    /// Number of bytes of the checksum in the content, with its separator.
    pub(crate) fn len(&self) -> usize {
        self.separator.len() + self.value_len()
    }

    /// The correct checksum of `content`, and its offset.
    fn expected(&self, content: &[u8]) -> Option<(u128, usize)> {
        let at = place(self.at, content.len())?;
        let from = place(self.from, content.len())?;
        let to = match self.to {
            None => at,
            Some(0) => content.len(),
            Some(to) => place(to, content.len())?,
        };
        let covered = content.get(from..to)?;
        // The bytes of a checksum within the covered range count as 0.
        let own = at.max(from)..(at + self.len()).min(to);
        let is_plain = self.extra.is_empty() && self.before.is_empty() && own.is_empty();
        let value = if is_plain {
            self.algorithm.compute(covered, self.width)
        } else {
            let mut covered = covered.to_vec();
            if !own.is_empty() {
                covered[own.start - from..own.end - from].fill(0);
            }
            let all = [&self.before[..], &covered, &self.extra].concat();
            self.algorithm.compute(&all, self.width)
        };
        Some((value, at + self.separator.len()))
    }

    /// Verifies the checksum.
    fn holds(&self, content: &[u8]) -> Result<(), FrameError> {
        let cut_off = FrameError::Truncated {
            found: u32::try_from(content.len()).unwrap_or(u32::MAX),
        };
        let (expected, at) = self.expected(content).ok_or(cut_off)?;
        let separator = content.get(at - self.separator.len()..at);
        let written = content.get(at..at + self.value_len()).ok_or(cut_off)?;
        let found = self
            .read(written)
            .filter(|_| separator == Some(&*self.separator));
        let low = |value: u128| u32::try_from(value & 0xffff_ffff).unwrap_or(0);
        match found {
            Some(found) if found == expected => Ok(()),
            found => {
                let (expected, found) = (low(expected), low(found.unwrap_or(0)));
                Err(FrameError::Checksum { expected, found })
            }
        }
    }

    fn read(&self, written: &[u8]) -> Option<u128> {
        let whole = |value: u128, byte: &u8| value << 8 | u128::from(*byte);
        let number = |bytes: &[u8]| match self.is_little {
            true => bytes.iter().rev().fold(0, whole),
            false => bytes.iter().fold(0, whole),
        };
        match self.is_hex {
            true => hex_bytes(written).map(|bytes| number(&bytes)),
            false => Some(number(written)),
        }
    }

    /// Writes the checksum.
    fn fill(&self, content: &mut [u8]) -> Option<()> {
        let (value, at) = self.expected(content)?;
        let mut all = value.to_be_bytes();
        let bytes = &mut all[16 - usize::from(self.width)..];
        if self.is_little {
            bytes.reverse();
        }
        let first = at - self.separator.len();
        content.get_mut(first..at)?.copy_from_slice(&self.separator);
        let place = content.get_mut(at..at + self.value_len())?;
        match self.is_hex {
            true => place.copy_from_slice(&hex_text(bytes)),
            false => place.copy_from_slice(bytes),
        }
        Some(())
    }
}

impl Framing {
    /// A format with this rule for the end of its frames and these checksums; without sync bytes,
    /// and with no other limit than the longest frame.
    pub(crate) fn new(cut: Cut, checks: Vec<Check>) -> Self {
        Self {
            name: String::new(),
            plain: Plain::all(&checks, &cut),
            cut,
            sync: Vec::new(),
            is_hex: false,
            checks,
            holes: Vec::new(),
            trailer: 0,
            end: Vec::new(),
            has_blank: false,
            max: FRAME_MAX,
            idle: Duration::ZERO,
        }
    }

    /// The body of a frame. The bits of a length that shares its field with the message are 0, as
    /// the message writes them.
    pub(crate) fn body<'a>(&self, frame: &'a [u8]) -> Option<Cow<'a, [u8]>> {
        let mut body = self.all_of_body(frame)?;
        if let Some((at, length)) = self.shared_length() {
            let field = at..at + usize::from(length.number.bytes);
            let field = body.to_mut().get_mut(field)?;
            let mut bytes = Vec::new();
            let own = length.number.bits(field) & !length.mask;
            length.number.put(own, &mut bytes);
            field.copy_from_slice(&bytes);
        }
        Some(body)
    }

    /// The bytes of a frame that are not in holes.
    fn all_of_body<'a>(&self, frame: &'a [u8]) -> Option<Cow<'a, [u8]>> {
        let content = self.content(frame).ok()?;
        let len = content.len().checked_sub(self.trailer)?;
        if self.holes.is_empty() {
            return Some(match content {
                Cow::Borrowed(content) => Cow::Borrowed(&content[..len]),
                Cow::Owned(mut content) => {
                    content.truncate(len);
                    Cow::Owned(content)
                }
            });
        }
        // Without holes behind the body, the bytes in front of it are skipped without a copy.
        if let (Cow::Borrowed(content), Some(front)) = (&content, self.front()) {
            return content.get(front..len).map(Cow::Borrowed);
        }
        let mut body = Vec::with_capacity(len);
        let mut at = 0;
        for &(hole, hole_len) in &self.holes {
            body.extend_from_slice(content.get(at..hole.min(len))?);
            at = hole + hole_len;
        }
        body.extend_from_slice(content.get(at..len)?);
        Some(Cow::Owned(body))
    }

    /// The frame of a body; `None` if the frame is too long or contradicts its length.
    pub(crate) fn frame(&self, body: &[u8]) -> Option<Vec<u8>> {
        let content = self.around(body)?;
        self.finished(content)
    }

    /// Like [`frame`](Self::frame), for a body behind space for the bytes [before it](Self::front).
    pub(crate) fn frame_behind(&self, mut content: Vec<u8>) -> Option<Vec<u8>> {
        self.enclose(&mut content)?;
        self.finished(content)
    }

    /// The number of bytes before the body, if no others lie within it.
    pub(crate) fn front(&self) -> Option<usize> {
        let mut holes = self.holes.iter();
        holes.try_fold(0, |end, (at, len)| (*at == end).then_some(end + len))
    }

    /// The frame of a content whose length and checksums are still empty.
    fn finished(&self, mut content: Vec<u8>) -> Option<Vec<u8>> {
        self.finish(&mut content)?;
        let wire = self.wire(content);
        (wire.len() <= self.max).then_some(wire)
    }

    /// The body size of a frame that begins like `body`; `None` if the body may have any length.
    pub(crate) fn room(&self, body: &[u8]) -> Option<usize> {
        let holes: usize = self.holes.iter().map(|(_, len)| len).sum();
        let size = match &self.cut {
            Cut::Fixed(size) => *size,
            Cut::Table { at, sizes } => {
                let byte = self.around(body)?.get(*at).copied()?;
                usize::from(sizes[usize::from(byte)])
            }
            Cut::Sized { head, size } => size.of(self.around(body)?.get(..*head)?)?,
            Cut::Marked { .. } | Cut::Length(_) | Cut::Silence { .. } => return None,
        };
        size.checked_sub(holes + self.trailer)
    }

    /// The content with this body; length and checksums are still empty.
    fn around(&self, body: &[u8]) -> Option<Vec<u8>> {
        let holes: usize = self.holes.iter().map(|(_, len)| len).sum();
        let mut content = Vec::with_capacity(body.len() + holes + self.trailer);
        let mut rest = body;
        for &(hole, len) in &self.holes {
            let taken = hole.checked_sub(content.len())?;
            content.extend_from_slice(rest.get(..taken)?);
            rest = &rest[taken..];
            content.resize(content.len() + len, 0);
        }
        content.extend_from_slice(rest);
        self.enclose(&mut content)?;
        Some(content)
    }

    /// Adds the trailer to a content that ends with its body, and writes the constant bytes.
    fn enclose(&self, content: &mut Vec<u8>) -> Option<()> {
        content.resize(content.len() + self.trailer, 0);
        content
            .get_mut(..self.sync.len())?
            .copy_from_slice(&self.sync);
        let len = content.len();
        content[len - self.end.len()..].copy_from_slice(&self.end);
        Some(())
    }

    /// Whether the length field has bits that belong to the message.
    pub(crate) fn shares_length(&self) -> bool {
        self.shared_length().is_some()
    }

    /// The length field that has bits of the message, and its offset in the body.
    pub(crate) fn shared_length(&self) -> Option<(usize, &Length)> {
        let Cut::Length(length) = &self.cut else {
            return None;
        };
        let bits = 8 * u32::from(length.number.bytes);
        let before = self.holes.iter().filter(|(at, _)| *at < length.at);
        let before: usize = before.map(|(_, len)| len).sum();
        let at = length.at.checked_sub(before)?;
        (length.mask.count_ones() < bits).then_some((at, length))
    }

    /// The offset of such a field in the body, and its bits that stay, as a key of a Lua table.
    pub(crate) fn shared_in_lua(&self) -> String {
        let Some((at, length)) = self.shared_length() else {
            return String::new();
        };
        let mut keep = Vec::new();
        length.number.put(!length.mask, &mut keep);
        let keep: Vec<String> = keep.iter().map(u8::to_string).collect();
        let keep = keep.join(", ");
        format!(", shared = {{ at = {at}, keep = {{ {keep} }} }}")
    }

    /// Writes the length of `content` into its length field.
    pub(crate) fn write_length(&self, content: &mut [u8]) -> Option<()> {
        let Cut::Length(length) = &self.cut else {
            return None;
        };
        let counted = i64::try_from(content.len()).ok()? - length.base;
        let value = counted.checked_div(length.unit)?;
        let value = u64::try_from(value)
            .ok()
            .filter(|_| counted % length.unit == 0)?;
        let Length {
            at, number, mask, ..
        } = *length;
        let places = content.get_mut(at..at + usize::from(number.bytes))?;
        let shift = mask.trailing_zeros();
        let value = value.checked_shl(shift).filter(|bits| bits & !mask == 0)?;
        let mut bytes = Vec::new();
        number.put(number.bits(places) & !mask | value, &mut bytes);
        places.copy_from_slice(&bytes);
        if let Some(again) = length.again {
            content
                .get_mut(again..again + bytes.len())?
                .copy_from_slice(&bytes);
        }
        Some(())
    }

    /// The frame of a content without trailer; the length field keeps its value.
    pub(crate) fn assemble(&self, content: &[u8]) -> Option<Vec<u8>> {
        let mut content = [content, &vec![0; self.trailer]].concat();
        let len = content.len();
        content[len - self.end.len()..].copy_from_slice(&self.end);
        for check in &self.checks {
            check.fill(&mut content)?;
        }
        Some(self.wire(content))
    }

    /// The frame of a content without trailer, if its size is one of this format.
    pub(crate) fn whole_frame(&self, content: &[u8]) -> Option<Vec<u8>> {
        let mut content = [content, &vec![0; self.trailer]].concat();
        let len = content.len();
        content[len - self.end.len()..].copy_from_slice(&self.end);
        self.finish(&mut content)?;
        let frame = self.wire(content);
        (frame.len() <= self.max).then_some(frame)
    }

    /// Writes length and checksums into `content`.
    fn finish(&self, content: &mut [u8]) -> Option<()> {
        match &self.cut {
            Cut::Length(_) => self.write_length(content)?,
            Cut::Fixed(size) if *size != content.len() => return None,
            Cut::Table { at, sizes } => {
                let byte = content.get(*at).copied()?;
                if usize::from(sizes[usize::from(byte)]) != content.len() {
                    return None;
                }
            }
            Cut::Sized { head, size } => {
                let said = content.get(..*head).and_then(|head| size.of(head));
                said.filter(|said| *said == content.len())?;
            }
            _ => {}
        }
        if let Some(plain) = &self.plain {
            return plain.iter().try_for_each(|check| check.fill(content));
        }
        self.checks.iter().try_for_each(|check| check.fill(content))
    }

    /// Corrects the length and the checksums of a damaged frame where they fit into it.
    pub(crate) fn repair(&self, frame: &mut [u8]) {
        let Ok(content) = self.content(frame) else {
            return;
        };
        let mut content = content.into_owned();
        if self.finish(&mut content).is_some() {
            let wire = self.wire(content);
            if wire.len() == frame.len() {
                frame.copy_from_slice(&wire);
            }
        }
    }

    /// Inverts the last checksum of a frame, if it has one.
    pub(crate) fn spoil(&self, frame: &mut Vec<u8>) {
        let Some(check) = self.checks.last() else {
            return;
        };
        let Ok(content) = self.content(frame) else {
            return;
        };
        let mut content = content.into_owned();
        let at = place(check.at, content.len()).map(|at| at + check.separator.len());
        let Some(at) = at.filter(|at| at + check.value_len() <= content.len()) else {
            return;
        };
        for byte in &mut content[at..at + check.value_len()] {
            *byte = match (*byte, check.is_hex) {
                (b'0', true) => b'1',
                (_, true) => b'0',
                (byte, false) => !byte,
            };
        }
        *frame = self.wire(content);
    }

    /// Verifies all checksums.
    fn checked(&self, content: &[u8]) -> Result<(), FrameError> {
        if let Some(plain) = &self.plain
            && plain.iter().all(|check| check.holds(content))
        {
            return Ok(());
        }
        self.checks
            .iter()
            .try_for_each(|check| check.holds(content))
    }
}

#[cfg(test)]
mod tests;
