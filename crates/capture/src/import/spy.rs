//! Log of pySerial's `spy://` port: reads and writes of a program.
//!
//! ```text
//! 000000.011 RX   0000  00 01 02 03 04 05 06 07  08 09  ..........
//! 000000.061 RTS  inactive
//! ```
//!
//! Times count from the opening of the port. A dump of more than 16 bytes continues in further
//! lines with higher offsets. Lines of other events contain no bytes.

use super::imported::{ImportError, Imported, Options};
use super::text::{decimal_nanos, lines, number, utf8};
use crate::Kind;
use engine::hex;

struct Row<'a> {
    nanos: u64,
    event: &'a str,
    rest: &'a str,
}

fn row(text: &[u8]) -> Option<Row<'_>> {
    let text = utf8(text);
    let (time, rest) = text.split_once(' ')?;
    let (whole, fraction) = time.split_once('.')?;
    if whole.len() != 6 || fraction.len() != 3 || number(whole).is_none() {
        return None;
    }
    let (event, rest) = rest.split_once(' ').unwrap_or((rest, ""));
    let is_event = (2..=4).contains(&event.len());
    is_event.then_some(Row {
        nanos: decimal_nanos(time)?,
        event,
        rest: rest.trim_start(),
    })
}

/// Offset and bytes of a row of data.
fn data(row: &Row<'_>) -> Option<(usize, Vec<u8>)> {
    let (offset, rest) = row.rest.split_once("  ")?;
    let offset = usize::from_str_radix(offset, 16)
        .ok()
        .filter(|_| offset.len() >= 4)?;
    // Sixteen pairs of three columns, with a gap after eight pairs.
    let end = rest.char_indices().nth(49).map_or(rest.len(), |(at, _)| at);
    let pairs = rest[..end].split_ascii_whitespace();
    let bytes: Option<Vec<u8>> = pairs.map(|pair| hex::byte(pair.as_bytes())).collect();
    bytes
        .filter(|bytes| !bytes.is_empty())
        .map(|bytes| (offset, bytes))
}

/// Whether a line is a row of data.
pub(super) fn is_data(text: &[u8]) -> bool {
    row(text).is_some_and(|row| matches!(row.event, "RX" | "TX") && data(&row).is_some())
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    out.clock = "virtual";
    let link = out.link(&options.link, options);
    let mut open: Option<(u64, bool, Vec<u8>)> = None;
    for line in lines(bytes).filter(|line| !line.text.trim_ascii().is_empty()) {
        let expected = "expected \"SSSSSS.mmm TX   0000  AB 24 ..\", as spy:// writes";
        let row = row(line.text).ok_or_else(|| line.wrong(expected))?;
        let is_received = match row.event {
            "RX" => true,
            "TX" => false,
            _ => continue,
        };
        if row.rest.starts_with('<') {
            continue;
        }
        let (offset, bytes) = data(&row).ok_or_else(|| line.wrong(expected))?;
        match &mut open {
            Some((_, way, so_far)) if offset > 0 => {
                if *way != is_received || offset != so_far.len() {
                    return Err(line.wrong("expected the offset behind the row before"));
                }
                so_far.extend(bytes);
            }
            None if offset > 0 => return Err(line.wrong("expected offset 0000 first")),
            _ => {
                flush(link, open.take(), options, out);
                out.line = line.number;
                open = Some((row.nanos, is_received, bytes));
            }
        }
    }
    flush(link, open, options, out);
    Ok(())
}

fn flush(link: usize, one: Option<(u64, bool, Vec<u8>)>, options: &Options, out: &mut Imported) {
    if let Some((nanos, is_received, bytes)) = one {
        out.push(link, nanos, options.way(is_received), Kind::Data, &bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    /// pySerial 3.5 on a pseudo-terminal: `spy:///dev/pts/N?file=spy.txt&all`.
    const SPIED: &str = "\
000000.000 TX   0000  AB 24 0A 00 D9                                    .$...           \n\
000000.011 RX   0000  00 01 02 03 04 05 06 07  08 09 0A 0B 0C 0D 0E 0F  ................\n\
000000.011 RX   0010  10 11 12                                          ...             \n\
000000.061 RX   <empty>\n\
000000.061 RTS  inactive\n";

    #[test]
    fn reads_and_writes_are_two_directions() {
        assert_eq!(Format::detect(SPIED.as_bytes()), Some(Format::Spy));
        let found = read_format(SPIED.as_bytes(), Format::Spy, &Options::default());
        let found = found.expect("sound");
        let tuple = |one: &crate::Record| (one.at.as_millis(), one.direction, one.bytes.to_vec());
        let told: Vec<_> = found.records().iter().map(tuple).collect();
        let received: Vec<u8> = (0..0x13).collect();
        let sent = vec![0xAB, 0x24, 0x0A, 0x00, 0xD9];
        let expected = [
            (0, Direction::ToDevice, sent),
            (11, Direction::ToMaster, received),
        ];
        assert_eq!(told, expected);
    }

    #[test]
    fn a_lost_row_is_an_error() {
        let lost = SPIED.replace("RX   0000", "RX   0008");
        let error = read_format(lost.as_bytes(), Format::Spy, &Options::default());
        assert!(error.expect_err("lost").to_string().starts_with("line 2"));
    }

    /// A row has six digits, three digits, an event, an offset of four digits and up to sixteen
    /// bytes.
    #[test]
    fn each_part_of_a_row_counts() {
        for text in [
            "000000.000 TX   0000  AB 24",
            "123456.789 RX   0010  AB",
            "000000.000 TX   00000  AB",
        ] {
            assert!(is_data(text.as_bytes()), "{text}");
        }
        for text in [
            "00000.000 TX   0000  AB",
            "000000.00 TX   0000  AB",
            "00000x.000 TX   0000  AB",
            "000000.000 T   0000  AB",
            "000000.000 XX   0000  AB",
            "000000.000 RTS  inactive",
            "000000.000 RX   <empty>",
            "000000.000 TX   000  AB",
            "000000.000 TX   000g  AB",
            "000000.000 TX   0000  ABC",
            "000000.000 TX   0000  ",
        ] {
            assert!(!is_data(text.as_bytes()), "{text}");
        }
        // The text behind sixteen bytes may look like bytes.
        let text = "000000.000 TX   0000  00 01 02 03 04 05 06 07  08 09 0A 0B 0C 0D 0E 0F  41 42";
        let row = row(text.as_bytes()).expect("a row");
        assert_eq!(data(&row), Some((0, (0..16).collect())));
    }

    /// An offset continues the bytes of the same direction; the first row has offset 0.
    #[test]
    fn an_offset_continues_the_row_before() {
        let error = |text: &str| {
            let found = read(text.as_bytes(), &Options::default(), &mut Imported::new());
            found.map_err(|error| error.message)
        };
        let first = "000000.000 TX   0000  AB 24\n";
        let behind =
            |way: &str, offset: &str| error(&format!("{first}000000.000 {way}   {offset}  0A\n"));
        assert_eq!(behind("TX", "0002"), Ok(()));
        let wrong = Err("expected the offset behind the row before".to_owned());
        assert_eq!(behind("TX", "0003"), wrong);
        assert_eq!(behind("RX", "0002"), wrong);
        assert_eq!(behind("RX", "0000"), Ok(()));
        assert_eq!(
            error("000000.000 TX   0002  AB\n"),
            Err("expected offset 0000 first".to_owned())
        );
    }
}
