//! The file format of SQLite 3, as far as the rows of a table require it. Read-only; a truncated or
//! damaged file gives its remaining rows.
//!
//! ```text
//! page: | kind u8 | 2 | cells u16 | 3 | right u32, if inner | cells' places u16 .. |   big-endian
//! leaf's cell: | length varint | row varint | header, values | next page u32, if they continue |
//! ```
//!
//! The C library is not used: it takes 53 s to compile with optimisation, 9 s without, and rejects
//! a damaged file as a whole.

use std::borrow::Cow;

use crate::finding::{Findings, Kind};

/// First bytes of every file.
pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";
/// Size of the file header, which is on the first page.
const HEADER: usize = 100;
/// Kinds of table pages: with numbers of further pages, and with rows.
const INNER: u8 = 5;
const LEAF: u8 = 13;
/// Maximum number of pages on the path from the first page of a table to a row.
const DEPTH_MAX: u32 = 20;

/// An SQLite file.
pub(super) struct Database<'a> {
    bytes: &'a [u8],
    page_size: usize,
    /// Number of used bytes of a page.
    usable: usize,
    /// Pages that have been read: each page belongs to one table.
    is_read: Vec<bool>,
}

/// A value of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value<'a> {
    Null,
    Integer(i64),
    Real,
    Text(&'a [u8]),
    Blob(&'a [u8]),
}

impl<'a> Value<'a> {
    /// The number; `row` replaces the value of a row id column.
    pub(super) const fn integer(self, row: i64) -> Option<i64> {
        match self {
            Self::Integer(number) => Some(number),
            Self::Null => Some(row),
            _ => None,
        }
    }

    pub(super) fn text(self) -> Option<&'a str> {
        match self {
            Self::Text(bytes) => core::str::from_utf8(bytes).ok(),
            _ => None,
        }
    }

    pub(super) const fn blob(self) -> Option<&'a [u8]> {
        match self {
            Self::Blob(bytes) => Some(bytes),
            _ => None,
        }
    }
}

/// A table.
pub(super) struct Table {
    first_page: u32,
    columns: Vec<String>,
}

impl Table {
    /// The index of a column.
    pub(super) fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column == name)
    }
}

impl<'a> Database<'a> {
    /// Opens the file, if its header is valid.
    pub(super) fn open(bytes: &'a [u8]) -> Option<Self> {
        let header = bytes.first_chunk::<HEADER>()?;
        let page_size = match u16::from_be_bytes([header[16], header[17]]) {
            1 => 0x1_0000,
            size => usize::from(size),
        };
        let usable = page_size.checked_sub(usize::from(header[20]))?;
        let is_sound = page_size.is_power_of_two() && page_size >= 512 && usable >= 480;
        (header.starts_with(MAGIC) && is_sound).then(|| Self {
            bytes,
            page_size,
            usable,
            is_read: vec![false; bytes.len().div_ceil(page_size)],
        })
    }

    /// The table called `name`.
    pub(super) fn table(&mut self, name: &str, findings: &mut Findings) -> Option<Table> {
        let mut found = None;
        // The first table lists the others: type, name, table, first page, definition.
        self.is_read.fill(false);
        self.rows(1, findings, &mut |_, values| {
            if let [kind, one, _, page, sql, ..] = values
                && kind.text() == Some("table")
                && one.text() == Some(name)
                && let (Some(page), Some(sql)) = (page.integer(0), sql.text())
            {
                found = u32::try_from(page).ok().map(|first_page| Table {
                    first_page,
                    columns: columns(sql),
                });
            }
        });
        found
    }

