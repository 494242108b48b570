//! Fields: from bytes to values and back.

mod decode;
mod encode;
mod example;

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::expr::{Expr, Scope};
use crate::number::{Number, NumberKind};
use crate::value::{Record, Value};

pub(crate) use decode::{TextEnd, TextPlace, decode, number_value, places, texts};
pub(crate) use encode::{encode, number_bytes, put_number};
pub(crate) use example::{example, longer};

/// Names of values.
pub(crate) type Names = Arc<BTreeMap<i128, String>>;

/// A compiled field.
#[derive(Clone, Debug)]
pub(crate) struct Field {
    pub(crate) name: Arc<str>,
    pub(crate) kind: Kind,
    pub(crate) constant: Option<Value>,
    pub(crate) calc: Option<Expr>,
    pub(crate) repeat: Option<Size>,
    pub(crate) condition: Option<Expr>,
    pub(crate) is_optional: bool,
    /// Value of one count, and value of count 0.
    pub(crate) scale: Option<[f64; 2]>,
    pub(crate) unit: String,
    pub(crate) limits: Option<[f64; 2]>,
    pub(crate) names: Option<Names>,
    pub(crate) flags: Vec<String>,
    pub(crate) about: String,
    /// The field whose size or count this field holds, if its value is not given.
    pub(crate) counts: Option<Arc<str>>,
    /// Whether the message reads the value of this field, or has another field of this name.
    pub(crate) is_read: bool,
    /// Whether an earlier field counts this one and is its size: any length of a value then fits.
    pub(crate) is_counted: bool,
}

/// The encoding of a field.
#[derive(Clone, Debug)]
pub(crate) enum Kind {
    Number(Number),
    /// Bits, highest or lowest first.
    Bits {
        bits: u8,
        is_low_first: bool,
    },
    /// Two decimal digits per byte, highest or lowest byte first.
    Bcd {
        size: Size,
        is_low_first: bool,
    },
    /// Decimal digits as text, with a sign if the width allows.
    Decimal(Size),
    /// Hexadecimal digits as text.
    Hex(Size),
    Str(Size),
    StrZ,
    Bytes(Size),
    /// Text or bytes with a length prefix.
    Prefixed {
        prefix: Number,
        is_text: bool,
    },
    Pad(Size),
    Group(Vec<Field>),
    Switch {
        on: Expr,
        cases: Vec<(Value, Vec<Field>)>,
        other: Option<Vec<Field>>,
    },
}

/// A number of bytes or elements.
#[derive(Clone, Debug)]
pub(crate) enum Size {
    Fixed(usize),
    Computed(Expr),
    Rest,
}

/// Maximum number of elements, whatever number the bytes contain.
pub(crate) const COUNT_MAX: usize = 4_096;

impl Size {
    /// The expression that computes it.
    pub(crate) const fn expr(&self) -> Option<&Expr> {
        match self {
            Self::Computed(expr) => Some(expr),
            Self::Fixed(_) | Self::Rest => None,
        }
    }

    /// Evaluates the number; `left` is the number of remaining bytes.
    fn of(&self, scope: &dyn Scope, left: usize) -> Option<usize> {
        match self {
            Self::Fixed(size) => Some(*size),
            Self::Rest => Some(left),
            Self::Computed(expr) => {
                let size = usize::try_from(expr.int(scope)?).ok()?;
                (size <= COUNT_MAX).then_some(size)
            }
        }
    }
}

/// Values of a group, then those of the enclosing group.
struct Nested<'a> {
    own: &'a Record,
    outer: &'a dyn Scope,
}

impl Scope for Nested<'_> {
    fn value(&self, name: &str) -> Option<Value> {
        let own = self.own.get(name).cloned();
        own.or_else(|| self.outer.value(name))
    }

    fn find(&self, name: &str) -> Option<Cow<'_, Value>> {
        match self.own.get(name) {
            Some(value) => Some(Cow::Borrowed(value)),
            None => self.outer.find(name),
        }
    }

    fn registers(&self, address: i128, count: i128) -> Option<Vec<u8>> {
        self.outer.registers(address, count)
    }
}

