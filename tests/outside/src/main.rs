//! hilrig's commands with the robot of this crate: `outside run arc.toml`, `outside ui arc.toml`.

use std::process::ExitCode;

fn main() -> ExitCode {
    outside::register();
    hilrig::cli::main()
}
