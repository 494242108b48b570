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

use crate::behaviour::Trigger;
use crate::description::Description;
use crate::field::{self, Field, Kind};
use crate::framing::Frame;
use crate::message::{Layout, Message};
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
        return Ok(match message.layout {
            Layout::Text { .. } => number(text).unwrap_or_else(|| Value::Text(text.to_owned())),
            Layout::Fields(_) => Value::Text(text.to_owned()),
        });
    };
    if let Some(constant) = &field.constant {
        return Err(format!(
            "{key} is always {}, leave it out",
            field.words(constant)
        ));
    }
    if field.repeat.is_some() {
        let values = text.split(',').filter(|part| !part.is_empty());
        let values: Result<Vec<_>, _> = values.map(|part| one(field, key, part)).collect();
        return Ok(Value::List(values?));
    }
    one(field, key, text)
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
        _ => number(text).ok_or_else(|| {
            let names = field.names.as_ref().map_or_else(String::new, |names| {
                let names: Vec<_> = names.values().map(String::as_str).collect();
                format!(", or one of: {}", names.join(", "))
            });
            format!("{key}=\"{text}\": expected a number{names}")
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
