//! Entries of the journal of systemd: `journalctl -o json`.
//!
//! ```text
//! {"__REALTIME_TIMESTAMP":"1764374400123456","MESSAGE":"RX: AB 24 0A","SYSLOG_IDENTIFIER":"bms"}
//! {"__REALTIME_TIMESTAMP":"1764374400223456","MESSAGE":[171,36,10]}      bytes that are no text
//! ```
//!
//! A message is read as hex text or as a log if all messages are. Otherwise, or if the journal has
//! messages of byte numbers, each message is the bytes of the line.

use serde_json::Value;

use super::Look;
use super::hextext::{self, Clock, Message, emit, log};
use super::imported::{ImportError, Imported, Options};
use super::text::{Line, lines, number};

const TIME: &str = "__REALTIME_TIMESTAMP";
const TEXT: &str = "MESSAGE";

/// Whether the file begins with an entry of a journal.
pub(super) fn is(bytes: &[u8]) -> bool {
    let text = bytes.trim_ascii_start();
    let head = &text[..text.len().min(4_096)];
    text.starts_with(b"{") && super::foreign::has(head, TIME.as_bytes())
}

/// An entry.
struct Entry<'a> {
    line: Line<'a>,
    micros: u64,
    bytes: Vec<u8>,
    /// Whether the journal shows the message as numbers, because it is no text.
    is_numbers: bool,
}

impl Entry<'_> {
    fn text(&self) -> Option<&str> {
        let text = core::str::from_utf8(&self.bytes).ok()?;
        (!self.is_numbers && !text.contains(['\n', '\r'])).then_some(text)
    }
}

fn entries<'a>(bytes: &'a [u8], names: &mut Vec<String>) -> Result<Vec<Entry<'a>>, ImportError> {
    let all: Vec<Line<'a>> = lines(bytes).collect();
    let mut values = serde_json::Deserializer::from_slice(bytes).into_iter::<Value>();
    let mut entries = Vec::new();
    loop {
        let rest = &bytes[values.byte_offset()..];
        let start = bytes.len() - rest.trim_ascii_start().len();
        let index = all.partition_point(|line| line.offset <= start);
        let Some(value) = values.next() else {
            return Ok(entries);
        };
        let line = all[index.saturating_sub(1)];
        let value = value.map_err(|error| line.wrong(format!("expected an entry: {error}")))?;
        if let Some(name) = value.get("SYSLOG_IDENTIFIER").and_then(Value::as_str)
            && !names.iter().any(|known| known == name)
        {
            names.push(name.to_owned());
        }
        let micros = value.get(TIME).and_then(Value::as_str).and_then(number);
        let micros =
            micros.ok_or_else(|| line.wrong(format!("expected microseconds as {TIME}")))?;
        let (bytes, is_numbers) = match value.get(TEXT) {
            Some(Value::String(text)) => (text.clone().into_bytes(), false),
            Some(Value::Array(numbers)) => {
                let byte = |number: &Value| number.as_u64().and_then(|one| u8::try_from(one).ok());
                let numbers: Option<Vec<u8>> = numbers.iter().map(byte).collect();
                let wrong = || line.wrong("expected text or one list of bytes as MESSAGE");
                (numbers.ok_or_else(wrong)?, true)
            }
            Some(Value::Null) => {
                return Err(line.wrong(
                    "MESSAGE is null because it is long: write the journal with journalctl --all",
                ));
            }
            // An entry without a message, e.g. of a core dump.
            _ => continue,
        };
        entries.push(Entry {
            line,
            micros,
            bytes,
            is_numbers,
        });
    }
}

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    is(bytes).then_some(Look::Surely)
}

