//! Real captures that are not part of the product: used when they lie beside it.

use std::fs;
use std::io::{ErrorKind, Write as _};
use std::path::Path;

/// The bytes of a capture, by its path below the folder of captures beside this repository.
///
/// `None`, said loudly, if there is no such folder: a clone without its neighbours still passes.
/// A folder that lacks the file is an error, so a misspelt name cannot skip a test for ever.
pub(crate) fn capture(name: &str) -> Option<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/captures");
    if !folder.is_dir() {
        skipped(&format!("no captures beside the repository, wanted {name}"));
        return None;
    }
    match fs::read(folder.join(name)) {
        Ok(bytes) => Some(bytes),
        Err(error) if error.kind() == ErrorKind::NotFound => panic!("there is no capture {name}"),
        Err(error) => panic!("cannot read the capture {name}: {error}"),
    }
}

/// Says that the running test proves nothing: in its own output, and past the test runner's
/// capture of it, which hides what passing tests print.
pub(crate) fn skipped(reason: &str) {
    let thread = std::thread::current();
    let line = format!("SKIPPED: {}: {reason}", thread.name().unwrap_or("a test"));
    eprintln!("{line}");
    // A closed standard error cannot be told to anybody.
    let _ = writeln!(std::io::stderr(), "{line}");
}
