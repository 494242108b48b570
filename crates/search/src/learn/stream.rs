//! Frames in a stream without pauses: frames of constant size, and frames with sync bytes and a
//! length field.

use std::collections::{BTreeMap, BTreeSet};

/// A way to split a stream into frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Cutting {
    /// First bytes of each frame.
    pub(crate) sync: Vec<u8>,
    pub(crate) how: How,
    /// Share of bytes in such frames, per cent.
    pub(crate) share: usize,
    /// Share of chunks that begin with such a frame, per cent.
    pub(crate) aligned: usize,
    /// Whether almost all chunks that begin with the sync bytes consist of such frames.
    pub(crate) is_clean: bool,
}

/// The rule that defines the end of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum How {
    /// All frames have this size.
    Fixed(usize),
    /// The frame has a length field: its value times `unit` plus `base` is the size of the frame.
    Length {
        at: usize,
        bytes: usize,
        is_big: bool,
        unit: usize,
        base: usize,
    },
}

/// Maximum number of examined bytes.
const BYTES_MAX: usize = 32 << 10;
/// Maximum number of sync byte sequences that are tried.
const STARTS_MAX: usize = 10;
/// Maximum length of a common beginning of chunks that is tried as sync bytes.
const PREFIX_MAX: usize = 4;
/// Minimum value of a second or later sync byte.
const MARK_MIN: u8 = 0x20;
/// Maximum offset of a length field behind the sync bytes.
const AT_MAX: usize = 6;
/// Maximum length of a frame.
const FRAME_MAX: usize = 1_024;
/// Minimum share of bytes in frames, per cent: other formats may share the line.
const SHARE_MIN: usize = 10;
/// Minimum share of the bytes of chunks with the sync bytes, per cent.
const CLEAN_MIN: usize = 97;
/// For this number of frames, one beginning may have no frame.
const STRAYS_SHARE: usize = 200;
/// Minimum number of frames.
const FRAMES_MIN: usize = 6;
/// Maximum number of bytes of a frame that its length field does not count.
const BASE_MAX: usize = 32;

/// The number at `at`.
fn number(bytes: &[u8], at: usize, len: usize, is_big: bool) -> Option<usize> {
    let field = bytes.get(at..at + len)?;
    let add = |value: usize, byte: &u8| value << 8 | usize::from(*byte);
    Some(match is_big {
        true => field.iter().fold(0, add),
        false => field.iter().rev().fold(0, add),
    })
}

impl Cutting {
    /// The size of the frame at the beginning of `bytes`, if a frame begins there.
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
                unit,
                base,
            } => {
                let size = number(bytes, at, len, is_big)? * unit + base;
                (size > at + len && size <= FRAME_MAX).then_some(size)
            }
        }
    }

    /// Number of beginnings behind a frame, or of a chunk, without a frame: other sizes, or damage.
    /// The last chunk may end within a frame.
    fn strays(&self, chunks: &[Vec<u8>]) -> usize {
        let mut strays = 0;
        for (index, chunk) in chunks.iter().enumerate() {
            let is_last = index + 1 == chunks.len();
            let mut at = 0;
            while let Some(rest) = chunk.get(at..).filter(|rest| rest.starts_with(&self.sync)) {
                let size = self.size(rest).unwrap_or(usize::MAX);
                let next = rest.get(size..);
                let is_stray = |next: &[u8]| !next.is_empty() && !next.starts_with(&self.sync);
                if next.map_or(!is_last, is_stray) {
                    strays += 1;
                }
                if next.is_none_or(is_stray) {
                    break;
                }
                at += size;
            }
        }
        strays
    }

    /// The frames in `chunks`. A frame counts only if its chunk ends behind it, or if the next byte
    /// is a common first byte of chunks.
    pub(crate) fn frames<'a>(&self, chunks: &'a [Vec<u8>]) -> Vec<&'a [u8]> {
        let firsts: BTreeSet<u8> = chunks
            .iter()
            .filter_map(|chunk| chunk.first().copied())
            .collect();
        let mut frames = Vec::new();
        for chunk in chunks {
            let mut at = 0;
            while at < chunk.len() {
                let size = self.size(&chunk[at..]);
                let frame = size.and_then(|size| chunk.get(at..at + size));
                let is_followed = |frame: &[u8]| {
                    let rest = &chunk[at + frame.len()..];
                    let is_begun = rest.starts_with(&self.sync);
                    is_begun || rest.first().is_none_or(|byte| firsts.contains(byte))
                };
                match frame.filter(|frame| is_followed(frame)) {
                    Some(frame) => {
                        frames.push(frame);
                        at += frame.len();
                    }
                    None => at += 1,
                }
            }
        }
        frames
    }

    /// Rank among splits with equal coverage: constant size, then 2 bytes low byte first, then 1
    /// byte.
    const fn rank(&self) -> usize {
        match self.how {
            How::Fixed(_) => 3,
            How::Length {
                bytes: 2,
                is_big: false,
                ..
            } => 2,
            How::Length { bytes: 1, .. } => 1,
            How::Length { .. } => 0,
        }
    }
}

