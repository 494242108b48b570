//! Tables of messages with columns of any names: CSV with commas, semicolons or tabs, and JSON.
//!
//! ```text
//! Time;Direction;Data                     a row a message, the bytes in hex
//! 0.000501;TX;AB 24 0A 00 D9
//! 0,000501;0x41                           seconds and a byte, without names
//! {"ts": 0.5, "dir": "rx", "data": "ab240a00d9"}     a line an object, or a list of objects
//! ```
//!
//! The columns are identified by their names. A table needs bytes, and times or directions.

use serde_json::Value;

use super::Look;
use super::cells;
use super::hextext::{
    Around, Base, Clock, Dates, Ends, Message, base_of, bytes_of, emit, is_sent, scaled,
    split_prefix,
};
use super::imported::{ImportError, Imported, Options};
use super::journal;
use super::text::{DECIMAL_COMMA, Line, decimal_nanos, lines, utf8};

const TIMES: [&str; 15] = [
    "time",
    "timestamp",
    "ts",
    "t",
    "date",
    "datetime",
    "elapsed",
    "timems",
    "timeus",
    "timens",
    "times",
    "timestampms",
    "timestampus",
    "relativetime",
    "seconds",
];
const DIRECTIONS: [&str; 9] = [
    "direction",
    "dir",
    "type",
    "function",
    "event",
    "rxtx",
    "txrx",
    "way",
    "request",
];
/// Times since the row before.
const PAUSES: [&str; 7] = [
    "delta",
    "deltatime",
    "timedelta",
    "deltat",
    "dt",
    "interval",
    "pause",
];
const LENGTHS: [&str; 5] = ["length", "len", "size", "count", "bytecount"];
const BYTES: [&str; 15] = [
    "data", "bytes", "hex", "payload", "rawdata", "raw", "message", "frame", "datahex", "hexdata",
    "packet", "content", "msg", "buffer", "rawbytes",
];

/// Rows with the names of their columns.
struct Table<'a> {
    names: Vec<String>,
    rows: Vec<(Line<'a>, Vec<String>)>,
}

/// Indexes of the columns.
struct Columns {
    time: Option<usize>,
    /// Whether the times are those since the row before.
    are_pauses: bool,
    length: Option<usize>,
    direction: Option<usize>,
    bytes: usize,
}

/// A name in lower case, without bracketed units and marks.
fn plain(name: &str) -> String {
    let name = name.to_lowercase();
    name.chars().filter(|c| c.is_alphanumeric()).collect()
}

fn columns(names: &[String]) -> Option<Columns> {
    let names: Vec<String> = names.iter().map(|name| plain(name)).collect();
    let find = |known: &[&str]| names.iter().position(|name| known.contains(&name.as_str()));
    let columns = Columns {
        time: find(&TIMES).or_else(|| names.iter().position(|name| is_pause(name))),
        are_pauses: find(&TIMES).is_none(),
        length: find(&LENGTHS),
        direction: find(&DIRECTIONS),
        bytes: find(&BYTES)?,
    };
    (columns.time.is_some() || columns.direction.is_some()).then_some(columns)
}

/// Whether a column has times since the row before; its name may end with a unit.
fn is_pause(name: &str) -> bool {
    let units = ["", "s", "ms", "us", "\u{b5}s", "ns"];
    let plain = |unit: &&str| {
        name.strip_suffix(unit)
            .is_some_and(|plain| PAUSES.contains(&plain))
    };
    units.iter().any(plain)
}

/// Nanoseconds per unit, from the name of a time column.
fn unit(name: &str) -> Option<u64> {
    let name = name.to_lowercase();
    let units = [
        ("ns", 1),
        ("us", 1_000),
        ("\u{b5}s", 1_000),
        ("ms", 1_000_000),
    ];
    let found = units.iter().find(|(unit, _)| {
        name.ends_with(&format!("_{unit}"))
            || name.contains(&format!("[{unit}]"))
            || name.contains(&format!("({unit})"))
            || plain(&name) == format!("time{unit}")
    });
    found.map(|(_, nanos)| *nanos)
}

