//! Mutants of known frames: changed fields, numbers, counts and lengths with correct checksums,
//! truncation, damage, and intact frames in another order or other chunks.

mod binary;
mod text;

use emulators::rng::Rng;

use crate::fuzz::dut::constants::Constants;
use crate::learn::FrameFormat;
use binary::{CHANGES, lying_count, lying_length, put_limit};
use text::TEXT_CHANGES;

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
/// Maximum number of chunks of a mutant.
const PIECES_MAX: usize = 64;

/// A changed content.
type Change = fn(&mut Vec<u8>, &Material<'_>, &mut Rng);

/// The material of mutants.
pub(super) struct Material<'a> {
    pub(super) format: &'a dyn FrameFormat,
    /// Contents of known frames.
    pub(super) contents: &'a [Vec<u8>],
    /// Numbers and words of the program.
    pub(super) constants: &'a Constants,
}

/// Numbers of changes of one content; a number that is listed more often is drawn more often. Many
/// defects need two or three unusual fields at once.
const STACKED: [usize; 8] = [1, 1, 1, 1, 2, 2, 3, 5];

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
                0..3 => lying_length(material, &frames[at], rng).map(|it| ("wrong-length", it)),
                3..6 => lying_count(material, &frames[at], rng).map(|it| ("wrong-count", it)),
                _ => None,
            };
            let kind = match lying {
                Some((kind, frame)) => {
                    frames[at] = frame;
                    kind
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

/// `chunk` with change `number` of the texts in its first frame with any; `None` if no frame has a
/// text.
pub(super) fn text_at_limit(material: &Material<'_>, chunk: &[u8], number: u32) -> Option<Mutant> {
    let format = material.format;
    let frames = format.split(chunk);
    let (at, texts) = frames.iter().enumerate().find_map(|(at, frame)| {
        let texts = format.texts(&format.content(frame)?);
        (!texts.is_empty()).then_some((at, texts))
    })?;
    let (kind, content) = &texts[usize::try_from(number).ok()? % texts.len()];
    let changed = format.frame(content, 0);
    let pieces = frames.iter().enumerate();
    let pieces = pieces.map(|(place, frame)| if place == at { &changed[..] } else { *frame });
    Some(Mutant {
        kind,
        pieces: vec![pieces.collect::<Vec<_>>().concat()],
        is_altered: true,
    })
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
    for _ in 1..STACKED[index(rng, STACKED.len())] {
        let (_, other) = changes[index(rng, changes.len())];
        content.truncate(CONTENT_MAX);
        other(&mut content, material, rng);
    }
    content.truncate(CONTENT_MAX);
    *frame = format.frame(&content, 0);
    kind
}

fn byte(rng: &mut Rng) -> u8 {
    rng.next_u64().to_be_bytes()[0]
}

/// A random number below `len`; 0 if `len` is 0.
fn index(rng: &mut Rng, len: usize) -> usize {
    usize::try_from(rng.below(len.max(1) as u64)).expect("below a length")
}
