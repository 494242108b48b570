//! Messages: the meaning of a frame's body.

use std::sync::Arc;

use crate::expr::{Nothing, Scope};
use crate::field::{self, Field};
use crate::framing::Framing;
use crate::pattern::{self, Piece};
use crate::schema::message::From;
use crate::value::{Record, Value};

/// Maximum number of steps that adjust an example to the length of its frame, one element per step.
const FIT_STEPS: usize = 512;

/// A compiled message.
#[derive(Clone, Debug)]
pub struct Message {
    pub(crate) name: Arc<str>,
    pub(crate) about: String,
    pub(crate) from: From,
    /// Index of its frame format.
    pub(crate) frame: usize,
    /// All frame formats.
    pub(crate) frames: Arc<Vec<Framing>>,
    pub(crate) layout: Layout,
    /// Whether a field has limits.
    pub(crate) has_limits: bool,
}

/// The structure of a body.
#[derive(Clone, Debug)]
pub(crate) enum Layout {
    Fields(Vec<Field>),
    Text {
        pieces: Vec<Piece>,
        fields: Vec<Field>,
    },
}

impl Layout {
    /// Whether a field, or a field in a case of a switch, has limits.
    pub(crate) fn has_limits(&self) -> bool {
        fn any(fields: &[Field]) -> bool {
            fields.iter().any(|field| match &field.kind {
                field::Kind::Switch { cases, other, .. } => {
                    let cases = cases.iter().map(|(_, fields)| fields).chain(other);
                    cases.into_iter().any(|fields| any(fields))
                }
                _ => field.limits.is_some(),
            })
        }
        let (Self::Fields(fields) | Self::Text { fields, .. }) = self;
        any(fields)
    }
}

/// The bytes of a message, and the problems with its values.
#[derive(Debug, Default)]
pub(crate) struct Written {
    pub(crate) bytes: Vec<u8>,
    pub(crate) cut: Vec<(String, Value)>,
    pub(crate) failed: Vec<String>,
}

impl Message {
    /// The name of the message.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The purpose of the message.
    pub fn about(&self) -> &str {
        &self.about
    }

    /// The end that sends the message.
    pub const fn from(&self) -> From {
        self.from
    }

    /// Whether the end `from` sends the message.
    pub(crate) fn is_from(&self, from: From) -> bool {
        self.from == from || self.from == From::Both || from == From::Both
    }

    /// The names of its named fields.
    pub fn field_names(&self) -> Vec<&str> {
        let pieces = match &self.layout {
            Layout::Fields(_) => &[],
            Layout::Text { pieces, .. } => &pieces[..],
        };
        let holes = pieces.iter().filter_map(|piece| match piece {
            Piece::Hole(hole) => Some(hole.name.as_str()),
            Piece::Words(_) => None,
        });
        let fields = self.fields().iter().map(|field| &*field.name);
        let mut names: Vec<&str> = Vec::new();
        for name in holes.chain(fields).filter(|name| !name.is_empty()) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    pub(crate) fn fields(&self) -> &[Field] {
        match &self.layout {
            Layout::Fields(fields) | Layout::Text { fields, .. } => fields,
        }
    }

    /// The text with field names in braces, if the message is a text.
    pub fn text(&self) -> Option<String> {
        match &self.layout {
            Layout::Fields(_) => None,
            Layout::Text { pieces, .. } => Some(pattern::source(pieces)),
        }
    }

    /// The names of its fields.
    pub(crate) fn names(&self) -> Vec<&str> {
        match &self.layout {
            Layout::Fields(fields) => names_of(fields),
            Layout::Text { pieces, .. } => {
                let names = pieces.iter().filter_map(|piece| match piece {
                    Piece::Hole(hole) => Some(hole.name.as_str()),
                    Piece::Words(_) => None,
                });
                names.collect()
            }
        }
    }

    /// The values of a body, if it is this message.
    pub fn decode(&self, body: &[u8]) -> Option<Record> {
        match &self.layout {
            Layout::Fields(fields) => field::decode(fields, body, &Nothing),
            Layout::Text { pieces, fields } => {
                let text: String = body.iter().map(|&byte| char::from(byte)).collect();
                pattern::decode(pieces, fields, &text)
            }
        }
    }

    /// The body with the values of `scope`.
    pub(crate) fn encode(&self, scope: &dyn Scope) -> Written {
        self.encode_behind(0, scope)
    }

    /// Like [`encode`](Self::encode), behind space for `front` bytes.
    pub(crate) fn encode_behind(&self, front: usize, scope: &dyn Scope) -> Written {
        match &self.layout {
            Layout::Fields(fields) => {
                let encoding = field::encode(fields, front, scope);
                Written {
                    bytes: encoding.bytes,
                    cut: encoding.cut,
                    failed: encoding.failed,
                }
            }
            Layout::Text { pieces, fields } => {
                let mut failed = Vec::new();
                let text = pattern::encode(pieces, fields, scope, &mut failed);
                let byte = |c: char| u8::try_from(u32::from(c)).unwrap_or(b'?');
                let space = core::iter::repeat_n(0, front);
                let bytes = space.chain(text.chars().map(byte)).collect();
                Written {
                    bytes,
                    cut: Vec::new(),
                    failed,
                }
            }
        }
    }

    /// Example values, selected by `choice(n)`, which returns a number below `n`.
    pub fn example(&self, choice: &mut dyn FnMut(u64) -> u64) -> Record {
        match &self.layout {
            Layout::Fields(fields) => {
                let mut record = field::example(fields, choice);
                self.fit(fields, &mut record, choice);
                record
            }
            Layout::Text { pieces, fields } => pattern::example(pieces, fields, choice),
        }
    }

    /// Resizes the field that takes the rest so that the body fits a frame of known size.
    fn fit(&self, fields: &[Field], record: &mut Record, choice: &mut dyn FnMut(u64) -> u64) {
        let (Some(rest), Some(framing)) = (
            fields.iter().find(|field| field.takes_rest()),
            self.frames.get(self.frame),
        ) else {
            return;
        };
        for _ in 0..FIT_STEPS {
            let body = self.encode(record).bytes;
            let len = body.len();
            let Some(room) = framing.room(&body) else {
                return;
            };
            if len == room {
                return;
            }
            let Some(value) = record.get(&rest.name) else {
                return;
            };
            let value = field::longer(rest, value, len, room, choice);
            record.set(&rest.name, value);
        }
    }

    /// Values in words: `reading: voltage 230.1 V, relay on`.
    pub fn words(&self, values: &Record) -> String {
        let words = field::words_of(self.fields(), values);
        match words.is_empty() {
            true => self.name.to_string(),
            false => format!("{}: {words}", self.name),
        }
    }
}

fn names_of(fields: &[Field]) -> Vec<&str> {
    let names = fields.iter().flat_map(|field| match &field.kind {
        field::Kind::Switch { cases, other, .. } => {
            let cases = cases.iter().map(|(_, fields)| fields).chain(other);
            cases.flat_map(|fields| names_of(fields)).collect()
        }
        _ => vec![&*field.name],
    });
    names.filter(|name| !name.is_empty()).collect()
}
