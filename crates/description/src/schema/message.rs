//! `[[message]]` and its fields.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Deserialize;

use super::short::{Many, Plain};
use super::wire::{Endian, SizeSpec};

/// A message: what a frame holds.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MessageSpec {
    /// Name, for behaviour and reports.
    pub name: String,
    /// Which end sends it.
    pub from: From,
    /// What it is for, in a line.
    #[serde(default)]
    pub about: String,
    /// Which frames carry it, by name; the first format if not given.
    #[serde(default)]
    pub frame: Option<String>,
    /// The text of a line: words and fields in braces, e.g. `SPEED {left} {right:.2f}`.
    #[serde(default)]
    pub text: Option<String>,
    /// Fields in the order of the bytes; for a `text` what is to be known of those in braces.
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
    /// Either of them.
    Both,
}

/// A field.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FieldSpec {
    /// Name; a field without one is not reported.
    #[serde(default)]
    pub name: String,
    /// What its bytes are: `u8` to `u64`, `i8` to `i64`, `f32`, `f64`, with `le` or `be` behind it
    /// if the order is another one; `b1` to `b64` bits, highest first; `bcd` (`bcdle`: lowest byte
    /// first), `decimal`, `hex` and `str` of `size` bytes, `strz` that ends with a 0, `bytes`,
    /// `pad`, `group` of `fields`, `switch` of `cases`.
    #[serde(default, rename = "type")]
    pub kind: String,
    /// The value that it always has: it tells messages apart.
    #[serde(default)]
    pub value: Option<Plain>,
    /// What is sent, as an expression over fields and state.
    #[serde(default)]
    pub calc: Option<String>,
    /// Bytes, digits or characters: a number, an expression over earlier fields, or `rest`.
    #[serde(default)]
    pub size: Option<SizeSpec>,
    /// How many there are: a number, an expression over earlier fields, or `rest`.
    #[serde(default)]
    pub repeat: Option<SizeSpec>,
    /// It is there only if this expression over earlier fields is true.
    #[serde(default, rename = "if")]
    pub condition: Option<String>,
    /// It may be missing at the end of a message, with all fields behind it.
    #[serde(default)]
    pub optional: bool,
    /// Order of its bytes.
    #[serde(default)]
    pub endian: Option<Endian>,
    /// Order of its words of 16 bits, where that is another one.
    #[serde(default)]
    pub words: Option<Endian>,
    /// Type of the number before a `str` or `bytes` that says how long it is.
    #[serde(default)]
    pub prefix: Option<String>,
    /// What one count is worth: the value is count * scale + offset.
    #[serde(default)]
    pub scale: Option<f64>,
    /// The value of count 0.
    #[serde(default)]
    pub offset: Option<f64>,
    /// Unit of the value, for people.
    #[serde(default)]
    pub unit: String,
    /// Least and greatest value.
    #[serde(default)]
    pub limits: Option<[f64; 2]>,
    /// Names of values: the name of a table of `[enums]`.
    #[serde(default, rename = "enum")]
    pub names: Option<String>,
    /// Names of bits, lowest first; an empty one is unused.
    #[serde(default)]
    pub flags: Vec<String>,
    /// Fields of a `group`.
    #[serde(default)]
    pub fields: Vec<Self>,
    /// What chooses the case of a `switch`: an expression over earlier fields.
    #[serde(default)]
    pub on: Option<String>,
    /// Fields of a `switch` by the value of `on`; `_` is any other.
    #[serde(default)]
    pub cases: BTreeMap<String, Vec<Self>>,
    /// What it is, for people.
    #[serde(default)]
    pub about: String,
}

/// Names of messages: one or several.
pub type Names = Many<String>;
