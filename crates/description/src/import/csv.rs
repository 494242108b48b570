//! A register map as CSV: the first line names the columns, each further line is a register.

mod records;

use super::words::{self, Address, SizeUnit, Wrong};
use super::{Map, Row, TABLES};
use records::{Record, records, separator};

/// The columns that are read, each with the names that maps give it.
const COLUMNS: [(Column, &[&str]); 15] = [
    (
        Column::At,
        &[
            "at",
            "address",
            "addr",
            "register",
            "reg",
            "register address",
            "modbus address",
        ],
    ),
    (
        Column::Name,
        &[
            "name",
            "label",
            "parameter",
            "variable",
            "signal",
            "register name",
            "description",
        ],
    ),
    (
        Column::Type,
        &["type", "data type", "datatype", "format", "data format"],
    ),
    (
        Column::Table,
        &[
            "table",
            "kind",
            "function",
            "function code",
            "fc",
            "register type",
            "space",
            "object",
        ],
    ),
    (
        Column::Scale,
        &["scale", "factor", "multiplier", "resolution"],
    ),
    (Column::Divisor, &["divisor", "gain", "divider"]),
    (Column::Offset, &["offset"]),
    (Column::Unit, &["unit", "units"]),
    (
        Column::Access,
        &["access", "rw", "r/w", "mode", "read/write"],
    ),
    (Column::Least, &["min", "minimum", "least"]),
    (Column::Most, &["max", "maximum", "greatest"]),
    (Column::Initial, &["initial", "default", "value"]),
    (
        Column::Size,
        &[
            "size",
            "bytes",
            "length",
            "registers",
            "register count",
            "number of registers",
            "quantity",
        ],
    ),
    (Column::Words, &["words", "word order"]),
    (
        Column::About,
        &["about", "comment", "remark", "remarks", "notes"],
    ),
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Column {
    At,
    Name,
    Type,
    Table,
    Scale,
    /// The count is the value times this.
    Divisor,
    Offset,
    Unit,
    Access,
    Least,
    Most,
    Initial,
    Size,
    Words,
    About,
}

/// The columns of a file.
struct Columns {
    titles: Vec<String>,
    found: Vec<Option<Column>>,
    separator: char,
}

/// A line with an address.
struct Line<'a> {
    number: usize,
    cells: &'a [String],
    address: Address,
    /// Index in [`TABLES`].
    table: usize,
}

impl Columns {
    fn has(&self, column: Column) -> bool {
        self.found.contains(&Some(column))
    }

    fn at(&self, column: Column) -> Option<usize> {
        self.found.iter().position(|found| *found == Some(column))
    }

    fn title(&self, column: Column) -> &str {
        let at = self.at(column);
        at.and_then(|at| self.titles.get(at))
            .map_or("", |title| title)
    }

    /// The text of a cell, if it has one.
    fn cell<'a>(&self, cells: &'a [String], column: Column) -> Option<&'a str> {
        let text = cells.get(self.at(column)?)?.trim();
        (!text.is_empty() && text != "-").then_some(text)
    }

    /// The meaning of a cell, or an error with the `expected` text.
    fn read<T>(
        &self,
        (line, cells): (usize, &[String]),
        column: Column,
        expected: &str,
        meaning: impl Fn(&str) -> Option<T>,
    ) -> Result<Option<T>, String> {
        let Some(text) = self.cell(cells, column) else {
            return Ok(None);
        };
        meaning(text)
            .map(Some)
            .ok_or_else(|| self.wrong(line, column, text, expected))
    }

    fn wrong(&self, line: usize, column: Column, text: &str, expected: &str) -> String {
        let title = self.title(column);
        format!("line {line}: {title}: is \"{text}\", expected {expected}")
    }

    /// Whether the title of the column says that its numbers are hexadecimal.
    fn is_hex(&self, column: Column) -> bool {
        words::is_hex_title(self.title(column))
    }

    fn figure(&self, at: (usize, &[String]), column: Column) -> Result<Option<f64>, String> {
        if self.is_hex(column) {
            let expected = "a hexadecimal number, as 1F";
            return self.read(at, column, expected, words::hex_number);
        }
        let expected = match self.separator {
            ',' => "a number with a point, without a comma",
            _ => "a number, without separators of thousands",
        };
        self.read(at, column, expected, |text| {
            words::number(text, self.separator)
        })
    }
}

