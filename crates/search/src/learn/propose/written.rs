//! The text of a frame format: the keys of its `[frame]` table, and its claims.

use std::collections::BTreeSet;

use super::super::checksum::{Checksum, shown};
use super::super::format::{Coding, Format};
use super::super::marked::{Marked, Summed};
use super::super::stream::{Cutting, How};
use super::super::sums;
use super::form::skeleton;
use super::stuffed::{STUFFED_BITS, STUFFED_SURE, Stuffed};
use super::{Claim, Confidence};

/// A frame format as text.
#[derive(Clone, Debug)]
pub(super) struct Proposed {
    /// The keys of its `[frame]` table.
    pub(super) toml: String,
    pub(super) claims: Vec<Claim>,
    pub(super) is_text: bool,
    /// Minimum number of bytes of a body.
    pub(super) least: usize,
    /// Whether frames of the device and of the host have this format.
    pub(super) ends: [bool; 2],
    /// Evidence, bits.
    pub(super) score: f64,
    pub(super) is_summed: bool,
    /// Whether pauses alone separated the frames.
    pub(super) is_paused: bool,
}

impl Proposed {
    /// Marks the framing as a guess: pauses also split other bytes than frames.
    pub(super) fn doubt(&mut self, left: usize) {
        let framing = self.claims.iter_mut().filter(|one| one.topic == "framing");
        for claim in framing.filter(|one| one.confidence == Confidence::Sure) {
            claim.confidence = Confidence::Guess;
            claim.evidence += &format!(", {left} bytes are in none");
        }
    }
}

/// Minimum number of frames for a claim about a length field or an end marker.
const FRAMES_SURE: usize = 12;
/// Minimum share of the bytes for a claim about frames without a checksum, per cent.
const SHARE_SURE: usize = 97;
/// Minimum number of lines of one form for a claim about text.
pub(super) const LINES_SURE: usize = 6;

/// A way to split the bytes.
pub(super) struct Found {
    pub(super) cut: Cut,
    pub(super) checksum: Option<Checksum>,
    pub(super) frames: Vec<Vec<u8>>,
}

/// The kind of split.
pub(super) enum Cut {
    Format(Format),
    Marked(Marked, Option<Summed>),
    Stream(Cutting),
}

impl Found {
    /// Evidence, bits.
    fn score(&self) -> f64 {
        let sum = self.checksum.filter(|sum| sum.described().is_some());
        let sum = sum.map_or(0.0, |sum| sum.bits);
        let how = match &self.cut {
            // With two sizes only, a byte may follow the size by coincidence.
            Cut::Stream(cutting) if matches!(cutting.how, How::Length { .. }) => {
                if sizes(&self.frames) > 2 { 12.0 } else { -1.0 }
            }
            Cut::Stream(_) => 6.0,
            Cut::Marked(marked, _) if marked.is_hex => 16.0,
            Cut::Marked(marked, _) if marked.is_usual(&self.frames) => 13.0,
            Cut::Marked(..) => 5.0,
            Cut::Format(format) if format.is_text => 14.0,
            Cut::Format(format) if format.coding != Coding::Raw => 14.0,
            Cut::Format(format) if !format.lengths.is_empty() => 8.0,
            Cut::Format(format) if !format.end.is_empty() => 4.0,
            Cut::Format(_) => 0.0,
        };
        // Additional evidence for the checksum is no reason to prefer one split over another.
        sum.min(30.0) + how
    }
}

