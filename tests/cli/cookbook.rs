//! Every recipe of the cookbook gives the output on the page.

use std::path::Path;
use std::process::Command;

use super::Session;

/// A block of the page: its language and its lines.
pub(crate) struct Block {
    pub(crate) language: String,
    pub(crate) lines: Vec<String>,
}

pub(crate) fn blocks(page: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut inside = false;
    for line in page.lines() {
        match (line.strip_prefix("```"), inside) {
            (Some(language), false) => {
                let language = language.to_owned();
                let lines = Vec::new();
                blocks.push(Block { language, lines });
                inside = true;
            }
            (Some(_), true) => inside = false,
            (None, true) => {
                let block = blocks.last_mut().expect("inside of one");
                block.lines.push(line.to_owned());
            }
            (None, false) => {}
        }
    }
    blocks
}

/// A command and its output on the page.
pub(crate) fn commands(lines: &[String]) -> Vec<(&str, Vec<&str>)> {
    let mut found: Vec<(&str, Vec<&str>)> = Vec::new();
    for line in lines {
        match line.strip_prefix("$ ") {
            Some(command) => found.push((command, Vec::new())),
            None => found.last_mut().expect("a command first").1.push(line),
        }
    }
    found
}

/// Whether `line` matches the page, where `...` stands for any text. The page may omit the
/// beginning and the end of a line only with dots.
fn is_shown(shown: &str, line: &str) -> bool {
    let mut rest = line.trim();
    let mut pieces = shown.trim().split("...").map(str::trim);
    let first = pieces.next().unwrap_or_default();
    let Some(behind) = rest.strip_prefix(first) else {
        return false;
    };
    rest = behind;
    let mut last = first;
    for piece in pieces {
        let Some(at) = rest.find(piece) else {
            return false;
        };
        rest = &rest[at + piece.len()..];
        last = piece;
    }
    rest.is_empty() || last.is_empty()
}

#[test]
fn dots_stand_for_anything() {
    assert!(is_shown(
        "  FAIL memory-intact ...",
        "  FAIL memory-intact 3 writes"
    ));
    assert!(is_shown("...of bus...", "5 bytes of bus, 5 of them"));
    assert!(is_shown("1", "1"));
    assert!(!is_shown("1", "12"));
    assert!(!is_shown("no divergence...", "divergence"));
}

/// Runs commands in a shell that finds `hilrig`; returns both output streams.
pub(crate) fn run(session: &Session, command: &str) -> String {
    let tool = Path::new(env!("CARGO_BIN_EXE_hilrig"));
    let folder = tool.parent().expect("a file in a folder").display();
    let path = std::env::var("PATH").unwrap_or_default();
    // With "; echo $?" the page shows the exit code; without it the exit code is 0.
    let (shows_code, line) = match command.strip_suffix("; echo $?") {
        Some(_) => (true, command),
        None => (false, command),
    };
    let mut shell = Command::new("sh");
    shell.args(["-c", line]).current_dir(&session.folder);
    shell.env("PATH", format!("{folder}:{path}"));
    let output = shell.output().expect("a shell");
    let said = [output.stdout, output.stderr].map(|s| String::from_utf8_lossy(&s).into_owned());
    assert!(
        shows_code || output.status.success(),
        "{command}: {:?}\n{}",
        output.status,
        said.concat()
    );
    said.join("\n")
}

#[test]
fn every_recipe_does_what_the_page_says() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/cookbook.md");
    let page = std::fs::read_to_string(page).expect("the page is there");
    let session = Session::new("cookbook");
    let mut recipes = 0;
    for block in blocks(&page) {
        if block.language == "toml" {
            let name = block.lines[0].strip_prefix("# ").expect("a file's name");
            session.write(name, &format!("\n{}\n", block.lines.join("\n")));
            continue;
        }
        // A session with the reader's own programs.
        if block.language == "text" {
            continue;
        }
        assert_eq!(block.language, "console");
        recipes += 1;
        for (command, shown) in commands(&block.lines) {
            let said = run(&session, command);
            for line in shown {
                assert!(
                    said.lines().any(|told| is_shown(line, told)),
                    "{command}: the page has \"{line}\", but it says\n{said}"
                );
            }
        }
    }
    assert!((10..=20).contains(&recipes), "{recipes} recipes");
}
