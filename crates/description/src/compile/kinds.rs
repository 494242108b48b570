//! The types of fields.

use super::{Compiler, whole};
use crate::expr::Expr;
use crate::field::{Kind, Size};
use crate::number::{Number, NumberKind, Orders};
use crate::schema::message::FieldSpec;
use crate::schema::wire::Endian;
use crate::value::Value;

/// Types other than numbers, for error messages.
const TYPES: &str = "u8, u16, u24, u32, u64, i8 .. i64, f32, f64, b1 .. b64, bcd, bcdle, decimal, hex, \
    str, strz, bytes, pad, group, switch";

impl Compiler<'_> {
    pub(super) fn kind(
        &mut self,
        key: &str,
        spec: &FieldSpec,
        known: &mut Vec<String>,
        depth: usize,
    ) -> Kind {
        let orders = Orders {
            endian: spec.endian.or(self.schema.endian),
            words: spec.words,
        };
        if let Some(number) = Number::named(&spec.kind, orders) {
            return Kind::Number(number.unwrap_or_else(|message| {
                self.wrong(format!("{key}.type"), message);
                Number {
                    bytes: 1,
                    kind: NumberKind::Unsigned,
                    endian: Endian::Big,
                    words: Endian::Big,
                }
            }));
        }
        if let Some(bits) = bits(&spec.kind) {
            let (bits, is_low_first) = bits;
            if !(1..=64).contains(&bits) {
                self.wrong(
                    format!("{key}.type"),
                    format!("\"{}\": expected b1 to b64", spec.kind),
                );
            }
            return Kind::Bits {
                bits: bits.clamp(1, 64),
                is_low_first,
            };
        }
        let earlier = known.clone();
        if matches!(spec.kind.as_str(), "str" | "bytes")
            && let Some(prefix) = &spec.prefix
        {
            let is_text = spec.kind == "str";
            let prefix = match Number::named(prefix, orders) {
                Some(Ok(number)) if number.kind == NumberKind::Unsigned => number,
                _ => {
                    let message = format!("is \"{prefix}\", expected u8, u16le or u16be");
                    self.wrong(format!("{key}.prefix"), message);
                    Number {
                        bytes: 1,
                        kind: NumberKind::Unsigned,
                        endian: Endian::Big,
                        words: Endian::Big,
                    }
                }
            };
            return Kind::Prefixed { prefix, is_text };
        }
        let size = |compiler: &mut Self| match &spec.size {
            Some(size) => compiler.size(&format!("{key}.size"), size, &earlier),
            None => {
                let message = format!("is missing: \"{}\" has no fixed size", spec.kind);
                compiler.wrong(format!("{key}.size"), message);
                Size::Fixed(1)
            }
        };
        match spec.kind.as_str() {
            "bcd" | "bcdle" => Kind::Bcd {
                size: size(self),
                is_low_first: spec.kind == "bcdle",
            },
            "decimal" => Kind::Decimal(size(self)),
            "hex" => Kind::Hex(size(self)),
            "str" => Kind::Str(size(self)),
            "strz" => Kind::StrZ,
            "bytes" => Kind::Bytes(size(self)),
            "pad" => Kind::Pad(size(self)),
            "group" => {
                if spec.fields.is_empty() {
                    self.wrong(
                        format!("{key}.fields"),
                        "is empty, expected fields of the group",
                    );
                }
                let fields = self.fields(&format!("{key}.fields"), &spec.fields, known, depth + 1);
                known.truncate(earlier.len());
                Kind::Group(fields)
            }
            "switch" => self.switch(key, spec, known, depth),
            "" => {
                self.wrong(key, format!("has no \"type\", expected one of {TYPES}"));
                Kind::Pad(Size::Fixed(1))
            }
            other => {
                let message = format!("there is no type \"{other}\", expected one of {TYPES}");
                self.wrong(format!("{key}.type"), message);
                Kind::Pad(Size::Fixed(1))
            }
        }
    }

    fn switch(
        &mut self,
        key: &str,
        spec: &FieldSpec,
        known: &mut Vec<String>,
        depth: usize,
    ) -> Kind {
        let earlier = known.clone();
        let on = match &spec.on {
            Some(text) => self.expr_of_fields(&format!("{key}.on"), text, Some(&earlier)),
            None => {
                self.wrong(
                    key,
                    "has no \"on\", expected an expression that chooses the case",
                );
                Expr::constant(Value::Int(0))
            }
        };
        if spec.cases.is_empty() {
            self.wrong(
                format!("{key}.cases"),
                "is empty, expected fields by the value of \"on\"",
            );
        }
        let (mut cases, mut other) = (Vec::new(), None);
        for (value, fields) in &spec.cases {
            let fields = self.fields(&format!("{key}.cases.{value}"), fields, known, depth + 1);
            known.truncate(earlier.len());
            match (value.as_str(), whole(value)) {
                ("_", _) => other = Some(fields),
                (_, Some(int)) => cases.push((Value::Int(int), fields)),
                (text, None) => cases.push((self.member(text), fields)),
            }
        }
        Kind::Switch { on, cases, other }
    }

    /// The value of `enum::member`, or the text itself.
    fn member(&self, text: &str) -> Value {
        let found = text.split_once("::").and_then(|(of, member)| {
            let names = self.enums.get(of)?;
            names
                .iter()
                .find(|(_, name)| *name == member)
                .map(|(number, _)| *number)
        });
        found.map_or_else(|| Value::Text(text.to_owned()), Value::Int)
    }
}

/// Bits of the type `bN`, `bNle` or `bNbe`.
fn bits(name: &str) -> Option<(u8, bool)> {
    let digits = name.strip_prefix('b')?;
    let (digits, is_low_first) = match digits.strip_suffix("le") {
        Some(digits) => (digits, true),
        None => (digits.strip_suffix("be").unwrap_or(digits), false),
    };
    digits.parse().ok().map(|bits| (bits, is_low_first))
}
