//! Messages in their binary form.
//!
//! ```text
//!   "HRN1" once, then   length u32 | type u8 | body
//!   item                kind u8 | port u8 | length u16 | time u64 | payload
//! ```
//!
//! All numbers are little endian.

use protocols::{Instant, LineConfig, LineEvent, Parity};
use serde_json::Value;

use crate::message::{Answer, CODING, Input, Item, LINE_EVENTS, Note, Output, Reply, Request};

/// First bytes of the rig's stream.
pub const MAGIC: [u8; 4] = *b"HRN1";
/// Maximum length of a message.
pub const MESSAGE_MAX: usize = 16 << 20;
/// Maximum length of an item's payload.
pub const ITEM_MAX: usize = 0xFFFF;

const NEVER: u64 = u64::MAX;

/// The payload of an item as bytes.
pub trait Payload: Sized {
    /// The number of the payload's kind.
    fn kind(&self) -> u8;
    /// Appends the payload.
    fn write(&self, to: &mut Vec<u8>);
    /// Splits the payload into items, if it is too long for one and can be split.
    fn parts(&self) -> Option<Vec<Self>>;
    /// Parses a payload.
    ///
    /// # Errors
    /// A description of the error.
    fn read(kind: u8, from: &[u8]) -> Result<Self, String>;
}

/// Writes a message: length, type, and the output of `body`. Writes nothing if `body` fails.
fn frame(
    to: &mut Vec<u8>,
    kind: u8,
    body: impl FnOnce(&mut Vec<u8>) -> Result<(), String>,
) -> Result<(), String> {
    let start = to.len();
    to.extend_from_slice(&[0; 4]);
    to.push(kind);
    let done = body(to);
    if done.is_err() {
        to.truncate(start);
        return done;
    }
    let len = u32::try_from(to.len() - start - 4).unwrap_or(u32::MAX);
    to[start..start + 4].copy_from_slice(&len.to_le_bytes());
    Ok(())
}

fn write_items<T: Payload>(to: &mut Vec<u8>, items: &[Item<T>]) -> Result<(), String> {
    let at = to.len();
    to.extend_from_slice(&[0; 2]);
    let mut count = 0_u16;
    let mut write = |item: &Item<T>, what: &T| {
        let number = count;
        let more = number.checked_add(1);
        count = more.ok_or_else(|| format!("it has more than {} items", u16::MAX))?;
        write_item(to, item, what).map_err(|what| format!("item {number} {what}"))
    };
    for item in items {
        match item.what.parts() {
            None => write(item, &item.what)?,
            Some(parts) => parts.iter().try_for_each(|part| write(item, part))?,
        }
    }
    to[at..at + 2].copy_from_slice(&count.to_le_bytes());
    Ok(())
}

fn write_item<T: Payload>(to: &mut Vec<u8>, item: &Item<T>, what: &T) -> Result<(), String> {
    to.push(what.kind());
    to.push(item.port);
    let start = to.len();
    to.extend_from_slice(&[0; 2]);
    to.extend_from_slice(&item.at.as_nanos().to_le_bytes());
    let body = to.len();
    what.write(to);
    let (len, kind) = (to.len() - body, what.kind());
    let short = u16::try_from(len).map_err(|_| {
        format!("is of kind {kind} and has {len} bytes, expected {ITEM_MAX} at most")
    })?;
    to[start..start + 2].copy_from_slice(&short.to_le_bytes());
    Ok(())
}

fn cut<T>(bytes: &[u8], part: impl Fn(Vec<u8>) -> T) -> Option<Vec<T>> {
    let parts = || bytes.chunks(ITEM_MAX).map(|bytes| part(bytes.to_vec()));
    (bytes.len() > ITEM_MAX).then(|| parts().collect())
}

/// Writes a request.
///
/// # Errors
/// The part that is too long.
pub fn write_request(to: &mut Vec<u8>, request: &Request) -> Result<(), String> {
    match request {
        Request::Hello(hello) => frame(to, b'H', |to| {
            let text = serde_json::to_vec(hello).unwrap_or_default();
            put(to, &text)
        }),
        Request::Exchange { now, items } => write_exchange(to, *now, items),
        Request::Save => frame(to, b'S', |_| Ok(())),
        Request::Load(state) => frame(to, b'L', |to| put(to, state)),
        Request::End => frame(to, b'E', |_| Ok(())),
    }
}