/// Reads the text of a CSV file.
pub(super) fn read(text: &str) -> Result<Map, String> {
    let separator = separator(text);
    let records = records(text, separator)?;
    let Some(((first, titles), rows)) = records.split_first() else {
        return Err("is empty, expected a first line with the names of columns".to_owned());
    };
    let titles: Vec<String> = titles.iter().map(|title| words::one_line(title)).collect();
    let columns = Columns {
        found: meanings(&titles),
        titles,
        separator,
    };
    if !columns.has(Column::At) {
        return Err(format!(
            "line {first}: no column of addresses, expected one called {}",
            names(Column::At)
        ));
    }
    let mut map = Map::default();
    for (title, column) in columns.titles.iter().zip(&columns.found) {
        if column.is_none() && !title.is_empty() {
            map.left_out.push(format!("the column \"{title}\""));
        }
    }
    let lines = lines(&columns, rows, &mut map)?;
    let numbered = numbered(&columns, &lines, &mut map.notes);
    for line in &lines {
        let row = columns.row(line, numbered[line.table], &mut map)?;
        map.rows.push(row);
    }
    let cells = lines.iter().map(|line| (line.number, line.cells));
    let access = cells.map(|(line, cells)| (line, columns.cell(cells, Column::Access)));
    map.notes.extend(words::write_only(access));
    Ok(map)
}

/// The lines with an address; the others are reported.
fn lines<'a>(
    columns: &Columns,
    rows: &'a [Record],
    map: &mut Map,
) -> Result<Vec<Line<'a>>, String> {
    let mut lines = Vec::new();
    let (mut dropped, mut inherited) = (Vec::new(), 0);
    let mut table = 3;
    for (number, cells) in rows {
        let at = (*number, &cells[..]);
        let is_hex = columns.is_hex(Column::At);
        let expected = match is_hex {
            true => "a hexadecimal address, as 10 or 0x10",
            false => "an address, as 16, 0x10 or 40017",
        };
        let address = |text: &str| Address::parse(text, is_hex);
        let Some(address) = columns.read(at, Column::At, expected, address)? else {
            dropped.push(number.to_string());
            continue;
        };
        let expected = "coil, discrete, input, holding, or the function code 1 to 4";
        match columns.read(at, Column::Table, expected, words::table)? {
            Some(own) => table = own,
            None => inherited += usize::from(columns.has(Column::Table)),
        }
        lines.push(Line {
            number: *number,
            cells,
            address,
            table,
        });
    }
    if !dropped.is_empty() {
        let (count, numbers) = (dropped.len(), dropped.join(", "));
        map.left_out
            .push(format!("lines without an address: {count}, at {numbers}"));
    }
    if inherited > 0 {
        map.notes.push(format!(
            "lines without a table take the table of the line before: {inherited}"
        ));
    }
    Ok(lines)
}

/// For each table, whether all of its addresses are numbers such as 40001, which is the holding
/// register 0. Without a column of tables, all addresses of the file are, or none.
fn numbered(columns: &Columns, lines: &[Line<'_>], notes: &mut Vec<String>) -> [bool; 4] {
    let has_table = columns.has(Column::Table);
    let mut all = [false; 4];
    for (table, is_numbered) in all.iter_mut().enumerate() {
        let own = || lines.iter().filter(|line| line.table == table);
        let fits = |line: &Line<'_>| {
            let number = line.address.numbered();
            number.is_some_and(|(of, _)| !has_table || of == table)
        };
        *is_numbered = own().next().is_some() && own().all(fits);
        let Some(line) = own().find(|line| fits(line)) else {
            continue;
        };
        let Some((of, low)) = line.address.numbered() else {
            continue;
        };
        let (at, of) = (line.address.at, TABLES[of]);
        notes.push(match *is_numbered {
            true => format!("address {at} is read as {of} {low}, and the others alike"),
            false => format!(
                "address {at} is read as {} {at}, not as {of} {low}: other addresses have no such \
                 prefix",
                TABLES[table]
            ),
        });
    }
    all
}

impl Columns {
    /// The register of a line.
    fn row(&self, line: &Line<'_>, is_numbered: bool, map: &mut Map) -> Result<Row, String> {
        let cells = line.cells;
        let at = (line.number, cells);
        let number = line.address.numbered().filter(|_| is_numbered);
        let (table, address) = number.unwrap_or((line.table, line.address.at));
        if address > 0xFFFF {
            let expected = "an address up to 65535";
            let text = self.cell(cells, Column::At).unwrap_or_default();
            return Err(self.wrong(line.number, Column::At, text, expected));
        }
        let text = |column: Column| words::one_line(self.cell(cells, column).unwrap_or_default());
        let mut row = Row {
            line: line.number,
            table,
            at: address,
            name: text(Column::Name),
            unit: text(Column::Unit),
            about: text(Column::About),
            ..Row::default()
        };
        self.kind(at, &mut row, map)?;
        row.scale = self.scale(at)?.filter(|scale| *scale != 1.0);
        row.offset = self
            .figure(at, Column::Offset)?
            .filter(|offset| *offset != 0.0);
        let limits = [Column::Least, Column::Most].map(|column| self.figure(at, column));
        match limits {
            [Err(error), _] | [_, Err(error)] => return Err(error),
            [Ok(Some(least)), Ok(Some(most))] => row.limits = Some([least, most]),
            [Ok(None), Ok(None)] => {}
            [Ok(least), Ok(_)] => {
                let given = least.map_or(Column::Most, |_| Column::Least);
                let given = self.title(given);
                map.left_out.push(format!(
                    "\"{given}\" of line {}, which has no second limit",
                    line.number
                ));
            }
        }
        let expected = "ABCD, CDAB, BADC, DCBA, big or little";
        let order = self.read(at, Column::Words, expected, words::order)?;
        [row.is_little_words, row.is_little_bytes] = order.unwrap_or_default();
        let expected = "R, RW, read, write, read only, read/write or function codes";
        row.is_writable = self.read(at, Column::Access, expected, words::access)?;
        row.initial = self.initial(at, &row)?;
        Ok(row)
    }

