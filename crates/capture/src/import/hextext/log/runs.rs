//! Runs of hex numbers in a line.

use engine::hex;

use super::{is_head, prefix_of};
use crate::import::hextext::ellipsis;

/// Consecutive hex numbers.
#[derive(Clone, Debug, Default)]
pub(in crate::import::hextext) struct Run {
    pub(in crate::import::hextext) bytes: Vec<u8>,
    pub(super) evident: usize,
    pub(super) has_marks: bool,
    pub(super) is_pairs: bool,
    pub(super) start: usize,
    pub(in crate::import::hextext) end: usize,
}

/// Kinds of numbers, which are not mixed in one run.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Pair,
    Marked,
    Digits,
}

fn number(token: &str) -> Option<(Kind, Vec<u8>)> {
    let marked = token
        .strip_prefix("0x")
        .or_else(|| token.strip_prefix("0X"));
    if let Some(digits) = marked {
        let byte = hex::byte(format!("{digits:0>2}").as_bytes()).filter(|_| !digits.is_empty())?;
        return Some((Kind::Marked, vec![byte]));
    }
    match token.len() {
        2 => hex::byte(token.as_bytes()).map(|byte| (Kind::Pair, vec![byte])),
        0..=3 => None,
        _ => {
            let has_digit = token.bytes().any(|byte| byte.is_ascii_digit());
            let bytes = hex::bytes(token).filter(|_| has_digit)?;
            Some((Kind::Digits, bytes))
        }
    }
}

/// All runs of a line.
pub(in crate::import::hextext) fn runs(text: &str) -> Vec<Run> {
    let is_inside = |c: char| c.is_alphanumeric() || c == '.' || c == '_';
    let (mut runs, mut last): (Vec<Run>, Option<(Kind, usize)>) = (Vec::new(), None);
    let mut at = 0;
    while at < text.len() {
        let rest = &text[at..];
        let len = rest.find(|c| !is_inside(c)).unwrap_or(rest.len());
        if len == 0 {
            at += rest.chars().next().map_or(1, char::len_utf8);
            continue;
        }
        let token = rest[..len].trim_end_matches('.');
        // A number of bytes that are not shown is no byte.
        let is_count =
            token.bytes().all(|byte| byte.is_ascii_digit()) && ellipsis::is_counted(&rest[len..]);
        let found = number(token).filter(|_| !is_count);
        if let Some((kind, bytes)) = &found {
            let gap = last.map(|(_, end)| &text[end..at]);
            // Groups of eight bytes, the last of which is shorter.
            let is_rest = gap == Some(" ")
                && runs
                    .last()
                    .is_some_and(|run| run.bytes.len().is_multiple_of(8));
            let is_kind = |(known, _): (Kind, usize)| {
                known == *kind || (known == Kind::Digits && *kind == Kind::Pair && is_rest)
            };
            let goes_on = last.is_some_and(is_kind) && gap.is_some_and(is_gap);
            if !goes_on {
                let start = at;
                runs.push(Run {
                    start,
                    ..Run::default()
                });
            }
            if let Some(run) = runs.last_mut() {
                let letters = token.as_bytes().chunks(2);
                let letters = letters.filter(|two| two.iter().any(u8::is_ascii_alphabetic));
                run.evident += match kind {
                    Kind::Marked => 1,
                    _ => letters.count(),
                };
                run.has_marks |= *kind == Kind::Marked;
                run.is_pairs |= *kind == Kind::Pair;
                run.bytes.extend(bytes);
                run.end = at + token.len();
            }
        }
        last = found.map(|(kind, _)| (kind, at + token.len()));
        at += len;
    }
    runs
}

/// Whether `gap` may separate two numbers of a run: spaces, a comma, or one mark without spaces.
fn is_gap(gap: &str) -> bool {
    let marks = gap.trim();
    gap.len() <= 3 && (marks.is_empty() || marks == "," || [":", "-", "|", ";"].contains(&gap))
}

