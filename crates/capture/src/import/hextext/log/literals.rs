//! Literals and lists of bytes among the words of a line, as Python, Rust and Java print them.
//!
//! ```text
//! 2026-11-28 16:00:00.001 DEBUG port wrote b'~\x12\x01\x01=p~'
//! sent b'AT\r\n', got b'OK\r\n'
//! sent [1, 3, 0, 255]                                   decimal numbers
//! ```

use super::stated::told;
use super::{Piece, prefix_of};
use crate::import::hextext::ellipsis;
use crate::import::hextext::tokens::escape;
use engine::hex;

/// A literal and its place in the line.
struct Literal {
    start: usize,
    end: usize,
    bytes: Vec<u8>,
}

/// The forms of content in a file.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Forms {
    /// Literals with more than digits.
    has_literals: bool,
    /// Lists of numbers all of which are decimal.
    has_lists: bool,
}

impl Forms {
    /// All forms, for a first look.
    pub(super) const ALL: Self = Self {
        has_literals: true,
        has_lists: true,
    };

    /// The forms in `texts`.
    pub(super) fn of<'a>(texts: impl Iterator<Item = &'a str> + Clone) -> Self {
        let lists = || texts.clone().flat_map(lists);
        Self {
            has_literals: texts.clone().any(is_in),
            has_lists: lists().any(|list| decimals(list).is_some())
                && lists().all(|list| decimals(list).is_some() || hex_list(list).is_none()),
        }
    }

    /// The note about lists.
    pub(super) fn note(self) -> Option<String> {
        let note = "the numbers of lists in brackets are taken as decimal: none is 0A or 05";
        self.has_lists.then(|| note.to_owned())
    }
}

/// Insides of all brackets.
fn lists(text: &str) -> impl Iterator<Item = &str> {
    let behind = text.split('[').skip(1);
    behind.filter_map(|behind| Some(behind.split_once(']')?.0))
}

/// Bytes of a list of two or more decimal numbers without leading zeros, perhaps with a sign.
fn decimals(list: &str) -> Option<Vec<u8>> {
    let byte = |word: &str| {
        let digits = word.strip_prefix('-').unwrap_or(word);
        let is_plain = digits == "0" || !digits.starts_with(['0', '+']);
        let signed = word.parse::<i8>().map(i8::cast_unsigned);
        word.parse().or(signed).ok().filter(|_| is_plain)
    };
    let bytes: Vec<u8> = words(list).map(byte).collect::<Option<_>>()?;
    (bytes.len() > 1).then_some(bytes)
}

/// The words between commas or blanks.
fn words(list: &str) -> impl Iterator<Item = &str> {
    list.split([',', ' ']).filter(|word| !word.is_empty())
}

/// Bytes of a list of pairs of hex digits.
fn hex_list(list: &str) -> Option<Vec<u8>> {
    let bytes = words(list).map(|word| hex::byte(word.as_bytes()));
    let bytes: Vec<u8> = bytes.collect::<Option<_>>()?;
    (bytes.len() > 1).then_some(bytes)
}

/// The first literal or list from `from` on.
fn next(text: &str, from: usize, forms: Forms) -> Option<Literal> {
    let literal = forms.has_literals.then(|| literal(text, from)).flatten();
    let list = forms.has_lists.then(|| list(text, from)).flatten();
    match (literal, list) {
        (Some(literal), Some(list)) if list.start < literal.start => Some(list),
        (literal, list) => literal.or(list),
    }
}

/// The first list from `from` on.
fn list(text: &str, from: usize) -> Option<Literal> {
    lists(&text[from..]).find_map(|list| {
        let start = list.as_ptr() as usize - text.as_ptr() as usize - 1;
        Some(Literal {
            start,
            end: start + list.len() + "[]".len(),
            bytes: decimals(list)?,
        })
    })
}

/// The first literal from `from` on.
fn literal(text: &str, from: usize) -> Option<Literal> {
    let opens = text[from..].match_indices(['\'', '"']);
    opens
        .filter_map(|(at, quote)| {
            let (before, inside) = text.split_at(from + at);
            let before = before.strip_suffix('b')?;
            let is_word = before.ends_with(|c: char| c.is_alphanumeric() || c == '_');
            if is_word || before.len() < from {
                return None;
            }
            let (bytes, len) = decoded(&inside[quote.len()..], quote.chars().next()?)?;
            Some(Literal {
                start: before.len(),
                end: from + at + quote.len() + len,
                bytes,
            })
        })
        .next()
}

/// The bytes before the closing `quote`, and the number of characters with it.
fn decoded(text: &str, quote: char) -> Option<(Vec<u8>, usize)> {
    let mut bytes = Vec::new();
    let mut chars = text.chars();
    loop {
        match chars.next()? {
            '\\' => bytes.push(escape(&mut chars)?),
            c if c == quote => return Some((bytes, text.len() - chars.as_str().len())),
            c => bytes.push(u8::try_from(c).ok().filter(u8::is_ascii)?),
        }
    }
}

