//! Tools of others that write our input formats and read our output formats.

use std::io::Write as _;
use std::path::Path;
use std::process::Command;

/// Whether `tool` is installed. CI must have it; elsewhere its absence is reported on the terminal,
/// past the test runner's capture of output.
pub(crate) fn has(tool: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&path).any(|folder| folder.join(tool).is_file())
        || Path::new(tool).is_file();
    if !found {
        assert!(std::env::var_os("CI").is_none(), "CI needs {tool}");
        let thread = std::thread::current();
        let name = thread.name().unwrap_or("a test");
        let _ = writeln!(std::io::stderr(), "SKIPPED: {name}: no {tool}");
    }
    found
}

/// Output of `command`, which must succeed.
pub(crate) fn printed(command: &mut Command) -> Vec<u8> {
    let output = command.output().expect("the tool starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {said}");
    output.stdout
}
