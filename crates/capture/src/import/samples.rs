//! Levels of a logic analyzer as CSV: sigrok, DSView, Saleae's digital export. Voltages of Saleae's
//! analog export and of oscilloscopes are converted with a threshold.
//!
//! ```text
//! ; Channels (2/2): RX, TX            sigrok-cli -O csv: a row a sample
//! ; Samplerate: 1 MHz
//! logic,logic
//! 1,1
//! Time [s],RX,TX                      Saleae: a row a change, with its time
//! 0.000000000,1,1
//! ```

use super::Look;
use super::cells::{CellRow, cells_of, divider, rows};
use super::imported::{ImportError, Imported, Options};
use super::levels::{self, Channel, sample_nanos, sample_rate};
use super::text::{DECIMAL_COMMA, Line, decimal_nanos, lines, utf8};
use super::threshold::digital;
use super::uart::Levels;

/// Header above the rows.
#[derive(Default)]
struct Head {
    rate: Option<u64>,
    names: Vec<String>,
    /// Nanoseconds per unit of the first column, if it is the time.
    time: Option<u64>,
    /// Offset of the first row of levels in the file.
    rows_at: usize,
    has_mark: bool,
    /// Whether the cells are voltages.
    is_analog: bool,
    /// Number of columns before the levels; the first of them may be the time.
    skipped: usize,
}

/// Maximum number of lines of a header.
const HEAD_MAX: usize = 40;

fn head(bytes: &[u8]) -> Option<Head> {
    let (mut head, divider) = (Head::default(), divider(bytes));
    let full = lines(bytes).filter(|line| !line.text.is_empty());
    for line in full.take(HEAD_MAX) {
        let text = utf8(line.text);
        if let Some(comment) = text.strip_prefix(';') {
            head.comment(comment);
            continue;
        }
        let rate = text.strip_prefix("META samplerate:");
        if let Some(rate) = rate {
            head.rate = sample_rate(rate);
            head.has_mark = true;
            continue;
        }
        let cells = cells_of(text, divider);
        if cells
            .iter()
            .skip(head.skipped)
            .all(|cell| level(cell).is_some())
        {
            head.rows_at = line.offset;
            let count = cells.len().saturating_sub(head.skipped);
            if head.names.len() != count {
                head.names = (0..count).map(|index| format!("channel {index}")).collect();
            }
            return (count > 0).then_some(head);
        }
        let skip = head.skipped;
        if head.time.is_some()
            && cells.len() > 1
            && cells.iter().skip(skip).all(|cell| volts(cell).is_some())
            && cells[1..].iter().any(|cell| cell.contains(['.', ',']))
        {
            (head.rows_at, head.is_analog) = (line.offset, true);
            return (head.names.len() == cells.len() - skip).then_some(head);
        }
        // The names of the columns; sigrok writes their kinds instead.
        let named = match time_unit(&cells[0]) {
            Some(unit) => {
                (head.time, head.skipped) = (Some(unit), 1);
                head.has_mark = true;
                &cells[1..]
            }
            // sigrok's csv:time=true writes no times in this column; the rate gives the times.
            None if cells[0] == "samples" => {
                head.skipped = 1;
                &cells[1..]
            }
            None => &cells[..],
        };
        let is_kinds = named.iter().all(|cell| cell == "logic");
        head.has_mark |= is_kinds;
        if named.iter().any(|cell| cell.contains("analog")) {
            return None;
        }
        if !is_kinds {
            head.names = named.to_vec();
        }
    }
    None
}

impl Head {
    fn comment(&mut self, text: &str) {
        let Some((key, value)) = text.split_once(':') else {
            return;
        };
        let key = key.trim().to_ascii_lowercase();
        if key.starts_with("channels") {
            self.names = value
                .split(',')
                .map(|name| name.trim().to_owned())
                .collect();
            self.has_mark = true;
        } else if key.starts_with("sample rate") || key.starts_with("samplerate") {
            self.rate = sample_rate(value);
            self.has_mark = true;
        }
    }
}

