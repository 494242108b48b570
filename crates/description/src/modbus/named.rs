//! Frames of Modbus with the names of registers. A reply has no register addresses, so its values
//! get names only with its request.

use std::collections::BTreeSet;

use super::{FUNCTIONS, is_read_response, words};
use crate::description::Description;
use crate::framing::Frame;
use crate::registers::{Cell, CellKind};
use crate::schema::message::From;
use crate::speak::{Read, tables, values};

/// A request to read registers, which gives its reply names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asked {
    address: u8,
    function: u8,
    at: u16,
    count: u16,
}

/// Words before numbers that are no registers, for a condition on a field.
const NUMBERED: [&str; 6] = ["coil", "coils", "device", "inputs", "register", "registers"];
/// All other words of frames.
const SAID: [&str; 13] = [
    "acknowledge",
    "busy",
    "device failure",
    "done",
    "illegal data address",
    "illegal data value",
    "illegal function",
    "of them",
    "refused",
    "too short for Modbus",
    "unknown",
    "unknown function",
    "true false inf nan",
];

fn word(high: u8, low: u8) -> u16 {
    u16::from_be_bytes([high, low])
}

impl Asked {
    /// Whether `bytes` have the size of the reply.
    fn fits(self, bytes: &[u8]) -> bool {
        let count = usize::from(self.count);
        bytes.len()
            == match self.function {
                1 | 2 => count.div_ceil(8),
                _ => 2 * count,
            }
    }

    /// The registers that the request covers at least in part.
    fn cells(self, of: &Description) -> Vec<&Cell> {
        let table = tables(of)
            .into_iter()
            .find(|(_, function, _)| *function == self.function);
        let [from, until] = [0, u32::from(self.count)].map(|more| u32::from(self.at) + more);
        let cells = table.into_iter().flat_map(|(_, _, table)| &table.cells);
        let is_asked = |cell: &&Cell| cell.at < until && cell.at + cell.len > from;
        cells.filter(is_asked).collect()
    }
}

impl Description {
    /// The device address in a frame of Modbus.
    pub fn addressee(&self, frame: &Frame) -> Option<u8> {
        self.protocol?;
        self.body_of(frame)?.first().copied()
    }

    /// The registers that a frame of Modbus asks to read, if it is such a request.
    pub fn asked(&self, frame: &Frame, from: From) -> Option<Asked> {
        self.protocol?;
        let body = self.body_of(frame)?;
        let [address, function @ 1..=4, rest @ ..] = &body[..] else {
            return None;
        };
        let &[a, b, c, d] = rest else {
            return None;
        };
        (!is_read_response(*function, rest, from)).then_some(Asked {
            address: *address,
            function: *function,
            at: word(a, b),
            count: word(c, d),
        })
    }

    /// As [`words_for`](Self::words_for), with the names of registers; `asked` is the last request
    /// to read.
    pub fn words_asked(&self, frame: &Frame, from: From, asked: Option<Asked>) -> String {
        let body = self.body_of(frame).filter(|_| self.protocol.is_some());
        let Some(body) = body else {
            return self.words_for(frame, from);
        };
        let plain = words(&body, from);
        let Some(named) = self.named(&body, from, asked) else {
            return plain;
        };
        match self.asked(frame, from) {
            None if body[1] < 5 => {
                let (name, _) = plain.rsplit_once(": ").unwrap_or((&plain, ""));
                format!("{name}: {named}")
            }
            _ => format!("{plain}: {named}"),
        }
    }

    /// The registers of a frame, with the values that it has.
    fn named(&self, body: &[u8], from: From, asked: Option<Asked>) -> Option<String> {
        let [address, function, rest @ ..] = body else {
            return None;
        };
        let told = |function: u8, at: u16, count: u16, bytes: &[u8]| {
            let read = Read {
                function,
                at,
                count,
            };
            let values = values(self, &read, bytes).into_iter();
            let told = values.map(|(cell, value)| {
                let variable = &self.variables[cell.variable];
                format!("{} {}", variable.name, variable.words(&value))
            });
            told.collect::<Vec<_>>()
        };
        let named = match (function, rest) {
            (1..=4, [_, bytes @ ..]) if is_read_response(*function, rest, from) => {
                let asked = asked.filter(|asked| {
                    (asked.address, asked.function) == (*address, *function) && asked.fits(bytes)
                })?;
                told(*function, asked.at, asked.count, bytes)
            }
            (1..=4, &[a, b, c, d]) => {
                let asked = Asked {
                    address: *address,
                    function: *function,
                    at: word(a, b),
                    count: word(c, d),
                };
                let cells = asked.cells(self).into_iter();
                let names = cells.map(|cell| self.variables[cell.variable].name.to_string());
                names.collect()
            }
            (5, &[a, b, value, _]) => told(1, word(a, b), 1, &[u8::from(value != 0)]),
            (6, [a, b, value @ ..]) => told(3, word(*a, *b), 1, value),
            (15, [a, b, c, d, _, bytes @ ..]) => {
                let count = word(*c, *d);
                let mut told = told(1, word(*a, *b), count, bytes);
                // The last byte has bits beyond the count.
                told.truncate(count.into());
                told
            }
            (16, [a, b, c, d, _, bytes @ ..]) => told(3, word(*a, *b), word(*c, *d), bytes),
            _ => return None,
        };
        (!named.is_empty()).then(|| named.join(", "))
    }

    /// The registers whose values are in frames that `from` sends.
    fn shown(&self, from: From) -> impl Iterator<Item = &Cell> {
        let tables = tables(self).into_iter();
        let cells = tables.flat_map(|(_, _, table)| &table.cells);
        cells.filter(move |cell| from != From::Host || cell.is_writable)
    }

    /// The fields for which frames of Modbus that `from` sends have a value; `None` for another
    /// protocol.
    pub fn shown_fields(&self, from: From) -> Option<Vec<&str>> {
        self.protocol?;
        let mut names = Vec::new();
        for cell in self.shown(from) {
            let variable = &self.variables[cell.variable];
            names.extend([&*variable.name, &variable.unit].map(|name: &str| name));
        }
        names.extend(NUMBERED);
        names.retain(|name| !name.is_empty());
        let mut seen = BTreeSet::new();
        names.retain(|name| seen.insert(*name));
        Some(names)
    }

    /// The words of frames of Modbus, as [`vocabulary`](Self::vocabulary).
    pub(crate) fn modbus_vocabulary(&self, beside_texts: bool) -> Option<Vec<&str>> {
        let cells = || {
            tables(self)
                .into_iter()
                .flat_map(|(_, _, table)| &table.cells)
        };
        let mut kinds = cells().map(|cell| cell.kind);
        if !beside_texts && kinds.any(|kind| matches!(kind, CellKind::Text(_))) {
            return None;
        }
        let mut words: BTreeSet<&str> = SAID.into_iter().chain(NUMBERED).collect();
        words.extend(FUNCTIONS.map(|(_, name)| name));
        for cell in cells() {
            let variable = &self.variables[cell.variable];
            words.extend([&*variable.name, variable.unit.as_str()]);
            let names = variable.names.iter().flat_map(|names| names.values());
            words.extend(names.map(String::as_str));
        }
        words.remove("");
        Some(words.into_iter().collect())
    }
}
