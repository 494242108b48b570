//! Bytes of a line of hex text.

use engine::hex;

use super::base::Base;
use super::literal::{is_literal, is_quoted};

/// Content of a line.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Found {
    pub(super) bytes: Vec<u8>,
    /// Bytes with a letter among their digits.
    pub(super) evident: usize,
    /// Groups of more than two digits.
    pub(super) groups: usize,
    /// Whether a prefix marks the digits as hex.
    pub(super) has_marks: bool,
}

/// The text without its comments; `is_open` is whether a C comment continues.
pub(super) fn without_comments(text: &str, is_open: &mut bool) -> String {
    let mut out = String::new();
    let mut rest = text;
    loop {
        if *is_open {
            let Some((_, behind)) = rest.split_once("*/") else {
                return out;
            };
            (*is_open, rest) = (false, behind);
        }
        let Some((before, behind)) = rest.split_once("/*") else {
            break;
        };
        out.push_str(before);
        (*is_open, rest) = (true, behind);
    }
    // Inside quotes these characters are bytes.
    let has_literal = ["\\", "b'", "b\""].iter().any(|mark| rest.contains(mark));
    let quoted = rest.rfind(['"', '\'']).filter(|_| has_literal);
    let from = quoted.map_or(0, |quoted| quoted + 1);
    let ends = ["//", "#"].map(|mark| rest[from..].find(mark));
    let end = ends.into_iter().flatten().min().map(|at| from + at);
    let rest = &rest[..end.unwrap_or(rest.len())];
    // A semicolon begins a comment unless bytes follow it.
    let rest = match rest.split_once(';') {
        Some((before, behind))
            if !behind.trim().is_empty()
                && quoted.is_none_or(|quoted| before.len() > quoted)
                && read(behind, Base::Hex).is_err() =>
        {
            before
        }
        _ => rest,
    };
    out.push_str(rest);
    out
}

/// Text between the braces of an array on this line, if it consists only of numbers with a prefix.
pub(super) fn inside_braces(text: &str) -> String {
    let inside = text.rsplit('{').next().unwrap_or(text);
    let inside = inside.split('}').next().unwrap_or(inside);
    if inside.contains('=') || inside.contains('[') {
        return String::new();
    }
    inside.to_owned()
}

/// Wrappers that programs print around bytes.
const WRAPPERS: [(&str, &str); 8] = [
    ("<Buffer", ">"),
    ("bytearray(", ")"),
    ("bytes(", ")"),
    ("Buffer.from(", ")"),
    ("[]byte{", "}"),
    ("vec![", "]"),
    ("new byte[]", ""),
    ("&[", "]"),
];

/// Decodes the bytes of a line after its prefix.
pub(super) fn read(text: &str, base: Base) -> Result<Found, String> {
    let mut text = text.trim().trim_end_matches(';');
    for (open, close) in WRAPPERS {
        let inside = text.strip_prefix(open);
        if let Some(inside) = inside.and_then(|inside| inside.strip_suffix(close)) {
            text = inside.trim();
        }
    }
    if text.contains('\\') || is_literal(text) || (base == Base::Text && is_quoted(text)) {
        return escapes(text);
    }
    let all = numbers(text, base);
    let Some((body, shown)) = text_column(text) else {
        return all;
    };
    match (numbers(body, base), all) {
        (Ok(found), _) if shows(shown, &found.bytes) => Ok(found),
        (_, Ok(all)) => Ok(all),
        (Ok(_), Err(_)) => Err(format!(
            "found \"{}\", expected hex digits, or the same bytes as text",
            shown.escape_default()
        )),
        (Err(error), _) => Err(error),
    }
}

fn numbers(text: &str, base: Base) -> Result<Found, String> {
    let text = text
        .strip_prefix('b')
        .filter(|rest| rest.starts_with(['\'', '"']))
        .unwrap_or(text);
    let mut found = Found::default();
    let is_divider = |c: char| {
        c.is_whitespace() || ",;:_|{}[]()\"'".contains(c) || (c == '-' && base != Base::Decimal)
    };
    let mut tokens = text.split(is_divider).filter(|token| !token.is_empty());
    tokens.try_for_each(|token| found.take(token, base))?;
    Ok(found)
}

/// Splits at a wider gap: bytes before it, and perhaps the same bytes as text after it.
fn text_column(text: &str) -> Option<(&str, &str)> {
    let at = ["   ", "  ", "\t"].iter().find_map(|gap| text.find(gap))?;
    let shown = text[at..].trim();
    let shown = shown.strip_prefix('|').unwrap_or(shown);
    Some((&text[..at], shown.strip_suffix('|').unwrap_or(shown)))
}

