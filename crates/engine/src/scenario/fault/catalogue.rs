//! All kinds of faults as data for a form, from the same tables as the scenario.

use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};

use super::kind::TIME_KEYS;
use super::{FaultKind, FaultSpec, WhenSpec};

/// All kinds of faults with their keys, and for each key its schema.
///
/// ```text
/// {kinds: [{name, about, place: [key..], links: [kind..], keys: [key..]}],
///  time: [key..], when: [{about, keys: [key..]}],
///  keys: {KEY: {description, type, minimum, maximum, ..}}}
/// ```
pub fn catalogue() -> Value {
    let kinds = FaultKind::ALL.iter().map(|kind| {
        let links: Vec<&str> = kind.links().iter().map(|link| link.name()).collect();
        json!({
            "name": kind.name(),
            "about": kind.about(),
            "place": kind.place().keys(),
            "links": links,
            "keys": kind.own_keys(),
        })
    });
    let kinds: Vec<Value> = kinds.collect();
    let when = WhenSpec::FORMS.map(|(about, keys)| json!({"about": about, "keys": keys}));
    // A form has no fields for nested conditions. A request on the control socket can contain them.
    let time = TIME_KEYS.iter().filter(|key| !key.ends_with("_when"));
    let time: Vec<&&str> = time.collect();
    json!({"kinds": kinds, "time": time, "when": when, "keys": keys()})
}

/// The schema of each key, references followed.
fn keys() -> Map<String, Value> {
    let generator = SchemaSettings::draft2020_12().into_generator();
    let schema = generator.into_root_schema_for::<FaultSpec>().to_value();
    let properties = schema["properties"].as_object().into_iter().flatten();
    let key = |(name, node): (&String, &Value)| (name.clone(), resolved(&schema, node));
    properties.map(key).collect()
}

/// The node with its references resolved.
fn resolved(schema: &Value, node: &Value) -> Value {
    let choices = node["anyOf"].as_array().into_iter().flatten();
    let reference = choices.chain([node]).find_map(|one| one["$ref"].as_str());
    let name = reference.and_then(|path| path.rsplit('/').next());
    let Some(named) = name.map(|name| &schema["$defs"][name]) else {
        return node.clone();
    };
    let mut whole = named.clone();
    if let (Some(whole), Some(about)) = (whole.as_object_mut(), node.get("description")) {
        whole.insert("description".to_owned(), about.clone());
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A form made from the catalogue has a field for each key of each kind, with its limits.
    #[test]
    fn every_key_of_every_kind_is_described() {
        let all = catalogue();
        let kinds = all["kinds"].as_array().expect("a list");
        assert_eq!(kinds.len(), FaultKind::ALL.len());
        for kind in kinds {
            let lists = [&kind["keys"], &kind["place"], &all["time"]];
            for key in lists.into_iter().filter_map(Value::as_array).flatten() {
                let described = &all["keys"][key.as_str().expect("a name")]["description"];
                assert!(described.is_string(), "{key} of {}", kind["name"]);
            }
        }
        let inner = &all["keys"]["when"]["properties"];
        let forms = all["when"].as_array().into_iter().flatten();
        let inside: Vec<&Value> = forms
            .filter_map(|form| form["keys"].as_array())
            .flatten()
            .collect();
        assert_eq!(inside.len(), 3 + 3 + 2);
        for key in inside {
            let described = &inner[key.as_str().expect("a name")]["description"];
            assert!(described.is_string(), "{key} of when");
        }
        let rate = &all["keys"]["rate"];
        assert_eq!([&rate["minimum"], &rate["maximum"]], [0.0, 1.0]);
        assert_eq!(kinds[0]["about"], "A bit is inverted.");
    }
}
