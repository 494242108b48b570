//! Detection of frame boundaries in an unknown format: by end or start markers, stuffing and length
//! fields.

use std::collections::{BTreeMap, BTreeSet};

use super::checksum;
use super::format::{Coding, Format, Length};

/// Maximum offset of a length field.
const LENGTH_AT_MAX: usize = 40;
/// Minimum evidence for a length field, bits.
const LENGTH_BITS: f64 = 10.0;
/// Maximum number of length fields of a format.
const LENGTHS_MAX: usize = 3;
/// One chunk in this many may have another end or stuffing.
const DAMAGED_SHARE: usize = 8;
/// Maximum number of examined bytes.
const BYTES_MAX: usize = 64 << 10;
/// End markers that are tried first, with their stuffing.
const ENDS: [(&[u8], &[u8], Coding); 10] = [
    (b"\r\n", b"", Coding::Raw),
    (b"\n", b"", Coding::Raw),
    (b"\r", b"", Coding::Raw),
    (&[0x00], b"", Coding::Cobs),
    (&[0xC0], b"", Coding::Slip),
    (&[0xC0], &[0xC0], Coding::Slip),
    (&[0x7E], &[0x7E], Coding::Hdlc),
    (&[0x10, 0x03], &[0x10, 0x02], Coding::Dle),
    (&[0x10, 0x03], &[0x10], Coding::Dle),
    (&[0x00], b"", Coding::Raw),
];
/// If one way to split has more evidence than this, start markers are not tried; bits.
const ENOUGH_BITS: f64 = 20.0;
/// Maximum number of start markers that are tried if no end marker is found.
const STARTS_MAX: usize = 6;

/// The format of `chunks`, and their frames.
pub(crate) fn infer(chunks: &[Vec<u8>]) -> (Format, Vec<Vec<u8>>) {
    let chunks = few(chunks);
    let mut found: Vec<(f64, Format, Vec<Vec<u8>>)> = Vec::new();
    for (end, flag, coding) in ENDS {
        let (end, flag) = (end.to_vec(), flag.to_vec());
        let format = Format {
            end,
            flag,
            coding,
            ..Format::unknown()
        };
        found.extend(tried(format, &chunks));
    }
    for end in common_ends(&chunks).into_iter().chain(text_ends(&chunks)) {
        let format = Format {
            end,
            ..Format::unknown()
        };
        found.extend(tried(format, &chunks));
    }
    // Tries each chunk as one frame.
    let format = with_fields(Format::unknown(), &chunks);
    found.push((score(&format), format, chunks.clone()));
    if found.iter().all(|(score, ..)| *score < ENOUGH_BITS) {
        let whole = chunks.concat();
        for start in common_starts(&whole) {
            let frames = split_before(&whole, &start);
            let format = with_fields(Format::unknown(), &frames);
            if format
                .checksum
                .is_some_and(|checksum| checksum.is_present())
            {
                found.push((score(&format), format, frames));
            }
        }
    }
    // Selects the first of equally good formats.
    let best = found
        .into_iter()
        .rev()
        .max_by(|one, other| one.0.total_cmp(&other.0));
    best.map_or((Format::unknown(), chunks), |(_, format, frames)| {
        (format, frames)
    })
}

/// The first of `chunks`, up to the number of bytes that are examined.
fn few(chunks: &[Vec<u8>]) -> Vec<Vec<u8>> {
    let mut room = BYTES_MAX;
    let mut few = Vec::new();
    for chunk in chunks.iter().filter(|chunk| !chunk.is_empty()) {
        let len = chunk.len().min(room);
        if len == 0 {
            break;
        }
        few.push(chunk[..len].to_vec());
        room -= len;
    }
    few
}

