//! A frame format: the end of frames, stuffing, checksum and lengths.

use super::checksum::Checksum;
use super::frame_format::{FieldLimits, FrameFormat};

/// The stuffing that keeps the end marker out of frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Coding {
    /// No stuffing.
    Raw,
    /// Consistent overhead byte stuffing: no zero within a frame.
    Cobs,
    /// RFC 1055: DB DC for C0, DB DD for DB.
    Slip,
    /// As in PPP: 7D precedes a byte with inverted bit 5.
    Hdlc,
    /// 10 begins each marker; within a frame it is sent twice.
    Dle,
}

const DLE: u8 = 0x10;

/// A length field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Length {
    /// Offset in the content.
    pub(crate) at: usize,
    /// Number of bytes of the field.
    pub(crate) bytes: usize,
    /// Whether the most significant byte comes first.
    pub(crate) is_big: bool,
    /// Number of bytes of the content per count.
    pub(crate) scale: usize,
    /// Number of bytes of the content that are not counted.
    pub(crate) rest: isize,
}

impl Length {
    /// The length that `content` states.
    pub(crate) fn read(&self, content: &[u8]) -> Option<usize> {
        let field = content.get(self.at..self.at + self.bytes)?;
        let number = |value: usize, byte: &u8| value << 8 | usize::from(*byte);
        Some(match self.is_big {
            true => field.iter().fold(0, number),
            false => field.iter().rev().fold(0, number),
        })
    }

    /// Whether `content` states its correct length.
    pub(crate) fn holds(&self, content: &[u8]) -> bool {
        self.read(content) == self.wanted(content.len())
    }

    fn wanted(&self, len: usize) -> Option<usize> {
        let counted = len.checked_add_signed(-self.rest)?;
        counted
            .is_multiple_of(self.scale)
            .then(|| counted / self.scale)
    }

    /// Writes the correct length into `content`, if the field fits.
    pub(crate) fn repair(&self, content: &mut [u8]) {
        if let Some(wanted) = self.wanted(content.len()) {
            self.write(content, wanted);
        }
    }

    /// Writes `value` into the field.
    pub(crate) fn write(&self, content: &mut [u8], value: usize) {
        if let Some(field) = content.get_mut(self.at..self.at + self.bytes) {
            let little = value.to_le_bytes();
            field.copy_from_slice(&little[..self.bytes]);
            if self.is_big {
                field.reverse();
            }
        }
    }
}

/// A frame format.
#[derive(Clone, Debug)]
pub(crate) struct Format {
    /// End marker; empty: none.
    pub(crate) end: Vec<u8>,
    /// Additional start marker, e.g. the flag of HDLC.
    pub(crate) flag: Vec<u8>,
    /// Stuffing.
    pub(crate) coding: Coding,
    /// The checksum.
    pub(crate) checksum: Option<Checksum>,
    /// Length fields.
    pub(crate) lengths: Vec<Length>,
    /// Whether frames are lines of text.
    pub(crate) is_text: bool,
}

impl Format {
    /// Bytes of an unknown format.
    pub(crate) const fn unknown() -> Self {
        Self {
            end: Vec::new(),
            flag: Vec::new(),
            coding: Coding::Raw,
            checksum: None,
            lengths: Vec::new(),
            is_text: false,
        }
    }

    /// Whether a prompt follows the line end, as in `\r\r>`.
    pub(crate) fn has_prompt(&self) -> bool {
        let is_end = |byte: &u8| b"\r\n".contains(byte);
        self.end.first().is_some_and(is_end) && !self.end.last().is_some_and(is_end)
    }

