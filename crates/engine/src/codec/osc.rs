//! `osc`: messages of Open Sound Control 1.0, as a phone with faders sends them.
//!
//! ```text
//! /address 0..   ,types 0..   arguments        each part a multiple of four bytes
//! ```
//!
//! On a network one packet is one message, or a bundle of them. In a stream of bytes a message
//! implies its length and a bundle does not, so bundles are reported as bad.

use core::time::Duration;

use protocols::{Candidate, Decoder, Format, FrameError};

use super::floor::Floor;
use super::lua::{Lua, LuaField, field};
use super::row::Codec;
use super::wire::{Choices, Wire};

/// Messages of Open Sound Control.
pub static OSC: Codec = Codec::of::<Osc>("Messages of Open Sound Control, no bundles")
    .with_idle(GAP)
    .with_floor(Floor {
        check_bits: 32,
        ..Floor::CHECKED
    })
    .with_lua(Lua {
        source: include_str!("lua/osc.lua"),
        judge: "judge_osc",
        tell: "tell_osc",
        fields: &FIELDS,
    });

/// A packet arrives completely at once.
const GAP: Duration = Duration::from_millis(5);
/// The longest message.
const MESSAGE_MAX: usize = 256;

const FIELDS: [LuaField; 3] = [
    field("osc_address", "string", "hilrig.osc.address", "Address"),
    field("osc_types", "string", "hilrig.osc.types", "Types"),
    field("osc_float", "float", "hilrig.osc.float", "Float"),
];

/// The messages.
#[derive(Clone, Copy, Debug)]
pub struct Osc;

/// Consecutive messages.
#[derive(Clone, Copy, Debug, Default)]
pub struct OscFormat;

/// A message.
#[derive(Clone, Debug)]
pub struct OscMessage(Vec<u8>);

/// A text, and the offset of the next part.
type Part<'a> = (&'a [u8], usize);

/// The text at `from`, which ends with one to four zeros; `None` if more bytes are needed.
fn text(bytes: &[u8], from: usize) -> Result<Option<Part<'_>>, FrameError> {
    let wrong = |at: usize| FrameError::Implausible {
        at: u32::try_from(at).unwrap_or(u32::MAX),
        found: bytes[at].into(),
    };
    let rest = bytes.get(from..).unwrap_or_default();
    let Some(len) = rest.iter().position(|byte| !byte.is_ascii_graphic()) else {
        return Ok(None);
    };
    let end = from + (len / 4 + 1) * 4;
    let padding = bytes[from + len..].iter().take(end - from - len);
    match padding.clone().position(|byte| *byte != 0) {
        Some(at) => Err(wrong(from + len + at)),
        None if bytes.len() < end => Ok(None),
        None => Ok(Some((&rest[..len], end))),
    }
}

/// Bytes of an argument of this type.
const fn argument_len(kind: u8) -> Option<usize> {
    match kind {
        b'i' | b'f' => Some(4),
        b'h' | b'd' | b't' => Some(8),
        b'T' | b'F' | b'N' | b'I' => Some(0),
        _ => None,
    }
}

/// Address, types and arguments.
type Message<'a> = [&'a [u8]; 3];

/// The message at the start of `bytes`, and its length; `None` if more bytes are needed.
fn message(bytes: &[u8]) -> Result<Option<(Message<'_>, usize)>, FrameError> {
    let Some((address, begin)) = text(bytes, 0)? else {
        return Ok(None);
    };
    let Some(&first) = bytes.get(begin) else {
        return Ok(None);
    };
    let wrong = |at: usize, found: u8| FrameError::Implausible {
        at: u32::try_from(at).unwrap_or(u32::MAX),
        found: found.into(),
    };
    if first != b',' {
        return Err(wrong(begin, first));
    }
    let Some((types, arguments)) = text(bytes, begin)? else {
        return Ok(None);
    };
    let mut end = arguments;
    for kind in &types[1..] {
        end += argument_len(*kind).ok_or_else(|| wrong(begin, *kind))?;
    }
    let whole = bytes.get(arguments..end);
    Ok(whole.map(|arguments| ([address, &types[1..], arguments], end)))
}