/// The properties of `format`, if `chunks` may have it.
fn tried(format: Format, chunks: &[Vec<u8>]) -> Option<(f64, Format, Vec<Vec<u8>>)> {
    let is_ended = |chunk: &&Vec<u8>| chunk.ends_with(&format.end);
    let ended = chunks.iter().filter(is_ended).count();
    let ends = |chunk: &Vec<u8>| format.split(chunk).len();
    // A single long chunk is a stream that may start and end within a frame.
    let is_stream = chunks.iter().any(|chunk| ends(chunk) > 3);
    let is_usual = is_stream || ended * DAMAGED_SHARE >= chunks.len() * (DAMAGED_SHARE - 1);
    // If a conversation ends within a frame, its last chunk is truncated.
    if ended == 0 && !is_stream || !is_usual && ended + 1 < chunks.len() {
        return None;
    }
    let frames: Vec<Vec<u8>> = chunks
        .iter()
        .flat_map(|chunk| format.split(chunk))
        .filter(|frame| frame.ends_with(&format.end) && frame.len() > format.end.len())
        .map(<[u8]>::to_vec)
        .collect();
    // SLIP has its marker at one end of a frame, or at both.
    let flagged = frames
        .iter()
        .filter(|frame| frame.starts_with(&format.flag));
    let is_flagged = flagged.count() * DAMAGED_SHARE >= frames.len() * (DAMAGED_SHARE - 1);
    if format.coding == Coding::Slip && !is_flagged {
        return None;
    }
    let sound = frames.iter().filter(|frame| format.body(frame).is_some());
    let sound = sound.count();
    if sound == 0 || sound * DAMAGED_SHARE < frames.len() * (DAMAGED_SHARE - 1) {
        return None;
    }
    let is_printable = |byte: &u8| matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n');
    let texts = frames.iter().filter(|frame| frame.iter().all(is_printable));
    let last = format.end.last()?;
    let is_line = matches!(format.coding, Coding::Raw)
        && (b"\r\n".contains(last) || TEXT_ENDS.contains(last));
    let is_text = is_line && texts.count() * DAMAGED_SHARE >= frames.len() * (DAMAGED_SHARE - 1);
    let format = with_fields(Format { is_text, ..format }, &frames);
    if !is_usual && !is_text && format.checksum.is_none() {
        return None;
    }
    Some((score(&format), format, frames))
}

/// `format` with its checksum and lengths.
fn with_fields(mut format: Format, frames: &[Vec<u8>]) -> Format {
    let bodies: Vec<Vec<u8>> = frames
        .iter()
        .filter_map(|frame| format.body(frame))
        .collect();
    format.checksum = checksum::infer(&bodies);
    if !format.is_text {
        let contents: Vec<Vec<u8>> = frames
            .iter()
            .filter(|frame| format.is_sound(frame) != Some(false))
            .filter_map(|frame| format.content(frame))
            .collect();
        format.lengths = lengths(&contents);
    }
    format
}

/// The evidence for `format`, bits.
fn score(format: &Format) -> f64 {
    let checksum = format
        .checksum
        .as_ref()
        .map_or(0.0, |checksum| checksum.bits);
    let stuffed = match format.coding {
        Coding::Raw => 0.0,
        Coding::Cobs | Coding::Slip | Coding::Hdlc => 4.0,
        Coding::Dle => 6.0,
    };
    let ended = if format.end.is_empty() { 0.0 } else { 1.0 };
    // Of two fitting end markers prefers the longer one: the shorter one would leave a byte of it
    // in each frame.
    let ended = ended + (format.end.len() + format.flag.len()) as f64 * 0.1;
    let text = if format.is_text { 8.0 } else { 0.0 };
    checksum + stuffed + ended + text + format.lengths.len() as f64
}

/// Bytes at the end of many chunks.
fn common_ends(chunks: &[Vec<u8>]) -> Vec<Vec<u8>> {
    if chunks.len() < 4 {
        return Vec::new();
    }
    let distinct: BTreeSet<&Vec<u8>> = chunks.iter().collect();
    let mut counts: BTreeMap<u8, usize> = BTreeMap::new();
    for last in distinct.iter().filter_map(|chunk| chunk.last()) {
        *counts.entry(*last).or_default() += 1;
    }
    let is_common = |count: usize| count >= 4 && count * 10 >= distinct.len() * 9;
    let common = counts.into_iter().filter(|(_, count)| is_common(*count));
    common.map(|(byte, _)| vec![byte]).collect()
}

/// Characters that end lines of text in some protocols.
const TEXT_ENDS: &[u8] = b";>|#!";
/// Minimum number of such characters.
const TEXT_ENDS_MIN: usize = 12;

