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

#[cfg(test)]
mod tests {
    use super::*;

    /// Time, direction, whether it is an arrow, stated number of bytes, and the rest.
    fn of(text: &str) -> (Option<u64>, Option<bool>, bool, Option<usize>, &str) {
        let (prefix, rest) = split(text);
        let at = prefix.at.map(|(nanos, _)| nanos / 1_000_000);
        (at, prefix.is_sent, prefix.is_arrow, prefix.told, rest)
    }

    /// 12:11:23.5 is 43,883,500 ms after midnight.
    #[test]
    fn a_prefix_has_a_time_a_direction_and_a_count() {
        const AT: Option<u64> = Some(43_883_500);
        for (text, expected) in [
            ("AB 24", (None, None, false, None, "AB 24")),
            ("  TX: AB", (None, Some(true), false, None, "AB")),
            ("rx AB", (None, Some(false), false, None, "AB")),
            ("12:11:23.5 AB", (AT, None, false, None, "AB")),
            ("12:11:23.5 TX AB", (AT, Some(true), false, None, "AB")),
            ("TX 12:11:23.5 AB", (AT, Some(true), false, None, "AB")),
            // An arrow behind a time may have no meaning; before it, and doubled, it has one.
            ("12:11:23.5 -> AB", (AT, Some(true), true, None, "AB")),
            ("12:11:23.5 > AB", (AT, Some(true), true, None, "AB")),
            ("12:11:23.5 >> AB", (AT, Some(true), false, None, "AB")),
            ("12:11:23.5 <- AB", (AT, Some(false), false, None, "AB")),
            ("-> AB", (None, Some(true), false, None, "AB")),
            // Marks between the parts, but not at the beginning.
            ("12:11:23.5 - TX | AB", (AT, Some(true), false, None, "AB")),
            ("| AB", (None, None, false, None, "| AB")),
            // Each part counts once.
            ("TX RX AB", (None, Some(true), false, None, "RX AB")),
            (
                "12:11:23.5 12:11:24.5 AB",
                (AT, None, false, None, "12:11:24.5 AB"),
            ),
            // A count needs a direction before it, or a name.
            ("TX (2): AB", (None, Some(true), false, Some(2), "AB")),
            ("TX [12]: AB", (None, Some(true), false, Some(12), "AB")),
            ("TX 2: AB", (None, Some(true), false, Some(2), "AB")),
            ("(2): AB", (None, None, false, None, "(2): AB")),
            ("len=2 AB", (None, None, false, Some(2), "AB")),
            ("TX Length: 2, AB", (None, Some(true), false, Some(2), "AB")),
            ("RX [len 2] AB", (None, Some(false), false, Some(2), "AB")),
            (
                "TX (2): (3): AB",
                (None, Some(true), false, Some(2), "(3): AB"),
            ),
            ("", (None, None, false, None, "")),
        ] {
            assert_eq!(of(text), expected, "{text}");
        }
    }

    #[test]
    fn a_stated_number_has_brackets_or_a_colon() {
        assert_eq!(stated("(10): x"), Some((10, "x")));
        assert_eq!(stated("[10]:x"), Some((10, "x")));
        assert_eq!(stated("10: x"), Some((10, "x")));
        for text in ["(10) x", "(10]: x", "[10): x", "10:x", "10 x", "(x): x", ""] {
            assert_eq!(stated(text), None, "{text}");
        }
    }

    #[test]
    fn a_named_number_has_one_of_five_names() {
        for text in [
            "len=10 x",
            "length: 10: x",
            "n 10 x",
            "(size 10) x",
            "[Count=10] x",
        ] {
            assert_eq!(named(text), Some((10, "x")), "{text}");
        }
        assert_eq!(named("len=10"), Some((10, "")));
        for text in ["lens=10 x", "len=x", "len=10x", "10 x", "len"] {
            assert_eq!(named(text), None, "{text}");
        }
    }

    /// A text may begin with a word of a direction; with a mark or in capitals it is one.
    #[test]
    fn a_direction_of_text_needs_a_mark() {
        let of = |text: &str| split_text(text).0.is_sent;
        for (text, expected) in [
            ("read the manual", None),
            ("read: the manual", Some(false)),
            ("[read] x", Some(false)),
            ("(send) x", Some(true)),
            ("TX x", Some(true)),
            ("RX x", Some(false)),
            ("tx x", None),
            ("-> x", Some(true)),
            ("<< x", Some(false)),
            ("words: x", None),
        ] {
            assert_eq!(of(text), expected, "{text}");
        }
    }
}
