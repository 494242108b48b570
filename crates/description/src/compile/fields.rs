//! `[[message]]`: fields, texts, and fields that count other fields.

use std::sync::Arc;

use super::Compiler;
use crate::expr::Expr;
use crate::field::{self, COUNT_MAX, Field, Kind, Size};
use crate::framing::Framing;
use crate::message::{Layout, Message};
use crate::number::NumberKind;
use crate::pattern::{self, Piece};
use crate::schema::message::{FieldSpec, MessageSpec};
use crate::schema::wire::SizeSpec;
use crate::value::Value;

/// Maximum depth of nested groups.
const DEPTH_MAX: usize = 8;

impl Compiler<'_> {
    /// The messages.
    pub(super) fn messages(&mut self, frames: &Arc<Vec<Framing>>) -> Vec<Message> {
        let schema = self.schema;
        let specs = schema.message.iter().enumerate();
        let messages = specs.map(|(index, spec)| self.message(index, spec, frames));
        let messages: Vec<Message> = messages.collect();
        for (index, message) in messages.iter().enumerate() {
            if messages[..index]
                .iter()
                .any(|other| other.name == message.name)
            {
                let text = format!("\"{}\" is taken, expected a name for each", message.name);
                self.wrong(format!("message[{index}].name"), text);
            }
        }
        if schema.protocol.is_some() && !messages.is_empty() {
            self.wrong(
                "message",
                "the protocol defines its own messages, leave them out",
            );
        }
        messages
    }

    fn message(&mut self, index: usize, spec: &MessageSpec, frames: &Arc<Vec<Framing>>) -> Message {
        let key = format!("message[{index}]");
        self.check_word(&format!("{key}.name"), &spec.name);
        let frame = match &spec.frame {
            None => 0,
            Some(name) => {
                let found = frames.iter().position(|frame| frame.name == *name);
                if found.is_none() {
                    let known: Vec<_> = frames.iter().map(|frame| &*frame.name).collect();
                    let known = known.join(", ");
                    let message = format!("there is no frame \"{name}\", expected one of: {known}");
                    self.wrong(format!("{key}.frame"), message);
                }
                found.unwrap_or(0)
            }
        };
        let layout = match &spec.text {
            Some(text) => {
                let pieces = pattern::pieces(text).unwrap_or_else(|message| {
                    self.wrong(format!("{key}.text"), message);
                    Vec::new()
                });
                let fields = self.text_fields(&key, &spec.fields, &pieces);
                self.check_pieces(&key, &pieces);
                Layout::Text { pieces, fields }
            }
            None => {
                if spec.fields.is_empty() {
                    self.wrong(&key, "is empty, expected \"fields\" or \"text\"");
                }
                let key = format!("{key}.fields");
                let mut fields = self.fields(&key, &spec.fields, &mut Vec::new(), 0);
                field::mark_read(&mut fields);
                Layout::Fields(fields)
            }
        };
        Message {
            name: Arc::from(&*spec.name),
            about: spec.about.clone(),
            from: spec.from,
            frame,
            frames: frames.clone(),
            has_limits: layout.has_limits(),
            layout,
        }
    }

    /// Records an error for two adjacent fields if the end of the first is ambiguous.
    fn check_pieces(&mut self, key: &str, pieces: &[Piece]) {
        for pair in pieces.windows(2) {
            if let [Piece::Hole(first), Piece::Hole(second)] = pair
                && first.fixed_width().is_none()
            {
                let message = format!(
                    "{{{}}} ends where {{{}}} begins, expected words between them or a width such \
                     as 02d",
                    first.name, second.name
                );
                self.wrong(format!("{key}.text"), message);
            }
        }
        let holes: Vec<_> = pieces
            .iter()
            .filter_map(|piece| match piece {
                Piece::Hole(hole) => Some(hole.name.clone()),
                Piece::Words(_) => None,
            })
            .collect();
        for (index, name) in holes.iter().enumerate() {
            self.check_word(&format!("{key}.text"), name);
            if holes[..index].contains(name) {
                self.wrong(
                    format!("{key}.text"),
                    format!("has {{{name}}} twice, expected once"),
                );
            }
        }
    }

    /// The declared properties of the fields of a text.
    fn text_fields(&mut self, key: &str, specs: &[FieldSpec], pieces: &[Piece]) -> Vec<Field> {
        let fields = specs.iter().enumerate().map(|(index, spec)| {
            let key = format!("{key}.fields[{index}]");
            let is_known = pieces
                .iter()
                .any(|piece| matches!(piece, Piece::Hole(hole) if hole.name == spec.name));
            if !is_known {
                let message = format!("the text has no {{{}}}", spec.name);
                self.wrong(format!("{key}.name"), message);
            }
            let kind = if spec.kind.is_empty() {
                Kind::Str(Size::Rest)
            } else {
                let message = "the text says how it is written, leave the type out";
                self.wrong(format!("{key}.type"), message);
                Kind::Str(Size::Rest)
            };
            self.common(&key, spec, kind, &[])
        });
        fields.collect()
    }

    pub(super) fn fields(
        &mut self,
        key: &str,
        specs: &[FieldSpec],
        known: &mut Vec<String>,
        depth: usize,
    ) -> Vec<Field> {
        if depth > DEPTH_MAX {
            self.wrong(
                key,
                format!("is nested too deep, expected {DEPTH_MAX} groups at most"),
            );
            return Vec::new();
        }
        let mut fields: Vec<Field> = Vec::new();
        for (index, spec) in specs.iter().enumerate() {
            let key = format!("{key}[{index}]");
            if !spec.name.is_empty() {
                self.check_word(&format!("{key}.name"), &spec.name);
                if fields.iter().any(|other| *other.name == *spec.name) {
                    let message = format!("\"{}\" is taken, expected a name for each", spec.name);
                    self.wrong(format!("{key}.name"), message);
                }
            }
            let kind = self.kind(&key, spec, known, depth);
            let field = self.common(&key, spec, kind, known);
            if spec.name.is_empty() && is_nameless(&field) {
                let message = "is missing: only constants and padding have no name";
                self.wrong(format!("{key}.name"), message);
            }
            let is_last = index + 1 == specs.len();
            if !is_last && takes_rest(&field) {
                let message = "takes all remaining bytes, expected it to be the last field";
                self.wrong(&key, message);
            }
            known.push(spec.name.clone());
            fields.push(field);
        }
        self.check_bits(key, &fields);
        link_counts(&mut fields);
        field::mark_counted(&mut fields);
        fields
    }

    /// Records an error if adjacent bit fields do not add up to whole bytes.
    fn check_bits(&mut self, key: &str, fields: &[Field]) {
        let mut bits = 0_usize;
        let mut order = None;
        for (index, field) in fields.iter().enumerate() {
            let next = match (&field.kind, &field.repeat) {
                (Kind::Bits { bits, is_low_first }, None) => {
                    Some((usize::from(*bits), *is_low_first))
                }
                (Kind::Bits { bits, is_low_first }, Some(Size::Fixed(count))) => {
                    Some((usize::from(*bits) * count, *is_low_first))
                }
                (Kind::Bits { .. }, Some(_)) => {
                    let message = "bits are repeated a fixed number of times";
                    self.wrong(format!("{key}[{index}].repeat"), message);
                    None
                }
                _ => None,
            };
            match next {
                Some((more, is_low_first)) => {
                    if order.is_some_and(|order| order != is_low_first) && !bits.is_multiple_of(8) {
                        let message = "has another bit order than the bits before it in the same \
                                       byte, expected the same order";
                        self.wrong(format!("{key}[{index}].type"), message);
                    }
                    order = Some(is_low_first);
                    bits += more;
                }
                None if !bits.is_multiple_of(8) => {
                    let message = format!(
                        "begins within a byte: {bits} bits are before it, expected a multiple of 8"
                    );
                    self.wrong(format!("{key}[{index}]"), message);
                    bits = 0;
                }
                None => (bits, order) = (0, None),
            }
        }
        if !bits.is_multiple_of(8) {
            let message = format!("ends with {bits} bits, expected a multiple of 8");
            self.wrong(key, message);
        }
    }

    fn common(&mut self, key: &str, spec: &FieldSpec, kind: Kind, known: &[String]) -> Field {
        let names = self.names(key, spec.names.as_deref());
        let scale = self.scale(key, spec.scale, spec.offset);
        self.check_limits(key, spec.limits);
        let earlier = known.to_vec();
        let constant = spec
            .value
            .as_ref()
            .map(|plain| self.constant(key, spec, &plain.0, &kind));
        let calc = spec.calc.as_ref().map(|text| {
            // `calc` may read any field of the message, and the state.
            self.expr_of_fields(&format!("{key}.calc"), text, None)
        });
        let repeat = spec
            .repeat
            .as_ref()
            .map(|size| self.size(&format!("{key}.repeat"), size, &earlier));
        let condition = spec
            .condition
            .as_ref()
            .map(|text| self.expr_of_fields(&format!("{key}.if"), text, Some(&earlier)));
        let is_container = matches!(kind, Kind::Group(_) | Kind::Switch { .. } | Kind::Pad(_));
        if calc.is_some() && is_container {
            let message = "has no effect on a group, a switch or a pad, expected it at a field \
                           in it";
            self.wrong(format!("{key}.calc"), message);
        }
        if constant.is_some() && calc.is_some() {
            self.wrong(key, "has \"value\" and \"calc\", expected one of them");
        }
        Field {
            name: Arc::from(&*spec.name),
            kind,
            constant,
            calc,
            repeat,
            condition,
            is_optional: spec.optional,
            scale,
            unit: spec.unit.clone(),
            limits: spec.limits,
            names,
            flags: spec.flags.clone(),
            about: spec.about.clone(),
            counts: None,
            is_read: false,
            is_counted: false,
        }
    }

    /// The constant value of a field, as its type decodes it.
    fn constant(&mut self, key: &str, spec: &FieldSpec, value: &Value, kind: &Kind) -> Value {
        let named = spec.names.as_ref().and_then(|names| self.enums.get(names));
        if let (Value::Text(text), Some(names)) = (value, named)
            && let Some((number, _)) = names.iter().find(|(_, name)| *name == text)
        {
            return Value::Int(*number);
        }
        let is_float = matches!(kind, Kind::Number(number) if number.kind == NumberKind::Float);
        let fits = match (kind, value) {
            (Kind::Number(number), Value::Int(int)) if !is_float && spec.scale.is_none() => {
                let [least, most] = number.range();
                (least..=most).contains(int)
            }
            (Kind::Number(_), Value::Int(_) | Value::Float(_)) => is_float || spec.scale.is_some(),
            (Kind::Bits { bits, .. }, Value::Int(int)) => (0..1_i128 << bits).contains(int),
            (Kind::Bcd { .. } | Kind::Decimal(_) | Kind::Hex(_), Value::Int(int)) => *int >= 0,
            (Kind::Str(_) | Kind::StrZ | Kind::Prefixed { is_text: true, .. }, Value::Text(_)) => {
                true
            }
            _ => false,
        };
        if !fits {
            let message = format!("is {value}, expected a value of the field's type");
            self.wrong(format!("{key}.value"), message);
        }
        match value.as_f64() {
            Some(float) if is_float || spec.scale.is_some() => Value::Float(float),
            _ => value.clone(),
        }
    }

    pub(super) fn size(&mut self, key: &str, spec: &SizeSpec, earlier: &[String]) -> Size {
        match spec {
            SizeSpec::Bytes(bytes) => {
                let size = usize::try_from(*bytes).unwrap_or(usize::MAX);
                if size > COUNT_MAX {
                    self.wrong(key, format!("is {size}, expected {COUNT_MAX} at most"));
                }
                Size::Fixed(size.min(COUNT_MAX))
            }
            SizeSpec::Expression(text) if text == "rest" => Size::Rest,
            SizeSpec::Expression(text) => {
                Size::Computed(self.expr_of_fields(key, text, Some(earlier)))
            }
        }
    }

    /// Compiles an expression over `earlier` fields, or over all fields and the state.
    pub(super) fn expr_of_fields(
        &mut self,
        key: &str,
        text: &str,
        earlier: Option<&[String]>,
    ) -> Expr {
        match earlier {
            Some(earlier) => {
                let is_known = |name: &str| {
                    let outer = name.split('.').next().unwrap_or(name);
                    earlier.iter().any(|known| known == outer)
                };
                let names = || {
                    let named = earlier.iter().filter(|name| !name.is_empty());
                    named.cloned().collect::<Vec<_>>().join(", ")
                };
                self.expr(key, text, &is_known, &names)
            }
            None => self.expr(key, text, &|_| true, &String::new),
        }
    }
}

