//! Frames disassembled and reassembled, for intentionally wrong inputs.

use core::ops::Range;

use crate::description::Description;
use crate::field;
use crate::framing::{Cut, Frame};
use crate::message::Layout;
use crate::number::{Number, NumberKind};
use crate::schema::message::From;

/// A number in a content, with values to try there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NumberPlace {
    /// The position of the number.
    pub range: Range<usize>,
    /// Values as bytes: the limits of the type and of the field, and one beyond each.
    pub values: Vec<Vec<u8>>,
    /// Whether the number is the length of the frame.
    pub is_length: bool,
}

impl Description {
    /// The content of a frame without trailer: sync bytes, length and body.
    pub fn content(&self, frame: &Frame) -> Option<Vec<u8>> {
        let framing = self.frames.0.get(frame.format)?;
        let mut content = framing.content(&frame.bytes).ok()?.into_owned();
        content.truncate(content.len().checked_sub(framing.trailer)?);
        Some(content)
    }

    /// The frame of such a content. The length field keeps its value; the checksums are correct.
    pub fn assemble(&self, format: usize, content: &[u8]) -> Option<Vec<u8>> {
        self.frames.0.get(format)?.assemble(content)
    }

    /// Makes the last checksum of a frame wrong.
    pub fn spoil(&self, format: usize, frame: &mut Vec<u8>) {
        self.frames.spoil(format, frame);
    }

    /// Writes the length of the frame into its content.
    pub fn repair_length(&self, format: usize, content: &mut [u8]) {
        let Some(framing) = self.frames.0.get(format) else {
            return;
        };
        let mut whole = [&*content, &vec![0; framing.trailer]].concat();
        if framing.write_length(&mut whole).is_some() {
            content.copy_from_slice(&whole[..content.len()]);
        }
    }

    /// The numbers of a content: the length of the frame, and the fields of the message of `from`
    /// in it.
    pub fn number_places(&self, format: usize, content: &[u8], from: From) -> Vec<NumberPlace> {
        let Some(framing) = self.frames.0.get(format) else {
            return Vec::new();
        };
        let mut places = Vec::new();
        if let Cut::Length(length) = &framing.cut {
            places.extend(length_place(content, length.at, length.number));
        }
        let Some((body, at_of)) = self.body_places(format, content) else {
            return places;
        };
        let Some((index, _)) = self.decode(format, &body, from) else {
            return places;
        };
        let Layout::Fields(fields) = &self.messages[index].layout else {
            return places;
        };
        for place in field::places(fields, &body) {
            let len = usize::from(place.number.bytes);
            let (Some(first), Some(last)) = (at_of.get(place.at), at_of.get(place.at + len - 1))
            else {
                continue;
            };
            // A number that encloses a hole has no single range.
            if last - first + 1 == len {
                places.push(NumberPlace {
                    range: *first..last + 1,
                    values: values(place.number, place.limits),
                    is_length: false,
                });
            }
        }
        places
    }
}

fn length_place(content: &[u8], at: usize, number: Number) -> Option<NumberPlace> {
    let range = at..at + usize::from(number.bytes);
    let told = number.bits(content.get(range.clone())?);
    let most = u64::MAX >> (64 - 8 * u32::from(number.bytes));
    let wanted = [
        0,
        1,
        told.wrapping_sub(1),
        told + 1,
        told.saturating_mul(2),
        most / 2,
        most,
    ];
    let values = wanted
        .into_iter()
        .filter(|value| *value <= most && *value != told);
    let values = values.map(|value| written(number, value)).collect();
    Some(NumberPlace {
        range,
        values,
        is_length: true,
    })
}

fn written(number: Number, bits: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    number.put(bits, &mut bytes);
    bytes
}

/// Values that often cause failures.
fn values(number: Number, limits: Option<[f64; 2]>) -> Vec<Vec<u8>> {
    let bits = 8 * u32::from(number.bytes);
    let (top, all) = (1_u64 << (bits - 1), u64::MAX >> (64 - bits));
    let mut wanted: Vec<u64> = match number.kind {
        NumberKind::Float => {
            let floats = [
                f64::NAN,
                f64::INFINITY,
                f64::NEG_INFINITY,
                -0.0,
                0.0,
                f64::MAX,
                1e-30,
            ];
            floats.map(|float| number.float_bits(float)).to_vec()
        }
        _ => vec![0, 1, top - 1, top, top + 1, all - 1, all],
    };
    for limit in limits.into_iter().flatten() {
        for value in [limit - 1.0, limit, limit + 1.0] {
            wanted.push(match number.kind {
                NumberKind::Float => number.float_bits(value),
                _ => {
                    let int = crate::value::Value::Float(value).as_int().unwrap_or(0);
                    let low = int & i128::from(all);
                    u64::try_from(low).unwrap_or(0)
                }
            });
        }
    }
    wanted.sort_unstable();
    wanted.dedup();
    wanted
        .into_iter()
        .map(|bits| written(number, bits))
        .collect()
}