impl Format for OscFormat {
    type Frame = OscMessage;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        if bytes.first() != Some(&b'/') {
            return Candidate::Noise;
        }
        match message(bytes) {
            Ok(Some((_, len))) if len <= MESSAGE_MAX => Candidate::Complete(len),
            Ok(None) if bytes.len() < MESSAGE_MAX => Candidate::Incomplete,
            Ok(_) => Candidate::Rejected(FrameError::Length {
                max: 256,
                found: u32::try_from(bytes.len()).unwrap_or(u32::MAX),
            }),
            Err(error) => Candidate::Rejected(error),
        }
    }

    fn frame(&self, bytes: &[u8]) -> OscMessage {
        OscMessage(bytes.to_vec())
    }
}

/// Controls of a model car's phone.
const ADDRESSES: [&str; 5] = ["/1/speed", "/1/direction", "/1/kill", "/goal", "/a"];

impl Wire for Osc {
    type Decoder = Decoder<OscFormat, MESSAGE_MAX>;
    const NAME: &'static str = "osc";

    fn decoder() -> Self::Decoder {
        Self::Decoder::default()
    }

    fn bytes(OscMessage(bytes): &OscMessage) -> &[u8] {
        bytes
    }

    fn words(OscMessage(bytes): &OscMessage) -> String {
        let Ok(Some(([address, types, mut rest], _))) = message(bytes) else {
            return "no message".to_owned();
        };
        let mut words = String::from_utf8_lossy(address).into_owned();
        for kind in types {
            let (argument, behind) = rest.split_at(argument_len(*kind).unwrap_or(0));
            rest = behind;
            words.push(' ');
            words += &argument_words(*kind, argument);
        }
        words
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let address = ADDRESSES[choices.below(ADDRESSES.len())];
        let types: Vec<u8> = (0..choices.below(4))
            .map(|_| b"fidT"[choices.below(4)])
            .collect();
        for part in [address.as_bytes(), &[b",", &types[..]].concat()] {
            out.extend(part);
            out.extend(vec![0; 4 - part.len() % 4]);
        }
        for kind in types {
            for _ in 0..argument_len(kind).unwrap_or(0) {
                out.push(choices.byte());
            }
        }
    }

    /// Only the form gives a message's length and validity.
    fn repair(frame: &mut [u8]) {
        if let Some(first) = frame.first_mut() {
            *first = b'/';
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let bytes = &bytes[..bytes.len().min(256)];
        let mut parts = bytes.chunks_exact(4);
        // Whole groups of four bytes, up to the group with the zeros.
        let mut text = || {
            let mut text = Vec::new();
            loop {
                let group = parts.next()?;
                let len = group.iter().take_while(|byte| **byte > 32 && **byte < 127);
                let len = len.count();
                text.extend(&group[..len]);
                match group[len..] {
                    [] => {}
                    ref zeros if zeros.iter().all(|byte| *byte == 0) => return Some(text),
                    _ => return None,
                }
            }
        };
        let (address, types) = (text()?, text()?);
        if address.first() != Some(&b'/') || types.first() != Some(&b',') {
            return None;
        }
        let mut len = 4 * (address.len() / 4 + 1) + 4 * (types.len() / 4 + 1);
        for kind in &types[1..] {
            len += match kind {
                b'i' | b'f' => 4,
                b'h' | b'd' | b't' => 8,
                b'T' | b'F' | b'N' | b'I' => 0,
                _ => return None,
            };
        }
        (len <= bytes.len()).then_some(len)
    }

    /// The message's types and the length of its address.
    fn kind(OscMessage(bytes): &OscMessage) -> u64 {
        let Ok(Some(([address, types, _], _))) = message(bytes) else {
            return 0;
        };
        let types = types
            .iter()
            .take(3)
            .fold(0, |sum, kind| sum << 8 | u64::from(*kind));
        (types << 4) | (address.len() as u64 / 4 % 16)
    }
}

fn argument_words(kind: u8, bytes: &[u8]) -> String {
    let four = || bytes.try_into().unwrap_or_default();
    let eight = || bytes.try_into().unwrap_or_default();
    match kind {
        b'i' => i32::from_be_bytes(four()).to_string(),
        b'f' => f32::from_be_bytes(four()).to_string(),
        b'h' => i64::from_be_bytes(eight()).to_string(),
        b'd' => f64::from_be_bytes(eight()).to_string(),
        b't' => format!("time {:#x}", u64::from_be_bytes(eight())),
        other => char::from(other).to_string(),
    }
}
