//! The docs are correct: links have targets, programs are files that other tests run, commands and
//! options exist, the first page works as described.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use protocols::avr::registers::{self, Access};

use super::cookbook::{Block, blocks, commands, run};
use super::{Session, text};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    let read = std::fs::read_to_string(root().join(path));
    read.unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// All pages, by their paths from the root.
fn pages() -> Vec<String> {
    let mut pages = Vec::new();
    for folder in ["", "docs", "python"] {
        for entry in std::fs::read_dir(root().join(folder)).expect("is there") {
            let path = entry.expect("readable").path();
            if path.extension().is_some_and(|end| end == "md") {
                let path = path.strip_prefix(root()).expect("below the root");
                pages.push(path.display().to_string());
            }
        }
    }
    pages.sort();
    assert!(pages.len() > 15, "{pages:?}");
    pages
}

/// The lines of a page outside of code blocks.
fn prose(page: &str) -> impl Iterator<Item = &str> {
    let mut inside = false;
    page.lines().filter(move |line| {
        let is_fence = line.starts_with("```");
        inside ^= is_fence;
        !inside && !is_fence
    })
}

/// Anchors of the headings, in the form of GitHub and mdBook.
fn anchors(page: &str) -> Vec<String> {
    let titles = prose(page).filter_map(|line| line.split_once("# "));
    let titles = titles.filter(|(signs, _)| signs.chars().all(|sign| sign == '#'));
    titles
        .map(|(_, title)| {
            let letters = title.to_lowercase();
            let kept = letters.chars().filter_map(|c| match c {
                ' ' => Some('-'),
                c if c.is_alphanumeric() || "-_".contains(c) => Some(c),
                _ => None,
            });
            kept.collect()
        })
        .collect()
}

/// Targets of the links of a page.
fn links(page: &str) -> Vec<String> {
    let text: String = prose(page).flat_map(|line| [line, "\n"]).collect();
    let ends = text.split("](").skip(1);
    ends.filter_map(|rest| Some(rest.split_once(')')?.0.to_owned()))
        .collect()
}

/// The error of the link `target` on the page at `path`, if there is one.
fn broken(path: &str, target: &str) -> Option<String> {
    if target.contains("://") {
        return None;
    }
    // The book contains the folder `docs` and nothing outside of it.
    if path.starts_with("docs/") && target.starts_with("../") {
        return Some(format!("{path}: {target} leads out of the book"));
    }
    let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
    let folder = Path::new(path).parent().unwrap_or(Path::new(""));
    let file: PathBuf = match file.is_empty() {
        true => path.into(),
        false => folder.join(file),
    };
    let there = root().join(&file);
    if !there.exists() {
        return Some(format!("{path}: {target} is not there"));
    }
    let is_page = file.extension().is_some_and(|end| end == "md");
    let is_known = || {
        let page = std::fs::read_to_string(&there).expect("readable");
        anchors(&page).iter().any(|one| one == anchor)
    };
    let holds = anchor.is_empty() || !is_page || is_known();
    (!holds).then(|| format!("{path}: {target} has no such heading"))
}

