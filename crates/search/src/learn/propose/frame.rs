//! The frame formats of a proposal: tries each way to split the bytes, selects the one with the
//! most evidence, and repeats this with the remaining bytes.

use std::sync::Arc;

use description::{Description, From};
use protocols::Decode as _;

use super::super::format::Format;
use super::super::{checksum, framing, marked, stream};
use super::Chunk;
use super::written::{Cut, Found, LINES_SURE, Proposed, proposed};

/// Maximum number of formats on one line.
const FORMATS_MAX: usize = 4;
/// Share of bytes outside frames below which no further formats are searched, per cent.
const LEFT_MIN: usize = 3;
/// Minimum share of the bytes of the other end that a format covers, per cent; then both ends use
/// the format.
const COVERED_MIN: usize = 10;
/// Maximum number of bytes from which a format is learned.
const BYTES_MAX: usize = 24 << 10;
/// Maximum number of ways to split a stream whose checksum is searched, and of pairs of markers.
const CUTTINGS: usize = 6;
const MARKINGS: usize = 3;

/// The formats of the frames: the one with the most evidence, then the best for the rest, and so
/// on.
pub(super) fn find(chunks: &[Chunk], baud: u32) -> Vec<Proposed> {
    let (mut rest, mut formats) = (chunks.to_vec(), Vec::new());
    let all: usize = chunks.iter().map(|chunk| chunk.bytes.len()).sum();
    let is_dialogue = chunks.iter().any(|chunk| !chunk.is_host);
    while formats.len() < FORMATS_MAX {
        let Some((format, left)) = best(&rest, baud, is_dialogue) else {
            break;
        };
        formats.push(format);
        let len: usize = left.iter().map(|chunk| chunk.bytes.len()).sum();
        if len * 100 <= all * LEFT_MIN {
            break;
        }
        rest = left;
    }
    formats
}

/// Whether a checksum confirms a format, the number of bytes in chunks that consist of its frames,
/// and the number of bytes in all its frames.
type Rank = (bool, usize, usize);

/// The best format of `chunks`, and the remaining bytes.
fn best(chunks: &[Chunk], baud: u32, is_dialogue: bool) -> Option<(Proposed, Vec<Chunk>)> {
    let side = |ends: &[bool]| -> Vec<Vec<u8>> {
        let own = chunks.iter().filter(|chunk| ends.contains(&chunk.is_host));
        let mut room = BYTES_MAX;
        let few = own.take_while(|chunk| {
            let is_room = room > 0;
            room = room.saturating_sub(chunk.bytes.len());
            is_room
        });
        few.map(|chunk| chunk.bytes.clone()).collect()
    };
    let mut all: Vec<(Rank, Proposed, Vec<Chunk>)> = Vec::new();
    for ends in [&[false, true][..], &[false], &[true]] {
        let set = side(ends);
        if set.is_empty() {
            continue;
        }
        // Each line of a conversation is a request; other text may be prose.
        let is_asked = ends == [true] && is_dialogue;
        let ways = ways(&set);
        for mut format in ways.iter().filter_map(|way| proposed(way, is_asked)) {
            let Some(read) = alone(&mut format, baud) else {
                continue;
            };
            let own = |chunk: &&Chunk| ends.contains(&chunk.is_host);
            let len: usize = chunks
                .iter()
                .filter(own)
                .map(|chunk| chunk.bytes.len())
                .sum();
            let cover = Cover::of(&read, chunks.iter().filter(own));
            if cover.bytes * 100 < len * COVERED_MIN {
                continue;
            }
            if format.toml == "terminator = \"\\n\"\n" && has_longer_ends(&read, chunks, ends) {
                continue;
            }
            format.ends = cover.ends;
            let mut left = cover.left;
            for is_host in [false, true].into_iter().filter(|end| !ends.contains(end)) {
                let other = || chunks.iter().filter(|chunk| chunk.is_host == is_host);
                let len: usize = other().map(|chunk| chunk.bytes.len()).sum();
                let cover = Cover::of(&read, other());
                // The other end may use the same format among others.
                if !format.is_text && cover.bytes * 100 >= len.max(1) * COVERED_MIN {
                    format.ends[usize::from(is_host)] = true;
                    left.extend(cover.left);
                } else {
                    left.extend(other().cloned());
                }
            }
            all.push(((format.is_summed, cover.clean, cover.bytes), format, left));
        }
    }
    all.sort_by(|(one, a, _), (other, b, _)| {
        other.cmp(one).then_with(|| b.score.total_cmp(&a.score))
    });
    all.into_iter()
        .next()
        .map(|(_, format, left)| (format, left))
}

/// Whether all lines of one end have a carriage return before the end marker.
fn has_longer_ends(read: &Description, chunks: &[Chunk], ends: &[bool]) -> bool {
    ends.iter().any(|is_host| {
        let own = chunks.iter().filter(|chunk| chunk.is_host == *is_host);
        let bodies = own.flat_map(|chunk| {
            let frames = spans(read, chunk).into_iter();
            let frames = frames.map(|span| chunk.bytes[span].to_vec());
            frames.collect::<Vec<_>>()
        });
        let mut bodies = bodies.peekable();
        bodies.peek().is_some() && bodies.all(|line| line.ends_with(b"\r\n"))
    })
}

