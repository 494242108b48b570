//! The messages of a proposal: similar bodies, their counters and constants, and the pairs of
//! request and reply.

use core::fmt::Write as _;
use std::collections::BTreeMap;

use description::{Description, From};
use protocols::Decode as _;

use super::form::{Number, placeholder, skeleton};
use super::written::Proposed;
use super::{Chunk, Claim, Confidence, REPLY_NANOS};

/// A message of plain bytes for each format.
pub(super) fn plain(formats: &[Proposed]) -> String {
    let (mut text, mut first) = (String::new(), [None, None]);
    for (index, format) in formats.iter().enumerate() {
        let number = if formats.len() == 1 {
            String::new()
        } else {
            format!("_{}", index + 1)
        };
        for (is_host, from) in [(true, "host"), (false, "device")] {
            if !format.ends[usize::from(is_host)] {
                continue;
            }
            let what = if is_host { "asked" } else { "told" };
            let name = format!("{what}{number}");
            let head = match format.least {
                0 => String::new(),
                least => format!("{{ name = \"head\", type = \"bytes\", size = {least} }}, "),
            };
            write!(
                text,
                "[[message]]\nname = \"{name}\"\nfrom = \"{from}\"\n{}fields = [{head}{{ name = \
                 \"data\", type = \"bytes\", size = \"rest\" }}]\n\n",
                frame_key(formats, index)
            )
            .expect(TAKES_ALL);
            first[usize::from(is_host)].get_or_insert(name);
        }
    }
    text += &match first {
        [Some(told), Some(asked)] => format!("[[on]]\nmessage = \"{asked}\"\nreply = \"{told}\"\n"),
        [None, Some(asked)] => format!("[[on]]\nmessage = \"{asked}\"\n"),
        [Some(told), None] => format!("[[every]]\nperiod = \"1s\"\nsend = \"{told}\"\n"),
        [None, None] => String::new(),
    };
    text
}

/// The key that selects the frame format of a message, if there are several formats.
fn frame_key(formats: &[Proposed], index: usize) -> String {
    match formats {
        [_] => String::new(),
        _ => format!("frame = \"f{}\"\n", index + 1),
    }
}

/// Maximum number of kinds of messages per side.
const KINDS_MAX: usize = 24;
/// Minimum number of bodies for claims about their bytes.
const BODIES_MIN: usize = 5;

/// Bodies of one kind.
struct Kind {
    name: String,
    is_host: bool,
    /// Index of the frame format.
    format: usize,
    bodies: Vec<Vec<u8>>,
}

const TAKES_ALL: &str = "a string takes everything";

/// Messages and behaviour with their claims.
pub(super) fn messages(
    of: &Description,
    chunks: &[Chunk],
    formats: &[Proposed],
) -> (String, Vec<Claim>) {
    let spoken = bodies(of, chunks);
    let mut kinds: Vec<Kind> = Vec::new();
    let mut order: Vec<(usize, [u64; 2])> = Vec::new();
    let keys: Vec<(bool, usize, Vec<u8>)> = keys(&spoken, formats);
    let mut index: BTreeMap<&(bool, usize, Vec<u8>), usize> = BTreeMap::new();
    for (key, (is_host, at, format, body)) in keys.iter().zip(&spoken) {
        let next = kinds.len();
        let kind = *index.entry(key).or_insert(next);
        if kind == next {
            let count = kinds.iter().filter(|kind| kind.is_host == *is_host).count() + 1;
            let what = if *is_host { "request" } else { "reply" };
            kinds.push(Kind {
                name: format!("{what}_{count}"),
                is_host: *is_host,
                format: *format,
                bodies: Vec::new(),
            });
        }
        kinds[kind].bodies.push(body.clone());
        order.push((kind, *at));
    }
    let per_side = |is_host: bool| kinds.iter().filter(|kind| kind.is_host == is_host).count();
    if per_side(true) > KINDS_MAX || per_side(false) > KINDS_MAX || kinds.is_empty() {
        return (plain(formats), Vec::new());
    }
    let mut text = String::new();
    for kind in &kinds {
        let from = if kind.is_host { "host" } else { "device" };
        let count = kind.bodies.len();
        write!(
            text,
            "# {count} of them\n[[message]]\nname = \"{}\"\nfrom = \"{from}\"\n{}",
            kind.name,
            frame_key(formats, kind.format)
        )
        .expect(TAKES_ALL);
        match formats
            .get(kind.format)
            .is_some_and(|format| format.is_text)
        {
            true => writeln!(text, "{}\n", line(kind)).expect(TAKES_ALL),
            false => writeln!(text, "fields = [\n{}]\n", fields(kind)).expect(TAKES_ALL),
        }
    }
    let (behaviour, claims) = behaviour(&kinds, &order);
    let (requests, replies) = (per_side(true), per_side(false));
    let mut all = vec![Claim {
        topic: "messages",
        words: format!("{requests} kinds of the driver, {replies} of the device"),
        evidence: format!("{} frames", spoken.len()),
        confidence: Confidence::Guess,
    }];
    all.extend(claims);
    (text + &behaviour, all)
}