    /// Passes each row of a table, in order, with its number and its values.
    pub(super) fn each_row(
        &mut self,
        table: &Table,
        findings: &mut Findings,
        take: &mut dyn FnMut(i64, &[Value<'_>]),
    ) {
        self.rows(table.first_page, findings, take);
    }

    fn rows(
        &mut self,
        first: u32,
        findings: &mut Findings,
        take: &mut dyn FnMut(i64, &[Value<'_>]),
    ) {
        // A stack of pages to be read.
        let mut pages = vec![(first, 0)];
        while let Some((number, depth)) = pages.pop() {
            let below = self.page_rows(number, findings, take);
            match below {
                Ok(below) if depth < DEPTH_MAX => {
                    pages.extend(below.into_iter().rev().map(|page| (page, depth + 1)));
                }
                Ok(_) => {}
                Err(what) => {
                    let place = format_args!("page {number}");
                    findings.add(Kind::Part, place, format_args!("{what}"));
                }
            }
        }
    }

    /// Reads the rows of a page, or returns the pages below it.
    fn page_rows(
        &mut self,
        number: u32,
        findings: &mut Findings,
        take: &mut dyn FnMut(i64, &[Value<'_>]),
    ) -> Result<Vec<u32>, &'static str> {
        let page = self.page(number)?;
        let start = if number == 1 { HEADER } else { 0 };
        let kind = page[start];
        let count = u16_at(page, start + 3).unwrap_or(0);
        let head = match kind {
            INNER => 12,
            LEAF => 8,
            _ => return Err("is no page of a table"),
        };
        let cells = (0..usize::from(count)).map(|cell| {
            let at = usize::from(u16_at(page, start + head + 2 * cell)?);
            page.get(at..).filter(|cell| !cell.is_empty())
        });
        if kind == INNER {
            let below = cells.map(|cell| u32_at(cell?, 0));
            let right = u32_at(page, start + 8);
            return Ok(below.chain([right]).flatten().collect());
        }
        let mut lost = 0;
        for cell in cells {
            let taken = cell.and_then(|cell| {
                let (row, record) = self.record(cell)?;
                take(row, &values(&record)?);
                Some(())
            });
            lost += usize::from(taken.is_none());
        }
        if lost > 0 {
            let what = format_args!("{lost} rows that cannot be read");
            findings.add(Kind::Part, format_args!("page {number}"), what);
        }
        Ok(Vec::new())
    }

    /// Returns a page that has not been read yet.
    fn page(&mut self, number: u32) -> Result<&'a [u8], &'static str> {
        let index = (number as usize)
            .checked_sub(1)
            .ok_or("is no number of a page")?;
        let from = index.saturating_mul(self.page_size);
        let page = from
            .checked_add(self.usable)
            .and_then(|to| self.bytes.get(from..to))
            .ok_or("is behind the end of the file")?;
        if core::mem::replace(&mut self.is_read[index], true) {
            return Err("belongs to two places");
        }
        Ok(page)
    }

    /// The row number and the complete record of a leaf cell.
    fn record(&mut self, cell: &'a [u8]) -> Option<(i64, Cow<'a, [u8]>)> {
        let (length, rest) = varint(cell)?;
        let (row, rest) = varint(rest)?;
        let length = usize::try_from(length).ok()?;
        if length > self.bytes.len() {
            return None;
        }
        let most = self.usable - 35;
        if length <= most {
            return Some((row, Cow::Borrowed(rest.get(..length)?)));
        }
        let least = (self.usable - 12) * 32 / 255 - 23;
        let here = least + (length - least) % (self.usable - 4);
        let here = if here <= most { here } else { least };
        let mut record = rest.get(..here)?.to_vec();
        let mut next = u32_at(rest, here)?;
        while record.len() < length {
            let page = self.page(next).ok()?;
            next = u32_at(page, 0)?;
            let wanted = (length - record.len()).min(page.len() - 4);
            record.extend_from_slice(&page[4..4 + wanted]);
        }
        Some((row, Cow::Owned(record)))
    }
}

/// The values of a record.
fn values(record: &[u8]) -> Option<Vec<Value<'_>>> {
    let (length, mut kinds) = varint(record)?;
    let (_, mut rest) = record.split_at_checked(usize::try_from(length).ok()?)?;
    kinds = kinds.get(..kinds.len().checked_sub(rest.len())?)?;
    let mut values = Vec::new();
    while !kinds.is_empty() {
        let (kind, behind) = varint(kinds)?;
        kinds = behind;
        let length = match kind {
            0 | 8 | 9 => 0,
            1..=4 => usize::try_from(kind).ok()?,
            5 => 6,
            6 | 7 => 8,
            12.. => usize::try_from((kind - 12) / 2).ok()?,
            _ => return None,
        };
        let (value, behind) = rest.split_at_checked(length)?;
        rest = behind;
        values.push(match kind {
            0 => Value::Null,
            1..=6 => Value::Integer(integer(value)),
            7 => Value::Real,
            8 | 9 => Value::Integer(kind - 8),
            _ if kind % 2 == 0 => Value::Blob(value),
            _ => Value::Text(value),
        });
    }
    Some(values)
}

/// An integer of one to eight bytes.
fn integer(bytes: &[u8]) -> i64 {
    let sign = bytes.first().is_some_and(|first| first & 0x80 != 0);
    let start = if sign { -1 } else { 0 };
    let more = |number: i64, byte: &u8| number << 8 | i64::from(*byte);
    bytes.iter().fold(start, more)
}

/// A number of one to nine bytes: seven bits of each, all eight of the ninth.
fn varint(bytes: &[u8]) -> Option<(i64, &[u8])> {
    let mut number = 0_i64;
    for (index, byte) in bytes.iter().enumerate().take(9) {
        if index == 8 {
            return Some((number << 8 | i64::from(*byte), &bytes[9..]));
        }
        number = number << 7 | i64::from(byte & 0x7F);
        if byte & 0x80 == 0 {
            return Some((number, &bytes[index + 1..]));
        }
    }
    None
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    let bytes = bytes.get(at..)?.first_chunk()?;
    Some(u16::from_be_bytes(*bytes))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..)?.first_chunk()?;
    Some(u32::from_be_bytes(*bytes))
}

/// The names of the columns in `CREATE TABLE name (column type .., ..)`.
fn columns(sql: &str) -> Vec<String> {
    let (_, inside) = sql.split_once('(').unwrap_or_default();
    let mut depth = 0_i32;
    let parts = inside.split(|letter: char| {
        depth += match letter {
            '(' => 1,
            ')' => -1,
            _ => 0,
        };
        letter == ',' && depth == 0
    });
    let first = |part: &str| {
        let word = part.split_whitespace().next().unwrap_or_default();
        word.trim_matches(['"', '`', '[', ']', '\'']).to_owned()
    };
    parts.map(first).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples in sections 1.6 and 2.1 of the format's documentation.
    #[test]
    fn numbers_are_read_as_the_format_says() {
        assert_eq!(varint(&[0x81, 0x00]), Some((128, &[][..])));
        assert_eq!(varint(&[0xFF; 9]), Some((-1, &[][..])));
        assert_eq!(varint(&[0xFF; 8]), None);
        assert_eq!([integer(&[0xFF, 0xFE]), integer(&[0x7F])], [-2, 127]);
    }

    #[test]
    fn columns_are_named_by_their_first_words() {
        let sql =
            "CREATE TABLE messages(id INTEGER PRIMARY KEY,\n\"topic_id\" INTEGER, x DEC(3,2))";
        assert_eq!(columns(sql), ["id", "topic_id", "x"]);
    }
}
