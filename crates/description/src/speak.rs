//! Requests and replies in the words of a description.
//!
//! ```text
//! set target=22.5          a message with its fields
//! read voltage             a register by its name
//! write alarm_voltage=251  a write to a register
//! read input 0 2           two registers by table, address and count
//! ```

mod complete;
mod modbus;

pub(crate) use modbus::{Read, raw, read, tables, values, write};

use span::near::with_meant;

use crate::behaviour::Trigger;
use crate::description::Description;
use crate::field::{self, Field, Kind};
use crate::framing::Frame;
use crate::message::{Layout, Message};
use crate::number::NumberKind;
use crate::pattern::{self, Form};
use crate::schema::message::From;
use crate::value::{Record, Value};

/// A request to a device.
#[derive(Clone, Debug)]
pub struct Request {
    /// The request in words.
    pub words: String,
    /// The frame.
    pub bytes: Vec<u8>,
    /// The expected reply.
    pub(crate) asks: Asks,
}

/// The expected reply to a request.
#[derive(Clone, Debug)]
pub(crate) enum Asks {
    /// One of these messages; empty if the device does not reply.
    Messages(Vec<usize>),
    /// A Modbus response from this address.
    Modbus { address: u8, read: Option<Read> },
}

/// A frame of the device in words.
#[derive(Clone, Debug, PartialEq)]
pub struct Reply {
    /// The frame in words.
    pub words: String,
    /// Values by name, each in words.
    pub values: Vec<(String, Value, String)>,
    /// Whether the device refused the request.
    pub is_refusal: bool,
    /// Whether the frame answers the request; otherwise it is unsolicited.
    pub is_asked: bool,
}

impl Description {
    /// Examples of requests in words.
    pub fn phrases(&self) -> Vec<String> {
        if self.protocol.is_some() {
            return modbus::phrases(self);
        }
        let asked = self
            .messages
            .iter()
            .filter(|message| message.is_from(From::Host));
        let asked = asked.filter(|message| message.from != From::Device);
        asked.map(phrase).collect()
    }

    /// Parses requests: the name of a message and `key=value` for its fields, or `read` and `write`
    /// of registers.
    ///
    /// # Errors
    /// If the message, field or value does not exist; with the expected ones.
    pub fn requests(&self, words: &[&str]) -> Result<Vec<Request>, String> {
        let read = self.read_requests(words);
        read.map_err(|message| with_meant(&message))
    }

    fn read_requests(&self, words: &[&str]) -> Result<Vec<Request>, String> {
        if self.protocol.is_some() {
            return modbus::requests(self, words);
        }
        let Some((name, given)) = words.split_first() else {
            return Err(format!("expected one of {}", self.phrases().join("; ")));
        };
        let known = |message: &&Message| message.name() == *name && message.from != From::Device;
        let Some(message) = self.messages.iter().find(known) else {
            let names = self
                .messages
                .iter()
                .filter(|message| message.from != From::Device);
            let names: Vec<_> = names.map(Message::name).collect();
            let names = names.join(", ");
            return Err(format!(
                "there is no message \"{name}\" of the driver, expected one of: {names}"
            ));
        };
        let mut values = Record::default();
        for pair in given {
            let (key, text) = pair
                .split_once('=')
                .ok_or_else(|| format!("\"{pair}\": expected FIELD=VALUE; {}", phrase(message)))?;
            let value = value_of(message, key, text)?;
            if values.get(key).is_some() {
                return Err(format!("{key} is given twice"));
            }
            values.set(key, value);
        }
        let request = self.request(message, &values)?;
        Ok(vec![request])
    }

    /// The request with the message `message` and these values.
    ///
    /// # Errors
    /// If a value does not fit its field.
    pub fn request(&self, message: &Message, values: &Record) -> Result<Request, String> {
        let written = message.encode(values);
        if let Some((name, value)) = written.cut.first() {
            return Err(format!(
                "{name} cannot be {value}, expected a value of its type"
            ));
        }
        if let Some(failed) = written.failed.first() {
            return Err(format!("{}: {failed}", message.name()));
        }
        let frame = self.frame_of(message.frame, &written.bytes);
        let bytes = frame.ok_or_else(|| format!("{} does not fit a frame", message.name()))?;
        let decoded = message.decode(&written.bytes);
        let words = message.words(decoded.as_ref().unwrap_or(values));
        let asks = Asks::Messages(self.answers(message));
        Ok(Request { words, bytes, asks })
    }

