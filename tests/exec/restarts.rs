//! `hilrig fuzz --exec --virtual`: a program that is put back to its first wait for each case, and
//! programs that have to be started.

use std::fs;
use std::process::Command;

use crate::guest::compiled;
use crate::support::folder;

const HILRIG: &str = env!("CARGO_BIN_EXE_hilrig");
const PROGRAM: &str = include_str!("programs/restarts.c");
const POLLS: &str = include_str!("programs/polls.c");
const METER: &str = "schema = 1\nname = \"meter\"\nrobot = \"none\"\nduration = \"2s\"\n\
                     device.meter = { description = \"modbus-meter\" }\n";

/// The output of a search of eight cases, each of 100 lines like `line`.
fn search(name: &str, command: &str, line: &str) -> String {
    let dir = folder(&format!("restarts-{name}"));
    fs::create_dir_all(dir.join("frames")).expect("a fresh folder");
    for (file, ending) in [("1", "one"), ("2", "two"), ("3", "three")] {
        let path = dir.join("frames").join(file);
        fs::write(path, format!("{line},{ending}\n")).expect("a fresh folder");
    }
    let mut fuzz = Command::new(HILRIG);
    fuzz.args(["fuzz", "--virtual", "--cases", "8", "--shrink", "8"])
        .args(["--corpus", "frames", "--out", "out", "--exec", command]);
    let output = fuzz.current_dir(&dir).output().expect("it starts");
    let said = [output.stdout, output.stderr].concat();
    String::from_utf8(said).expect("the command speaks UTF-8")
}

/// Number of cases without a start.
fn saved(said: &str) -> u32 {
    let line = said.lines().find(|line| line.contains("without a start"));
    let count = line.and_then(|line| line.split(' ').next());
    count.map_or(0, |count| count.parse().expect("a number"))
}

/// The program counts lines and seconds since its start: put back, it has counted none. With a
/// thread, a child, another file or more memory it is started for each case. Neither way has a
/// finding.
#[test]
fn a_case_without_a_start_begins_like_one_with_a_start() {
    let Some(program) = compiled("restarts", "cc", PROGRAM, &["-pthread"]) else {
        return;
    };
    let program = program.display();
    for (how, is_put_back) in [
        ("plain", true),
        ("thread", false),
        ("file", false),
        ("child", false),
        ("grows", false),
    ] {
        let command = format!("exec {program} {how} \"$HILRIG_DIR/port\"");
        let said = search(how, &command, "$DATA,12");
        assert!(said.contains(" 0 findings"), "{how}: {said}");
        // All but the first.
        let expected = if is_put_back { 7 } else { 0 };
        assert_eq!(saved(&said), expected, "{how}: {said}");
    }
}

/// A failure of a case without a start is a finding if a start shows it as well: it is confirmed
/// and minimised. Only the texts in the program contain the word at which it fails.
#[test]
fn a_finding_without_a_start_is_one_with_a_start() {
    let Some(program) = compiled("restarts-bug", "cc", PROGRAM, &["-pthread"]) else {
        return;
    };
    let command = format!("exec {} bug \"$HILRIG_DIR/port\"", program.display());
    let said = search("bug", &command, "$DATA,12");
    let cause = folder("restarts-bug").join("out/findings/01-crash-sigabrt/cause.txt");
    let cause = fs::read_to_string(cause).expect(&said);
    assert!(cause.contains("1 turns left of"), "{cause}");
}

/// A program that polls with a timeout of 0 and a clock never blocks: its requests come one by one
/// all the same, and each gets a reply of the case.
#[test]
fn a_program_that_polls_without_a_timeout_gets_its_inputs() {
    let Some(program) = compiled("restarts-polls", "cc", POLLS, &[]) else {
        return;
    };
    let dir = folder("restarts-polls");
    fs::create_dir_all(&dir).expect("a fresh folder");
    fs::write(dir.join("meter.toml"), METER).expect("a fresh folder");
    let command = format!("exec {}", program.display());
    let mut fuzz = Command::new(HILRIG);
    fuzz.args(["fuzz", "--virtual", "--cases", "2", "--case", "200ms"])
        .args([
            "--scenario",
            "meter.toml",
            "--link",
            "meter",
            "--out",
            "out",
        ])
        .args(["--exec", &command]);
    let output = fuzz.current_dir(&dir).output().expect("it starts");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let all = [output.stdout, output.stderr].concat();
    let all = String::from_utf8_lossy(&all).into_owned();
    let inputs = said.split(" 2 cases with ").nth(1).expect(&all);
    let inputs: u32 = inputs
        .split(' ')
        .next()
        .and_then(|count| count.parse().ok())
        .expect(&all);
    assert!(inputs >= 10, "{all}");
}
