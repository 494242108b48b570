//! JSON Schema of a scenario, and the reference. The schema is derived from the types that read a
//! scenario; the reference is generated from the schema.

mod examples;
mod reference;

use schemars::generate::SchemaSettings;
use schemars::{Schema, SchemaGenerator, json_schema};
use serde_json::{Value, json};

use super::{Scenario, device};

pub use examples::{example, examples};
pub use reference::reference;

/// The JSON Schema (draft 2020-12) of a scenario, with the settings of all registered kinds of
/// devices.
pub fn json_schema() -> Value {
    let generator = SchemaSettings::draft2020_12().into_generator();
    generator.into_root_schema_for::<Scenario>().to_value()
}

/// Devices by name, each a table named like its kind.
pub(super) fn devices(generator: &mut SchemaGenerator) -> Schema {
    let kinds = device::kinds().into_iter().map(|kind| {
        json!({
            "type": "object",
            "description": format!("{}.", kind.about()),
            "properties": { kind.name(): kind.schema(generator) },
            "required": [kind.name()],
            "additionalProperties": false,
        })
    });
    let kinds: Vec<Value> = kinds.collect();
    json_schema!({
        "type": "object",
        "additionalProperties": { "oneOf": kinds },
    })
}
