//! Lines of a dump: rows, heads, and lines without data.

use crate::import::ImportError;
use crate::import::hextext::log;
use crate::import::text::{self, Line};
use crate::import::textlog;

/// A line of a dump.
#[derive(Clone, Debug)]
pub(super) enum Row {
    /// A repetition of the previous row.
    Again,
    /// An offset and cells.
    At {
        offset: String,
        /// The rest of the line; empty at the end.
        rest: String,
        /// The text of a log before the row.
        before: String,
        is_indented: bool,
    },
    /// The bytes of the previous row in another form, as od writes with two -t.
    Same(String),
    /// Words before a message.
    Head(String),
}

/// All lines with content; an omitted prompt is noted.
pub(super) fn rows<'a>(
    bytes: &'a [u8],
    notes: &mut Vec<String>,
) -> Result<Vec<(Line<'a>, Row)>, ImportError> {
    let full = || text::lines(bytes).filter(|line| !line.text.trim_ascii().is_empty());
    let last = full().last().map(|line| line.number);
    let mut rows: Vec<(Line<'a>, Row)> = Vec::new();
    for line in full() {
        let text = plain(line.text);
        if is_mute(&text) {
            continue;
        }
        if let Some(row) = row(&text, rows.last().map(|(_, row)| row)) {
            rows.push((line, row));
            continue;
        }
        let is_edge = rows.is_empty() || Some(line.number) == last;
        if is_edge && is_prompt(&text) {
            notes.push(format!(
                "line {} is a prompt and skipped: {text}",
                line.number
            ));
            continue;
        }
        if !rows.is_empty() && Some(line.number) == last && is_cut_offset(&text) {
            notes.push(format!("line {} is cut and left out: {text}", line.number));
            continue;
        }
        // Words in the middle of a dump are damage, unless a message begins after them.
        rows.push((line, Row::Head(text)));
    }
    let is_row = |row: &Row| matches!(row, Row::At { .. });
    if let Some((line, Row::Head(_))) = rows.last()
        && !rows.iter().any(|(_, row)| is_row(row))
    {
        return Err(line.wrong("expected an offset and bytes, as xxd, hexdump and od write"));
    }
    let mut pairs = rows.windows(2);
    if let Some([_, (line, _)]) = pairs.find(|pair| {
        matches!(
            pair,
            [
                (_, Row::Head(_)),
                (_, Row::Head(_) | Row::Again | Row::Same(_))
            ]
        )
    }) {
        return Err(line.wrong("expected an offset and bytes, as xxd, hexdump and od write"));
    }
    Ok(rows)
}

/// Whether a row is among the first lines.
pub(super) fn begins_with_rows(bytes: &[u8]) -> bool {
    const LINES: usize = 60;
    let mut full = text::lines(bytes).filter(|line| !line.text.trim_ascii().is_empty());
    let mut full = full.by_ref().take(LINES);
    full.any(|line| matches!(row(&plain(line.text), None), Some(Row::At { .. })))
}

/// The text without the frames of hexyl, and without its column of characters.
fn plain(text: &[u8]) -> String {
    let text = log::plain(text);
    let Some(inside) = text.trim_start().strip_prefix('\u{2502}') else {
        return text;
    };
    let mut columns = inside.split('\u{2502}');
    let offset = columns.next().unwrap_or_default().trim();
    let cells: Vec<&str> = columns.collect();
    // Two panels of cells and two of characters, or one of each.
    let half = cells.len() / 2;
    let cells = cells[..half].join(" ").replace('\u{250A}', " ");
    format!("{offset}  {}", cells.trim()).trim_end().to_owned()
}

/// Whether a line has no content: a ruler of columns, a frame, the head of a table.
fn is_mute(text: &str) -> bool {
    let trimmed = text.trim();
    let is_drawn =
        |c: char| "-=+_\u{2500}\u{250C}\u{252C}\u{2510}\u{2514}\u{2534}\u{2518}".contains(c);
    if trimmed.chars().all(|c| is_drawn(c) || c.is_whitespace()) || trimmed.starts_with("```") {
        return true;
    }
    if textlog::is_of_putty(trimmed) {
        return true;
    }
    let lower = trimmed.to_ascii_lowercase();
    if ["offset", "label:", "path:", "address"]
        .iter()
        .any(|start| lower.starts_with(start))
    {
        return true;
    }
    // 00 01 02 .. 0F, as an editor writes above its columns.
    let words = trimmed.split_ascii_whitespace();
    let short = words.take_while(|word| word.len() <= 2);
    let numbers = short.map_while(|word| u32::from_str_radix(word, 16).ok());
    let count = numbers
        .zip(0..)
        .take_while(|(number, index)| number == index);
    count.count() >= 8
}

/// Whether a line is a shell prompt, with or without the command that made the dump.
fn is_prompt(text: &str) -> bool {
    const TOOLS: [&str; 8] = [
        "xxd",
        "hexdump",
        "hd",
        "od",
        "Format-Hex",
        "tshark",
        "hexyl",
        "certutil",
    ];
    let trimmed = text.trim();
    let marks = ['$', '#', '%', '>'];
    let Some(at) = trimmed.find(marks) else {
        return false;
    };
    let command = trimmed[at + 1..].trim();
    let mut words = command.split([' ', '|', '/']);
    command.is_empty() || words.any(|word| TOOLS.contains(&word))
}

fn row(text: &str, last: Option<&Row>) -> Option<Row> {
    let trimmed = text.trim_start();
    let indent = text.len() - trimmed.len();
    if trimmed.trim_end() == "*" {
        return Some(Row::Again);
    }
    if let Some((offset, rest)) = at(trimmed) {
        return Some(Row::At {
            offset,
            rest,
            before: String::new(),
            is_indented: indent > 0,
        });
    }
    if let Some(
        Row::At {
            offset,
            is_indented: false,
            ..
        }
        | Row::Same(offset),
    ) = last
        && indent >= 5
    {
        // The cells begin in the same column as those of the row above.
        let width = match last {
            Some(Row::Same(_)) => 0,
            _ => offset.len(),
        };
        return Some(Row::Same(text.get(width..).unwrap_or_default().to_owned()));
    }
    // A log writes its own words before the row.
    let marks = [": ", "] ", ")\t", "| ", ") "];
    let mut starts: Vec<usize> = marks
        .iter()
        .flat_map(|mark| text.match_indices(mark).map(|(at, mark)| at + mark.len()))
        .collect();
    starts.sort_unstable();
    starts.into_iter().find_map(|start| {
        let (offset, rest) = at(text[start..].trim_start())?;
        let is_row = rest.split_ascii_whitespace().next().is_some_and(is_cell);
        is_row.then(|| Row::At {
            offset,
            rest,
            before: text[..start].to_owned(),
            is_indented: false,
        })
    })
}

/// Whether a line is the beginning of an offset, too short for a whole one.
fn is_cut_offset(text: &str) -> bool {
    let digits = text.trim().trim_start_matches("0x");
    digits.len() < 4 && digits.bytes().all(|byte| byte.is_ascii_hexdigit())
}

fn is_cell(word: &str) -> bool {
    word.len().is_multiple_of(2) && word.bytes().all(|byte| byte.is_ascii_hexdigit())
}

/// The offset at the beginning of a line, and the rest.
fn at(text: &str) -> Option<(String, String)> {
    let end = text.find([' ', '\t']).unwrap_or(text.len());
    let (mut offset, mut rest) = text.split_at(end);
    let has_prefix = offset.starts_with("0x");
    offset = offset.strip_prefix("0x").unwrap_or(offset);
    // gdb names the symbol after the address.
    let symbol = rest
        .trim_start()
        .strip_prefix('<')
        .and_then(|rest| rest.split_once(">:"));
    let mut colon = offset.ends_with(':');
    if let Some((_, behind)) = symbol.filter(|_| has_prefix) {
        (rest, colon) = (behind, true);
    }
    let digits = offset.trim_end_matches([':', 'h']);
    let least = if colon { 2 } else { 4 };
    let is_offset =
        (least..=16).contains(&digits.len()) && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    let rest = if rest.trim().is_empty() { "" } else { rest };
    let mark = if colon { ":" } else { "" };
    is_offset.then(|| (format!("{digits}{mark}"), rest.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rulers_frames_and_heads_have_no_content() {
        for text in [
            "-----",
            "+---+ ===",
            "```hex",
            "Offset(h) 00 01",
            "Label: x",
            "Path: x",
            "ADDRESS",
            "   00 01 02 03 04 05 06 07 08",
            "0 1 2 3 4 5 6 7",
        ] {
            assert!(is_mute(text), "{text}");
        }
        for text in [
            "00 01 02 03 04 05 06",
            "00 01 02 04 05 06 07 08 09",
            "0000 01",
            "a -- b",
        ] {
            assert!(!is_mute(text), "{text}");
        }
    }

    #[test]
    fn a_prompt_ends_with_a_mark_or_has_the_command_of_a_dump() {
        for text in [
            "$",
            "me@pc:~$ ",
            "me@pc:~$ xxd a",
            "# cat a|hexdump -C",
            "> /usr/bin/od -c a",
        ] {
            assert!(is_prompt(text), "{text}");
        }
        for text in ["me@pc:~$ ls", "100% sure", "cat a | xxd", ""] {
            assert!(!is_prompt(text), "{text}");
        }
    }

    #[test]
    fn a_short_number_is_a_cut_offset() {
        let cut = ["0x01", "012", "0"].map(is_cut_offset);
        let other = ["0123", "0x0123", "0g"].map(is_cut_offset);
        assert_eq!((cut, other), ([true; 3], [false; 3]));
    }

    /// An offset with a colon has two digits or more, one without a colon four or more; at most
    /// sixteen.
    #[test]
    fn an_offset_begins_a_row() {
        for (text, offset, rest) in [
            ("00000000: 0a0b", "00000000:", " 0a0b"),
            ("00: 0a", "00:", " 0a"),
            ("0000 0a", "0000", " 0a"),
            ("0000h 0a", "0000", " 0a"),
            ("0000  ", "0000", ""),
            ("1234567890123456 0a", "1234567890123456", " 0a"),
            ("0x1f00:\t0x01", "1f00:", "\t0x01"),
            ("0x20000000 <buf+8>:\t0x01", "20000000:", "\t0x01"),
            ("20000000 <buf>: 1", "20000000", " <buf>: 1"),
        ] {
            assert_eq!(
                at(text),
                Some((offset.to_owned(), rest.to_owned())),
                "{text}"
            );
        }
        for text in [
            "0: 0a",
            "00 0a",
            "000 0a",
            "12345678901234567 0a",
            "000g 0a",
            "words",
        ] {
            assert_eq!(at(text), None, "{text}");
        }
    }

    /// A row that begins in the column of the cells above it has the same bytes; a log has its own
    /// words before a row.
    #[test]
    fn rows_are_told_from_each_other() {
        assert!(matches!(row("  * ", None), Some(Row::Again)));
        assert!(matches!(
            row("0000 0a", None),
            Some(Row::At {
                is_indented: false,
                ..
            })
        ));
        let indented = row("  0000 0a", None);
        assert!(matches!(
            indented,
            Some(Row::At {
                is_indented: true,
                ..
            })
        ));
        let above = row("0000000 0201", None);
        let same = row("        a   b", above.as_ref());
        assert!(matches!(same, Some(Row::Same(cells)) if cells == " a   b"));
        assert!(row("     a", above.as_ref()).is_some() && row("    a", above.as_ref()).is_none());
        assert!(row("        a   b", indented.as_ref()).is_none());
        let Some(Row::At { before, offset, .. }) = row("I (12) hex: 0000: 0a 0b", None) else {
            panic!("a row of a log");
        };
        assert_eq!((&*before, &*offset), ("I (12) hex: ", "0000:"));
        assert!(row("I (12) hex: words", None).is_none() && row("hex: 0000 word", None).is_none());
    }

    #[test]
    fn a_dump_begins_within_sixty_lines() {
        let text = |count: usize| "words\n".repeat(count) + "0000 0a\n";
        assert!(begins_with_rows(text(59).as_bytes()) && !begins_with_rows(text(60).as_bytes()));
    }

    /// Words alone are no dump; words behind its rows may be damage.
    #[test]
    fn words_need_rows() {
        let of = |text: &str| rows(text.as_bytes(), &mut Vec::new()).map(|rows| rows.len());
        assert!(of("words\n").is_err() && of("words\nmore\n0000 0a\n").is_err());
        assert_eq!(of("0000 0a\nwords\n").ok(), Some(2));
        assert_eq!(of("words\n0000 0a\nwords\n").ok(), Some(3));
        assert!(of("words\n*\n0000 0a\n").is_err());
    }
}
