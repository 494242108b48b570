//! Rules about files that other files name: snapshots, scenarios, licences.

use std::collections::BTreeSet;

use crate::files::{File, all, functions, root};

/// Reason that the snapshot `file` belongs to no test; `source` is the test in its header.
fn orphan(file: &File, source: Option<&str>) -> Option<String> {
    let stem = file.path.rsplit('/').next().unwrap_or(&file.path);
    let name = stem.strip_suffix(".snap")?.rsplit("__").next()?;
    let Some(source) = source else {
        return Some(format!("{}: its test is gone", file.path));
    };
    // An explicit name, or that of the test function, numbered from the second snapshot on.
    let function = name
        .trim_end_matches(|c: char| c.is_ascii_digit())
        .trim_end_matches('-');
    let is_named = [name, function].iter().any(|name| {
        source.contains(&format!("\"{name}\""))
            || source.contains(&format!("fn {name}("))
            || source.contains(&format!("fn test_{name}("))
    });
    (!is_named).then(|| format!("{}: no snapshot of its test is called {name}", file.path))
}

fn source_of(snapshot: &File) -> Option<String> {
    let source = snapshot
        .text
        .lines()
        .find_map(|line| line.strip_prefix("source: "))?;
    std::fs::read_to_string(root().join(source)).ok()
}

#[test]
fn every_snapshot_has_its_test() {
    let snapshot = |name| File::sample(name, "");
    let test = "#[test]\nfn a_map() {}\n  assert_snapshot!(\"legs\", map);";
    assert_eq!(
        orphan(&snapshot("s/rig__maps__a_map.snap"), Some(test)),
        None
    );
    assert_eq!(
        orphan(&snapshot("s/rig__maps__a_map-2.snap"), Some(test)),
        None
    );
    assert_eq!(
        orphan(&snapshot("s/rig__maps__legs.snap"), Some(test)),
        None
    );
    assert!(orphan(&snapshot("s/rig__maps__gone.snap"), Some(test)).is_some());
    assert!(orphan(&snapshot("s/rig__maps__a_map.snap"), None).is_some());

    let snapshots = all(&[".snap", "README.md"]);
    let orphans: Vec<String> = snapshots
        .iter()
        .filter_map(|file| orphan(file, source_of(file).as_deref()))
        .collect();
    assert!(orphans.is_empty(), "\n{}", orphans.join("\n"));
}

/// A scenario that no page names is hard to find, and a name without a file misleads.
#[test]
fn the_pages_name_every_scenario_and_no_other() {
    let pages: String = all(&[".md"]).into_iter().map(|file| file.text).collect();
    let scenarios = all(&[".toml"]);
    let scenarios: Vec<&str> = scenarios
        .iter()
        .filter_map(|file| file.path.strip_prefix("scenarios/"))
        .collect();
    assert!(!scenarios.is_empty());
    for scenario in &scenarios {
        assert!(
            pages.contains(scenario),
            "no page names scenarios/{scenario}"
        );
    }
    let named = pages.split("scenarios/").skip(1).filter_map(|rest| {
        let end = rest.find(|c: char| !(c.is_alphanumeric() || "-_/.".contains(c)))?;
        rest[..end]
            .trim_end_matches('.')
            .ends_with(".toml")
            .then(|| &rest[..end])
    });
    for name in named {
        let name = name.trim_end_matches('.');
        assert!(
            scenarios.contains(&name),
            "a page names scenarios/{name}, there is none"
        );
    }
}

/// The tests of a simplification must exist.
#[test]
fn the_tests_that_the_fidelity_page_names_exist() {
    let page = all(&["FIDELITY.md"]);
    let page = &page.first().expect("the page is there").text;
    let sources = all(&[".rs", ".py"]);
    let defined: BTreeSet<&str> = sources
        .iter()
        .flat_map(|file| functions(&file.text))
        .collect();
    let rows = page
        .lines()
        .filter(|line| line.starts_with("| ") && line.contains('`'));
    let named = rows.flat_map(|row| {
        let columns = row.trim_matches([' ', '|']).rsplit_once(" | ");
        let (_, tests) = columns.unwrap_or_else(|| panic!("no test in {row}"));
        tests.split('`').skip(1).step_by(2)
    });
    let named: Vec<&str> = named.collect();
    assert!(named.len() > 40, "{named:?}");
    for name in named {
        let is_there = defined.contains(name) || defined.contains(&*format!("test_{name}"));
        assert!(is_there, "there is no {name}");
    }
}

/// A long test with a wrong name in its list would run at each landing, and one with wrong paths
/// would never run with `--since`.
#[test]
fn the_long_tests_and_their_paths_exist() {
    let list = std::fs::read_to_string(root().join("tests/long.txt")).expect("the list");
    let sources = all(&[".rs"]);
    let defined: BTreeSet<&str> = sources
        .iter()
        .flat_map(|file| functions(&file.text))
        .collect();
    let rows: Vec<_> = list
        .lines()
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .map(|line| line.split_once(' ').expect("paths and a name"))
        .collect();
    assert!(!rows.is_empty());
    for (paths, test) in rows {
        let name = test.rsplit("::").next().unwrap_or(test);
        assert!(defined.contains(name), "there is no {test}");
        for path in paths.split(',') {
            assert!(root().join(path).exists(), "{test}: there is no {path}");
        }
    }
}

/// The last column of the ledger names tests, or a file with them.
#[test]
fn the_tests_that_the_ledger_names_exist() {
    let page = std::fs::read_to_string(root().join("docs/fidelity.md")).expect("the page");
    let sources = all(&[".rs"]);
    let defined: BTreeSet<&str> = sources
        .iter()
        .flat_map(|file| functions(&file.text))
        .collect();
    let rows: Vec<_> = page
        .lines()
        .filter(|line| line.ends_with("` |"))
        .filter_map(|line| line.trim_end_matches(" |").rsplit_once(" | "))
        .collect();
    assert!(rows.len() > 20, "{}", rows.len());
    for name in rows
        .iter()
        .flat_map(|(_, tests)| tests.split('`').skip(1).step_by(2))
    {
        let is_there = defined.contains(name) || root().join(name).is_file();
        assert!(is_there, "there is no {name}");
    }
}

/// The texts of both licences in the crates' manifests exist.
#[test]
fn both_licences_are_here() {
    for (file, words) in [
        (
            "LICENSE-MIT",
            "Permission is hereby granted, free of charge",
        ),
        ("LICENSE-APACHE", "Version 2.0, January 2004"),
    ] {
        let text = std::fs::read_to_string(root().join(file)).expect(file);
        assert!(text.contains(words), "{file}");
    }
}
