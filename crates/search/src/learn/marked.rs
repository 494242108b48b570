//! Frames between a start marker and an end marker, such as STX and ETX. Bytes behind the end
//! marker, such as a checksum, may belong to the frame.

use std::collections::BTreeMap;

use super::checksum::{self, Checksum};

/// The markers of frames, and the number of bytes behind the end marker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Marked {
    pub(crate) start: u8,
    pub(crate) end: Vec<u8>,
    pub(crate) tail: usize,
    /// Whether the bytes between the markers are pairs of hexadecimal digits.
    pub(crate) is_hex: bool,
    /// Share of bytes in such frames, per cent.
    pub(crate) share: usize,
}

/// The checksum of frames between markers, and which markers it covers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Summed {
    pub(crate) checksum: Checksum,
    pub(crate) covers_start: bool,
    pub(crate) covers_end: bool,
}

/// Maximum number of bytes behind an end marker.
const TAIL_MAX: usize = 4;
/// Minimum number of frames.
const FRAMES_MIN: usize = 6;
/// Minimum share of bytes in frames, per cent.
const SHARE_MIN: usize = 90;
/// Maximum number of start markers that are tried.
const STARTS_MAX: usize = 6;
/// Maximum number of bytes between markers.
const INNER_MAX: usize = 1_024;

impl Marked {
    /// The frames in `chunks`. A frame counts only if the next byte begins a frame too, or if its
    /// chunk ends behind it.
    pub(crate) fn frames<'a>(&self, chunks: &'a [Vec<u8>]) -> Vec<&'a [u8]> {
        let mut frames = Vec::new();
        for chunk in chunks {
            let mut at = 0;
            while at < chunk.len() {
                let len = self.len(&chunk[at..]);
                let is_followed = |len: &usize| {
                    chunk
                        .get(at + len)
                        .is_none_or(|next| *next == self.start || b"\r\n".contains(next))
                };
                match len.filter(is_followed) {
                    Some(len) => {
                        frames.push(&chunk[at..at + len]);
                        at += len;
                    }
                    None => at += 1,
                }
            }
        }
        frames
    }

    /// The length of the frame at the beginning of `bytes`.
    fn len(&self, bytes: &[u8]) -> Option<usize> {
        if bytes.first() != Some(&self.start) {
            return None;
        }
        let window = &bytes[1..bytes.len().min(INNER_MAX)];
        let end = window
            .windows(self.end.len())
            .position(|part| part == self.end)?;
        let len = 1 + end + self.end.len() + self.tail;
        (end > 0 && len <= bytes.len()).then_some(len)
    }

    /// The bytes between the markers, and those behind the end marker.
    fn parts<'a>(&self, frame: &'a [u8]) -> (&'a [u8], &'a [u8]) {
        let at = frame.len() - self.tail;
        (&frame[1..at - self.end.len()], &frame[at..])
    }

    /// The content of a frame as descriptions define it: without markers, digits as bytes.
    pub(crate) fn content(&self, frame: &[u8]) -> Option<Vec<u8>> {
        let (inner, behind) = self.parts(frame);
        if !self.is_hex {
            return Some([inner, behind].concat());
        }
        let pairs = inner.chunks(2).map(|pair| {
            let is_digits = pair.len() == 2 && pair.iter().all(u8::is_ascii_hexdigit);
            let text = core::str::from_utf8(pair).ok().filter(|_| is_digits)?;
            u8::from_str_radix(text, 16).ok()
        });
        pairs.collect()
    }

    /// Adds the markers behind the end marker that all frames have, as in `<GETVER>>`.
    fn lengthen(&mut self, frames: &[Vec<u8>]) {
        while self.tail > 0 {
            let behind = |frame: &Vec<u8>| frame[frame.len() - self.tail];
            let Some(next) = frames.first().map(behind) else {
                return;
            };
            if !is_marker(next) || !frames.iter().all(|frame| behind(frame) == next) {
                return;
            }
            self.end.push(next);
            self.tail -= 1;
        }
    }

    /// Whether the bytes between the markers are printable and the markers are usual ones.
    pub(crate) fn is_usual(&self, frames: &[Vec<u8>]) -> bool {
        let is_plain = |byte: &u8| matches!(byte, b' '..=b'~' | b'\t');
        is_marker(self.start)
            && self.end.iter().all(|byte| is_marker(*byte))
            && frames
                .iter()
                .all(|frame| self.parts(frame).0.iter().all(is_plain))
    }

    /// The checksum of `frames`, which may cover the markers.
    pub(crate) fn summed(&self, frames: &[Vec<u8>]) -> Option<Summed> {
        let mut best: Option<Summed> = None;
        for (covers_start, covers_end) in
            [(false, false), (false, true), (true, false), (true, true)]
        {
            // The end marker counts only if the checksum is behind it.
            if covers_end && (self.tail == 0 || self.is_hex) || covers_start && self.is_hex {
                continue;
            }
            let body = |frame: &Vec<u8>| -> Option<Vec<u8>> {
                if self.is_hex {
                    return self.content(frame);
                }
                let (inner, behind) = self.parts(frame);
                let before = &frame[..usize::from(covers_start)];
                let end: &[u8] = if covers_end { &self.end } else { &[] };
                Some([before, inner, end, behind].concat())
            };
            let bodies: Vec<Vec<u8>> = frames.iter().filter_map(body).collect();
            let sum = checksum::infer(&bodies).filter(|sum| sum.described().is_some());
            let Some(checksum) = sum else {
                continue;
            };
            let Some(place) = checksum.placed() else {
                continue;
            };
            let is_behind = place.gap.is_empty()
                && place.head.is_none()
                && place.tail.len() + place.len <= self.tail;
            if covers_start && place.start > 0 || covers_end && !is_behind {
                continue;
            }
            let is_better = best.is_none_or(|known| {
                let rank = |sum: &Checksum| (sum.is_sure, sum.bits);
                rank(&checksum) > rank(&known.checksum)
            });
            if is_better {
                best = Some(Summed {
                    checksum,
                    covers_start,
                    covers_end,
                });
            }
        }
        best
    }
}

