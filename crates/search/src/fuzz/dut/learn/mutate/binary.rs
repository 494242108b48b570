//! Changes of any content: numbers, counts, parts.

use emulators::rng::Rng;

use super::{Change, Material, byte, index};
use crate::learn::FieldLimits;

/// Maximum length of a content created from nothing.
const FRESH_MAX: u64 = 41;
/// Largest difference of a number near the old one.
const NEAR_MAX: u64 = 35;
/// Largest number of bytes behind a count that it does not count.
const UNCOUNTED_MAX: usize = 2;
/// Sizes of the counted parts, bytes.
const SIZES: [usize; 4] = [1, 2, 4, 8];

/// Changes of a content; the checksum is corrected afterwards.
pub(super) const CHANGES: [(&str, Change); 20] = [
    ("limit-of-byte", |content, _, rng| limit(content, 1, rng)),
    // Twice: most fields of serial protocols have 16 bits.
    ("limit-of-16-bits", |content, _, rng| limit(content, 2, rng)),
    ("limit-of-16-bits", |content, _, rng| limit(content, 2, rng)),
    ("limit-of-32-bits", |content, _, rng| limit(content, 4, rng)),
    ("limit-of-64-bits", |content, _, rng| limit(content, 8, rng)),
    ("wrong-length", wrong_length),
    ("number-near", |content, _, rng| near(content, rng)),
    ("constant", |content, material, rng| {
        constant(content, material, rng);
    }),
    ("word", |content, material, rng| {
        if let Some(word) = material.constants.word(rng) {
            let from = index(rng, content.len() + 1);
            let to = match rng.below(2) {
                0 => from,
                _ => (from + word.len()).min(content.len()),
            };
            content.splice(from..to, word.iter().copied());
        }
    }),
    ("count", |content, _, rng| {
        let counts = counts(content);
        match counts.get(index(rng, counts.len())) {
            Some(count) => count.change(content, rng),
            None => limit(content, 1, rng),
        }
    }),
    ("part-of-another-frame", |content, material, rng| {
        let other = &material.contents[index(rng, material.contents.len())];
        let from = index(rng, content.len());
        let len = 1 + index(rng, 8);
        let part = other.get(from..).unwrap_or_default();
        let part = &part[..len.min(part.len())];
        let to = (from + part.len()).min(content.len());
        content.splice(from..to, part.iter().copied());
    }),
    ("same-bytes", |content, _, rng| {
        let from = index(rng, content.len() + 1);
        let to = from + index(rng, content.len() - from + 1);
        let same = [0, 0xFF, 0x80, byte(rng)][index(rng, 4)];
        content[from..to].fill(same);
    }),
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
    ("grown", |content, material, rng| {
        let at = index(rng, content.len() + 1);
        let more = vec![byte(rng); 1 << rng.below(8)];
        content.splice(at..at, more);
        material.format.repair_lengths(content);
    }),
    ("repeated-part", |content, material, rng| {
        let from = index(rng, content.len() + 1);
        let to = from + index(rng, content.len() - from + 1);
        let part = content[from..to].repeat(1 << rng.below(4));
        content.splice(from..from, part);
        if rng.below(2) == 0 {
            material.format.repair_lengths(content);
        }
    }),
    ("left-out-part", |content, material, rng| {
        let from = index(rng, content.len() + 1);
        let to = from + index(rng, (content.len() - from + 1).min(9));
        content.drain(from..to);
        if rng.below(2) == 0 {
            material.format.repair_lengths(content);
        }
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

/// Writes a value that often causes failures into `content`.
fn limit(content: &mut [u8], bytes: usize, rng: &mut Rng) {
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
    write(content, bytes, value, rng);
}

/// Writes the lowest `bytes` of `value` anywhere into `content`, in one of both orders.
fn write(content: &mut [u8], bytes: usize, value: u64, rng: &mut Rng) {
    let Some(last) = content.len().checked_sub(bytes) else {
        return;
    };
    let at = index(rng, last + 1);
    let mut field = value.to_le_bytes()[..bytes].to_vec();
    if rng.below(2) == 0 {
        field.reverse();
    }
    content[at..at + bytes].copy_from_slice(&field);
}

/// Adds a small number to a number of the content, or subtracts it.
fn near(content: &mut [u8], rng: &mut Rng) {
    let bytes = [1, 1, 2, 4][index(rng, 4)];
    let Some(last) = content.len().checked_sub(bytes) else {
        return;
    };
    let at = index(rng, last + 1);
    let (is_big, field) = (rng.below(2) == 0, &mut content[at..at + bytes]);
    if is_big {
        field.reverse();
    }
    let mut value = [0; 8];
    value[..bytes].copy_from_slice(field);
    let (value, step) = (u64::from_le_bytes(value), 1 + rng.below(NEAR_MAX));
    let value = match rng.below(2) {
        0 => value.wrapping_add(step),
        _ => value.wrapping_sub(step),
    };
    field.copy_from_slice(&value.to_le_bytes()[..bytes]);
    if is_big {
        field.reverse();
    }
}

/// Writes a number with which the program compares.
fn constant(content: &mut [u8], material: &Material<'_>, rng: &mut Rng) {
    let Some(number) = material.constants.number(rng) else {
        return;
    };
    let least = match number {
        -0x80..=0xFF => 1,
        -0x8000..=0xFFFF => 2,
        -0x8000_0000..=0xFFFF_FFFF => 4,
        _ => 8,
    };
    let bytes = match rng.below(3) {
        0 => (2 * least).min(8),
        _ => least,
    };
    write(content, bytes, number.cast_unsigned(), rng);
}

/// A byte that may count parts behind it.
struct Count {
    at: usize,
    /// Size of a part, bytes.
    size: usize,
    /// Number of bytes at the end that are not counted.
    rest: usize,
}

/// The bytes that may be counts, because they equal the number of parts behind them.
fn counts(content: &[u8]) -> Vec<Count> {
    let mut counts = Vec::new();
    for (at, &count) in content.iter().enumerate().filter(|(_, count)| **count > 0) {
        let behind = content.len() - at - 1;
        for size in SIZES {
            let rest = behind.checked_sub(usize::from(count) * size);
            if let Some(rest) = rest.filter(|rest| *rest <= UNCOUNTED_MAX) {
                counts.push(Count { at, size, rest });
            }
        }
    }
    counts
}

impl Count {
    /// Changes the count; in half of the cases also the number of parts.
    fn change(&self, content: &mut Vec<u8>, rng: &mut Rng) {
        let (old, new) = self.lie(content, rng);
        if rng.below(2) == 0 {
            return;
        }
        if rng.below(4) > 0 {
            self.change_others(content, old, new);
        }
        let rest = content.split_off(content.len() - self.rest);
        let fill = content.last().copied().unwrap_or_default();
        content.resize(self.at + 1 + usize::from(new) * self.size, fill);
        content.extend(rest);
    }

    /// Changes the count alone; returns the old one and the new one.
    fn lie(&self, content: &mut [u8], rng: &mut Rng) -> (u8, u8) {
        let old = content[self.at];
        let new = match rng.below(8) {
            0 => old.wrapping_add(1),
            1 => old.wrapping_sub(1),
            2 => old.saturating_mul(2),
            // Even: parts of two bytes fill it.
            3 => 0x7F,
            4 => 0x80,
            5 => 0xFE,
            6 => 0xFF,
            _ => byte(rng),
        };
        content[self.at] = new;
        (old, new)
    }

    /// Changes other counts of the same parts before this one: the number of registers stands
    /// before their number of bytes.
    fn change_others(&self, content: &mut [u8], old: u8, new: u8) {
        let [old, new] = [old, new].map(|count| usize::from(count) * self.size);
        for other in &mut content[..self.at] {
            for size in SIZES {
                if usize::from(*other) * size == old && new.is_multiple_of(size) {
                    *other = u8::try_from(new / size).unwrap_or(u8::MAX);
                    break;
                }
            }
        }
    }
}

/// `frame` with one of its lengths wrong and all other bytes unchanged; `None` if no length is
/// known.
pub(super) fn lying_length(
    material: &Material<'_>,
    frame: &[u8],
    rng: &mut Rng,
) -> Option<Vec<u8>> {
    let mut content = material.format.content(frame)?;
    if material.format.limits(&content).is_empty() {
        return None;
    }
    wrong_length(&mut content, material, rng);
    Some(material.format.frame(&content, 0))
}

/// `frame` with a byte changed that may be a count; `None` if there is none, as in text.
pub(super) fn lying_count(material: &Material<'_>, frame: &[u8], rng: &mut Rng) -> Option<Vec<u8>> {
    let mut content = material.format.content(frame)?;
    let counts = counts(&content);
    let count = counts.get(index(rng, counts.len()))?;
    if material.format.is_text() {
        return None;
    }
    count.lie(&mut content, rng);
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
pub(super) fn put_limit(content: &mut Vec<u8>, fields: &[FieldLimits], rng: &mut Rng) {
    let field = &fields[index(rng, fields.len())];
    if let Some(value) = field.values.get(index(rng, field.values.len())) {
        content.splice(field.range.clone(), value.iter().copied());
    }
}