fn table(bytes: &[u8]) -> Option<Table<'_>> {
    let first = lines(bytes).find(|line| !line.text.trim_ascii().is_empty())?;
    if first.text.trim_ascii_start().starts_with(b"{") || first.text.trim_ascii().starts_with(b"[")
    {
        return objects(bytes);
    }
    let text = utf8(first.text);
    let dividers = [';', '\t', ','];
    let is_head = |divider: &char| columns(&cut(text, *divider)).is_some();
    let Some(divider) = dividers.into_iter().find(is_head) else {
        return dividers
            .iter()
            .find_map(|divider| without_head(bytes, *divider));
    };
    let rows = cells::rows_of(bytes, divider).map(|row| (row.line, row.cells));
    // A damaged row may have been blanked.
    let is_full = |(_, cells): &(Line<'_>, Vec<String>)| cells.iter().any(|cell| !cell.is_empty());
    let mut rows = rows.filter(is_full);
    let (_, names) = rows.next()?;
    let rows = rows.collect();
    Some(Table { names, rows })
}

/// Rows of a time with a fraction and a marked number, e.g. `0,001;0x41`: no head has to name these
/// columns.
fn without_head(bytes: &[u8], divider: char) -> Option<Table<'_>> {
    let rows: Vec<_> = cells::rows_of(bytes, divider)
        .map(|row| (row.line, row.cells))
        .collect();
    let is_time = |text: &str| text.contains(['.', ',']) && decimal_nanos(text).is_some();
    let is_row = |(_, cells): &(Line<'_>, Vec<String>)| match &cells[..] {
        [time, bytes] => is_time(time) && bytes.starts_with("0x"),
        _ => false,
    };
    let names = ["time", "data"].map(str::to_owned).to_vec();
    (!rows.is_empty() && rows.iter().all(is_row)).then_some(Table { names, rows })
}

fn cut(text: &str, divider: char) -> Vec<String> {
    cells::cells_of(text, divider)
}

/// Reads one object per line, or one list of objects.
fn objects(bytes: &[u8]) -> Option<Table<'_>> {
    let mut all: Vec<(Line<'_>, Value)> = Vec::new();
    let full = || lines(bytes).filter(|line| !line.text.trim_ascii().is_empty());
    let first = full().next()?;
    match serde_json::from_slice::<Value>(bytes) {
        Ok(Value::Array(values)) => all.extend(values.into_iter().map(|value| (first, value))),
        Ok(value) => all.push((first, value)),
        Err(_) => {
            for line in full() {
                let text = utf8(line.text).trim().trim_end_matches(',');
                if !matches!(text, "[" | "]") {
                    all.push((line, serde_json::from_str(text).ok()?));
                }
            }
        }
    }
    let names: Vec<String> = all.first()?.1.as_object()?.keys().cloned().collect();
    let rows = all.into_iter().map(|(line, value)| {
        let cell = |name: &String| match value.get(name) {
            None | Some(Value::Null) => String::new(),
            Some(Value::String(text)) => text.clone(),
            Some(other) => other.to_string(),
        };
        (line, names.iter().map(cell).collect())
    });
    Some(Table {
        rows: rows.collect(),
        names: names.clone(),
    })
}

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    if journal::is(bytes) {
        return journal::look(bytes);
    }
    let table = table(bytes)?;
    let columns = columns(&table.names)?;
    let texts = || {
        table
            .rows
            .iter()
            .filter_map(|(_, cells)| cells.get(columns.bytes))
    };
    let base = base_of(texts().map(String::as_str), Around::Marks).ok()?;
    let sound = texts().filter(|text| !text.is_empty() && bytes_of(text, base).is_ok());
    (sound.count() > 0).then_some(Look::Surely)
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    if journal::is(bytes) {
        return journal::read(bytes, options, out);
    }
    let expected = || {
        ImportError::of_file(
            "expected a table with columns of the time or the direction, and of bytes in hex",
        )
    };
    let table = table(bytes).ok_or_else(expected)?;
    let columns = columns(&table.names).ok_or_else(expected)?;
    let cell = |cells: &[String], column: usize| cells.get(column).cloned().unwrap_or_default();
    let texts: Vec<String> = table
        .rows
        .iter()
        .map(|(_, cells)| cell(cells, columns.bytes))
        .collect();
    let base = base_of(texts.iter().map(String::as_str), Around::Marks);
    let base = base.map_err(ImportError::of_file)?;
    if base == Base::Decimal {
        out.note("the numbers are taken as decimal: none has a letter or a 0x");
    }
    let ways = columns.direction.map(|column| {
        let ways = table.rows.iter().map(|(_, cells)| cells.get(column));
        Ends::of(ways.flatten().map(String::as_str))
    });
    let ends = ways.unwrap_or_default();
    let dates = columns.time.map(|column| {
        let cells = table.rows.iter().filter_map(|(_, cells)| cells.get(column));
        Dates::of(cells.map(String::as_str))
    });
    let dates = dates.unwrap_or_default();
    dates.note().into_iter().for_each(|note| out.note(note));
    ends.notes.iter().for_each(|note| out.note(note));
    let (mut messages, mut skipped, mut sum) = (Vec::new(), 0, 0_u64);
    let mut lengths = Vec::new();
    if columns.are_pauses && columns.time.is_some() {
        out.note("each time is taken as the pause since the row before");
    }
    for ((line, cells), text) in table.rows.iter().zip(&texts) {
        let at = columns.time.map(|column| {
            let text = cell(cells, column);
            time(&dates.told(&text), &table.names[column], *line)
        });
        let mut at = at.transpose();
        if columns.are_pauses
            && let Ok(Some((pause, clock))) = &mut at
        {
            sum = sum.saturating_add(*pause);
            (*pause, *clock) = (sum, Clock::Seconds);
        }
        if text.is_empty() {
            skipped += 1;
            // The pause before a row without bytes counts.
            let pause = at.ok().flatten().filter(|at| at.1 == Clock::Plus);
            messages.extend(pause.map(|at| Message::new(*line, Some(at), None, Vec::new())));
            continue;
        }
        let at = at?;
        let found = bytes_of(text, base).map_err(|message| line.wrong(message))?;
        lengths.extend(columns.length.and_then(|column| {
            let told: usize = cell(cells, column).trim().parse().ok()?;
            Some((*line, told, found.len()))
        }));
        if columns
            .time
            .is_some_and(|column| cell(cells, column).contains(','))
        {
            out.note(DECIMAL_COMMA);
        }
        let way = columns.direction.map(|column| cell(cells, column));
        let way = match way {
            Some(way) => Some(is_sent(&ends.told(&way)).ok_or_else(|| {
                let way = way.escape_default().to_string();
                line.wrong(format!(
                    "found \"{way}\" as the direction, expected TX, RX, read or write"
                ))
            })?),
            None => None,
        };
        messages.push(Message::new(*line, at, way, found));
    }
    // A column that mostly differs from the number of bytes states something else.
    let same = lengths.iter().filter(|(_, told, found)| told == found);
    if same.count() * 2 >= lengths.len()
        && let Some((line, told, found)) = lengths.iter().find(|(_, told, found)| told > found)
    {
        return Err(line.wrong(format!(
            "the row announces {told} bytes but contains {found}: export all bytes"
        )));
    }
    if skipped > 0 {
        out.note(format!("{skipped} rows without bytes are skipped"));
    }
    emit(messages, options, out)
}

