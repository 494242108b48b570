//! Encoding of values into bytes.

use std::borrow::Cow;

use super::decode::choose;
use super::{Field, Kind, Nested, Size};
use crate::expr::Scope;
use crate::framing::hex_text;
use crate::number::{Number, NumberKind};
use crate::value::{Record, Value};

/// The bytes of fields, and the values that did not fit.
#[derive(Debug, Default)]
pub(crate) struct Encoding {
    pub(crate) bytes: Vec<u8>,
    /// Fields whose value was changed to fit: name and value.
    pub(crate) cut: Vec<(String, Value)>,
    /// Expressions that could not be evaluated.
    pub(crate) failed: Vec<String>,
    /// Bits of an incomplete byte.
    bits: [bool; 8],
    bit_count: usize,
    is_low_first: bool,
}

/// Initial capacity for the body of a usual message.
const BODY: usize = 64;

/// Encodes `fields` with the values of `scope`; a field without value becomes 0 or empty.
pub(crate) fn encode(fields: &[Field], scope: &dyn Scope) -> Encoding {
    let mut encoding = Encoding {
        bytes: Vec::with_capacity(BODY),
        ..Encoding::default()
    };
    encoding.fields(fields, &Record::default(), scope);
    encoding.flush();
    encoding
}

/// The bytes of a number in a register, and whether the value fits.
pub(crate) fn number_bytes(number: Number, value: &Value) -> (Vec<u8>, bool) {
    let mut out = Vec::new();
    let fits = put_number(number, value, &mut out);
    (out, fits)
}

/// Writes a number; returns whether the value fits.
pub(crate) fn put_number(number: Number, value: &Value, out: &mut Vec<u8>) -> bool {
    if number.kind == NumberKind::Float {
        let float = value.as_f64();
        number.put(number.float_bits(float.unwrap_or(0.0)), out);
        return float.is_some();
    }
    let wanted = value.as_int();
    let [least, greatest] = number.range();
    let int = wanted.unwrap_or(0).clamp(least, greatest);
    let mask = u64::MAX >> (64 - 8 * u32::from(number.bytes));
    let bits = u64::try_from(int & i128::from(mask)).unwrap_or(0);
    number.put(bits, out);
    wanted == Some(int)
}

impl Encoding {
    fn fields(&mut self, fields: &[Field], own: &Record, outer: &dyn Scope) {
        // Values written so far, for expressions over earlier fields.
        let mut written = own.clone();
        for field in fields {
            let scope = Nested {
                own: &written,
                outer,
            };
            if let Some(condition) = &field.condition {
                match condition.eval(&scope) {
                    Ok(value) if value.is_true() => {}
                    Ok(_) => continue,
                    Err(error) => {
                        self.failed.push(format!("{}: {error}", field.name));
                        continue;
                    }
                }
            }
            if let Kind::Switch { on, cases, other } = &field.kind {
                let on = on.eval(&scope).unwrap_or(Value::Int(0));
                if let Some(chosen) = choose(&on, cases, other.as_deref()) {
                    self.fields(chosen, &written, outer);
                }
                continue;
            }
            let known = match field.name.is_empty() {
                true => None,
                false => scope.value(&field.name),
            };
            if field.is_optional && known.is_none() && field.constant.is_none() {
                return;
            }
            let is_known = known.is_some();
            let value = self.value_of(field, fields, &scope, known);
            match &field.repeat {
                None => self.value(field, &value, &scope),
                Some(size) => {
                    let list = match &value {
                        Value::List(list) => list.clone(),
                        Value::Bytes(bytes) => {
                            bytes.iter().map(|&byte| Value::Int(byte.into())).collect()
                        }
                        // A single value is repeated for each element.
                        one => {
                            let count = match size {
                                Size::Rest => usize::from(is_known),
                                size => size.of(&scope, 0).unwrap_or(1),
                            };
                            vec![one.clone(); count]
                        }
                    };
                    let count = match size {
                        Size::Rest => list.len(),
                        size => size.of(&scope, 0).unwrap_or(list.len()),
                    };
                    if count != list.len() && is_known {
                        self.cut
                            .push((field.name.to_string(), Value::List(list.clone())));
                    }
                    let nothing = Value::Int(0);
                    for index in 0..count {
                        self.value(field, list.get(index).unwrap_or(&nothing), &scope);
                    }
                }
            }
            if !field.name.is_empty() {
                written.set_shared(&field.name, value);
            }
        }
    }

    /// The value that `field` encodes; `known` is its value in `scope`.
    fn value_of(
        &mut self,
        field: &Field,
        fields: &[Field],
        scope: &dyn Scope,
        known: Option<Value>,
    ) -> Value {
        if let Some(constant) = &field.constant {
            return constant.clone();
        }
        if let Some(calc) = &field.calc {
            return calc.eval(scope).unwrap_or_else(|error| {
                self.failed.push(format!("{}: {error}", field.name));
                Value::Int(0)
            });
        }
        if let Some(counted) = &field.counts
            && let Some(of) = fields.iter().find(|other| other.name == *counted)
        {
            let known = match of.name.is_empty() {
                true => None,
                false => scope.value(&of.name),
            };
            let value = self.value_of(of, fields, scope, known);
            let len = match &value {
                Value::List(list) => list.len(),
                Value::Bytes(bytes) => bytes.len(),
                Value::Text(text) => text.chars().count(),
                _ => 0,
            };
            return Value::Int(i128::try_from(len).unwrap_or(0));
        }
        known.map_or(Value::Int(0), |value| field.unnamed(value))
    }

