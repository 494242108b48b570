//! Messages of a description instead of bytes: the rig decodes and encodes the frames.

use std::sync::Arc;

use description::device::{MISSING_PAUSE, no_pause};
use description::{Cutter, Description, Frame, From, Message, Record, Value};
use protocols::{Decode as _, FrameError, Instant, LineConfig};
use serde_json::{Map, Number, Value as Json, json};

/// Maximum length of a frame that a silence ends.
const SILENT_MAX: usize = 4_096;

/// The result of decoding.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Heard {
    /// A message: name and fields.
    Message(Json),
    /// A frame without a matching message.
    Unknown(Vec<u8>),
    /// Bytes outside frames: the broken rule, and a description.
    Bad(&'static str, String),
}

/// Decodes the frames of a driver.
#[derive(Clone)]
pub(crate) struct Listener {
    description: Arc<Description>,
    cutter: Cutter,
    /// Bytes of a frame that ends with a silence.
    silent: Vec<u8>,
    quiet_at: Option<Instant>,
}

impl Listener {
    pub(crate) fn new(description: Arc<Description>) -> Self {
        Self {
            cutter: description.cutter_of(From::Host),
            description,
            silent: Vec::new(),
            quiet_at: None,
        }
    }

    /// Time at which the silence is long enough to end a frame.
    pub(crate) const fn quiet_at(&self) -> Option<Instant> {
        self.quiet_at
    }

    /// Ends a frame if the line was silent for long enough before `now`.
    pub(crate) fn pass(&mut self, now: Instant, to: &mut dyn FnMut(Instant, Heard)) {
        let Some(at) = self.quiet_at.filter(|at| *at <= now) else {
            return;
        };
        self.quiet_at = None;
        if !self.description.ends_with_silence() {
            self.cutter.idle();
            return self.cut(at, &[], to);
        }
        let bytes = core::mem::take(&mut self.silent);
        if !bytes.is_empty() {
            let count = self.description.without_pause(&bytes);
            let heard = match (self.description.whole(&bytes), count) {
                (Ok(frame), _) => self.heard(&frame),
                (Err(_), Some(count)) => {
                    Heard::Bad(MISSING_PAUSE, no_pause(count, self.description.idle()))
                }
                (Err(error), None) => bad(error),
            };
            to(at, heard);
        }
    }

    /// Decodes received bytes; the last one ended at `end`.
    pub(crate) fn hear(
        &mut self,
        line: LineConfig,
        end: Instant,
        bytes: &[u8],
        to: &mut dyn FnMut(Instant, Heard),
    ) {
        self.pass(line.byte_end(end, bytes.len() as u64), to);
        self.quiet_at = Some(end + self.description.idle());
        if self.description.ends_with_silence() {
            let room = SILENT_MAX.saturating_sub(self.silent.len());
            self.silent.extend(bytes.iter().take(room));
            return;
        }
        for (index, byte) in bytes.iter().enumerate() {
            let at = line.byte_end(end, (bytes.len() - 1 - index) as u64);
            self.cut(at, &[*byte], to);
        }
    }

    fn cut(&mut self, at: Instant, bytes: &[u8], to: &mut dyn FnMut(Instant, Heard)) {
        let mut rest = bytes;
        let mut first_error = None;
        while let Some(outcome) = self.cutter.step(&mut rest) {
            match outcome {
                Ok(frame) => {
                    let heard = self.heard(&frame);
                    to(at, heard);
                }
                // The rest of a damaged frame causes further errors; the first error gives the
                // reason.
                Err(error) => first_error = first_error.or(Some(error)),
            }
        }
        if let Some(error) = first_error {
            to(at, bad(error));
        }
    }

    fn heard(&self, frame: &Frame) -> Heard {
        match self.description.message(frame, From::Host) {
            Some((message, record)) => Heard::Message(json!({
                "name": message.name(),
                "fields": json_of_record(&record),
            })),
            None => Heard::Unknown(frame.bytes.to_vec()),
        }
    }
}

