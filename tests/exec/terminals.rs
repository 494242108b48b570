//! Terminal properties of a port, in real and in virtual time: the table in `docs/pty.md` contains
//! the results of a program, row by row.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

const RIG: &str = include_str!("programs/terminal.toml");
const PROBE: &str = include_str!("programs/terminal.py");
const PAGE: &str = include_str!("../../docs/pty.md");

/// A row of the table: a query, and its result in real and in virtual time.
fn rows() -> Vec<[String; 3]> {
    let (_, table) = PAGE
        .split_once("| behaviour | real time |")
        .expect("the table");
    let rows = table
        .lines()
        .skip(2)
        .take_while(|line| line.starts_with('|'));
    let cells = |line: &str| {
        let mut cells = line.trim_matches('|').split(" | ");
        let mut cell = || {
            let cell = cells.next().unwrap_or_default().trim();
            cell.trim_matches('`').replace("\\|", "|")
        };
        [cell(), cell(), cell()]
    };
    rows.map(cells).collect()
}

fn start(folder: &Path, more: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_hilrig"))
        .current_dir(folder)
        .args([
            "run",
            "terminal.toml",
            "--exec-may-end",
            "--exec-wait",
            "60s",
        ])
        .args(["--exec-needs", "plug", "--exec", "python3 terminal.py"])
        .args(more)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary is built")
}

/// The program's results by query.
fn found(folder: &Path, out: &str, child: Child) -> BTreeMap<String, String> {
    let output = child.wait_with_output().expect("it ends");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let log = fs::read_to_string(folder.join(out).join("program.log")).unwrap_or_default();
    assert!(output.status.success(), "{out}: {said}\n{log}");
    let pairs = log.lines().filter_map(|line| line.split_once(" = "));
    pairs
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .collect()
}

#[test]
fn a_port_does_what_the_table_says_in_real_and_in_virtual_time() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let folder = folder.join(format!("terminals-{}", std::process::id()));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a fresh folder");
    fs::write(folder.join("terminal.toml"), RIG).expect("a fresh file");
    fs::write(folder.join("terminal.py"), PROBE).expect("a fresh file");
    let real = start(&folder, &["--out", "real"]);
    let virtual_ = start(&folder, &["--virtual", "--out", "virtual"]);
    let real = found(&folder, "real", real);
    let virtual_ = found(&folder, "virtual", virtual_);
    let rows = rows();
    assert!(rows.len() >= 25, "{} rows", rows.len());
    for [what, in_real, in_virtual] in &rows {
        assert_eq!(real.get(what), Some(in_real), "{what}, in real time");
        assert_eq!(
            virtual_.get(what),
            Some(in_virtual),
            "{what}, in virtual time"
        );
    }
    let keys: Vec<&String> = rows.iter().map(|[what, ..]| what).collect();
    let unsaid: Vec<&String> = real.keys().filter(|key| !keys.contains(key)).collect();
    assert!(unsaid.is_empty(), "not in the table: {unsaid:?}");
}
