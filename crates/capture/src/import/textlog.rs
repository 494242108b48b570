//! Text that a terminal logged: a line of the port after each time, or a session below a header.
//!
//! ```text
//! 12:11:23.456 -> $GPGGA,123519,..          Arduino IDE; also tio -t, TeraTerm, grabserial, ts
//! =~=~=~= PuTTY log 2026.11.27 12:11:23 =~=~=~=
//! ```
//!
//! With times, each line is assumed to have ended with CR LF, which the terminal does not show. If
//! bytes are not text, times and bytes cannot be distinguished, which is an error.

use super::Look;
use super::controls::Notation;
use super::hextext::{Clock, Dates, Message, emit, split_text};
use super::imported::{ImportError, Imported, Options, Untimed};
use super::text::{Line, line_end, lines, utf8};

/// Whether a line is PuTTY's own: its head, or an entry of its event log.
pub(super) fn is_of_putty(text: &str) -> bool {
    (text.starts_with("=~=~=~=") && text.contains("PuTTY log")) || text.starts_with("Event Log: ")
}

/// Whether a line is PuTTY's head of bytes, which rows of a dump follow.
pub(super) fn is_raw(text: &[u8]) -> bool {
    [&b"Incoming raw data"[..], b"Outgoing raw data"]
        .iter()
        .any(|head| text.starts_with(head))
}

/// Whether a line is the header that a terminal writes before a session.
fn session(text: &[u8]) -> bool {
    let text = utf8(text);
    (text.starts_with("=~=~=~=") && text.contains("PuTTY log"))
        || text.starts_with("Script started on ")
}

/// Whether the terminal wrote this line after a session.
fn is_end(text: &[u8]) -> bool {
    text.starts_with(b"Script done on ")
}

/// A line with its time.
struct Stamped<'a> {
    line: Line<'a>,
    at: (u64, Clock),
    is_sent: Option<bool>,
    is_arrow: bool,
    text: &'a str,
}

fn stamped<'a>(line: Line<'a>, dates: Dates) -> Option<Stamped<'a>> {
    let text = core::str::from_utf8(line.text).ok()?;
    let (prefix, rest) = split_text(text);
    let at = split_text(&dates.told(text)).0.at?;
    // A date may begin with a word.
    let is_dated = matches!(at.1, Clock::Date | Clock::Utc | Clock::Year);
    let is_begun = text.starts_with(|c: char| c.is_ascii_digit() || c == '[' || c == '(');
    let is_word = text.starts_with(|c: char| c.is_ascii_alphabetic());
    (is_begun || is_dated && is_word).then_some(())?;
    Some(Stamped {
        line,
        at,
        is_sent: prefix.is_sent,
        is_arrow: prefix.is_arrow,
        text: rest,
    })
}

/// All lines of a log with times.
fn all(bytes: &[u8]) -> Option<Vec<Stamped<'_>>> {
    let full = lines(bytes).filter(|line| !line.text.trim_ascii().is_empty());
    let dates = dates(bytes);
    full.map(|line| stamped(line, dates)).collect()
}

/// The order of the dates before the lines.
fn dates(bytes: &[u8]) -> Dates {
    Dates::of(lines(bytes).map(|line| utf8(line.text)))
}

