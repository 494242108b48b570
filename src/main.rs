//! The `hilrig` command: parses, runs, maps the result to an exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    #[cfg(feature = "command")]
    return hilrig::cli::main();
    #[cfg(not(feature = "command"))]
    return hilrig::demo::main();
}
