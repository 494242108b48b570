//! Twelve drivers with one defect each, in three languages: their causes are named, and their cases
//! fail with the defect and pass without it. A landing tries four. With more seeds:
//! `python3 tests/drivers/prove.py --seeds 20`.

use std::path::Path;
use std::process::Command;

use crate::thorough::is_thorough;

/// Drivers of each landing: one or two of each language, with defects that no other test here has.
const SOME: [&str; 4] = ["late_reader", "resync", "stale", "endian"];

#[test]
fn drivers_with_a_defect_are_red_and_their_cause_is_named() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new("python3")
        .arg(root.join("tests/drivers/prove.py"))
        .args(if is_thorough() { &[][..] } else { &SOME })
        .env("HILRIG", env!("CARGO_BIN_EXE_hilrig"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .expect("python3 is there");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
}
