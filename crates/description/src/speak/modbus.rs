//! Registers of a Modbus device, by name.

use super::{Asks, Reply, Request, number};
use crate::description::Description;
use crate::modbus;
use crate::number::NumberKind;
use crate::registers::{Cell, CellKind, Table};
use crate::schema::message::From;
use crate::value::Value;

/// The range that a request reads: function, first address and count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Read {
    pub(crate) function: u8,
    pub(crate) at: u16,
    pub(crate) count: u16,
}

/// Name of a table, the function that reads it, and the table.
type Known<'a> = (&'static str, u8, &'a Table);

pub(crate) fn tables(of: &Description) -> Vec<Known<'_>> {
    let Some(all) = &of.registers else {
        return Vec::new();
    };
    let tables = [
        ("coils", 1, &all.coils),
        ("discrete", 2, &all.discrete),
        ("holding", 3, &all.holding),
        ("input", 4, &all.input),
    ];
    let known = |function: u8| all.functions.is_empty() || all.functions.contains(&function);
    let used = tables
        .into_iter()
        .filter(|(_, function, table)| !table.is_empty() && known(*function));
    used.collect()
}

/// The register called `name`.
fn find<'a>(of: &'a Description, name: &str) -> Option<(u8, &'a Cell)> {
    tables(of).into_iter().find_map(|(_, function, table)| {
        let cell = table
            .cells
            .iter()
            .find(|cell| *of.variables[cell.variable].name == *name);
        cell.map(|cell| (function, cell))
    })
}

pub(super) fn phrases(of: &Description) -> Vec<String> {
    let mut phrases = vec!["read".to_owned()];
    for (_, _, table) in tables(of) {
        for cell in &table.cells {
            let name = &of.variables[cell.variable].name;
            phrases.push(format!("read {name}"));
            if cell.is_writable {
                phrases.push(format!("write {name}=VALUE"));
            }
        }
    }
    phrases.push("read TABLE ADDRESS COUNT".to_owned());
    phrases
}

/// The words that may follow `before` in a request.
pub(super) fn words_behind(of: &Description, before: &[&str]) -> Vec<String> {
    let cells = || {
        let tables = tables(of).into_iter();
        tables.flat_map(|(_, _, table)| &table.cells)
    };
    let name = |cell: &Cell| of.variables[cell.variable].name.to_string();
    match before {
        [] => ["read", "write"].map(str::to_owned).to_vec(),
        ["read", ..] => cells().map(name).collect(),
        ["write", ..] => {
            let writable = cells().filter(|cell| cell.is_writable);
            writable.map(|cell| format!("{}=", name(cell))).collect()
        }
        _ => Vec::new(),
    }
}

pub(super) fn requests(of: &Description, words: &[&str]) -> Result<Vec<Request>, String> {
    match words {
        ["read"] => {
            let all = tables(of).into_iter().flat_map(|(_, function, table)| {
                table
                    .cells
                    .iter()
                    .map(move |cell| read_cell(of, function, cell))
            });
            Ok(all.collect())
        }
        ["read", table, at, count] if table_named(of, table).is_ok() => {
            let (_, function, _) = table_named(of, table)?;
            let word = |text: &str| {
                let parsed = crate::compile::whole(text).and_then(|at| u16::try_from(at).ok());
                parsed.ok_or_else(|| format!("\"{text}\": expected a number from 0 to 65535"))
            };
            Ok(vec![read(of, function, word(at)?, word(count)?)])
        }
        ["read", names @ ..] => {
            let requests = names.iter().map(|name| {
                let (function, cell) = find(of, name).ok_or_else(|| unknown(of, name))?;
                Ok(read_cell(of, function, cell))
            });
            requests.collect()
        }
        ["write", pairs @ ..] if !pairs.is_empty() => {
            let requests = pairs.iter().map(|pair| {
                let (name, text) = pair
                    .split_once('=')
                    .ok_or_else(|| format!("\"{pair}\": expected NAME=VALUE"))?;
                let (function, cell) = find(of, name).ok_or_else(|| unknown(of, name))?;
                if !cell.is_writable {
                    return Err(read_only(of, name));
                }
                let names = of.variables[cell.variable].names.as_ref();
                let named = names.and_then(|names| {
                    let found = names.iter().find(|(_, known)| *known == text);
                    found.map(|(number, _)| Value::Int(*number))
                });
                let value = match (named, cell.kind) {
                    (Some(value), _) => value,
                    (None, CellKind::Text(_)) => Value::Text(text.to_owned()),
                    (None, _) => number(text)
                        .ok_or_else(|| format!("{name}=\"{text}\": expected a number"))?,
                };
                order(of, function, cell, value)
                    .map_err(|allowed| format!("{name} cannot be {text}, {allowed}"))
            });
            requests.collect()
        }
        _ => Err(format!("expected one of {}", phrases(of).join("; "))),
    }
}

fn table_named<'a>(of: &'a Description, name: &str) -> Result<Known<'a>, String> {
    let found = tables(of).into_iter().find(|(known, ..)| *known == name);
    found.ok_or_else(|| unknown(of, name))
}

fn unknown(of: &Description, name: &str) -> String {
    let cells = tables(of)
        .into_iter()
        .flat_map(|(_, _, table)| &table.cells);
    let names: Vec<_> = cells
        .map(|cell| &*of.variables[cell.variable].name)
        .collect();
    format!(
        "there is no register \"{name}\", expected one of: {}",
        names.join(", ")
    )
}