/// Whether every line has a time and the rest is text.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    let is_plain = |one: &Stamped<'_>| {
        one.text
            .bytes()
            .all(|byte| matches!(byte, b' '..=b'~' | b'\t'))
    };
    all(bytes).is_some_and(|all| !all.is_empty() && all.iter().all(is_plain))
}

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let first = lines(bytes).next()?;
    if session(first.text) {
        return Some(Look::Surely);
    }
    // A device may itself send times.
    is_text(bytes).then_some(Look::Perhaps)
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    if lines(bytes).next().is_some_and(|line| session(line.text)) {
        return session_bytes(bytes, options, out);
    }
    let all = all(bytes).ok_or_else(|| {
        ImportError::of_file("expected a time before each line, as terminals log text")
    })?;
    let binary = all.iter().find(|one| {
        one.text
            .bytes()
            .any(|byte| !matches!(byte, b' '..=b'~' | b'\t'))
    });
    if let Some(binary) = binary {
        return Err(binary.line.wrong(
            "bytes that are no text stand between the times: log without times and import with \
             --format raw, or log in hex",
        ));
    }
    let notation = Notation::of(all.iter().map(|one| one.text));
    out.note(match notation {
        Some(_) => "control characters are read as the log writes them, e.g. <CR> or \\r",
        None => "each line is taken to have ended with CR LF, which the log does not show",
    });
    dates(bytes)
        .note()
        .into_iter()
        .for_each(|note| out.note(note));
    let are_arrows = all.iter().all(|one| one.is_sent.is_none() || one.is_arrow);
    let messages = all.into_iter().map(|one| {
        let is_sent = one.is_sent.filter(|_| !are_arrows);
        let text = match notation {
            Some(notation) => notation.bytes(one.text).ok_or_else(|| {
                one.line
                    .wrong("found a backslash, expected an escape as \\r")
            })?,
            None => [one.text.as_bytes(), b"\r\n"].concat(),
        };
        Ok(Message::new(one.line, Some(one.at), is_sent, text))
    });
    emit(messages.collect::<Result<_, ImportError>>()?, options, out)
}

