//! How frames of an unknown format are distinguished: by what ends or begins them, by their
//! stuffing and by what they tell of their length.

use std::collections::{BTreeMap, BTreeSet};

use super::checksum;
use super::format::{Coding, Format, Length};

/// Last place of a field that tells a length.
const LENGTH_AT_MAX: usize = 40;
/// Bits of evidence that a length field needs.
const LENGTH_BITS: f64 = 10.0;
/// Lengths of a format that are kept.
const LENGTHS_MAX: usize = 3;
/// Share of chunks of which one may not end as the others, or not be stuffed as they are.
const DAMAGED_SHARE: usize = 8;
/// Maximum number of checked bytes.
const BYTES_MAX: usize = 64 << 10;
/// Ends of frames that are tried first, each with its stuffing.
const ENDS: [(&[u8], &[u8], Coding); 8] = [
    (b"\r\n", b"", Coding::Raw),
    (b"\n", b"", Coding::Raw),
    (b"\r", b"", Coding::Raw),
    (&[0x00], b"", Coding::Cobs),
    (&[0xC0], b"", Coding::Slip),
    (&[0xC0], &[0xC0], Coding::Slip),
    (&[0x7E], &[0x7E], Coding::Hdlc),
    (&[0x00], b"", Coding::Raw),
];
/// Bits of evidence for one way to split above which no beginnings of frames are tried.
const ENOUGH_BITS: f64 = 20.0;
/// Beginnings of frames that are tried if nothing ends them.
const STARTS_MAX: usize = 6;

/// The format of `chunks`, each what came in one go, and their frames.
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
    for end in common_ends(&chunks) {
        let format = Format {
            end,
            ..Format::unknown()
        };
        found.extend(tried(format, &chunks));
    }
    // Each chunk a frame.
    let format = with_fields(Format::unknown(), &chunks);
    found.push((score(&format), format, chunks.clone()));
    if found.iter().all(|(score, ..)| *score < ENOUGH_BITS) {
        let whole = chunks.concat();
        for start in common_starts(&whole) {
            let frames = split_before(&whole, &start);
            let format = with_fields(Format::unknown(), &frames);
            if format.checksum.is_some_and(|checksum| checksum.is_sure) {
                found.push((score(&format), format, frames));
            }
        }
    }
    // The first of equals.
    let best = found
        .into_iter()
        .rev()
        .max_by(|one, other| one.0.total_cmp(&other.0));
    best.map_or((Format::unknown(), chunks), |(_, format, frames)| {
        (format, frames)
    })
}

/// So many of `chunks` as are checked.
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

/// What is known of `format` if `chunks` may be of it.
fn tried(format: Format, chunks: &[Vec<u8>]) -> Option<(f64, Format, Vec<Vec<u8>>)> {
    let is_ended = |chunk: &&Vec<u8>| chunk.ends_with(&format.end);
    let ended = chunks.iter().filter(is_ended).count();
    let ends = |chunk: &Vec<u8>| format.split(chunk).len();
    // One long chunk is a stream that may begin and end anywhere.
    let is_stream = chunks.iter().any(|chunk| ends(chunk) > 3);
    let is_usual = is_stream || ended * DAMAGED_SHARE >= chunks.len() * (DAMAGED_SHARE - 1);
    // A conversation that ends in the middle of a frame has one chunk that is cut.
    if ended == 0 && !is_stream || !is_usual && ended + 1 < chunks.len() {
        return None;
    }
    let frames: Vec<Vec<u8>> = chunks
        .iter()
        .flat_map(|chunk| format.split(chunk))
        .filter(|frame| frame.ends_with(&format.end) && frame.len() > format.end.len())
        .map(<[u8]>::to_vec)
        .collect();
    let sound = frames.iter().filter(|frame| format.body(frame).is_some());
    let sound = sound.count();
    if sound == 0 || sound * DAMAGED_SHARE < frames.len() * (DAMAGED_SHARE - 1) {
        return None;
    }
    let is_printable = |byte: &u8| matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n');
    let texts = frames.iter().filter(|frame| frame.iter().all(is_printable));
    let is_line = matches!(format.coding, Coding::Raw) && b"\r\n".contains(format.end.last()?);
    let is_text = is_line && texts.count() * DAMAGED_SHARE >= frames.len() * (DAMAGED_SHARE - 1);
    let format = with_fields(Format { is_text, ..format }, &frames);
    if !is_usual && !is_text && format.checksum.is_none() {
        return None;
    }
    Some((score(&format), format, frames))
}

/// `format` with its checksum and its lengths.
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

/// How much speaks for `format`, bits.
fn score(format: &Format) -> f64 {
    let checksum = format
        .checksum
        .as_ref()
        .map_or(0.0, |checksum| checksum.bits);
    let stuffed = match format.coding {
        Coding::Raw => 0.0,
        Coding::Cobs | Coding::Slip | Coding::Hdlc => 4.0,
    };
    let ended = if format.end.is_empty() { 0.0 } else { 1.0 };
    // Of two ends that fit the longer one: the other leaves a byte of it in each frame.
    let ended = ended + format.end.len() as f64 * 0.1;
    let text = if format.is_text { 8.0 } else { 0.0 };
    checksum + stuffed + ended + text + format.lengths.len() as f64
}

/// Bytes with which many of several chunks end.
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

/// Pairs of bytes that come most often in a stream.
fn common_starts(whole: &[u8]) -> Vec<Vec<u8>> {
    let mut counts: BTreeMap<&[u8], usize> = BTreeMap::new();
    for len in [1, 2] {
        for window in whole.windows(len) {
            *counts.entry(window).or_default() += 1;
        }
    }
    let mut common: Vec<(&[u8], usize)> =
        counts.into_iter().filter(|(_, count)| *count > 3).collect();
    // A longer beginning is a better one.
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

/// The fields of `contents` that tell how long they are.
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
    // What each other length tells is worth its bits: the first one only sets the constant.
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
    // The widest field at a place, the low byte of which another one would be.
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

/// The field of that kind at `at`, if it tells of all of `contents`.
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
    // A length counts no more than a small trailer that is not here, such as a checksum.
    let length = Length { rest, ..unset };
    let is_likely = (-8..=64).contains(&rest);
    (is_likely && contents.iter().all(|content| length.holds(content))).then_some(length)
}