/// Writes the request of an exchange.
///
/// # Errors
/// The item that is too long.
pub fn write_exchange(to: &mut Vec<u8>, now: Instant, items: &[Item<Input>]) -> Result<(), String> {
    frame(to, b'X', |to| {
        to.extend_from_slice(&now.as_nanos().to_le_bytes());
        write_items(to, items)
    })
}

/// Writes an answer.
///
/// # Errors
/// The item that is too long.
pub fn write_answer(to: &mut Vec<u8>, answer: &Answer) -> Result<(), String> {
    match answer {
        Answer::Hello(text) => frame(to, b'h', |to| put(to, text.to_string().as_bytes())),
        Answer::Exchange(reply) => frame(to, b'x', |to| {
            let next = reply.next.map_or(NEVER, Instant::as_nanos);
            to.extend_from_slice(&next.to_le_bytes());
            write_items(to, &reply.items)
        }),
        Answer::Saved(state) => frame(to, b's', |to| put(to, state)),
        Answer::Loaded => frame(to, b'l', |_| Ok(())),
    }
}

fn put(to: &mut Vec<u8>, bytes: &[u8]) -> Result<(), String> {
    to.extend_from_slice(bytes);
    Ok(())
}

/// A message without its length field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Framed<'a> {
    /// Type of the message.
    pub kind: u8,
    /// Bytes behind the type.
    pub body: &'a [u8],
    /// Total length, including the length field.
    pub len: usize,
}

/// The message at the beginning of `bytes`; `None` if it is incomplete.
///
/// # Errors
/// If the length field is invalid.
pub fn split(bytes: &[u8]) -> Result<Option<Framed<'_>>, String> {
    let Some((head, rest)) = bytes.split_first_chunk::<4>() else {
        return Ok(None);
    };
    let len = u32::from_le_bytes(*head) as usize;
    if len == 0 || len > MESSAGE_MAX {
        let shown = String::from_utf8_lossy(&bytes[..bytes.len().min(16)]).into_owned();
        return Err(format!(
            "its length is {len} (it begins with {shown:?}), expected 1 to {MESSAGE_MAX}"
        ));
    }
    let framed = rest.get(..len).map(|message| Framed {
        kind: message[0],
        body: &message[1..],
        len: 4 + len,
    });
    Ok(framed)
}

/// Parses an answer.
///
/// # Errors
/// A description of the error.
pub fn read_answer(kind: u8, body: &[u8]) -> Result<Answer, String> {
    match kind {
        b'h' => {
            let text = serde_json::from_slice(body);
            text.map(Answer::Hello)
                .map_err(|error| format!("its greeting is no JSON: {error}"))
        }
        b'x' => {
            let mut from = Reader(body);
            let next = from.u64().ok_or("it is cut off before \"next\"")?;
            let items = read_items(&mut from)?;
            Ok(Answer::Exchange(Reply {
                next: (next != NEVER).then_some(Instant::from_nanos(next)),
                items,
            }))
        }
        b's' => Ok(Answer::Saved(body.to_vec())),
        b'l' => Ok(Answer::Loaded),
        other => Err(format!(
            "its type is {:?}, expected h, x, s or l",
            char::from(other)
        )),
    }
}

/// Parses a request.
///
/// # Errors
/// A description of the error.
pub fn read_request(kind: u8, body: &[u8]) -> Result<Request, String> {
    match kind {
        b'H' => {
            let hello = serde_json::from_slice(body);
            hello
                .map(Request::Hello)
                .map_err(|error| format!("the greeting cannot be read: {error}"))
        }
        b'X' => {
            let mut from = Reader(body);
            let now = from.u64().ok_or("it is cut off before \"now\"")?;
            let items = read_items(&mut from)?;
            Ok(Request::Exchange {
                now: Instant::from_nanos(now),
                items,
            })
        }
        b'S' => Ok(Request::Save),
        b'L' => Ok(Request::Load(body.to_vec())),
        b'E' => Ok(Request::End),
        other => Err(format!(
            "its type is {:?}, expected H, X, S, L or E",
            char::from(other)
        )),
    }
}

fn read_items<T: Payload>(from: &mut Reader<'_>) -> Result<Vec<Item<T>>, String> {
    let count = from.u16().ok_or("it is cut off before \"count\"")?;
    let mut items = Vec::new();
    for number in 0..count {
        let item = read_item(from).map_err(|what| format!("item {number} of {count} {what}"))?;
        items.push(item);
    }
    match from.0.len() {
        0 => Ok(items),
        more => Err(format!("{more} bytes follow its last item, expected none")),
    }
}

