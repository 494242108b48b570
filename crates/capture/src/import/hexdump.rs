//! Dumps with offsets: xxd, hexdump, od, `tshark -x`.
//!
//! ```text
//! 00000000: ab24 0a00 d9ab 240a  .$....$.         xxd: bytes in order
//! 00000000  ab 24 0a 00 d9 ab 24 0a  |.$....$.|    hexdump -C, od -A x -t x1z
//! 0000000 24ab 000a abd9 0a24                      hexdump, od -x: words, low byte first
//! 0000000 022253 000012 125731 005044              od: octal words
//! 0x3ffb4280   ab 24 0a 00 d9   |.$...|            addresses of a memory, gdb's too
//! *                                                the row before again, up to the next offset
//! 0000010                                          the end
//! ```
//!
//! The format of the cells is not derived from one row. The reader uses the first known layout that
//! satisfies two conditions. Every offset follows from the bytes before it, and the text column, if
//! present, shows the same bytes.
//!
//! Lines of words are heads: each begins a message and may contain its time and direction. Indented
//! rows among unindented ones are the other direction, as Wireshark shows a conversation. Rulers of
//! columns and a shell prompt at an end of the file are ignored.
//!
//! A row that is cut, changed or missing costs its own bytes: the offsets tell how many. They are
//! counted in a note. If no layout fits three of four rows, the file is refused with its first
//! error.

mod layout;
mod lines;
mod losses;

use super::Look;
use super::hextext::{Dates, Ends, Message, emit, log};
use super::imported::{ImportError, Imported, Options, Untimed};
use super::text::Line;
use super::textlog;
use layout::{Layout, Shape, layouts, same};
use lines::{Row, rows};
use losses::{Losses, stride};

/// Maximum number of bytes of a dump, and of a row.
const BYTES_MAX: usize = 64 << 20;
const ROW_MAX: usize = 64 << 10;

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    // Most other files have no row at their beginning; then the rest is not examined.
    lines::begins_with_rows(bytes).then_some(())?;
    let mut notes = Vec::new();
    let rows = rows(bytes, &mut notes).ok()?;
    let data = || {
        rows.iter().filter_map(|(_, row)| match row {
            Row::At { offset, rest, .. } => Some((offset, rest)),
            _ => None,
        })
    };
    // A lone row or rows of few figures prove nothing: a device may send such lines.
    let is_long = |rest: &str| {
        let mut cells = rest.split_ascii_whitespace();
        cells.clone().count() >= CELLS_MIN || cells.any(|cell| cell.len() >= 8)
    };
    let (offset, rest) = data().next()?;
    let has_mark = offset.ends_with(':') || rest.ends_with('|') || has_text(offset, rest);
    if super::text::lines(bytes).any(|line| textlog::is_raw(line.text)) && chunks(&rows).is_ok() {
        return Some(Look::Surely);
    }
    let is_marked = has_mark || (data().count() > 1 && is_long(rest));
    let has_data = data().any(|(_, rest)| !rest.is_empty());
    let heads = rows
        .iter()
        .filter(|(_, row)| matches!(row, Row::Head(_)))
        .count();
    let is_dump = heads <= data().count() && (heads == 0 || is_long(rest));
    (is_dump && has_data && is_marked && chunks(&rows).is_ok()).then_some(Look::Surely)
}

/// Reason why a file that begins with rows is no dump.
pub(super) fn doubt(bytes: &[u8]) -> Option<String> {
    lines::begins_with_rows(bytes).then_some(())?;
    let found = rows(bytes, &mut Vec::new()).and_then(|rows| chunks(&rows).map(|_| ()));
    found
        .err()
        .map(|error| format!("as a dump with offsets: {error}"))
}

/// Whether the text column shows the first bytes of the row.
fn has_text(offset: &str, rest: &str) -> bool {
    let pairs = rest.split_ascii_whitespace();
    let is_pair = |cell: &&str| cell.len() == 2 && engine::hex::byte(cell.as_bytes()).is_some();
    let is_zero = offset.bytes().all(|byte| byte == b'0');
    is_zero
        && pairs.clone().take_while(is_pair).count() >= 2
        && pairs.last().is_some_and(|last| !is_pair(&last))
}

