//! Annotations of sigrok's UART decoder.
//!
//! ```text
//! 5313-6147 uart-1: FA
//! 5313-6147 UART: RX: FA        PulseView, export of annotations
//! ```
//!
//! The range is in samples and covers the data bits. Without it, the bytes are assumed to be back
//! to back.

use super::imported::{ImportError, Imported, Options};
use super::roles::roles;
use super::text::{Line, lines, number, utf8};
use crate::Kind;
use engine::hex;
use engine::rig::line::Direction;
use protocols::LineEvent;

struct Annotation<'a> {
    decoder: String,
    samples: Option<(u64, u64)>,
    what: &'a str,
}

fn annotation(text: &[u8]) -> Option<Annotation<'_>> {
    let (head, what) = utf8(text).split_once(": ")?;
    let (range, decoder) = match head.split_once(' ') {
        Some((range, decoder)) => (Some(range), decoder),
        None => (None, head),
    };
    let samples = match range {
        None => None,
        Some(range) => {
            let (from, to) = range.split_once('-')?;
            Some((number(from)?, number(to)?))
        }
    };
    // PulseView names the decoder and the row.
    let in_row = what.split_once(": ").filter(|_| samples.is_some());
    if let Some((row, what)) = in_row.filter(|_| decoder.to_lowercase().contains("uart")) {
        let decoder = format!("{decoder} {row}");
        return Some(Annotation {
            decoder,
            samples,
            what,
        });
    }
    number(decoder.strip_prefix("uart-")?)?;
    Some(Annotation {
        decoder: decoder.to_owned(),
        samples,
        what,
    })
}

/// Parts of a character that PulseView exports beside its bytes.
fn is_part(one: &Annotation<'_>) -> bool {
    let row = one.decoder.to_lowercase();
    let is_other = ["bits", "packet", "break", "warning"]
        .iter()
        .any(|other| row.contains(other));
    let parts = ["Start bit", "Stop bit", "Parity bit", "Idle"];
    !row.starts_with("uart-") && (is_other || parts.iter().any(|part| one.what.starts_with(part)))
}

/// Whether a line is a byte.
pub(super) fn is_data(text: &[u8]) -> bool {
    annotation(text).is_some_and(|one| hex::byte(one.what.as_bytes()).is_some())
}

/// A decoder in the output.
#[derive(Default)]
struct Decoder {
    link: usize,
    direction: Option<Direction>,
    count: usize,
    /// End of the data bits of the last byte, in samples.
    last_end: Option<u64>,
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    out.clock = "virtual";
    let full = || lines(bytes).filter(|line| !line.text.trim_ascii().is_empty());
    let mut names: Vec<String> = Vec::new();
    for one in full().filter_map(|line| annotation(line.text)) {
        if !is_part(&one) && !names.contains(&one.decoder) {
            names.push(one.decoder);
        }
    }
    let roles = roles(&names, options, out);
    let mut decoders: Vec<Decoder> = Vec::new();
    for role in &roles {
        decoders.push(Decoder {
            link: out.link(&role.link, options),
            direction: Some(role.direction),
            ..Decoder::default()
        });
    }
    if names.len() == 1 && names[0].starts_with("uart-") {
        out.note(
            "sigrok-cli's lines do not tell RX from TX: all are taken as one direction; if they \
             hold both, use --protocol-decoder-jsontrace, or import the .sr file",
        );
    }
    for line in full() {
        let expected = "expected \"FROM-TO uart-1: XX\" or \"uart-1: XX\"";
        let one = annotation(line.text).ok_or_else(|| line.wrong(expected))?;
        if is_part(&one) {
            continue;
        }
        let index = names.iter().position(|name| *name == one.decoder);
        let own = index.and_then(|index| decoders.get_mut(index));
        let own = own.ok_or_else(|| line.wrong(expected))?;
        let nanos = time(line, &one, options, own.count)?;
        let (kind, byte) = match (one.what, hex::byte(one.what.as_bytes())) {
            (_, Some(byte)) => (Kind::Data, Some(byte)),
            ("Frame error", None) => {
                // The error belongs to the byte above if that byte ends where the error begins.
                if one
                    .samples
                    .is_some_and(|(from, _)| own.last_end == Some(from))
                {
                    out.records.pop();
                }
                (Kind::Line(LineEvent::FramingError), None)
            }
            ("Break condition" | "Break", None) => (Kind::Line(LineEvent::Break), None),
            _ => {
                let what = one.what.escape_default();
                let expected = "expected two hex digits: choose -A uart=rx-data";
                return Err(line.wrong(format!("found \"{what}\", {expected}")));
            }
        };
        if byte.is_some() {
            let overlaps = |(from, _): (u64, u64)| own.last_end.is_some_and(|end| from < end);
            if one.samples.is_some_and(overlaps) {
                return Err(line.wrong(
                    "the byte overlaps the one before, so RX and TX are mixed here: use \
                     --protocol-decoder-jsontrace, or import the .sr file",
                ));
            }
            own.count += 1;
        }
        own.last_end = one.samples.map(|(_, to)| to).filter(|_| byte.is_some());
        let direction = own.direction.unwrap_or(options.direction);
        out.push(own.link, nanos, direction, kind, byte.as_slice());
    }
    if names.len() > 1 {
        out.sort();
    }
    Ok(())
}

