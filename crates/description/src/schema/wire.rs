//! `[line]`, `[frame]` and `checksum`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Deserialize;

use super::short::{FromPlain, Many, Marker, Short};
use crate::value::Value;
use span::Span;

/// The serial line.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LineSpec {
    /// Bits per second, 300 to 4000000.
    #[schemars(range(min = 300, max = 4_000_000))]
    pub baud: u32,
    /// Data bits, parity and stop bits, e.g. `8N1` or `7E1`.
    #[serde(default = "eight_n_one")]
    pub format: String,
    /// Only one end may send at a time, as on RS-485: what arrives while the device sends is lost.
    #[serde(default)]
    pub half_duplex: bool,
    /// Least time from the end of a request to the beginning of the reply.
    #[serde(default)]
    pub turnaround: Option<Span>,
    /// Address of the device on its wire, for protocols and expressions that need one.
    #[serde(default)]
    pub address: Option<u32>,
    /// The device sends back every byte that it receives.
    #[serde(default)]
    pub echo: bool,
}

fn eight_n_one() -> String {
    "8N1".to_owned()
}

/// Order of the bytes of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Endian {
    /// Lowest byte first.
    Little,
    /// Highest byte first.
    Big,
}

/// How frames are cut out of bytes. Exactly one of `terminator`, `end`, `length`, `size`, `sizes`
/// and `silence` says where a frame ends.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameSpec {
    /// Name, if there are several formats on the line.
    #[serde(default)]
    pub name: String,
    /// Ends a line of text.
    #[serde(default)]
    pub terminator: Option<Marker>,
    /// Begins a frame whose end is marked; no part of what the messages see.
    #[serde(default)]
    pub start: Option<Marker>,
    /// Ends a frame.
    #[serde(default)]
    pub end: Option<Marker>,
    /// How bytes of the markers are kept out of a frame.
    #[serde(default)]
    pub stuffing: Option<Stuffing>,
    /// Bytes behind the end marker that belong to the frame.
    #[serde(default)]
    pub tail: Option<u16>,
    /// Last bytes of the tail, e.g. a line end behind the checksum.
    #[serde(default)]
    pub closing: Option<Marker>,
    /// How the frame's bytes are written: `hex` for two hexadecimal digits each.
    #[serde(default)]
    pub encoding: Option<Encoding>,
    /// First bytes of every frame whose length is known.
    #[serde(default)]
    pub sync: Option<Marker>,
    /// Where the frame says how long it is.
    #[serde(default)]
    pub length: Option<LengthSpec>,
    /// Bytes of every frame; or an expression over its first bytes `b0`, `b1`, .., see `head`.
    #[serde(default)]
    pub size: Option<SizeSpec>,
    /// Bytes that have to be there for the expression `size`; 1 if not given.
    #[serde(default)]
    pub head: Option<u8>,
    /// Bytes of a frame by the byte `at`, e.g. `{ 0x01 = 8, 0x02 = 4 }`.
    #[serde(default)]
    pub sizes: BTreeMap<String, u16>,
    /// Which byte `sizes` looks at, from 0; 0 if not given.
    #[serde(default)]
    pub at: Option<u8>,
    /// Characters of silence that end a frame, e.g. 3.5.
    #[serde(default)]
    pub silence: Option<f64>,
    /// Checksums.
    #[serde(default)]
    pub checksum: Many<Short<ChecksumSpec>>,
    /// Most bytes of a frame; 1024 if not given.
    #[serde(default)]
    pub max: Option<u16>,
    /// Pause that ends a half-received frame; as long as 20 characters and at least 10 ms if not
    /// given.
    #[serde(default)]
    pub idle: Option<Span>,
}

/// How bytes of the markers are kept out of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Stuffing {
    /// They are not.
    None,
    /// C0 ends a frame; within it C0 is DB DC, DB is DB DD (RFC 1055).
    Slip,
    /// 7E is the marker; within a frame 7D stands before a byte whose bit 5 is inverted (RFC 1662).
    Hdlc,
    /// Consistent overhead byte stuffing; 0 is the marker.
    Cobs,
}

