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
}