    /// The messages that can answer `message`.
    pub(crate) fn answers(&self, message: &Message) -> Vec<usize> {
        let index = self
            .messages
            .iter()
            .position(|other| other.name == message.name);
        let mut answers: Vec<usize> = Vec::new();
        for on in &self.on {
            let fits = match on.trigger {
                Trigger::Message(of) => Some(of) == index,
                Trigger::AnyMessage => true,
                Trigger::Event(_) => false,
            };
            if fits {
                answers.extend(&on.deed.send);
            }
        }
        answers.dedup();
        answers
    }

    /// The messages that follow the first frame of a reply: some replies have several.
    pub(crate) fn rest_of_reply(&self, first: &Frame) -> Vec<usize> {
        let body = self.body(first).unwrap_or_default();
        let found = self.decode(first.format, &body, From::Device);
        let Some((first, _)) = found else {
            return Vec::new();
        };
        let mut rest: Vec<usize> = Vec::new();
        for on in &self.on {
            let mut own = on.deed.send.clone();
            let is_reply = !matches!(on.trigger, Trigger::Event(_));
            let Some(at) = own.iter().position(|sent| *sent == first && is_reply) else {
                continue;
            };
            own.remove(at);
            for index in 0..own.len() {
                let times = |all: &[usize]| all.iter().filter(|one| **one == own[index]).count();
                if times(&rest) < times(&own[..=index]) {
                    rest.push(own[index]);
                }
            }
        }
        rest
    }

    /// Describes in words a frame that arrived after a request.
    pub fn reply(&self, request: &Request, frame: &Frame) -> Reply {
        if let Asks::Modbus { address, read } = &request.asks {
            let body = self.body(frame).unwrap_or_default();
            return modbus::reply(self, *address, read.as_ref(), &body);
        }
        let Asks::Messages(asked) = &request.asks else {
            return Reply::unknown(self.words(frame));
        };
        let Some((message, record)) = self.message(frame, From::Device) else {
            return Reply::unknown(self.words(frame));
        };
        let index = self
            .messages
            .iter()
            .position(|other| other.name == message.name);
        let values = record.0.iter().map(|(name, value)| {
            let known = field::find(message.fields(), name);
            let words = known.map_or_else(|| value.to_string(), |field| field.words(value));
            (name.to_string(), value.clone(), words)
        });
        Reply {
            words: message.words(&record),
            values: values.collect(),
            is_refusal: false,
            is_asked: index.is_some_and(|index| asked.contains(&index)),
        }
    }
}

impl Request {
    /// Whether the device answers the request.
    pub fn is_answered(&self) -> bool {
        match &self.asks {
            Asks::Messages(asked) => !asked.is_empty(),
            Asks::Modbus { address, .. } => *address != 0,
        }
    }
}

impl Reply {
    fn unknown(words: String) -> Self {
        Self {
            words,
            values: Vec::new(),
            is_refusal: false,
            is_asked: false,
        }
    }
}

/// The words of a request: a message with its fields.
fn phrase(message: &Message) -> String {
    let mut words = vec![message.name().to_owned()];
    for name in free_fields(message) {
        let field = field::find(message.fields(), name);
        let unit = field.map_or("", |field| field.unit.as_str());
        let wanted = if unit.is_empty() { "VALUE" } else { unit };
        words.push(format!("{name}={wanted}"));
    }
    words.join(" ")
}

/// The fields of a request whose values are neither constant nor computed.
fn free_fields(message: &Message) -> Vec<&str> {
    let mut names = message.names();
    names.retain(|name| {
        field::find(message.fields(), name).is_none_or(|field| {
            field.constant.is_none() && field.calc.is_none() && field.counts.is_none()
        })
    });
    names
}