/// How the bytes of a frame are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// As they are.
    Binary,
    /// As two hexadecimal digits each, in capitals.
    Hex,
}

/// Bytes, or an expression.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected a number of bytes, or an expression as text"
)]
pub enum SizeSpec {
    /// Bytes.
    Bytes(u32),
    /// An expression; `rest` is all that is left.
    Expression(String),
}

/// The length field.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LengthSpec {
    /// Its place in the frame, from 0.
    pub at: u16,
    /// `u8`, `u16`, `u24` or `u32`, with `le` or `be` behind it if the order is another one.
    #[serde(rename = "type")]
    pub kind: String,
    /// What it counts.
    #[serde(default)]
    pub counts: Counts,
    /// Bytes of those that it does not count; less than 0 if it counts more.
    #[serde(default)]
    pub without: i32,
    /// Bytes for each that it counts, e.g. 2 for words.
    #[serde(default)]
    pub unit: Option<u16>,
    /// Bits of the field that are the length; all if not given. The other bits belong to the
    /// message, which has a field of this size at this place.
    #[serde(default)]
    pub mask: Option<u32>,
    /// Place of a second field with the same length, as M-Bus has it.
    #[serde(default)]
    pub again: Option<u16>,
}

/// What a length field counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Counts {
    /// The bytes behind it, without checksums and end marker at the end.
    #[default]
    Payload,
    /// All bytes behind it.
    Rest,
    /// All bytes of the frame.
    Frame,
}

/// A checksum; the name of its algorithm is the short form.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ChecksumSpec {
    /// The algorithm: a name of the CRC catalogue such as `CRC-16/MODBUS`, or a sum such as `sum8`.
    #[serde(default)]
    pub algorithm: Option<String>,
    /// A CRC of one's own.
    #[serde(default)]
    pub polynomial: Option<PolynomialSpec>,
    /// First byte that it covers; less than 0 from the end; 0 if not given.
    #[serde(default)]
    pub from: Option<i32>,
    /// First byte behind those that it covers; 0 is the end; its own place if not given. Its own
    /// bytes count as 0.
    #[serde(default)]
    pub to: Option<i32>,
    /// Its place; less than 0 from the end; the end if not given.
    #[serde(default)]
    pub at: Option<i32>,
    /// Its bytes, if only some are sent.
    #[serde(default)]
    pub bytes: Option<u8>,
    /// Order of its bytes.
    #[serde(default)]
    pub endian: Option<Endian>,
    /// How it is written; binary if not given.
    #[serde(default)]
    pub encoding: Option<Encoding>,
    /// What stands before it.
    #[serde(default)]
    pub separator: Option<Marker>,
    /// Bytes that are summed up behind those of the frame.
    #[serde(default)]
    pub extra: Option<Marker>,
    /// Bytes that are summed up before those of the frame, e.g. its start marker.
    #[serde(default)]
    pub before: Option<Marker>,
}

/// The parameters of a CRC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PolynomialSpec {
    /// Bits of the register, 3 to 64.
    pub width: u8,
    /// The polynomial without its highest bit.
    pub poly: u64,
    /// The register at the start.
    #[serde(default)]
    pub init: u64,
    /// Whether bytes are read lowest bit first.
    #[serde(default)]
    pub refin: bool,
    /// Whether the register is reflected at the end.
    #[serde(default)]
    pub refout: bool,
    /// What the register is XORed with at the end.
    #[serde(default)]
    pub xorout: u64,
}

impl FromPlain for ChecksumSpec {
    const EXPECTED: &'static str = "the name of an algorithm, or a table";

    fn from_plain(value: Value) -> Option<Self> {
        let Value::Text(name) = value else {
            return None;
        };
        let algorithm = Some(name);
        Some(Self {
            algorithm,
            ..Self::default()
        })
    }
}
