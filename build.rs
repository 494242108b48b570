//! Sets the commit of the build for `hilrig --version`: `HILRIG_BUILD` is ` (1a2b3c4d5)`, with `,
//! changed` if files differ from it, or ` (debug build)`.
//!
//! A debug build does not name its commit, because the whole crate would be compiled again with
//! each commit. Without git, or as a part of another repository, it is empty.

use std::env;
use std::path::Path;
use std::process::Command;

/// Sources of the program. If none of them changes, the build script does not run again.
const SOURCES: [&str; 7] = [
    "build.rs",
    "src",
    "crates",
    "protocols/src",
    "emulators/src",
    "firmware_core/src",
    "Cargo.toml",
];

fn main() {
    let build = match env::var("PROFILE").as_deref() {
        Ok("release") => commit().map_or_else(String::new, |commit| format!(" ({commit})")),
        _ => {
            println!("cargo::rerun-if-changed=build.rs");
            " (debug build)".to_owned()
        }
    };
    println!("cargo::rustc-env=HILRIG_BUILD={build}");
}

/// The commit that is checked out here.
fn commit() -> Option<String> {
    for source in SOURCES {
        println!("cargo::rerun-if-changed={source}");
    }
    let root = Path::new(&git(&["rev-parse", "--show-toplevel"])?).canonicalize();
    if root.ok()? != Path::new(env!("CARGO_MANIFEST_DIR")).canonicalize().ok()? {
        return None;
    }
    // Grows with each commit and checkout. Cargo would ask again and again for a file that is not
    // there.
    let log = git(&["rev-parse", "--git-path", "logs/HEAD"])?;
    if Path::new(&log).exists() {
        println!("cargo::rerun-if-changed={log}");
    }
    let commit = git(&["rev-parse", "--short=9", "HEAD"])?;
    let changed = git(&["status", "--porcelain", "--untracked-files=no"])?;
    Some(match changed.is_empty() {
        true => commit,
        false => format!("{commit}, changed"),
    })
}

/// The output of a git command; `None` if git is missing or fails.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let said = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| said.trim_end().to_owned())
}
