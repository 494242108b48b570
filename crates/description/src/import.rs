//! Descriptions from files of other tools: register maps as CSV, the JSON of pymodbus' simulator,
//! and the structures of Kaitai Struct.
//!
//! A map has addresses, types and names. It has no sources of values, latencies or line settings:
//! the draft contains usual ones, and says so.

mod csv;
mod ksy;
mod pymodbus;
mod words;

use core::fmt::Write as _;
use std::collections::BTreeSet;

use crate::Description;

/// A draft made of another tool's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Draft {
    /// The text of the description.
    pub text: String,
    /// The number of registers of a map.
    pub registers: usize,
    /// The number of fields of a structure.
    pub fields: usize,
    /// Parts of the file that are not in the draft.
    pub left_out: Vec<String>,
    /// The interpretations of ambiguous parts of the file.
    pub notes: Vec<String>,
}

/// The tables of a Modbus device, in the order of a description.
const TABLES: [&str; 4] = ["coils", "discrete", "input", "holding"];

/// The content of a map.
#[derive(Debug, Default)]
struct Map {
    rows: Vec<Row>,
    /// Settings of the line, as far as the file has them.
    line: Vec<(&'static str, String)>,
    left_out: Vec<String>,
    notes: Vec<String>,
}

/// A register of a map.
#[derive(Clone, Debug, Default, PartialEq)]
struct Row {
    /// Its line in the file, or 0.
    line: usize,
    /// Index in [`TABLES`].
    table: usize,
    at: u32,
    name: String,
    kind: String,
    /// Number of bytes of a text.
    size: Option<u16>,
    is_little_words: bool,
    /// The order of the bytes in a word.
    is_little_bytes: bool,
    is_writable: Option<bool>,
    scale: Option<f64>,
    offset: Option<f64>,
    unit: String,
    limits: Option<[f64; 2]>,
    /// The initial value as TOML.
    initial: Option<String>,
    about: String,
}

/// Makes a description called `name` of the register map or structure `file` with this text. A name
/// that ends with `.ksy` is a structure of Kaitai Struct.
///
/// # Errors
/// If the text is not such a file; the message names file, line and column, and the expected value.
pub fn import(name: &str, file: &str, text: &str) -> Result<Draft, String> {
    let text = text.trim_start_matches('\u{feff}');
    if file.to_ascii_lowercase().ends_with(".ksy") {
        return ksy::import(name, file, text);
    }
    let is_json = text.trim_start().starts_with('{');
    let map = match is_json {
        true => pymodbus::read(text),
        false => csv::read(text),
    };
    let mut map = map.map_err(|error| format!("{file}: {error}"))?;
    if map.rows.is_empty() {
        return Err(format!(
            "{file}: has no register, expected one on each line"
        ));
    }
    for part in map.left_out.iter_mut().chain(&mut map.notes) {
        *part = words::one_line(part);
    }
    name_rows(&mut map.rows);
    map.rows.sort_by_key(|row| (row.table, row.at));
    let draft = Draft {
        text: written(name, file, &map),
        registers: map.rows.len(),
        fields: 0,
        left_out: map.left_out,
        notes: map.notes,
    };
    // Overlaps and types are judged by the reader of descriptions; the lines are those of the map.
    match Description::parse(name, &draft.text, &|_| Err("no file".to_owned())) {
        Ok(_) => Ok(draft),
        Err(error) => Err(format!(
            "{file}: {}",
            in_lines_of(&map.rows, &draft.text, &error)
        )),
    }
}

/// The problems of a draft with the lines of the map.
fn in_lines_of(rows: &[Row], draft: &str, error: &crate::DescriptionError) -> String {
    let first = draft.lines().position(|line| line.starts_with("  { at = "));
    let mut rows = rows.iter();
    let mut line_of = std::collections::BTreeMap::new();
    for (number, line) in (1..).zip(draft.lines()).skip(first.unwrap_or(0)) {
        if line.starts_with("  { at = ")
            && let Some(row) = rows.next()
        {
            line_of.insert(number, row.line);
        }
    }
    let problems = error.problems.iter().map(|problem| {
        let line = line_of.get(&problem.line).copied().filter(|line| *line > 0);
        let key = problem.key.rsplit('.').next().unwrap_or_default();
        match line {
            Some(line) => format!("line {line}: {key}: {}", problem.message),
            None => format!("{key}: {}", problem.message),
        }
    });
    problems.collect::<Vec<_>>().join("; ")
}

/// Turns the names of a map into different names of variables.
fn name_rows(rows: &mut [Row]) {
    let mut used = BTreeSet::new();
    for row in rows {
        let base = identifier(&row.name, TABLES[row.table], row.at);
        let more = (2..).map(|number| format!("{base}_{number}"));
        let mut names = core::iter::once(base.clone()).chain(more);
        let name = names.find(|name| !used.contains(name)).unwrap_or(base);
        if row.about.is_empty() && row.name != name {
            row.about = row.name.trim().to_owned();
        }
        used.insert(name.clone());
        row.name = name;
    }
}

/// Words of expressions that no variable can have.
const RESERVED: [&str; 8] = [
    "and", "or", "not", "true", "false", "self", "request", "figure",
];

/// A name of lower-case letters, digits and underscores.
fn identifier(name: &str, table: &str, at: u32) -> String {
    let mut text = String::new();
    for c in name.trim().chars() {
        match c.to_ascii_lowercase() {
            c @ ('a'..='z' | '0'..='9') => text.push(c),
            _ if text.is_empty() || text.ends_with('_') => {}
            _ => text.push('_'),
        }
    }
    let text = text.trim_end_matches('_');
    let starts_well = text.starts_with(|c: char| c.is_ascii_lowercase());
    match starts_well && !RESERVED.contains(&text) {
        true => text.to_owned(),
        false if text.is_empty() => format!("{table}_{at}"),
        false => format!("r_{text}"),
    }
}

fn written(name: &str, file: &str, map: &Map) -> String {
    let [name, file] = [name, file].map(words::one_line);
    let of_line = |key: &str| map.line.iter().find(|(known, _)| *known == key);
    let [baud, format] = ["baud", "format"].map(|key| of_line(key).map(|(_, value)| value.clone()));
    let is_known = baud.is_some();
    let baud = baud.unwrap_or_else(|| "9600".to_owned());
    let format = format.unwrap_or_else(|| "8N1".to_owned());
    let mut text = format!(
        "# The registers of {file}. A map has no sources of values: until you set them, each register\n\
         # has its initial value. \"hilrig conform PORT --description {name}.toml\" compares a real\n\
         # device with this file.\n"
    );
    for part in &map.left_out {
        let _ = writeln!(text, "# Left out: {part}.");
    }
    for note in &map.notes {
        let _ = writeln!(text, "# Note: {note}.");
    }
    let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let about = quoted(&format!("Registers of {file}"));
    let _ = write!(
        text,
        "name = {}\nabout = {about}\nprotocol = \"modbus-rtu\"\nlatency = \"10ms\"                # \
         from a request to its reply: not in the map\nline = {{ baud = {baud}, format = \
         \"{format}\", address = 1 }}{}\n\n[registers]\n",
        quoted(&name),
        if is_known { "" } else { "  # not in the map" },
    );
    for (index, table) in TABLES.iter().enumerate() {
        let rows: Vec<&Row> = map.rows.iter().filter(|row| row.table == index).collect();
        if rows.is_empty() {
            continue;
        }
        let _ = writeln!(text, "{table} = [");
        for row in rows {
            let _ = writeln!(text, "  {{ {} }},", row.keys().join(", "));
        }
        text += "]\n";
    }
    text
}

impl Row {
    fn is_bit(&self) -> bool {
        self.table < 2
    }