/// Nanoseconds per unit of a time column, from its name.
fn time_unit(name: &str) -> Option<u64> {
    let name = name.to_ascii_lowercase();
    // sigrok's csv:time=true writes only the unit.
    let unit = match name.strip_prefix("time") {
        Some(unit) => unit.trim().trim_start_matches("stamp").trim(),
        None if name.ends_with("seconds") => name.trim_end_matches("econds"),
        None => return None,
    };
    let unit = unit.trim_matches(['[', ']', '(', ')']);
    Some(match unit {
        "" | "s" | "sec" | "second" | "seconds" => 1_000_000_000,
        "ms" | "millis" => 1_000_000,
        "us" | "micros" => 1_000,
        "ns" | "nanos" => 1,
        _ => return None,
    })
}

fn level(cell: &str) -> Option<bool> {
    match cell {
        "0" => Some(false),
        "1" => Some(true),
        _ => None,
    }
}

fn volts(cell: &str) -> Option<f64> {
    let cell = cell.replace(',', ".");
    cell.parse().ok().filter(|volts: &f64| volts.is_finite())
}

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let head = head(bytes)?;
    head.has_mark.then_some(Look::Surely)
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let head = head(bytes).ok_or_else(|| {
        ImportError::of_file("expected columns of 0 and 1 below a head, as sigrok and Saleae write")
    })?;
    if divider(bytes) == ';' {
        out.note(DECIMAL_COMMA);
    }
    if head.is_analog {
        return analog(bytes, &head, options, out);
    }
    let mut channels: Vec<Channel> = Vec::new();
    let rate = options.sample_rate.or(head.rate);
    let mut count = 0;
    // A file of samples has rows without a change.
    let (mut last, mut is_of_changes): (Vec<String>, bool) = (Vec::new(), head.time.is_some());
    for row in rows(bytes).skip_while(|row| row.line.offset < head.rows_at) {
        if row.cells[0].starts_with("META") {
            continue;
        }
        let nanos = match (head.time, rate) {
            (Some(unit), _) => time(&row, unit)?,
            (None, Some(rate)) => sample_nanos(count, rate),
            (None, None) => {
                let expected = "the samples have no time: expected --samplerate";
                return Err(row.line.wrong(expected));
            }
        };
        count += 1;
        let first = head.skipped;
        let own = row.cells.get(first..).unwrap_or_default();
        is_of_changes &= own != last;
        last = own.to_vec();
        for (index, name) in head.names.iter().enumerate() {
            let level = level(row.cell(first + index)).ok_or_else(|| wrong(row.line, &row))?;
            if channels.len() == index {
                let name = name.clone();
                let levels = Levels {
                    first: level,
                    ..Levels::default()
                };
                channels.push(Channel { name, levels });
            }
            channels[index].levels.set(nanos, level);
        }
    }
    for channel in &mut channels {
        channel.levels.is_open = is_of_changes;
    }
    levels::read(channels, options, out)
}

/// Converts voltages over time to levels.
fn analog(
    bytes: &[u8],
    head: &Head,
    options: &Options,
    out: &mut Imported,
) -> Result<(), ImportError> {
    let mut samples: Vec<Vec<(u64, f64)>> = vec![Vec::new(); head.names.len()];
    for row in rows(bytes).skip_while(|row| row.line.offset < head.rows_at) {
        let nanos = time(&row, head.time.unwrap_or(1_000_000_000))?;
        for (index, own) in samples.iter_mut().enumerate() {
            let volts = volts(row.cell(1 + index));
            let volts = volts.ok_or_else(|| row.line.wrong("expected a voltage in each column"))?;
            own.push((nanos, volts));
        }
    }
    out.note(
        "the voltages are converted to levels: the threshold is the middle of each channel's range",
    );
    let channels = head.names.iter().zip(&samples);
    let channels = channels.filter_map(|(name, samples)| {
        let (name, levels) = (name.clone(), digital(samples)?);
        Some(Channel { name, levels })
    });
    levels::read(channels.collect(), options, out)
}