/// The first run directly behind a direction, otherwise the one at the end of the line, or the
/// longest.
pub(super) fn best(text: &str) -> Option<Run> {
    let all = runs(text);
    let starts = core::iter::once(0).chain(all.iter().map(|run| run.end));
    let mut heads = starts
        .zip(&all)
        .map(|(start, run)| (&text[start..run.start], run));
    let is_directed = |head: &str| is_head(head) && prefix_of(head).is_sent.is_some();
    let longest = all.iter().map(|run| run.bytes.len()).max()?;
    if let Some((_, run)) = heads
        .find(|(head, run)| is_directed(head) && (run.has_marks || 2 * run.bytes.len() >= longest))
    {
        return Some(run.clone());
    }
    let is_last = |run: &&Run| {
        let tail =
            text[run.end..].trim_matches(|c: char| c.is_whitespace() || "]})>'\"|.,;".contains(c));
        tail.is_empty()
    };
    let last = all.iter().rfind(is_last).cloned();
    last.filter(|run| run.has_marks || is_head(&text[..run.start]))
        .or_else(|| all.into_iter().rev().max_by_key(|run| run.bytes.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes and place of each run.
    fn found(text: &str) -> Vec<(Vec<u8>, &str)> {
        let runs = runs(text).into_iter();
        runs.map(|run| (run.bytes, &text[run.start..run.end]))
            .collect()
    }

    #[test]
    fn numbers_of_one_kind_with_a_small_gap_are_a_run() {
        for (text, expected) in [
            ("read 01 02 0A.", vec!["01 02 0A"]),
            ("01, 02,0A", vec!["01, 02,0A"]),
            ("01:02-0A|04;05", vec!["01:02-0A|04;05"]),
            ("01   02", vec!["01   02"]),
            ("01    02", vec!["01", "02"]),
            ("01 : 02", vec!["01", "02"]),
            ("01 0x02", vec!["01", "0x02"]),
            ("0x1 0X02 0xfF", vec!["0x1 0X02 0xfF"]),
            ("0102 03", vec!["0102", "03"]),
            ("0102030405060708 09", vec!["0102030405060708 09"]),
            ("0102030405060708, 09", vec!["0102030405060708", "09"]),
            ("abcdef 12345 123 1", vec![]),
            ("0x 0x123", vec![]),
            ("01 word 02", vec!["01", "02"]),
            ("v1.02 x_01", vec![]),
        ] {
            let places: Vec<&str> = found(text).into_iter().map(|(_, place)| place).collect();
            assert_eq!(places, expected, "{text}");
        }
        assert_eq!(found("a 0102 b")[0].0, [1, 2]);
    }

    #[test]
    fn evident_digits_and_marks_of_a_run_are_counted() {
        let of = |text: &str| {
            let run = runs(text).remove(0);
            (run.evident, run.has_marks, run.is_pairs)
        };
        assert_eq!(of("AB 12 C4"), (2, false, true));
        assert_eq!(of("ab12c4"), (2, false, false));
        assert_eq!(of("0x12 0x01"), (2, true, false));
    }

    /// Of several runs, the one behind a direction, the one at the end, or the longest.
    #[test]
    fn the_bytes_of_a_line_are_its_best_run() {
        let of = |text: &str| best(text).map(|run| run.bytes);
        assert_eq!(of("len 05 data 01 02 03 04"), Some(vec![1, 2, 3, 4]));
        assert_eq!(
            of("TX 01 02 len 09 08 07 06 05 x"),
            Some(vec![9, 8, 7, 6, 5])
        );
        assert_eq!(of("TX 01 02 03 len 09 08 07 06 05 x"), Some(vec![1, 2, 3]));
        assert_eq!(of("word 01 02 03 word 04 word"), Some(vec![1, 2, 3]));
        assert_eq!(of("no bytes"), None);
    }

    /// A marked run behind a direction counts, however short; so does a marked one at the end.
    #[test]
    fn a_marked_run_counts_however_short() {
        let of = |text: &str| best(text).map(|run| run.bytes);
        assert_eq!(of("TX 0x01 len 09 08 07 06 05 x"), Some(vec![1]));
        assert_eq!(of("word 01 02 03 word 0x04"), Some(vec![4]));
        assert_eq!(of("word 01 02 03 word 04"), Some(vec![1, 2, 3]));
        assert_eq!(of("data 01 02 03 word: 04"), Some(vec![4]));
    }

    /// The end of the line may have blanks, brackets and marks behind the bytes.
    #[test]
    fn a_run_ends_a_line_in_brackets() {
        let of = |text: &str| best(text).map(|run| run.bytes);
        for tail in ["]", " ]", "})>\"", "  |.", " \t"] {
            let text = format!("word 01 02 03 word 0x04{tail}");
            assert_eq!(of(&text), Some(vec![4]), "{text}");
        }
        assert_eq!(of("word 01 02 03 word 0x04 x"), Some(vec![1, 2, 3]));
    }
}