impl Field {
    /// Whether the field takes all remaining bytes.
    pub(crate) const fn takes_rest(&self) -> bool {
        matches!(self.repeat, Some(Size::Rest))
            || matches!(self.kind, Kind::Str(Size::Rest) | Kind::Bytes(Size::Rest))
    }

    /// Converts a count to a value.
    pub(crate) fn scaled(&self, value: Value) -> Value {
        match self.scale.and_then(|scale| Some((scale, value.as_f64()?))) {
            Some(([scale, offset], count)) => Value::Float(count * scale + offset),
            None => value,
        }
    }

    /// Like [`unscaled`](Self::unscaled), without a copy of the value.
    pub(crate) fn count_of<'a>(&self, value: &'a Value) -> Cow<'a, Value> {
        match self.scale {
            None => Cow::Borrowed(value),
            Some(_) => Cow::Owned(self.unscaled(value.clone())),
        }
    }

    /// Whether a value may have a fraction.
    pub(crate) fn takes_fractions(&self) -> bool {
        let is_float =
            matches!(&self.kind, Kind::Number(number) if number.kind == NumberKind::Float);
        is_float || self.scale.is_some()
    }

    /// Converts a value to a count.
    pub(crate) fn unscaled(&self, value: Value) -> Value {
        match self.scale.and_then(|scale| Some((scale, value.as_f64()?))) {
            Some(([scale, offset], value)) => Value::Float((value - offset) / scale),
            None => value,
        }
    }

    /// Converts a name to its number; returns other values unchanged.
    pub(crate) fn unnamed(&self, value: Value) -> Value {
        if let (Value::Text(text), Some(names)) = (&value, &self.names)
            && let Some((number, _)) = names.iter().find(|(_, name)| *name == text)
        {
            return Value::Int(*number);
        }
        value
    }

    /// The limits, if `value` is beyond them.
    pub(crate) fn beyond(&self, value: &Value) -> Option<[f64; 2]> {
        let limits = self.limits?;
        let [least, greatest] = limits;
        let number = value.as_f64()?;
        (!(least..=greatest).contains(&number)).then_some(limits)
    }

    /// A value in words, with its unit or name.
    pub(crate) fn words(&self, value: &Value) -> String {
        if let Value::List(list) = value {
            let all: Vec<_> = list.iter().map(|value| self.words(value)).collect();
            return format!("[{}]", all.join(", "));
        }
        if let (Value::Record(record), Kind::Group(fields)) = (value, &self.kind) {
            return format!("{{{}}}", words_of(fields, record));
        }
        if let (Some(names), Some(int)) = (&self.names, value.as_int())
            && let Some(name) = names.get(&int)
        {
            return name.clone();
        }
        if !self.flags.is_empty()
            && let Some(bits) = value.as_int()
        {
            let set = self.flags.iter().enumerate();
            let set = set.filter(|(bit, name)| bits >> bit & 1 == 1 && !name.is_empty());
            let set: Vec<_> = set.map(|(_, name)| name.as_str()).collect();
            let known = self
                .flags
                .iter()
                .enumerate()
                .filter(|(_, name)| !name.is_empty());
            let known = known.fold(0_i128, |all, (bit, _)| all | 1 << bit);
            let rest = bits & !known;
            let rest = if rest == 0 {
                String::new()
            } else {
                format!(" +{rest:#x}")
            };
            return match set.is_empty() {
                true if rest.is_empty() => "none".to_owned(),
                _ => format!("{}{rest}", set.join("|")),
            };
        }
        match self.unit.as_str() {
            "" => value.to_string(),
            unit => format!("{value} {unit}"),
        }
    }
}