/// The entries as lines with times, if all messages are one line of text each.
fn as_log(entries: &[Entry<'_>]) -> Option<String> {
    let line = |entry: &Entry<'_>| {
        let (whole, part) = (entry.micros / 1_000_000, entry.micros % 1_000_000);
        Some(format!("[{whole}.{part:06}] {}\n", entry.text()?))
    };
    entries.iter().map(line).collect()
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let mut names = Vec::new();
    let entries = entries(bytes, &mut names)?;
    if names.len() > 1 {
        out.note(format!(
            "the journal has messages of {}: all are read as one line; journalctl -t NAME chooses",
            names.join(", ")
        ));
    }
    if let Some(text) = as_log(&entries) {
        let text = text.as_bytes();
        let is_sure = |look: Option<Look>| look == Some(Look::Surely);
        let read = match () {
            () if is_sure(hextext::look(text)) => Some(hextext::read(text, options, out)),
            () if is_sure(log::look(text)) => Some(log::read(text, options, out)),
            () => None,
        };
        if let Some(read) = read {
            out.clock = "utc";
            return read.map_err(|error| match entries.get(error.line.wrapping_sub(1)) {
                Some(entry) => entry.line.wrong(error.message),
                None => error,
            });
        }
    }
    let has_numbers = entries.iter().any(|entry| entry.is_numbers);
    out.note(match has_numbers {
        true => "each message is taken as the bytes of the line, without a line end",
        false => "each message is taken to have ended with CR LF, which the journal does not show",
    });
    let end: &[u8] = if has_numbers { b"" } else { b"\r\n" };
    let messages = entries.into_iter().map(|entry| {
        let at = entry.micros.saturating_mul(1_000);
        let bytes = [&entry.bytes, end].concat();
        Message::new(entry.line, Some((at, Clock::Utc)), None, bytes)
    });
    emit(messages.collect(), options, out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};

    /// Times in microseconds, directions and bytes of the records, and the clock.
    fn told(messages: &[&str]) -> Result<Vec<(u64, bool, Vec<u8>)>, String> {
        let mut text = String::new();
        for (number, message) in messages.iter().enumerate() {
            let micros = 1_764_374_400_000_000 + 100 * number;
            text +=
                &format!("{{\"{TIME}\":\"{micros}\",\"PRIORITY\":\"6\",\"{TEXT}\":{message}}}\n");
        }
        assert_eq!(Format::detect(text.as_bytes()), Some(Format::Table));
        let found = read_format(text.as_bytes(), Format::Table, &Options::default());
        let found = found.map_err(|error| error.to_string())?;
        assert_eq!(found.clock, "utc");
        let one = |one: &crate::Record| {
            let is_sent = one.direction == engine::rig::line::Direction::ToDevice;
            let micros = one.at.as_nanos() / 1_000 - 1_764_374_400_000_000;
            (micros, is_sent, one.bytes.to_vec())
        };
        Ok(found.records().iter().map(one).collect())
    }

    /// Hex with directions, hex alone, numbers, and the text of the line.
    #[test]
    fn messages_of_a_journal_are_bytes() {
        let both = told(&["\"TX: AB 24 0A\"", "\"RX: 0A 1B\""]).expect("hex");
        assert_eq!(
            both,
            [
                (0, true, vec![0xAB, 0x24, 0x0A]),
                (100, false, vec![0x0A, 0x1B])
            ]
        );
        let hex = told(&["\"ab240a\"", "\"0a1b\""]).expect("hex");
        assert_eq!(hex[1], (100, false, vec![0x0A, 0x1B]));
        let numbers = told(&["[171,36,10]", "\"OK\""]).expect("numbers");
        let plain = [(0, false, vec![171, 36, 10]), (100, false, b"OK".to_vec())];
        assert_eq!(numbers, plain);
        let text = told(&["\"$GPGGA,1\"", "\"started\""]).expect("text");
        assert_eq!(text[0], (0, false, b"$GPGGA,1\r\n".to_vec()));
        let error = told(&["\"AB 24\"", "null"]).expect_err("a message that is cut off");
        assert!(
            error.starts_with("line 2") && error.contains("--all"),
            "{error}"
        );
        assert!(told(&["[171,256]"]).is_err());
    }
    #[test]
    fn a_message_is_text_on_one_line() {
        let line = lines(b"x").next().expect("one");
        let text = |bytes: &[u8], is_numbers| {
            let entry = Entry {
                line,
                micros: 1_500_000,
                bytes: bytes.to_vec(),
                is_numbers,
            };
            let log = as_log(core::slice::from_ref(&entry));
            (entry.text().is_some(), log)
        };
        assert_eq!(
            text(b"RX: AB", false),
            (true, Some("[1.500000] RX: AB\n".to_owned()))
        );
        assert_eq!(text(b"RX: AB", true), (false, None));
        assert_eq!(
            (text(b"a\nb", false), text(b"a\rb", false)),
            ((false, None), (false, None))
        );
        assert_eq!(text(b"\xFF", false), (false, None));
    }

    /// Messages of several programs are noted with their names.
    #[test]
    fn several_programs_are_noted() {
        let notes = |names: &[&str]| {
            let entry = |name: &&str| {
                format!(
                    "{{\"{TIME}\":\"1764374400000000\",\"SYSLOG_IDENTIFIER\":\"{name}\",\
                     \"{TEXT}\":\"AB 24\"}}\n"
                )
            };
            let text: String = names.iter().map(entry).collect();
            let found = read_format(text.as_bytes(), Format::Table, &Options::default());
            let notes = found.expect("sound").notes.into_iter();
            notes
                .filter(|note| note.contains("messages of"))
                .collect::<Vec<_>>()
        };
        assert!(notes(&["a", "a"]).is_empty());
        let found = notes(&["a", "b", "a"]);
        assert!(
            found[0].starts_with("the journal has messages of a, b: "),
            "{found:?}"
        );
    }
}