    /// Sets the type.
    fn kind(&self, at: (usize, &[String]), row: &mut Row, map: &mut Map) -> Result<(), String> {
        let count = |text: &str| text.parse::<u16>().ok().filter(|size| *size > 0);
        let size = self.read(at, Column::Size, "a number from 1 to 65535", count)?;
        let unit = SizeUnit::of_title(self.title(Column::Size));
        let text = self.cell(at.1, Column::Type).unwrap_or_default();
        let found = words::kind(text, size, unit).map_err(|wrong| match wrong {
            Wrong::Kind => {
                let expected = "a type as u16, int32, float or string[8]";
                self.wrong(at.0, Column::Type, text, expected)
            }
            Wrong::Size => {
                let column = match size {
                    Some(_) => Column::Size,
                    None => Column::Type,
                };
                let expected = "the size of the type: a column \"registers\" or \"bytes\", a type \
                                such as uint32, or string[1] to string[250]";
                let found = self.cell(at.1, column).unwrap_or_default();
                self.wrong(at.0, column, found, expected)
            }
        })?;
        (row.kind, row.size) = (found.0.to_owned(), found.1);
        let note = "sizes of texts are read as bytes; a column \"registers\" would be in registers";
        let is_guess = row.size.is_some() && size.is_some() && unit.is_none();
        if is_guess && !map.notes.iter().any(|known| known == note) {
            map.notes.push(note.to_owned());
        }
        Ok(())
    }

    fn scale(&self, at: (usize, &[String])) -> Result<Option<f64>, String> {
        for column in [Column::Scale, Column::Divisor] {
            if self.figure(at, column)? == Some(0.0) {
                let text = self.cell(at.1, column).unwrap_or_default();
                let expected = "a number other than 0, or an empty cell for no scale";
                return Err(self.wrong(at.0, column, text, expected));
            }
        }
        let scale = self.figure(at, Column::Scale)?;
        let divisor = self.figure(at, Column::Divisor)?;
        match (
            scale.filter(|scale| *scale != 1.0),
            divisor.filter(|divisor| *divisor != 1.0),
        ) {
            (Some(scale), Some(divisor)) if (scale * divisor - 1.0).abs() > 1e-9 => {
                let text = self.cell(at.1, Column::Divisor).unwrap_or_default();
                let expected =
                    format!("nothing, as \"{}\" is given too", self.title(Column::Scale));
                Err(self.wrong(at.0, Column::Divisor, text, &expected))
            }
            (Some(scale), _) => Ok(Some(scale)),
            (None, divisor) => Ok(divisor.map(f64::recip)),
        }
    }

    /// The initial value as TOML.
    fn initial(&self, at: (usize, &[String]), row: &Row) -> Result<Option<String>, String> {
        if row.is_bit() {
            let bit = self.read(
                at,
                Column::Initial,
                "0, 1, on, off, true or false",
                words::bit,
            )?;
            return Ok(bit.map(|bit| bit.to_string()));
        }
        if row.kind == "str" {
            return Ok(self.cell(at.1, Column::Initial).map(quoted));
        }
        let value = self.figure(at, Column::Initial)?;
        Ok(
            value.map(|value| match value.fract() == 0.0 && value.abs() < 1e15 {
                true => format!("{value:.0}"),
                false => format!("{value:?}"),
            }),
        )
    }
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// The meaning of each column; the first column of a meaning counts.
fn meanings(titles: &[String]) -> Vec<Option<Column>> {
    let mut found: Vec<Option<Column>> = vec![None; titles.len()];
    let words = titles.iter().map(|title| {
        let title = title.split(['(', '[']).next().unwrap_or_default();
        let title = words::plain(title);
        let base = |word: &&str| !["hex", "dec", "decimal", "hexadecimal"].contains(word);
        let words: Vec<&str> = title.split(' ').filter(base).collect();
        words.join(" ")
    });
    let words: Vec<String> = words.collect();
    for (column, names) in COLUMNS {
        // The first name in the list that a column has.
        let at = names
            .iter()
            .find_map(|name| words.iter().position(|word| word == name));
        if let Some(at) = at.filter(|at| found[*at].is_none()) {
            found[at] = Some(column);
        }
    }
    found
}

fn names(column: Column) -> String {
    let known = COLUMNS.iter().find(|(known, _)| *known == column);
    known.map_or_else(String::new, |(_, names)| names.join(", "))
}
