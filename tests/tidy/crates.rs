//! Rules about crates: their dependencies on each other, and their licences.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use serde_json::Value;

use crate::files::root;

/// Cargo's metadata of this workspace and its dependencies on this host.
fn metadata() -> Value {
    let cargo = env!("CARGO");
    let version = Command::new(cargo).arg("-vV").output().expect("cargo runs");
    let version = String::from_utf8(version.stdout).expect("cargo speaks UTF-8");
    let host = version
        .lines()
        .find_map(|line| line.strip_prefix("host: "))
        .expect("cargo names its host");
    let output = Command::new(cargo)
        .args([
            "metadata",
            "--offline",
            "--format-version=1",
            "--filter-platform",
            host,
        ])
        .current_dir(root())
        .output()
        .expect("cargo runs");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo metadata: {errors}");
    serde_json::from_slice(&output.stdout).expect("cargo writes JSON")
}

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key]
        .as_str()
        .unwrap_or_else(|| panic!("no {key} in {value}"))
}

fn list<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value[key].as_array().unwrap_or_else(|| panic!("no {key}"))
}

/// The crates of the workspace with the names of their dependencies, with or without those for
/// tests.
fn dependencies(metadata: &Value, with_tests: bool) -> BTreeMap<String, BTreeSet<String>> {
    let ours = list(metadata, "packages")
        .iter()
        .filter(|package| package["source"].is_null());
    ours.map(|package| {
        let known = list(package, "dependencies")
            .iter()
            .filter(|known| with_tests || known["kind"] != "dev")
            .map(|known| text(known, "name").to_owned());
        let name = text(package, "name");
        // A crate whose tests need a feature of the crate names itself.
        let others = known.filter(|known| known != name);
        (name.to_owned(), others.collect())
    })
    .collect()
}

/// Emulators and firmware share only the wire, and neither depends on the rig. This includes their
/// tests, where a short cut would be hard to find.
#[test]
fn crates_know_only_what_lies_below_them() {
    let crates = dependencies(&metadata(), true);
    let ours: BTreeSet<_> = crates.keys().cloned().collect();
    assert!(ours.contains("hilrig"), "{ours:?}");
    // Cargo itself rejects crates that depend on each other, so these remain.
    let lower = [
        "hilrig-protocols",
        "hilrig-emulators",
        "hilrig-firmware",
        "hilrig-description",
    ];
    for name in lower {
        let known = &crates[name];
        let below: &[&str] = match name {
            "hilrig-protocols" => &[],
            "hilrig-description" => &["hilrig-protocols", "hilrig-emulators", "hilrig-span"],
            _ => &["hilrig-protocols"],
        };
        let wrong = known
            .intersection(&ours)
            .filter(|known| !below.contains(&known.as_str()));
        assert_eq!(
            wrong.count(),
            0,
            "{name} knows {known:?}, may know {below:?}"
        );
    }
}

/// Code that runs on a board or must give the same bytes on every machine has few and harmless
/// dependencies: no runtime, no I/O, no host mathematics.
#[test]
fn the_lower_crates_depend_on_next_to_nothing() {
    let crates = dependencies(&metadata(), false);
    let allowed: [(&str, &[&str]); 3] = [
        // Messages of protocol buffers, lists with fixed capacity: neither has a heap.
        ("hilrig-protocols", &["crc", "micropb", "heapless"]),
        // Lines and letters of the display, drawn without heap, floats or a frame buffer. The
        // phone's messages, for programs that run on a PC.
        (
            "hilrig-firmware",
            &["hilrig-protocols", "libm", "embedded-graphics", "rosc"],
        ),
        (
            "hilrig-emulators",
            &["hilrig-protocols", "libm", "rand_xoshiro"],
        ),
    ];
    for (name, allowed) in allowed {
        let wrong = crates[name]
            .iter()
            .filter(|known| !allowed.contains(&known.as_str()));
        assert_eq!(wrong.collect::<Vec<_>>(), Vec::<&String>::new(), "{name}");
    }
}

/// Licences that require only their text. MPL-2.0 also requires that changes of its files are
/// published; there are no changes.
const LICENCES: [&str; 13] = [
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "ISC",
    "MIT",
    "MPL-2.0",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
];

/// Whether an SPDX expression is satisfied by the licences above. `A/B` is the old form of `A OR
/// B`.
fn is_free(expression: &str) -> bool {
    let expression = expression.replace('/', " OR ").replace(['(', ')'], " ");
    // Brackets are dropped. Because "and" binds tighter than "or", this can only add demands to an
    // alternative, or split one. So with an "and" every named licence is checked.
    let is_known = |licence: &str| LICENCES.contains(&licence.trim());
    if expression.contains(" AND ") {
        expression
            .split(" OR ")
            .flat_map(|part| part.split(" AND "))
            .all(is_known)
    } else {
        expression.split(" OR ").any(is_known)
    }
}