/// The rules are the same as for described devices.
fn bad(error: FrameError) -> Heard {
    let rule = match error {
        FrameError::Checksum { .. } => "bad-checksum",
        FrameError::Truncated { .. } => "frame-cut-off",
        FrameError::Length { .. } => "bad-length",
        _ => "bad-frame",
    };
    Heard::Bad(rule, error.to_string())
}

/// The frame of a message that a node program sends.
pub(crate) fn frame_of(description: &Description, message: &Json) -> Result<Vec<u8>, String> {
    let name = message["name"].as_str().unwrap_or_default();
    let messages = description.messages().iter();
    let is_sent = |message: &&Message| message.from() != From::Host;
    let Some(known) = messages
        .clone()
        .filter(is_sent)
        .find(|known| known.name() == name)
    else {
        let known: Vec<_> = messages.filter(is_sent).map(Message::name).collect();
        let known = known.join(", ");
        return Err(format!(
            "is the message \"{name}\", expected one of {known}"
        ));
    };
    let Json::Object(fields) = &message["fields"] else {
        return Err(format!("is the message {name} without \"fields\""));
    };
    let names = known.field_names();
    if let Some(other) = fields.keys().find(|field| !names.contains(&field.as_str())) {
        let names = names.join(", ");
        return Err(format!(
            "has the field \"{other}\", which the message {name} does not have, expected: {names}"
        ));
    }
    let fields = fields.iter();
    let fields = fields.map(|(field, value)| Ok((field.as_str().into(), value_of(value)?)));
    let record = Record(fields.collect::<Result<_, String>>()?);
    description
        .frame(known, &record)
        .ok_or_else(|| format!("is the message {name} with values that do not fit into a frame"))
}

/// The messages of a description, for the greeting.
pub(crate) fn table_of(description: &Description) -> Json {
    let message = |message: &Message| {
        let from = match message.from() {
            From::Host => "host",
            From::Device => "device",
            From::Both => "both",
        };
        json!({ "name": message.name(), "from": from, "fields": message.field_names() })
    };
    description.messages().iter().map(message).collect()
}

fn json_of_record(record: &Record) -> Json {
    let fields = record.0.iter();
    let fields = fields.map(|(name, value)| (name.to_string(), json_of(value)));
    Json::Object(fields.collect::<Map<_, _>>())
}

fn json_of(value: &Value) -> Json {
    match value {
        Value::Bool(yes) => Json::Bool(*yes),
        Value::Int(int) => match (i64::try_from(*int), u64::try_from(*int)) {
            (Ok(int), _) => int.into(),
            (_, Ok(int)) => int.into(),
            _ => Json::String(int.to_string()),
        },
        Value::Float(float) => Number::from_f64(*float).map_or(Json::Null, Json::Number),
        Value::Text(text) => Json::String(text.clone()),
        Value::Bytes(bytes) => json!({ "hex": crate::json::hex(bytes) }),
        Value::List(list) => list.iter().map(json_of).collect(),
        Value::Record(record) => json_of_record(record),
    }
}

fn value_of(json: &Json) -> Result<Value, String> {
    Ok(match json {
        Json::Null => return Err("has a field that is null, expected a value".to_owned()),
        Json::Bool(yes) => Value::Bool(*yes),
        Json::Number(number) => match (number.as_i64(), number.as_u64()) {
            (Some(int), _) => Value::Int(int.into()),
            (_, Some(int)) => Value::Int(int.into()),
            _ => Value::Float(number.as_f64().unwrap_or_default()),
        },
        Json::String(text) => Value::Text(text.clone()),
        Json::Array(list) => Value::List(list.iter().map(value_of).collect::<Result<_, _>>()?),
        Json::Object(map) => match (map.len(), map.get("hex")) {
            (1, Some(hex)) => Value::Bytes(crate::json::bytes(hex)?),
            _ => {
                let fields = map.iter();
                let fields =
                    fields.map(|(name, value)| Ok((name.as_str().into(), value_of(value)?)));
                Value::Record(Record(fields.collect::<Result<_, String>>()?))
            }
        },
    })
}
