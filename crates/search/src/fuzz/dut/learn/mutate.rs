//! Mutants of known frames: fields at their limits, wrong lengths with correct checksums,
//! truncation, damage, and intact frames in another order or other chunks.

use emulators::rng::Rng;

use crate::learn::{FieldLimits, FrameFormat};

/// Data sent at once, and the mutation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Mutant {
    /// The name of the mutation.
    pub(super) kind: &'static str,
    /// Bytes, in chunks with short pauses between them.
    pub(super) pieces: Vec<Vec<u8>>,
    /// Whether a program may reject the data, because an intact device never sends them.
    pub(super) is_altered: bool,
}

/// Maximum length of a content.
const CONTENT_MAX: usize = 2048;
/// Maximum length of a content created from nothing.
const FRESH_MAX: u64 = 41;
/// Separators of the fields of a line.
const SEPARATORS: &[u8] = b",;:=|/ \t";
/// Maximum number of chunks of a mutant.
const PIECES_MAX: usize = 64;

/// A changed content.
type Change = fn(&mut Vec<u8>, &Material<'_>, &mut Rng);

/// The material of mutants.
pub(super) struct Material<'a> {
    pub(super) format: &'a dyn FrameFormat,
    /// Contents of known frames.
    pub(super) contents: &'a [Vec<u8>],
}

/// Changes of a content; the checksum is corrected afterwards.
const CHANGES: [(&str, Change); 12] = [
    ("limit-of-byte", |content, _, rng| limit(content, 1, rng)),
    ("limit-of-16-bits", |content, _, rng| limit(content, 2, rng)),
    ("limit-of-32-bits", |content, _, rng| limit(content, 4, rng)),
    ("limit-of-64-bits", |content, _, rng| limit(content, 8, rng)),
    ("wrong-length", wrong_length),
    ("short", |content, material, rng| {
        content.truncate(index(rng, content.len()));
        if rng.below(2) == 0 {
            material.format.repair_lengths(content);
        }
    }),
    ("long", |content, material, rng| {
        let more = 1_u64 << rng.below(9);
        content.extend((0..more).map(|_| byte(rng)));
        if rng.below(2) == 0 {
            material.format.repair_lengths(content);
        }
    }),
    ("repeated-part", |content, _, rng| {
        let from = index(rng, content.len() + 1);
        let to = from + index(rng, content.len() - from + 1);
        let part = content[from..to].to_vec();
        content.splice(from..from, part);
    }),
    ("left-out-part", |content, _, rng| {
        let from = index(rng, content.len() + 1);
        let to = from + index(rng, (content.len() - from + 1).min(9));
        content.drain(from..to);
    }),
    ("other-bytes", |content, _, rng| {
        for _ in 0..1_u64 << rng.below(4) {
            let at = index(rng, content.len());
            if let Some(changed) = content.get_mut(at) {
                *changed = byte(rng);
            }
        }
    }),
    ("spliced", |content, material, rng| {
        let other = &material.contents[index(rng, material.contents.len())];
        content.truncate(index(rng, content.len() + 1));
        let from = content.len().min(other.len());
        content.extend(&other[from..]);
    }),
    ("random", |content, _, rng| {
        let len = rng.below(FRESH_MAX);
        *content = (0..len).map(|_| byte(rng)).collect();
    }),
];

/// Changes of a text content.
const TEXT_CHANGES: [(&str, Change); 9] = [
    ("empty-field", |content, _, rng| field(content, b"", rng)),
    ("number-at-limit", |content, _, rng| {
        const NUMBERS: [&str; 14] = [
            "0",
            "-1",
            "255",
            "256",
            "32768",
            "65536",
            "2147483648",
            "-2147483649",
            "4294967296",
            "18446744073709551616",
            "1e999",
            "nan",
            "-inf",
            "0x7fffffff",
        ];
        let number = NUMBERS[index(rng, NUMBERS.len())];
        field(content, number.as_bytes(), rng);
    }),
    ("digits", |content, _, rng| {
        let len = 1 + rng.below(12);
        let digits: Vec<u8> = (0..len).map(|_| b"0123456789.-"[index(rng, 12)]).collect();
        field(content, &digits, rng);
    }),
    ("long-field", |content, _, rng| {
        let long = vec![b"A9 %"[index(rng, 4)]; 1 << (4 + rng.below(6))];
        field(content, &long, rng);
    }),
    ("no-number", |content, _, rng| {
        const WORDS: [&[u8]; 6] = [b"x", b"%s%n", b"--", b"N/A", b"\xFF\xFE", b"\"'\\"];
        field(content, WORDS[index(rng, WORDS.len())], rng);
    }),
    ("fields-left-out", |content, _, rng| {
        let fields = fields(content);
        let at = index(rng, fields.len());
        content.truncate(fields[at].start.saturating_sub(1));
    }),
    ("field-left-out", |content, _, rng| {
        let fields = fields(content);
        let field = fields[index(rng, fields.len())].clone();
        content.drain(field.start..(field.end + 1).min(content.len()));
    }),
    ("more-fields", |content, _, rng| {
        let fields = fields(content);
        let last = fields[index(rng, fields.len())].clone();
        let one = [b",", &content[last]].concat();
        for _ in 0..1_u64 << rng.below(7) {
            content.extend(&one);
        }
    }),
    ("other-characters", |content, _, rng| {
        for _ in 0..1_u64 << rng.below(3) {
            let at = index(rng, content.len());
            if let Some(changed) = content.get_mut(at) {
                *changed = b' ' + u8::try_from(rng.below(95)).unwrap_or(0);
            }
        }
    }),
];

