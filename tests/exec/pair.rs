//! Two foreign programs of one scenario, joined by a cable that loses bytes, in virtual time.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::{Ended, ended_in};

const SCENARIO: &str = include_str!("programs/pair/pair.toml");

fn folder(name: &str) -> PathBuf {
    let folder = format!("pair-{name}-{}", std::process::id());
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(folder)
}

/// A fresh folder with both programs and the scenario.
fn prepared(name: &str, scenario: &str) -> PathBuf {
    let folder = folder(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a fresh folder");
    let programs = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/exec/programs/pair");
    fs::copy(programs.join("planner.py"), folder.join("planner.py")).expect("is there");
    fs::write(folder.join("pair.toml"), scenario).expect("a fresh file");
    let mut compiler = Command::new("cc");
    compiler.arg("-O1").arg("-o").arg(folder.join("driver"));
    let built = compiler.arg(programs.join("driver.c")).status();
    assert!(built.is_ok_and(|status| status.success()), "cc is needed");
    folder
}

fn hilrig(folder: &Path, args: &[&str]) -> Ended {
    let mut hilrig = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    let ended = hilrig.current_dir(folder).args(args).output();
    ended_in(folder, ended.expect("the binary is built"))
}

fn run(folder: &Path, more: &[&str]) -> Ended {
    let run = ["run", "pair.toml", "--out", "out"];
    hilrig(folder, &[&run, more].concat())
}

fn trace(ended: &Ended) -> String {
    let mut lines = ended.said.lines();
    let line = lines.find_map(|line| line.trim().strip_prefix("trace "));
    line.expect("each run says it").to_owned()
}

/// The planner repeats lost orders, so that the robot reaches its waypoint; each run gives the same
/// bytes, another seed other ones.
#[test]
fn a_planner_and_a_driver_make_the_same_bytes_each_time() {
    let folder = prepared("same", SCENARIO);
    let first = run(&folder, &[]);
    assert_eq!(first.code, Some(0), "{}\n{}", first.said, first.log);
    let mut orders = first.log.lines().filter(|line| line.starts_with("order "));
    let last = orders.next_back().expect("it gave orders").to_owned();
    assert!(
        !last.contains("after 110 tries"),
        "nothing was lost: {last}"
    );
    let second = run(&folder, &[]);
    assert_eq!((trace(&first), &first.log), (trace(&second), &second.log));
    assert_ne!(trace(&first), trace(&run(&folder, &["--seed", "9"])));
    let _ = fs::remove_dir_all(&folder);
}

/// Commands that judge a run of the file: each starts its programs or refuses it, so that none is
/// green without them.
#[test]
fn commands_that_do_not_start_the_programs_refuse_the_file() {
    let short = SCENARIO.replace("duration = \"12s\"", "duration = \"300ms\"");
    let folder = prepared("refused", &short);
    run(&folder, &[]);
    let from = ["case", "from", "out/capture.pcapng", "-o", "made.toml"];
    let made = hilrig(&folder, &from);
    assert_eq!(made.code, Some(0), "{}", made.said);
    for args in [
        "run pair.toml --exec true",
        "run pair.toml --node true",
        "run pair.toml --realtime",
        "run pair.toml --realtime --ui",
        "campaign pair.toml --seeds 0..2",
        "campaign pair.toml --seeds 0..2 --exec true",
        "campaign pair.toml --seeds 0..2 --mutants",
        "shrink pair.toml",
        "shrink out/case.toml --exec true --virtual",
        "shrink out/capture.pcapng --exec true",
        "shrink made.toml --exec true --virtual",
        "debug pair.toml --exec true",
        "up pair.toml --until-over",
        "ui pair.toml --duration 1s",
        "fuzz --scenario pair.toml --cases 1",
        "fuzz --scenario pair.toml --exec true",
        "case check made.toml --exec true",
        "run made.toml --exec true --virtual",
    ] {
        let words: Vec<&str> = args.split(' ').collect();
        let refused = hilrig(&folder, &words);
        assert_eq!(refused.code, Some(2), "{args}: {}", refused.said);
        let names_it = refused.said.contains("[exec.");
        assert!(names_it, "{args}: {}", refused.said);
    }
    let _ = fs::remove_dir_all(&folder);
}

/// The program that ends is named.
#[test]
fn the_program_that_ended_is_named() {
    let dies = SCENARIO.replace(
        "exec.driver]\ncommand = './driver",
        "exec.driver]\ncommand = 'timeout 2 ./driver",
    );
    let folder = prepared("dies", &dies);
    let ended = run(&folder, &[]);
    assert_eq!(ended.code, Some(1), "{}", ended.said);
    let alive = ended
        .said
        .lines()
        .find(|line| line.contains("program-alive"));
    let alive = alive.expect("judged");
    assert!(
        alive.contains("FAIL") && alive.contains("driver ended with exit code 124 at "),
        "{alive}"
    );
    assert!(alive.contains("planner to the end"), "{alive}");
    let _ = fs::remove_dir_all(&folder);
}

/// A program that ends with exit code 0 while the other one continues: an error, unless its table
/// allows it. The table of the other program does not count.
#[test]
fn a_program_may_end_before_the_other_one() {
    let ends = SCENARIO.replace(
        "exec.planner]\ncommand = 'python3 planner.py \"$HILRIG_PORT_ORDERS\"'",
        "exec.planner]\nMAY\ncommand = 'timeout 1 python3 planner.py \"$HILRIG_PORT_ORDERS\"; true'",
    );
    let ends = ends.replace("duration = \"12s\"", "duration = \"5s\"");
    assert!(ends.contains("MAY"), "the table is another one");
    for (name, may, is_allowed) in [
        ("may", ends.replace("MAY", "may_end = true"), true),
        ("may-not", ends.replace("MAY", ""), false),
        (
            "other",
            ends.replace("MAY", "")
                .replace("exec.driver]", "exec.driver]\nmay_end = true"),
            false,
        ),
    ] {
        let folder = prepared(name, &may);
        let ended = run(&folder, &[]);
        let mut lines = ended.said.lines();
        let alive = lines.find(|line| line.contains("program-alive"));
        let alive = alive.unwrap_or_else(|| panic!("{name}: {}", ended.said));
        assert_eq!(alive.contains("ok "), is_allowed, "{name}: {alive}");
        assert!(
            alive.contains("planner ended with exit code 0 at "),
            "{name}: {alive}"
        );
        let _ = fs::remove_dir_all(&folder);
    }
}