/// Whether a byte is a usual marker: a control character or punctuation.
fn is_marker(byte: u8) -> bool {
    byte < 0x20 || b"<>[](){}!:;$#@*&|".contains(&byte)
}

/// The markers that split `chunks` into frames, the best first.
pub(crate) fn markings(chunks: &[Vec<u8>]) -> Vec<Marked> {
    let all: usize = chunks.iter().map(Vec::len).sum();
    let mut found: Vec<Marked> = Vec::new();
    for start in starts(chunks) {
        for tail in 0..=TAIL_MAX {
            for end in ends(chunks, start, tail) {
                let mut marked = Marked {
                    start,
                    end: vec![end],
                    tail,
                    is_hex: false,
                    share: 0,
                };
                let frames = marked.frames(chunks);
                let framed: usize = frames.iter().map(|frame| frame.len()).sum();
                marked.share = framed * 100 / all.max(1);
                if frames.len() >= FRAMES_MIN && marked.share >= SHARE_MIN {
                    found.push(marked);
                }
            }
        }
    }
    // Lines are text, unless their bytes are digits.
    found.retain_mut(|marked| {
        let frames: Vec<Vec<u8>> = marked
            .frames(chunks)
            .iter()
            .map(|one| one.to_vec())
            .collect();
        if !b"\r\n".contains(&marked.end[0]) {
            return true;
        }
        let has_return = frames.iter().all(|frame| frame.ends_with(b"\r\n"));
        if has_return {
            marked.end = b"\r\n".to_vec();
        }
        marked.is_hex = marked.tail == 0 && !marked.start.is_ascii_hexdigit();
        marked.is_hex &= frames.iter().all(|frame| marked.content(frame).is_some());
        marked.is_hex || marked.start < 0x20
    });
    // Binary bytes may hold any marker: only text and digits are kept.
    found.retain_mut(|marked| {
        let frames: Vec<Vec<u8>> = marked
            .frames(chunks)
            .iter()
            .map(|one| one.to_vec())
            .collect();
        marked.lengthen(&frames);
        marked.is_hex || marked.is_usual(&frames)
    });
    found.sort_by_key(|marked| (core::cmp::Reverse(marked.share), marked.tail));
    found
}

/// Frequent first bytes of chunks, and frequent bytes.
fn starts(chunks: &[Vec<u8>]) -> Vec<u8> {
    let ranked = |bytes: &mut dyn Iterator<Item = u8>| {
        let mut counts: BTreeMap<u8, usize> = BTreeMap::new();
        for byte in bytes {
            *counts.entry(byte).or_default() += 1;
        }
        let mut ranked: Vec<(u8, usize)> = counts.into_iter().collect();
        ranked.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
        ranked.into_iter().map(|(byte, _)| byte)
    };
    let firsts = ranked(&mut chunks.iter().filter_map(|chunk| chunk.first().copied()));
    let usual = ranked(&mut chunks.iter().flatten().copied());
    let mut starts: Vec<u8> = firsts.take(2).collect();
    for byte in usual.take(STARTS_MAX) {
        if !starts.contains(&byte) {
            starts.push(byte);
        }
    }
    starts
}

/// The most frequent bytes that stand `tail` bytes before a start marker or before the end of a
/// chunk.
fn ends(chunks: &[Vec<u8>], start: u8, tail: usize) -> Vec<u8> {
    let mut counts: BTreeMap<u8, usize> = BTreeMap::new();
    for chunk in chunks {
        let places = (1..chunk.len()).filter(|at| chunk[*at] == start);
        for place in places.chain([chunk.len()]) {
            if let Some(end) = place.checked_sub(tail + 1).map(|at| chunk[at]) {
                *counts.entry(end).or_default() += 1;
            }
        }
    }
    let mut common: Vec<(u8, usize)> = counts.into_iter().collect();
    common.retain(|(end, count)| *end != start && *count >= FRAMES_MIN);
    common.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
    common.into_iter().take(2).map(|(end, _)| end).collect()
}