    /// Splits `chunk` into frames with their end markers; bytes behind the last end marker count as
    /// a frame too.
    pub(crate) fn split<'a>(&self, chunk: &'a [u8]) -> Vec<&'a [u8]> {
        if self.end.is_empty() {
            return vec![chunk];
        }
        let (mut frames, mut from) = (Vec::new(), 0);
        let mut at = 0;
        while at + self.end.len() <= chunk.len() {
            if let Some(len) = self.skipped(&chunk[at..], at == from) {
                at += len;
                continue;
            }
            let is_end = chunk[at..].starts_with(&self.end);
            // Two consecutive flags begin a frame.
            if is_end && !(self.flag == self.end && at == from) {
                at += self.end.len();
                frames.push(&chunk[from..at]);
                from = at;
            } else {
                at += 1;
            }
        }
        if from < chunk.len() {
            frames.push(&chunk[from..]);
        }
        frames
    }

    /// Number of the next bytes that hold no end marker with DLE stuffing: the start marker, and a
    /// DLE that is sent twice.
    fn skipped(&self, rest: &[u8], is_first: bool) -> Option<usize> {
        let is_dle = self.coding == Coding::Dle;
        if is_dle && is_first && rest.starts_with(&self.flag) {
            return Some(self.flag.len());
        }
        (is_dle && rest.starts_with(&[DLE, DLE])).then_some(2)
    }

    /// A frame without its end marker and stuffing; `None` if the stuffing is damaged.
    pub(crate) fn body(&self, frame: &[u8]) -> Option<Vec<u8>> {
        let inner = frame.strip_suffix(&*self.end)?;
        let inner = match (inner.strip_prefix(&*self.flag), self.coding) {
            (Some(inner), _) => inner,
            (None, Coding::Dle) => return None,
            (None, _) => inner,
        };
        match self.coding {
            Coding::Raw => Some(inner.to_vec()),
            Coding::Cobs => cobs_decoded(inner),
            Coding::Slip => unescaped(inner, 0xDB, &[(0xDC, 0xC0), (0xDD, 0xDB)]),
            Coding::Hdlc => hdlc_decoded(inner),
            Coding::Dle => unescaped(inner, DLE, &[(DLE, DLE)]),
        }
    }

    /// A frame without end marker, stuffing and checksum.
    pub(crate) fn content(&self, frame: &[u8]) -> Option<Vec<u8>> {
        let body = self.body(frame)?;
        match &self.checksum {
            Some(checksum) => checksum.without(&body),
            None => Some(body),
        }
    }

    /// Whether the checksum of `frame` is correct; `None` if no checksum is known.
    pub(crate) fn is_sound(&self, frame: &[u8]) -> Option<bool> {
        let checksum = self.checksum.as_ref()?;
        let body = self.body(frame);
        Some(body.is_some_and(|body| checksum.holds(&body)))
    }

    /// A frame of `content`; its checksum is changed by `off`.
    pub(crate) fn frame(&self, content: &[u8], off: u64) -> Vec<u8> {
        let body = match &self.checksum {
            Some(checksum) => checksum.put(content, off),
            None => content.to_vec(),
        };
        let inner = match self.coding {
            Coding::Raw => body,
            Coding::Cobs => cobs_encoded(&body),
            Coding::Slip => escaped(&body, 0xDB, &[(0xDC, 0xC0), (0xDD, 0xDB)]),
            Coding::Hdlc => escaped(&body, 0x7D, &[(0x5E, 0x7E), (0x5D, 0x7D)]),
            Coding::Dle => escaped(&body, DLE, &[(DLE, DLE)]),
        };
        [&*self.flag, &inner, &self.end].concat()
    }
}

impl core::fmt::Display for Format {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let mut words = Vec::new();
        match (self.coding, &*self.end) {
            (Coding::Cobs, _) => words.push("COBS".to_owned()),
            (Coding::Slip, _) => words.push("SLIP".to_owned()),
            (Coding::Hdlc, _) => words.push("HDLC".to_owned()),
            (Coding::Dle, _) => words.push("DLE".to_owned()),
            (Coding::Raw, []) => {}
            (Coding::Raw, end) if self.is_text => {
                words.push(format!(
                    "lines that end with {:?}",
                    end.escape_ascii().to_string()
                ));
            }
            (Coding::Raw, end) => {
                let hex: Vec<String> = end.iter().map(|byte| format!("{byte:02X}")).collect();
                words.push(format!("frames that end with {}", hex.join(" ")));
            }
        }
        for length in &self.lengths {
            let (at, bits) = (length.at, 8 * length.bytes);
            words.push(format!("{bits}-bit length at byte {at}"));
        }
        if let Some(checksum) = &self.checksum {
            let sure = if checksum.is_sure { "" } else { " (a guess)" };
            words.push(format!("checksum {checksum}{sure}"));
        }
        match &words[..] {
            [] => f.write_str("unknown"),
            words => f.write_str(&words.join("; ")),
        }
    }
}