/// The text of the format; `None` if nothing is certain. `is_asked`: the bytes are requests, which
/// the other end answers.
pub(super) fn proposed(found: &Found, is_asked: bool) -> Option<Proposed> {
    if let Cut::Stream(cutting) = &found.cut {
        let first = found.frames.first().map(Vec::len);
        let is_varied = found.frames.iter().any(|frame| Some(frame.len()) != first);
        // A constant is no length.
        if matches!(cutting.how, How::Length { .. }) && !is_varied {
            return None;
        }
    }
    let mut claims = Vec::new();
    let sum = found.checksum.and_then(|sum| Some((sum, sum.described()?)));
    let is_summed = sum.as_ref().is_some_and(|(sum, _)| sum.is_present());
    let prefix = common_prefix(&found.frames);
    let (mut toml, start, framing) = match &found.cut {
        Cut::Stream(cutting) => of_stream(cutting, found, is_summed),
        Cut::Marked(marked, _) => of_marked(marked, found, is_summed),
        Cut::Format(format) => of_format(format, found, &prefix, is_summed)?,
    };
    claims.push(framing);
    if let Some((sum, words)) = &sum {
        let (text, end) = checksum_toml(sum, words, start, &found.cut)?;
        toml += &text;
        toml += &end;
        claims.push(Claim {
            topic: "checksum",
            // The claim names the algorithm as the draft does.
            words: sum.to_string().replacen(&shown(sum.name()), words, 1),
            evidence: format!("{:.0} bits over {} frames", sum.bits, found.frames.len()),
            confidence: if sum.is_sure {
                Confidence::Sure
            } else {
                Confidence::Guess
            },
        });
    }
    let is_text = matches!(&found.cut, Cut::Format(format) if format.is_text);
    let is_paused = match &found.cut {
        Cut::Format(format) => !is_text && format.coding == Coding::Raw && format.end.is_empty(),
        Cut::Stream(_) | Cut::Marked(..) => false,
    };
    // Without frames there is no claim. Frames that cover all bytes, and lines of few forms or with
    // a prompt behind them, are a guess at least.
    let is_any = claims
        .iter()
        .any(|claim| claim.confidence == Confidence::Sure);
    let covers = match &found.cut {
        Cut::Stream(cutting) => cutting.share >= SHARE_SURE,
        Cut::Marked(marked, _) => marked.share >= SHARE_SURE,
        Cut::Format(format) if format.coding != Coding::Raw => {
            let stuffed = Stuffed::of(format, &found.frames);
            stuffed.bits + stuffed.flags >= STUFFED_BITS
        }
        Cut::Format(format) => is_text && (is_asked || format.has_prompt() || forms(&found.frames)),
    };
    let is_any = is_any || covers;
    is_any.then(|| Proposed {
        toml,
        claims,
        is_text,
        least: 0,
        ends: [true; 2],
        score: found.score(),
        is_summed,
        is_paused,
    })
}