/// Minimum number of cells in the first row of a valid dump of several rows.
const CELLS_MIN: usize = 4;

/// A group of bytes that belong together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Chunk {
    bytes: Vec<u8>,
    /// Index of the row that is its head.
    head: Option<usize>,
    /// Index of its first row.
    first: usize,
    is_indented: bool,
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let rows = rows(bytes, &mut out.notes)?;
    refuse_headers(&rows)?;
    let Fit {
        layout,
        first,
        chunks,
        losses,
    } = chunks(&rows)?;
    losses.note().into_iter().for_each(|note| out.note(note));
    if layout.is_swapped() {
        out.note(
            "the dump has words: they are taken as low byte first, as od and hexdump write them \
             on a PC",
        );
    }
    if first > 0 {
        out.note(format!(
            "the dump begins at offset {first}: the bytes before it are missing"
        ));
    }
    let heads = || rows.iter().filter_map(|(_, row)| words(row));
    let heads = Heads {
        ends: Ends::of(heads()),
        dates: Dates::of(heads()),
    };
    let notes = heads.ends.notes.iter().cloned().chain(heads.dates.note());
    notes.for_each(|note| out.note(note));
    if let [chunk] = &chunks[..] {
        let prefix = prefix(chunk, &rows, &heads);
        if prefix.at.is_none() && prefix.is_sent.is_none() {
            Untimed::new(options, out).stream(options.direction, &chunk.bytes, out);
            return Ok(());
        }
    }
    let messages = messages(chunks, &rows, &heads, out);
    emit(messages, options, out)
}