/// A description with this format alone. The minimum body size is raised until frames are possible.
fn alone(format: &mut Proposed, baud: u32) -> Option<Arc<Description>> {
    (0..=LEAST_MAX).find_map(|least| {
        format.least = least;
        super::parse(&super::draft(core::slice::from_ref(format), baud, 0, None)).ok()
    })
}

/// Maximum of the minimum body size.
const LEAST_MAX: usize = 6;

/// The part of chunks that frames cover.
pub(super) struct Cover {
    /// Number of bytes in frames, and of those in chunks that consist of frames only.
    pub(super) bytes: usize,
    clean: usize,
    /// Whether frames of the device and of the host were found.
    ends: [bool; 2],
    left: Vec<Chunk>,
}

impl Cover {
    pub(super) fn of<'a>(read: &Description, chunks: impl Iterator<Item = &'a Chunk>) -> Self {
        let mut cover = Self {
            bytes: 0,
            clean: 0,
            ends: [false; 2],
            left: Vec::new(),
        };
        for chunk in chunks {
            let spans = spans(read, chunk);
            let framed: usize = spans.iter().map(core::ops::Range::len).sum();
            cover.bytes += framed;
            cover.ends[usize::from(chunk.is_host)] |= framed > 0;
            let (mut from, mut is_clean) = (0, true);
            let end = chunk.bytes.len();
            for span in spans.into_iter().chain(core::iter::once(end..end)) {
                let gap = &chunk.bytes[from..span.start];
                // Line ends before a line belong to no frame.
                if !gap.iter().all(|byte| b"\r\n".contains(byte)) {
                    is_clean = false;
                    cover.left.push(Chunk {
                        bytes: gap.to_vec(),
                        ..chunk.clone()
                    });
                }
                from = span.end;
            }
            cover.clean += if is_clean { framed } else { 0 };
        }
        cover
    }
}

/// The positions of the frames in a chunk.
fn spans(read: &Description, chunk: &Chunk) -> Vec<core::ops::Range<usize>> {
    let from = if chunk.is_host {
        From::Host
    } else {
        From::Device
    };
    let mut cutter = read.cutter_of(from);
    let (mut spans, mut rest) = (Vec::new(), &chunk.bytes[..]);
    for is_over in [false, true] {
        if is_over {
            cutter.idle();
        }
        while let Some(outcome) = cutter.step(&mut rest) {
            if let Ok(frame) = outcome {
                let end = chunk.bytes.len() - rest.len() - cutter.pending();
                spans.push(end - frame.bytes.len()..end);
            }
        }
    }
    spans
}

fn ways(chunks: &[Vec<u8>]) -> Vec<Found> {
    let mut ways = Vec::new();
    let (format, frames) = framing::infer(chunks);
    ways.push(Found {
        checksum: format.checksum,
        cut: Cut::Format(format),
        frames,
    });
    if let Some(end) = common_end(chunks) {
        let format = Format {
            end,
            is_text: true,
            ..Format::unknown()
        };
        let frames = chunks.iter().flat_map(|chunk| format.split(chunk));
        let frames = frames.map(<[u8]>::to_vec).collect();
        ways.push(Found {
            checksum: None,
            cut: Cut::Format(format),
            frames,
        });
    }
    for marked in marked::markings(chunks).into_iter().take(MARKINGS) {
        let frames = marked.frames(chunks).into_iter().map(<[u8]>::to_vec);
        let frames: Vec<Vec<u8>> = frames.collect();
        let summed = marked.summed(&frames);
        ways.push(Found {
            checksum: summed.map(|summed| summed.checksum),
            cut: Cut::Marked(marked, summed),
            frames,
        });
    }
    for cutting in stream::cuttings(chunks).into_iter().take(CUTTINGS) {
        let frames = cutting.frames(chunks).into_iter().map(<[u8]>::to_vec);
        let frames: Vec<Vec<u8>> = frames.collect();
        ways.push(Found {
            checksum: checksum::infer(&frames),
            cut: Cut::Stream(cutting),
            frames,
        });
    }
    ways
}

/// A longer end marker that all chunks share, such as a line end and a prompt.
fn common_end(chunks: &[Vec<u8>]) -> Option<Vec<u8>> {
    let is_text = |byte: &u8| matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n');
    let (first, others) = chunks.split_first()?;
    if chunks.len() < LINES_SURE || !chunks.iter().flatten().all(is_text) {
        return None;
    }
    let shares = |len: &usize| {
        others
            .iter()
            .all(|other| other.ends_with(&first[first.len() - len..]))
    };
    let len = (1..first.len()).take_while(shares).last()?;
    let end = &first[first.len() - len..];
    // The marker begins at a line end; a common end without one is text of the lines.
    let at = end.iter().position(|byte| b"\r\n".contains(byte))?;
    let end = &end[at..];
    let is_prompt = end.len() > 1 && end.last().is_some_and(|byte| !b"\r\n".contains(byte));
    is_prompt.then(|| end.to_vec())
}
