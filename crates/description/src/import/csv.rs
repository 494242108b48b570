//! A register map as CSV: the first line names the columns, each further line is a register.

use super::{Map, Row};

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
    (Column::Size, &["size", "bytes", "length"]),
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

/// Reads the text of a CSV file.
pub(super) fn read(text: &str) -> Result<Map, String> {
    let separator = separator(text);
    let records = records(text, separator)?;
    let Some(((first, titles), rows)) = records.split_first() else {
        return Err("is empty, expected a first line with the names of columns".to_owned());
    };
    let found = columns(titles);
    let mut map = Map::default();
    let needs = |column: Column| found.contains(&Some(column));
    if !needs(Column::At) {
        return Err(format!(
            "line {first}: no column of addresses, expected one called {}",
            names(Column::At)
        ));
    }
    for (title, column) in titles.iter().zip(&found) {
        if column.is_none() && !title.trim().is_empty() {
            map.left_out
                .push(format!("the column \"{}\"", title.trim()));
        }
    }
    let mut table = 3;
    for (line, cells) in rows {
        let cell = |column: Column| {
            let at = found.iter().position(|found| *found == Some(column))?;
            let text = cells.get(at)?.trim();
            (!text.is_empty() && text != "-").then_some(text)
        };
        let Some(at) = cell(Column::At) else {
            continue;
        };
        if let Some(word) = cell(Column::Table) {
            table = table_of(word).ok_or_else(|| {
                format!(
                    "line {line}: {}: is \"{word}\", expected coil, discrete, input, holding, or \
                     the function code 1 to 4",
                    title_of(titles, &found, Column::Table)
                )
            })?;
        }
        let (at, of_number) = address(at).ok_or_else(|| {
            format!(
                "line {line}: {}: is \"{at}\", expected an address, as 16, 0x10 or 40017",
                title_of(titles, &found, Column::At)
            )
        })?;
        // 40001 is the register 0, unless a column gives the table.
        let is_plain = needs(Column::Table);
        let (table, at) = match of_number.filter(|_| !is_plain) {
            Some((table, low)) => (table, low),
            None => (table, at),
        };
        let mut row = Row {
            line: *line,
            table,
            at,
            name: cell(Column::Name).unwrap_or_default().to_owned(),
            unit: cell(Column::Unit).unwrap_or_default().to_owned(),
            about: cell(Column::About).unwrap_or_default().to_owned(),
            ..Row::default()
        };
        let figure = |column: Column| match cell(column) {
            None => Ok(None),
            Some(text) => number(text).map(Some).ok_or_else(|| {
                let title = title_of(titles, &found, column);
                format!("line {line}: {title}: is \"{text}\", expected a number")
            }),
        };
        let size = figure(Column::Size)?;
        let kind = cell(Column::Type).unwrap_or("u16");
        (row.kind, row.size) = type_of(kind, size).ok_or_else(|| {
            format!(
                "line {line}: {}: is \"{kind}\", expected a type as u16, int32, float or string[8]",
                title_of(titles, &found, Column::Type)
            )
        })?;
        let divisor = figure(Column::Divisor)?.filter(|divisor| *divisor != 0.0);
        let scale = figure(Column::Scale)?.or(divisor.map(f64::recip));
        row.scale = scale.filter(|scale| *scale != 1.0 && *scale != 0.0);
        row.offset = figure(Column::Offset)?.filter(|offset| *offset != 0.0);
        if let (Some(least), Some(most)) = (figure(Column::Least)?, figure(Column::Most)?) {
            row.limits = Some([least, most]);
        }
        row.is_little_words = cell(Column::Words).is_some_and(|words| {
            ["little", "low first", "cdab", "dcba", "swapped", "swap"]
                .contains(&words.to_lowercase().as_str())
        });
        row.is_writable = cell(Column::Access).map(|text| text.to_lowercase().contains('w'));
        row.initial = cell(Column::Initial).map(|text| match number(text) {
            _ if table < 2 => (!["0", "false", "off"].contains(&&*text.to_lowercase())).to_string(),
            Some(_) if row.kind == "str" => quoted(text),
            Some(value) if value.fract() == 0.0 && value.abs() < 1e15 => format!("{value:.0}"),
            Some(value) => format!("{value:?}"),
            None => quoted(text),
        });
        map.rows.push(row);
    }
    Ok(map)
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// The separator of the first line: the most frequent of comma, semicolon and tab.
fn separator(text: &str) -> char {
    let first = text.lines().next().unwrap_or_default();
    let count = |separator: char| first.matches(separator).count();
    let all = ['\t', ';', ','];
    all.into_iter().max_by_key(|one| count(*one)).unwrap_or(',')
}

type Record = (usize, Vec<String>);

/// The lines of a file in cells, with their line numbers; quotes may enclose a cell.
fn records(text: &str, separator: char) -> Result<Vec<Record>, String> {
    let mut records: Vec<Record> = Vec::new();
    let (mut cells, mut cell, mut quoted_at) = (Vec::new(), String::new(), None);
    let (mut line, mut first) = (1, 1);
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '"' if quoted_at.is_some() && chars.peek() == Some(&'"') => {
                chars.next();
                cell.push('"');
            }
            '"' if quoted_at.is_some() => quoted_at = None,
            '"' if cell.trim().is_empty() => {
                cell.clear();
                quoted_at = Some(line);
            }
            '\n' if quoted_at.is_none() => {
                cells.push(core::mem::take(&mut cell));
                records.push((first, core::mem::take(&mut cells)));
                first = line + 1;
            }
            c if c == separator && quoted_at.is_none() => cells.push(core::mem::take(&mut cell)),
            '\r' => {}
            c => cell.push(c),
        }
        line += usize::from(c == '\n');
    }
    if let Some(line) = quoted_at {
        return Err(format!("line {line}: a quotation mark is not closed"));
    }
    cells.push(cell);
    records.push((first, cells));
    let is_used = |cells: &[String]| {
        let first = cells.first().map_or("", |cell| cell.trim());
        !first.starts_with('#') && cells.iter().any(|cell| !cell.trim().is_empty())
    };
    records.retain(|(_, cells)| is_used(cells));
    Ok(records)
}

