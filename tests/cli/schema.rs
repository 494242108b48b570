//! The schema and the reference of scenarios are complete and correct.

use std::collections::BTreeSet;
use std::path::Path;

use hilrig::run::Run;
use hilrig::scenario::{Scenario, schema};
use serde_json::Value;

use super::{Session, text};

const PAGE: &str = include_str!("../../docs/scenario.md");

/// After a change of a key, run `hilrig schema --markdown > docs/scenario.md` and check the result.
#[test]
fn the_page_is_what_the_command_prints() {
    let output = Session::new("markdown").hilrig(&["schema", "--markdown"]);
    assert_eq!(output.status.code(), Some(0));
    let said = text(&output.stdout);
    let differing = said.lines().zip(PAGE.lines()).find(|(a, b)| a != b);
    assert_eq!(differing, None);
    assert_eq!(said, PAGE);
}

/// Names of all keys below `node`.
fn keys<'a>(node: &'a Value, found: &mut BTreeSet<&'a str>) {
    match node {
        Value::Object(map) => {
            let own = map.get("properties").and_then(Value::as_object);
            found.extend(
                own.into_iter()
                    .flat_map(|map| map.keys().map(String::as_str)),
            );
            map.values().for_each(|node| keys(node, found));
        }
        Value::Array(all) => all.iter().for_each(|node| keys(node, found)),
        _ => {}
    }
}

#[test]
fn every_key_of_the_schema_stands_on_the_page() {
    let output = Session::new("schema").hilrig(&["schema"]);
    assert_eq!(output.status.code(), Some(0));
    let schema: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let mut found = BTreeSet::new();
    keys(&schema, &mut found);
    assert!(found.len() > 100, "{found:?}");
    let is_told = |key: &str| {
        let wanted = [
            format!("`{key}`"),
            format!("{{ {key} = "),
            format!(".{key}]"),
        ];
        wanted.iter().any(|wanted| PAGE.contains(wanted.as_str()))
    };
    let missing: Vec<_> = found.into_iter().filter(|key| !is_told(key)).collect();
    assert_eq!(missing, Vec::<&str>::new());
}

/// Every key has a description.
#[test]
fn no_key_on_the_page_is_without_its_sentence() {
    let rows = PAGE.lines().filter(|line| line.starts_with("| `"));
    let mute: Vec<&str> = rows.filter(|row| row.ends_with("|  |")).collect();
    assert_eq!(mute, Vec::<&str>::new());
}

#[test]
fn every_example_of_the_page_runs() {
    let examples = schema::examples();
    assert!(examples.len() > 20);
    for (path, text) in examples {
        let shown = schema::example(&path).expect("it has one").trim_end();
        assert!(PAGE.contains(shown), "{path}");
        let name = format!("<example of {path}>");
        let (scenario, source) = Scenario::parse(Path::new(&name), text).expect(&path);
        let mut run = Run::new(scenario, &source, None).expect(&path);
        run.rig.run_for(core::time::Duration::from_millis(300));
    }
}

/// The shipped scenarios contain only keys of the schema.
#[test]
fn the_shipped_scenarios_have_known_keys_only() {
    let schema = schema::json_schema();
    let mut known = BTreeSet::new();
    keys(&schema, &mut known);
    for name in ["rescue-flat", "own-slave", "moving-obstacle", "legs"] {
        let table: toml::Table = super::shipped(name).parse().expect("TOML");
        let unknown: Vec<&String> = table
            .keys()
            .filter(|key| !known.contains(key.as_str()))
            .collect();
        assert_eq!(unknown, Vec::<&String>::new(), "{name}");
    }
}
