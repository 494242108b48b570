//! Randomly generated programs with threads, sleeps, pipes, polls and locks. In virtual time each
//! makes the same calls in both runs. Deterministic output equals that in real time.

use std::process::{Command, Stdio};

/// Twelve of the programs that attack their supervisor, in a second or two; `prove.py` runs 1,000.
#[test]
fn hostile_programs_leave_nothing_behind_and_are_judged_right() {
    let tools = ["cc", "python3"].map(|tool| Command::new(tool).arg("--version").output());
    if tools.iter().any(Result::is_err) {
        eprintln!("SKIPPED: hostile programs: expected cc and python3");
        return;
    }
    let proof = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/exec/hostile/prove.py");
    let output = Command::new("python3")
        .args([proof, "--count", "12"])
        .env("HILRIG", env!("CARGO_BIN_EXE_hilrig"))
        .env("TMPDIR", env!("CARGO_TARGET_TMPDIR"))
        .stdin(Stdio::null())
        .output()
        .expect("Python");
    let said = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(
        said.contains("12 hostile programs of seed 1: 0 wrong"),
        "{said}"
    );
}

/// Three of the programs; `tests/exec/generated.sh` runs any number.
#[test]
fn generated_programs_are_the_same_twice_and_as_in_real_time() {
    let tools = ["cc", "python3"].map(|tool| Command::new(tool).arg("--version").output());
    if tools.iter().any(Result::is_err) {
        eprintln!("SKIPPED: generated programs: expected cc and python3");
        return;
    }
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/exec/generated.sh");
    let output = Command::new(script)
        .args(["1", "3"])
        .env("HILRIG", env!("CARGO_BIN_EXE_hilrig"))
        .env("TMPDIR", env!("CARGO_TARGET_TMPDIR"))
        .stdin(Stdio::null())
        .output()
        .expect("a shell");
    let said = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("1 to 3: 0 differ"), "{said}");
}