/// A kind of damage and its function.
type Damage = (&'static str, fn(&mut Vec<u8>, &mut Rng));

/// Damage to a frame: afterwards its checksum is wrong, or it is not a frame.
const DAMAGE: [Damage; 7] = [
    ("flipped-bit", |frame, rng| {
        let at = index(rng, frame.len());
        if let Some(changed) = frame.get_mut(at) {
            *changed ^= 1 << rng.below(8);
        }
    }),
    ("cut", |frame, rng| frame.truncate(index(rng, frame.len()))),
    ("lost-byte", |frame, rng| {
        if !frame.is_empty() {
            frame.remove(index(rng, frame.len()));
        }
    }),
    ("extra-byte", |frame, rng| {
        frame.insert(index(rng, frame.len() + 1), byte(rng));
    }),
    ("garbage-before", |frame, rng| {
        let len = 1 + rng.below(24);
        let garbage: Vec<u8> = (0..len).map(|_| byte(rng)).collect();
        frame.splice(0..0, garbage);
    }),
    ("half-before", |frame, rng| {
        let half = frame[..index(rng, frame.len() + 1)].to_vec();
        frame.splice(0..0, half);
    }),
    ("noise", |frame, rng| {
        let len = 1 + rng.below(64);
        *frame = (0..len).map(|_| byte(rng)).collect();
    }),
];

/// A mutant of `chunk`, which is empty if the device never sent anything.
pub(super) fn mutant(material: &Material<'_>, chunk: &[u8], rng: &mut Rng) -> Mutant {
    let format = material.format;
    let mut frames: Vec<Vec<u8>> = format
        .split(chunk)
        .into_iter()
        .map(<[u8]>::to_vec)
        .collect();
    if frames.is_empty() {
        frames.push(Vec::new());
    }
    let at = index(rng, frames.len());
    let turn = rng.below(20);
    let altered = |kind, frames: &[Vec<u8>]| Mutant {
        kind,
        pieces: vec![frames.concat()],
        is_altered: true,
    };
    match turn {
        0..14 => {
            // Parsers trust a wrong length behind a correct checksum.
            let lying = match turn {
                0..4 => lying_length(material, &frames[at], rng),
                _ => None,
            };
            let kind = match lying {
                Some(frame) => {
                    frames[at] = frame;
                    "wrong-length"
                }
                None => change(material, &mut frames[at], rng),
            };
            altered(kind, &frames)
        }
        14 => {
            let content = format.content(&frames[at]);
            let off = 1 + rng.below(255);
            frames[at] = match content {
                Some(content) => format.frame(&content, off),
                None => Vec::new(),
            };
            altered("wrong-checksum", &frames)
        }
        15..17 => {
            let (kind, damage) = DAMAGE[index(rng, DAMAGE.len())];
            damage(&mut frames[at], rng);
            altered(kind, &frames)
        }
        17 => {
            let same = frames[at].clone();
            frames.insert(at, same);
            altered("twice", &frames)
        }
        18 => {
            let kind = match rng.below(3) {
                0 => {
                    frames.clear();
                    "nothing"
                }
                1 if frames.len() > 1 => {
                    frames.rotate_left(1);
                    "other-order"
                }
                _ => {
                    let other = &material.contents[index(rng, material.contents.len())];
                    frames[at] = format.frame(other, 0);
                    "other-frame"
                }
            };
            altered(kind, &frames)
        }
        _ => {
            let whole = frames.concat();
            let (kind, pieces) = match rng.below(2) {
                0 if whole.len() <= PIECES_MAX => {
                    ("bytewise", whole.chunks(1).map(<[u8]>::to_vec).collect())
                }
                _ => {
                    let (head, tail) = whole.split_at(index(rng, whole.len() + 1));
                    ("in-two", vec![head.to_vec(), tail.to_vec()])
                }
            };
            Mutant {
                kind,
                pieces,
                is_altered: chunk.is_empty(),
            }
        }
    }
}

/// Changes the content of `frame`.
fn change(material: &Material<'_>, frame: &mut Vec<u8>, rng: &mut Rng) -> &'static str {
    let format = material.format;
    let content = format.content(frame).or_else(|| {
        let other = material.contents.get(index(rng, material.contents.len()));
        other.cloned()
    });
    let mut content = content.unwrap_or_default();
    let is_text = format.is_text() && rng.below(4) > 0;
    let changes = if is_text {
        &TEXT_CHANGES[..]
    } else {
        &CHANGES[..]
    };
    // With one frame or none, random bytes are as good as mutations.
    let is_poor = material.contents.len() < 2 && !format.is_text();
    let (kind, change) = match is_poor && rng.below(2) == 0 {
        true => CHANGES[CHANGES.len() - 1],
        false => changes[index(rng, changes.len())],
    };
    let known = format.fields(&content);
    // In a described format, a field at its limits is more effective than random bytes.
    if !known.is_empty() && rng.below(2) == 0 {
        put_limit(&mut content, &known, rng);
        *frame = format.frame(&content, 0);
        return "field-at-limit";
    }
    change(&mut content, material, rng);
    if rng.below(8) == 0 {
        let (_, other) = changes[index(rng, changes.len())];
        other(&mut content, material, rng);
    }
    content.truncate(CONTENT_MAX);
    *frame = format.frame(&content, 0);
    kind
}

/// Writes a value that often causes failures into `content`.
fn limit(content: &mut [u8], bytes: usize, rng: &mut Rng) {
    let Some(last) = content.len().checked_sub(bytes) else {
        return;
    };
    let at = index(rng, last + 1);
    let (top, all) = (1_u64 << (8 * bytes - 1), u64::MAX >> (64 - 8 * bytes));
    let floating = match bytes {
        4 => [f32::NAN, f32::INFINITY, -0.0, f32::MAX].map(|value| value.to_bits().into()),
        8 => [f64::NAN, f64::INFINITY, -0.0, f64::MAX].map(f64::to_bits),
        _ => [0, 1, top, all],
    };
    let whole = [
        0,
        1,
        top - 1,
        top,
        top + 1,
        all - 1,
        all,
        content.len() as u64,
    ];
    let value = match rng.below(3) {
        0 => floating[index(rng, floating.len())],
        _ => whole[index(rng, whole.len())],
    };
    let mut field = value.to_le_bytes()[..bytes].to_vec();
    if rng.below(2) == 0 {
        field.reverse();
    }
    content[at..at + bytes].copy_from_slice(&field);
}

/// `frame` with one of its lengths wrong and all other bytes unchanged; `None` if no length is
/// known.
fn lying_length(material: &Material<'_>, frame: &[u8], rng: &mut Rng) -> Option<Vec<u8>> {
    let mut content = material.format.content(frame)?;
    if material.format.limits(&content).is_empty() {
        return None;
    }
    wrong_length(&mut content, material, rng);
    Some(material.format.frame(&content, 0))
}

/// Changes a length field to a wrong value.
fn wrong_length(content: &mut Vec<u8>, material: &Material<'_>, rng: &mut Rng) {
    let fields = material.format.limits(content);
    if fields.is_empty() {
        limit(content, 1, rng);
        return;
    }
    put_limit(content, &fields, rng);
}

/// Writes one of the test values into a field.
fn put_limit(content: &mut Vec<u8>, fields: &[FieldLimits], rng: &mut Rng) {
    let field = &fields[index(rng, fields.len())];
    if let Some(value) = field.values.get(index(rng, field.values.len())) {
        content.splice(field.range.clone(), value.iter().copied());
    }
}

/// The fields of a line; at least one.
fn fields(content: &[u8]) -> Vec<core::ops::Range<usize>> {
    let (mut fields, mut from) = (Vec::new(), 0);
    for (at, byte) in content.iter().enumerate() {
        if SEPARATORS.contains(byte) {
            fields.push(from..at);
            from = at + 1;
        }
    }
    fields.push(from..content.len());
    fields
}

/// Replaces a field of a line with `new`; rarely the first field, which selects the message.
fn field(content: &mut Vec<u8>, new: &[u8], rng: &mut Rng) {
    let fields = fields(content);
    let at = match index(rng, fields.len()) {
        0 if rng.below(4) > 0 => index(rng, fields.len()),
        at => at,
    };
    let field = fields[at].clone();
    content.splice(field, new.iter().copied());
}

fn byte(rng: &mut Rng) -> u8 {
    rng.next_u64().to_be_bytes()[0]
}

/// A random number below `len`; 0 if `len` is 0.
fn index(rng: &mut Rng, len: usize) -> usize {
    usize::try_from(rng.below(len.max(1) as u64)).expect("below a length")
}
