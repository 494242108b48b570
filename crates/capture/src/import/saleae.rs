//! Exports of Saleae's Logic.
//!
//! ```text
//! Time [s],Value,Parity Error,Framing Error        the serial analyzer's export
//! 0.000105,0xFA,,Error
//! name,type,start_time,duration,data,error         the table of Logic 2
//! "Async Serial","data",0.0001,8.6e-05,0xFA,framing
//! ```
//!
//! Form known from the analyzer's source and from files of others, not from a run. The value must
//! be in hex: in other radices the two cannot be told apart.

use super::text::{Line, decimal_nanos, lines, moment, utf8};
use super::{ImportError, Imported, Options};
use crate::Kind;
use engine::hex;
use protocols::LineEvent;

const FRAMING: Kind = Kind::Line(LineEvent::FramingError);
/// The event's number in the capture; lines of ours have no parity.
const PARITY: Kind = Kind::Other(8);

/// Whether a line is the head of such a file.
pub(super) fn is_head(text: &[u8]) -> bool {
    let cells = cells(utf8(text));
    Columns::of(&cells).is_some()
}

/// Where in a row what stands.
struct Columns {
    time: usize,
    duration: Option<usize>,
    value: usize,
    /// Columns of errors, and what one there means if it does not say itself.
    errors: Vec<(usize, Kind)>,
    kind: Option<usize>,
}

impl Columns {
    fn of(cells: &[String]) -> Option<Self> {
        let find = |name: &str| {
            cells
                .iter()
                .position(|cell| cell.eq_ignore_ascii_case(name))
        };
        if let (Some(time), Some(value)) = (find("Time [s]"), find("Value")) {
            let errors = [("Parity Error", PARITY), ("Framing Error", FRAMING)];
            let errors = errors
                .into_iter()
                .filter_map(|(name, kind)| Some((find(name)?, kind)));
            return Some(Self {
                time,
                duration: None,
                value,
                errors: errors.collect(),
                kind: None,
            });
        }
        Some(Self {
            time: find("start_time")?,
            duration: Some(find("duration")?),
            value: find("data")?,
            errors: find("error")
                .map(|index| (index, FRAMING))
                .into_iter()
                .collect(),
            kind: Some(find("type")?),
        })
    }
}

/// The cells of a row; a quoted one may hold commas, and quotes twice.
fn cells(row: &str) -> Vec<String> {
    let (mut cells, mut cell, mut quoted) = (Vec::new(), String::new(), false);
    let mut chars = row.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '"' if quoted && chars.next_if_eq(&'"').is_some() => cell.push('"'),
            '"' => quoted = !quoted,
            ',' if !quoted => cells.push(core::mem::take(&mut cell)),
            c => cell.push(c),
        }
    }
    cells.push(cell);
    cells.iter().map(|cell| cell.trim().to_owned()).collect()
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    out.clock = "virtual";
    let link = out.link(&options.link, options);
    let mut rows = lines(bytes).filter(|line| !line.text.is_empty());
    let Some(head) = rows.next() else {
        return Ok(());
    };
    let columns = Columns::of(&cells(utf8(head.text))).ok_or_else(|| {
        head.wrong("expected \"Time [s],Value,..\" or \"name,type,start_time,duration,data,..\"")
    })?;
    for line in rows {
        let row = cells(utf8(line.text));
        let cell = |index: usize| row.get(index).map_or("", String::as_str);
        if columns.kind.is_some_and(|kind| cell(kind) != "data") {
            continue;
        }
        let (nanos, is_date) = time(cell(columns.time))
            .ok_or_else(|| line.wrong("expected seconds, or a date, as the time"))?;
        if is_date {
            out.clock = "utc";
        }
        let took = match columns.duration {
            Some(index) => decimal_nanos(cell(index))
                .ok_or_else(|| line.wrong("expected seconds as the duration"))?,
            None => options.byte_nanos(1),
        };
        let errors = columns.errors.iter();
        let mut errors = errors.map(|&(index, kind)| (cell(index), kind));
        let kind = match errors.find(|(error, _)| !error.is_empty()) {
            None => Kind::Data,
            Some(("Error", kind)) => kind,
            Some(("framing", _)) => FRAMING,
            Some(("parity", _)) => PARITY,
            Some(_) => return Err(line.wrong("expected no error, Error, framing or parity")),
        };
        let byte = value(line, cell(columns.value))?;
        let bytes = if kind == Kind::Data { &[byte][..] } else { &[] };
        out.push(
            link,
            nanos.saturating_add(took),
            options.direction,
            kind,
            bytes,
        );
    }
    Ok(())
}