/// Whether `shown` may be the text of `bytes`: one character each; an unprintable byte is any
/// character but a letter or a digit of ASCII, which would be a hex digit or a word.
fn shows(shown: &str, bytes: &[u8]) -> bool {
    let fits = |(c, &byte): (char, &u8)| match byte {
        b'!'..=b'~' => c == char::from(byte),
        _ => !c.is_ascii_alphanumeric(),
    };
    shown.chars().count() == bytes.len() && shown.chars().zip(bytes).all(fits)
}

impl Found {
    fn take(&mut self, token: &str, base: Base) -> Result<(), String> {
        let byte = match base {
            Base::Hex | Base::Text => None,
            Base::Loose => Some(hex::byte(format!("{token:0>2}").as_bytes())),
            Base::Binary => Some(u8::from_str_radix(token, 2).ok()),
            Base::Octal => Some(u8::from_str_radix(token, 8).ok()),
            Base::Decimal => {
                let signed = token.parse::<i8>().map(i8::cast_unsigned);
                Some(token.parse::<u8>().or(signed).ok())
            }
        };
        if let Some(byte) = byte {
            self.bytes.push(byte.ok_or_else(|| unexpected(token))?);
            self.evident += usize::from(base == Base::Loose);
            return Ok(());
        }
        let prefixes = ["0x", "0X", "$", "&h", "&H"];
        let marked = prefixes
            .iter()
            .find_map(|prefix| token.strip_prefix(prefix));
        let marked = marked.or_else(|| token.strip_suffix(['h', 'H']));
        if let Some(digits) = marked {
            return self.take_number(token, digits);
        }
        let bytes = hex::bytes(token).ok_or_else(|| unexpected(token))?;
        let pairs = token.as_bytes().chunks(2);
        let has_letter = |pair: &&[u8]| pair.iter().any(u8::is_ascii_alphabetic);
        self.evident += pairs.filter(has_letter).count();
        self.groups += usize::from(bytes.len() > 1);
        self.bytes.extend(bytes);
        Ok(())
    }

    /// A number with a prefix is a byte.
    fn take_number(&mut self, token: &str, digits: &str) -> Result<(), String> {
        if digits.len() > 2 && hex::bytes(&format!("{digits:0>16}")).is_some() {
            return Err(format!(
                "found {token}, a number of several bytes: which one was first on the line is \
                 unknown; write each byte by itself"
            ));
        }
        let byte = hex::byte(format!("{digits:0>2}").as_bytes()).filter(|_| !digits.is_empty());
        self.bytes.push(byte.ok_or_else(|| unexpected(token))?);
        self.evident += 1;
        self.has_marks = true;
        Ok(())
    }
}

fn unexpected(token: &str) -> String {
    let token = token.escape_default();
    format!("found \"{token}\", expected bytes as pairs of hex digits")
}

/// Decodes `\xAB\x24\n`, in quotes also with plain characters, as Python and C write them.
fn escapes(text: &str) -> Result<Found, String> {
    let mut found = Found {
        has_marks: true,
        ..Found::default()
    };
    let mut quote = None;
    let mut chars = text.chars();
    while let Some(c) = chars.next() {
        match (c, quote) {
            ('\\', _) => {
                let byte = escape(&mut chars).ok_or_else(|| {
                    "found a backslash, expected an escape as \\xAB or \\n".to_owned()
                })?;
                found.bytes.push(byte);
                found.evident += 1;
            }
            (c, Some(open)) if c == open => quote = None,
            (c, Some(_)) if c.is_ascii() => found.bytes.extend(u8::try_from(c)),
            ('"' | '\'', None) => quote = Some(c),
            (c, None) if c.is_whitespace() || "bB,;()[]+".contains(c) => {}
            (c, _) => return Err(unexpected(&c.to_string())),
        }
    }
    match quote {
        Some(quote) => Err(format!("expected a closing {quote}")),
        None => Ok(found),
    }
}