    /// Its keys in a description.
    fn keys(&self) -> Vec<String> {
        let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
        let mut keys = vec![
            format!("at = {}", self.at),
            format!("name = {}", quoted(&self.name)),
        ];
        if !self.is_bit() && self.kind != "u16" {
            keys.push(format!("type = \"{}\"", self.kind));
        }
        if let Some(size) = self.size {
            keys.push(format!("size = {size}"));
        }
        let words = match self.is_little_words {
            true => "little",
            false => "big",
        };
        match (self.is_little_words, self.is_little_bytes) {
            _ if self.is_bit() || self.kind == "str" => {}
            (_, true) => keys.push(format!("endian = \"little\", words = \"{words}\"")),
            (true, false) => keys.push("words = \"little\"".to_owned()),
            (false, false) => {}
        }
        let may_be_written = ["holding", "coils"].contains(&TABLES[self.table]);
        if may_be_written && self.is_writable == Some(false) {
            keys.push("access = \"read\"".to_owned());
        }
        for (key, value) in [("scale", self.scale), ("offset", self.offset)] {
            if let Some(value) = value {
                keys.push(format!("{key} = {value:?}"));
            }
        }
        if !self.unit.is_empty() {
            keys.push(format!("unit = {}", quoted(&self.unit)));
        }
        if let Some([least, most]) = self.limits {
            keys.push(format!("limits = [{least:?}, {most:?}]"));
        }
        if let Some(initial) = &self.initial {
            keys.push(format!("initial = {initial}"));
        }
        if !self.about.is_empty() {
            keys.push(format!("about = {}", quoted(&self.about)));
        }
        keys
    }
}

#[cfg(test)]
mod tests;
