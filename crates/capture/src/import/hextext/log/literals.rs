//! Literals of bytes among the words of a line, as Python and Rust print them.
//!
//! ```text
//! 2026-11-28 16:00:00.001 DEBUG port wrote b'~\x12\x01\x01=p~'
//! sent b'AT\r\n', got b'OK\r\n'
//! ```

use super::stated::told;
use super::{Piece, prefix_of};
use crate::import::hextext::tokens::escape;
use engine::hex;

/// A literal and its place in the line.
struct Literal {
    start: usize,
    end: usize,
    bytes: Vec<u8>,
}

/// The first literal from `from` on.
fn next(text: &str, from: usize) -> Option<Literal> {
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
pub(super) fn is_in(text: &str) -> bool {
    let mut from = 0;
    while let Some(found) = next(text, from) {
        let shown = core::str::from_utf8(&found.bytes).unwrap_or("?");
        if !found.bytes.is_empty() && hex::bytes(shown).is_none() {
            return true;
        }
        from = found.end;
    }
    false
}

/// The literals of a line. The time before the first one holds for all of them; the direction holds
/// until another one follows.
pub(super) fn pieces(text: &str) -> Vec<Piece> {
    let mut pieces: Vec<Piece> = Vec::new();
    let mut from = 0;
    while let Some(found) = next(text, from) {
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
            bytes: found.bytes,
        });
        from = found.end;
    }
    pieces
}