/// Refuses dumps of whole network packets, which are not bytes of a line.
fn refuse_headers(rows: &[(Line<'_>, Row)]) -> Result<(), ImportError> {
    const WORDS: [&str; 7] = [
        " IP ", " IP6 ", " TCP ", " UDP ", "Ethernet", "URB_", "Frame (",
    ];
    for (line, row) in rows {
        if let Row::Head(text) = row
            && WORDS.iter().any(|word| text.contains(word))
        {
            return Err(line.wrong(
                "these are packets with their headers, not the bytes of a line: import the pcap \
                 file itself, or export the payload with tshark -T fields -e data.data",
            ));
        }
    }
    Ok(())
}

/// The text of a head, or before a row of a log.
fn words(row: &Row) -> Option<&str> {
    match row {
        Row::Head(text) => Some(text),
        Row::At { before, .. } if !before.is_empty() => Some(before),
        _ => None,
    }
}

/// Information from all heads together.
struct Heads {
    ends: Ends,
    dates: Dates,
}

/// Time and direction of a chunk from its head, or from the text before its first row.
fn prefix(chunk: &Chunk, rows: &[(Line<'_>, Row)], heads: &Heads) -> log::Stamp {
    let head = chunk.head.and_then(|head| rows.get(head));
    let own = rows.get(chunk.first);
    let text = [head, own].into_iter().flatten();
    let text = text.into_iter().find_map(|(_, row)| words(row));
    text.map_or_else(log::Stamp::default, |text| {
        log::stamp(&heads.dates.told(&heads.ends.told(text)))
    })
}

fn messages<'a>(
    chunks: Vec<Chunk>,
    rows: &[(Line<'a>, Row)],
    heads: &Heads,
    out: &mut Imported,
) -> Vec<Message<'a>> {
    let has_lanes = chunks.iter().any(|chunk| chunk.is_indented)
        && chunks.iter().any(|chunk| !chunk.is_indented);
    if has_lanes {
        out.note("indented rows are taken as from the device, the others as to it");
    }
    let message = |chunk: Chunk| {
        let prefix = prefix(&chunk, rows, heads);
        let lane = has_lanes.then_some(!chunk.is_indented);
        let line = rows[chunk.head.unwrap_or(chunk.first)].0;
        Message::new(line, prefix.at, lane.or(prefix.is_sent), chunk.bytes)
    };
    chunks.into_iter().map(message).collect()
}

/// The rows, decoded with a layout.
#[derive(Clone, Debug)]
struct Fit {
    layout: Layout,
    /// Offset of the first byte.
    first: usize,
    chunks: Vec<Chunk>,
    losses: Losses,
}

/// Decodes with the first layout that fits all rows; if there is none, with the one that fits the
/// most. A dump may begin again at offset 0, as a dump of packets does.
fn chunks(rows: &[(Line<'_>, Row)]) -> Result<Fit, ImportError> {
    let offsets = || {
        rows.iter().filter_map(|(_, row)| match row {
            Row::At { offset, .. } => Some(offset.as_str()),
            _ => None,
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
            match with(layout, shape, rows, Losses::none()) {
                Ok(fit) => fits.push(fit),
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
    let few = Losses::of_few(offsets().count());
    let all = layouts(digits).flatten();
    let mut fits: Vec<Fit> = all
        .filter_map(|layout| with(layout, shape, rows, few.clone()).ok())
        .collect();
    let damage = |fit: &Fit| (fit.losses.rows, fit.losses.bytes);
    if let Some(least) = fits.iter().map(damage).min() {
        fits.retain(|fit| damage(fit) == least);
        return decided(fits, digits, rows);
    }
    Err(worst.unwrap_or_else(|| ImportError::of_file("expected rows of an offset and bytes")))
}

/// Chooses between several layouts that fit. With rows replaced by "*", octal and hex offsets may
/// both fit. hexdump writes hex offsets and pads its last row with spaces; od does not pad.
fn decided(
    mut fits: Vec<Fit>,
    digits: usize,
    rows: &[(Line<'_>, Row)],
) -> Result<Fit, ImportError> {
    let is_same = fits.iter().all(|fit| fit.chunks == fits[0].chunks);
    if !is_same && digits == 7 && fits[0].layout.is_of_hexdump() {
        let mut data = rows.iter().filter_map(|(line, row)| match row {
            Row::At { rest, .. } if !rest.is_empty() => Some((line, rest)),
            _ => None,
        });
        let cells = |rest: &str| rest.split_ascii_whitespace().count();
        let first = data.next().map_or(0, |(_, rest)| cells(rest));
        let last = data.next_back();
        match last.filter(|(_, rest)| cells(rest) < first) {
            Some((_, rest)) => {
                let is_padded = rest.ends_with(' ');
                fits.retain(|fit| fit.layout.has_hex_offsets() == is_padded);
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

/// Position of the rows of one indentation.
#[derive(Default)]
struct Lane {
    /// Offset after the last row, if one was read.
    reached: Option<usize>,
    last_row: Vec<u8>,
    repeats: bool,
}

/// Decodes the bytes with one layout.
fn with(
    layout: Layout,
    shape: Shape,
    rows: &[(Line<'_>, Row)],
    mut losses: Losses,
) -> Result<Fit, ImportError> {
    let mut chunks: Vec<Chunk> = Vec::new();
    let mut lanes = [Lane::default(), Lane::default()];
    let (mut first, mut head, mut is_open, mut last) = (None, None, false, 0);
    let stride = stride(layout, rows);
    let next_offset = |index: usize| {
        let next = rows[index + 1..].iter().find_map(|(_, row)| match row {
            Row::Same(_) => None,
            Row::At { offset, .. } => Some(layout.offset(offset)),
            _ => Some(None),
        });
        next.flatten()
    };
    for (index, (line, row)) in rows.iter().enumerate() {
        let (offset, rest, is_indented) = match row {
            Row::Head(_) => {
                if index + 1 == rows.len() {
                    let message = "expected rows of an offset and bytes behind this line";
                    losses.skip(line.wrong(message))?;
                    continue;
                }
                if losses.are_counted()
                    && lanes[last].reached.is_some()
                    && next_offset(index).is_some_and(|next| next > 0)
                {
                    losses.skip(line.wrong("expected an offset and bytes"))?;
                    continue;
                }
                (head, is_open) = (Some(index), false);
                continue;
            }
            Row::Again => {
                lanes[last].repeats = true;
                continue;
            }
            Row::Same(text) => {
                if !same(text, &lanes[last].last_row, shape) {
                    let message = "expected the bytes of the row before in another form";
                    losses.take(line.wrong(message))?;
                }
                continue;
            }
            Row::At {
                offset,
                rest,
                is_indented,
                ..
            } => (offset, rest, *is_indented),
        };
        let Some(offset) = layout.offset(offset) else {
            let message = format!("expected {} as the offset", layout.offset_name());
            losses.skip(line.wrong(message))?;
            continue;
        };
        let lane = usize::from(is_indented);
        let is_anew = offset == 0 && !rest.is_empty() && !lanes[lane].repeats;
        let own = &mut lanes[lane];
        if is_anew || own.reached.is_none() {
            own.reached = Some(offset);
            own.repeats = false;
        }
        let reached = own.reached.unwrap_or(offset);
        let is_gap = offset != reached && !own.repeats;
        if is_gap {
            let error = line.wrong(format!(
                "the offset is {offset:#x}, the bytes before it end at {reached:#x}: rows are \
                 missing or damaged"
            ));
            let is_damaged = offset < reached
                || offset - reached > losses::GAP_MAX.saturating_mul(stride)
                || next_offset(index).is_some_and(|next| next <= offset);
            if is_damaged {
                losses.skip(error)?;
                continue;
            }
            losses.gap(error)?;
            losses.bytes = losses.bytes.saturating_add(offset - reached);
        }
        first = first.or(Some(offset));
        if is_anew || !is_open || lane != last {
            chunks.push(Chunk {
                head: head.take(),
                first: index,
                is_indented,
                ..Chunk::default()
            });
        }
        (is_open, last) = (true, lane);
        let chunk = chunks.last_mut().expect("one was begun");
        if own.repeats {
            own.repeats = false;
            let missing = fill(&mut chunk.bytes, reached, offset, &own.last_row);
            if let Err(message) = missing {
                losses.take(line.wrong(message))?;
                losses.bytes = losses.bytes.saturating_add(offset.saturating_sub(reached));
            }
        }
        own.reached = Some(offset);
        if rest.is_empty() {
            continue;
        }
        let len = next_offset(index)
            .and_then(|next| next.checked_sub(offset))
            .filter(|&len| len > 0 && len <= ROW_MAX)
            .filter(|&len| !losses.are_counted() || len <= stride);
        let row = match layout.row(rest, len, shape) {
            Ok(row) => row,
            Err(message) => {
                losses.take(line.wrong(message))?;
                let kept = layout.rest_of(rest, len.unwrap_or(stride), shape);
                let lost = len.unwrap_or(kept.len()) - kept.len();
                losses.bytes += lost;
                own.reached = Some(offset.saturating_add(lost));
                kept
            }
        };
        let reached = own.reached.unwrap_or(offset);
        own.reached = Some(reached.saturating_add(row.len()));
        chunk.bytes.extend_from_slice(&row);
        own.last_row = row;
    }
    losses.end()?;
    chunks.retain(|chunk| !chunk.bytes.is_empty());
    Ok(Fit {
        layout,
        first: first.unwrap_or(0),
        chunks,
        losses,
    })
}

/// Repeats the last row up to `offset`.
fn fill(chunk: &mut Vec<u8>, reached: usize, offset: usize, row: &[u8]) -> Result<(), String> {
    let missing = offset.checked_sub(reached);
    let missing = missing.filter(|missing| {
        !row.is_empty() && missing.is_multiple_of(row.len()) && *missing <= BYTES_MAX
    });
    let missing = missing.ok_or("the rows that \"*\" stands for do not end at this offset")?;
    chunk.extend(row.iter().cycle().take(missing));
    Ok(())
}

#[cfg(test)]
mod tests;
