//! Values that a file may write in a short form.

use core::fmt;
use core::marker::PhantomData;
use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer, StrDeserializer};
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use crate::value::Value;

/// One, or a list of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Many<T>(pub Vec<T>);

impl<T> Default for Many<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: JsonSchema> JsonSchema for Many<T> {
    fn schema_name() -> Cow<'static, str> {
        format!("Many_{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let one = generator.subschema_for::<T>();
        json_schema!({ "anyOf": [one, { "type": "array", "items": one }] })
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Many<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OneOrMany<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for OneOrMany<T> {
            type Value = Many<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a table or a list of tables")
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Many<T>, E> {
                T::deserialize(StrDeserializer::new(text)).map(|one| Many(vec![one]))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Many<T>, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map)).map(|one| Many(vec![one]))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Many<T>, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(seq)).map(Many)
            }
        }
        deserializer.deserialize_any(OneOrMany(PhantomData))
    }
}

/// Bytes: a list of numbers, or text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Marker(pub Vec<u8>);

impl JsonSchema for Marker {
    fn schema_name() -> Cow<'static, str> {
        "Bytes".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "Bytes: a list of numbers such as `[0xB5, 0x62]`, or text.",
            "anyOf": [
                { "type": "string" },
                { "type": "array", "items": { "type": "integer", "minimum": 0, "maximum": 255 } },
            ],
        })
    }
}

impl<'de> Deserialize<'de> for Marker {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Bytes;
        impl<'de> Visitor<'de> for Bytes {
            type Value = Marker;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a list of bytes such as [0xB5, 0x62], or text")
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Marker, E> {
                Ok(Marker(text.as_bytes().to_vec()))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Marker, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(seq)).map(Marker)
            }
        }
        deserializer.deserialize_any(Bytes)
    }
}

/// A plain value, or an expression as text.
#[derive(Clone, Debug, PartialEq)]
pub struct Plain(pub Value);

impl Plain {
    /// The text of an expression with this value.
    pub fn expression(&self) -> String {
        match &self.0 {
            Value::Text(text) => text.clone(),
            other => other.to_string(),
        }
    }
}

impl JsonSchema for Plain {
    fn schema_name() -> Cow<'static, str> {
        "Value".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": ["string", "number", "boolean"] })
    }
}

struct PlainVisitor;

impl Visitor<'_> for PlainVisitor {
    type Value = Plain;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, true, false or text")
    }

    fn visit_bool<E: Error>(self, yes: bool) -> Result<Plain, E> {
        Ok(Plain(Value::Bool(yes)))
    }

    fn visit_i64<E: Error>(self, int: i64) -> Result<Plain, E> {
        Ok(Plain(Value::Int(int.into())))
    }

    fn visit_u64<E: Error>(self, int: u64) -> Result<Plain, E> {
        Ok(Plain(Value::Int(int.into())))
    }

    fn visit_f64<E: Error>(self, float: f64) -> Result<Plain, E> {
        match float.is_finite() {
            true => Ok(Plain(Value::Float(float))),
            false => Err(E::custom(format!(
                "{float} is no figure, expected a finite number"
            ))),
        }
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Plain, E> {
        Ok(Plain(Value::Text(text.to_owned())))
    }
}

impl<'de> Deserialize<'de> for Plain {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(PlainVisitor)
    }
}

/// A conversion from a plain value.
pub trait FromPlain: Sized {
    /// The expected form in a file.
    const EXPECTED: &'static str;

    /// Converts `value`, if it has the expected form.
    fn from_plain(value: Value) -> Option<Self>;
}

/// A table, or a plain value as its short form.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Short<T>(pub T);

impl<T: JsonSchema> JsonSchema for Short<T> {
    fn schema_name() -> Cow<'static, str> {
        format!("Short_{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let table = generator.subschema_for::<T>();
        json_schema!({ "anyOf": [table, { "type": ["string", "number", "boolean"] }] })
    }
}

impl<'de, T: Deserialize<'de> + FromPlain> Deserialize<'de> for Short<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct PlainOrTable<T>(PhantomData<T>);
        impl<T: FromPlain> PlainOrTable<T> {
            fn of<E: Error>(self, value: Plain) -> Result<Short<T>, E> {
                let found = value.0.kind();
                let short = T::from_plain(value.0).map(Short);
                short.ok_or_else(|| {
                    E::custom(format!("invalid type: {found}, expected {}", T::EXPECTED))
                })
            }
        }
        impl<'de, T: Deserialize<'de> + FromPlain> Visitor<'de> for PlainOrTable<T> {
            type Value = Short<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(T::EXPECTED)
            }

            fn visit_bool<E: Error>(self, yes: bool) -> Result<Short<T>, E> {
                self.of(PlainVisitor.visit_bool(yes)?)
            }

            fn visit_i64<E: Error>(self, int: i64) -> Result<Short<T>, E> {
                self.of(PlainVisitor.visit_i64(int)?)
            }

            fn visit_f64<E: Error>(self, float: f64) -> Result<Short<T>, E> {
                self.of(PlainVisitor.visit_f64(float)?)
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Short<T>, E> {
                self.of(PlainVisitor.visit_str(text)?)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Short<T>, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map)).map(Short)
            }
        }
        deserializer.deserialize_any(PlainOrTable(PhantomData))
    }
}
