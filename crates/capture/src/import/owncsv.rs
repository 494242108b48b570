//! The CSV form of `hilrig export`: `time_s,link,direction,event,bytes,comment`.

use protocols::LineEvent;

use super::Look;
use super::cells::{CellRow, rows};
use super::imported::{ImportError, Imported, Options};
use super::text::decimal_nanos;
use crate::{Kind, event_words};
use engine::hex;
use engine::rig::line::Direction;

const HEAD: [&str; 6] = ["time_s", "link", "direction", "event", "bytes", "comment"];

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let head = rows(bytes).next()?;
    (head.cells == HEAD).then_some(Look::Surely)
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    out.clock = "virtual";
    let mut rows = rows(bytes);
    let head = rows
        .next()
        .ok_or_else(|| ImportError::of_file("expected rows, found none"))?;
    if head.cells != HEAD {
        return Err(head
            .line
            .wrong(format!("expected the head \"{}\"", HEAD.join(","))));
    }
    if options.baud.is_none() {
        out.note("the file contains no baud rates: --baud N sets one for all links");
    }
    for row in rows {
        record(&row, options, out)?;
    }
    Ok(())
}

fn record(row: &CellRow<'_>, options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let wrong = |what: &str| row.line.wrong(format!("expected {what}"));
    let [time, link, way, event, bytes, comment] = &row.cells[..] else {
        return Err(wrong("six columns"));
    };
    let nanos = decimal_nanos(time).ok_or_else(|| wrong("seconds as time_s"))?;
    let ways = [Direction::ToMaster, Direction::ToDevice];
    let direction = ways.into_iter().find(|direction| direction.name() == way);
    let direction = direction.ok_or_else(|| wrong("to-master or to-device"))?;
    let kind = kind(event).ok_or_else(|| wrong("data or an event as \"port closed\""))?;
    let bytes = hex::bytes(bytes).ok_or_else(|| wrong("bytes as pairs of hex digits"))?;
    let link = out.link(link, options);
    out.line = row.line.number;
    out.push(link, nanos, direction, kind, &bytes);
    if let Some(last) = out.records.last_mut() {
        last.comment.clone_from(comment);
    }
    Ok(())
}

fn kind(words: &str) -> Option<Kind> {
    const EVENTS: [LineEvent; 6] = [
        LineEvent::Opened,
        LineEvent::Closed,
        LineEvent::Break,
        LineEvent::FramingError,
        LineEvent::ParityError,
        LineEvent::Overrun,
    ];
    if words == "data" {
        return Some(Kind::Data);
    }
    let event = EVENTS
        .into_iter()
        .find(|&event| event_words(event) == words);
    let number = || words.strip_prefix("event ")?.parse().ok();
    event.map(Kind::Line).or_else(|| number().map(Kind::Other))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};

    /// The format that `hilrig export` writes: a comment may contain line ends and commas.
    #[test]
    fn rows_are_records_again() {
        let text = "time_s,link,direction,event,bytes,comment\r\n\
                    1.000000501,lidar,to-master,data,FAA0,\"fault: a, b\nc\"\r\n\
                    1.000000502,base,to-device,port closed,,\r\n\
                    1.000000503,base,to-device,event 6,,\r\n";
        assert_eq!(Format::detect(text.as_bytes()), Some(Format::Csv));
        let found = read_format(text.as_bytes(), Format::Csv, &Options::default());
        let found = found.expect("sound");
        let names: Vec<_> = found.links().iter().map(|link| &*link.name).collect();
        assert_eq!(names, ["lidar", "base"]);
        let first = &found.records()[0];
        assert_eq!(first.at.as_nanos(), 1_000_000_501);
        assert_eq!(
            (&first.bytes[..], &*first.comment),
            (&b"\xFA\xA0"[..], "fault: a, b\nc")
        );
        let kinds: Vec<Kind> = found.records().iter().map(|one| one.kind).collect();
        assert_eq!(kinds[1..], [Kind::Line(LineEvent::Closed), Kind::Other(6)]);
    }

    #[test]
    fn a_wrong_cell_is_named() {
        let error = |row: &str| {
            let text = format!("time_s,link,direction,event,bytes,comment\n{row}\n");
            let found = read_format(text.as_bytes(), Format::Csv, &Options::default());
            found.expect_err("wrong").to_string()
        };
        assert!(error("x,a,to-master,data,FA,").contains("time_s"));
        assert!(error("1,a,up,data,FA,").contains("to-device"));
        assert!(error("1,a,to-master,dat,FA,").contains("port closed"));
        assert!(error("1,a,to-master,data,F,").contains("pairs"));
        assert!(error("1,a").contains("six columns"));
    }
}