fn read_item<T: Payload>(from: &mut Reader<'_>) -> Result<Item<T>, String> {
    let cut = || "is cut off".to_owned();
    let [kind, port] = from.take().ok_or_else(cut)?;
    let len = from.u16().ok_or_else(cut)?;
    let at = Instant::from_nanos(from.u64().ok_or_else(cut)?);
    let payload = from.slice(len.into()).ok_or_else(cut)?;
    let what = T::read(kind, payload)?;
    Ok(Item { port, at, what })
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    fn slice(&mut self, len: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(head)
    }
}

fn number(from: &[u8]) -> Result<f64, String> {
    let bytes = from.try_into();
    let bytes = bytes.map_err(|_| format!("has a value of {} bytes, expected 8", from.len()))?;
    Ok(f64::from_le_bytes(bytes))
}

fn message_of(from: &[u8]) -> Result<Value, String> {
    serde_json::from_slice(from).map_err(|error| format!("is a message that is not JSON: {error}"))
}

fn code_of(event: LineEvent) -> u8 {
    let known = LINE_EVENTS.iter().find(|(_, known, _)| *known == event);
    known.map_or(0, |(code, ..)| *code)
}

fn event_of(code: u8) -> Result<LineEvent, String> {
    let known = LINE_EVENTS.iter().find(|(known, ..)| *known == code);
    let known = known.map(|(_, event, _)| *event);
    known.ok_or_else(|| format!("is line event {code}, expected 0 to 5, or {CODING} for a coding"))
}

impl Payload for Input {
    fn parts(&self) -> Option<Vec<Self>> {
        match self {
            Self::Bytes(bytes) => cut(bytes, Self::Bytes),
            _ => None,
        }
    }

    fn kind(&self) -> u8 {
        match self {
            Self::Bytes(_) => 1,
            Self::Line(_) => 2,
            Self::Fault { .. } => 3,
            Self::Quantity(_) => 4,
            Self::Message(_) => 6,
        }
    }

    fn write(&self, to: &mut Vec<u8>) {
        match self {
            Self::Bytes(bytes) => to.extend_from_slice(bytes),
            Self::Line(event) => to.push(code_of(*event)),
            Self::Fault {
                name,
                begins,
                figure,
            } => {
                to.push(u8::from(*begins));
                to.extend_from_slice(&figure.unwrap_or(f64::NAN).to_le_bytes());
                to.extend_from_slice(name.as_bytes());
            }
            Self::Quantity(value) => to.extend_from_slice(&value.to_le_bytes()),
            Self::Message(message) => to.extend_from_slice(message.to_string().as_bytes()),
        }
    }

    fn read(kind: u8, from: &[u8]) -> Result<Self, String> {
        match kind {
            1 => Ok(Self::Bytes(from.to_vec())),
            2 => match from {
                [code] => event_of(*code).map(Self::Line),
                _ => Err("is a line event without its number".to_owned()),
            },
            3 => {
                let mut from = Reader(from);
                let cut = || "is a fault that is cut off".to_owned();
                let [begins] = from.take().ok_or_else(cut)?;
                let figure = f64::from_le_bytes(from.take().ok_or_else(cut)?);
                Ok(Self::Fault {
                    name: String::from_utf8_lossy(from.0).into_owned(),
                    begins: begins != 0,
                    figure: (!figure.is_nan()).then_some(figure),
                })
            }
            4 => number(from).map(Self::Quantity),
            6 => message_of(from).map(Self::Message),
            other => Err(format!("is of kind {other}, expected 1 to 4 or 6")),
        }
    }
}

impl Payload for Output {
    fn parts(&self) -> Option<Vec<Self>> {
        match self {
            Self::Bytes(bytes) => cut(bytes, Self::Bytes),
            _ => None,
        }
    }

    fn kind(&self) -> u8 {
        match self {
            Self::Bytes(_) => 1,
            Self::Line(_) | Self::Coding(_) => 2,
            Self::Note(note) if note.is_violation => 4,
            Self::Note(_) => 3,
            Self::Quantity(_) => 5,
            Self::Message(_) => 6,
        }
    }

    fn write(&self, to: &mut Vec<u8>) {
        match self {
            Self::Bytes(bytes) => to.extend_from_slice(bytes),
            Self::Line(event) => to.push(code_of(*event)),
            Self::Coding(line) => {
                to.push(CODING);
                to.extend_from_slice(&line.baud.to_le_bytes());
                to.extend_from_slice(&[line.data_bits, line.parity as u8, line.stop_bits]);
            }
            Self::Note(note) => {
                to.extend_from_slice(note.rule.as_bytes());
                to.push(0);
                to.extend_from_slice(note.detail.as_bytes());
                if !note.bytes.is_empty() {
                    to.push(0);
                    to.extend_from_slice(&note.bytes);
                }
            }
            Self::Quantity(value) => to.extend_from_slice(&value.to_le_bytes()),
            Self::Message(message) => to.extend_from_slice(message.to_string().as_bytes()),
        }
    }