/// A body with its sender, the start and the end of its chunk, and its format.
type Body = (bool, [u64; 2], usize, Vec<u8>);

/// The bodies of all frames in order of time.
fn bodies(of: &Description, chunks: &[Chunk]) -> Vec<Body> {
    let mut cutters = [From::Device, From::Host].map(|from| of.cutter_of(from));
    let mut all = Vec::new();
    for chunk in chunks {
        let cutter = &mut cutters[usize::from(chunk.is_host)];
        let mut frames: Vec<_> = cutter.push(&chunk.bytes).flatten().collect();
        cutter.idle();
        frames.extend(cutter.push(&[]).flatten());
        for frame in frames {
            if let Some(body) = of.body(&frame) {
                let times = [chunk.begins, chunk.ends];
                all.push((chunk.is_host, times, frame.format, body));
            }
        }
    }
    all
}

/// The key of each body's kind: the form of a text, else the first byte and the length.
fn keys(spoken: &[Body], formats: &[Proposed]) -> Vec<(bool, usize, Vec<u8>)> {
    let mut firsts: BTreeMap<(bool, usize), BTreeMap<u8, usize>> = BTreeMap::new();
    for (is_host, _, format, body) in spoken {
        let first = body.first().copied().unwrap_or(0);
        *firsts
            .entry((*is_host, *format))
            .or_default()
            .entry(first)
            .or_default() += 1;
    }
    let keys = spoken.iter().map(|(is_host, _, format, body)| {
        if formats.get(*format).is_some_and(|format| format.is_text) {
            return (*is_host, *format, skeleton(body).0.into_bytes());
        }
        let is_kind = firsts.get(&(*is_host, *format)).is_some_and(|counts| {
            let all: usize = counts.values().sum();
            counts.len() <= 12 && counts.len() * 2 <= all.max(2)
        });
        let first = body.first().copied().filter(|_| is_kind);
        let len = u16::try_from(body.len()).unwrap_or(u16::MAX).to_be_bytes();
        (*is_host, *format, first.into_iter().chain(len).collect())
    });
    keys.collect()
}

/// The keys of a message for lines of one form. A device sends the numbers of its first line.
fn line(kind: &Kind) -> String {
    let lines = &kind.bodies;
    let form = skeleton(lines.first().map_or(&[][..], Vec::as_slice)).0;
    let all: Vec<_> = lines.iter().map(|line| skeleton(line).1).collect();
    let (mut text, mut values) = (String::new(), Vec::new());
    let mut index = 0;
    let mut rest = form.as_str();
    while let Some(at) = rest.find("{}") {
        // A doubled brace is not a number.
        let is_brace = rest[..at].ends_with('{');
        text += &rest[..at];
        rest = &rest[at + 2..];
        if is_brace {
            text += "{}";
            continue;
        }
        let seen = all.iter().filter_map(|numbers| numbers.get(index).cloned());
        let seen: Vec<_> = seen.collect();
        text += &placeholder(index, &seen);
        let value = seen.first().map(Number::value);
        values.extend(
            value.map(|value| format!("  {{ name = \"n{index}\", calc = \"{value}\" }},\n")),
        );
        index += 1;
    }
    let text = format!("text = {}", toml::Value::String(text + rest));
    match kind.is_host || values.is_empty() {
        true => text,
        false => format!("{text}\nfields = [\n{}]", values.concat()),
    }
}

