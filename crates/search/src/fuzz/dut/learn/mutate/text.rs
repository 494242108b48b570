//! Changes of a line: its fields, its separators, its numbers.

use core::ops::Range;

use emulators::rng::Rng;

use super::{Change, index};

/// Separators of the fields of a line. A bracket or quote separates as well: fields of JSON and
/// quoted words are then fields of their own.
const SEPARATORS: &[u8] = b",;:=|/ \t{}[]()<>\"'";
/// Characters that open a nested part.
const OPENING: &[u8] = b"{[(<\"'";
/// Maximum number of digits that a changed number keeps as leading zeros.
const DIGITS_MAX: usize = 18;

/// Changes of a text content.
pub(super) const TEXT_CHANGES: [(&str, Change); 22] = [
    ("empty-field", |content, _, rng| field(content, b"", rng)),
    ("empty-fields", |content, _, rng| {
        let fields = fields(content);
        let from = index(rng, fields.len());
        let count = 1 + index(rng, fields.len() - from);
        for field in fields[from..from + count].iter().rev() {
            content.drain(field.clone());
        }
    }),
    ("joined-fields", |content, _, rng| {
        let fields = fields(content);
        let from = index(rng, fields.len());
        let count = 1 + index(rng, 3);
        for field in fields[from..].iter().take(count).rev() {
            if field.end < content.len() {
                content.remove(field.end);
            }
        }
    }),
    ("separator-twice", |content, _, rng| {
        let (_, separator) = any_field(content, rng);
        let at = index(rng, content.len() + 1);
        content.insert(at, separator);
    }),
    ("repeated-field", |content, _, rng| {
        let (field, separator) = any_field(content, rng);
        let one = [&content[field.clone()], &[separator]].concat();
        let many = one.repeat(1 << rng.below(7));
        content.splice(field.start..field.start, many);
    }),
    ("swapped-fields", |content, _, rng| {
        let fields = fields(content);
        let [one, other] = [index(rng, fields.len()), index(rng, fields.len())];
        let (one, other) = (&fields[one.min(other)], &fields[one.max(other)]);
        let [first, second] = [one, other].map(|range| content[range.clone()].to_vec());
        content.splice(other.clone(), first);
        content.splice(one.clone(), second);
    }),
    ("field-of-another-line", |content, material, rng| {
        let other = &material.contents[index(rng, material.contents.len())];
        let (from, _) = any_field(other, rng);
        field(content, &other[from], rng);
    }),
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
    ("number-near", |content, _, rng| number_near(content, rng)),
    ("other-digits", |content, _, rng| other_digits(content, rng)),
    ("small-number", |content, _, rng| {
        let top = 10_u64.pow(1 + u32::try_from(rng.below(4)).unwrap_or(0));
        field(content, rng.below(top).to_string().as_bytes(), rng);
    }),
    ("constant", |content, material, rng| {
        if let Some(number) = material.constants.number(rng) {
            let text = match rng.below(6) {
                0 => format!("{number:X}"),
                1 => format!("{number}."),
                _ => number.to_string(),
            };
            field(content, text.as_bytes(), rng);
        }
    }),
    ("word", |content, material, rng| {
        if let Some(word) = material.constants.word(rng) {
            match rng.below(3) {
                0 => {
                    let at = index(rng, content.len() + 1);
                    content.splice(at..at, word.iter().copied());
                }
                1 => {
                    let (range, _) = any_field(content, rng);
                    content.splice(range, word.iter().copied());
                }
                _ => field(content, word, rng),
            }
        }
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
    ("longer-field", |content, _, rng| {
        let (range, _) = any_field(content, rng);
        let part = content[range.clone()].to_vec();
        let part = if part.is_empty() { b"0".to_vec() } else { part };
        let more = part.repeat(1 << rng.below(6));
        content.splice(range.end..range.end, more);
    }),
    ("no-number", |content, _, rng| {
        const WORDS: [&[u8]; 6] = [b"x", b"%s%n", b"--", b"N/A", b"\xFF\xFE", b"\"'\\"];
        field(content, WORDS[index(rng, WORDS.len())], rng);
    }),
    ("nested", |content, _, rng| {
        let open = OPENING[index(rng, OPENING.len())];
        let at = index(rng, content.len() + 1);
        let many = vec![open; 1 << rng.below(9)];
        content.splice(at..at, many);
    }),
    ("fields-left-out", |content, _, rng| {
        let fields = fields(content);
        let at = index(rng, fields.len());
        content.truncate(fields[at].start.saturating_sub(1));
    }),
    ("field-left-out", |content, _, rng| {
        let (field, _) = any_field(content, rng);
        content.drain(field.start..(field.end + 1).min(content.len()));
    }),
    ("more-fields", |content, _, rng| {
        let (last, separator) = any_field(content, rng);
        let one = [&[separator], &content[last]].concat();
        content.extend(one.repeat(1 << rng.below(7)));
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

/// The fields of a line; at least one.
fn fields(content: &[u8]) -> Vec<Range<usize>> {
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

/// One of the fields of a line, and the separator next to it: a comma if there is none.
fn any_field(content: &[u8], rng: &mut Rng) -> (Range<usize>, u8) {
    let fields = fields(content);
    let field = fields[index(rng, fields.len())].clone();
    let before = field.start.checked_sub(1);
    let next = content.get(field.end).copied();
    let separator = next.or_else(|| content.get(before?).copied());
    (field, separator.unwrap_or(b','))
}

/// Replaces a field of a line with `new`; rarely the first field, which selects the message.
fn field(content: &mut Vec<u8>, new: &[u8], rng: &mut Rng) {
    let fields = fields(content);
    let at = match index(rng, fields.len()) {
        0 if rng.below(4) > 0 => index(rng, fields.len()),
        at => at,
    };
    content.splice(fields[at].clone(), new.iter().copied());
}

/// The runs of digits of a line.
fn numbers(content: &[u8]) -> Vec<Range<usize>> {
    let (mut runs, mut from) = (Vec::new(), None);
    for (at, byte) in content.iter().chain(b" ").enumerate() {
        match (byte.is_ascii_digit(), from) {
            (true, None) => from = Some(at),
            (false, Some(start)) => {
                runs.push(start..at);
                from = None;
            }
            _ => {}
        }
    }
    runs
}

/// Adds or subtracts a small number, multiplies or divides a number by ten, or negates it.
fn number_near(content: &mut Vec<u8>, rng: &mut Rng) {
    let runs = numbers(content);
    let Some(run) = runs.get(index(rng, runs.len())).cloned() else {
        return;
    };
    let digits = &content[run.clone()];
    let (width, text) = (digits.len(), String::from_utf8_lossy(digits).into_owned());
    let Some(old) = text.parse::<i64>().ok().filter(|_| width <= DIGITS_MAX) else {
        return;
    };
    let step = 10_i64.pow(u32::try_from(rng.below(4)).unwrap_or(0));
    let new = match rng.below(8) {
        0..3 => old.saturating_add(step),
        3..5 => old.saturating_sub(step),
        5 => old.saturating_mul(10),
        6 => old / 10,
        _ => -old,
    };
    let new = match rng.below(3) {
        0 => new.to_string(),
        _ => format!("{new:0width$}"),
    };
    content.splice(run, new.into_bytes());
}

/// Replaces up to two digits of a number; its length stays.
fn other_digits(content: &mut [u8], rng: &mut Rng) {
    let runs = numbers(content);
    let Some(run) = runs.get(index(rng, runs.len())).cloned() else {
        return;
    };
    let at = run.start + index(rng, run.len());
    for digit in content[at..run.end].iter_mut().take(1 + index(rng, 2)) {
        *digit = b"0123456789"[index(rng, 10)];
    }
}
