//! The frame formats of a proposal: each way to cut the bytes is tried, the one with most evidence is
//! taken, and the same is done with what it leaves.

use std::collections::BTreeSet;

use description::{Description, From};
use protocols::Decode as _;

use super::super::checksum::{self, Checksum};
use super::super::format::{Coding, Format};
use super::super::stream::{self, Cutting, How};
use super::super::{framing, sums};
use super::{Chunk, Claim, Confidence};

/// A frame format as a file has it.
#[derive(Clone, Debug)]
pub(super) struct Proposed {
    /// The keys of its `[frame]`.
    pub(super) toml: String,
    pub(super) claims: Vec<Claim>,
    pub(super) is_text: bool,
    /// Bytes that each body has at least.
    pub(super) least: usize,
    /// Whether frames of the device and of the host have it.
    pub(super) ends: [bool; 2],
    /// Evidence, bits.
    score: f64,
    is_summed: bool,
}

impl Proposed {
    /// Whether a checksum proves it.
    pub(super) const fn is_summed(&self) -> bool {
        self.is_summed
    }
}

/// Formats on one line at most.
const FORMATS_MAX: usize = 4;
/// Share of the bytes in no frame below which no more formats are looked for, per cent.
const LEFT_MIN: usize = 3;
/// Share of the bytes of its ends that a format has at least, per cent.
const COVERED_MIN: usize = 10;
/// Bytes from which a format is learned.
const BYTES_MAX: usize = 24 << 10;
/// Ways to cut a stream of which the checksum is looked for.
const CUTTINGS: usize = 6;

/// Frames from which a length field or an end is claimed.
const FRAMES_SURE: usize = 12;
/// Lines of one form from which text is claimed.
const LINES_SURE: usize = 6;

/// A way to cut the bytes.
struct Found {
    cut: Cut,
    checksum: Option<Checksum>,
    frames: Vec<Vec<u8>>,
}

enum Cut {
    Format(Format),
    Stream(Cutting),
}

impl Found {
    /// Evidence, bits.
    fn score(&self) -> f64 {
        let sum = self.checksum.filter(|sum| expressed(sum).is_some());
        let sum = sum.map_or(0.0, |sum| sum.bits);
        let how = match &self.cut {
            Cut::Stream(cutting) if matches!(cutting.how, How::Length { .. }) => 12.0,
            Cut::Stream(_) => 6.0,
            Cut::Format(format) if format.is_text => 14.0,
            Cut::Format(format) if format.coding != Coding::Raw => 14.0,
            Cut::Format(format) if !format.lengths.is_empty() => 8.0,
            Cut::Format(format) if !format.end.is_empty() => 4.0,
            Cut::Format(_) => 0.0,
        };
        // More than enough for the checksum is no reason to prefer one way over another.
        sum.min(30.0) + how
    }
}