#[test]
fn every_link_leads_somewhere() {
    assert_eq!(anchors("# A b, c-d\n## `up` & e"), ["a-b-c-d", "up--e"]);
    assert!(broken("docs/ci.md", "nowhere.md").is_some());
    assert!(broken("docs/ci.md", "python.md#nothing").is_some());
    assert!(broken("docs/ci.md", "../README.md#start").is_some());
    assert!(broken("README.md", "docs/ci.md#a-container").is_none());
    let mut found = Vec::new();
    let mut count = 0;
    for path in pages() {
        for link in links(&read(&path)) {
            count += 1;
            found.extend(broken(&path, &link));
        }
    }
    assert!(count > 60, "{count} links");
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

#[test]
fn the_book_has_every_page_once() {
    let summary = links(&read("docs/SUMMARY.md"));
    let pages = pages().into_iter();
    let pages = pages.filter_map(|path| Some(path.strip_prefix("docs/")?.to_owned()));
    let mut pages: Vec<String> = pages.filter(|page| page != "SUMMARY.md").collect();
    let mut listed = summary.clone();
    pages.sort();
    listed.sort();
    assert_eq!(listed, pages);
}

/// Code blocks of these languages on these pages are equal to files that are run or built.
#[test]
fn programs_on_the_pages_are_the_files() {
    let files = [
        ("docs/connect.md", "toml", "docs/connect/robot.toml"),
        ("docs/connect.md", "c", "docs/connect/robot.c"),
        ("docs/connect.md", "rust", "examples/connect.rs"),
        ("docs/ci.md", "text", "docs/ci/Containerfile"),
    ];
    let several = [
        ("docs/connect.md", "python", "docs/connect/robot.py"),
        ("docs/connect.md", "python", "docs/connect/test_robot.py"),
        ("docs/python.md", "python", "docs/connect/test_robot.py"),
        ("docs/ci.md", "yaml", "docs/ci/github.yml"),
        ("docs/ci.md", "yaml", "docs/ci/gitlab.yml"),
        ("docs/ci.md", "yaml", "docs/ci/pytest-github.yml"),
        ("docs/ci.md", "yaml", "docs/ci/pytest-gitlab.yml"),
        ("docs/ci.md", "yaml", "docs/ci/pytest-woodpecker.yml"),
    ];
    for (page, language, file) in files.into_iter().chain(several) {
        let text = read(file);
        let lines: Vec<&str> = text.lines().collect();
        let of = |block: &Block| block.language == language && block.lines == lines;
        assert!(blocks(&read(page)).iter().any(of), "{page} has not {file}");
    }
    // The page has no untested block in these languages.
    let page = blocks(&read("docs/connect.md"));
    let programs = page
        .iter()
        .filter(|block| ["c", "rust", "python", "toml"].contains(&&*block.language));
    assert_eq!(programs.count(), 5);
}

/// The table of the base's registers, generated from the table that the program and the base share.
#[test]
fn the_register_map_on_the_page_is_the_code_s() {
    let page = read("docs/connect.md");
    for register in &registers::TABLE {
        let access = match register.access {
            Access::ReadOnly => "read",
            Access::ReadWrite => "read, write",
            Access::Scratch => "keeps what is written",
        };
        let (address, name, unit) = (register.address, register.name, register.unit);
        let width = format!("{:?}", register.width).to_lowercase();
        let row = format!("| {address} | `{name}` | {width} | {access} | {unit} |");
        assert!(page.contains(&row), "docs/connect.md lacks: {row}");
    }
    let rows = page.lines().filter(|line| {
        let number = line
            .strip_prefix("| ")
            .and_then(|line| line.split_once(' '));
        number.is_some_and(|(number, _)| number.parse::<u8>().is_ok())
    });
    assert_eq!(rows.count(), registers::TABLE.len());
}

/// `line` without its quoted parts: commands of other software.
fn unquoted(line: &str) -> String {
    line.split('\'').step_by(2).collect()
}

/// Commands with subcommands.
const NESTED: [&str; 5] = ["case", "campaign", "fault", "fidelity", "map"];

#[test]
fn every_command_on_a_page_has_its_options() {
    let session = Session::new("docs-options");
    let mut helps: BTreeMap<String, String> = BTreeMap::new();
    let mut count = 0;
    for path in pages() {
        let page = read(&path).replace("\\\n", " ");
        let lines = page
            .lines()
            .filter_map(|line| line.strip_prefix("$ hilrig "));
        for line in lines {
            count += 1;
            let line = unquoted(line.split(" #").next().unwrap_or(line));
            let words: Vec<&str> = line.split_whitespace().collect();
            let plain = words.iter().filter(|word| !word.starts_with('-'));
            let nested = plain.skip(1).find(|word| {
                [
                    "from", "check", "merge", "xv11", "diff", "add", "list", "end",
                ]
                .contains(word)
            });
            let mut verbs = vec![words[0]];
            verbs.extend(nested.filter(|_| NESTED.contains(&words[0])));
            let mut known = String::new();
            for depth in 1..=verbs.len() {
                let verb = verbs[..depth].join(" ");
                let help = helps.entry(verb.clone()).or_insert_with(|| {
                    let mut arguments: Vec<&str> = verb.split(' ').collect();
                    arguments.push("--help");
                    let output = session.hilrig(&arguments);
                    assert_eq!(output.status.code(), Some(0), "{path}: hilrig {verb}");
                    text(&output.stdout).to_owned()
                });
                known += help;
            }
            for word in words.iter().filter(|word| word.starts_with("--")) {
                let option = word.split('=').next().unwrap_or(word);
                assert!(known.contains(option), "{path}: hilrig {line}: no {option}");
            }
        }
    }
    assert!(count > 40, "{count} commands");
}

#[test]
fn the_first_page_does_what_it_says() {
    let session = Session::new("first-run");
    let mut count = 0;
    for block in blocks(&read("docs/first-run.md")) {
        for (command, _) in commands(&block.lines) {
            if command.starts_with("hilrig ") {
                run(&session, command);
                count += 1;
            }
        }
    }
    assert_eq!(count, 9);
    let verdict: serde_json::Value =
        serde_json::from_str(&session.read("verdict.json")).expect("JSON");
    assert_eq!(verdict["verdict"], "pass");
    for made in [
        "hilrig-out/kitchen-1/case.toml",
        "man1/hilrig-run.1",
        "hilrig.bash",
    ] {
        assert!(session.path(made).exists(), "{made}");
    }
}
