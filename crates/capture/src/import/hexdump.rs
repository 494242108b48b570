//! Dumps with offsets: xxd, hexdump, od, `tshark -x`.
//!
//! ```text
//! 00000000: ab24 0a00 d9ab 240a  .$....$.         xxd: bytes in order
//! 00000000  ab 24 0a 00 d9 ab 24 0a  |.$....$.|    hexdump -C, od -A x -t x1z
//! 0000000 24ab 000a abd9 0a24                      hexdump, od -x: words, low byte first
//! 0000000 022253 000012 125731 005044              od: octal words
//! *                                                the row before again, up to the next offset
//! 0000010                                          the end
//! ```
//!
//! What the cells mean is not guessed from one row: of all layouts that these tools have, the first
//! is taken in which every offset follows from the bytes before it, and the text beside the bytes,
//! if there is any, says the same.

mod layout;

use super::Look;
use super::imported::{ImportError, Imported, Options, Untimed};
use super::text::{Line, lines, utf8};
use layout::{Layout, Shape, layouts};

/// A line of a dump.
#[derive(Clone, Copy, Debug)]
enum Row<'a> {
    /// The row before, again and again.
    Again,
    /// An offset, and the rest of the line; nothing in it at the end.
    At(&'a str, &'a str),
}

/// Most bytes of a dump.
const BYTES_MAX: usize = 64 << 20;

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let rows = rows(bytes).ok()?;
    // A row alone or rows of few figures prove nothing: a device may send such lines.
    let is_long = |row: &Row<'_>| match row {
        Row::At(_, rest) => rest.split_ascii_whitespace().count() >= CELLS_MIN,
        Row::Again => false,
    };
    let first = rows.first().map(|(_, row)| row)?;
    let is_marked = has_mark(first) || (rows.len() > 1 && is_long(first));
    let has_data = rows
        .iter()
        .any(|(_, row)| matches!(row, Row::At(_, rest) if !rest.is_empty()));
    (has_data && is_marked && chunks(&rows).is_ok()).then_some(Look::Surely)
}

/// Cells of a first row from which on several rows are believed.
const CELLS_MIN: usize = 4;

/// Whether a row has what only a tool writes: a colon behind the offset, or text in bars.
fn has_mark(row: &Row<'_>) -> bool {
    matches!(row, Row::At(offset, rest) if offset.ends_with(':') || rest.ends_with('|'))
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let rows = rows(bytes)?;
    let (layout, first, chunks) = chunks(&rows)?;
    if layout.is_swapped() {
        out.note(
            "the dump has words: they are taken as low byte first, as od and hexdump write them \
             on a PC",
        );
    }
    if first > 0 {
        out.note(format!(
            "the dump begins at offset {first}: what was before it is missing"
        ));
    }
    let mut times = Untimed::new(options, out);
    let is_one = chunks.len() == 1;
    for chunk in chunks {
        if is_one {
            times.stream(options.direction, &chunk, out);
        } else {
            times.push(options.direction, &chunk, out);
            times.pause();
        }
    }
    Ok(())
}

fn rows(bytes: &[u8]) -> Result<Vec<(Line<'_>, Row<'_>)>, ImportError> {
    let full = lines(bytes).filter(|line| !line.text.trim_ascii().is_empty());
    full.map(|line| {
        let row = row(utf8(line.text));
        let wrong = || line.wrong("expected an offset and bytes, as xxd, hexdump and od write");
        Ok((line, row.ok_or_else(wrong)?))
    })
    .collect()
}

fn row(text: &str) -> Option<Row<'_>> {
    let text = text.trim_start();
    if text.trim_end() == "*" {
        return Some(Row::Again);
    }
    let end = text.find([' ', '\t']).unwrap_or(text.len());
    let (offset, rest) = text.split_at(end);
    let digits = offset.strip_suffix(':').unwrap_or(offset);
    let is_offset =
        (4..=16).contains(&digits.len()) && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    let rest = if rest.trim().is_empty() { "" } else { rest };
    is_offset.then_some(Row::At(offset, rest))
}

/// A layout, the offset of the first byte, and the bytes.
type Fit = (Layout, usize, Vec<Vec<u8>>);

