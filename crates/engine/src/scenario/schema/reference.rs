//! The scenario reference, written from the schema.

use core::fmt::Write as _;

use serde_json::{Map, Value};

use super::examples::example;
use crate::scenario::FaultKind;

const INTRODUCTION: &str = "\
# The scenario file

A scenario is a TOML file that describes a run: robot, world, mission, faults and expectations. An
unknown key is an error that names file, line and key. `hilrig schema` prints the JSON Schema for
editors and generators. This page is the output of `hilrig schema --markdown`.

A time is a text with a number and a unit: `ns`, `us`, `ms`, `s`, `min` or `m`, or `h`. Examples: `\"90s\"`, `\"1.5 s\"`,
`\"200ms\"`; at most a week. Lengths are in metres, angles in degrees counter-clockwise; x points to the
right of a map and y up. In the column \"default\", `needed` marks a required key. The default `-` marks
an optional key without a default value.

Each example runs after two additions, unless it contains these parts itself: before it, the lines
of the first example up to `[mission]`; after it, a `[world]` with a `start`.
";

/// Tables at the top; the others follow in alphabetical order.
const ORDER: [&str; 14] = [
    "mission", "expect", "program", "chassis", "link", "device", "exec", "cable", "team", "world",
    "fault", "budget", "phases", "origin",
];

/// Limit of nested tables, larger than any real nesting.
const DEPTH_MAX: usize = 8;

/// The reference of all tables and keys, as Markdown, from the [schema](super::json_schema()).
pub fn reference(schema: &Value) -> String {
    let mut page = Page {
        schema,
        text: INTRODUCTION.to_owned(),
    };
    page.table("", "", schema, 0);
    page.text
}

struct Page<'a> {
    schema: &'a Value,
    text: String,
}

