//! Annotations of sigrok's UART decoder as a JSON trace, which distinguishes RX from TX.
//!
//! ```text
//! {"traceEvents": [{"ph": "B", "ts": 509.0, "pid": "uart-1", "tid": "RX", "name": "AB"}, ..
//! ```
//!
//! Times are in microseconds. The two events of a byte mark the start and the end of its data bits.

use serde::Deserialize;

use protocols::LineEvent;

use super::Look;
use super::imported::{ImportError, Imported, Options};
use super::roles::roles;
use super::text::utf8;
use crate::Kind;
use engine::hex;

#[derive(Deserialize)]
struct Trace {
    #[serde(rename = "traceEvents")]
    events: Vec<Event>,
}

#[derive(Deserialize)]
struct Event {
    ph: String,
    ts: f64,
    pid: String,
    tid: String,
    name: String,
}

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let head = utf8_head(bytes).trim_start();
    (head.starts_with('{') && head.contains("\"traceEvents\"")).then_some(Look::Surely)
}

fn utf8_head(bytes: &[u8]) -> &str {
    utf8(&bytes[..bytes.len().min(256)])
}

/// Whether a row of a UART decoder contains its bytes.
fn is_data(row: &str) -> bool {
    matches!(
        row,
        "RX" | "TX" | "RX data" | "TX data" | "rx-data" | "tx-data"
    )
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    out.clock = "virtual";
    let trace: Trace = serde_json::from_slice(bytes).map_err(|error| {
        let line = error.line().max(1);
        let starts = bytes
            .iter()
            .zip(1_usize..)
            .filter(|(byte, _)| **byte == b'\n');
        let offset = match line {
            1 => 0,
            _ => starts.map(|(_, at)| at).nth(line - 2).unwrap_or(0),
        };
        ImportError {
            line,
            offset,
            message: format!("expected a trace of sigrok-cli: {error}"),
        }
    })?;
    let is_uart = |event: &&Event| event.pid.starts_with("uart-");
    let other = trace.events.iter().find(|event| !is_uart(event));
    if let Some(other) = other {
        let pid = &other.pid;
        out.note(format!(
            "annotations of {pid} are skipped: they belong to no serial line"
        ));
    }
    let own = || {
        trace
            .events
            .iter()
            .filter(is_uart)
            .filter(|event| is_data(&event.tid))
    };
    let mut names: Vec<String> = Vec::new();
    for event in own() {
        let name = format!("{} {}", event.pid, event.tid);
        if !names.contains(&name) {
            names.push(name);
        }
    }
    if names.is_empty() {
        return Err(ImportError::of_file(
            "the trace has no bytes of a UART: decode with -P uart:baudrate=N:rx=CHANNEL",
        ));
    }
    // One decoder is one line, so its number is omitted from the name.
    let is_one = names.iter().all(|name| name.starts_with("uart-1 "));
    let shown: Vec<String> = match is_one {
        true => names
            .iter()
            .map(|name| name["uart-1 ".len()..].to_owned())
            .collect(),
        false => names.clone(),
    };
    let roles = roles(&shown, options, out);
    for event in own().filter(|event| event.ph == "E") {
        let name = format!("{} {}", event.pid, event.tid);
        let index = names.iter().position(|known| *known == name).unwrap_or(0);
        let (kind, byte) = match hex::byte(event.name.as_bytes()) {
            Some(byte) => (Kind::Data, Some(byte)),
            None if event.name.contains("rame error") => {
                (Kind::Line(LineEvent::FramingError), None)
            }
            None if event.name.contains("reak") => (Kind::Line(LineEvent::Break), None),
            None => {
                let name = event.name.escape_default();
                return Err(ImportError::of_file(format!(
                    "found \"{name}\" as a byte, expected two hex digits: decode with format=hex"
                )));
            }
        };
        let role = &roles[index];
        let link = out.link(&role.link, options);
        let at = nanos(event.ts).saturating_add(options.byte_nanos(1) / 10);
        out.push(link, at, role.direction, kind, byte.as_slice());
    }
    out.sort();
    Ok(())
}

fn nanos(micros: f64) -> u64 {
    let nanos = (micros * 1e3).round();
    #[expect(clippy::cast_possible_truncation, reason = "within the range, rounded")]
    let nanos = if (0.0..9e18).contains(&nanos) {
        nanos as i64
    } else {
        0
    };
    u64::try_from(nanos).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    /// Output of sigrok-cli 0.7.2.
    const TRACE: &str = "{\"traceEvents\": [\n\
        {\"ph\": \"B\", \"ts\": 509.000000, \"pid\": \"uart-1\", \"tid\": \"TX\", \"name\": \"AB\"},\n\
        {\"ph\": \"E\", \"ts\": 579.000000, \"pid\": \"uart-1\", \"tid\": \"TX\", \"name\": \"AB\"},\n\
        {\"ph\": \"B\", \"ts\": 1509.00000, \"pid\": \"uart-1\", \"tid\": \"RX\", \"name\": \"24\"},\n\
        {\"ph\": \"E\", \"ts\": 1579.00000, \"pid\": \"uart-1\", \"tid\": \"RX\", \"name\": \"24\"},\n\
        {\"ph\": \"E\", \"ts\": 1580.00000, \"pid\": \"uart-1\", \"tid\": \"RX bits\", \"name\": \"1\"}\n\
        ]}\n";

    #[test]
    fn rx_and_tx_are_two_directions() {
        assert_eq!(Format::detect(TRACE.as_bytes()), Some(Format::Trace));
        let found = read_format(TRACE.as_bytes(), Format::Trace, &Options::default());
        let found = found.expect("sound");
        let tuple =
            |one: &crate::Record| (one.at.as_nanos() / 1000, one.direction, one.bytes.to_vec());
        let told: Vec<_> = found.records().iter().map(tuple).collect();
        let expected = [
            (579, Direction::ToDevice, vec![0xAB]),
            (1_579, Direction::ToMaster, vec![0x24]),
        ];
        assert_eq!(told, expected);
    }

    #[test]
    fn what_is_no_trace_of_a_uart_is_refused() {
        let error = |text: &str| {
            let found = read_format(text.as_bytes(), Format::Trace, &Options::default());
            found.expect_err("unsound").to_string()
        };
        let i2c = TRACE.replace("uart-1", "i2c-1");
        assert!(error(&i2c).contains("no bytes of a UART"));
        let decimal = TRACE.replace("\"name\": \"24\"", "\"name\": \"036\"");
        assert!(error(&decimal).contains("format=hex"));
        let cut = error(&TRACE[..200]);
        assert!(cut.starts_with("line 4"), "{cut}");
    }
}