/// Parses `text` as the value of the field `key`.
fn value_of(message: &Message, key: &str, text: &str) -> Result<Value, String> {
    let names = message.names();
    if !names.contains(&key) {
        let known = names.join(", ");
        let known = if known.is_empty() {
            "none".to_owned()
        } else {
            known
        };
        return Err(format!(
            "{} has no field \"{key}\", expected one of: {known}",
            message.name()
        ));
    }
    let Some(field) = field::find(message.fields(), key) else {
        return match &message.layout {
            Layout::Text { pieces, .. } => of_form(pattern::form(pieces, key), key, text),
            Layout::Fields(_) => Ok(Value::Text(text.to_owned())),
        };
    };
    if let Some(constant) = &field.constant {
        return Err(format!(
            "{key} is always {}, leave it out",
            field.words(constant)
        ));
    }
    if let Layout::Text { pieces, .. } = &message.layout {
        let names = field.names.iter().flat_map(|names| names.iter());
        let named = { names }.find(|(_, name)| *name == text);
        let value = match named {
            Some((number, _)) => Value::Int(*number),
            None => of_form(pattern::form(pieces, key), key, text)?,
        };
        return within(field, key, text, value);
    }
    let one = |text| within(field, key, text, one(field, key, text)?);
    if field.repeat.is_some() {
        let values = text.split(',').filter(|part| !part.is_empty());
        return Ok(Value::List(values.map(one).collect::<Result<_, _>>()?));
    }
    one(text)
}

/// `value`, if it is within the limits of its field and a whole number of its steps.
fn within(field: &Field, key: &str, text: &str, value: Value) -> Result<Value, String> {
    let Some(found) = value.as_f64() else {
        return Ok(value);
    };
    if let Some([least, most]) = field.limits
        && !(least..=most).contains(&found)
    {
        return Err(format!("{key}={text}: expected {least} to {most}"));
    }
    let is_float = matches!(&field.kind, Kind::Number(number) if number.kind == NumberKind::Float);
    if let (Some([scale, offset]), false) = (field.scale, is_float) {
        let count = (found - offset) / scale;
        let nearest = libm::round(count);
        if (count - nearest).abs() > 1e-6 * count.abs().max(1.0) {
            let nearest = Value::Float(nearest * scale + offset);
            return Err(format!(
                "{key}={text}: the field has steps of {scale}, the nearest value is {nearest}"
            ));
        }
    }
    Ok(value)
}

/// Parses `text` as a value in a text.
fn of_form(form: Form, key: &str, text: &str) -> Result<Value, String> {
    let wanted = match form {
        Form::Text => return Ok(Value::Text(text.to_owned())),
        Form::Plain | Form::Fixed => "a number",
        Form::Decimal => "a whole number",
        Form::Hex | Form::SmallHex => "a whole number from 0 on",
    };
    let fits = |value: &Value| match (form, value) {
        (Form::Plain | Form::Fixed, _) => true,
        (Form::Decimal, value) => matches!(value, Value::Int(_)),
        (_, value) => matches!(value, Value::Int(0..)),
    };
    let value = number(text).filter(fits);
    value.ok_or_else(|| format!("{key}=\"{text}\": expected {wanted}"))
}

fn one(field: &Field, key: &str, text: &str) -> Result<Value, String> {
    if let Some(names) = &field.names
        && let Some((number, _)) = names.iter().find(|(_, name)| *name == text)
    {
        return Ok(Value::Int(*number));
    }
    if !field.flags.is_empty() && number(text).is_none() {
        let mut bits = 0;
        for name in text.split('|').filter(|name| *name != "none") {
            let bit = field
                .flags
                .iter()
                .position(|flag| flag == name)
                .ok_or_else(|| {
                    format!(
                        "{key} has no bit \"{name}\", expected some of: {}",
                        field.flags.join(", ")
                    )
                })?;
            bits |= 1_i128 << bit;
        }
        return Ok(Value::Int(bits));
    }
    match &field.kind {
        Kind::Str(_) | Kind::StrZ | Kind::Prefixed { is_text: true, .. } => {
            Ok(Value::Text(text.to_owned()))
        }
        Kind::Bytes(_) | Kind::Prefixed { is_text: false, .. } => {
            let digits: Vec<u8> = text
                .bytes()
                .filter(|byte| !byte.is_ascii_whitespace())
                .collect();
            let bytes = crate::framing::hex_bytes(&digits);
            bytes.map(Value::Bytes).ok_or_else(|| {
                format!("{key}=\"{text}\": expected bytes as two hexadecimal digits each")
            })
        }
        _ => number(text)
            .filter(|value| field.takes_fractions() || value.is_whole())
            .ok_or_else(|| {
                let what = if number(text).is_some() {
                    "a whole number"
                } else {
                    "a number"
                };
                let names = field.names.as_ref().map_or_else(String::new, |names| {
                    let names: Vec<_> = names.values().map(String::as_str).collect();
                    format!(", or one of: {}", names.join(", "))
                });
                format!("{key}=\"{text}\": expected {what}{names}")
            }),
    }
}