impl<'a> Page<'a> {
    /// Resolves a reference to its type; ignores `null` among the choices.
    fn resolve(&self, node: &'a Value) -> &'a Value {
        if let Some(name) = node["$ref"].as_str() {
            let name = name.rsplit('/').next().unwrap_or_default();
            return &self.schema["$defs"][name];
        }
        let choices = node["anyOf"].as_array().into_iter().flatten();
        let mut choices = choices.filter(|choice| choice["type"] != "null");
        match (choices.next(), choices.next()) {
            (Some(only), None) => self.resolve(only),
            _ => node,
        }
    }

    /// One table and the tables in it. `path` is as in a file, with NAME for any name.
    fn table(&mut self, path: &str, header: &str, node: &'a Value, depth: usize) {
        let node = self.resolve(node);
        let Some(keys) = node["properties"].as_object() else {
            self.forms(path, header, node);
            return;
        };
        match path {
            "" => self.text.push_str("\n## The file\n"),
            _ => self.line(&format!("\n## `{header}`")),
        }
        self.line("");
        self.line(&sentence(node));
        self.keys(node, keys);
        if path == "fault" {
            self.fault_kinds();
        }
        if let Some(example) = example(path) {
            let example = example.trim_end();
            self.line(&format!("\n```toml\n{example}\n```"));
        }
        if depth >= DEPTH_MAX {
            return;
        }
        let mut names: Vec<&String> = keys.keys().collect();
        let rank = |name: &str| ORDER.iter().position(|known| *known == name);
        if path.is_empty() {
            names.sort_by_key(|name| rank(name).unwrap_or(ORDER.len()));
        }
        for name in names {
            let inner = if path.is_empty() {
                name.clone()
            } else {
                format!("{path}.{name}")
            };
            self.tables_in(&inner, &keys[name], depth + 1);
        }
    }

    /// A kind of device whose settings are a value or a table; other values have no section.
    fn forms(&mut self, path: &str, header: &str, node: &'a Value) {
        let (Some(forms), Some(example)) = (node["anyOf"].as_array(), example(path)) else {
            return;
        };
        self.line(&format!("\n## `{header}`\n"));
        self.line(&sentence(node));
        for form in forms {
            let form = self.resolve(form);
            if let Some(keys) = form["properties"].as_object() {
                self.keys(form, keys);
            }
        }
        let example = example.trim_end();
        self.line(&format!("\n```toml\n{example}\n```"));
    }

    /// The tables that the value of a key consists of.
    fn tables_in(&mut self, path: &str, node: &'a Value, depth: usize) {
        let node = self.resolve(node);
        let named = &node["additionalProperties"];
        if let Some(kinds) = named["oneOf"].as_array() {
            for kind in kinds {
                let Some((name, settings)) =
                    kind["properties"].as_object().and_then(|p| p.iter().next())
                else {
                    continue;
                };
                let path = format!("{path}.NAME.{name}");
                self.table(&path, &format!("[{path}]"), settings, depth);
            }
        } else if named.is_object() {
            let path = format!("{path}.NAME");
            self.table(&path, &format!("[{path}]"), named, depth);
        } else if node["items"].is_object() {
            self.table(path, &format!("[[{path}]]"), &node["items"], depth);
        } else {
            self.table(path, &format!("[{path}]"), node, depth);
        }
    }

    /// The keys of a table, and the words of keys with fixed choices.
    fn keys(&mut self, table: &'a Value, keys: &'a Map<String, Value>) {
        if keys.is_empty() {
            return;
        }
        self.line("\n| key | type | default | range | is |\n|---|---|---|---|---|");
        let required = table["required"].as_array();
        for (name, node) in keys {
            let is_required = required.is_some_and(|all| all.iter().any(|key| key == name));
            let default = if is_required {
                "needed".to_owned()
            } else {
                self.default_of(node)
            };
            let (kind, range) = (self.type_of(node), self.range_of(node));
            let mut text = sentence(node);
            if text.is_empty() {
                text = sentence(self.resolve(node));
            }
            let row = format!("| `{name}` | {kind} | {default} | {range} | {text} |");
            self.line(&row);
        }
        let mut told: Vec<&Value> = Vec::new();
        for (name, node) in keys {
            if table["properties"]["kind"].is_object() && name == "kind" {
                continue;
            }
            let choices = &self.resolve(node)["oneOf"];
            let Some(all) = choices.as_array().filter(|_| !told.contains(&choices)) else {
                continue;
            };
            told.push(choices);
            let same = keys.iter().filter(|(_, other)| {
                let other = self.resolve(other);
                other["oneOf"] == *choices
            });
            let names: Vec<String> = same.map(|(name, _)| format!("`{name}`")).collect();
            let verb = if names.len() == 1 { "is" } else { "are each" };
            self.line(&format!("\n{} {verb} one of\n", names.join(", ")));
            for choice in all {
                self.choice(choice);
            }
        }
    }

    /// One choice for the value of a key: a word, or a table with one key.
    fn choice(&mut self, choice: &'a Value) {
        let words = choice["enum"].as_array().into_iter().flatten();
        let words: Vec<String> = words
            .chain(choice.get("const"))
            .map(Value::to_string)
            .collect();
        let told = sentence(choice);
        if !words.is_empty() {
            let words = words.join("`, `");
            let told = if told.is_empty() {
                told
            } else {
                format!(": {told}")
            };
            self.line(&format!("- `{words}`{told}"));
            return;
        }
        for (name, node) in choice["properties"].as_object().into_iter().flatten() {
            let inner = self.resolve(node)["properties"].as_object();
            let value = match inner {
                None => self.type_of(node),
                Some(keys) => {
                    let keys = keys.iter();
                    let keys = keys.map(|(key, node)| format!("`{key}` {}", sentence(node)));
                    keys.collect::<Vec<_>>().join(" ")
                }
            };
            self.line(&format!("- `{{ {name} = .. }}`: {told} {value}"));
        }
    }

    /// Effect and keys of each kind of fault.
    fn fault_kinds(&mut self) {
        self.line("\nEach kind has its own keys, in addition to the keys of its target and of its time:\n");
        self.line("| `kind` | acts on | own keys | effect |\n|---|---|---|---|");
        for kind in FaultKind::ALL {
            let code = |words: &[&str]| {
                let words = words.iter().map(|word| format!("`{word}`"));
                words.collect::<Vec<_>>().join(", ")
            };
            let links: Vec<&str> = kind.links().iter().map(|link| link.name()).collect();
            let place = match links.len() {
                0 => code(kind.place().keys()),
                _ => format!("{}: {}", code(kind.place().keys()), links.join(", ")),
            };
            let (name, own, about) = (kind.name(), code(kind.own_keys()), kind.about());
            self.line(&format!("| `{name}` | {place} | {own} | {about} |"));
        }
    }

    fn type_of(&self, node: &'a Value) -> String {
        if node["$ref"] == "#/$defs/Span" {
            return "time".to_owned();
        }
        let node = if node["anyOf"].is_array() {
            let choices = node["anyOf"].as_array().into_iter().flatten();
            let known = choices.filter(|choice| choice["type"] != "null");
            let mut kinds: Vec<String> = known.map(|node| self.type_of(node)).collect();
            kinds.dedup();
            return kinds.join(" or ");
        } else {
            self.resolve(node)
        };
        if node["oneOf"].is_array() {
            return "one of those below".to_owned();
        }
        let name = match &node["type"] {
            Value::Array(names) => names
                .iter()
                .find_map(|name| name.as_str().filter(|n| *n != "null")),
            name => name.as_str(),
        };
        match name.unwrap_or_default() {
            "array" => self.list_of(node),
            "object" => "table".to_owned(),
            "integer" => "whole number".to_owned(),
            "boolean" => "`true` or `false`".to_owned(),
            "string" if node["enum"].is_array() => {
                let words = node["enum"].as_array().into_iter().flatten();
                let words: Vec<String> = words.map(|word| format!("`{word}`")).collect();
                words.join(", ")
            }
            "string" => "text".to_owned(),
            name => name.to_owned(),
        }
    }

    fn list_of(&self, node: &'a Value) -> String {
        match (&node["items"], node["maxItems"].as_u64()) {
            (items, Some(count)) => format!("{count} times {}", self.type_of(items)),
            (items, None) => format!("list of: {}", self.type_of(items)),
        }
    }

    fn default_of(&self, node: &'a Value) -> String {
        match &node["default"] {
            Value::Null => "-".to_owned(),
            Value::Object(_) => "its keys' own".to_owned(),
            Value::Array(all) if all.is_empty() => "none".to_owned(),
            other => format!("`{other}`"),
        }
    }

    fn range_of(&self, node: &'a Value) -> String {
        let node = if node["minimum"].is_null() {
            self.resolve(node)
        } else {
            node
        };
        match (&node["minimum"], &node["maximum"]) {
            (Value::Null, Value::Null) => String::new(),
            (least, Value::Null) => format!("from {}", plain(least)),
            (Value::Null, most) => format!("up to {}", plain(most)),
            (least, most) => format!("{} to {}", plain(least), plain(most)),
        }
    }

    fn line(&mut self, text: &str) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "{text}");
    }
}

/// `2` rather than `2.0`.
fn plain(number: &Value) -> String {
    match (number.as_u64(), number.as_f64()) {
        (Some(whole), _) => whole.to_string(),
        (None, number) => number.map_or_else(String::new, |number| number.to_string()),
    }
}

/// The description on one line, fit for a table.
fn sentence(node: &Value) -> String {
    let text = node["description"].as_str().unwrap_or_default();
    text.split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
        .replace('|', "\\|")
}