/// Parses the time in a cell: a number in the unit of its column, or a date.
fn time(text: &str, name: &str, line: Line<'_>) -> Result<(u64, Clock), ImportError> {
    let plain = text.strip_prefix('+').unwrap_or(text);
    if let (Some(at), "") = (split_prefix(plain).0.at, split_prefix(plain).1)
        && !is_number(plain)
        && at.1 != Clock::Seconds
    {
        return Ok(at);
    }
    let wrong = || line.wrong("expected a number, a date or a time of the day as the time");
    // The number of digits shows whether a time is seconds, milliseconds, microseconds or
    // nanoseconds since 1970.
    let unit = unit(name).unwrap_or(match plain.find(['.', ',']).unwrap_or(plain.len()) {
        0..=11 => 1_000_000_000,
        12..=14 => 1_000_000,
        15..=17 => 1_000,
        _ => 1,
    });
    let nanos = scaled(plain, unit)
        .or_else(|| Some(decimal_nanos(plain)? / (1_000_000_000 / unit)))
        .ok_or_else(wrong)?;
    let clock = match nanos {
        _ if plain != text => Clock::Plus,
        SINCE_1970.. => Clock::Utc,
        _ => Clock::Seconds,
    };
    Ok((nanos, clock))
}

/// Nanoseconds from 1970 to 2001: longer times count from 1970.
const SINCE_1970: u64 = 1_000_000_000_000_000_000;