/// The formats of the frames: the one with most evidence, then that of what is left, and so on.
pub(super) fn find(chunks: &[Chunk], baud: u32) -> Vec<Proposed> {
    let (mut rest, mut formats) = (chunks.to_vec(), Vec::new());
    let all: usize = chunks.iter().map(|chunk| chunk.bytes.len()).sum();
    while formats.len() < FORMATS_MAX {
        let Some((format, left)) = best(&rest, baud) else {
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

/// Whether a checksum proves a format, bytes of chunks that are its frames alone, and of all frames.
type Rank = (bool, usize, usize);

/// The best format of `chunks`, and what is left without its frames.
fn best(chunks: &[Chunk], baud: u32) -> Option<(Proposed, Vec<Chunk>)> {
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
        for mut format in ways(&set).iter().filter_map(proposed) {
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
                // The other end may have the same format among others.
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

/// Whether all lines of one of the ends have a carriage return before what ends them.
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

/// The description with this format alone. Bodies have at least as many bytes as it takes for a
/// frame of them to be possible.
fn alone(format: &mut Proposed, baud: u32) -> Option<std::sync::Arc<Description>> {
    (0..=LEAST_MAX).find_map(|least| {
        format.least = least;
        super::parse(&super::draft(core::slice::from_ref(format), baud, 0, None)).ok()
    })
}

/// Bytes that a body may need at most.
const LEAST_MAX: usize = 6;

/// What of chunks lies in frames.
pub(super) struct Cover {
    /// Bytes in frames, and those of them in chunks that are frames alone.
    pub(super) bytes: usize,
    clean: usize,
    /// Whether the device and the host have frames.
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
                // Line ends before a line are part of no frame.
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

/// Where the frames of a chunk are.
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

/// A longer end of lines of text that all chunks share, such as an end of line and a prompt.
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
    // It begins with an end of line, or it is the end of what the lines say.
    let at = end.iter().position(|byte| b"\r\n".contains(byte))?;
    let end = &end[at..];
    let is_prompt = end.len() > 1 && end.last().is_some_and(|byte| !b"\r\n".contains(byte));
    is_prompt.then(|| end.to_vec())
}

fn proposed(found: &Found) -> Option<Proposed> {
    let mut claims = Vec::new();
    let sum = found.checksum.and_then(|sum| Some((sum, expressed(&sum)?)));
    let is_summed = sum.as_ref().is_some_and(|(sum, _)| sum.is_sure);
    let prefix = common_prefix(&found.frames);
    let (mut toml, start, framing) = match &found.cut {
        Cut::Stream(cutting) => of_stream(cutting, found, is_summed),
        Cut::Format(format) => of_format(format, found, &prefix, is_summed)?,
    };
    claims.push(framing);
    if let Some((sum, words)) = &sum {
        let (text, end) = checksum_toml(sum, words, start, &found.cut)?;
        toml += &text;
        toml += &end;
        claims.push(Claim {
            topic: "checksum",
            words: sum.to_string(),
            evidence: format!("{:.0} bits over {} frames", sum.bits, found.frames.len()),
            confidence: if sum.is_sure {
                Confidence::Sure
            } else {
                Confidence::Guess
            },
        });
    }
    let is_text = matches!(&found.cut, Cut::Format(format) if format.is_text);
    // Nothing is claimed from nothing.
    let is_any = claims
        .iter()
        .any(|claim| claim.confidence == Confidence::Sure);
    is_any.then(|| Proposed {
        toml,
        claims,
        is_text,
        least: 0,
        ends: [true; 2],
        score: found.score(),
        is_summed,
    })
}

fn bytes(bytes: &[u8]) -> String {
    let all: Vec<_> = bytes.iter().map(|byte| format!("0x{byte:02X}")).collect();
    format!("[{}]", all.join(", "))
}

fn claim(words: String, evidence: String, is_sure: bool) -> Claim {
    let confidence = if is_sure {
        Confidence::Sure
    } else {
        Confidence::Guess
    };
    Claim {
        topic: "framing",
        words,
        evidence,
        confidence,
    }
}

/// The text, how many bytes before the body are no part of the content, and the claim.
fn of_stream(cutting: &Cutting, found: &Found, is_summed: bool) -> (String, usize, Claim) {
    let (sync, count) = (bytes(&cutting.sync), found.frames.len());
    let evidence = format!("{count} frames, {} % of the bytes", cutting.share);
    let distinct: BTreeSet<&Vec<u8>> = found.frames.iter().collect();
    let sizes: BTreeSet<usize> = distinct.iter().map(|frame| frame.len()).collect();
    let distinct = distinct.len();
    let is_aligned = cutting.share >= 97 && cutting.aligned >= 97 && count >= FRAMES_SURE;
    match cutting.how {
        How::Fixed(size) => {
            let words = format!("frames of {size} bytes that begin with {sync}");
            // Frames that are all alike say nothing of their size.
            let is_sure =
                is_summed || is_aligned && distinct >= FRAMES_SURE && cutting.sync.len() > 1;
            (
                format!("sync = {sync}\nsize = {size}\n"),
                0,
                claim(words, evidence, is_sure),
            )
        }
        How::Length {
            at,
            bytes: len,
            is_big,
            unit,
            base,
        } => {
            let kind = number(len, is_big);
            let is_zero = |at: usize| found.frames.iter().all(|frame| frame.get(at) == Some(&0));
            let other = match len {
                1 if at > 0 && is_zero(at - 1) => format!(", or u16be at byte {}", at - 1),
                _ => String::new(),
            };
            let words = format!(
                "frames that begin with {sync} and have their length at byte {at} ({kind}{other})"
            );
            let unit = match unit {
                1 => String::new(),
                unit => format!(", unit = {unit}"),
            };
            let text = format!(
                "sync = {sync}\nlength = {{ at = {at}, type = \"{kind}\", counts = \"frame\", \
                 without = {base}{unit} }}\n"
            );
            // Two sizes may go with two kinds of frames by chance.
            let is_sure = is_summed || is_aligned && sizes.len() > 2;
            (text, 0, claim(words, evidence, is_sure))
        }
    }
}

fn number(len: usize, is_big: bool) -> String {
    let order = match (len, is_big) {
        (1, _) => "",
        (_, true) => "be",
        (_, false) => "le",
    };
    format!("u{}{order}", 8 * len)
}

fn of_format(
    format: &Format,
    found: &Found,
    prefix: &[u8],
    is_summed: bool,
) -> Option<(String, usize, Claim)> {
    let count = found.frames.len();
    let evidence = format!("{count} frames");
    let named = match format.coding {
        Coding::Raw => None,
        Coding::Cobs => Some("cobs"),
        Coding::Slip => Some("slip"),
        Coding::Hdlc => Some("hdlc"),
    };
    if let Some(name) = named {
        let text = format!("stuffing = \"{name}\"\n");
        let words = format!("frames coded with {}", name.to_uppercase());
        return Some((text, 0, claim(words, evidence, is_summed)));
    }
    if format.is_text {
        let is_formed = forms(&found.frames);
        let end = format.end.escape_ascii().to_string();
        let words = format!("lines of text that end with \"{end}\"");
        let has_dollar = is_summed && prefix.first() == Some(&b'$');
        let start = if has_dollar { "start = \"$\"\n" } else { "" };
        let text = format!("{start}terminator = \"{end}\"\n");
        let evidence = format!("{count} lines");
        let is_sure = is_summed || is_formed;
        return Some((
            text,
            usize::from(has_dollar),
            claim(words, evidence, is_sure),
        ));
    }
    if !format.end.is_empty() {
        let end = bytes(&format.end);
        let words = format!("frames that end with {end}");
        return Some((
            format!("end = {end}\n"),
            0,
            claim(words, evidence, is_summed),
        ));
    }
    // Pauses tell frames apart; a length field says it as well.
    if let Some(length) = format.lengths.first() {
        let behind = found.checksum.map_or(0, |sum| sum.len_behind());
        let rest = i64::try_from(length.rest).ok()? + i64::try_from(behind).ok()?;
        let kind = number(length.bytes, length.is_big);
        let sync = &prefix[..prefix.len().min(length.at)];
        let unit = match length.scale {
            1 => String::new(),
            scale => format!(", unit = {scale}"),
        };
        let at = length.at;
        let text = format!(
            "sync = {}\nlength = {{ at = {at}, type = \"{kind}\", counts = \"frame\", without = {rest}{unit} }}\n",
            bytes(sync)
        );
        let words = format!("frames with their length at byte {at} ({kind})");
        return Some((
            text,
            0,
            claim(words, evidence, is_summed || count >= FRAMES_SURE),
        ));
    }
    let size = found.frames.first()?.len();
    if found.frames.iter().all(|frame| frame.len() == size)
        && !prefix.is_empty()
        && prefix.len() < size
    {
        let sync = bytes(&prefix[..prefix.len().min(2)]);
        let words = format!("frames of {size} bytes that begin with {sync}");
        return Some((
            format!("sync = {sync}\nsize = {size}\n"),
            0,
            claim(words, evidence, is_summed),
        ));
    }
    let words = "frames that a silence ends".to_owned();
    Some((
        "silence = 3.5\n".to_owned(),
        0,
        claim(words, evidence, is_summed),
    ))
}

/// Whether lines have few forms: words and numbers at the same places.
fn forms(lines: &[Vec<u8>]) -> bool {
    let mut counts: std::collections::BTreeMap<String, usize> = std::collections::BTreeMap::new();
    for line in lines {
        *counts.entry(super::message::skeleton(line).0).or_default() += 1;
    }
    let usual: usize = counts.values().filter(|count| **count >= LINES_SURE).sum();
    let has_numbers = counts.keys().any(|form| form.contains('{'));
    usual * 10 >= lines.len() * 9 && lines.len() >= LINES_SURE && has_numbers
}

fn common_prefix(frames: &[Vec<u8>]) -> Vec<u8> {
    let Some((first, others)) = frames.split_first() else {
        return Vec::new();
    };
    let shared = |at: &usize| others.iter().all(|other| other.get(*at) == first.get(*at));
    let len = (0..first.len()).take_while(shared).count();
    first[..len].to_vec()
}

/// The name of the algorithm as descriptions have it; `None` if they cannot say it.
fn expressed(sum: &Checksum) -> Option<String> {
    let name = sum.name();
    if let Some(rest) = name.strip_prefix("CRC_") {
        let (width, rest) = rest.split_once('_')?;
        return Some(format!("CRC-{width}/{}", rest.replace('_', "-")));
    }
    sums::described(name, sum.free()).map(str::to_owned)
}

/// The checksum as a file has it, and what ends the frame behind it.
fn checksum_toml(sum: &Checksum, name: &str, start: usize, cut: &Cut) -> Option<(String, String)> {
    let place = sum.placed()?;
    if place.is_hex && place.gap == [b'*'] && name == "xor" && start == 1 && place.start == 1 {
        return Some(("checksum = \"nmea\"\n".to_owned(), String::new()));
    }
    let mut keys = vec![format!("algorithm = \"{name}\"")];
    match place.head {
        None => match place.start.checked_sub(start)? {
            0 => {}
            from => keys.push(format!("from = {from}")),
        },
        Some([at, from, to]) => {
            let at = at.checked_sub(start)?;
            keys.push(format!("at = {at}"));
            if from > 0 {
                keys.push(format!("from = {}", from.checked_sub(start)?));
            }
            if to == 0 {
                keys.push("to = 0".to_owned());
            }
        }
    }
    if place.bytes > 1 {
        let endian = if place.is_big { "big" } else { "little" };
        keys.push(format!("endian = \"{endian}\""));
    }
    if place.is_hex {
        keys.push("encoding = \"hex\"".to_owned());
    }
    if !place.gap.is_empty() {
        keys.push(format!("separator = {}", bytes(&place.gap)));
    }
    let is_marked = matches!(cut, Cut::Format(format) if !format.end.is_empty());
    let end = match (&place.tail[..], is_marked) {
        ([], _) => String::new(),
        (tail, false) => format!("end = {}\n", bytes(tail)),
        (tail, true) => {
            keys.push(format!("at = -{}", tail.len() + place.len));
            String::new()
        }
    };
    Some((format!("checksum = {{ {} }}\n", keys.join(", ")), end))
}
