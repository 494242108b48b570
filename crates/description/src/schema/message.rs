//! `[[message]]` and its fields.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Deserialize;

use super::short::{Many, Plain};
use super::wire::{Endian, SizeSpec};

/// A message: the content of a frame.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MessageSpec {
    /// Name, for behaviour and reports.
    pub name: String,
    /// The end that sends the message.
    pub from: From,
    /// The purpose of the message in one line.
    #[serde(default)]
    pub about: String,
    /// The frame format, by name; the first format if not given.
    #[serde(default)]
    pub frame: Option<String>,
    /// The text of a line: words and fields in braces, e.g. `SPEED {left} {right:.2f}`.
    #[serde(default)]
    pub text: Option<String>,
    /// Fields in the order of the bytes; for a `text`, properties of the fields in braces.
    #[serde(default)]
    pub fields: Vec<FieldSpec>,
}

/// The end that sends a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum From {
    /// The driver.
    Host,
    /// The device.
    Device,
    /// Either end.
    Both,
}

/// A field.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FieldSpec {
    /// Name; a field without a name is not reported.
    #[serde(default)]
    pub name: String,
    /// The type: `u8` to `u64`, `i8` to `i64`, `f32`, `f64`, with the suffix `le` or `be` for
    /// another byte order; `b1` to `b64` bits, highest first; `bcd` (`bcdle`: lowest byte first),
    /// `decimal`, `hex` and `str` of `size` bytes; `strz` that ends with a 0; `bytes`, `pad`,
    /// `group` of `fields`, `switch` of `cases`.
    #[serde(default, rename = "type")]
    pub kind: String,
    /// The constant value of the field; it distinguishes messages.
    #[serde(default)]
    pub value: Option<Plain>,
    /// The value to send, as an expression over fields and state.
    #[serde(default)]
    pub calc: Option<String>,
    /// Number of bytes, digits or characters: a number, an expression over earlier fields, or
    /// `rest`.
    #[serde(default)]
    pub size: Option<SizeSpec>,
    /// Number of repetitions: a number, an expression over earlier fields, or `rest`.
    #[serde(default)]
    pub repeat: Option<SizeSpec>,
    /// The field is present only if this expression over earlier fields is true.
    #[serde(default, rename = "if")]
    pub condition: Option<String>,
    /// The field may be missing at the end of a message, with all fields behind it.
    #[serde(default)]
    pub optional: bool,
    /// Byte order of the field.
    #[serde(default)]
    pub endian: Option<Endian>,
    /// Order of the field's 16-bit words, if different.
    #[serde(default)]
    pub words: Option<Endian>,
    /// Type of the length prefix of a `str` or `bytes`.
    #[serde(default)]
    pub prefix: Option<String>,
    /// Value of one count: the value is count * scale + offset.
    #[serde(default)]
    pub scale: Option<f64>,
    /// The value of count 0.
    #[serde(default)]
    pub offset: Option<f64>,
    /// Unit of the value, for display.
    #[serde(default)]
    pub unit: String,
    /// Least and greatest value.
    #[serde(default)]
    pub limits: Option<[f64; 2]>,
    /// Names of values: the name of a table of `[enums]`.
    #[serde(default, rename = "enum")]
    pub names: Option<String>,
    /// Names of bits, lowest first; an empty name marks an unused bit.
    #[serde(default)]
    pub flags: Vec<String>,
    /// Fields of a `group`.
    #[serde(default)]
    pub fields: Vec<Self>,
    /// The expression over earlier fields that selects the case of a `switch`.
    #[serde(default)]
    pub on: Option<String>,
    /// Fields of a `switch` by the value of `on`; `_` is any other value.
    #[serde(default)]
    pub cases: BTreeMap<String, Vec<Self>>,
    /// A description of the field, for display.
    #[serde(default)]
    pub about: String,
}

/// Names of messages: one or several.
pub type Names = Many<String>;