/// Parses a number as a user writes it.
fn number(text: &str) -> Option<Value> {
    if let Some(int) = crate::compile::whole(text) {
        return Some(Value::Int(int));
    }
    match text {
        "true" | "on" => return Some(Value::Int(1)),
        "false" | "off" => return Some(Value::Int(0)),
        _ => {}
    }
    let float = text.parse::<f64>().ok()?;
    float.is_finite().then_some(Value::Float(float))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A value that the device would read as another one is refused, also in a text.
    #[test]
    fn a_value_that_does_not_fit_is_refused() {
        let nothing = |_: &str| Err("no file".to_owned());
        let own = r#"
            name = "heater"
            about = "A heater"
            line = { baud = 9600 }
            frame = { terminator = "\r", max = 60 }
            [[message]]
            name = "set"
            from = "host"
            text = "SP={target:.1f} {steps:d} {flags:02X} {gain} {label:s}"
            [[message]]
            name = "done"
            from = "device"
            text = "OK"
            [[on]]
            message = "set"
            reply = "done"
        "#;
        let heater = Description::parse("heater", own, &nothing).unwrap_or_else(|e| panic!("{e}"));
        let request = |words: &[&str]| heater.requests(&[&["set"], words].concat());
        let sound = [
            "target=4.5",
            "steps=-3",
            "flags=0x1F",
            "gain=0.25",
            "label=0 7",
        ];
        let sent = request(&sound).expect("all fit");
        assert_eq!(sent[0].bytes, b"SP=4.5 -3 1F 0.25 0 7\r");
        for (word, expected) in [
            ("target=abc", "target=\"abc\": expected a number"),
            ("target=4,5", "target=\"4,5\": expected a number"),
            ("target=nan", "target=\"nan\": expected a number"),
            ("target=", "target=\"\": expected a number"),
            ("steps=1.5", "steps=\"1.5\": expected a whole number"),
            (
                "flags=-1",
                "flags=\"-1\": expected a whole number from 0 on",
            ),
            ("gain=much", "gain=\"much\": expected a number"),
        ] {
            assert_eq!(request(&[word]).err().as_deref(), Some(expected));
        }
        // A text with settings of its fields, and numbers of steps of 0.1 from 1 to 50.
        let limited = own.replace(
            "[[message]]\n            name = \"done\"",
            "fields = [{ name = \"steps\", limits = [1, 50] }]\n            [[message]]\n            \
             name = \"done\"",
        );
        let flow = own.replace(
            "text = \"SP={target:.1f} {steps:d} {flags:02X} {gain} {label:s}\"",
            "fields = [{ name = \"flow\", type = \"u16le\", scale = 0.1, limits = [1, 50] }]",
        );
        for (text, sound, wrong) in [
            (
                &limited,
                "steps=50",
                [("steps=51", "1 to 50"), ("steps=x", "whole number")],
            ),
            (
                &flow,
                "flow=25.1",
                [
                    ("flow=2555", "1 to 50"),
                    ("flow=25.04", "nearest value is 25"),
                ],
            ),
        ] {
            let device = Description::parse("limited", text, &nothing);
            let device = device.unwrap_or_else(|error| panic!("{error}"));
            assert!(device.requests(&["set", sound]).is_ok(), "{sound}");
            for (word, expected) in wrong {
                let error = device.requests(&["set", word]).err().unwrap_or_default();
                assert!(error.contains(expected), "{word}: {error}");
            }
        }
        let twice = request(&["steps=1", "steps=2"]);
        assert_eq!(twice.err().as_deref(), Some("steps is given twice"));
    }
}