/// Whether the value of a field without a name would be lost.
const fn is_nameless(field: &Field) -> bool {
    field.constant.is_none()
        && field.calc.is_none()
        && !matches!(field.kind, Kind::Pad(_) | Kind::Switch { .. })
}

const fn takes_rest(field: &Field) -> bool {
    let of_size = matches!(
        field.kind,
        Kind::Str(Size::Rest) | Kind::Bytes(Size::Rest) | Kind::Pad(Size::Rest)
    );
    of_size || matches!(field.repeat, Some(Size::Rest))
}

/// Links each field that holds the size or count of another field to that field.
fn link_counts(fields: &mut [Field]) {
    for index in 0..fields.len() {
        let field = &fields[index];
        let size = match &field.kind {
            Kind::Str(size) | Kind::Bytes(size) => Some(size),
            _ => None,
        };
        let counting = [size, field.repeat.as_ref()].into_iter().flatten();
        let names = counting.filter_map(|size| match size {
            Size::Computed(expr) => expr.single_name().map(str::to_owned),
            _ => None,
        });
        let names: Vec<String> = names.collect();
        let counted = field.name.clone();
        for name in names {
            let counting = fields[..index]
                .iter_mut()
                .find(|other| *other.name == *name);
            if let Some(counting) =
                counting.filter(|field| field.constant.is_none() && field.calc.is_none())
            {
                counting.counts = Some(counted.clone());
            }
        }
    }
}