/// Fields of bodies of equal length: constants, counters, and plain bytes. A device sends its
/// constants, whatever the request holds.
fn fields(kind: &Kind) -> String {
    let (mut out, bodies) = (String::new(), &kind.bodies);
    let len = bodies.first().map_or(0, Vec::len);
    let column = |at: usize| {
        bodies
            .iter()
            .map(move |body| body.get(at).copied().unwrap_or(0))
    };
    let is_constant = |at: usize| column(at).all(|byte| Some(byte) == bodies[0].get(at).copied());
    let is_enough = bodies.len() >= BODIES_MIN;
    let mut at = 0;
    while at < len {
        if at == 0 && (is_constant(0) || bodies.len() == 1) {
            let value = bodies[0][0];
            writeln!(out, "  {{ type = \"u8\", value = 0x{value:02X} }},").expect(TAKES_ALL);
            at += 1;
            continue;
        }
        if let Some((kind, size)) = counter(bodies, at).filter(|_| is_enough) {
            writeln!(
                out,
                "  {{ name = \"counter_{at}\", type = \"{kind}\", about = \"counts up\" }},"
            )
            .expect(TAKES_ALL);
            at += size;
            continue;
        }
        if let Some(seen) = few(column(at)) {
            let seen: Vec<_> = seen.iter().map(|byte| format!("{byte:02X}")).collect();
            writeln!(
                out,
                "  {{ name = \"choice_{at}\", type = \"u8\", about = \"seen: {}\" }},",
                seen.join(" ")
            )
            .expect(TAKES_ALL);
            at += 1;
            continue;
        }
        let is_alike = |other: usize| {
            is_constant(other) == is_constant(at)
                && counter(bodies, other).is_none()
                && few(column(other)).is_none()
        };
        let mut end = at + 1;
        while end < len && is_alike(end) {
            end += 1;
        }
        let about = match is_constant(at) && is_enough {
            true => {
                let bytes = bodies[0][at..end].iter().map(|byte| format!("{byte:02X}"));
                let bytes: Vec<_> = bytes.collect();
                let sent = match kind.is_host {
                    true => String::new(),
                    false => format!(", calc = \"bytes(0x{})\"", bytes.join(", 0x")),
                };
                format!("{sent}, about = \"always {}\"", bytes.join(" "))
            }
            false => String::new(),
        };
        let size = end - at;
        writeln!(
            out,
            "  {{ name = \"bytes_{at}\", type = \"bytes\", size = {size}{about} }},"
        )
        .expect(TAKES_ALL);
        at = end;
    }
    if len == 0 {
        out += "  { name = \"data\", type = \"bytes\", size = \"rest\" },\n";
    }
    out
}

/// Maximum number of values of a byte that is a choice.
const CHOICES_MAX: usize = 4;
/// Minimum number of bodies for each value of a choice.
const BODIES_PER_CHOICE: usize = 8;

/// The values of a byte that takes few different ones, each of them repeatedly.
fn few(column: impl Iterator<Item = u8>) -> Option<Vec<u8>> {
    let mut counts: BTreeMap<u8, usize> = BTreeMap::new();
    column.for_each(|byte| *counts.entry(byte).or_default() += 1);
    let all: usize = counts.values().sum();
    let is_choice = (2..=CHOICES_MAX).contains(&counts.len())
        && all >= BODIES_PER_CHOICE * counts.len()
        && counts.values().all(|count| *count > 1);
    is_choice.then(|| counts.into_keys().collect())
}