/// The possible ways to split `chunks`, the best first.
pub(crate) fn cuttings(chunks: &[Vec<u8>]) -> Vec<Cutting> {
    let mut room = BYTES_MAX;
    let few = chunks.iter().take_while(|chunk| {
        let is_room = room > 0;
        room = room.saturating_sub(chunk.len());
        is_room
    });
    let few: Vec<Vec<u8>> = few
        .map(|chunk| chunk[..chunk.len().min(BYTES_MAX)].to_vec())
        .collect();
    let stream = few.concat();
    let mut found: Vec<Cutting> = Vec::new();
    for sync in starts(&stream, &few) {
        let places: Vec<usize> = stream
            .windows(sync.len())
            .enumerate()
            .filter(|(_, window)| *window == sync)
            .map(|(at, _)| at)
            .collect();
        let ways = fixed(&places)
            .into_iter()
            .chain(lengths(&stream, &sync, &places))
            .chain(lengths_of_chunks(&few, &sync));
        let ways: BTreeSet<How> = ways.collect();
        for how in ways {
            let mut cutting = Cutting {
                sync: sync.clone(),
                how,
                share: 0,
                aligned: 0,
                is_clean: false,
            };
            let frames = cutting.frames(&few);
            let framed: usize = frames.iter().map(|frame| frame.len()).sum();
            cutting.share = framed * 100 / stream.len().max(1);
            let begin = few.iter().filter(|chunk| {
                let size = cutting.size(chunk);
                size.is_some_and(|size| size <= chunk.len())
            });
            cutting.aligned = begin.count() * 100 / few.len().max(1);
            let own = few.iter().filter(|chunk| chunk.starts_with(&sync));
            let own: usize = own.map(Vec::len).sum();
            let strays = cutting.strays(&few);
            cutting.is_clean = own > 0
                && framed * 100 >= own * CLEAN_MIN
                && match how {
                    // Another size is no damage.
                    How::Fixed(_) => strays == 0,
                    How::Length { .. } => strays <= (frames.len() / STRAYS_SHARE).max(1),
                };
            if frames.len() >= FRAMES_MIN && cutting.share >= SHARE_MIN {
                found.push(cutting);
            }
        }
    }
    found.sort_by_key(|cutting| {
        let share = (cutting.share, cutting.aligned);
        core::cmp::Reverse((share, cutting.rank(), cutting.sync.len()))
    });
    // Of sync bytes with a common beginning keeps the longest that covers as much.
    let mut kept: Vec<Cutting> = Vec::new();
    for cutting in found {
        let is_like = |known: &Cutting| {
            known.how == cutting.how && known.sync.first() == cutting.sync.first()
        };
        if !kept.iter().any(is_like) {
            kept.push(cutting);
        }
    }
    kept
}