fn cobs_decoded(inner: &[u8]) -> Option<Vec<u8>> {
    let (mut out, mut at) = (Vec::new(), 0);
    while let Some(&code) = inner.get(at) {
        let next = at + usize::from(code);
        let part = inner.get(at + 1..next).filter(|_| code > 0)?;
        if part.contains(&0) {
            return None;
        }
        out.extend(part);
        if code < 0xFF && next < inner.len() {
            out.push(0);
        }
        at = next;
    }
    (!inner.is_empty()).then_some(out)
}

fn cobs_encoded(body: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    for (index, block) in body.split(|byte| *byte == 0).enumerate() {
        let mut rest = block;
        // No zero follows a block of 254 bytes.
        while rest.len() >= 0xFE {
            out.push(0xFF);
            out.extend(&rest[..0xFE]);
            rest = &rest[0xFE..];
        }
        let is_left = !rest.is_empty() || block.is_empty() || index + 1 < zeros(body) + 1;
        if is_left {
            out.push(u8::try_from(rest.len() + 1).unwrap_or(0xFF));
            out.extend(rest);
        }
    }
    out
}

fn zeros(body: &[u8]) -> usize {
    body.iter().filter(|byte| **byte == 0).count()
}

fn escaped(body: &[u8], escape: u8, pairs: &[(u8, u8)]) -> Vec<u8> {
    let mut out = Vec::new();
    for byte in body {
        match pairs.iter().find(|(_, plain)| plain == byte) {
            Some((code, _)) => out.extend([escape, *code]),
            None => out.push(*byte),
        }
    }
    out
}

fn unescaped(inner: &[u8], escape: u8, pairs: &[(u8, u8)]) -> Option<Vec<u8>> {
    let (mut out, mut bytes) = (Vec::new(), inner.iter());
    while let Some(byte) = bytes.next() {
        if *byte != escape {
            out.push(*byte);
            continue;
        }
        let code = bytes.next()?;
        out.push(pairs.iter().find(|(known, _)| known == code)?.1);
    }
    Some(out)
}

fn hdlc_decoded(inner: &[u8]) -> Option<Vec<u8>> {
    let (mut out, mut bytes) = (Vec::new(), inner.iter());
    while let Some(byte) = bytes.next() {
        match byte {
            0x7D => out.push(bytes.next()? ^ 0x20),
            byte => out.push(*byte),
        }
    }
    Some(out)
}

impl FrameFormat for Format {
    fn split<'a>(&self, chunk: &'a [u8]) -> Vec<&'a [u8]> {
        Self::split(self, chunk)
    }

    fn content(&self, frame: &[u8]) -> Option<Vec<u8>> {
        Self::content(self, frame)
    }

    fn frame(&self, content: &[u8], off: u64) -> Vec<u8> {
        Self::frame(self, content, off)
    }

    fn is_damaged(&self, frame: &[u8]) -> bool {
        let checksum = self.checksum.as_ref();
        checksum.is_some_and(|checksum| checksum.is_sure) && self.is_sound(frame) == Some(false)
    }

    fn repair_lengths(&self, content: &mut [u8]) {
        self.lengths
            .iter()
            .for_each(|length| length.repair(content));
    }

    /// Test values for the length fields: one more and one less, none, all.
    fn limits(&self, content: &[u8]) -> Vec<FieldLimits> {
        let limits = |length: &Length| {
            let told = length.read(content)?;
            let most = (1_usize << (8 * length.bytes)) - 1;
            let mut values = vec![
                0,
                1,
                told.saturating_sub(1),
                told + 1,
                told * 2,
                most / 2,
                most,
            ];
            values.retain(|value| *value <= most && *value != told);
            let range = length.at..length.at + length.bytes;
            let written = |value| {
                let mut copy = content.to_vec();
                length.write(&mut copy, value);
                copy[range.clone()].to_vec()
            };
            let values = values.into_iter().map(written).collect();
            Some(FieldLimits {
                range: range.clone(),
                values,
            })
        };
        self.lengths.iter().filter_map(limits).collect()
    }

    fn in_words(&self) -> String {
        self.to_string()
    }

    fn is_text(&self) -> bool {
        self.is_text
    }
}
