//! `--json`: each command prints one object that matches its schema. Also the completions and
//! manual pages, which must contain every command.

use std::process::Stdio;

use serde_json::Value;

use super::text;
use super::verbs::{Bench, VERBS};

/// Differences between `value` and `schema`, with their position. Only the keywords of our schemas
/// are supported; any other is an error.
fn wrong(schema: &Value, value: &Value, root: &Value, place: &str) -> Vec<String> {
    let Value::Object(rules) = schema else {
        return Vec::from_iter((schema == false).then(|| format!("{place}: not allowed")));
    };
    let mut found = Vec::new();
    for (rule, with) in rules {
        let all = || with.as_array().expect("a list").iter();
        let fits = |one: &&Value| wrong(one, value, root, place).is_empty();
        let holds = match rule.as_str() {
            "$schema" | "$defs" | "title" | "description" | "format" | "minimum" | "maximum"
            | "default" => true,
            "$ref" => {
                let name = with
                    .as_str()
                    .expect("text")
                    .rsplit('/')
                    .next()
                    .expect("one");
                found.extend(wrong(&root["$defs"][name], value, root, place));
                true
            }
            "type" => match with {
                Value::String(one) => is_type(one, value),
                more => {
                    let types = more.as_array().expect("a list").iter();
                    types.flat_map(Value::as_str).any(|one| is_type(one, value))
                }
            },
            "const" => with == value,
            "enum" => all().any(|one| one == value),
            "anyOf" => all().any(|one| fits(&one)),
            "oneOf" => all().filter(fits).count() == 1,
            "required" => all().all(|key| value.get(key.as_str().expect("text")).is_some()),
            "properties" => {
                for (key, schema) in with.as_object().expect("a table") {
                    if let Some(value) = value.get(key) {
                        found.extend(wrong(schema, value, root, &format!("{place}.{key}")));
                    }
                }
                true
            }
            "additionalProperties" => {
                let known = |key: &String| rules["properties"].get(key).is_some();
                for (key, value) in value.as_object().into_iter().flatten() {
                    if rules.get("properties").is_none() || !known(key) {
                        found.extend(wrong(with, value, root, &format!("{place}.{key}")));
                    }
                }
                true
            }
            "items" => {
                for (index, value) in value.as_array().into_iter().flatten().enumerate() {
                    found.extend(wrong(with, value, root, &format!("{place}[{index}]")));
                }
                true
            }
            "prefixItems" => {
                let values = value.as_array().into_iter().flatten();
                for (index, (schema, value)) in all().zip(values).enumerate() {
                    found.extend(wrong(schema, value, root, &format!("{place}[{index}]")));
                }
                true
            }
            "minItems" => value
                .as_array()
                .is_none_or(|all| all.len() as u64 >= number(with)),
            "maxItems" => value
                .as_array()
                .is_none_or(|all| all.len() as u64 <= number(with)),
            other => panic!("{place}: the test does not know \"{other}\""),
        };
        if !holds {
            found.push(format!("{place}: {rule} {with}, not {value}"));
        }
    }
    found
}

fn number(value: &Value) -> u64 {
    value.as_u64().expect("a count")
}

fn is_type(name: &str, value: &Value) -> bool {
    match name {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "string" => value.is_string(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("no type of JSON: {other}"),
    }
}

#[test]
fn the_judge_of_this_test_finds_what_is_wrong() {
    let schema: Value = serde_json::json!({
        "type": "object",
        "properties": { "a": { "type": ["integer", "null"] }, "b": { "const": 1 } },
        "required": ["a"],
    });
    let count = |value: Value| wrong(&schema, &value, &schema, "").len();
    assert_eq!(count(serde_json::json!({ "a": 1, "b": 1 })), 0);
    assert_eq!(count(serde_json::json!({ "a": null })), 0);
    assert_eq!(count(serde_json::json!({ "a": "1" })), 1);
    assert_eq!(count(serde_json::json!({ "b": 1 })), 1);
    assert_eq!(count(serde_json::json!({ "a": 1, "b": 2 })), 1);
    assert_eq!(count(serde_json::json!([])), 2);
}

/// Each command has its own branch of the schema, so an object of another command does not match.
#[test]
fn every_command_prints_one_object_as_its_schema_says() {
    let bench = Bench::new("json");
    let schema = bench.command("schema --output").output().expect("starts");
    let schema: Value = serde_json::from_slice(&schema.stdout).expect("JSON");
    for verb in &VERBS {
        // After two dashes, the option would belong to the program.
        let line = match verb.line.split_once(" -- ") {
            Some((ours, program)) => format!("{ours} --json -- {program}"),
            None => format!("{} --json", verb.line),
        };
        let output = bench.command(&line).output().expect("starts");
        let said: Value = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|error| panic!("{line}: {error}: {output:?}"));
        assert_eq!(
            wrong(&schema, &said, &schema, ""),
            Vec::<String>::new(),
            "{line}"
        );
        assert_eq!(said["command"], verb.name);
        assert_eq!(said["exit_code"], verb.code, "{line}");
        let verdict = match verb.code {
            0 => "pass",
            1 => "fail",
            _ => "error",
        };
        assert_eq!(said["verdict"], verdict, "{line}");
        let has_result = said["result"].is_object();
        assert_eq!(has_result, verb.code < 2, "{line}: {said}");
    }
    // Other forms of these commands.
    for line in [
        "wireshark --print",
        "man",
        "bugs",
        "experiment",
        "fidelity",
        "fidelity hc06",
        "fidelity --markdown",
    ] {
        let output = bench.command(&format!("{line} --json")).output();
        let said = serde_json::from_slice(&output.expect("starts").stdout).expect("JSON");
        assert_eq!(
            wrong(&schema, &said, &schema, ""),
            Vec::<String>::new(),
            "{line}"
        );
    }
    // Errors in the arguments, and a command that does not exist.
    for (line, command) in [
        ("run --json", "run"),
        ("campaign s.toml --sedes 0..2 --json", "campaign"),
        ("--json fidelity xv11 --seed minus", "fidelity"),
        ("--json frobnicate", ""),
    ] {
        let output = bench.command(line).output().expect("starts");
        let said: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_eq!(
            wrong(&schema, &said, &schema, ""),
            Vec::<String>::new(),
            "{line}"
        );
        assert_eq!(
            (&said["command"], &said["exit_code"]),
            (&command.into(), &2.into()),
            "{line}"
        );
        assert!(
            said["error"]
                .as_str()
                .is_some_and(|error| !error.is_empty()),
            "{line}: {said}"
        );
        assert_eq!(output.status.code(), Some(2), "{line}");
    }
    // The result of another command does not match this one's schema.
    let output = bench
        .command("map diff base base --json")
        .output()
        .expect("starts");
    let mut said: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    said["command"] = "run".into();
    assert!(!wrong(&schema, &said, &schema, "").is_empty());
}

