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
    let ends = ["//", "#"].map(|mark| rest.find(mark).filter(|&at| Some(at) > quoted));
    let end = ends.into_iter().flatten().min();
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