/// The error of a write to a register that only the device changes.
fn read_only(of: &Description, name: &str) -> String {
    let all = words_behind(of, &["write"]);
    let writable: Vec<_> = all.iter().map(|one| one.trim_end_matches('=')).collect();
    let expected = match &writable[..] {
        [] => "no register of this device can be written".to_owned(),
        some => format!("expected one of: {}", some.join(", ")),
    };
    format!("the register \"{name}\" is read-only, {expected}; `read {name}` reads it")
}

fn read_cell(of: &Description, function: u8, cell: &Cell) -> Request {
    let [at, count] = [cell.at, cell.len].map(|value| u16::try_from(value).unwrap_or(u16::MAX));
    let mut request = read(of, function, at, count);
    request.words = format!("read {}", of.variables[cell.variable].name);
    request
}

/// A request to read registers.
pub(crate) fn read(of: &Description, function: u8, at: u16, count: u16) -> Request {
    let [at_bytes, count_bytes] = [at, count].map(u16::to_be_bytes);
    let pdu = [&[function][..], &at_bytes, &count_bytes].concat();
    let name = modbus::function_name(function);
    let read = Read {
        function,
        at,
        count,
    };
    raw(
        of,
        &pdu,
        format!("{name} {at}, {count} of them"),
        Some(read),
    )
}

/// A request to write a register with a value that a user orders. The request names the value that
/// the register gets: a scaled one is rounded to a whole count.
///
/// # Errors
/// If the value does not fit the register; with the allowed values.
fn order(of: &Description, function: u8, cell: &Cell, value: Value) -> Result<Request, String> {
    let bytes = cell.bytes_of_order(&value)?;
    let is_counted =
        matches!(cell.kind, CellKind::Number(number) if number.kind != NumberKind::Float);
    let written = match is_counted && cell.scale.is_some() {
        true => cell.value(&bytes),
        false => value,
    };
    Ok(write(of, function, cell, &written))
}

/// A request to write a register with a value.
pub(crate) fn write(of: &Description, function: u8, cell: &Cell, value: &Value) -> Request {
    let name = &of.variables[cell.variable].name;
    let at = u16::try_from(cell.at).unwrap_or(u16::MAX).to_be_bytes();
    let bytes = cell.bytes(value);
    let pdu = match (function, cell.len) {
        (1, _) => [
            &[5][..],
            &at,
            if bytes == [0] { &[0, 0] } else { &[0xFF, 0] },
        ]
        .concat(),
        (_, 1) => [&[6][..], &at, &bytes].concat(),
        (_, len) => {
            let count = u16::try_from(len).unwrap_or(0).to_be_bytes();
            let size = u8::try_from(bytes.len()).unwrap_or(u8::MAX);
            [&[16][..], &at, &count, &[size], &bytes].concat()
        }
    };
    raw(of, &pdu, format!("write {name}={value}"), None)
}

/// A request with the bytes `pdu` behind the address.
pub(crate) fn raw(of: &Description, pdu: &[u8], words: String, read: Option<Read>) -> Request {
    let address = of
        .address
        .and_then(|address| u8::try_from(address).ok())
        .unwrap_or(1);
    let body = [&[address][..], pdu].concat();
    Request {
        words,
        bytes: of.frame_of(0, &body).unwrap_or_default(),
        asks: Asks::Modbus { address, read },
    }
}

pub(super) fn reply(of: &Description, address: u8, read: Option<&Read>, body: &[u8]) -> Reply {
    let mut reply = Reply::unknown(modbus::words(body, From::Device));
    let [from, function, rest @ ..] = body else {
        return reply;
    };
    reply.is_asked = *from == address;
    reply.is_refusal = function & 0x80 != 0;
    let Some(read) = read.filter(|read| read.function == *function) else {
        return reply;
    };
    let Some((count, bytes)) = rest.split_first() else {
        return reply;
    };
    if usize::from(*count) != bytes.len() {
        return reply;
    }
    for (cell, value) in values(of, read, bytes) {
        let variable = &of.variables[cell.variable];
        let words = variable.words(&value);
        reply.values.push((variable.name.to_string(), value, words));
    }
    let told = reply
        .values
        .iter()
        .map(|(name, _, words)| format!("{name} {words}"));
    let told: Vec<_> = told.collect();
    if !told.is_empty() {
        reply.words = told.join(", ");
    }
    reply
}

/// The registers that lie completely within the range that was read, with their values.
pub(crate) fn values<'a>(of: &'a Description, read: &Read, bytes: &[u8]) -> Vec<(&'a Cell, Value)> {
    let table = tables(of)
        .into_iter()
        .find(|(_, function, _)| *function == read.function);
    let Some((_, _, table)) = table else {
        return Vec::new();
    };
    let bits: Vec<u8>;
    let (plain, unit) = match read.function {
        1 | 2 => {
            bits = bytes
                .iter()
                .flat_map(|byte| (0..8).map(move |bit| byte >> bit & 1))
                .collect();
            (&bits[..], 1)
        }
        _ => (bytes, 2),
    };
    let cells = table.cells.iter().filter_map(|cell| {
        let first = usize::try_from(cell.at.checked_sub(read.at.into())?).ok()? * unit;
        let len = usize::try_from(cell.len).ok()? * unit;
        let raw = plain.get(first..first + len)?;
        Some((cell, cell.value(raw)))
    });
    cells.collect()
}
