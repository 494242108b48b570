//! Values of fields, variables and expressions.

use core::fmt;
use std::sync::Arc;

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A truth value.
    Bool(bool),
    /// An integer: 64 bits with or without sign, with room for sums.
    Int(i128),
    /// A floating-point number.
    Float(f64),
    /// Text.
    Text(String),
    /// Bytes.
    Bytes(Vec<u8>),
    /// Several values of one field.
    List(Vec<Self>),
    /// Fields of a group.
    Record(Record),
}

/// Whether two names are equal; most unequal names differ in length or first letter.
pub(crate) fn is_same(one: &str, other: &str) -> bool {
    let (one, other) = (one.as_bytes(), other.as_bytes());
    one.len() == other.len() && one.first() == other.first() && one == other
}

/// Values by name, in the order of the fields.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record(pub Vec<(Arc<str>, Value)>);

impl Record {
    /// The value called `name`; `outer.inner` is a value in a group.
    pub fn get(&self, name: &str) -> Option<&Value> {
        if let Some((_, value)) = self.0.iter().find(|(key, _)| is_same(key, name)) {
            return Some(value);
        }
        // Only a group has an inner name.
        let is_group = |(_, value): &(_, Value)| matches!(value, Value::Record(_));
        if !self.0.iter().any(is_group) {
            return None;
        }
        let (outer, inner) = name.split_once('.')?;
        match self.get(outer)? {
            Value::Record(record) => record.get(inner),
            _ => None,
        }
    }

    /// Adds a value, or replaces the value of that name.
    pub fn set(&mut self, name: &str, value: Value) {
        match self.0.iter_mut().find(|(key, _)| &**key == name) {
            Some((_, old)) => *old = value,
            None => self.0.push((name.into(), value)),
        }
    }
}

impl Record {
    /// Like [`set`](Self::set), with a shared name.
    pub(crate) fn set_shared(&mut self, name: &Arc<str>, value: Value) {
        match self.0.iter_mut().find(|(key, _)| is_same(key, name)) {
            Some((_, old)) => *old = value,
            None => self.0.push((Arc::clone(name), value)),
        }
    }
}

impl Value {
    /// The value as a number; true is 1.
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            Self::Bool(yes) => Some(f64::from(u8::from(*yes))),
            #[expect(clippy::cast_precision_loss, reason = "the nearest number is meant")]
            Self::Int(int) => Some(*int as f64),
            Self::Float(float) => Some(*float),
            _ => None,
        }
    }

    /// The value as an integer, rounded to the nearest.
    pub fn as_int(&self) -> Option<i128> {
        match self {
            Self::Bool(yes) => Some(i128::from(*yes)),
            Self::Int(int) => Some(*int),
            #[expect(clippy::cast_possible_truncation, reason = "saturates")]
            Self::Float(float) if float.is_finite() => Some(float.round() as i128),
            _ => None,
        }
    }

    /// Whether the value is a number without a fraction.
    pub(crate) fn is_whole(&self) -> bool {
        match self {
            Self::Int(_) | Self::Bool(_) => true,
            Self::Float(float) => float.fract() == 0.0,
            _ => false,
        }
    }

    /// Whether the value counts as true: not 0, not empty.
    pub fn is_true(&self) -> bool {
        match self {
            Self::Bool(yes) => *yes,
            Self::Int(int) => *int != 0,
            Self::Float(float) => *float != 0.0,
            Self::Text(text) => !text.is_empty(),
            Self::Bytes(bytes) => !bytes.is_empty(),
            Self::List(list) => !list.is_empty(),
            Self::Record(record) => !record.0.is_empty(),
        }
    }

    /// The name of the type, for messages.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Bool(_) => "a truth value",
            Self::Int(_) => "a whole number",
            Self::Float(_) => "a number",
            Self::Text(_) => "text",
            Self::Bytes(_) => "bytes",
            Self::List(_) => "a list",
            Self::Record(_) => "a group",
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(yes) => write!(f, "{yes}"),
            Self::Int(int) => write!(f, "{int}"),
            Self::Float(float) => write!(f, "{}", shown(*float)),
            Self::Text(text) => write!(f, "\"{}\"", text.escape_default()),
            Self::Bytes(bytes) => {
                let pairs: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
                write!(f, "[{}]", pairs.join(" "))
            }
            Self::List(list) => {
                let all: Vec<_> = list.iter().map(ToString::to_string).collect();
                write!(f, "[{}]", all.join(", "))
            }
            Self::Record(record) => {
                let all = record
                    .0
                    .iter()
                    .map(|(name, value)| format!("{name} {value}"));
                write!(f, "{{{}}}", all.collect::<Vec<_>>().join(", "))
            }
        }
    }
}

/// A number with at most seven digits, as scaled fields have: 23.4, not 23.400000000000002.
fn shown(float: f64) -> String {
    let plain = format!("{float}");
    if plain.len() <= 9 || !float.is_finite() {
        return plain;
    }
    let short = format!("{float:.6e}").parse::<f64>().unwrap_or(float);
    let short = format!("{short}");
    if short.len() < plain.len() {
        short
    } else {
        plain
    }
}