/// Whether a line holds a literal with more than digits. A text of hex digits alone may be digits
/// in quotes.
fn is_in(text: &str) -> bool {
    let mut from = 0;
    while let Some(found) = literal(text, from) {
        let shown = core::str::from_utf8(&found.bytes).unwrap_or("?");
        if !found.bytes.is_empty() && hex::bytes(shown).is_none() {
            return true;
        }
        from = found.end;
    }
    false
}

/// The literals and lists of a line. The time before the first one applies to all of them; the
/// direction applies until another one follows.
pub(super) fn pieces(text: &str, forms: Forms) -> Vec<Piece> {
    let mut pieces: Vec<Piece> = Vec::new();
    let mut from = 0;
    while let Some(found) = next(text, from, forms) {
        let head = &text[from..found.start];
        let mut prefix = prefix_of(head);
        if let Some(last) = pieces.last() {
            prefix.at = last.prefix.at;
            prefix.is_sent = prefix.is_sent.or(last.prefix.is_sent);
        }
        pieces.push(Piece {
            prefix,
            evident: found.bytes.len(),
            has_marks: true,
            told: told(head),
            is_bare: pieces.is_empty() && head.trim().is_empty(),
            is_cut: ellipsis::begins(&text[found.end..]),
            bytes: found.bytes,
        });
        from = found.end;
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(text: &str) -> Vec<(Vec<u8>, Option<bool>)> {
        let pieces = pieces(text, Forms::ALL).into_iter();
        pieces
            .map(|piece| (piece.bytes, piece.prefix.is_sent))
            .collect()
    }

    #[test]
    fn literals_and_lists_are_found_in_their_order() {
        let (a, list) = (b"a".to_vec(), vec![1, 2]);
        assert_eq!(
            found("x b'a' [1, 2]"),
            [(a.clone(), None), (list.clone(), None)]
        );
        assert_eq!(found("x [1, 2] b\"a\""), [(list, None), (a, None)]);
        let both = "sent b'AT\\r', got b'O\\x4b'";
        let expected = [
            (b"AT\r".to_vec(), Some(true)),
            (b"OK".to_vec(), Some(false)),
        ];
        assert_eq!(found(both), expected);
        assert_eq!(found("sent b'1' b'2'")[1], (b"2".to_vec(), Some(true)));
        // The letter b at the end of a word is no mark, and a literal without its closing quote is
        // none.
        assert_eq!(found("ab'x' b'open \\q' b'"), []);
        assert_eq!(found("b'\u{e4}'"), []);
    }

    #[test]
    fn a_piece_tells_what_stands_around_it() {
        let one = |text: &str| pieces(text, Forms::ALL).remove(0);
        let bare = one("  b'ab'");
        assert_eq!(
            (bare.is_bare, bare.evident, bare.has_marks),
            (true, 2, true)
        );
        assert!(!one("x b'ab'").is_bare && !one("x b'ab'").is_cut);
        assert!(one("b'ab'...").is_cut);
        assert_eq!(one("3 bytes: b'ab'").told, Some(3));
        assert!(!pieces("b'a' b'b'", Forms::ALL)[1].is_bare);
        assert!(pieces("b'ab' [1, 2]", Forms::default()).is_empty());
    }

    /// Lists are decimal if none of them has a number such as 0A or 05.
    #[test]
    fn lists_are_decimal_unless_one_is_hex() {
        let has = |texts: &[&str]| Forms::of(texts.iter().copied()).has_lists;
        assert!(has(&["sent [1, 3, 0, 255]"]) && has(&["[-1 127]"]));
        assert!(!has(&["[10, 20]", "[0A, 05]"]) && has(&["[10, 20]", "[a word]"]));
        for list in ["5", "01, 03", "256, 1", "+1, 2", "-129, 1", "1, x", ""] {
            assert_eq!(decimals(list), None, "{list}");
        }
        assert_eq!(
            decimals("0, -1, -128, 255"),
            Some(vec![0, 0xFF, 0x80, 0xFF])
        );
        assert_eq!(
            (hex_list("0A, 05"), hex_list("0A"), hex_list("A, 5")),
            (Some(vec![10, 5]), None, None)
        );
    }

    /// A literal of digits alone may stand for digits, so it is not taken as bytes.
    #[test]
    fn a_literal_of_digits_is_none() {
        let literals = ["b'4142'", "b''", "b'xyz'", "b'4142' b'zz'", "no"].map(is_in);
        assert_eq!(literals, [false, false, true, true, false]);
    }

    /// A list ends behind its bracket.
    #[test]
    fn a_list_has_its_place() {
        let found = list("ab [1, 2] c", 0).expect("a list");
        assert_eq!((found.start, found.end, found.bytes), (3, 9, vec![1, 2]));
        let second = list("[1, 2] [3, 4]", 6).expect("another");
        assert_eq!((second.start, second.end), (7, 13));
        let one = literal("x b'ab' y", 0).expect("a literal");
        assert_eq!((one.start, one.end), (2, 7));
    }
}