/// Whether a cell is a number, whose unit the name of the column tells.
fn is_number(text: &str) -> bool {
    text.bytes()
        .all(|byte| byte.is_ascii_digit() || byte == b'.')
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    fn told(text: &str) -> Result<Vec<(u64, bool, Vec<u8>)>, String> {
        assert_eq!(
            Format::detect(text.as_bytes()),
            Some(Format::Table),
            "{text}"
        );
        let found = read_format(text.as_bytes(), Format::Table, &Options::default());
        let found = found.map_err(|error| error.to_string())?;
        let one = |one: &crate::Record| {
            let is_sent = one.direction == Direction::ToDevice;
            (one.at.as_nanos() / 1_000, is_sent, one.bytes.to_vec())
        };
        Ok(found.records().iter().map(one).collect())
    }

    #[test]
    fn columns_are_known_by_their_names() {
        let expected = vec![(501, true, vec![0xAB, 0x24]), (1_500, false, vec![0x0A])];
        for text in [
            "Time;Direction;Data\n0.000501;TX;AB 24\n0.0015;RX;0A\n",
            "time_us,dir,bytes\n501,write,AB24\n1500,read,0A\n",
            "#\tTime\tFunction\tData\n1\t0.000501\tIRP_MJ_WRITE\tab 24\n2\t0.0012\tIRP_MJ_CREATE\t\n\
             3\t0.0015\tIRP_MJ_READ\t0a\n",
            "{\"ts\": 0.000501, \"dir\": \"tx\", \"data\": \"ab24\"}\n\
             {\"ts\": 0.0015, \"dir\": \"rx\", \"data\": \"0a\"}\n",
            "[{\"time_ms\": 0.501, \"direction\": \"sent\", \"bytes\": [171, 36]},\n\
             {\"time_ms\": 1.5, \"direction\": \"received\", \"bytes\": [10]}]\n",
        ] {
            assert_eq!(told(text), Ok(expected.clone()), "{text}");
        }
        for ways in [
            ["PC -> METER", "METER -> PC"],
            ["master", "slave"],
            ["out", "in"],
        ] {
            let [sent, received] = ways;
            let text = format!("time_us,dir,bytes\n501,{sent},AB24\n1500,{received},0A\n");
            assert_eq!(told(&text), Ok(expected.clone()), "{text}");
        }
        let error = told("time,dir,data\n0.1,up,AB\n").expect_err("a way");
        assert!(
            error.starts_with("line 2") && error.contains("\"up\""),
            "{error}"
        );
    }

    /// Times with a decimal comma, as programs write them in many countries.
    #[test]
    fn a_comma_may_be_the_decimal_mark() {
        let expected = vec![(501, false, vec![0x41]), (1_500, false, vec![0x0A])];
        for text in [
            "0,000501;0x41\n0,0015;0x0A\n",
            "0.000501,0x41\n0.0015,0x0A\n",
            "Time;Data\n0,000501;41\n0,0015;0A\n",
            "Time\tData\n0,000501\t41\n0,0015\t0A\n",
            "Time,Data\n\"0,000501\",41\n\"0,0015\",0A\n",
        ] {
            assert_eq!(told(text), Ok(expected.clone()), "{text}");
        }
        assert!(told("Time;Data\n1,234,567;41\n").is_err());
        assert!(told("Time;Data\n1.234,5;41\n").is_err());
    }

    /// The first bytes come at 501 us, the next 999 us later; a row without bytes has a time, too.
    #[test]
    fn a_column_of_pauses_is_added_up() {
        let expected = vec![(501, true, vec![0xAB, 0x24]), (1_500, false, vec![0x0A])];
        for text in [
            "No;Delta;Direction;Data\n1;0.000501;TX;AB 24\n2;0.000999;RX;0A\n",
            "delta_us,dir,bytes\n501,write,AB24\n500,,\n499,read,0A\n",
            "Delta [ms],dir,bytes\n0.501,write,AB24\n0.999,read,0A\n",
        ] {
            assert_eq!(told(text), Ok(expected.clone()), "{text}");
        }
    }

    #[test]
    fn a_row_that_announces_more_bytes_than_it_has_is_an_error() {
        let text = "time,dir,length,data\n0.1,TX,2,AB24\n0.2,RX,8,0A0B\n";
        let error = told(text).expect_err("cut");
        assert!(
            error.starts_with("line 3") && error.contains("announces 8"),
            "{error}"
        );
        assert!(told(&text.replace(",2,", ",66,")).is_ok());
    }

    #[test]
    fn other_tables_are_none() {
        for text in [
            "time,temperature\n0.1,23\n",
            "name,data\na,AB\n",
            "{\"a\": 1}\n",
            "",
            "data\nAB\n",
            "0,1;2\n",
            "1;0x41\n",
        ] {
            assert!(look(text.as_bytes()).is_none(), "{text}");
        }
    }

    /// The unit of a column stands behind a line, in brackets, or behind "time".
    #[test]
    fn the_name_of_a_column_tells_its_unit() {
        for (name, expected) in [
            ("time_us", Some(1_000)),
            ("Time [ms]", Some(1_000_000)),
            ("t(ns) x", Some(1)),
            ("Timeus", Some(1_000)),
            ("Time \u{b5}s", Some(1_000)),
            ("time", None),
            ("status", None),
            ("times", None),
        ] {
            assert_eq!(unit(name), expected, "{name}");
        }
        let pauses = ["delta", "deltams", "dt\u{b5}s", "deltax", "time"].map(is_pause);
        assert_eq!(pauses, [true, true, true, false, false]);
        assert_eq!(
            ["12.5", "12:5", "", "1a"].map(is_number),
            [true, false, true, false]
        );
    }

    /// Seconds up to eleven digits, then milliseconds, microseconds and nanoseconds since 1970.
    #[test]
    fn the_digits_of_a_time_tell_its_unit() {
        let line = lines(b"x").next().expect("a line");
        let of = |text: &str| time(text, "time", line).ok();
        const AT: u64 = 1_682_942_398_000_000_000;
        for (text, expected) in [
            ("0.5", (500_000_000, Clock::Seconds)),
            ("+0.5", (500_000_000, Clock::Plus)),
            ("1682942398", (AT, Clock::Utc)),
            ("1682942398000", (AT, Clock::Utc)),
            ("1682942398000000", (AT, Clock::Utc)),
            ("1682942398000000000", (AT, Clock::Utc)),
            ("00000000012", (12_000_000_000, Clock::Seconds)),
            ("000000000012", (12_000_000, Clock::Seconds)),
            ("00000000000012", (12_000_000, Clock::Seconds)),
            ("000000000000012", (12_000, Clock::Seconds)),
            ("00000000000000012", (12_000, Clock::Seconds)),
            ("000000000000000012", (12, Clock::Seconds)),
        ] {
            assert_eq!(of(text), Some(expected), "{text}");
        }
        assert_eq!((of("x"), of("")), (None, None));
        assert_eq!(
            time("12", "time_ms", line).ok(),
            Some((12_000_000, Clock::Seconds))
        );
    }

    /// Rows without bytes are counted; a column of lengths counts if half of it is right.
    #[test]
    fn rows_without_bytes_are_counted() {
        let notes = |text: &str| {
            let found = read_format(text.as_bytes(), Format::Table, &Options::default());
            found.expect("sound").notes
        };
        let skipped = |text: &str| {
            let notes = notes(text).into_iter();
            notes
                .filter(|note| note.contains("skipped"))
                .collect::<Vec<_>>()
        };
        let head = "Time;Direction;Data\n0.1;TX;AB 24\n";
        assert!(skipped(head).is_empty());
        let two = format!("{head}0.2;RX;\n0.3;RX;\n");
        assert_eq!(skipped(&two), ["2 rows without bytes are skipped"]);
        let is_pause = |note: &String| note.contains("pause since the row before");
        assert!(!notes(head).iter().any(is_pause));
        assert!(notes(&head.replace("Time", "Delta")).iter().any(is_pause));
        // Of two rows one is right: the other one is cut. Of three, one is no half.
        let length = |rows: &str| told(&format!("time,dir,length,data\n{rows}")).is_err();
        assert!(length("0.1,TX,2,AB24\n0.2,RX,8,0A0B\n"));
        assert!(!length("0.1,TX,2,AB24\n0.2,RX,8,0A0B\n0.3,RX,8,0A0B\n"));
        assert!(!length("0.1,TX,2,AB24\n0.2,RX,1,0A0B\n"));
    }

    /// A table has at least one row with bytes.
    #[test]
    fn a_table_without_bytes_is_none() {
        let is = |rows: &str| look(format!("Time;Direction;Data\n{rows}").as_bytes()).is_some();
        assert!(!is("") && !is("0.1;TX;\n") && !is("0.1;TX;word\n"));
        assert!(is("0.1;TX;\n0.2;TX;AB 24\n") && is("0.1;TX;word\n0.2;TX;AB 24\n"));
    }

    /// The columns tell that the digits are hex: no note has to.
    #[test]
    fn digits_of_a_table_need_no_note() {
        let text = "Time;Direction;Data\n0.1;TX;10 20\n0.2;RX;30 40\n";
        let found = read_format(text.as_bytes(), Format::Table, &Options::default());
        let notes = found.expect("sound").notes;
        assert!(
            notes.iter().all(|note| !note.contains("taken as hex")),
            "{notes:?}"
        );
    }
}
