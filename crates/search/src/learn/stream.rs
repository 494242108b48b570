//! Frames in a stream without pauses: those of one size, and those that begin with sync bytes and
//! say how long they are.

use std::collections::BTreeMap;

/// How frames of a stream are told apart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Cutting {
    /// First bytes of each frame.
    pub(crate) sync: Vec<u8>,
    pub(crate) how: How,
    /// Share of the bytes that lie in such frames, per cent.
    pub(crate) share: usize,
}

/// What says where a frame ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum How {
    /// All have this size.
    Fixed(usize),
    /// A number in the frame: its value and `base` are the frame's size.
    Length {
        at: usize,
        bytes: usize,
        is_big: bool,
        base: usize,
    },
}

/// Bytes that are looked at.
const BYTES_MAX: usize = 32 << 10;
/// Sync bytes that are tried.
const STARTS_MAX: usize = 10;
/// Last place of a length field behind the sync bytes.
const AT_MAX: usize = 6;
/// Longest frame.
const FRAME_MAX: usize = 1_024;
/// Least share of bytes in frames, per cent.
const SHARE_MIN: usize = 85;
/// Fewest frames.
const FRAMES_MIN: usize = 6;

impl Cutting {
    /// The size of the frame that `bytes` begin with, if they say so.
    fn size(&self, bytes: &[u8]) -> Option<usize> {
        if !bytes.starts_with(&self.sync) {
            return None;
        }
        match self.how {
            How::Fixed(size) => Some(size),
            How::Length {
                at,
                bytes: len,
                is_big,
                base,
            } => {
                let field = bytes.get(at..at + len)?;
                let number = |value: usize, byte: &u8| value << 8 | usize::from(*byte);
                let value = match is_big {
                    true => field.iter().fold(0, number),
                    false => field.iter().rev().fold(0, number),
                };
                let size = value + base;
                (size > at + len && size <= FRAME_MAX).then_some(size)
            }
        }
    }

    /// The frames of `stream`. A frame counts only if another one, or the end, follows it.
    pub(crate) fn frames<'a>(&self, stream: &'a [u8]) -> Vec<&'a [u8]> {
        let (mut frames, mut at) = (Vec::new(), 0);
        while at < stream.len() {
            let size = self.size(&stream[at..]);
            let frame = size.and_then(|size| stream.get(at..at + size));
            let is_followed = |frame: &[u8]| {
                let rest = &stream[at + frame.len()..];
                rest.len() < self.sync.len().max(1) || rest.starts_with(&self.sync)
            };
            match frame.filter(|frame| is_followed(frame)) {
                Some(frame) => {
                    frames.push(frame);
                    at += frame.len();
                }
                None => at += 1,
            }
        }
        frames
    }
}

/// The ways in which `stream` can be cut, best first.
pub(crate) fn cuttings(stream: &[u8]) -> Vec<Cutting> {
    let stream = &stream[..stream.len().min(BYTES_MAX)];
    let mut found: Vec<Cutting> = Vec::new();
    for sync in starts(stream) {
        let places: Vec<usize> = stream
            .windows(sync.len())
            .enumerate()
            .filter(|(_, window)| *window == sync)
            .map(|(at, _)| at)
            .collect();
        for how in fixed(&places)
            .into_iter()
            .chain(lengths(stream, &sync, &places))
        {
            let mut cutting = Cutting {
                sync: sync.clone(),
                how,
                share: 0,
            };
            let frames = cutting.frames(stream);
            let framed: usize = frames.iter().map(|frame| frame.len()).sum();
            cutting.share = framed * 100 / stream.len().max(1);
            if frames.len() >= FRAMES_MIN && cutting.share >= SHARE_MIN {
                found.push(cutting);
            }
        }
    }
    found.sort_by_key(|cutting| {
        let is_fixed = matches!(cutting.how, How::Fixed(_));
        core::cmp::Reverse((cutting.share, is_fixed, cutting.sync.len()))
    });
    found
}

/// Bytes that come so often that they may begin frames: longer ones first.
fn starts(stream: &[u8]) -> Vec<Vec<u8>> {
    let mut all = Vec::new();
    for len in [3, 2, 1] {
        let mut counts: BTreeMap<&[u8], usize> = BTreeMap::new();
        for window in stream.windows(len) {
            *counts.entry(window).or_default() += 1;
        }
        let mut common: Vec<(&[u8], usize)> = counts
            .into_iter()
            .filter(|(start, count)| {
                // A row of one value is no mark.
                let is_plain = len > 1 && start.iter().all(|byte| [0, 0xFF].contains(byte));
                *count >= FRAMES_MIN && !is_plain
            })
            .collect();
        common.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
        let taken = common.into_iter().take(STARTS_MAX);
        all.extend(taken.map(|(start, _)| start.to_vec()));
    }
    all
}

/// The distance that most beginnings have from the next one.
fn fixed(places: &[usize]) -> Option<How> {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for pair in places.windows(2) {
        *counts.entry(pair[1] - pair[0]).or_default() += 1;
    }
    let (size, count) = counts.into_iter().max_by_key(|(_, count)| *count)?;
    let is_usual = count * 2 >= places.len() && (2..=FRAME_MAX).contains(&size);
    is_usual.then_some(How::Fixed(size))
}

/// Numbers behind the sync bytes that say how far it is to the next beginning.
fn lengths(stream: &[u8], sync: &[u8], places: &[usize]) -> Vec<How> {
    let mut found = Vec::new();
    for at in sync.len()..=sync.len() + AT_MAX {
        for (bytes, is_big) in [(1, false), (2, false), (2, true)] {
            let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
            let mut values: Vec<usize> = Vec::new();
            for pair in places.windows(2) {
                let field = stream.get(pair[0] + at..pair[0] + at + bytes);
                let Some(field) = field else { continue };
                let number = |value: usize, byte: &u8| value << 8 | usize::from(*byte);
                let value = match is_big {
                    true => field.iter().fold(0, number),
                    false => field.iter().rev().fold(0, number),
                };
                if let Some(base) = (pair[1] - pair[0]).checked_sub(value) {
                    *counts.entry(base).or_default() += 1;
                    values.push(value);
                }
            }
            values.sort_unstable();
            values.dedup();
            let most = counts.into_iter().max_by_key(|(_, count)| *count);
            // A field that always has the same value says nothing of lengths.
            if let Some((base, count)) = most
                && values.len() > 1
                && count * 2 >= places.len().saturating_sub(1)
                && base <= 32
            {
                found.push(How::Length {
                    at,
                    bytes,
                    is_big,
                    base,
                });
            }
        }
    }
    found
}
