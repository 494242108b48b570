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
    /// Only one end may send at a time, as on RS-485; the device loses bytes that arrive while it
    /// sends.
    #[serde(default)]
    pub half_duplex: bool,
    /// Minimum time from the end of a request to the beginning of the reply.
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

/// A frame format. Exactly one of `terminator`, `end`, `length`, `size`, `sizes` and `silence`
/// defines the end of a frame.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameSpec {
    /// Name, if there are several formats on the line.
    #[serde(default)]
    pub name: String,
    /// Line terminator of a text protocol.
    #[serde(default)]
    pub terminator: Option<Marker>,
    /// Start marker of a frame with an end marker; not part of the body.
    #[serde(default)]
    pub start: Option<Marker>,
    /// End marker of a frame.
    #[serde(default)]
    pub end: Option<Marker>,
    /// How marker bytes within a frame are escaped.
    #[serde(default)]
    pub stuffing: Option<Stuffing>,
    /// Number of bytes behind the end marker that belong to the frame.
    #[serde(default)]
    pub tail: Option<u16>,
    /// Last bytes behind the end marker, e.g. a line end behind the checksum.
    #[serde(default)]
    pub closing: Option<Marker>,
    /// Encoding of the frame's bytes: `hex` for two hexadecimal digits per byte.
    #[serde(default)]
    pub encoding: Option<Encoding>,
    /// First bytes of every frame of known length.
    #[serde(default)]
    pub sync: Option<Marker>,
    /// The length field.
    #[serde(default)]
    pub length: Option<LengthSpec>,
    /// Number of bytes of every frame, or an expression over its first bytes `b0`, `b1`, .. (see
    /// `head`).
    #[serde(default)]
    pub size: Option<SizeSpec>,
    /// Number of bytes that the expression `size` reads; 1 if not given.
    #[serde(default)]
    pub head: Option<u8>,
    /// Frame size by the value of the byte `at`, e.g. `{ 0x01 = 8, 0x02 = 4 }`.
    #[serde(default)]
    pub sizes: BTreeMap<String, u16>,
    /// Offset of the byte that `sizes` reads; 0 if not given.
    #[serde(default)]
    pub at: Option<u8>,
    /// Characters of silence that end a frame, e.g. 3.5.
    #[serde(default)]
    pub silence: Option<f64>,
    /// Checksums.
    #[serde(default)]
    pub checksum: Many<Short<ChecksumSpec>>,
    /// Maximum number of bytes of a frame; 1024 if not given.
    #[serde(default)]
    pub max: Option<u16>,
    /// Idle time after which a partial frame is discarded; if not given, the time of 20 characters
    /// and at least 10 ms.
    #[serde(default)]
    pub idle: Option<Span>,
}

/// How marker bytes within a frame are escaped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Stuffing {
    /// No escape.
    None,
    /// C0 ends a frame; within a frame C0 is sent as DB DC, and DB as DB DD (RFC 1055).
    Slip,
    /// 7E is the marker; within a frame 7D precedes a byte whose bit 5 is inverted (RFC 1662).
    Hdlc,
    /// Consistent overhead byte stuffing; 0 is the marker.
    Cobs,
    /// Markers begin with DLE (10), by default DLE STX (10 02) and DLE ETX (10 03); within a frame
    /// DLE is sent twice.
    Dle,
}

/// The encoding of a frame's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// Plain bytes.
    Binary,
    /// Two upper-case hexadecimal digits per byte.
    Hex,
}

/// A number of bytes, or an expression.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected a number of bytes, or an expression as text"
)]
pub enum SizeSpec {
    /// A number of bytes.
    Bytes(u32),
    /// An expression; `rest` is all remaining bytes.
    Expression(String),
}

/// The length field.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LengthSpec {
    /// Offset of the field in the frame.
    pub at: u16,
    /// `u8`, `u16`, `u24` or `u32`, with the suffix `le` or `be` for another byte order.
    #[serde(rename = "type")]
    pub kind: String,
    /// The bytes that the field counts.
    #[serde(default)]
    pub counts: Counts,
    /// Number of those bytes that are not counted; negative if more bytes are counted.
    #[serde(default)]
    pub without: i32,
    /// Number of bytes per count, e.g. 2 for words.
    #[serde(default)]
    pub unit: Option<u16>,
    /// Mask of the length bits; all bits if not given. The other bits belong to the message, which
    /// has a field of the same size at the same offset.
    #[serde(default)]
    pub mask: Option<u32>,
    /// Offset of a second field with the same length, as in M-Bus.
    #[serde(default)]
    pub again: Option<u16>,
}

/// The bytes that a length field counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Counts {
    /// The bytes behind the field, without checksums and end marker at the end.
    #[default]
    Payload,
    /// All bytes behind the field.
    Rest,
    /// All bytes of the frame.
    Frame,
}

/// A checksum; its short form is the name of the algorithm.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ChecksumSpec {
    /// The algorithm: a name of the CRC catalogue such as `CRC-16/MODBUS`, or a sum such as `sum8`.
    #[serde(default)]
    pub algorithm: Option<String>,
    /// A user-defined CRC.
    #[serde(default)]
    pub polynomial: Option<PolynomialSpec>,
    /// Offset of the first covered byte; negative from the end; 0 if not given.
    #[serde(default)]
    pub from: Option<i32>,
    /// Offset behind the last covered byte; 0 is the end; the offset of the checksum if not given.
    /// The bytes of the checksum itself count as 0.
    #[serde(default)]
    pub to: Option<i32>,
    /// Offset of the checksum; negative from the end; the end if not given.
    #[serde(default)]
    pub at: Option<i32>,
    /// Number of bytes that are sent, if fewer than the result has.
    #[serde(default)]
    pub bytes: Option<u8>,
    /// Number of low bits of the result that are sent, e.g. 7 if bytes are below 128; all bits if
    /// not given.
    #[serde(default)]
    pub bits: Option<u8>,
    /// Number that is added to the result, e.g. 32 if the checksum is a printable character.
    #[serde(default)]
    pub plus: Option<u32>,
    /// Byte order of the checksum.
    #[serde(default)]
    pub endian: Option<Endian>,
    /// Encoding of the checksum; binary if not given.
    #[serde(default)]
    pub encoding: Option<Encoding>,
    /// Bytes before the checksum that separate it.
    #[serde(default)]
    pub separator: Option<Marker>,
    /// Bytes that the checksum covers in addition, behind those of the frame.
    #[serde(default)]
    pub extra: Option<Marker>,
    /// Bytes that the checksum covers in addition, before those of the frame, e.g. its start
    /// marker.
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
    /// The value that is XORed with the register at the end.
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
