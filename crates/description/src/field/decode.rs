//! Decoding of bytes into values.

use std::sync::Arc;

use super::{Field, Kind, Nested, Size};
use crate::expr::Scope;
use crate::framing::hex_bytes;
use crate::number::{Number, NumberKind};
use crate::value::{Record, Value};

/// Decodes `bytes` if the fields consume all of them.
pub(crate) fn decode(fields: &[Field], bytes: &[u8], scope: &dyn Scope) -> Option<Record> {
    let mut reader = Reader::of(bytes);
    let mut record = Record(Vec::with_capacity(fields.len()));
    reader.fields(fields, &mut record, scope)?;
    (reader.bytes.is_empty() && reader.bit == 0).then_some(record)
}

/// The position of a number within bytes.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    pub(crate) at: usize,
    pub(crate) number: Number,
    /// Least and greatest count, if the field has limits.
    pub(crate) limits: Option<[f64; 2]>,
}

/// The positions of all numbers in `bytes` if the fields fit; constants are left out.
pub(crate) fn places(fields: &[Field], bytes: &[u8]) -> Vec<Place> {
    let mut reader = Reader {
        places: Some(Vec::new()),
        ..Reader::of(bytes)
    };
    let read = reader.fields(fields, &mut Record::default(), &crate::expr::Nothing);
    read.map_or_else(Vec::new, |()| reader.places.unwrap_or_default())
}

/// The end of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TextEnd {
    /// A NUL behind it.
    Nul,
    /// A number before it counts its bytes.
    Count,
    /// NULs fill its fixed size.
    Padding,
    /// The end of the message.
    Frame,
}

/// The position of a text or of counted bytes within bytes.
#[derive(Clone, Debug)]
pub(crate) struct TextPlace {
    pub(crate) at: usize,
    /// Number of its bytes, without a NUL behind them.
    pub(crate) len: usize,
    pub(crate) end: TextEnd,
    /// The position of the number that counts its bytes.
    pub(crate) count: Option<(usize, Number)>,
    /// Whether it holds characters.
    pub(crate) is_text: bool,
}

/// The positions of all texts, and of bytes of changing number, in `bytes` if the fields fit.
pub(crate) fn texts(fields: &[Field], bytes: &[u8]) -> Vec<TextPlace> {
    let mut reader = Reader {
        places: Some(Vec::new()),
        ..Reader::of(bytes)
    };
    let read = reader.fields(fields, &mut Record::default(), &crate::expr::Nothing);
    read.map_or_else(Vec::new, |()| reader.texts)
}

