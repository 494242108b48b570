//! Settings of described devices: a file, a table with further keys, or a list of both.

use core::fmt;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use ::description::Description;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::ser::SerializeSeq;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::load::{LoadError, load, texts};

/// The devices of a wire.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DescriptionSpec(pub Vec<UnitSpec>);

/// One device of a wire.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UnitSpec {
    /// A description that comes with the tool, by its name; or a file that ends with `.toml`,
    /// relative to the scenario's folder.
    pub file: String,
    /// Name of the device among several on one wire; the description's if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Address on the wire; the description's if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub address: Option<u32>,
    /// The text of the description, included in saved cases; `file` is then only its name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
    /// Contents of the files that the description names, included in saved cases.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub beside: BTreeMap<String, String>,
}

impl UnitSpec {
    const fn of(file: String) -> Self {
        Self {
            file,
            name: None,
            address: None,
            text: None,
            beside: BTreeMap::new(),
        }
    }

    const fn is_plain(&self) -> bool {
        self.name.is_none() && self.address.is_none() && self.text.is_none()
    }

    /// The description of the device; the path of a file is relative to the folder `base`.
    ///
    /// # Errors
    /// If the description does not exist or is wrong.
    pub fn load(&self, base: &Path) -> Result<Arc<Description>, LoadError> {
        let Some(text) = &self.text else {
            return load(&self.file, base);
        };
        let beside = |name: &str| {
            let text = self.beside.get(name);
            text.cloned()
                .ok_or_else(|| format!("cannot read {name}: it is not among the files of the case"))
        };
        Ok(Description::parse(&self.file, text, &beside)?)
    }

    /// Includes the text of its file, so that the file is no longer needed. An unreadable or wrong
    /// file stays a reference.
    fn embed(&mut self, base: &Path) {
        if self.text.is_some() || !self.file.ends_with(".toml") {
            return;
        }
        if let Ok((text, beside)) = texts(&self.file, base) {
            (self.text, self.beside) = (Some(text), beside);
        }
    }
}

impl DescriptionSpec {
    /// Includes the text of each file relative to the folder `base`, so that a saved case runs in
    /// any folder.
    pub(in crate::scenario) fn embed(&mut self, base: &Path) {
        self.0.iter_mut().for_each(|unit| unit.embed(base));
    }
}

/// One device in the form of the file.
struct Unit(UnitSpec);

const EXPECTED: &str =
    "the name or file of a description, a table with \"file\", or a list of them";

impl<'de> Deserialize<'de> for Unit {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct One;
        impl<'de> Visitor<'de> for One {
            type Value = Unit;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(EXPECTED)
            }

            fn visit_str<E: Error>(self, file: &str) -> Result<Unit, E> {
                Ok(Unit(UnitSpec::of(file.to_owned())))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Unit, A::Error> {
                UnitSpec::deserialize(MapAccessDeserializer::new(map)).map(Unit)
            }
        }
        deserializer.deserialize_any(One)
    }
}

impl<'de> Deserialize<'de> for DescriptionSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct All;
        impl<'de> Visitor<'de> for All {
            type Value = DescriptionSpec;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(EXPECTED)
            }

            fn visit_str<E: Error>(self, file: &str) -> Result<DescriptionSpec, E> {
                Ok(DescriptionSpec(vec![UnitSpec::of(file.to_owned())]))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<DescriptionSpec, A::Error> {
                let unit = UnitSpec::deserialize(MapAccessDeserializer::new(map))?;
                Ok(DescriptionSpec(vec![unit]))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<DescriptionSpec, A::Error> {
                let mut units = Vec::new();
                while let Some(Unit(unit)) = seq.next_element()? {
                    units.push(unit);
                }
                match units.is_empty() {
                    true => Err(A::Error::custom(format!(
                        "the list is empty, expected {EXPECTED}"
                    ))),
                    false => Ok(DescriptionSpec(units)),
                }
            }
        }
        deserializer.deserialize_any(All)
    }
}

impl Serialize for DescriptionSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match &self.0[..] {
            [unit] if unit.is_plain() => serializer.serialize_str(&unit.file),
            [unit] => unit.serialize(serializer),
            units => {
                let mut seq = serializer.serialize_seq(Some(units.len()))?;
                for unit in units {
                    seq.serialize_element(unit)?;
                }
                seq.end()
            }
        }
    }
}

impl JsonSchema for DescriptionSpec {
    fn schema_name() -> Cow<'static, str> {
        "DescriptionSpec".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let table = generator.subschema_for::<UnitSpec>();
        let one = json_schema!({ "anyOf": [{ "type": "string" }, table] });
        json_schema!({
            "description": "The name of a description that comes with the tool, or a file that ends \
                with `.toml`. A table also gives an address; a list describes several devices \
                on one wire.",
            "anyOf": [{ "type": "string" }, table, { "type": "array", "items": one }],
        })
    }
}