/// Frequent byte sequences that may begin frames, longer ones first.
fn starts(stream: &[u8], chunks: &[Vec<u8>]) -> Vec<Vec<u8>> {
    let mut all: Vec<Vec<u8>> = Vec::new();
    let mut add = |start: &[u8]| {
        // Small numbers behind the first byte are addresses and kinds rather than sync bytes.
        let end = start.iter().skip(1).position(|byte| *byte < MARK_MIN);
        let start = &start[..end.map_or(start.len(), |at| at + 1)];
        // A third byte is data that did not change, unless the sync bytes count down or repeat.
        let is_row = |pair: &[u8]| pair[0] == pair[1] || pair[0].wrapping_sub(1) == pair[1];
        let rows = start.windows(2).take_while(|pair| is_row(pair)).count();
        let most = if rows == 0 { 2 } else { rows + 2 };
        let start = &start[..start.len().min(most)];
        if !all.iter().any(|known| known == start) {
            all.push(start.to_vec());
        }
    };
    for len in (1..=PREFIX_MAX).rev() {
        let mut counts: BTreeMap<&[u8], usize> = BTreeMap::new();
        for start in chunks.iter().filter_map(|chunk| chunk.get(..len)) {
            *counts.entry(start).or_default() += 1;
        }
        let mut common: Vec<_> = counts.into_iter().filter(|(_, count)| *count > 3).collect();
        common.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
        common.iter().take(3).for_each(|(start, _)| add(start));
    }
    for len in [3, 2, 1] {
        let mut counts: BTreeMap<&[u8], usize> = BTreeMap::new();
        for window in stream.windows(len) {
            *counts.entry(window).or_default() += 1;
        }
        let mut common: Vec<(&[u8], usize)> = counts
            .into_iter()
            .filter(|(start, count)| {
                // A sequence of equal bytes is not a sync sequence.
                let is_plain = len > 1 && start.iter().all(|byte| [0, 0xFF].contains(byte));
                *count >= FRAMES_MIN && !is_plain
            })
            .collect();
        common.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
        let taken = common.into_iter().take(STARTS_MAX);
        taken.for_each(|(start, _)| add(start));
    }
    all
}

/// The most frequent distance between two beginnings.
fn fixed(places: &[usize]) -> Option<How> {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for pair in places.windows(2) {
        *counts.entry(pair[1] - pair[0]).or_default() += 1;
    }
    let (size, count) = counts.into_iter().max_by_key(|(_, count)| *count)?;
    let is_usual = count * 2 >= places.len() && (2..=FRAME_MAX).contains(&size);
    is_usual.then_some(How::Fixed(size))
}

/// Types of numbers that may be a length.
const NUMBERS: [(usize, bool); 3] = [(1, false), (2, false), (2, true)];

/// Numbers behind the sync bytes that give the distance to the next beginning.
fn lengths(stream: &[u8], sync: &[u8], places: &[usize]) -> Vec<How> {
    let mut found = Vec::new();
    for at in sync.len()..=sync.len() + AT_MAX {
        for (bytes, is_big) in NUMBERS {
            let ends = places
                .windows(2)
                .map(|pair| (pair[0], vec![pair[1] - pair[0]]));
            let ends: Vec<_> = ends.collect();
            found.extend(voted(stream, &ends, at, bytes, is_big));
        }
    }
    found
}

/// Numbers behind the sync bytes that give the distance to a later beginning or to the end of the
/// chunk.
fn lengths_of_chunks(chunks: &[Vec<u8>], sync: &[u8]) -> Vec<How> {
    let stream = chunks.concat();
    let (mut ends, mut from) = (Vec::new(), 0);
    for chunk in chunks {
        if chunk.starts_with(sync) {
            let windows = chunk.windows(sync.len()).enumerate().skip(sync.len());
            let again = windows
                .filter(|(_, window)| *window == sync)
                .map(|(at, _)| at);
            ends.push((from, again.chain([chunk.len()]).take(8).collect()));
        }
        from += chunk.len();
    }
    let mut found = Vec::new();
    for at in sync.len()..=sync.len() + AT_MAX {
        for (bytes, is_big) in NUMBERS {
            found.extend(voted(&stream, &ends, at, bytes, is_big));
        }
    }
    found
}

/// The length field at `at` for frames of several sizes, if it fits most frames.
fn voted(
    stream: &[u8],
    ends: &[(usize, Vec<usize>)],
    at: usize,
    bytes: usize,
    is_big: bool,
) -> Vec<How> {
    let mut found = Vec::new();
    for unit in [1, 2] {
        let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
        let mut values: BTreeSet<usize> = BTreeSet::new();
        for (from, sizes) in ends {
            let Some(value) = number(stream, from + at, bytes, is_big) else {
                continue;
            };
            values.insert(value);
            for size in sizes {
                if let Some(base) = size.checked_sub(value * unit) {
                    *counts.entry(base).or_default() += 1;
                }
            }
        }
        let most = counts.into_iter().max_by_key(|(_, count)| *count);
        // A constant field gives no evidence of lengths.
        if let Some((base, count)) = most
            && values.len() > 1
            && count * 2 >= ends.len()
            && base <= BASE_MAX
        {
            found.push(How::Length {
                at,
                bytes,
                is_big,
                unit,
                base,
            });
        }
    }
    found
}
