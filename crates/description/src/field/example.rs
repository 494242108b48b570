//! Example values of fields, for tests, fuzzing and requests.

use super::decode::choose;
use super::{Field, Kind, Nested, Size};
use crate::number::NumberKind;
use crate::value::{Record, Value};

/// Example values of the fields, selected by `choice(n)`, which returns a number below `n`.
/// Encoding and decoding the examples gives the same values.
pub(crate) fn example(fields: &[Field], choice: &mut dyn FnMut(u64) -> u64) -> Record {
    let mut record = Record::default();
    examples(fields, choice, &mut record);
    record
}

fn examples(fields: &[Field], choice: &mut dyn FnMut(u64) -> u64, record: &mut Record) {
    for field in fields {
        if let Some(condition) = &field.condition {
            let scope = Nested {
                own: record,
                outer: &crate::expr::Nothing,
            };
            if !condition.eval(&scope).is_ok_and(|value| value.is_true()) {
                continue;
            }
        }
        if let Kind::Switch { on, cases, other } = &field.kind {
            let chosen = on.eval(&Nested {
                own: record,
                outer: &crate::expr::Nothing,
            });
            let on = chosen.unwrap_or(Value::Int(0));
            if let Some(chosen) = choose(&on, cases, other.as_deref()) {
                let chosen = chosen.to_vec();
                examples(&chosen, choice, record);
            }
            continue;
        }
        if field.counts.is_some() || field.calc.is_some() || field.name.is_empty() {
            continue;
        }
        let value = match (&field.constant, &field.repeat) {
            (Some(constant), _) => constant.clone(),
            (None, None) => one_example(field, choice, record),
            (None, Some(size)) => {
                let scope = Nested {
                    own: record,
                    outer: &crate::expr::Nothing,
                };
                let count = match size {
                    Size::Fixed(count) => *count,
                    size => match size.of(&scope, 0) {
                        Some(count) if !matches!(size, Size::Rest) => count,
                        _ => usize::try_from(choice(5)).unwrap_or(0),
                    },
                };
                Value::List(
                    (0..count)
                        .map(|_| one_example(field, choice, record))
                        .collect(),
                )
            }
        };
        record.0.push((field.name.clone(), value));
    }
}

/// Resizes `value` of a field that takes the rest: it encodes to `len` bytes now and should encode
/// to `room` bytes.
pub(crate) fn longer(
    field: &Field,
    value: &Value,
    len: usize,
    room: usize,
    choice: &mut dyn FnMut(u64) -> u64,
) -> Value {
    let sized = |now: usize| (now + room).saturating_sub(len);
    match value {
        Value::Bytes(bytes) => {
            let mut bytes = bytes.clone();
            bytes.resize_with(sized(bytes.len()), || byte(choice));
            Value::Bytes(bytes)
        }
        Value::Text(text) => {
            let letters = text.chars().chain(core::iter::repeat('x'));
            Value::Text(letters.take(sized(text.chars().count())).collect())
        }
        Value::List(list) => {
            let mut list = list.clone();
            match len < room {
                true => list.push(one_example(field, choice, &Record::default())),
                false => drop(list.pop()),
            }
            Value::List(list)
        }
        other => other.clone(),
    }
}

fn one_example(field: &Field, choice: &mut dyn FnMut(u64) -> u64, record: &Record) -> Value {
    let scope = Nested {
        own: record,
        outer: &crate::expr::Nothing,
    };
    let size = |size: &Size, choice: &mut dyn FnMut(u64) -> u64| match size {
        Size::Fixed(size) => *size,
        Size::Rest => usize::try_from(choice(9)).unwrap_or(0),
        computed => computed
            .of(&scope, 0)
            .unwrap_or_else(|| usize::try_from(choice(9)).unwrap_or(0)),
    };
    let text = |len: usize, choice: &mut dyn FnMut(u64) -> u64| {
        let letter = |_| char::from(b'a' + u8::try_from(choice(26)).unwrap_or(0));
        Value::Text((0..len).map(letter).collect())
    };
    if let Some(names) = &field.names
        && let Some(number) = names
            .keys()
            .nth(usize::try_from(choice(names.len() as u64)).unwrap_or(0))
    {
        return Value::Int(*number);
    }
    let raw = match &field.kind {
        Kind::Number(number) => {
            // Any bit pattern, except NaN and infinity: NaN is not equal to itself.
            let bits = choice(u64::MAX) >> (64 - 8 * u32::from(number.bytes));
            match number.kind {
                NumberKind::Float => {
                    let float = number.float(bits);
                    Value::Float(if float.is_finite() { float } else { 1.5 })
                }
                _ => Value::Int(number.int(bits)),
            }
        }
        Kind::Bits { bits, .. } => Value::Int((choice(u64::MAX) >> (64 - u32::from(*bits))).into()),
        Kind::Bcd { size: of, .. } => {
            let len = u32::try_from(size(of, choice).min(8)).unwrap_or(1);
            Value::Int(choice(100_u64.checked_pow(len).unwrap_or(u64::MAX)).into())
        }
        Kind::Decimal(of) => {
            let len = u32::try_from(size(of, choice).min(18)).unwrap_or(1);
            Value::Int(choice(10_u64.pow(len)).into())
        }
        Kind::Hex(of) => {
            let len = u32::try_from(size(of, choice).min(15)).unwrap_or(1);
            Value::Int(choice(16_u64.pow(len)).into())
        }
        Kind::Str(of) => {
            let len = size(of, choice);
            text(len, choice)
        }
        Kind::StrZ => {
            let len = usize::try_from(choice(9)).unwrap_or(0);
            text(len, choice)
        }
        Kind::Prefixed { is_text, .. } => {
            let len = usize::try_from(choice(9)).unwrap_or(0);
            match is_text {
                true => text(len, choice),
                false => Value::Bytes((0..len).map(|_| byte(choice)).collect()),
            }
        }
        Kind::Bytes(of) => {
            let len = size(of, choice);
            Value::Bytes((0..len).map(|_| byte(choice)).collect())
        }
        Kind::Pad(_) => Value::Bytes(Vec::new()),
        Kind::Group(fields) => return Value::Record(example(fields, choice)),
        Kind::Switch { .. } => Value::Int(0),
    };
    let value = field.scaled(raw.clone());
    match field.beyond(&value) {
        Some([least, greatest]) => within(field, least, greatest, choice),
        None => value,
    }
}

/// An example value within the limits of the field.
fn within(field: &Field, least: f64, greatest: f64, choice: &mut dyn FnMut(u64) -> u64) -> Value {
    #[expect(clippy::cast_precision_loss, reason = "at most 1000")]
    let share = choice(1_001) as f64 / 1_000.0;
    let wanted = Value::Float(least + (greatest - least) * share);
    let count = field.unscaled(wanted);
    match (&field.kind, count.as_f64()) {
        (Kind::Number(number), Some(count)) if number.kind == NumberKind::Float => {
            let bits = number.float_bits(count);
            field.scaled(Value::Float(number.float(bits)))
        }
        (_, Some(count)) => {
            let down = Value::Float(count.floor()).as_int().unwrap_or(0);
            let value = field.scaled(Value::Int(down));
            match field.beyond(&value) {
                Some(_) => field.scaled(Value::Int(down + 1)),
                None => value,
            }
        }
        _ => count,
    }
}

fn byte(choice: &mut dyn FnMut(u64) -> u64) -> u8 {
    u8::try_from(choice(256)).unwrap_or(0)
}