/// Marks the fields whose size is their own length: `count`, then bytes with `size = "count"`.
pub(crate) fn mark_counted(fields: &mut [Field]) {
    for index in 0..fields.len() {
        let (before, field) = (&fields[..index], &fields[index]);
        let (Kind::Str(Size::Computed(size)) | Kind::Bytes(Size::Computed(size))) = &field.kind
        else {
            continue;
        };
        let is_counted = before.iter().any(|count| {
            let is_free = count.constant.is_none() && count.calc.is_none();
            let is_sure = count.condition.is_none() && count.repeat.is_none();
            let is_size = Some(&*count.name) == size.single_name();
            is_free && is_sure && is_size && count.counts.as_ref() == Some(&field.name)
        });
        fields[index].is_counted = is_counted && fields[index].repeat.is_none();
    }
}

/// Marks the fields of a message whose value another field needs.
pub(crate) fn mark_read(fields: &mut [Field]) {
    let mut names = Named::default();
    names.collect(fields);
    let Named { all, read } = names;
    let is_twice = |name: &str| all.iter().filter(|other| *other == name).count() > 1;
    each(fields, &mut |field| {
        field.is_read = read.contains(&*field.name) || is_twice(&field.name);
    });
}

/// The names in the fields of a message.
#[derive(Default)]
struct Named {
    all: Vec<String>,
    read: BTreeSet<String>,
}

impl Named {
    fn collect(&mut self, fields: &[Field]) {
        for field in fields {
            // A field that is counted stands behind the one that counts it.
            self.all.push(field.name.to_string());
            let on = match &field.kind {
                Kind::Switch { on, .. } => Some(on),
                _ => None,
            };
            let size = match &field.kind {
                Kind::Bcd { size, .. }
                | Kind::Decimal(size)
                | Kind::Hex(size)
                | Kind::Str(size)
                | Kind::Bytes(size)
                | Kind::Pad(size) => size.expr().filter(|_| !field.is_counted),
                _ => None,
            };
            let repeat = field.repeat.as_ref().and_then(Size::expr);
            let exprs = [
                on,
                size,
                repeat,
                field.condition.as_ref(),
                field.calc.as_ref(),
            ];
            for name in exprs.into_iter().flatten().flat_map(Expr::names) {
                let outer = name.split('.').next().unwrap_or(name);
                self.read.insert(outer.to_owned());
            }
            match &field.kind {
                Kind::Group(fields) => self.collect(fields),
                Kind::Switch { cases, other, .. } => {
                    cases.iter().for_each(|(_, fields)| self.collect(fields));
                    other.iter().for_each(|fields| self.collect(fields));
                }
                _ => {}
            }
        }
    }
}

/// Calls `act` for each field, also for those in groups and in the cases of a switch.
fn each(fields: &mut [Field], act: &mut dyn FnMut(&mut Field)) {
    for field in fields {
        act(field);
        match &mut field.kind {
            Kind::Group(fields) => each(fields, act),
            Kind::Switch { cases, other, .. } => {
                cases.iter_mut().for_each(|(_, fields)| each(fields, act));
                other.iter_mut().for_each(|fields| each(fields, act));
            }
            _ => {}
        }
    }
}

/// Values in words, with their field names.
pub(crate) fn words_of(fields: &[Field], record: &Record) -> String {
    let mut words = Vec::new();
    for (name, value) in &record.0 {
        if name.is_empty() {
            continue;
        }
        let field = find(fields, name);
        let said = field.map_or_else(|| value.to_string(), |field| field.words(value));
        words.push(format!("{name} {said}"));
    }
    words.join(", ")
}

/// The field called `name`; the cases of a switch are searched too.
pub(crate) fn find<'a>(fields: &'a [Field], name: &str) -> Option<&'a Field> {
    fields.iter().find_map(|field| match &field.kind {
        Kind::Switch { cases, other, .. } => {
            let cases = cases.iter().map(|(_, fields)| fields).chain(other);
            cases.into_iter().find_map(|fields| find(fields, name))
        }
        _ if &*field.name == name => Some(field),
        _ => None,
    })
}