#[test]
fn an_error_is_an_object_as_well() {
    let bench = Bench::new("json-error");
    let output = bench
        .command("run nowhere.toml --json")
        .output()
        .expect("starts");
    assert_eq!(output.status.code(), Some(2));
    let said: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(said["verdict"], "error");
    assert_eq!(said["exit_code"], 2);
    assert!(said["result"].is_null());
    let error = said["error"].as_str().expect("text");
    assert!(error.contains("nowhere.toml"), "{error}");
    assert_eq!(text(&output.stderr), format!("error: {error}\n"));
    // If the object cannot be printed, that is an error.
    let full = std::fs::File::options().write(true).open("/dev/full");
    let mut command = bench.command("schema --json");
    let output = command
        .stdout(full.expect("Linux has it"))
        .stderr(Stdio::piped());
    let output = output.output().expect("starts");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).starts_with("error: cannot write to standard output"));
}

/// Both are generated from the table of commands, so all commands of this list are known.
#[test]
fn completions_and_manual_pages_know_every_command() {
    let bench = Bench::new("man");
    let man = bench.command("man o/man").output().expect("starts");
    assert_eq!(man.status.code(), Some(0));
    let pages: Vec<String> = bench.files().into_iter().map(|(name, _)| name).collect();
    let of_top = |page: &String| {
        let name = page
            .rsplit('/')
            .next()?
            .strip_suffix(".1")?
            .strip_prefix("hilrig-")?;
        (!name.contains('-')).then(|| name.to_owned())
    };
    let mut known: Vec<String> = pages.iter().filter_map(of_top).collect();
    let mut verbs: Vec<String> = VERBS.iter().map(|verb| verb.name.to_owned()).collect();
    known.sort();
    verbs.sort();
    assert_eq!(known, verbs, "tests/cli/verbs.rs has every command");
    let below = pages
        .iter()
        .any(|page| page.ends_with("/hilrig-map-diff.1"));
    assert!(below, "{pages:?}");
    for (name, page) in bench.files() {
        let page = String::from_utf8(page).expect("text");
        assert!(
            page.contains(".SH NAME") && page.contains(".SH OPTIONS"),
            "{name}"
        );
    }
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let output = bench.command(&format!("completions {shell}")).output();
        let script = output.expect("starts").stdout;
        for verb in &verbs {
            assert!(
                text(&script).contains(verb.as_str()),
                "{shell} lacks {verb}"
            );
        }
    }
}

/// Output to a pipe has no colour, whatever TERM says.
#[test]
fn a_pipe_is_not_coloured() {
    let bench = Bench::new("colour");
    let mut command = bench.command("run s.toml --out o/run");
    let output = command
        .env("TERM", "xterm-256color")
        .output()
        .expect("starts");
    assert!(text(&output.stdout).contains("PASS short"));
    assert!(!output.stdout.contains(&0x1B));
}

/// A scenario from `new` runs unchanged, and an existing file is not overwritten.
#[test]
fn a_new_scenario_runs() {
    let bench = Bench::new("new");
    for (name, option, verb) in [
        ("o/a", "", "run"),
        ("o/b", " --robot", "up"),
        ("o/c.toml", " --devices", "up"),
    ] {
        let made = bench
            .command(&format!("new {name}{option}"))
            .output()
            .expect("starts");
        assert_eq!(made.status.code(), Some(0), "{made:?}");
        let path = text(&made.stdout).trim_end().to_owned();
        let line = match verb {
            "run" => format!("run {path} --out o/run"),
            _ => format!("up {path} --dir ports --duration 100ms"),
        };
        let ran = bench.command(&line).output().expect("starts");
        assert_eq!(ran.status.code(), Some(0), "{line}: {ran:?}");
        let again = bench
            .command(&format!("new {name}{option}"))
            .output()
            .expect("starts");
        assert_eq!(again.status.code(), Some(2));
        assert!(text(&again.stderr).contains("already exists"), "{again:?}");
    }
    let wrong = bench.command("new o/two,words").output().expect("starts");
    assert_eq!(wrong.status.code(), Some(2));
    assert!(text(&wrong.stderr).contains("name: is"), "{wrong:?}");
}
