//! Several robots in one world, each with a foreign program, in virtual time.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::{Ended, ended_in};

const SCENARIO: &str = include_str!("programs/meet/meet.toml");
/// The command of both robots.
const COMMAND: &str = "command = 'python3 driver.py'";

/// A fresh folder with the program and `scenario`.
fn prepared(name: &str, scenario: &str) -> PathBuf {
    let folder = format!("team-{name}-{}", std::process::id());
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(folder);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a fresh folder");
    let programs = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/exec/programs/meet");
    fs::copy(programs.join("driver.py"), folder.join("driver.py")).expect("is there");
    fs::write(folder.join("meet.toml"), scenario).expect("a fresh file");
    folder
}

fn hilrig(folder: &Path, words: &str) -> Ended {
    let mut hilrig = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    let ended = hilrig.current_dir(folder).args(words.split(' ')).output();
    ended_in(folder, ended.expect("the binary is built"))
}

fn run(name: &str, scenario: &str, more: &str) -> Ended {
    let folder = prepared(name, scenario);
    let ended = hilrig(&folder, &format!("run meet.toml --out out{more}"));
    let _ = fs::remove_dir_all(&folder);
    ended
}

/// Exit code and output of a command without a run.
fn refused(folder: &Path, words: &str) -> (Option<i32>, String) {
    let mut hilrig = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    let ended = hilrig.current_dir(folder).args(words.split(' ')).output();
    let ended = ended.expect("the binary is built");
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    (ended.status.code(), said)
}

/// The text behind `head` of its line.
fn line(ended: &Ended, head: &str) -> String {
    let mut lines = ended.said.lines();
    let line = lines.find_map(|line| line.trim().strip_prefix(head));
    line.unwrap_or_else(|| panic!("{head}: {}", ended.said))
        .trim()
        .to_owned()
}

/// The scenario in which only the further robot has a program of its own, under its path, and the
/// first one a built-in program.
fn mixed() -> String {
    let (head, rest) = SCENARIO.split_once("[[expect.rule]]").expect("there");
    let (_, rest) = rest.split_once("[team.blue]").expect("there");
    let rest = rest.replace("python3", "HILRIG_PORT_BASE=\"$HILRIG_DIR/base\" python3");
    format!("{head}[team.blue]{rest}").replacen("custom", "yellow", 1)
}

/// Two robots with the same program stop in front of each other, on a link that loses bytes. Each
/// run gives the same bytes.
///
/// The first 1.4 m apart, they approach with 0.4 m/s, and a robot has a radius of 0.15 m. The first
/// robot stops when 0.3 m are free in front of its middle, after 2.375 s. A further robot that does
/// not stop needs 0.75 s more, and touches at 3.125 s, or a few periods of 30 ms earlier, in which
/// the first robot still drives.
#[test]
fn robots_with_programs_of_their_own_meet_in_a_corridor() {
    let ended = run("first", SCENARIO, "");
    assert_eq!(ended.code, Some(0), "{}\n{}", ended.said, ended.log);
    assert!(line(&ended, "ok   blue/no-collision-at-speed").starts_with("0 contacts"));
    let alive = line(&ended, "ok   program-alive");
    assert_eq!(alive, "east to the end; blue/west to the end");
    let again = run("again", SCENARIO, "");
    assert_eq!(line(&ended, "trace"), line(&again, "trace"));
    let both = SCENARIO.rsplit_once(COMMAND).expect("the further robot");
    let blind = format!("{}command = 'python3 driver.py -1'{}", both.0, both.1);
    let ended = run("blind", &blind, "");
    assert_eq!(ended.code, Some(1), "{}\n{}", ended.said, ended.log);
    let touched = line(&ended, "FAIL blue/no-collision-at-speed");
    let at = touched
        .split(" s,")
        .next()
        .and_then(|it| it.rsplit(' ').next());
    let at: f64 = at.and_then(|at| at.parse().ok()).expect("a time");
    assert!((2.95..3.125).contains(&at), "{touched}");
    assert_eq!(ended.said.matches("FAIL ").count(), 2, "{}", ended.said);
}

