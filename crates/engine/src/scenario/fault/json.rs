//! A fault as JSON, with the errors of a scenario file.

use std::path::PathBuf;

use serde::Deserialize as _;
use serde_json::{Map, Value};

use super::FaultSpec;
use crate::scenario::{Document, ScenarioError, Source, read_whole};

impl FaultSpec {
    /// Reads the keys of a fault.
    ///
    /// # Errors
    /// Each wrong key, and what a scenario file says of it.
    pub fn of_json(keys: &Map<String, Value>) -> Result<Self, Vec<(String, String)>> {
        let mut table = toml::Table::new();
        for (key, value) in keys {
            match toml::Value::try_from(value) {
                Ok(value) => table.insert(key.clone(), value),
                Err(_) => return Err(vec![(key.clone(), "is null, expected a value".to_owned())]),
            };
        }
        let source = Source {
            path: PathBuf::new(),
            text: table.to_string(),
        };
        let read =
            |document: Document<'_>| Self::deserialize(toml::de::Deserializer::from(document));
        read_whole(&source, read).map_err(flaws)
    }
}

/// Keys and messages of an error.
fn flaws(error: ScenarioError) -> Vec<(String, String)> {
    match error {
        ScenarioError::Several(all) => all.into_iter().flat_map(flaws).collect(),
        ScenarioError::Invalid { key, message, .. } => vec![(key, message)],
        other => vec![("fault".to_owned(), other.to_string())],
    }
}
