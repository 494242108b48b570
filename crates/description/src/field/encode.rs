//! Encoding of values into bytes.

use std::borrow::Cow;

use super::decode::choose;
use super::{Field, Kind, Nested, Size};
use crate::expr::Scope;
use crate::framing::hex_text;
use crate::number::{Number, NumberKind};
use crate::value::{Record, Value, is_same};

/// The bytes of fields, and the values that did not fit.
#[derive(Debug, Default)]
pub(crate) struct Encoding {
    pub(crate) bytes: Vec<u8>,
    /// Fields whose value was changed to fit: name and value.
    pub(crate) cut: Vec<(String, Value)>,
    /// Expressions that could not be evaluated.
    pub(crate) failed: Vec<String>,
    /// Bits of an incomplete byte, the first one lowest, and their number.
    bits: u8,
    bit_count: u8,
    is_low_first: bool,
}

/// Initial capacity for the body of a usual message.
const BODY: usize = 64;

/// Encodes `fields` with the values of `scope`, behind space for `front` bytes; a field without
/// value becomes 0 or empty.
pub(crate) fn encode(fields: &[Field], front: usize, scope: &dyn Scope) -> Encoding {
    let mut encoding = Encoding {
        bytes: Vec::with_capacity(front + BODY),
        ..Encoding::default()
    };
    encoding.bytes.resize(front, 0);
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
    if let Value::Int(int) = value
        && let Some(bits) = number.exact_bits(*int)
    {
        number.put(bits, out);
        return true;
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
        let inner = Nested { own, outer };
        // Names are looked up in fewer scopes if some of them are empty.
        let outer: &dyn Scope = match own.0.is_empty() {
            true => outer,
            false => &inner,
        };
        // Values written so far that the message reads.
        let mut written = Record::default();
        for field in fields {
            let inner = Nested {
                own: &written,
                outer,
            };
            let scope: &dyn Scope = match written.0.is_empty() {
                true => outer,
                false => &inner,
            };
            if let Some(condition) = &field.condition {
                match condition.eval(scope) {
                    Ok(value) if value.is_true() => {}
                    Ok(_) => continue,
                    Err(error) => {
                        self.failed.push(format!("{}: {error}", field.name));
                        continue;
                    }
                }
            }
            if let Kind::Switch { on, cases, other } = &field.kind {
                let on = on.eval(scope).unwrap_or(Value::Int(0));
                if let Some(chosen) = choose(&on, cases, other.as_deref()) {
                    self.fields(chosen, &written, outer);
                }
                continue;
            }
            let is_named = !field.name.is_empty();
            let known = || scope.find(&field.name).filter(|_| is_named);
            if field.is_optional && field.constant.is_none() && known().is_none() {
                return;
            }
            let value = self.value_of(field, fields, scope);
            match &field.repeat {
                None => self.value(field, &value, scope),
                Some(size) => {
                    let is_known = known().is_some();
                    let list = match &*value {
                        Value::List(list) => list.clone(),
                        Value::Bytes(bytes) => {
                            bytes.iter().map(|&byte| Value::Int(byte.into())).collect()
                        }
                        // A single value is repeated for each element.
                        one => {
                            let has_value =
                                is_known || field.calc.is_some() || field.constant.is_some();
                            let count = match size {
                                Size::Rest => usize::from(has_value),
                                size => size.of(scope, 0).unwrap_or(1),
                            };
                            vec![one.clone(); count]
                        }
                    };
                    let count = match size {
                        Size::Rest => list.len(),
                        size => size.of(scope, 0).unwrap_or(list.len()),
                    };
                    if count != list.len() && is_known {
                        self.cut
                            .push((field.name.to_string(), Value::List(list.clone())));
                    }
                    let nothing = Value::Int(0);
                    for index in 0..count {
                        self.value(field, list.get(index).unwrap_or(&nothing), scope);
                    }
                }
            }
            if is_named && field.is_read {
                let value = value.into_owned();
                written.set_shared(&field.name, value);
            }
        }
    }

    /// The value that `field` encodes with the values of `scope`.
    fn value_of<'a>(
        &mut self,
        field: &'a Field,
        fields: &'a [Field],
        scope: &'a dyn Scope,
    ) -> Cow<'a, Value> {
        if let Some(constant) = &field.constant {
            return Cow::Borrowed(constant);
        }
        if let Some(calc) = &field.calc {
            return Cow::Owned(calc.eval(scope).unwrap_or_else(|error| {
                self.failed.push(format!("{}: {error}", field.name));
                Value::Int(0)
            }));
        }
        if let Some(counted) = &field.counts
            && let Some(of) = fields.iter().find(|other| is_same(&other.name, counted))
        {
            let value = self.value_of(of, fields, scope);
            let len = i128::try_from(length_of(&value)).unwrap_or(0);
            return Cow::Owned(Value::Int(len));
        }
        let known = match field.name.is_empty() {
            true => None,
            false => scope.find(&field.name),
        };
        match known {
            None => Cow::Owned(Value::Int(0)),
            Some(value) if field.names.is_some() => Cow::Owned(field.unnamed(value.into_owned())),
            Some(value) => value,
        }
    }

    fn value(&mut self, field: &Field, value: &Value, scope: &dyn Scope) {
        let raw = &*field.count_of(value);
        if let Kind::Bits { bits, is_low_first } = &field.kind {
            return self.put_bits(field, raw, *bits, *is_low_first);
        }
        self.flush();
        let is_given = !matches!(value, Value::Int(0));
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
                    _ if field.is_counted => length_of(value),
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
        self.is_low_first = is_low_first;
        let bits = match raw {
            Value::Int(int) => u64::try_from(*int).ok(),
            _ => None,
        };
        let bits = bits.filter(|bits| bits.checked_shr(count.into()).unwrap_or(0) == 0);
        // Most values fit.
        let bits = bits.unwrap_or_else(|| {
            let wanted = raw.as_int().unwrap_or(0);
            let most = (1_i128 << count) - 1;
            let int = wanted.clamp(0, most);
            if int != wanted {
                self.cut.push((field.name.to_string(), raw.clone()));
            }
            u64::try_from(int).unwrap_or(0)
        });
        let mut place = 0;
        while place < count {
            let len = (count - place).min(8 - self.bit_count);
            let next = match is_low_first {
                true => low_bits(bits >> place, len),
                false => low_bits(bits >> (count - place - len), len).reverse_bits() >> (8 - len),
            };
            self.bits |= next << self.bit_count;
            self.bit_count += len;
            place += len;
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
        self.bit_count = 0;
        let bits = core::mem::take(&mut self.bits);
        self.bytes.push(match self.is_low_first {
            true => bits,
            false => bits.reverse_bits(),
        });
    }
}

/// The content of a field that counts `value`.
fn length_of(value: &Value) -> usize {
    match value {
        Value::List(list) => list.len(),
        Value::Bytes(bytes) => bytes.len(),
        Value::Text(text) => text.chars().count(),
        _ => 0,
    }
}

/// The low `len` bits, 1 to 8.
fn low_bits(bits: u64, len: u8) -> u8 {
    bits.to_le_bytes()[0] & (0xFF >> (8 - len))
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