    fn value(&mut self, field: &Field, value: &Value, scope: &dyn Scope) {
        let raw = &*field.count_of(value);
        if let Kind::Bits { bits, is_low_first } = &field.kind {
            return self.put_bits(field, raw, *bits, *is_low_first);
        }
        self.flush();
        let is_given = *value != Value::Int(0);
        let fits = match &field.kind {
            Kind::Number(number) => put_number(*number, raw, &mut self.bytes),
            Kind::Bcd { size, is_low_first } => {
                let len = size.of(scope, 0).unwrap_or(1);
                let (digits, fits) = digits(raw.as_int(), 2 * len);
                let pairs = digits.as_bytes().chunks(2);
                let bytes = pairs.map(|pair| (pair[0] - b'0') << 4 | (pair[1] - b'0'));
                let mut bytes: Vec<u8> = bytes.collect();
                if *is_low_first {
                    bytes.reverse();
                }
                self.bytes.extend(bytes);
                fits
            }
            Kind::Decimal(size) => {
                let len = size.of(scope, 0).unwrap_or(1);
                let int = raw.as_int().unwrap_or(0);
                let (text, fits) = match int < 0 && len > 1 {
                    true => {
                        let (digits, fits) = digits(Some(-int), len - 1);
                        (format!("-{digits}"), fits)
                    }
                    false => digits(raw.as_int(), len),
                };
                self.bytes.extend(text.bytes());
                fits
            }
            Kind::Hex(size) => {
                let len = size.of(scope, 0).unwrap_or(2);
                let int = raw.as_int().unwrap_or(0).max(0);
                let all = hex_text(&int.to_be_bytes());
                let kept = &all[all.len().saturating_sub(len)..];
                self.bytes.extend_from_slice(kept);
                raw.as_int().is_some_and(|int| int >= 0)
                    && all[..all.len() - kept.len()]
                        .iter()
                        .all(|digit| *digit == b'0')
            }
            Kind::Str(size) | Kind::Bytes(size) => {
                let bytes = plain_bytes(raw);
                let len = match size {
                    Size::Rest => bytes.len(),
                    size => size.of(scope, 0).unwrap_or(bytes.len()),
                };
                let kept = bytes.len().min(len);
                self.bytes.extend_from_slice(&bytes[..kept]);
                self.bytes.resize(self.bytes.len() + len - kept, 0);
                let is_text = matches!(field.kind, Kind::Str(_));
                kept == bytes.len() && (is_text || kept == len || !is_given)
            }
            Kind::StrZ => {
                let bytes = plain_bytes(raw);
                let end = bytes.iter().position(|byte| *byte == 0);
                let kept = end.unwrap_or(bytes.len());
                self.bytes.extend_from_slice(&bytes[..kept]);
                self.bytes.push(0);
                end.is_none()
            }
            Kind::Prefixed { prefix, .. } => {
                let bytes = plain_bytes(raw);
                let [_, most] = prefix.range();
                let kept = bytes.len().min(usize::try_from(most).unwrap_or(usize::MAX));
                let len = Value::Int(i128::try_from(kept).unwrap_or(0));
                put_number(*prefix, &len, &mut self.bytes);
                self.bytes.extend_from_slice(&bytes[..kept]);
                kept == bytes.len()
            }
            Kind::Pad(size) => {
                let len = size.of(scope, 0).unwrap_or(0);
                self.bytes.resize(self.bytes.len() + len, 0);
                true
            }
            Kind::Group(fields) => {
                let nothing = Record::default();
                let own = match raw {
                    Value::Record(record) => record,
                    _ => &nothing,
                };
                self.fields(fields, own, scope);
                true
            }
            Kind::Bits { .. } | Kind::Switch { .. } => true,
        };
        if !fits {
            self.cut.push((field.name.to_string(), value.clone()));
        }
    }

    fn put_bits(&mut self, field: &Field, raw: &Value, count: u8, is_low_first: bool) {
        let wanted = raw.as_int().unwrap_or(0);
        let most = (1_i128 << count) - 1;
        let int = wanted.clamp(0, most);
        if int != wanted {
            self.cut.push((field.name.to_string(), raw.clone()));
        }
        self.is_low_first = is_low_first;
        let bit = |place: u8| int >> place & 1 == 1;
        for place in 0..count {
            let place = match is_low_first {
                true => place,
                false => count - 1 - place,
            };
            self.bits[self.bit_count] = bit(place);
            self.bit_count += 1;
            if self.bit_count == 8 {
                self.flush();
            }
        }
    }

    /// Writes the pending bits as a byte.
    fn flush(&mut self) {
        if self.bit_count == 0 {
            return;
        }
        let count = core::mem::take(&mut self.bit_count);
        let byte = self.bits[..count]
            .iter()
            .enumerate()
            .fold(0_u8, |byte, (place, &bit)| {
                let shift = if self.is_low_first { place } else { 7 - place };
                byte | u8::from(bit) << shift
            });
        self.bytes.push(byte);
    }
}

fn plain_bytes(value: &Value) -> Cow<'_, [u8]> {
    Cow::Owned(match value {
        Value::Bytes(bytes) => return Cow::Borrowed(bytes),
        // One byte per character, as in decoding.
        Value::Text(text) => text
            .chars()
            .map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?'))
            .collect(),
        Value::List(list) => {
            let byte = |value: &Value| u8::try_from(value.as_int()?).ok();
            list.iter().map(|value| byte(value).unwrap_or(0)).collect()
        }
        Value::Int(0) => Vec::new(),
        other => other.to_string().into_bytes(),
    })
}

/// The last `len` decimal digits, and whether no digit was cut off.
fn digits(value: Option<i128>, len: usize) -> (String, bool) {
    let wanted = value.unwrap_or(0);
    let text = format!("{:0len$}", wanted.max(0));
    let fits = value.is_some_and(|value| value >= 0) && text.len() == len;
    (text[text.len() - len..].to_owned(), fits)
}