/// Characters at the end of many parts of a text without line ends.
fn text_ends(chunks: &[Vec<u8>]) -> Vec<Vec<u8>> {
    let mut all = chunks.iter().flatten();
    if !all.clone().all(|byte| matches!(byte, b' '..=b'~')) || all.next().is_none() {
        return Vec::new();
    }
    let count = |end: &u8| all.clone().filter(|byte| *byte == end).count();
    let many = TEXT_ENDS.iter().filter(|end| count(end) >= TEXT_ENDS_MIN);
    many.map(|end| vec![*end]).collect()
}

/// The most frequent pairs of bytes in a stream.
fn common_starts(whole: &[u8]) -> Vec<Vec<u8>> {
    let mut counts: BTreeMap<&[u8], usize> = BTreeMap::new();
    for len in [1, 2] {
        for window in whole.windows(len) {
            *counts.entry(window).or_default() += 1;
        }
    }
    let mut common: Vec<(&[u8], usize)> =
        counts.into_iter().filter(|(_, count)| *count > 3).collect();
    // A longer start marker is better.
    common.sort_by_key(|(start, count)| core::cmp::Reverse((start.len(), *count)));
    let pairs = common.iter().filter(|(start, _)| start.len() == 2);
    let singles = common.iter().filter(|(start, _)| start.len() == 1);
    let starts = pairs.take(STARTS_MAX).chain(singles.take(STARTS_MAX));
    starts.map(|(start, _)| start.to_vec()).collect()
}

fn split_before(whole: &[u8], start: &[u8]) -> Vec<Vec<u8>> {
    let starts = whole.windows(start.len()).enumerate();
    let at: Vec<usize> = starts
        .filter(|(_, window)| *window == start)
        .map(|(at, _)| at)
        .collect();
    let ends = at.iter().skip(1).copied();
    at.iter()
        .zip(ends)
        .map(|(&from, to)| whole[from..to].to_vec())
        .collect()
}

/// The length fields of `contents`.
fn lengths(contents: &[Vec<u8>]) -> Vec<Length> {
    let distinct: BTreeSet<&Vec<u8>> = contents.iter().collect();
    let sizes: BTreeSet<usize> = distinct.iter().map(|content| content.len()).collect();
    let Some(&shortest) = sizes.first() else {
        return Vec::new();
    };
    let (mut found, mut tried) = (Vec::new(), 0.0_f64);
    for at in 0..shortest.min(LENGTH_AT_MAX) {
        for (bytes, is_big) in [(2, false), (2, true), (1, false)] {
            for scale in [1, 2, 4] {
                if at + bytes > shortest {
                    continue;
                }
                tried += 1.0;
                found.extend(length(at, bytes, is_big, scale, &distinct));
            }
        }
    }
    // Each further length is worth its bits; the first one only determines the constant.
    let bits = 8.0 * (sizes.len() as f64 - 1.0) - tried.max(1.0).log2();
    let bits = bits
        + if sizes.len() > 1 {
            distinct.len() as f64
        } else {
            0.0
        };
    if bits < LENGTH_BITS && sizes.len() < 3 {
        return Vec::new();
    }
    // Keeps the widest field at an offset; its low byte would be a field too.
    let mut kept: Vec<Length> = Vec::new();
    for length in found {
        let overlaps = |known: &Length| {
            length.at < known.at + known.bytes && known.at < length.at + length.bytes
        };
        if !kept.iter().any(overlaps) && kept.len() < LENGTHS_MAX {
            kept.push(length);
        }
    }
    kept
}

/// The length field of this kind at `at`, if it fits all of `contents`.
fn length(
    at: usize,
    bytes: usize,
    is_big: bool,
    scale: usize,
    contents: &BTreeSet<&Vec<u8>>,
) -> Option<Length> {
    let unset = Length {
        at,
        bytes,
        is_big,
        scale,
        rest: 0,
    };
    let first = contents.first()?;
    let value = unset.read(first)?.checked_mul(scale)?;
    let rest = isize::try_from(first.len()).ok()? - isize::try_from(value).ok()?;
    // A length counts at most a small trailer that was removed, such as a checksum.
    let length = Length { rest, ..unset };
    let is_likely = (-8..=64).contains(&rest);
    (is_likely && contents.iter().all(|content| length.holds(content))).then_some(length)
}
