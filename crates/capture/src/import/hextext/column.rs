//! The column of characters at the right of bytes, which may look like bytes itself.
//!
//! ```text
//! RX: 41 42 43 44  ABCD
//! 41 42 20 23 |AB #|      the number sign begins no comment here
//! ```

use super::log::runs::runs;

/// Marks around the characters, in pairs.
const MARKS: [(char, char); 7] = [
    ('|', '|'),
    ('"', '"'),
    ('\'', '\''),
    ('[', ']'),
    ('(', ')'),
    ('<', '>'),
    (';', ';'),
];

/// The text without a column at its end that shows the last bytes before it, one character each.
///
/// A line of a dump with an offset keeps its column: behind the offset it would look like bytes.
pub(super) fn without_column(text: &str) -> &str {
    if begins_with_offset(text) {
        return text;
    }
    let bodies = gaps(text).filter_map(|at| {
        let (body, shown) = text.split_at(at);
        let run = runs(body).pop()?;
        let is_last = run.end == body.trim_end().len() && run.bytes.len() > 1;
        (is_last && is_shown(shown, &run.bytes)).then(|| body.trim_end())
    });
    bodies.into_iter().next().unwrap_or(text)
}

/// Whether a line begins with an offset of a dump: `0010:`, `00000010:` or `00000010`.
fn begins_with_offset(text: &str) -> bool {
    let word = text.split_whitespace().next().unwrap_or_default();
    let digits = word.strip_suffix(':').unwrap_or(word);
    let least = if digits.len() < word.len() { 4 } else { 6 };
    digits.len() >= least && digits.bytes().all(|byte| byte.is_ascii_hexdigit())
}

/// Places at which such a column may begin, the last one first: wide gaps, and blanks before a
/// mark.
fn gaps(text: &str) -> impl Iterator<Item = usize> {
    let bytes = text.as_bytes();
    let is_blank = |at: usize| bytes.get(at).is_some_and(|byte| b" \t".contains(byte));
    let is_mark = |at: usize| {
        let rest = text.get(at..).unwrap_or_default();
        MARKS.iter().any(|(open, _)| rest.starts_with(*open))
    };
    let is_gap = move |at: &usize| {
        let begins = is_blank(*at) && *at > 0 && !is_blank(*at - 1);
        let is_wide = bytes[*at] == b'\t' || is_blank(*at + 1);
        begins && (is_wide || is_mark(*at + 1))
    };
    (0..bytes.len()).rev().filter(is_gap)
}

/// Whether `shown` has the characters of `bytes`, perhaps between marks. Blanks at its ends may be
/// lost. An unprintable byte is shown as anything but a letter or a digit of ASCII.
fn is_shown(shown: &str, bytes: &[u8]) -> bool {
    let plain = shown.trim();
    let inside = MARKS.iter().find_map(|(open, close)| {
        let inside = plain.strip_prefix(*open)?;
        Some(inside.strip_suffix(*close).unwrap_or(inside))
    });
    let fits = |text: &str, bytes: &[u8]| {
        let is_same = |(c, &byte): (char, &u8)| match byte {
            b' '..=b'~' => c == char::from(byte),
            _ => !c.is_ascii_alphanumeric(),
        };
        text.chars().count() == bytes.len() && text.chars().zip(bytes).all(is_same)
    };
    let is_bare = || {
        let is_blank = |byte: &&u8| **byte == b' ';
        let before = bytes.iter().take_while(is_blank).count();
        let behind = bytes[before..].iter().rev().take_while(is_blank).count();
        let inner = &bytes[before..bytes.len() - behind];
        !inner.is_empty() && fits(plain, inner)
    };
    inside.is_some_and(|inside| [inside, inside.trim()].iter().any(|text| fits(text, bytes)))
        || is_bare()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn characters_that_look_like_bytes_are_none() {
        for (text, body) in [
            ("RX: 41 42 43 44  ABCD", "RX: 41 42 43 44"),
            ("41 42\tAB", "41 42"),
            ("41 42 |AB|", "41 42"),
            ("41 42 'AB'", "41 42"),
            ("41 42 [AB]", "41 42"),
            ("41 42 ; AB", "41 42"),
            ("41 42 20 23 |AB #|", "41 42 20 23"),
            ("41 42 20 23  AB #", "41 42 20 23"),
            ("20 41 42 20    AB ", "20 41 42 20"),
            ("00 41 42 7F  .AB.", "00 41 42 7F"),
            (
                "30 31 32 33 34 35 36 37  38 39 41 42 43 44 45 46  0123456789ABCDEF",
                "30 31 32 33 34 35 36 37  38 39 41 42 43 44 45 46",
            ),
        ] {
            assert_eq!(without_column(text), body, "{text}");
        }
    }

    /// A column stays if it has bytes behind a gap, a remark, or characters that do not match the
    /// bytes.
    #[test]
    fn other_columns_stay() {
        for text in [
            "41 42  43 44",
            "01 02  AB",
            "41 42 AB",
            "41 42  AC",
            "41 42 (AB CD)",
            "TX  41 42",
            "00000000: 4142  AB",
            "0010: 41 42  AB",
            "00000010  41 42  |AB|",
            "",
        ] {
            assert_eq!(without_column(text), text, "{text}");
        }
    }

    /// A lone byte, and bytes before other words, have no column. An offset has four digits and a
    /// colon, or six.
    #[test]
    fn a_column_shows_the_last_bytes_of_a_line() {
        for text in ["x 41  A", "41 42 x  AB", "41 42  A"] {
            assert_eq!(without_column(text), text, "{text}");
        }
        let found = ["0010: x", "000010 x", "001: x", "00010 x", "00100g x", "x"];
        let expected = [true, true, false, false, false, false];
        assert_eq!(found.map(begins_with_offset), expected);
        assert!(is_shown(" |A B|", b"A B") && is_shown("A", b" A ") && is_shown("[AB", b"AB"));
        assert!(!is_shown("", b"  ") && !is_shown("AB", b"ABC") && !is_shown("|A|", b"\x01"));
        assert!(is_shown("A.", b"A\x01") && !is_shown("Ax", b"A\x01"));
    }
}
