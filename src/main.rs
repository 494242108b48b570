//! The `hilrig` command: parses, runs, maps the result to an exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    hilrig::cli::main()
}
