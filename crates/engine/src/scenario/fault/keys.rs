//! The keys of each kind of fault, as JSON Schema.

use schemars::Schema;
use serde_json::{Value, json};

use super::FaultKind;
use super::kind::TIME_KEYS;

/// Adds the allowed keys of each kind to the schema of a fault.
pub(super) fn add_to_schema(schema: &mut Schema) {
    let rules = FaultKind::ALL.iter().map(|kind| {
        let place = kind.place().keys().iter();
        let keys = place.chain(kind.own_keys()).chain(&TIME_KEYS);
        let keys: Vec<&str> = ["kind"].into_iter().chain(keys.copied()).collect();
        json!({
            "if": { "properties": { "kind": { "const": kind.name() } } },
            "then": { "required": kind.place().keys(), "propertyNames": { "enum": keys } },
        })
    });
    let rules: Vec<Value> = rules.collect();
    schema.insert("allOf".to_owned(), rules.into());
}