/// The bytes by the first layout in which all rows fit; a dump may begin anew at offset 0, as one
/// of packets does.
fn chunks(rows: &[(Line<'_>, Row<'_>)]) -> Result<Fit, ImportError> {
    let offsets = || {
        rows.iter().filter_map(|(_, row)| match row {
            Row::At(offset, _) => Some(*offset),
            Row::Again => None,
        })
    };
    let shape = Shape {
        has_colon: offsets().any(|offset| offset.ends_with(':')),
    };
    let digits = offsets()
        .next()
        .map_or(0, |offset| offset.trim_end_matches(':').len());
    let mut worst: Option<ImportError> = None;
    for group in layouts(digits) {
        let mut fits: Vec<Fit> = Vec::new();
        for layout in group {
            match with(layout, shape, rows) {
                Ok((first, chunks)) => fits.push((layout, first, chunks)),
                Err(error) if worst.as_ref().is_none_or(|worst| error.line > worst.line) => {
                    worst = Some(error);
                }
                Err(_) => {}
            }
        }
        if !fits.is_empty() {
            return decided(fits, digits, rows);
        }
    }
    Err(worst.unwrap_or_else(|| ImportError::of_file("expected rows of an offset and bytes")))
}

/// The right one of what fits. Rows that "*" stands for may fit octal offsets as well as hex ones:
/// hexdump, whose are hex, fills its last row with spaces, od does not.
fn decided(
    mut fits: Vec<Fit>,
    digits: usize,
    rows: &[(Line<'_>, Row<'_>)],
) -> Result<Fit, ImportError> {
    let is_same = fits.iter().all(|fit| fit.2 == fits[0].2);
    if !is_same && digits == 7 && fits[0].0.is_of_hexdump() {
        let mut data = rows.iter().filter_map(|(line, row)| match row {
            Row::At(_, rest) if !rest.is_empty() => Some((line, rest)),
            _ => None,
        });
        let cells = |rest: &str| rest.split_ascii_whitespace().count();
        let first = data.next().map_or(0, |(_, rest)| cells(rest));
        let last = data.next_back();
        match last.filter(|(_, rest)| cells(rest) < first) {
            Some((_, rest)) => {
                let is_padded = rest.ends_with(' ');
                fits.retain(|fit| fit.0.has_hex_offsets() == is_padded);
            }
            None => {
                let (line, _) = rows[rows.len() - 1];
                return Err(line.wrong(
                    "the offsets may be octal (od) or hex (hexdump), and \"*\" hides which: dump \
                     all rows with -v, or use od -A x or hexdump -C",
                ));
            }
        }
    }
    let fit = fits.into_iter().next();
    fit.ok_or_else(|| ImportError::of_file("expected rows of an offset and bytes"))
}

/// The bytes by one layout.
fn with(
    layout: Layout,
    shape: Shape,
    rows: &[(Line<'_>, Row<'_>)],
) -> Result<(usize, Vec<Vec<u8>>), ImportError> {
    let mut chunks: Vec<Vec<u8>> = Vec::new();
    let (mut first, mut base, mut last_row) = (None, 0, Vec::new());
    let mut repeats = false;
    for (index, (line, row)) in rows.iter().enumerate() {
        let Row::At(offset, rest) = *row else {
            repeats = true;
            continue;
        };
        let offset = layout.offset(offset).ok_or_else(|| {
            line.wrong(format!("expected {} as the offset", layout.offset_name()))
        })?;
        first = first.or(Some(offset));
        let is_new = chunks.is_empty() || (offset == 0 && !rest.is_empty());
        if is_new {
            (base, repeats) = (offset, false);
            chunks.push(Vec::new());
        }
        let chunk = chunks.last_mut().expect("one was begun");
        if repeats {
            fill(chunk, base, offset, &last_row).map_err(|message| line.wrong(message))?;
            repeats = false;
        }
        let reached = base + chunk.len();
        if offset != reached {
            return Err(line.wrong(format!(
                "the offset is {offset:#x}, the bytes before it end at {reached:#x}: rows are \
                 missing or damaged"
            )));
        }
        if rest.is_empty() {
            continue;
        }
        let next = match rows.get(index + 1) {
            Some((_, Row::At(next, _))) => layout.offset(next),
            _ => None,
        };
        let len = next
            .and_then(|next| next.checked_sub(offset))
            .filter(|&len| len > 0);
        last_row = layout
            .row(rest, len, shape)
            .map_err(|message| line.wrong(message))?;
        chunk.extend_from_slice(&last_row);
    }
    Ok((first.unwrap_or(0), chunks))
}

/// Repeats the last row up to `offset`.
fn fill(chunk: &mut Vec<u8>, base: usize, offset: usize, row: &[u8]) -> Result<(), String> {
    let missing = offset.checked_sub(base + chunk.len());
    let missing = missing.filter(|missing| {
        !row.is_empty() && missing.is_multiple_of(row.len()) && *missing <= BYTES_MAX
    });
    let missing = missing.ok_or("the rows that \"*\" stands for do not end at this offset")?;
    chunk.extend(row.iter().cycle().take(missing));
    Ok(())
}

#[cfg(test)]
mod tests;