/// Decodes the characters after a backslash.
pub(in crate::import) fn escape(chars: &mut core::str::Chars<'_>) -> Option<u8> {
    Some(match chars.next()? {
        'x' | 'X' => {
            let digits: String = chars.by_ref().take(2).collect();
            hex::byte(digits.as_bytes())?
        }
        'n' => b'\n',
        'r' => b'\r',
        't' => b'\t',
        'a' => 7,
        'b' => 8,
        'f' => 12,
        'v' => 11,
        'e' => 27,
        first @ '0'..='7' => {
            let mut value = first.to_digit(8)?;
            for _ in 0..2 {
                let Some(digit) = chars.clone().next().and_then(|c| c.to_digit(8)) else {
                    break;
                };
                chars.next();
                value = value * 8 + digit;
            }
            u8::try_from(value).ok()?
        }
        c @ ('\\' | '\'' | '"') => u8::try_from(c).ok()?,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes, evident ones, groups, and whether there is a mark.
    fn found(text: &str, base: Base) -> (Vec<u8>, usize, usize, bool) {
        let found = read(text, base).unwrap_or_else(|error| panic!("{text}: {error}"));
        (found.bytes, found.evident, found.groups, found.has_marks)
    }

    fn error(text: &str, base: Base) -> String {
        read(text, base).expect_err(text)
    }

    /// A byte is evident if one of its digits is a letter, or if it is marked.
    #[test]
    fn evident_bytes_groups_and_marks_are_counted() {
        let read = [0xAB, 0x24, 0x0A, 0x00, 0xD9].to_vec();
        assert_eq!(
            found("AB 24 0A 00 D9", Base::Hex),
            (read.clone(), 3, 0, false)
        );
        assert_eq!(
            found("AB24 0A00 D9", Base::Hex),
            (read.clone(), 3, 2, false)
        );
        assert_eq!(found("ab240a00d9", Base::Hex), (read, 3, 1, false));
        let marked = [0xAB, 1, 0xF, 0xA, 5].to_vec();
        assert_eq!(found("0xAB 0X1 $F &hA 5h", Base::Hex), (marked, 5, 0, true));
        assert_eq!(
            found("A 5 0F", Base::Loose),
            ([0xA, 5, 0xF].to_vec(), 3, 0, false)
        );
        assert_eq!(found("00000101", Base::Binary), ([5].to_vec(), 0, 0, false));
        assert_eq!(
            found("377 1", Base::Octal),
            ([0xFF, 1].to_vec(), 0, 0, false)
        );
        let signed = [0xFF, 0xFF, 0x80].to_vec();
        assert_eq!(found("255 -1 -128", Base::Decimal), (signed, 0, 0, false));
    }

    #[test]
    fn a_token_that_is_no_byte_is_named() {
        for (text, base) in [
            ("41 4", Base::Hex),
            ("41 xy", Base::Hex),
            ("0x", Base::Hex),
            ("123", Base::Loose),
            ("2", Base::Binary),
            ("400", Base::Octal),
            ("256", Base::Decimal),
            ("-129", Base::Decimal),
        ] {
            let token = text.rsplit(' ').next().expect("one");
            let expected = format!("found \"{token}\"");
            assert!(error(text, base).starts_with(&expected), "{text}");
        }
        let several = "a number of several bytes";
        assert!(error("0x100", Base::Hex).contains(several));
        assert!(!error("0xxyz", Base::Hex).contains(several));
    }

    /// `\1011` is an octal `A` and a 1.
    #[test]
    fn escapes_are_bytes() {
        assert_eq!(found(r"\xAB\n", Base::Hex), (vec![0xAB, 0x0A], 2, 0, true));
        assert_eq!(found(r"b'a\x01'", Base::Hex), (vec![0x61, 1], 1, 0, true));
        let named = found(r"\a\b\t\n\v\f\r\e\0\253", Base::Hex).0;
        assert_eq!(named, [7, 8, 9, 10, 11, 12, 13, 27, 0, 0xAB]);
        assert_eq!(found(r"b'\1011'", Base::Hex).0, b"A1");
        assert_eq!(found(r#""it's \x01""#, Base::Hex).0, b"it's \x01");
        assert_eq!(error(r"\x41 'a", Base::Hex), "expected a closing '");
        assert!(error(r"\q", Base::Hex).starts_with("found a backslash"));
        assert!(error(r"\x41 z", Base::Hex).starts_with("found \"z\""));
    }

    #[test]
    fn bytes_are_read_from_the_wrappers_of_programs() {
        for text in [
            "<Buffer 41 42>",
            "bytearray([0x41, 0x42])",
            "bytes([0x41, 0x42])",
            "Buffer.from([0x41, 0x42])",
            "[]byte{0x41, 0x42};",
            "vec![0x41, 0x42]",
            "new byte[]{0x41, 0x42}",
            "&[0x41, 0x42]",
            "b'4142'",
        ] {
            assert_eq!(found(text, Base::Hex).0, b"AB", "{text}");
        }
    }

    /// A point may stand for a byte that has no character, a letter may not.
    #[test]
    fn text_beside_the_bytes_shows_the_same_bytes() {
        assert_eq!(found("41 42  AB", Base::Hex).0, b"AB");
        assert_eq!(found("41 01\t|A.|", Base::Hex).0, b"A\x01");
        assert_eq!(found("41 01  AB", Base::Hex).0, b"A\x01\xAB");
        assert_eq!(found("41 42  43", Base::Hex).0, b"ABC");
        assert!(error("41 42   XY", Base::Hex).contains("found \"XY\", expected hex digits, or"));
        assert!(!shows("ABC", b"AB") && !shows("A", b"AB") && shows("A ", b"A\x7F"));
    }

    #[test]
    fn comments_are_left_out() {
        let plain = |text: &str| {
            let mut is_open = false;
            let found = without_comments(text, &mut is_open);
            (found, is_open)
        };
        for (text, expected) in [
            ("AB // x", "AB "),
            ("AB # x // y", "AB "),
            ("AB /* c */ CD", "AB  CD"),
            ("AB ; a read", "AB "),
            ("AB;CD", "AB;CD"),
            ("AB; ", "AB; "),
            (r"b'#//;'", r"b'#//;'"),
            (r"b'#' # x", r"b'#' "),
            (r"b'#' ; a read", r"b'#' "),
        ] {
            assert_eq!(plain(text), (expected.to_owned(), false), "{text}");
        }
        assert_eq!(plain("AB /* open"), ("AB ".to_owned(), true));
        let mut is_open = true;
        assert_eq!(without_comments("still open", &mut is_open), "");
        assert!(is_open);
        assert_eq!(without_comments("end */ CD", &mut is_open), " CD");
        assert!(!is_open);
    }

    #[test]
    fn numbers_between_braces_are_those_of_an_array() {
        for (text, inside) in [
            ("x = {1, 2};", "1, 2"),
            ("1, 2};", "1, 2"),
            ("int len = 5", ""),
            ("byte a[5]", ""),
        ] {
            assert_eq!(inside_braces(text), inside, "{text}");
        }
    }

    /// A semicolon within a literal begins no comment, nor does one before bytes.
    #[test]
    fn a_semicolon_begins_a_comment_of_words() {
        let of = |text: &str| without_comments(text, &mut false);
        assert_eq!(of("b'a;b'"), "b'a;b'");
        assert_eq!(of("b'ab'; words"), "b'ab'");
        assert_eq!(of("AB ; words"), "AB ");
        assert_eq!(of("AB ; 24"), "AB ; 24");
        assert_eq!(of("AB ;"), "AB ;");
        assert_eq!(of("b'a#b' # c"), "b'a#b' ");
        assert_eq!(of("AB // c"), "AB ");
        assert_eq!(of("AB # c // d"), "AB ");
        let mut is_open = false;
        assert_eq!(
            without_comments("AB /* c */ 24 /* d", &mut is_open),
            "AB  24 "
        );
        assert!(is_open, "a comment");
        assert_eq!(without_comments("e", &mut is_open), "");
        assert!(is_open, "a line within the comment");
        assert_eq!(without_comments("f */ 0A", &mut is_open), " 0A");
        assert!(!is_open);
    }

    /// Hex digits in quotes are digits, unless the file has literals: then they are characters.
    #[test]
    fn digits_in_quotes_are_characters_beside_literals() {
        assert_eq!(found("b'AB'", Base::Hex).0, [0xAB]);
        assert_eq!(found("b'AB'", Base::Text).0, b"AB");
        assert_eq!(found("b\"4142\"", Base::Text).0, b"4142");
        assert_eq!(found("AB", Base::Text).0, [0xAB]);
    }

    /// A literal of characters that are no hex digits is one in any file.
    #[test]
    fn a_literal_has_other_characters_than_digits() {
        assert_eq!(found("b'hey'", Base::Hex).0, b"hey");
        assert_eq!(found("b\"AT+1\"", Base::Hex).0, b"AT+1");
        assert!(is_literal("b'hey'") && !is_literal("b'AB'") && !is_literal("'hey'"));
        assert!(is_quoted("b'AB'") && !is_quoted("b'AB") && !is_quoted("AB'"));
    }
}