/// End of the stop bit, ns.
fn time(
    line: Line<'_>,
    one: &Annotation<'_>,
    options: &Options,
    count: usize,
) -> Result<u64, ImportError> {
    let Some((_, to)) = one.samples else {
        if options.baud.is_none() {
            let expected = "no sample numbers: expected --baud, or a dump with \
                            --protocol-decoder-samplenum";
            return Err(line.wrong(expected));
        }
        return Ok(options.byte_nanos(count + 1));
    };
    let rate = options.sample_rate.filter(|&rate| rate > 0);
    let rate = rate.ok_or_else(|| line.wrong("sample numbers: expected --samplerate"))?;
    let nanos = u128::from(to) * 1_000_000_000 / u128::from(rate);
    let nanos = u64::try_from(nanos).map_err(|_| line.wrong("the sample number is too large"))?;
    Ok(nanos.saturating_add(options.byte_nanos(1) / 10))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};

    type Samples = Option<(u64, u64)>;

    /// Decoder, samples and content of a line.
    fn of(text: &str) -> Option<(String, Samples, &str)> {
        let one = annotation(text.as_bytes())?;
        Some((one.decoder, one.samples, one.what))
    }

    /// sigrok-cli names the decoder with its number; PulseView names it and its row.
    #[test]
    fn a_line_names_its_decoder() {
        for (text, decoder, samples, what) in [
            ("53-61 uart-1: FA", "uart-1", Some((53, 61)), "FA"),
            ("uart-12: FA", "uart-12", None, "FA"),
            ("53-61 UART: RX: FA", "UART RX", Some((53, 61)), "FA"),
            ("53-61 My uart: TX: x", "My uart TX", Some((53, 61)), "x"),
        ] {
            let expected = Some((decoder.to_owned(), samples, what));
            assert_eq!(of(text), expected, "{text}");
        }
        for text in [
            "UART: RX: FA",
            "53-61 SPI: MOSI: 01",
            "53 uart-1: FA",
            "a-61 uart-1: FA",
            "53-b uart-1: FA",
            "uart-x: FA",
            "uart-: FA",
            "uart-1 FA",
        ] {
            assert_eq!(of(text), None, "{text}");
        }
        assert!(is_data(b"uart-1: FA") && !is_data(b"uart-1: Start bit"));
    }

    /// Rows of PulseView beside its bytes, and the bits around them.
    #[test]
    fn parts_of_a_character_are_no_bytes() {
        let is = |text: &str| is_part(&annotation(text.as_bytes()).expect(text));
        for text in [
            "0-1 UART: RX bits: 1",
            "0-1 UART: TX packets: FA",
            "0-1 UART: RX breaks: Break condition",
            "0-1 UART: RX warnings: Frame error",
            "0-1 UART: RX: Start bit",
            "0-1 UART: RX: Stop bit",
            "0-1 UART: RX: Parity bit",
            "0-1 UART: RX: Idle",
        ] {
            assert!(is(text), "{text}");
        }
        for text in ["0-1 UART: RX: FA", "0-1 uart-1: Start bit"] {
            assert!(!is(text), "{text}");
        }
    }

    /// A byte may begin where the one before ends, and not earlier. Two decoders are two lines,
    /// which are sorted by time; one decoder may hold both, which is noted.
    #[test]
    fn bytes_of_one_line_do_not_overlap() {
        let options = Options {
            sample_rate: Some(1_000_000),
            ..Options::default()
        };
        let read = |text: &str| read_format(text.as_bytes(), Format::Sigrok, &options);
        let told = |text: &str| -> Vec<(u64, u8)> {
            let found = read(text).expect("sound");
            let records = found.records().iter();
            records
                .map(|one| (one.at.as_micros(), one.bytes[0]))
                .collect()
        };
        assert_eq!(
            told("0-10 uart-1: 01\n10-20 uart-1: 02\n"),
            [(10, 1), (20, 2)]
        );
        let error = read("0-10 uart-1: 01\n9-20 uart-1: 02\n").expect_err("both directions");
        assert!(error.message.contains("overlaps"), "{error}");
        assert_eq!(error.line, 2);
        let two = "0-10 uart-1: 01\n20-30 uart-1: 03\n5-15 uart-2: 02\n";
        assert_eq!(told(two), [(10, 1), (15, 2), (30, 3)]);
        let is_mixed = |text: &str| {
            let notes = read(text).expect("sound").notes;
            notes
                .iter()
                .any(|note| note.contains("do not tell RX from TX"))
        };
        assert!(is_mixed("0-10 uart-1: 01\n") && !is_mixed(two));
        assert!(!is_mixed("0-10 UART: RX: 01\n"));
        let parts = "0-1 UART: RX: Start bit\n1-9 UART: RX: 41\n1-2 UART: RX bits: 1\n";
        assert_eq!(told(parts), [(9, 0x41)]);
    }

    /// Rows of PulseView name their direction.
    #[test]
    fn rows_have_their_directions() {
        let options = Options {
            sample_rate: Some(1_000_000),
            ..Options::default()
        };
        let text = "0-10 UART: TX: 01\n20-30 UART: RX: 02\n";
        let found = read_format(text.as_bytes(), Format::Sigrok, &options).expect("sound");
        let ways: Vec<Direction> = found.records().iter().map(|one| one.direction).collect();
        assert_eq!(ways, [Direction::ToDevice, Direction::ToMaster]);
    }
}
