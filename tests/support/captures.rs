//! Real captures outside of the product, used if they lie beside the repository.

use std::fs;
use std::io::{ErrorKind, Write as _};
use std::path::Path;

/// The bytes of a capture, by its path below the folder of captures beside this repository.
///
/// `None`, with a visible message, if the folder does not exist: a clone without the captures still
/// passes. If the folder exists without the file, that is an error, so a misspelt name cannot skip
/// a test forever.
pub(crate) fn capture(name: &str) -> Option<Vec<u8>> {
    beside("captures", name)
}

/// The bytes of a file in a folder beside this repository, by the same rules.
pub(crate) fn beside(folder: &str, name: &str) -> Option<Vec<u8>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../shared")
        .join(folder);
    if !path.is_dir() {
        skipped(&format!("no {folder} beside the repository, wanted {name}"));
        return None;
    }
    match fs::read(path.join(name)) {
        Ok(bytes) => Some(bytes),
        Err(error) if error.kind() == ErrorKind::NotFound => panic!("{folder} lacks {name}"),
        Err(error) => panic!("cannot read {name} in {folder}: {error}"),
    }
}

/// Reports that the running test proves nothing: in its own output, and directly to standard error,
/// because the test runner hides the output of passing tests.
pub(crate) fn skipped(reason: &str) {
    let thread = std::thread::current();
    let line = format!("SKIPPED: {}: {reason}", thread.name().unwrap_or("a test"));
    eprintln!("{line}");
    // An error of a closed standard error cannot be reported.
    let _ = writeln!(std::io::stderr(), "{line}");
}
