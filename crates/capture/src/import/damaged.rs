//! Damaged lines of a text file: a line that is cut inside a byte keeps its other bytes, and a line
//! that cannot be read costs itself alone. Both are counted.

use std::borrow::Cow;

use super::imported::{ImportError, Imported, Options};
use super::text::{lines, utf8};

/// Maximum share of lines that are left out; in a file with more of them, they are no damage.
const SHARE: usize = 4;
/// Maximum number of bytes that are read again because of lines that are left out.
const READ_AGAIN: usize = 64 << 20;

/// The end of a line with bytes in hex.
enum End {
    /// Pairs of digits to the end.
    Whole,
    /// A digit is left over, at this place of the line.
    Cut(usize),
    /// Numbers without leading zeros.
    Loose,
    Other,
}

fn is_hex(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

fn end_of(line: &str) -> End {
    let text = line.trim_end();
    let is_between = |c: char| c.is_whitespace() || ",;:".contains(c);
    let words: Vec<&str> = text
        .split(is_between)
        .filter(|word| !word.is_empty())
        .collect();
    let is_pair = |word: &&str| word.len() == 2 && is_hex(word);
    let is_loose = |three: &[&str]| {
        is_pair(&three[0]) && three[1].len() == 1 && is_hex(three[1]) && is_pair(&three[2])
    };
    if words.windows(3).any(is_loose) {
        return End::Loose;
    }
    let (last, before) = match &words[..] {
        [.., before, last] => (*last, *before),
        [last] => (*last, ""),
        [] => return End::Other,
    };
    let pairs = words
        .iter()
        .rev()
        .skip(1)
        .take(2)
        .filter(|word| is_pair(word));
    let is_group = |word: &str| is_hex(word) && word.len() >= 4;
    let cut = End::Cut(text.len() - 1);
    match last.len() {
        _ if !is_hex(last) => End::Other,
        1 if pairs.count() == 2 => cut,
        1 if is_group(before) => cut,
        2 if is_pair(&before) => End::Whole,
        len if len.is_multiple_of(2) && len >= 4 => End::Whole,
        len if len % 2 == 1 && (len >= 5 || len == 3 && is_group(before)) => cut,
        _ => End::Other,
    }
}

/// Whether a text is a dump with offsets of an odd number of digits: most lines begin with as many
/// digits, and have bytes behind them. The offset at its end is whole.
fn has_offsets(bytes: &[u8]) -> bool {
    let (mut count, mut begin_alike, mut len) = (0, 0, None);
    for line in lines(bytes) {
        let mut words = utf8(line.text).split_whitespace();
        let (Some(first), Some(_)) = (words.next(), words.next()) else {
            continue;
        };
        count += 1;
        if len.is_none() && first.len() % 2 == 1 && is_hex(first) {
            len = Some(first.len());
        }
        begin_alike += usize::from(len == Some(first.len()) && is_hex(first));
    }
    2 * begin_alike > count
}

/// The text without the digits that are left over where lines are cut inside a byte, and the
/// numbers of these lines. Each digit becomes a blank, so that all places stay.
pub(super) fn without_cut_bytes(bytes: &[u8]) -> (Cow<'_, [u8]>, Vec<usize>) {
    let nothing = (Cow::Borrowed(bytes), Vec::new());
    if core::str::from_utf8(bytes).is_err() || has_offsets(bytes) {
        return nothing;
    }
    let (mut whole, mut cuts) = (0, Vec::new());
    for line in lines(bytes) {
        match end_of(utf8(line.text)) {
            End::Whole => whole += 1,
            End::Cut(at) => cuts.push((line.number, line.offset + at)),
            End::Loose => return nothing,
            End::Other => {}
        }
    }
    if cuts.is_empty() || cuts.len() > whole {
        return nothing;
    }
    let mut text = bytes.to_vec();
    cuts.iter().for_each(|(_, at)| text[*at] = b' ');
    let numbers = cuts.into_iter().map(|(number, _)| number);
    (Cow::Owned(text), numbers.collect())
}

/// A reader of a format.
type Read = fn(&[u8], &Options, &mut Imported) -> Result<(), ImportError>;

/// Reads a text by `read`, without the lines that it cannot read if they are few.
///
/// # Errors
/// The first error, if there are too many, or if it is no error of a line.
pub(super) fn read(bytes: &[u8], options: &Options, read: Read) -> Result<Imported, ImportError> {
    let (text, cuts) = without_cut_bytes(bytes);
    let mut text = text.into_owned();
    let count = lines(&text)
        .filter(|line| !line.text.trim_ascii().is_empty())
        .count();
    let mut left_out: Vec<ImportError> = Vec::new();
    loop {
        let mut imported = Imported::new();
        let Err(error) = read(&text, options, &mut imported) else {
            if let Some(first) = cuts.first() {
                let (lines, cuts) = (in_words(cuts.len()), cuts.len());
                let each = if cuts == 1 { "its" } else { "their" };
                imported.note(format!(
                    "{lines} cut inside a byte, line {first}{}: {each} other bytes are kept",
                    if cuts == 1 { "" } else { " is the first" },
                ));
            }
            if let Some(first) = left_out.first() {
                let lines = in_words(left_out.len());
                imported.note(format!("{lines} left out, as damaged; the first: {first}"));
            }
            return Ok(imported);
        };
        let is_damage = error.line > 0
            && (left_out.len() + 1) * SHARE <= count
            && (left_out.len() + 1) * text.len() <= READ_AGAIN
            && blank(&mut text, error.line);
        if !is_damage {
            return Err(left_out.into_iter().next().unwrap_or(error));
        }
        left_out.push(error);
    }
}

fn in_words(lines: usize) -> String {
    match lines {
        1 => "1 line is".to_owned(),
        lines => format!("{lines} lines are"),
    }
}

/// Overwrites the line with this number; `false` if it is empty already.
fn blank(text: &mut [u8], number: usize) -> bool {
    let found = lines(text).nth(number - 1);
    let Some(range) = found.map(|line| line.offset..line.offset + line.text.len()) else {
        return false;
    };
    let line = &mut text[range];
    if line.trim_ascii().is_empty() {
        return false;
    }
    line.fill(b' ');
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, open};
    use std::path::Path;

    /// The format of a text, its bytes, and its notes about damage.
    fn told(text: &str) -> (Option<Format>, Vec<Vec<u8>>, Vec<String>) {
        let opened = open(text.as_bytes(), Path::new("a.log")).expect("a known kind");
        let Some(format) = opened.format else {
            return (None, Vec::new(), Vec::new());
        };
        let found = super::super::read(&opened.bytes, format, &Options::default());
        let found = found.unwrap_or_else(|error| panic!("{text}: {error}"));
        let bytes = found.records().iter().map(|one| one.bytes.to_vec());
        let is_damage = |note: &&String| note.contains("cut") || note.contains("left out");
        let notes = found.notes.iter().filter(is_damage).cloned();
        (Some(format), bytes.collect(), notes.collect())
    }

    const FIRST: [u8; 3] = [1, 4, 0x2A];

    /// Guards against a damaged line that makes a log look like another format, or that loses good
    /// bytes. The second line is cut inside its third byte, the last one inside its second.
    #[test]
    fn a_line_that_is_cut_keeps_its_whole_bytes() {
        let heads = [
            ("", Format::Hex),
            ("TX: ", Format::Hex),
            ("12:00:00.100 ", Format::Hex),
            ("[12:00:00.100] RX: ", Format::Hex),
            ("I (120) uart: RX ", Format::Log),
        ];
        for (head, format) in heads {
            let text = format!(
                "{head}01 04 2A\n{head}05 06 2\n{head}01 04 2A\n{head}01 04 2A\n{head}07 08 0"
            );
            let expected = [&FIRST[..], &[5, 6], &FIRST, &FIRST, &[7, 8]];
            let (found, bytes, notes) = told(&text);
            assert_eq!(found, Some(format), "{head}");
            assert_eq!(bytes, expected, "{head}");
            let note = "2 lines are cut inside a byte, line 2 is the first: their other bytes are \
                        kept";
            assert_eq!(notes, [note], "{head}");
        }
        // Numbers without leading zeros are whole.
        assert_eq!(told("0A 1 2B\n0B 11 2\n0A 1 2B\n").2, [""; 0]);
        // The offset at the end of a dump of hexdump or od is whole, too.
        for dump in [
            "0000000 0201 0403\n0000004 0005\n0000005\n",
            "0000000 001 002\n0000002\n",
        ] {
            assert_eq!(without_cut_bytes(dump.as_bytes()).1, [0; 0], "{dump}");
        }
    }

    /// In each form of lines, a line of another kind is left out alone: the lines around it are
    /// read.
    #[test]
    fn a_line_that_cannot_be_read_is_left_out_and_counted() {
        let hex = "TX: AB 24\nRX: 0A 0B\n";
        let table = "0.1;TX;AB 24\n0.2;RX;0A 0B\n";
        for (head, good, bad, format) in [
            ("", hex, "RX: 0A ?? 0B\n", Format::Hex),
            (
                "Time;Direction;Data\n",
                table,
                "0.3;RX;0A ZZ\n",
                Format::Table,
            ),
            (
                "Time;Direction;Data\n",
                table,
                "yesterday;RX;0A\n",
                Format::Table,
            ),
            (
                "",
                "000000.000 TX   0000  AB 24                                            .$\n\
                 000000.001 RX   0000  0A 0B                                            ..\n",
                "000000.002 RX   0000\n",
                Format::Spy,
            ),
        ] {
            let text = format!("{head}{good}{bad}{good}{good}");
            let (found, bytes, notes) = told(&text);
            assert_eq!(found, Some(format), "{bad}");
            assert_eq!(bytes.concat(), [0xAB, 0x24, 0x0A, 0x0B].repeat(3), "{bad}");
            let line = head.lines().count() + 3;
            let wanted = format!("1 line is left out, as damaged; the first: line {line} (byte ");
            assert!(
                notes.len() == 1 && notes[0].starts_with(&wanted),
                "{notes:?}"
            );
        }
        // Half of the lines are no damage.
        let text = format!("Time;Direction;Data\n{table}1;RX;Z\n2;RX;Z\n");
        let error = read(
            text.as_bytes(),
            &Options::default(),
            super::super::table::read,
        );
        assert_eq!(error.expect_err("too many").line, 4);
    }

    /// Levels without times, and a file without a byte, name the missing part.
    #[test]
    fn levels_without_times_and_an_empty_file_are_named() {
        for (text, words) in [
            ("D0\n0\n1\n0\n", "levels of channels without times"),
            ("D0,D1\n0,1\n1,1\n", "levels of channels without times"),
            ("", "is empty"),
            ("\n \n", "is empty"),
        ] {
            let error = open(text.as_bytes(), Path::new("a.csv")).map(|opened| opened.format);
            let error = error.expect_err("no bytes").to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
        assert_eq!(told("D0 0A\n01 D1\n").0, Some(Format::Hex));
    }
    /// The end of a line: whole, loose, other, or the place of a digit that is left over.
    #[test]
    fn the_end_of_a_line_shows_whether_it_is_cut() {
        let end = |line: &str| match end_of(line) {
            End::Whole => "whole".to_owned(),
            End::Cut(at) => at.to_string(),
            End::Loose => "loose".to_owned(),
            End::Other => "other".to_owned(),
        };
        for (line, expected) in [
            ("01 04 2A", "whole"),
            ("01,04;2A", "whole"),
            ("ABCD", "whole"),
            ("01 04 2", "6"),
            ("01 04 2  ", "6"),
            ("ABCD 2", "5"),
            ("ABCDE", "4"),
            ("ABCD 123", "7"),
            ("0A 1 2B", "loose"),
            ("0A 1 2B 4", "loose"),
            ("01 2", "other"),
            ("x 04 2", "other"),
            ("ABC", "other"),
            ("12 ABC", "other"),
            ("01", "other"),
            ("01 zz", "other"),
            ("", "other"),
        ] {
            assert_eq!(end(line), expected, "{line}");
        }
    }

    /// More than half of the lines begin with as many digits, an odd number of them.
    #[test]
    fn a_dump_with_offsets_of_an_odd_length_is_whole() {
        let has = |text: &str| has_offsets(text.as_bytes());
        assert!(has("0000000 0201\n0000004 0005\n0000005\n"));
        assert!(!has("0000000 01\nabcd 01\n") && has("0000000 01\nabcd 01\n0000001 02\n"));
        assert!(!has("00000000 01\n00000001 02\n") && !has("000zz00 01\n") && !has(""));
    }

    /// As many lines may be cut as are whole; with more of them the text is of another kind.
    #[test]
    fn no_more_lines_are_cut_than_whole() {
        let cuts = |text: &str| without_cut_bytes(text.as_bytes()).1;
        assert_eq!(cuts("01 04 2A\n05 06 2\n"), [2]);
        assert_eq!(cuts("01 04 2A\n05 06 2\n05 06 3\n"), [0; 0]);
        assert_eq!(cuts("01 04 2A\n"), [0; 0]);
    }

    /// The note counts the lines: one with a cut inside a byte, and one of four that is left out.
    #[test]
    fn a_single_cut_line_is_noted_alone() {
        let (_, bytes, notes) = told("TX: 01 04 2A\nTX: 01 04 2A\nTX: 05 06 2\n");
        assert_eq!(bytes.concat(), [1, 4, 0x2A, 1, 4, 0x2A, 5, 6]);
        let note = "1 line is cut inside a byte, line 3: its other bytes are kept";
        assert_eq!(notes, [note]);
        let lines = |good: usize| {
            let text = "0.1;TX;AB 24\n".repeat(good) + "0.3;RX;0A ZZ\n";
            let text = format!("Time;Direction;Data\n{text}");
            read(
                text.as_bytes(),
                &Options::default(),
                super::super::table::read,
            )
            .is_ok()
        };
        assert_eq!([1, 2].map(lines), [false, true]);
    }

    /// A line is overwritten by blanks once.
    #[test]
    fn a_line_becomes_blank_once() {
        let mut text = b"ab\ncd\n".to_vec();
        assert!(blank(&mut text, 2) && !blank(&mut text, 2) && !blank(&mut text, 3));
        assert_eq!(text, b"ab\n  \n");
    }
}
