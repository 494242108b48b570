//! One row a record: `time_s,link,direction,event,bytes,comment`.

use core::fmt::Write as _;

use super::Export;
use crate::Kind;
use engine::hex;

pub(super) fn write(export: &Export<'_>) -> String {
    let mut out = String::from("time_s,link,direction,event,bytes,comment\r\n");
    for record in &export.capture.records {
        let nanos = record.at.as_nanos();
        let (seconds, rest) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
        let link = export.capture.links.get(record.link);
        let link = quoted(link.map_or("", |link| &link.name));
        let event = match record.kind {
            Kind::Data => "data".to_owned(),
            Kind::Line(event) => quoted(crate::event_words(event)),
            Kind::Other(number) => format!("event {number}"),
        };
        let (direction, comment) = (record.direction.name(), quoted(&record.comment));
        write!(out, "{seconds}.{rest:09},{link},{direction},{event},")
            .expect("a string takes everything");
        hex::push_digits(&mut out, &record.bytes);
        write!(out, ",{comment}\r\n").expect("a string takes everything");
    }
    out
}

/// Formats a cell, in quotes if it contains a separator.
fn quoted(text: &str) -> String {
    if text.contains(['"', ',', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    /// RFC 4180, section 2, rules 5 to 7.
    #[test]
    fn a_cell_with_a_comma_or_a_quote_is_quoted() {
        assert_eq!(super::quoted("flip"), "flip");
        assert_eq!(super::quoted("a, \"b\""), "\"a, \"\"b\"\"\"");
    }

    /// Seconds with nine digits, the name of the link, and the event.
    #[test]
    fn each_record_is_a_row() {
        use super::super::{Belief, Laser};
        use super::*;
        use crate::replay::Recorded;
        use crate::{Capture, Interface, Record};
        use engine::rig::line::Direction;
        use protocols::Instant;

        let record = |kind, bytes: &[u8], comment: &str| Record {
            link: 0,
            sequence: None,
            at: Instant::from_nanos(12_345_678_901),
            direction: Direction::ToDevice,
            kind,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: comment.to_owned(),
        };
        let capture = Capture {
            links: vec![Interface::new("a,b", 9_600)],
            records: vec![
                record(Kind::Data, &[0xAB, 0x24], "flip"),
                record(Kind::Other(7), &[], ""),
                Record {
                    link: 9,
                    ..record(Kind::Data, &[1], "")
                },
            ],
            ..Capture::default()
        };
        let (recorded, belief) = (Recorded::default(), Belief::default());
        let text = write(&Export {
            capture: &capture,
            recorded: &recorded,
            belief: Some(&belief),
            laser: Laser::default(),
        });
        let expected = [
            "time_s,link,direction,event,bytes,comment",
            "12.345678901,\"a,b\",to-device,data,AB24,flip",
            "12.345678901,\"a,b\",to-device,event 7,,",
            "12.345678901,,to-device,data,01,",
            "",
        ];
        assert_eq!(text, expected.join("\r\n"));
    }
}