/// The value of a number in a register.
pub(crate) fn number_value(number: Number, bytes: &[u8]) -> Value {
    let bits = number.bits(bytes);
    match number.kind {
        NumberKind::Float => Value::Float(number.float(bits)),
        _ => Value::Int(number.int(bits)),
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    /// Number of bits of the first byte that have been read.
    bit: u8,
    /// Number of bytes at the start.
    len: usize,
    /// Positions of the numbers read so far, if requested.
    places: Option<Vec<Place>>,
    /// The texts read so far, and the numbers that count the bytes of a field, with its name.
    texts: Vec<TextPlace>,
    counts: Vec<(Arc<str>, usize, Number)>,
}

impl<'a> Reader<'a> {
    const fn of(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            bit: 0,
            len: bytes.len(),
            places: None,
            texts: Vec::new(),
            counts: Vec::new(),
        }
    }

    fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        if self.bit != 0 {
            return None;
        }
        let (taken, rest) = self.bytes.split_at_checked(len)?;
        self.bytes = rest;
        Some(taken)
    }

    fn note(&mut self, field: &Field, number: Number) {
        let at = self.len - self.bytes.len();
        if let Some(counted) = field.counts.as_ref().filter(|_| self.places.is_some()) {
            self.counts.push((counted.clone(), at, number));
        }
        if let Some(places) = self.places.as_mut().filter(|_| field.constant.is_none()) {
            let count = |value: f64| field.unscaled(Value::Float(value)).as_f64();
            let limits = field
                .limits
                .and_then(|[least, most]| Some([count(least)?, count(most)?]));
            places.push(Place { at, number, limits });
        }
    }

    /// Notes the text or the bytes of `field`, of which the first is the next one.
    fn note_text(&mut self, field: &Field, len: usize) {
        if self.places.is_none() || field.constant.is_some() {
            return;
        }
        let at = self.len - self.bytes.len();
        let counted = || {
            let mut counts = self.counts.iter().rev();
            let (_, at, number) = counts.find(|(name, ..)| *name == field.name)?;
            Some((*at, *number))
        };
        let (end, count, is_text) = match &field.kind {
            Kind::StrZ => (TextEnd::Nul, None, true),
            Kind::Prefixed { prefix, is_text } => {
                let before = at - usize::from(prefix.bytes);
                (TextEnd::Count, Some((before, *prefix)), *is_text)
            }
            Kind::Str(Size::Fixed(_)) => (TextEnd::Padding, None, true),
            Kind::Str(Size::Rest) => (TextEnd::Frame, None, true),
            Kind::Bytes(Size::Rest) => (TextEnd::Frame, None, false),
            Kind::Str(Size::Computed(_)) => (TextEnd::Count, counted(), true),
            Kind::Bytes(Size::Computed(_)) => (TextEnd::Count, counted(), false),
            _ => return,
        };
        // A size by another expression stays: nothing says how its fields would change.
        let end = match (end, count) {
            (TextEnd::Count, None) => return,
            (end, _) => end,
        };
        self.texts.push(TextPlace {
            at,
            len,
            end,
            count,
            is_text,
        });
    }

    fn bits(&mut self, count: u8, is_low_first: bool) -> Option<u64> {
        let (mut value, mut place) = (0_u64, 0);
        while place < count {
            let byte = *self.bytes.first()?;
            let len = (count - place).min(8 - self.bit);
            value = if is_low_first {
                let part = (byte >> self.bit) & (0xFF >> (8 - len));
                value | u64::from(part) << place
            } else {
                value << len | u64::from((byte << self.bit) >> (8 - len))
            };
            place += len;
            self.bit += len;
            if self.bit == 8 {
                self.bit = 0;
                self.bytes = &self.bytes[1..];
            }
        }
        Some(value)
    }

    fn fields(&mut self, fields: &[Field], record: &mut Record, outer: &dyn Scope) -> Option<()> {
        for field in fields {
            if field.is_optional && self.bytes.is_empty() {
                return Some(());
            }
            let scope = Nested { own: record, outer };
            if let Some(condition) = &field.condition
                && !condition.eval(&scope).ok()?.is_true()
            {
                continue;
            }
            if let Kind::Switch { on, cases, other } = &field.kind {
                let on = on.eval(&scope).ok()?;
                let chosen = choose(&on, cases, other.as_deref())?;
                self.fields(chosen, record, outer)?;
                continue;
            }
            let value = match &field.repeat {
                None => self.value(field, &scope)?,
                Some(Size::Rest) => {
                    let mut list = Vec::new();
                    while !self.bytes.is_empty() {
                        let left = self.bytes.len();
                        list.push(self.value(field, &scope)?);
                        if self.bytes.len() == left && self.bit == 0 {
                            return None;
                        }
                    }
                    Value::List(list)
                }
                Some(size) => {
                    let count = size.of(&scope, 0)?;
                    let list = (0..count).map(|_| self.value(field, &scope));
                    Value::List(list.collect::<Option<_>>()?)
                }
            };
            if let Some(constant) = &field.constant
                && *constant != value
            {
                return None;
            }
            if !field.name.is_empty() && !matches!(field.kind, Kind::Pad(_)) {
                record.0.push((field.name.clone(), value));
            }
        }
        Some(())
    }

    fn value(&mut self, field: &Field, scope: &dyn Scope) -> Option<Value> {
        let size = |reader: &Self, size: &Size| size.of(scope, reader.bytes.len());
        let value = match &field.kind {
            Kind::Number(number) => {
                self.note(field, *number);
                number_value(*number, self.take(number.bytes.into())?)
            }
            Kind::Bits { bits, is_low_first } => {
                Value::Int(self.bits(*bits, *is_low_first)?.into())
            }
            Kind::Bcd {
                size: of,
                is_low_first,
            } => {
                let len = size(self, of)?;
                let mut bytes = self.take(len)?.to_vec();
                if *is_low_first {
                    bytes.reverse();
                }
                let digits = bytes.iter().try_fold(0_i128, |value, &byte| {
                    let (high, low) = (byte >> 4, byte & 15);
                    let fits = high < 10 && low < 10;
                    let digits = fits.then_some(i128::from(high * 10 + low))?;
                    value.checked_mul(100)?.checked_add(digits)
                });
                Value::Int(digits?)
            }
            Kind::Decimal(of) => {
                let len = size(self, of)?;
                let text = core::str::from_utf8(self.take(len)?).ok()?;
                let sound = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
                let digits = text.strip_prefix(['-', '+']).unwrap_or(text);
                Value::Int(Some(text).filter(|_| sound(digits))?.parse().ok()?)
            }
            Kind::Hex(of) => {
                let len = size(self, of)?;
                let digits = self.take(len)?;
                let padded = [&b"0"[..usize::from(len % 2 == 1)], digits].concat();
                let bytes = hex_bytes(&padded).filter(|bytes| bytes.len() <= 8)?;
                Value::Int(
                    bytes
                        .iter()
                        .fold(0, |all, &byte| all << 8 | i128::from(byte)),
                )
            }
            Kind::Str(of) => {
                let len = size(self, of)?;
                self.note_text(field, len);
                text_value(self.take(len)?, matches!(of, Size::Fixed(_)))
            }
            Kind::StrZ => {
                let len = self.bytes.iter().position(|byte| *byte == 0)?;
                self.note_text(field, len);
                let text = text_value(self.take(len)?, false);
                self.take(1)?;
                text
            }
            Kind::Bytes(of) => {
                let len = size(self, of)?;
                self.note_text(field, len);
                Value::Bytes(self.take(len)?.to_vec())
            }
            Kind::Prefixed { prefix, is_text } => {
                let bytes = self.take(prefix.bytes.into())?;
                let len = usize::try_from(prefix.int(prefix.bits(bytes))).ok()?;
                self.note_text(field, len);
                let bytes = self.take(len)?;
                match is_text {
                    true => text_value(bytes, false),
                    false => Value::Bytes(bytes.to_vec()),
                }
            }
            Kind::Pad(of) => {
                let len = size(self, of)?;
                self.take(len)?;
                return Some(Value::Bytes(Vec::new()));
            }
            Kind::Group(fields) => {
                let mut record = Record::default();
                self.fields(fields, &mut record, scope)?;
                return Some(Value::Record(record));
            }
            Kind::Switch { .. } => return None,
        };
        Some(field.scaled(value))
    }
}

/// Text with one byte per character; the padding of a fixed size is removed.
fn text_value(bytes: &[u8], is_padded: bool) -> Value {
    let padding = bytes
        .iter()
        .rev()
        .take_while(|byte| is_padded && **byte == 0)
        .count();
    let text = &bytes[..bytes.len() - padding];
    Value::Text(text.iter().map(|&byte| char::from(byte)).collect())
}

/// The fields of the case that `on` selects.
pub(super) fn choose<'a>(
    on: &Value,
    cases: &'a [(Value, Vec<Field>)],
    other: Option<&'a [Field]>,
) -> Option<&'a [Field]> {
    let fits = |case: &Value| match (case.as_int(), on.as_int()) {
        (Some(case), Some(on)) => case == on,
        _ => case == on,
    };
    let found = cases.iter().find(|(case, _)| fits(case));
    found.map(|(_, fields)| &**fields).or(other)
}
