//! Bytes without time: taken as back to back at the line's rate.

use super::text::{lines, number, utf8};
use super::{ImportError, Imported, Options};
use crate::Kind;

/// Bytes of one record; a device's receiver is told a few at a time, too.
const PIECE: usize = 16;

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    out.clock = "virtual";
    let refuse = |message: &str| {
        Err(ImportError {
            line: 1,
            offset: 0,
            message: message.to_owned(),
        })
    };
    if lines(bytes)
        .next()
        .is_some_and(|line| is_stamped(line.text))
    {
        return refuse("tio wrote times between the bytes: expected its log without -t");
    }
    if options.baud.is_none() {
        return refuse("bytes without time: expected --baud to tell how long they took");
    }
    let link = out.link(&options.link, options);
    let mut done = 0;
    for piece in bytes.chunks(PIECE) {
        done += piece.len();
        let nanos = options.byte_nanos(done);
        out.push(link, nanos, options.direction, Kind::Data, piece);
    }
    Ok(())
}

/// Whether a line begins as tio's with -t, `[08:00:04.460] `.
fn is_stamped(text: &[u8]) -> bool {
    let text = text.get(..15).map(utf8).unwrap_or_default();
    let stamp = text
        .strip_prefix('[')
        .and_then(|text| text.strip_suffix("] "));
    let mut parts = stamp.unwrap_or_default().split([':', '.']);
    [2, 2, 2, 3].iter().all(|&len| {
        let part = parts.next().unwrap_or_default();
        part.len() == len && number(part).is_some()
    })
}