#[test]
fn dependencies_are_free_to_use() {
    assert!(is_free("MIT OR Apache-2.0") && is_free("MIT/Apache-2.0"));
    assert!(is_free("(MIT OR Apache-2.0) AND Unicode-3.0"));
    assert!(is_free("Apache-2.0 WITH LLVM-exception OR GPL-3.0"));
    assert!(!is_free("GPL-3.0") && !is_free("MIT AND GPL-3.0"));

    let metadata = metadata();
    let used: BTreeSet<&str> = list(&metadata["resolve"], "nodes")
        .iter()
        .map(|node| text(node, "id"))
        .collect();
    let packages = list(&metadata, "packages").iter();
    let wrong: Vec<String> = packages
        .filter(|package| used.contains(text(package, "id")))
        .filter(|package| !package["license"].as_str().is_some_and(is_free))
        .map(|package| format!("{} {}", text(package, "name"), package["license"]))
        .collect();
    assert_eq!(wrong, Vec::<String>::new());
}

fn manifest(path: &str) -> toml::Table {
    let text = std::fs::read_to_string(root().join(path)).expect("is in the repository");
    text.parse()
        .unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// A crate that both workspaces use has the same settings in both, so that it is built once in a
/// shared folder.
#[test]
fn the_crate_outside_is_built_as_the_workspace_is() {
    let [main, outside] = ["Cargo.toml", "tests/outside/Cargo.toml"].map(manifest);
    let lock = manifest("tests/outside/Cargo.lock");
    let locked: BTreeSet<_> = lock["package"]
        .as_array()
        .expect("packages")
        .iter()
        .filter_map(|package| package["name"].as_str())
        .collect();
    // The outer workspace needs its own build of the rig, which runs for a shorter time than it
    // compiles.
    let shared = |name: &str| locked.contains(name) && name != "hilrig";
    let mut expected = main["profile"]["test"]["package"].clone();
    let levels = expected.as_table_mut().expect("packages");
    levels.retain(|name, _| shared(name));
    assert!(levels.len() > 10, "{levels:?}");
    let told = &outside["profile"]["test"];
    assert_eq!(told["package"], expected);
    for setting in ["debug", "lto"] {
        assert_eq!(told[setting], main["profile"]["dev"][setting], "{setting}");
    }
}

/// The first lines of code blocks in the docs of `text` that rustdoc compiles: those without a
/// language, or with an attribute of rustdoc.
fn compiled_examples(text: &str) -> usize {
    let comments = text.lines().map(str::trim_start).filter_map(|line| {
        let rest = line
            .strip_prefix("//!")
            .or_else(|| line.strip_prefix("///"))?;
        rest.trim_start().strip_prefix("```")
    });
    let attributes = [
        "",
        "no_run",
        "should_panic",
        "compile_fail",
        "ignore",
        "rust",
    ];
    let starts = comments.step_by(2).map(|words| words.split(',').next());
    starts
        .filter(|word| word.is_some_and(|word| attributes.contains(&word.trim())))
        .count()
}

#[test]
fn examples_in_docs_are_told_from_pictures() {
    let text = "//! ```text\n//! a - b\n//! ```\n    /// ```no_run\n    /// x\n    /// ```\n";
    assert_eq!(compiled_examples(text), 1);
    assert_eq!(compiled_examples(&text.replace("no_run", "toml")), 0);
    assert_eq!(compiled_examples(&text.replace("text", "rust,no_run")), 2);
}

/// Rustdoc reads a whole crate to find its examples. Crates without one switch this off, and a new
/// example in such a crate has to switch it on.
#[test]
fn crates_with_examples_in_their_docs_compile_them() {
    let metadata = metadata();
    let ours = list(&metadata, "packages")
        .iter()
        .filter(|package| package["source"].is_null());
    let mut compiled = 0;
    for package in ours {
        let Some(library) = list(package, "targets")
            .iter()
            .find(|target| target["kind"][0] == "lib")
        else {
            continue;
        };
        let path = std::path::Path::new(text(library, "src_path"));
        let folder = path.parent().expect("a folder").strip_prefix(root());
        let folder = folder.expect("in the repository").display().to_string();
        let examples: usize = crate::files::all(&[".rs"])
            .iter()
            .filter(|file| file.path.starts_with(&format!("{folder}/")))
            .map(|file| compiled_examples(&file.text))
            .sum();
        let name = text(package, "name");
        assert_eq!(
            library["doctest"],
            examples > 0,
            "{name}: {examples} examples"
        );
        compiled += examples;
    }
    assert!(compiled > 0, "no crate has an example");
}