fn wrong(line: Line<'_>, row: &CellRow<'_>) -> ImportError {
    let found = row.cells.join(",");
    line.wrong(format!(
        "found \"{}\", expected 0 or 1 in each column",
        found.escape_default()
    ))
}

/// Parses the time of a row. Saleae's first row may lie before the trigger.
fn time(row: &CellRow<'_>, unit: u64) -> Result<u64, ImportError> {
    let cell = row.cell(0);
    let plain = cell.strip_prefix('-').map_or(cell, |_| "0");
    let units = decimal_nanos(plain).ok_or_else(|| row.line.wrong("expected a time"))?;
    Ok(units / (1_000_000_000 / unit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    fn told(text: &str, baud: u32) -> Result<Vec<(u64, Direction, Vec<u8>)>, String> {
        let options = Options {
            baud: Some(baud),
            ..Options::default()
        };
        let found = read_format(text.as_bytes(), Format::Samples, &options);
        let found = found.map_err(|error| error.to_string())?;
        let tuple =
            |one: &crate::Record| (one.at.as_nanos() / 1000, one.direction, one.bytes.to_vec());
        Ok(found.records().iter().map(tuple).collect())
    }

    /// 0x41 on TX at 1 Mbaud from 10 us on, as in Saleae's export: a row a change.
    #[test]
    fn changes_with_times_are_read() {
        let text = "Time [s],RX,TX\r\n0.000000000,1,1\r\n0.000010000,1,0\r\n0.000011000,1,1\r\n\
                    0.000012000,1,0\r\n0.000017000,1,1\r\n0.000018000,1,0\r\n0.000019000,1,1\r\n\
                    0.000100000,1,1\r\n";
        let with_commas = text.replace(',', ";").replace('.', ",");
        for text in [text, &with_commas] {
            assert_eq!(Format::detect(text.as_bytes()), Some(Format::Samples));
            let expected = vec![(20, Direction::ToDevice, vec![0x41])];
            assert_eq!(told(text, 1_000_000), Ok(expected), "{text}");
        }
    }

    /// The same without a row behind the last bits, and with a second channel that changes last:
    /// 0xF0 on RX ends at 25 us, its last change is at 20 us.
    #[test]
    fn the_last_character_of_each_channel_is_whole() {
        let text = "Time [s],RX,TX\n0,1,1\n0.000010000,1,0\n0.000011000,1,1\n\
                    0.000012000,1,0\n0.000015000,0,0\n0.000017000,0,1\n0.000018000,0,0\n\
                    0.000019000,0,1\n0.000020000,1,1\n";
        let [rx, tx] = [Direction::ToMaster, Direction::ToDevice];
        let expected = vec![(20, tx, vec![0x41]), (25, rx, vec![0xF0])];
        assert_eq!(told(text, 1_000_000), Ok(expected));
        // Rows without a change are samples, which end within a character.
        let samples = text.replace("0,1,1\n0.00001", "0,1,1\n0.000001,1,1\n0.00001");
        assert_eq!(told(&samples, 1_000_000).map(|told| told.len()), Ok(1));
    }

    /// The same byte sample by sample, as sigrok-cli 0.7.2 writes it: 1 us each.
    #[test]
    fn samples_at_a_rate_are_read() {
        let mut text = "; CSV generated by libsigrok 0.5.2\n; Channels (1/1): RX\n\
                        ; Samplerate: 1 MHz\nlogic\n"
            .to_owned();
        let levels = "1".repeat(10) + "0100000101" + &"1".repeat(30);
        levels.chars().for_each(|level| text.extend([level, '\n']));
        assert_eq!(Format::detect(text.as_bytes()), Some(Format::Samples));
        assert_eq!(
            told(&text, 1_000_000),
            Ok(vec![(20, Direction::ToMaster, vec![0x41])])
        );
        let no_rate = text.replace("; Samplerate: 1 MHz\n", "");
        assert!(
            told(&no_rate, 1_000_000)
                .expect_err("no rate")
                .contains("--samplerate")
        );
        let damaged = text.replacen("1\n0\n", "1\n2\n", 1);
        assert!(
            told(&damaged, 1_000_000)
                .expect_err("two")
                .contains("expected 0 or 1")
        );
        // 115,200 baud does not fit bits of 1 us.
        let wrong = told(&text, 115_200).expect_err("another rate");
        assert!(wrong.contains("is no UART at 115200 baud"), "{wrong}");
    }

    #[test]
    fn other_tables_are_none() {
        for text in [
            "Time [s],Value\n0.1,0xFA\n",
            "a,b\n1,0\n",
            "1,0\n",
            "",
            "Time,A\n0,analog\n",
        ] {
            assert_eq!(
                Format::detect(text.as_bytes()),
                Format::detect(text.as_bytes())
            );
            assert_eq!(look(text.as_bytes()), None, "{text:?}");
        }
    }

    /// The unit of a column of times, by its name.
    #[test]
    fn the_name_of_a_time_column_has_a_unit() {
        for (name, expected) in [
            ("Time [s]", Some(1_000_000_000)),
            ("time", Some(1_000_000_000)),
            ("Time (ms)", Some(1_000_000)),
            ("Timestamp us", Some(1_000)),
            ("time ns", Some(1)),
            ("Time millis", Some(1_000_000)),
            ("seconds", Some(1_000_000_000)),
            ("Milliseconds", Some(1_000_000)),
            ("microseconds", Some(1_000)),
            ("nanoseconds", Some(1)),
            ("time h", None),
            ("RX", None),
        ] {
            assert_eq!(time_unit(name), expected, "{name}");
        }
        assert_eq!(
            (level("0"), level("1"), level("2")),
            (Some(false), Some(true), None)
        );
        assert_eq!((volts("3,3"), volts("-0.1")), (Some(3.3), Some(-0.1)));
        assert_eq!((volts("inf"), volts("x")), (None, None));
    }

    /// 0xFF at 100,000 baud: a start bit of 10 us in 3.3 V, from 100 us on. Each voltage needs its
    /// column.
    #[test]
    fn voltages_are_converted_to_levels() {
        let of = |rows: &[(u32, &str)]| {
            let rows: String = rows
                .iter()
                .map(|(us, volts)| format!("0.{us:06}0,{volts}\n"))
                .collect();
            let text = format!("Time [s],RX\n{rows}");
            let options = Options {
                baud: Some(100_000),
                ..Options::default()
            };
            let mut out = Imported::new();
            let found = read(text.as_bytes(), &options, &mut out);
            let bytes = out.records().iter().flat_map(|one| one.bytes.to_vec());
            (
                found.map_err(|error| error.message),
                bytes.collect::<Vec<u8>>(),
            )
        };
        let whole = [(0, "3.3"), (100, "0.0"), (110, "3.3"), (500, "3.2")];
        assert_eq!(of(&whole), (Ok(()), vec![0xFF]));
        let (found, _) = of(&[(0, "3.3"), (100, "0.0"), (110, "x"), (500, "3.3")]);
        assert_eq!(found, Err("expected a voltage in each column".to_owned()));
    }

    /// Semicolons between the columns tell that the comma is the decimal mark.
    #[test]
    fn a_decimal_comma_is_noted() {
        let text = "Time [s],RX\n0.0,1\n0.0001,0\n0.00011,1\n0.0005,1\n";
        let notes = |text: &str| {
            let options = Options {
                baud: Some(100_000),
                ..Options::default()
            };
            let mut out = Imported::new();
            read(text.as_bytes(), &options, &mut out).expect("sound");
            out.notes.contains(&DECIMAL_COMMA.to_owned())
        };
        let with_commas = text.replace(',', ";").replace('.', ",");
        assert_eq!((notes(text), notes(&with_commas)), (false, true));
    }
}
