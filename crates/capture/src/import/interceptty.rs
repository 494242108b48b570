//! interceptty's log of a port and the program that uses it.
//!
//! ```text
//! < 0xab (.)            from the program to the device, a byte a line
//! > <tab>0x24 ($)       from the device
//! [07:58 50.596918]> <tab>ab(.):24($)     -T and -e: a time, and bytes up to the end of a line
//! ```
//!
//! The format is known from the program's source. Without -T there are no times.

use super::Look;
use super::hextext::{Clock, Turns};
use super::imported::{ImportError, Imported, Options, Untimed};
use super::text::{Line, decimal_nanos, lines, moment};
use crate::Kind;
use engine::hex;

struct Row {
    line: usize,
    /// Time since midnight; `None` for a row that continues, or without -T.
    nanos: Option<u64>,
    is_received: bool,
    bytes: Vec<u8>,
}

fn row(line: &Line<'_>) -> Option<Row> {
    // A byte above 127 is written unchanged as text, which is not valid UTF-8.
    let text = &*String::from_utf8_lossy(line.text);
    let (nanos, rest) = match text.strip_prefix('[') {
        Some(inside) => {
            let (time, rest) = inside.split_once(']')?;
            (Some(time_of_day(time)?), rest)
        }
        None => (None, text.trim_start()),
    };
    let (is_received, rest) = match rest.split_at_checked(2)? {
        ("> ", rest) => (true, rest.trim_start_matches('\t')),
        ("< ", rest) => (false, rest),
        _ => return None,
    };
    let mut bytes = Vec::new();
    let mut rest = rest.trim_end();
    while !rest.is_empty() {
        let digits = rest.strip_prefix("0x").unwrap_or(rest);
        bytes.push(hex::byte(digits.as_bytes().get(..2)?)?);
        let behind = behind_text(digits.get(2..)?)?;
        // With a byte a line, each byte has its prefix; several bytes are separated by colons.
        rest = match behind.strip_prefix(':') {
            Some(behind) => behind,
            None if behind.is_empty() => "",
            None => return None,
        };
    }
    (!bytes.is_empty()).then_some(Row {
        line: line.number,
        nanos,
        is_received,
        bytes,
    })
}

/// Text after the byte, ` (A)` or `([CR])`, if present.
fn behind_text(text: &str) -> Option<&str> {
    let Some(inside) = text.trim_start_matches(' ').strip_prefix('(') else {
        return Some(text);
    };
    // The text may itself be a bracket.
    let first = inside.chars().next()?;
    let (_, behind) = inside[first.len_utf8()..].split_once(')')?;
    Some(behind)
}

/// `07:58 50.596918`.
fn time_of_day(text: &str) -> Option<u64> {
    let (minutes, seconds) = text.split_once(' ')?;
    let (seconds, fraction) = seconds.split_once('.')?;
    let whole = moment("1970-01-01", &format!("{minutes}:{seconds}"), '-')?;
    Some(whole * 1_000_000_000 + decimal_nanos(&format!("0.{fraction}"))?)
}

fn is_note(text: &[u8]) -> bool {
    text.is_empty() || text.starts_with(b"#")
}

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let rows = lines(bytes).filter(|line| !is_note(line.text));
    let mut rows = rows.take(super::LINES_LOOKED_AT).peekable();
    rows.peek()?;
    let is_own = |line: Line<'_>| {
        let text = line.text;
        let is_prefixed = text.windows(2).any(|two| two == b"0x") || text.starts_with(b"[");
        is_prefixed && row(&line).is_some()
    };
    rows.all(is_own).then_some(Look::Surely)
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let rows = lines(bytes).filter(|line| !is_note(line.text));
    let expected = "expected \"> 0xAB (.)\" or \"< 0xAB (.)\", as interceptty writes";
    let rows: Result<Vec<Row>, ImportError> = rows
        .map(|line| row(&line).ok_or_else(|| line.wrong(expected)))
        .collect();
    let rows = rows?;
    if rows.iter().any(|row| row.nanos.is_some()) {
        timed(&rows, options, out);
        return Ok(());
    }
    // Neighbours of one direction arrived together, as far as the log shows.
    let mut times = Untimed::new(options, out);
    for run in rows.chunk_by(|a, b| a.is_received == b.is_received) {
        let bytes: Vec<u8> = run.iter().flat_map(|row| row.bytes.clone()).collect();
        times.stream(options.way(run[0].is_received), &bytes, out);
        times.pause();
    }
    Ok(())
}

fn timed(rows: &[Row], options: &Options, out: &mut Imported) {
    out.clock = "virtual";
    out.note("interceptty's times are of the day: the capture counts from midnight");
    let link = out.link(&options.link, options);
    let (mut turns, mut last) = (Turns::of(Clock::Day, core::iter::empty()), 0);
    for row in rows {
        let nanos = row.nanos.map_or(last, |nanos| turns.nanos(nanos, row.line));
        last = nanos;
        out.line = row.line;
        out.push(
            link,
            nanos,
            options.way(row.is_received),
            Kind::Data,
            &row.bytes,
        );
    }
    turns.note().into_iter().for_each(|note| out.note(note));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    fn told(text: &str) -> Vec<(u64, Direction, Vec<u8>)> {
        assert_eq!(Format::detect(text.as_bytes()), Some(Format::Interceptty));
        let options = Options {
            baud: Some(1_000_000),
            ..Options::default()
        };
        let found = read_format(text.as_bytes(), Format::Interceptty, &options).expect("sound");
        let tuple =
            |one: &crate::Record| (one.at.as_nanos() / 1000, one.direction, one.bytes.to_vec());
        found.records().iter().map(tuple).collect()
    }

    /// The format of version 0.6 for each byte. At 1 Mbaud a character takes 10 us; the two
    /// directions are four characters apart.
    #[test]
    fn bytes_of_both_directions_are_read_in_their_order() {
        let text = "< 0xab (\u{fffd})\n< 0x24 ($)\n> \t0x28 (()\n> \t0x29 ())\n> \t0x0d ([CR])\n";
        let (up, down) = (Direction::ToMaster, Direction::ToDevice);
        let expected = [
            (20, down, vec![0xAB, 0x24]),
            (90, up, vec![0x28, 0x29, 0x0D]),
        ];
        assert_eq!(told(text), expected);
    }

    /// The output with -T and -e: 07:58:50.596918 is 28,730,596,918 us after midnight.
    #[test]
    fn times_and_lines_are_read() {
        let text = "# Using '[LF]' as end of line char\n\
                    [07:58 50.596918]< 41(A):54(T):0a([LF])\n\
                    [07:58 50.600000]> \t4f(O):4b(K)\n";
        let expected = [
            (28_730_596_918, Direction::ToDevice, b"AT\n".to_vec()),
            (28_730_600_000, Direction::ToMaster, b"OK".to_vec()),
        ];
        assert_eq!(told(text), expected);
    }
}
