//! Exports of Saleae's Logic.
//!
//! ```text
//! Time [s],Value,Parity Error,Framing Error        the serial analyzer's export
//! 0.000105,0xFA,,Error
//! name,type,start_time,duration,data,error         the table of Logic 2
//! "Async Serial","data",0.0001,8.6e-05,0xFA,framing
//! ```
//!
//! The formats are known from the analyzer's source and from files of others, not from a run. The
//! value must be in hex: other radices are ambiguous.

use super::Look;
use super::cells::{CellRow, rows};
use super::imported::{ImportError, Imported, Options};
use super::roles::{Role, roles};
use super::text::{DECIMAL_COMMA, Line, decimal_nanos, moment, zone};
use crate::Kind;
use engine::hex;
use protocols::LineEvent;

const FRAMING: Kind = Kind::Line(LineEvent::FramingError);
/// Number of the parity event in a capture; the lines of this tool have no parity.
const PARITY: Kind = Kind::Other(8);

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let mut head = rows(bytes).take(super::LINES_LOOKED_AT);
    let is_head = |row: CellRow<'_>| Columns::of(&row.cells).is_some();
    head.any(is_head).then_some(Look::Surely)
}

/// Indexes of the columns of a row.
struct Columns {
    time: usize,
    duration: Option<usize>,
    value: usize,
    /// Columns of errors, with the kind of an error that does not name itself.
    errors: Vec<(usize, Kind)>,
    kind: Option<usize>,
    /// Column of the analyzer's name.
    analyzer: Option<usize>,
    /// Columns that only analyzers of other buses fill, with the bus.
    others: Vec<(usize, &'static str)>,
}

/// Columns of a table that a serial line leaves empty.
const OTHERS: [(&str, &str); 8] = [
    ("ack", "I2C"),
    ("read", "I2C"),
    ("mosi", "SPI"),
    ("miso", "SPI"),
    ("identifier", "CAN"),
    ("num_data_bytes", "CAN"),
    ("crc", "CAN"),
    ("channel", "I2S"),
];
/// Words in an analyzer's name for a bus that is not a serial line.
const BUSES: [&str; 8] = [
    "i2c", "spi", "can", "lin", "i2s", "1-wire", "onewire", "jtag",
];

impl Columns {
    /// The bus of a row, if it is not a serial line.
    fn other_bus(&self, row: &CellRow<'_>) -> Option<&'static str> {
        let filled = self
            .others
            .iter()
            .find(|(column, _)| !row.cell(*column).is_empty());
        if let Some((_, bus)) = filled {
            return Some(bus);
        }
        let name = self
            .analyzer
            .map_or("", |column| row.cell(column))
            .to_lowercase();
        let words = name.split(|c: char| !(c.is_alphanumeric() || c == '-'));
        let mut words = words.filter(|word| !word.is_empty());
        words.find_map(|word| BUSES.iter().find(|bus| **bus == word).copied())
    }

    fn of(cells: &[String]) -> Option<Self> {
        let find = |name: &str| {
            cells
                .iter()
                .position(|cell| cell.eq_ignore_ascii_case(name))
        };
        if let (Some(time), Some(value)) = (
            find("Time [s]"),
            find("Value").or(find("Decoded Protocol Result")),
        ) {
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
                analyzer: find("Analyzer Name").or_else(|| find("Name")),
                others: Vec::new(),
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
            analyzer: find("name"),
            others: OTHERS
                .iter()
                .filter_map(|&(name, bus)| Some((find(name)?, bus)))
                .collect(),
        })
    }
}

/// The analyzers of a table that belong to no other bus.
fn analyzers(
    table: &[CellRow<'_>],
    columns: &Columns,
    options: &Options,
) -> Result<Vec<String>, ImportError> {
    let mut all: Vec<String> = Vec::new();
    for row in table {
        let name = columns.analyzer.map_or("", |column| row.cell(column));
        if !all.iter().any(|known| known == name) {
            all.push(name.to_owned());
        }
    }
    let named = all.join(", ");
    if let Some(missing) = options.channels.iter().find(|name| !all.contains(name)) {
        return Err(ImportError::of_file(format!(
            "--channel {missing}: there is no such analyzer, expected one of: {named}"
        )));
    }
    let is_chosen = |name: &String| options.channels.is_empty() || options.channels.contains(name);
    let chosen: Vec<String> = all.into_iter().filter(is_chosen).collect();
    for row in table {
        let name = columns.analyzer.map_or("", |column| row.cell(column));
        let is_own = chosen.iter().any(|chosen| chosen == name);
        if let Some(bus) = columns.other_bus(row).filter(|_| is_own) {
            return Err(row.line.wrong(format!(
                "this row of \"{name}\" is of a bus ({bus}), not of a serial line; choose the \
                 serial analyzers with --channel NAME: {named}"
            )));
        }
    }
    Ok(chosen)
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    out.clock = "virtual";
    let mut table = rows(bytes);
    let Some(head) = table.next() else {
        return Ok(());
    };
    let columns = Columns::of(&head.cells).ok_or_else(|| {
        head.line
            .wrong("expected \"Time [s],Value,..\" or \"name,type,start_time,duration,data,..\"")
    })?;
    let table: Vec<CellRow<'_>> = table.collect();
    let analyzers = analyzers(&table, &columns, options)?;
    let roles = match columns.analyzer {
        Some(_) => roles(&analyzers, options, out),
        None => vec![Role {
            link: options.link.clone(),
            direction: options.direction,
        }],
    };
    for row in table {
        let name = columns.analyzer.map_or("", |column| row.cell(column));
        let index = analyzers.iter().position(|analyzer| analyzer == name);
        let role = index.and_then(|index| roles.get(index));
        let is_data = columns.kind.is_none_or(|kind| row.cell(kind) == "data");
        let Some(role) = role.filter(|_| is_data) else {
            continue;
        };
        byte(&row, &columns, role, options, out)?;
    }
    out.sort();
    Ok(())
}

fn byte(
    row: &CellRow<'_>,
    columns: &Columns,
    role: &Role,
    options: &Options,
    out: &mut Imported,
) -> Result<(), ImportError> {
    let line = row.line;
    let (nanos, is_date) = time(row.cell(columns.time))
        .ok_or_else(|| line.wrong("expected seconds, or a date, as the time"))?;
    if is_date {
        out.clock = "utc";
    }
    let took = match columns.duration {
        Some(index) => decimal_nanos(row.cell(index))
            .ok_or_else(|| line.wrong("expected seconds as the duration"))?,
        None => options.byte_nanos(1),
    };
    let errors = columns.errors.iter();
    let mut errors = errors.map(|&(index, kind)| (row.cell(index), kind));
    let kind = match errors.find(|(error, _)| !error.is_empty()) {
        None => Kind::Data,
        Some(("Error", kind)) => kind,
        Some(("framing", _)) => FRAMING,
        Some(("parity", _)) => PARITY,
        Some(_) => return Err(line.wrong("expected no error, Error, framing or parity")),
    };
    if row.cell(columns.time).contains(',') {
        out.note(DECIMAL_COMMA);
    }
    let byte = value(line, row.cell(columns.value))?;
    let bytes = if kind == Kind::Data { &[byte][..] } else { &[] };
    let link = out.link(&role.link, options);
    let at = nanos.saturating_add(took);
    out.push(link, at, role.direction, kind, bytes);
    Ok(())
}

/// Parses nanoseconds; the flag is whether they count from 1970.
fn time(text: &str) -> Option<(u64, bool)> {
    if let Some((date, time)) = text.split_once('T') {
        let at = time.find(['Z', '+', '-']).unwrap_or(time.len());
        let (time, east) = time.split_at(at);
        let east = if east.is_empty() { 0 } else { zone(east)? };
        let (time, fraction) = time.split_once('.').unwrap_or((time, "0"));
        let seconds = moment(date, time, '-')?.checked_add_signed(-east)?;
        let nanos = seconds.checked_mul(1_000_000_000)?;
        return Some((nanos + decimal_nanos(&format!("0.{fraction}"))?, true));
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
    use super::super::cells::cells;
    use super::super::text::lines;
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    fn is_head(text: &[u8]) -> bool {
        look(text).is_some()
    }

    /// Both formats have their columns in any order, in upper or lower case. Without a time or a
    /// value the file has neither format.
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
        assert_eq!(time("1970-01-01T01:00:01.5+01:00"), date);
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

    fn told(text: &str, channels: &[&str]) -> Result<Vec<(u64, Direction, u8)>, String> {
        let options = Options {
            channels: channels.iter().map(|name| (*name).to_owned()).collect(),
            ..Options::default()
        };
        let found = read_format(text.as_bytes(), Format::Saleae, &options);
        let found = found.map_err(|error| error.to_string())?;
        let tuple = |one: &crate::Record| (one.at.as_nanos() / 1000, one.direction, one.bytes[0]);
        Ok(found.records().iter().map(tuple).collect())
    }

    /// Two analyzers in one table are the two directions, by their names or by their order.
    #[test]
    fn two_analyzers_are_two_directions() {
        let (up, down) = (Direction::ToMaster, Direction::ToDevice);
        for [rx, tx] in [
            ["RX from gps", "TX to gps"],
            ["Async Serial", "Async Serial [1]"],
        ] {
            let text = format!(
                "name,type,start_time,duration,data,error\n\
                 \"{rx}\",\"data\",0.001,0.0001,0x24,\n\
                 \"{tx}\",\"data\",0.0005,0.0001,0xB5,\n\
                 \"{rx}\",\"data\",0.002,0.0001,0x47,\n"
            );
            let expected = vec![(600, down, 0xB5), (1_100, up, 0x24), (2_100, up, 0x47)];
            assert_eq!(told(&text, &[]), Ok(expected), "{rx}");
            assert_eq!(told(&text, &[tx]).map(|told| told.len()), Ok(1));
        }
    }

    /// Exports of a computer whose decimal mark is the comma, of both forms.
    #[test]
    fn semicolons_divide_columns_beside_decimal_commas() {
        let up = Direction::ToMaster;
        for text in [
            "Time [s];Value;Parity Error;Framing Error\n0,000105;0x24;;\n",
            "name;type;start_time;duration;data;error\n\"RX\";\"data\";0,0001;5e-06;0x24;\n",
        ] {
            assert_eq!(Format::detect(text.as_bytes()), Some(Format::Saleae));
            assert_eq!(told(text, &[]), Ok(vec![(105, up, 0x24)]), "{text}");
        }
    }

    /// A row of I2C is not a byte of a serial line: detected by its columns or its name.
    #[test]
    fn a_row_of_another_bus_is_refused() {
        let head = "name,type,start_time,duration,data,error,ack,address,read\n";
        let serial = "\"Async Serial\",\"data\",0.1,0.0001,0x24,,,,\n";
        for (row, bus) in [
            ("\"Sensor\",\"data\",0.2,0.0001,0xA0,,true,,\n", "I2C"),
            ("\"my SPI\",\"data\",0.2,0.0001,0xA0,,,,\n", "spi"),
        ] {
            let text = format!("{head}{serial}{row}");
            let error = told(&text, &[]).expect_err("another bus");
            let is_told = error.starts_with("line 3") && error.contains(&format!("({bus})"));
            assert!(is_told && error.contains("--channel NAME"), "{error}");
            assert_eq!(told(&text, &["Async Serial"]).map(|told| told.len()), Ok(1));
            let unknown = told(&text, &["UART"]).expect_err("unknown");
            assert!(
                unknown.contains("expected one of: Async Serial"),
                "{unknown}"
            );
        }
    }
}
