//! Time and direction before the bytes of a line.

use super::clock::{self, Clock, next_word};
use super::ends::label;

/// Text before the bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::import) struct Prefix {
    pub(in crate::import) at: Option<(u64, Clock)>,
    /// Whether the host sent the bytes; `None` if the line has no direction.
    pub(in crate::import) is_sent: Option<bool>,
    /// Whether the direction is only an arrow to the right after the time, which the Arduino IDE
    /// and PlatformIO write before received text.
    pub(in crate::import) is_arrow: bool,
    /// Number of bytes that the line states before them.
    pub(in crate::import) told: Option<usize>,
}

/// Words for bytes that the host sent.
const SENT: [&str; 13] = [
    "tx", "send", "sent", "sending", "out", "write", "wrote", "written", "host", "->", "-->", ">",
    ">>",
];
/// Words for bytes that the host received.
const RECEIVED: [&str; 13] = [
    "rx",
    "recv",
    "received",
    "receiving",
    "rcv",
    "in",
    "read",
    "device",
    "<-",
    "<--",
    "<",
    "<<",
    "receive",
];

/// The prefix of a line, and the rest.
pub(in crate::import) fn split(text: &str) -> (Prefix, &str) {
    split_with(text, direction)
}

/// The prefix of a line of text, and the rest. Words of a direction need a mark, because the text
/// may begin with such a word: brackets, a colon, or capital letters.
pub(in crate::import) fn split_text(text: &str) -> (Prefix, &str) {
    split_with(text, |word| {
        let is_arrow = !word.contains(|c: char| c.is_alphanumeric());
        let is_marked = is_arrow || word.ends_with([':', ']', ')']) || matches!(word, "TX" | "RX");
        direction(word.trim_matches(['[', ']', '(', ')'])).filter(|_| is_marked)
    })
}

/// The prefix of a line whose directions `direction` finds in words as they are written.
fn split_with(text: &str, direction: fn(&str) -> Option<bool>) -> (Prefix, &str) {
    let (mut prefix, mut rest) = (Prefix::default(), text.trim_start());
    loop {
        let Some((word, behind)) = next_word(rest) else {
            return (prefix, rest);
        };
        let at = || clock::at_beginning(rest, word, behind);
        if let Some((at, behind)) = prefix.at.is_none().then(at).flatten() {
            (prefix.at, rest) = (Some(at), behind);
        } else if let Some(is_sent) =
            direction(written(rest, behind)).filter(|_| prefix.is_sent.is_none())
        {
            prefix.is_arrow = prefix.at.is_some() && matches!(word, "->" | ">");
            (prefix.is_sent, rest) = (Some(is_sent), behind);
        } else if prefix != Prefix::default() && matches!(word, "-" | "|" | ":" | ",") {
            rest = behind;
        } else if let Some((told, behind)) = stated(rest)
            .filter(|_| prefix.is_sent.is_some())
            .or_else(|| named(rest))
            .filter(|_| prefix.told.is_none())
        {
            (prefix.told, rest) = (Some(told), behind);
        } else {
            return (prefix, rest);
        }
    }
}

/// The number of bytes that a text begins with, and the rest: `(10):`, `[10]:` or `10:`. Numbers
/// without a colon need all lines, see [`super::leading`].
fn stated(text: &str) -> Option<(usize, &str)> {
    let (count, behind) = match text.chars().next()? {
        '(' => bracketed(&text[1..], ')')?,
        '[' => bracketed(&text[1..], ']')?,
        _ => digits(text).filter(|(_, behind)| behind.starts_with(": "))?,
    };
    Some((count, behind.strip_prefix(':')?.trim_start()))
}

/// The number of bytes that a text names, and the rest: `len=10`, `length: 10`, `[len 10]`.
fn named(text: &str) -> Option<(usize, &str)> {
    let inside = text.trim_start_matches(['(', '[']);
    let names = ["length", "len", "n", "size", "count"];
    let end = inside.find(|c: char| !c.is_ascii_alphabetic())?;
    let (name, behind) = inside.split_at(end);
    let is_name = names.contains(&name.to_ascii_lowercase().as_str());
    let behind = behind.trim_start_matches([' ', '=', ':']);
    let (count, behind) = digits(behind).filter(|_| is_name)?;
    let behind = behind.trim_start_matches([':', ',', ')', ']']);
    (behind.is_empty() || behind.starts_with(' ')).then(|| (count, behind.trim_start()))
}

fn bracketed(text: &str, close: char) -> Option<(usize, &str)> {
    let (count, behind) = digits(text)?;
    Some((count, behind.strip_prefix(close)?))
}

/// A decimal number at the beginning, and the rest.
fn digits(text: &str) -> Option<(usize, &str)> {
    let end = text
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(text.len());
    Some((text[..end].parse().ok()?, &text[end..]))
}

/// The first word of a text with its brackets and marks; `behind` is the text behind it.
fn written<'a>(text: &'a str, behind: &str) -> &'a str {
    text[..text.len() - behind.len()].trim_end()
}

fn direction(word: &str) -> Option<bool> {
    let word = word
        .trim_matches(|c: char| "[]():,".contains(c))
        .to_ascii_lowercase();
    let is_in = |words: &[&str]| words.contains(&word.as_str());
    match (is_in(&SENT), is_in(&RECEIVED)) {
        (true, _) => Some(true),
        (_, true) => Some(false),
        _ => label(&word),
    }
}