/// Number of different sizes.
fn sizes(frames: &[Vec<u8>]) -> usize {
    let sizes: BTreeSet<usize> = frames.iter().map(Vec::len).collect();
    sizes.len()
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

/// The text, the number of bytes before the body that are not content, and the claim.
fn of_stream(cutting: &Cutting, found: &Found, is_summed: bool) -> (String, usize, Claim) {
    let (sync, count) = (bytes(&cutting.sync), found.frames.len());
    let evidence = format!("{count} frames, {} % of the bytes", cutting.share);
    let distinct: BTreeSet<&Vec<u8>> = found.frames.iter().collect();
    let sizes: BTreeSet<usize> = distinct.iter().map(|frame| frame.len()).collect();
    let distinct = distinct.len();
    // Other formats may share the line: sync bytes of their own tell them apart.
    let is_own = cutting.is_clean && cutting.sync.len() > 1;
    let is_all = cutting.is_clean && cutting.share >= SHARE_SURE && cutting.aligned >= SHARE_SURE;
    let is_aligned = (is_all || is_own) && count >= FRAMES_SURE;
    match cutting.how {
        How::Fixed(size) => {
            let words = format!("frames of {size} bytes that begin with {sync}");
            // Identical frames give no evidence of their size.
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
            // With two sizes only, the size may correlate with the kind of frame by coincidence,
            // even with correct checksums.
            let is_sure = sizes.len() > 2 && (is_summed || is_aligned);
            (text, 0, claim(words, evidence, is_sure))
        }
    }
}

/// The text, the number of bytes before the body that are not content, and the claim.
fn of_marked(marked: &Marked, found: &Found, is_summed: bool) -> (String, usize, Claim) {
    let (start, end) = (bytes(&[marked.start]), bytes(&marked.end));
    let count = found.frames.len();
    let evidence = format!("{count} frames, {} % of the bytes", marked.share);
    let mut text = format!("start = {start}\nend = {end}\n");
    let mut words = format!("frames from {start} to {end}");
    if marked.tail > 0 {
        text += &format!("tail = {}\n", marked.tail);
        words += &format!(" and {} bytes behind it", marked.tail);
    }
    if marked.is_hex {
        text += "encoding = \"hex\"\n";
        words += ", in hexadecimal digits";
    }
    let distinct: BTreeSet<&Vec<u8>> = found.frames.iter().collect();
    let sizes: BTreeSet<usize> = distinct.iter().map(|frame| frame.len()).collect();
    let is_usual = marked.is_hex || marked.is_usual(&found.frames);
    let is_control = marked.start < 0x20 && marked.end[0] < 0x20;
    let is_varied = distinct.len() >= FRAMES_SURE && (sizes.len() > 1 || is_control);
    let is_sure = is_usual && marked.share >= SHARE_SURE && (is_varied || is_summed);
    (text, 0, claim(words, evidence, is_sure))
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
        Coding::Dle => Some("dle"),
    };
    if let Some(name) = named {
        let mut text = format!("stuffing = \"{name}\"\n");
        if format.coding == Coding::Dle && format.flag.len() == 1 {
            text += &format!("start = {}\n", bytes(&format.flag));
        }
        let words = format!("frames coded with {}", name.to_uppercase());
        let stuffed = Stuffed::of(format, &found.frames);
        let evidence = match format.coding {
            Coding::Cobs => evidence,
            _ => format!("{evidence}, {} escapes", stuffed.escapes),
        };
        let is_sure = is_summed || stuffed.bits >= STUFFED_SURE;
        return Some((text, 0, claim(words, evidence, is_sure)));
    }
    if format.is_text {
        let is_formed = forms(&found.frames);
        let end = format.end.escape_ascii().to_string();
        let words = format!("lines of text that end with \"{end}\"");
        let has_dollar = is_summed && prefix.first() == Some(&b'$');
        let start = if has_dollar { "start = \"$\"\n" } else { "" };
        let text = format!("{start}terminator = \"{end}\"\n");
        let evidence = format!("{count} lines");
        // A character of the text may end each line by coincidence.
        let is_sure = is_summed || is_formed && format.end.last().is_some_and(|end| *end < 0x20);
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
    // Pauses separate the frames; a length field confirms this.
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
    let is_fixed = found.frames.iter().all(|frame| frame.len() == size);
    if is_fixed && !prefix.is_empty() && prefix.len() < size {
        let sync = bytes(&prefix[..prefix.len().min(2)]);
        let words = format!("frames of {size} bytes that begin with {sync}");
        return Some((
            format!("sync = {sync}\nsize = {size}\n"),
            0,
            claim(words, evidence, is_summed),
        ));
    }
    if is_fixed && is_summed && count >= FRAMES_SURE && prefix.is_empty() {
        let words = format!("frames of {size} bytes");
        return Some((format!("size = {size}\n"), 0, claim(words, evidence, true)));
    }
    // Bytes that start and end each frame look like markers, as STX and ETX: a silence is then not
    // the only rule that fits.
    let behind = found.checksum.map_or(0, |sum| sum.len_behind());
    let last = [0, behind].map(|behind| common_last(&found.frames, behind));
    let marked = prefix.first().zip(last.into_iter().flatten().next());
    let words = match marked {
        None => "frames that a silence ends".to_owned(),
        Some((first, last)) => format!(
            "frames that a silence ends; each begins with {} and has {} at its end, which may be \
             markers",
            bytes(&[*first]),
            bytes(&[last])
        ),
    };
    Some((
        "silence = 3.5\n".to_owned(),
        0,
        // With two sizes only, a length may end the frames as well.
        claim(
            words,
            evidence,
            is_summed && marked.is_none() && sizes(&found.frames) > 2,
        ),
    ))
}

/// The byte that all frames have before the last `behind` bytes.
fn common_last(frames: &[Vec<u8>], behind: usize) -> Option<u8> {
    let of = |frame: &Vec<u8>| frame.len().checked_sub(behind + 1).map(|at| frame[at]);
    let last = of(frames.first()?)?;
    frames
        .iter()
        .all(|frame| of(frame) == Some(last))
        .then_some(last)
}

/// Whether the lines have few forms, with words and numbers at the same positions.
fn forms(lines: &[Vec<u8>]) -> bool {
    let mut counts: std::collections::BTreeMap<String, usize> = std::collections::BTreeMap::new();
    for line in lines {
        *counts.entry(skeleton(line).0).or_default() += 1;
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

/// The text of the checksum, and the end marker behind it.
fn checksum_toml(sum: &Checksum, name: &str, start: usize, cut: &Cut) -> Option<(String, String)> {
    let place = sum.placed()?;
    if place.is_hex && place.gap == [b'*'] && name == "xor" && start == 1 && place.start == 1 {
        return Some(("checksum = \"nmea\"\n".to_owned(), String::new()));
    }
    let mut keys = vec![sums::key(name)];
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
    if let Cut::Marked(marked, Some(summed)) = cut {
        if summed.covers_start {
            keys.push(format!("before = {}", bytes(&[marked.start])));
        }
        if summed.covers_end {
            keys.push(format!("extra = {}", bytes(&marked.end)));
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
    let is_marked = match cut {
        Cut::Format(format) => !format.end.is_empty(),
        Cut::Marked(..) => true,
        Cut::Stream(_) => false,
    };
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
