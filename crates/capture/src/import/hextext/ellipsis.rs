//! Marks of tools that show only the first bytes of a message.
//!
//! ```text
//! RX: 01 03 20 00 ...          also an ellipsis of one character, or (truncated)
//! RX: 01 03 20 00 (28 more bytes)     also without brackets
//! ```

const ELLIPSES: [&str; 2] = ["...", "\u{2026}"];
const CLOSERS: &[char] = &[' ', '\t', ']', ')', '}', '>'];
const OPENERS: &[char] = &[' ', '\t', '[', '(', '{', '<'];

/// The text without such marks at its end; `None` if it has none.
pub(super) fn without(text: &str) -> Option<&str> {
    let mut shown = None;
    while let Some(before) = without_one(shown.unwrap_or(text)) {
        shown = Some(before);
    }
    shown
}

fn without_one(text: &str) -> Option<&str> {
    let inside = text.trim_end_matches(CLOSERS);
    let before = ELLIPSES.iter().find_map(|mark| inside.strip_suffix(mark));
    let before = before.filter(|before| !before.ends_with('.')).or_else(|| {
        let at = inside.rfind(OPENERS)?;
        is_word(&inside[at..]).then(|| &inside[..at])
    });
    let before = before.or_else(|| without_count(inside));
    before.map(|before| before.trim_end_matches(OPENERS))
}

/// The text before a count at its end, such as `14 more bytes`.
fn without_count(text: &str) -> Option<&str> {
    let (head, more) = text.char_indices().rev().find_map(|(at, _)| {
        let is_begun = at == 0 || text[..at].ends_with(' ');
        (is_begun && is_more(&text[at..])).then(|| text.split_at(at))
    })?;
    // Nothing but the two words.
    let is_whole = more
        .bytes()
        .all(|byte| byte.is_ascii_alphabetic() || byte == b' ');
    let digits = head.trim_end_matches(' ');
    let before = digits.trim_end_matches(|c: char| c.is_ascii_digit());
    let is_count = before.len() < digits.len() && before.ends_with(['+', ' ', '(', '[']);
    (is_whole && is_count).then(|| before.trim_end_matches(['+', ' ']))
}

/// Whether the text behind a number says that the number counts the bytes that are not shown.
pub(super) fn is_counted(behind: &str) -> bool {
    behind
        .strip_prefix(' ')
        .is_some_and(|words| is_more(words.trim_start()))
}

/// Whether such a mark begins the text behind some bytes.
pub(super) fn begins(tail: &str) -> bool {
    let is_around = |c: char| CLOSERS.contains(&c) || OPENERS.contains(&c) || "\"',".contains(c);
    let inside = tail.trim_start_matches(is_around);
    let is_ellipsis = |mark: &&str| {
        let behind = inside.strip_prefix(*mark);
        behind.is_some_and(|behind| behind.is_empty() || behind.starts_with(is_around))
    };
    let words = inside.trim_start_matches(|c: char| c.is_ascii_digit() || "+ ".contains(c));
    ELLIPSES.iter().any(is_ellipsis) || is_word(inside) || is_more(words)
}

fn is_word(text: &str) -> bool {
    let word = text.trim_matches(|c| OPENERS.contains(&c) || CLOSERS.contains(&c));
    word.eq_ignore_ascii_case("truncated")
}

/// Whether a text is "more" or "more bytes".
fn is_more(text: &str) -> bool {
    let lower = text.to_ascii_lowercase();
    let mut words = lower.split(|c: char| !c.is_ascii_alphabetic());
    words.next() == Some("more") && matches!(words.next(), None | Some("" | "byte" | "bytes"))
}

/// Lines whose bytes the tool cut.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cuts {
    first: Option<usize>,
    count: usize,
}

impl Cuts {
    pub(super) fn add(&mut self, line: usize) {
        self.first.get_or_insert(line);
        self.count += 1;
    }

    /// The note about these lines.
    pub(super) fn note(&self) -> Option<String> {
        let (first, count) = (self.first?, self.count);
        Some(format!(
            "the log shows only the first bytes of {count} messages (\"...\" behind them), the \
             first is line {first}: their frames are not complete"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mark_behind_bytes_is_known() {
        for (text, body) in [
            ("01 03 ...", "01 03"),
            ("01 03...", "01 03"),
            ("01 03 \u{2026}", "01 03"),
            ("01 03 [...]", "01 03"),
            ("[01 03 ...]", "[01 03"),
            ("01 03 (truncated)", "01 03"),
            ("01 03 <Truncated>", "01 03"),
            ("01 03 ... (truncated)", "01 03"),
            ("01 03 [...] (28 more bytes)", "01 03"),
            ("01 03 (28 more bytes)", "01 03"),
            ("01 03 28 more bytes", "01 03"),
            ("01 03 +28 more", "01 03"),
        ] {
            assert_eq!(without(text), Some(body), "{text}");
            assert!(begins(&text[body.len()..]), "{text}");
        }
        for tail in [
            " ... C4 0B",
            "' ...",
            " (28 more bytes)",
            " +28 more",
            "...)",
        ] {
            assert!(begins(tail), "{tail}");
        }
    }

    /// A column of unprintable characters, and words with another meaning, do not mark cut bytes.
    #[test]
    fn other_text_is_no_mark() {
        for text in [
            "01 03 ....",
            "01 03  ...A",
            "'AB...'",
            "01 03",
            "not truncated at all",
            "01 03 no more",
            "28 moreover",
            "AB more bytes",
            "",
        ] {
            assert_eq!(without(text), None, "{text}");
        }
        for tail in [
            " ....",
            " ...A",
            " (8 bytes)",
            " no more",
            " (retry)",
            " moreover",
            "",
        ] {
            assert!(!begins(tail), "{tail}");
        }
    }

    /// A count stands behind a blank, a plus sign or a bracket, with digits and the two words.
    #[test]
    fn a_count_of_more_bytes_has_digits() {
        for (text, before) in [
            ("01 28 more bytes", Some("01")),
            ("01 +28 more", Some("01")),
            ("01 (28 more byte", Some("01 (")),
            ("01 x28 more", None),
            ("01 more bytes", None),
            ("01 28 more 2", None),
            ("28 more", None),
        ] {
            assert_eq!(without_count(text), before, "{text}");
        }
        assert!(is_counted(" more bytes") && is_counted("  more") && !is_counted("more"));
        assert!(!is_counted(" bytes"));
    }

    #[test]
    fn cut_lines_are_counted() {
        let mut cuts = Cuts::default();
        assert_eq!(cuts.note(), None);
        [7, 9].into_iter().for_each(|line| cuts.add(line));
        let note = cuts.note().expect("two");
        assert!(
            note.contains("of 2 messages") && note.contains("first is line 7"),
            "{note}"
        );
    }

    /// The words need a number before them, behind a blank, a plus sign or a bracket.
    #[test]
    fn words_without_a_number_are_no_count() {
        for (text, body) in [
            ("01 03 + 4 more", "01 03"),
            ("01 03 +4 more bytes", "01 03"),
            ("01 03 (4 more bytes)", "01 03"),
            ("01 03 [12 more]", "01 03"),
        ] {
            assert_eq!(without(text), Some(body), "{text}");
        }
        for text in [
            "01 03 + more bytes",
            "01 0x more",
            "01 03 x4 more",
            "01 03 4 more than",
            "4 more",
        ] {
            assert_eq!(without_count(text), None, "{text}");
        }
    }
}