/// The bytes of a session, without the terminal's own lines.
fn session_bytes(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    out.note(
        "the session of a terminal: its text counts as received, without times; bytes that the \
         terminal does not show may be missing",
    );
    let (mut own, last) = (Vec::new(), line_end(bytes));
    for line in lines(bytes) {
        if is_raw(line.text) {
            return Err(line.wrong(
                "this is PuTTY's log of raw data, expected rows of a dump behind this line; \
                 --format hexdump shows which row is damaged",
            ));
        }
        if session(line.text) || is_end(line.text) {
            continue;
        }
        let end = bytes[line.offset..].iter().position(|byte| *byte == last);
        let end = end.map_or(bytes.len(), |end| line.offset + end + 1);
        own.extend_from_slice(&bytes[line.offset..end]);
    }
    Untimed::new(options, out).stream(options.direction, &own, out);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    fn told(text: &str) -> Result<Vec<(u64, bool, Vec<u8>)>, String> {
        let found = read_format(text.as_bytes(), Format::Text, &Options::default());
        let found = found.map_err(|error| error.to_string())?;
        let one = |one: &crate::Record| {
            let is_sent = one.direction == Direction::ToDevice;
            (one.at.as_millis(), is_sent, one.bytes.to_vec())
        };
        Ok(found.records().iter().map(one).collect())
    }

    /// 12:11:23.456 is 43,883,456 ms after midnight. The arrow of the IDE is not a direction.
    #[test]
    fn lines_with_times_are_text_of_the_port() {
        let text = "12:11:23.456 -> $GPGGA,1\r\n12:11:24.000 -> OK\r\n";
        assert_eq!(Format::detect(text.as_bytes()), Some(Format::Text));
        let expected = vec![
            (43_883_456, false, b"$GPGGA,1\r\n".to_vec()),
            (43_884_000, false, b"OK\r\n".to_vec()),
        ];
        assert_eq!(told(text), Ok(expected));
        let both = told("[0.5] TX: AT\n[0.6] RX: OK\n").expect("sound");
        assert_eq!((both[0].1, both[1].1), (true, false));
        assert!(
            told("[0.5] A\u{e9}\n")
                .expect_err("bytes")
                .contains("no text")
        );
    }

    /// A word of a direction is one only with a mark; `ts` writes dates without a year.
    #[test]
    fn the_text_keeps_its_first_word() {
        let both = told("[0.5] device ready\n[0.6] in range\n").expect("sound");
        let texts: Vec<&[u8]> = both.iter().map(|one| &*one.2).collect();
        assert_eq!(texts, [&b"device ready\r\n"[..], b"in range\r\n"]);
        let both = told("[0.5] [TX] AT\n[0.6] rx: OK\n").expect("sound");
        let ways: Vec<_> = both.iter().map(|one| (one.1, &*one.2)).collect();
        assert_eq!(ways, [(true, &b"AT\r\n"[..]), (false, b"OK\r\n")]);
        let text = "Nov 27 23:00:00 temp 21\nNov 29 00:00:00 temp 22\n";
        assert_eq!(Format::detect(text.as_bytes()), Some(Format::Text));
        let dated = told(text).expect("sound");
        assert_eq!(dated[1].0 - dated[0].0, 25 * 3_600_000);
        assert_eq!(dated[0].2, b"temp 21\r\n");
    }

    #[test]
    fn a_session_loses_its_head() {
        let text = "=~=~=~=~=~=~= PuTTY log 2026.11.27 12:11:23 =~=~=~=~=\r\nOK\r\n\r\n$GP\r\n";
        assert_eq!(Format::detect(text.as_bytes()), Some(Format::Text));
        let bytes: Vec<u8> = told(text)
            .expect("sound")
            .into_iter()
            .flat_map(|one| one.2)
            .collect();
        assert_eq!(bytes, b"OK\r\n\r\n$GP\r\n");
    }

    /// Each line has a time and printable characters or tabs behind it.
    #[test]
    fn text_is_printable() {
        for (text, expected) in [
            ("[0.5] A\n", true),
            ("[0.5] A\tB~ \n\n[0.6] C\n", true),
            ("[0.5] A\n[0.6] \u{e9}\n", false),
            ("[0.5] A\x7F\n", false),
            ("[0.5] A\x1F\n", false),
            ("[0.5] A\nB\n", false),
            ("", false),
            ("\n \n", false),
        ] {
            assert_eq!(is_text(text.as_bytes()), expected, "{text:?}");
        }
    }

    /// The lines that PuTTY and `script` write themselves.
    #[test]
    fn lines_of_a_terminal_are_known() {
        let head = "=~=~=~=~=~=~= PuTTY log 2026.11.27 12:11:23 =~=~=~=~=";
        let texts = [
            head,
            "Event Log: x",
            "Script started on x",
            "=~=~=~=",
            "PuTTY log",
        ];
        let found = texts.map(is_of_putty);
        assert_eq!(found, [true, true, false, false, false]);
        let found = texts.map(|text| session(text.as_bytes()));
        assert_eq!(found, [true, false, true, false, false]);
        assert!(is_end(b"Script done on x") && !is_end(b"Script started on x"));
        let raw = [
            "Incoming raw data at x",
            "Outgoing raw data at x",
            "raw data",
        ];
        assert_eq!(raw.map(|text| is_raw(text.as_bytes())), [true, true, false]);
    }

    /// A session keeps its line ends and the bytes of its last line.
    #[test]
    fn a_session_of_script_loses_its_first_and_last_line() {
        let bytes = |text: &str| -> Vec<u8> {
            let all = told(text).expect("sound").into_iter();
            all.flat_map(|one| one.2).collect()
        };
        let text = "Script started on x\nOK\r\n\n$GP\nScript done on x\n";
        assert_eq!(bytes(text), b"OK\r\n\n$GP\n");
        assert_eq!(bytes("Script started on x\nOK\n$GP"), b"OK\n$GP");
        let raw = told("Script started on x\nIncoming raw data at x\n");
        assert!(raw.expect_err("a dump").contains("--format hexdump"));
    }

    /// A line begins with its time, in brackets too, or with a date of words.
    #[test]
    fn a_time_begins_its_line() {
        let is = |text: &str| {
            let line = lines(text.as_bytes()).next().expect("one");
            stamped(line, Dates::default()).is_some()
        };
        for text in [
            "12:11:23.5 x",
            "[0.5] x",
            "(0.5) x",
            "Nov 27 12:11:23 x",
            "[Nov 27 12:11:23] x",
        ] {
            assert!(is(text), "{text}");
        }
        for text in ["x 12:11:23.5", "+0.5 x", "word"] {
            assert!(!is(text), "{text}");
        }
    }

    /// Arrows in all lines are those of the terminal; beside other directions they are directions.
    #[test]
    fn arrows_are_directions_beside_others() {
        let ways = |text: &str| -> Vec<bool> {
            told(text)
                .expect("sound")
                .into_iter()
                .map(|one| one.1)
                .collect()
        };
        assert_eq!(ways("12:11:23.4 -> A\n12:11:23.5 -> B\n"), [false, false]);
        assert_eq!(ways("12:11:23.4 -> A\n12:11:23.5 RX: B\n"), [true, false]);
    }
}