/// The type of a counter at `at`, if the numbers there rise by one from body to body.
fn counter(bodies: &[Vec<u8>], at: usize) -> Option<(&'static str, usize)> {
    let kinds: [(&str, usize); 3] = [("u16le", 2), ("u16be", 2), ("u8", 1)];
    kinds.into_iter().find(|(kind, size)| {
        let read = |body: &Vec<u8>| -> Option<u32> {
            let bytes = body.get(at..at + size)?;
            Some(match *kind {
                "u16le" => u32::from(bytes[1]) << 8 | u32::from(bytes[0]),
                "u16be" => u32::from(bytes[0]) << 8 | u32::from(bytes[1]),
                _ => u32::from(bytes[0]),
            })
        };
        let values: Vec<u32> = bodies.iter().filter_map(read).collect();
        let modulus = 1_u32 << (8 * size);
        let rises = values
            .windows(2)
            .filter(|pair| (pair[0] + 1) % modulus == pair[1])
            .count();
        // A 16-bit counter must carry; otherwise its low byte is the counter.
        let carries = *size == 1 || values.iter().any(|value| value >> 8 != values[0] >> 8);
        values.len() >= BODIES_MIN && rises * 10 >= (values.len() - 1) * 9 && carries
    })
}

/// Replies to requests, and periods of unsolicited messages.
/// A latency is the time from the end of the request to the start of the reply.
fn behaviour(kinds: &[Kind], order: &[(usize, [u64; 2])]) -> (String, Vec<Claim>) {
    let (mut text, mut claims) = (String::new(), Vec::new());
    let mut pairs: BTreeMap<usize, Vec<(usize, u64)>> = BTreeMap::new();
    for pair in order.windows(2) {
        let [(first, [_, asked]), (second, [answered, _])] = pair else {
            continue;
        };
        let time = answered.saturating_sub(*asked);
        if kinds[*first].is_host && !kinds[*second].is_host && time < REPLY_NANOS {
            pairs.entry(*first).or_default().push((*second, time));
        }
    }
    for (request, replies) in &pairs {
        let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
        for (reply, _) in replies {
            *counts.entry(*reply).or_default() += 1;
        }
        let Some((reply, count)) = counts.into_iter().max_by_key(|(_, count)| *count) else {
            continue;
        };
        let mut times: Vec<u64> = replies.iter().map(|(_, time)| *time).collect();
        times.sort_unstable();
        let latency_us = times[times.len() / 2] / 1_000;
        let (asked, answer) = (&kinds[*request].name, &kinds[reply].name);
        write!(
            text,
            "[[on]]\nmessage = \"{asked}\"\nreply = \"{answer}\"\nlatency = \"{latency_us}us\"\n\n"
        )
        .expect(TAKES_ALL);
        claims.push(Claim {
            topic: "replies",
            words: format!(
                "{asked} is answered by {answer} after {:.1} ms (median)",
                latency_us as f64 / 1e3
            ),
            evidence: format!("{count} of {} times", replies.len()),
            confidence: Confidence::Guess,
        });
    }
    if pairs.is_empty() {
        for (index, kind) in kinds.iter().enumerate().filter(|(_, kind)| !kind.is_host) {
            let at: Vec<u64> = order
                .iter()
                .filter(|(of, _)| *of == index)
                .map(|(_, [begin, _])| *begin)
                .collect();
            let mut gaps: Vec<u64> = at
                .windows(2)
                .map(|pair| pair[1].saturating_sub(pair[0]))
                .collect();
            gaps.sort_unstable();
            let period = gaps
                .get(gaps.len() / 2)
                .copied()
                .unwrap_or(1_000_000_000)
                .max(1_000_000)
                / 1_000;
            write!(
                text,
                "[[every]]\nperiod = \"{period}us\"\nsend = \"{}\"\n\n",
                kind.name
            )
            .expect(TAKES_ALL);
        }
    }
    if text.is_empty() {
        text += "[[on]]\nevent = \"start\"\n";
    }
    (text, claims)
}