/// Nanoseconds, and whether they count from 1970.
fn time(text: &str) -> Option<(u64, bool)> {
    if let Some((date, time)) = text.split_once('T') {
        let time = time.trim_end_matches('Z');
        let time = time.strip_suffix("+00:00").unwrap_or(time);
        let (time, fraction) = time.split_once('.').unwrap_or((time, "0"));
        let seconds = moment(date, time, '-')?.checked_mul(1_000_000_000)?;
        return Some((seconds + decimal_nanos(&format!("0.{fraction}"))?, true));
    }
    Some((decimal_nanos(text)?, false))
}

fn value(line: Line<'_>, text: &str) -> Result<u8, ImportError> {
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let digits = digits.filter(|digits| !digits.is_empty());
    let byte = digits.and_then(|digits| hex::byte(format!("{digits:0>2}").as_bytes()));
    byte.ok_or_else(|| {
        let found = text.escape_default();
        line.wrong(format!(
            "found value \"{found}\", expected hex as 0xFA: export in hexadecimal"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RFC 4180: a quoted cell may hold commas, and quotes twice.
    #[test]
    fn a_row_is_cut_at_its_commas() {
        assert_eq!(cells("a, b ,,c"), ["a", "b", "", "c"]);
        assert_eq!(
            cells("\"a,b\",\"say \"\"no\"\"\",c"),
            ["a,b", "say \"no\"", "c"]
        );
        assert_eq!(cells("\"\",\"\"\"\""), ["", "\""]);
        assert_eq!(cells(""), [""]);
    }

    /// Both forms have their columns anywhere, in capitals or not; without a time or a value it is
    /// none of them.
    #[test]
    fn a_head_names_its_columns_in_any_order() {
        assert!(is_head(b"Time [s],Value,Parity Error,Framing Error"));
        assert!(is_head(b"value,TIME [S]"));
        assert!(is_head(
            b"\"name\",\"type\",\"start_time\",\"duration\",\"data\""
        ));
        for none in [
            &b"Time [s],Values"[..],
            b"Value",
            b"type,start_time,duration",
            b"",
            b"\xFF",
        ] {
            assert!(!is_head(none));
        }
        let columns = Columns::of(&cells("data,error,type,duration,start_time")).expect("one");
        let places = (columns.value, columns.kind, columns.duration, columns.time);
        assert_eq!(places, (0, Some(2), Some(3), 4));
        assert_eq!(columns.errors, [(1, FRAMING)]);
        let head = "Framing Error,Value,Parity Error,Time [s]";
        let columns = Columns::of(&cells(head)).expect("the other");
        assert_eq!(
            (columns.value, columns.kind, columns.duration),
            (1, None, None)
        );
        assert_eq!(columns.errors, [(2, PARITY), (0, FRAMING)]);
    }

    /// Seconds from the start, or a date in universal time, with or without a fraction.
    #[test]
    fn a_time_is_seconds_or_a_date() {
        assert_eq!(time("0.5"), Some((500_000_000, false)));
        let date = Some((1_500_000_000, true));
        assert_eq!(time("1970-01-01T00:00:01.5Z"), date);
        assert_eq!(time("1970-01-01T00:00:01.5+00:00"), date);
        assert_eq!(time("1970-01-01T00:00:01"), Some((1_000_000_000, true)));
        assert_eq!(
            ["1970-01-01T", "x", "1970-01-01T00:00:01.5+01:00"].map(time),
            [None; 3]
        );
    }

    #[test]
    fn a_value_is_hex_with_its_mark() {
        let line = lines(b"row").next().expect("one");
        let of = |text| value(line, text).ok();
        assert_eq!(
            ["0xFA", "0Xfa", "0x7"].map(of),
            [Some(0xFA), Some(0xFA), Some(7)]
        );
        assert_eq!(["FA", "0x", "0x100", "250", ""].map(of), [None; 5]);
    }
}
