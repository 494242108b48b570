//! The frame format of a proposal: each way to cut the bytes is tried, and the one with most
//! evidence is taken.

use super::super::checksum::{self, Checksum};
use super::super::format::{Coding, Format};
use super::super::stream::{self, Cutting, How};
use super::super::{framing, sums};
use super::{Chunk, Claim, Confidence};

/// A frame format as a file has it.
#[derive(Clone, Debug)]
pub(super) struct Proposed {
    pub(super) toml: String,
    pub(super) claims: Vec<Claim>,
    pub(super) is_text: bool,
}

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

/// The format of the device's frames, or of the driver's if the device never speaks.
pub(super) fn find(chunks: &[Chunk]) -> Option<Proposed> {
    let side = |is_host: bool| -> Vec<Vec<u8>> {
        let own = chunks.iter().filter(|chunk| chunk.is_host == is_host);
        own.map(|chunk| chunk.bytes.clone()).collect()
    };
    let [device, host] = [false, true].map(side);
    let both: Vec<Vec<u8>> = device.iter().chain(&host).cloned().collect();
    // Both directions mostly have one format; where they do not, the device's counts.
    let sets = [both, device, host];
    let mut found: Vec<Found> = Vec::new();
    for set in sets.iter().filter(|set| !set.is_empty()) {
        found.extend(ways(set));
        let is_certain = |one: &Found| {
            let sum = one.checksum.filter(|sum| expressed(sum).is_some());
            sum.is_some_and(|sum| sum.is_sure)
        };
        if found.iter().any(is_certain) {
            break;
        }
    }
    found.sort_by(|one, other| other.score().total_cmp(&one.score()));
    found.iter().find_map(proposed)
}

fn ways(chunks: &[Vec<u8>]) -> Vec<Found> {
    let (format, frames) = framing::infer(chunks);
    let mut ways = vec![Found {
        checksum: format.checksum,
        cut: Cut::Format(format),
        frames,
    }];
    let whole = chunks.concat();
    for cutting in stream::cuttings(&whole).into_iter().take(2) {
        let frames = cutting.frames(&whole).into_iter().map(<[u8]>::to_vec);
        let frames: Vec<Vec<u8>> = frames.collect();
        ways.push(Found {
            checksum: checksum::infer(&frames),
            cut: Cut::Stream(cutting),
            frames,
        });
    }
    ways
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
    is_any.then_some(Proposed {
        toml: format!("[frame]\n{toml}"),
        claims,
        is_text,
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
    match cutting.how {
        How::Fixed(size) => {
            let words = format!("frames of {size} bytes that begin with {sync}");
            let is_sure =
                is_summed || cutting.share >= 97 && count >= FRAMES_SURE && cutting.sync.len() > 1;
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
            base,
        } => {
            let kind = number(len, is_big);
            let words = format!(
                "frames that begin with {sync} and have their length at byte {at} ({kind})"
            );
            let text = format!(
                "sync = {sync}\nlength = {{ at = {at}, type = \"{kind}\", counts = \"frame\", \
                 without = {base} }}\n"
            );
            let is_sure = is_summed || cutting.share >= 97 && count >= FRAMES_SURE;
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
    let found = sums::DESCRIBED
        .iter()
        .find(|(known, free, _)| *known == name && *free == sum.free());
    found.map(|(_, _, described)| (*described).to_owned())
}

/// The checksum as a file has it, and what ends the frame behind it.
fn checksum_toml(sum: &Checksum, name: &str, start: usize, cut: &Cut) -> Option<(String, String)> {
    let place = sum.placed()?;
    if place.is_hex && place.gap == [b'*'] && name == "xor" && start == 1 && place.start == 1 {
        return Some(("checksum = \"nmea\"\n".to_owned(), String::new()));
    }
    let mut keys = vec![format!("algorithm = \"{name}\"")];
    match place.start.checked_sub(start)? {
        0 => {}
        from => keys.push(format!("from = {from}")),
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