/// One command drives both robots; a robot with a built-in program keeps it beside one with a
/// program of yours; the program that ends, and the motors that it left on, have the names of their
/// robot.
#[test]
fn programs_drive_the_robots_that_they_are_for() {
    let bare = SCENARIO.replace(COMMAND, "").replace("[exec.east]", "");
    let bare = bare.replace("[team.blue.exec.west]", "");
    let folder = prepared("fleet", &bare.replace("\"4s\"", "\"3s\""));
    let both = "#!/bin/sh\npython3 driver.py &\n\
                HILRIG_PORT_BASE=\"$HILRIG_PORT_BLUE_BASE\" exec python3 driver.py\n";
    fs::write(folder.join("both"), both).expect("a fresh file");
    let words = "run meet.toml --out out --virtual --exec";
    let mut words: Vec<&str> = words.split(' ').collect();
    words.push("sh both");
    let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    let ended = command.current_dir(&folder).args(words).output();
    let ended = ended_in(&folder, ended.expect("the binary is built"));
    assert_eq!(ended.code, Some(0), "{}\n{}", ended.said, ended.log);
    line(&ended, "ok   blue/rule-drives");
    let _ = fs::remove_dir_all(&folder);

    let ended = run("mixed", &mixed(), "");
    assert_eq!(ended.code, Some(0), "{}\n{}", ended.said, ended.log);
    let opened = line(&ended, "ok   program-connected");
    assert_eq!(opened, "opened blue/base");

    let dies = mixed().replace(
        "exec.west]\ncommand = '",
        "exec.west]\ncommand = 'timeout 2 env ",
    );
    let dies = dies.replacen("watchdog = \"500ms\"\n", "", 1);
    let ended = run("dies", &dies, "");
    assert_eq!(ended.code, Some(1), "{}\n{}", ended.said, ended.log);
    line(&ended, "FAIL program-alive");
    let motors = line(&ended, "FAIL blue/motors-stop-after-silence");
    assert!(
        motors.contains("set-points still on at the end"),
        "{motors}"
    );
}

/// Each command starts the program of a further robot, or refuses the file and names the way out.
#[test]
fn commands_that_do_not_start_these_programs_refuse_the_file() {
    let bare = SCENARIO.replacen(COMMAND, "", 2);
    let bare = bare
        .replace("[exec.east]", "")
        .replace("[team.blue.exec.west]", "");
    let own = SCENARIO.replacen(COMMAND, "", 1).replace("[exec.east]", "");
    let folder = prepared("refused", &own);
    fs::write(folder.join("bare.toml"), bare).expect("a fresh file");
    let rows = [
        (
            "shrink",
            "[team.blue.exec.west], which shrink does not start",
        ),
        (
            "campaign --seeds 0..2",
            "[team.blue.exec.west], which campaign",
        ),
        ("debug --exec true", "[team.blue.exec.west], which debug"),
        ("ui --duration 1s", "[team.blue.exec.west], which ui"),
        ("up --until-over", "[team.blue.exec.west], which up"),
        ("run --exec true", "[exec.NAME], expected no other one"),
        ("run --realtime", "in virtual time; leave the option out"),
    ];
    for (words, told) in rows {
        let (command, more) = words.split_once(' ').unwrap_or((words, ""));
        let words = format!("{command} meet.toml {more}");
        let (code, said) = refused(&folder, words.trim_end());
        assert_eq!(code, Some(2), "{words}: {said}");
        assert!(said.contains(told), "{words}: {said}");
    }
    for words in [
        "run",
        "shrink",
        "campaign --seeds 0..2",
        "ui --duration 1s",
        "run --exec true",
    ] {
        let (command, more) = words.split_once(' ').unwrap_or((words, ""));
        let words = format!("{command} bare.toml {more}");
        let (code, said) = refused(&folder, words.trim_end());
        let told = "bare.toml:36: team.blue.robot: is \"custom\", which has no built-in program";
        assert_eq!(code, Some(2), "{words}: {said}");
        assert!(said.contains(told), "{words}: {said}");
        assert!(said.contains("--exec CMD --virtual"), "{words}: {said}");
    }
    let _ = fs::remove_dir_all(&folder);
}
