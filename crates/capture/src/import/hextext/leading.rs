//! Numbers before or behind the bytes of each line that are no bytes.
//!
//! ```text
//! TX 8 01 03 00 00 00 02 C4 0B      the number of bytes; also (8) or [8]
//! TX 01 03 00 (3)
//! 1: 01 03 00                       the index of the line; also (1), [1] or 1)
//! ```
//!
//! All lines together decide: each number is the number of the bytes behind it, or the next index.
//! A number that may also be the first byte, because it has the same form, is a byte, with a note.

use engine::hex;

use super::prefix;
use crate::import::text::{Line, number};

/// The number before the bytes of a line.
struct Leading {
    /// Place of the number, with its marks and the blanks behind it.
    start: usize,
    end: usize,
    value: usize,
    /// Number of digits as written.
    digits: usize,
    /// Whether marks separate it from the bytes.
    is_marked: bool,
    /// Number of bytes behind it.
    count: usize,
    /// Whether these bytes are pairs of hex digits.
    are_pairs: bool,
}

/// Removes the numbers from the lines if they are no bytes; returns a note.
///
/// # Errors
/// If it is unknown what marked numbers are, with the index of the line.
pub(super) fn remove(texts: &mut [(Line<'_>, String)]) -> Result<Option<String>, (usize, String)> {
    let mut all = Vec::new();
    for (index, (_, text)) in texts.iter().enumerate() {
        match leading(text) {
            Numbers::None => {}
            Numbers::Bytes => return Ok(None),
            Numbers::Behind(found) => all.push((index, found)),
        }
    }
    let leads = || all.iter().map(|(_, found)| found);
    let is_each = |is: fn(&Leading) -> bool| leads().all(is);
    let is_marked = is_each(|one| one.is_marked);
    let note = if all.is_empty() {
        return Ok(None);
    } else if is_each(|one| one.value == one.count) {
        // From ten on, decimal and hex differ; the same number on all lines may be a start byte.
        let is_decimal = leads().any(|one| one.are_pairs && one.value >= 10);
        let is_sure = leads().any(|one| one.is_marked || (one.are_pairs && one.digits % 2 == 1))
            || (is_decimal && leads().any(|one| one.value != all[0].1.value));
        if !is_sure {
            let note = "the first number of each line is the number of bytes behind it: it is \
                        taken as a byte, as a protocol may send it";
            let may_be_count = all.len() > 1 && leads().any(|one| one.count > 1);
            return Ok(may_be_count.then(|| note.to_owned()));
        }
        "the number before the bytes of each line is their count, and no byte"
    } else if is_marked && all.len() > 1 && is_index(leads()) {
        "the number before the bytes of each line is its index, and no byte"
    } else if is_marked && leads().any(|one| one.value == one.count) {
        let cut = all.iter().find(|(_, one)| one.value != one.count);
        let (index, one) = cut.expect("not all are equal");
        let (told, count) = (one.value, one.count);
        return Err((
            *index,
            format!("the line announces {told} bytes but contains {count}: log all bytes"),
        ));
    } else if is_marked {
        let (index, one) = &all[0];
        return Err((
            *index,
            format!(
                "the number {} before the bytes is neither their count nor an index: remove it, \
                 or write it as the bytes",
                one.value
            ),
        ));
    } else {
        return Ok(None);
    };
    for (index, found) in &all {
        let text = &mut texts[*index].1;
        // A colon separates a word from the bytes: `Length 8: 01 03`.
        let head = text[..found.start].trim_end();
        let is_behind_word = found.is_marked && head.ends_with(char::is_alphanumeric);
        let mark = if is_behind_word { ": " } else { "" };
        text.replace_range(found.start..found.end, mark);
    }
    Ok(Some(note.to_owned()))
}

/// The text without `(3)` at its end, if that is the number of the bytes before it.
pub(super) fn without_count_behind(text: &str) -> &str {
    let count = || {
        let (before, count) = text.trim_end().strip_suffix(')')?.rsplit_once('(')?;
        let counts = before.split_ascii_whitespace().rev().map_while(bytes_in);
        (number(count)? == counts.sum::<usize>() as u64).then_some(before)
    };
    count().unwrap_or(text)
}

/// Whether each number is the next one.
fn is_index<'a>(leads: impl Iterator<Item = &'a Leading>) -> bool {
    let values: Vec<usize> = leads.map(|one| one.value).collect();
    values.windows(2).all(|pair| pair[0] + 1 == pair[1])
}

/// Numbers at the end of a line.
enum Numbers {
    /// One at most.
    None,
    /// All may be bytes.
    Bytes,
    /// A number, and bytes behind it.
    Behind(Leading),
}

fn leading(text: &str) -> Numbers {
    let body = prefix::split(text).1;
    // The last words that are numbers.
    let mut words: Vec<(usize, &str)> = Vec::new();
    for word in body.split_ascii_whitespace().rev() {
        let is_first = lead(word).is_some();
        if bytes_in(word).is_none() && !is_first {
            break;
        }
        words.push((word.as_ptr() as usize - text.as_ptr() as usize, word));
        if bytes_in(word).is_none() {
            break;
        }
    }
    words.reverse();
    let [(start, first), behind @ ..] = &words[..] else {
        return Numbers::None;
    };
    if behind.is_empty() {
        return Numbers::None;
    }
    let Some((digits, is_marked)) = lead(first) else {
        return Numbers::Bytes;
    };
    let are_pairs = |word: &str| {
        let mut parts = parts(word);
        parts.all(|part| part.starts_with("0x") || part.len().is_multiple_of(2))
    };
    Numbers::Behind(Leading {
        start: *start,
        end: behind[0].0,
        value: number(digits)
            .and_then(|value| usize::try_from(value).ok())
            .unwrap_or(0),
        digits: digits.len(),
        is_marked,
        count: behind.iter().filter_map(|(_, word)| bytes_in(word)).sum(),
        are_pairs: behind.iter().all(|(_, word)| are_pairs(word)),
    })
}

/// The digits of a word that is a decimal number, and whether it has marks: `8`, `(8)`, `[8]`,
/// `8:` or `8)`.
fn lead(word: &str) -> Option<(&str, bool)> {
    let pairs = [
        ("(", "):"),
        ("[", "]:"),
        ("(", ")"),
        ("[", "]"),
        ("", ":"),
        ("", ")"),
    ];
    let marked = pairs.iter().find_map(|(open, close)| {
        word.strip_prefix(open)?
            .strip_suffix(close)
            .filter(|inside| number(inside).is_some())
    });
    match marked {
        Some(inside) => Some((inside, true)),
        None => number(word).map(|_| (word, false)),
    }
}

fn parts(word: &str) -> impl Iterator<Item = &str> {
    let is_divider = |c: char| ",:;-_|".contains(c);
    word.split(is_divider).filter(|part| !part.is_empty())
}

/// Number of bytes that a word shows; `None` if it shows something else.
fn bytes_in(word: &str) -> Option<usize> {
    let counts = parts(word).map(|part| match part.trim_end_matches(['h', 'H']).len() {
        _ if part.starts_with("0x") => Some(1),
        1 | 3 => number(part).map(|_| 1),
        len => hex::bytes(&part[..len]).map(|_| len / 2),
    });
    let count = counts.sum::<Option<usize>>()?;
    (count > 0).then_some(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lines without the numbers, and the note or the error.
    fn removed(lines: &[&str]) -> (Vec<String>, String) {
        let line = |text: &&str| {
            let line = Line {
                number: 0,
                offset: 0,
                text: b"",
            };
            (line, (*text).to_owned())
        };
        let mut texts: Vec<_> = lines.iter().map(line).collect();
        let note =
            remove(&mut texts).unwrap_or_else(|(index, error)| Some(format!("{index}: {error}")));
        let texts = texts.into_iter().map(|(_, text)| text).collect();
        (texts, note.unwrap_or_default())
    }

    #[test]
    fn a_count_of_the_bytes_is_none_of_them() {
        for lines in [
            &["TX 3 10 5B 01", "RX 2 E5 AF"][..],
            &["TX 3 105B01", "RX 2 E5AF"],
            &["TX 3 10:5B:01", "RX 2 E5:AF"],
            &["TX (3) 10 5B 01", "RX (2) E5 AF"],
            &["TX [03] 10 5B 01", "RX [02] E5 AF"],
            &["DEBUG port TX 3 10 5B 01", "DEBUG port RX 2 E5 AF"],
            &["0.5 3 10 5B 01", "0.6 2 E5 AF"],
            &["(3) 10 5B 01"],
            &["3: 10 5B 01"],
            &["TX 003 10 5B 01"],
        ] {
            let (texts, note) = removed(lines);
            assert!(note.contains("their count"), "{lines:?}: {note}");
            let has_count = |text: &String| text.contains(['2', '3']);
            assert!(!texts.iter().any(has_count), "{texts:?}");
        }
        let (texts, _) = removed(&["TX 10 01 02 03 04 05 06 07 08 09 0A", "RX 01 AA"]);
        assert_eq!(texts, ["TX 01 02 03 04 05 06 07 08 09 0A", "RX AA"]);
        let (texts, _) = removed(&["x Length 2: AB CD", "TX 16 AB"]);
        assert_eq!(texts, ["x Length 2: AB CD", "TX 16 AB"]);
    }

    #[test]
    fn a_count_behind_the_bytes_is_none_of_them() {
        for (text, body) in [
            ("(>>) 01h 03h 00h (3)", "(>>) 01h 03h 00h "),
            ("TX: 010300 (3) ", "TX: 010300 "),
            ("TX: 01 03 00 (2)", "TX: 01 03 00 (2)"),
            ("TX: 01 03 00", "TX: 01 03 00"),
            (") (", ") ("),
        ] {
            assert_eq!(without_count_behind(text), body);
        }
    }

    #[test]
    fn an_index_of_the_lines_is_no_byte() {
        for lines in [
            ["01: AB CD EF", "02: 12 34"],
            ["[9] AB CD EF", "[10] 12 34"],
            ["0) AB CD EF", "1) 12 34"],
            ["0.5 (9) AB CD EF", "0.6 (10) 12 34"],
        ] {
            let (texts, note) = removed(&lines);
            assert!(note.contains("its index"), "{lines:?}: {note}");
            assert!(
                texts[0].ends_with("AB CD EF") && !texts[0].contains('9'),
                "{texts:?}"
            );
        }
    }

    /// A protocol may send its length first; other numbers are an error or bytes.
    #[test]
    fn a_number_of_unknown_meaning_stays_or_is_an_error() {
        for (lines, expected) in [
            (&["TX 03 10 5B 01", "RX 02 E5 AF"][..], "taken as a byte"),
            (&["TX 3 1 2 171", "RX 2 1 2"], "taken as a byte"),
            (&["TX 0C 10 5B 01", "RX 02 E5 AF"], ""),
            (&["TX 02 E5 AF"], ""),
            (
                &[
                    "10 01 02 03 04 05 06 07 08 09 0A",
                    "10 01 02 03 04 05 06 07 08 09 0A",
                ],
                "taken as a byte",
            ),
            (&["12 34 56"], ""),
            (&["[1, 3, 0, 255]", "[1, 3]"], ""),
            (&["no bytes", ""], ""),
            (&["RX [17] 03 00", "RX [17] 03 00"], "0: the number 17"),
            (
                &["TX [3] 10 5B 01", "RX [5] E5 AF"],
                "1: the line announces 5",
            ),
        ] {
            let (texts, note) = removed(lines);
            assert_eq!(texts, lines);
            assert!(
                note.contains(expected) && note.is_empty() == expected.is_empty(),
                "{lines:?}: {note}"
            );
        }
    }
}