    fn read(kind: u8, from: &[u8]) -> Result<Self, String> {
        match kind {
            1 => Ok(Self::Bytes(from.to_vec())),
            2 => match from {
                [code] => event_of(*code).map(Self::Line),
                [CODING, coding @ ..] => coding_of(coding).map(Self::Coding),
                _ => Err("is a line event without its number".to_owned()),
            },
            3 | 4 => note_of(kind == 4, from).map(Self::Note),
            5 => number(from).map(Self::Quantity),
            6 => message_of(from).map(Self::Message),
            other => Err(format!("is of kind {other}, expected 1 to 6")),
        }
    }
}

fn coding_of(from: &[u8]) -> Result<LineConfig, String> {
    let mut from = Reader(from);
    let wrong = || "is a line coding that cannot be, expected e.g. 9600, 8, 0, 1".to_owned();
    let baud = u32::from_le_bytes(from.take().ok_or_else(wrong)?);
    let [data_bits, parity, stop_bits] = from.take().ok_or_else(wrong)?;
    let parity = match parity {
        0 => Parity::None,
        1 => Parity::Even,
        2 => Parity::Odd,
        _ => return Err(wrong()),
    };
    let is_sound = baud > 0 && (5..=8).contains(&data_bits) && (1..=2).contains(&stop_bits);
    let line = LineConfig {
        baud,
        data_bits,
        parity,
        stop_bits,
    };
    is_sound.then_some(line).ok_or_else(wrong)
}

fn note_of(is_violation: bool, from: &[u8]) -> Result<Note, String> {
    let mut parts = from.splitn(3, |byte| *byte == 0);
    let mut text = || {
        parts
            .next()
            .map(|part| String::from_utf8_lossy(part).into_owned())
    };
    let rule = text().unwrap_or_default();
    let detail = text()
        .ok_or("is a note without a sentence, expected the rule, a zero byte and the sentence")?;
    if rule.is_empty() {
        return Err("is a note without the name of a rule".to_owned());
    }
    Ok(Note {
        is_violation,
        rule,
        detail,
        bytes: parts.next().unwrap_or_default().to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An item has at most 64 KiB: longer data are split into several items without loss.
    #[test]
    fn bytes_that_are_too_long_for_an_item_come_in_several() {
        let bytes: Vec<u8> = (0..=255).cycle().take(ITEM_MAX + 100).collect();
        let item = |what| Item {
            port: 3,
            at: Instant::ZERO,
            what,
        };
        let items = vec![
            item(Output::Bytes(bytes.clone())),
            item(Output::Quantity(1.0)),
        ];
        let mut written = Vec::new();
        let answer = Answer::Exchange(Reply { next: None, items });
        write_answer(&mut written, &answer).expect("short items");
        let framed = split(&written).expect("sound").expect("whole");
        let Ok(Answer::Exchange(reply)) = read_answer(framed.kind, framed.body) else {
            panic!("an exchange");
        };
        let parts = reply.items.iter().map(|item| match &item.what {
            Output::Bytes(bytes) => bytes.clone(),
            _ => Vec::new(),
        });
        assert_eq!(reply.items.len(), 3);
        assert_eq!(parts.collect::<Vec<_>>().concat(), bytes);
    }

    /// A payload that is too long and cannot be split is an error; nothing of it is written.
    #[test]
    fn an_item_that_is_too_long_is_an_error() {
        let message = |len: usize| Item {
            port: 0,
            at: Instant::ZERO,
            what: Input::Message(Value::String("x".repeat(len))),
        };
        // The length includes its two quotation marks.
        let mut written = Vec::new();
        let most = [message(0), message(ITEM_MAX - 2)];
        write_exchange(&mut written, Instant::ZERO, &most).expect("it fits");
        let len = written.len();
        let more = [message(0), message(ITEM_MAX - 1)];
        let error = write_exchange(&mut written, Instant::ZERO, &more);
        let expected = "item 1 is of kind 6 and has 65536 bytes, expected 65535 at most";
        assert_eq!(error, Err(expected.to_owned()));
        assert_eq!(written.len(), len);
    }
}