/// The meaning of each column; the first column of a meaning counts.
fn columns(titles: &[String]) -> Vec<Option<Column>> {
    let mut found: Vec<Option<Column>> = vec![None; titles.len()];
    let words = titles.iter().map(|title| {
        let title = title.trim().to_lowercase().replace(['_', '-'], " ");
        title
            .split(['(', '['])
            .next()
            .unwrap_or_default()
            .trim()
            .to_owned()
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

fn title_of<'a>(titles: &'a [String], found: &[Option<Column>], column: Column) -> &'a str {
    let at = found.iter().position(|found| *found == Some(column));
    at.and_then(|at| titles.get(at))
        .map_or("", |title| title.trim())
}

/// An address, and its table and offset if it may be a number such as 40001.
type Address = (u32, Option<(usize, u32)>);

fn address(text: &str) -> Option<Address> {
    // Of a range, such as 0-1, the first one.
    let first = text.split(['-', '–', '~']).next().unwrap_or(text).trim();
    let at = match first
        .strip_prefix("0x")
        .or_else(|| first.strip_prefix("0X"))
    {
        Some(digits) => u32::from_str_radix(digits, 16).ok()?,
        None => match first.strip_suffix(['h', 'H']) {
            Some(digits) => u32::from_str_radix(digits, 16).ok()?,
            None => first.parse().ok()?,
        },
    };
    let numbered = match first.len() {
        5 => Some((at / 10_000, at % 10_000)),
        6 => Some((at / 100_000, at % 100_000)),
        _ => None,
    };
    let table = numbered.and_then(|(table, low)| {
        let table = match table {
            0 => 0,
            1 => 1,
            3 => 2,
            4 => 3,
            _ => return None,
        };
        Some((table, low.checked_sub(1)?))
    });
    (at <= 0xFFFF || table.is_some()).then_some((at, table))
}

/// The index of a table by its usual names.
fn table_of(word: &str) -> Option<usize> {
    let word = word.trim().to_lowercase();
    let starts = |names: &[&str]| names.iter().any(|name| word.starts_with(name));
    match word.as_str() {
        "1" | "01" | "fc1" | "fc01" | "5" | "05" | "0x" => return Some(0),
        "2" | "02" | "fc2" | "fc02" | "1x" => return Some(1),
        "4" | "04" | "fc4" | "fc04" | "3x" | "ir" => return Some(2),
        "3" | "03" | "fc3" | "fc03" | "6" | "06" | "16" | "4x" | "hr" => return Some(3),
        _ => {}
    }
    if starts(&["coil", "co", "digital out"]) {
        Some(0)
    } else if starts(&["discrete", "di", "contact", "digital in"]) {
        Some(1)
    } else if starts(&["input", "read-only", "analog in"]) {
        Some(2)
    } else {
        starts(&["holding", "analog out"]).then_some(3)
    }
}

/// The type of a description, and the number of bytes of a text.
fn type_of(text: &str, size: Option<f64>) -> Option<(String, Option<u16>)> {
    let plain = |kind: &str| Some((kind.to_owned(), None));
    let word: String = text.to_lowercase().split_whitespace().collect();
    let word = word.replace('_', "");
    let digits = |from: &str| -> Option<u16> {
        let digits: String = from.chars().filter(char::is_ascii_digit).collect();
        digits.parse().ok()
    };
    if word.starts_with("str") || word.starts_with("ascii") || word.starts_with("char") {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "limited to 250"
        )]
        let size = size.map(|size| size.clamp(0.0, 250.0) as u16);
        let size = digits(&word).or(size)?;
        return Some(("str".to_owned(), Some(size + size % 2)));
    }
    match word.as_str() {
        "bool" | "boolean" | "bit" | "coil" | "u16" | "uint16" | "uint" | "word" | "ushort"
        | "unsigned" | "unsignedshort" | "enum" | "bitfield" | "bitfield16" | "flags" | "u2" => {
            plain("u16")
        }
        "i16" | "int16" | "s16" | "sint16" | "int" | "short" | "signed" | "integer" | "s2" => {
            plain("i16")
        }
        "u32" | "uint32" | "udint" | "dword" | "ulong" | "bitfield32" | "acc32" | "u4" => {
            plain("u32")
        }
        "i32" | "int32" | "s32" | "sint32" | "dint" | "long" | "s4" => plain("i32"),
        "u64" | "uint64" | "ulint" | "qword" | "acc64" | "u8bytes" => plain("u64"),
        "i64" | "int64" | "s64" | "lint" => plain("i64"),
        "f32" | "float" | "float32" | "real" | "single" | "f4" | "ieee754" => plain("f32"),
        "f64" | "float64" | "double" | "lreal" | "f8" => plain("f64"),
        _ => None,
    }
}

/// A number as maps write it, with a point or a comma.
fn number(text: &str) -> Option<f64> {
    if let Some(digits) = text.strip_prefix("0x") {
        return u32::from_str_radix(digits, 16).ok().map(f64::from);
    }
    let plain = text.replace(',', ".");
    let value: f64 = plain.parse().ok()?;
    value.is_finite().then_some(value)
}
