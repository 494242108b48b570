use std::env;
use std::ffi::OsString;
use std::io;
use std::path::PathBuf;
use std::process::Stdio;

use clap::Args;

use super::answer::ProgramEnded;
use super::{CliError, Verdict, out};
use crate::realtime::exec::PORTS_VARIABLE;
use crate::realtime::guest;

/// Start a program on the ports of a rig that runs in real time, with modem lines.
///
/// A pseudo-terminal has no modem lines, so clients that set DTR or RTS or send a break fail on
/// one. This command adds them to the rig's ports: DTR and RTS keep their values and reach the
/// devices that use them; CTS, DSR and DCD are on; a break reaches the device. The program is not
/// changed and runs at full speed. The exit code is the program's.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig up lidar.toml --dir /tmp/robot\n  \
    hilrig with --dir /tmp/robot -- python3 my_driver.py       # in another terminal\n  \
    hilrig with --dir /tmp/robot -- picocom -b 115200 /tmp/robot/lidar\n  \
    hilrig run lidar.toml --exec 'hilrig with -- python3 my_driver.py'")]
pub(super) struct WithArgs {
    /// Directory of the rig's ports [default: HILRIG_DIR of the environment]
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
    /// The program and its arguments
    #[arg(required = true, trailing_var_arg = true, value_name = "CMD")]
    command: Vec<OsString>,
}

pub(super) fn run(args: WithArgs) -> Result<Verdict, CliError> {
    let dir = args
        .dir
        .or_else(|| env::var_os(PORTS_VARIABLE).map(PathBuf::from));
    let dir = dir.ok_or_else(|| {
        let wrong = format!("--dir: it is missing, and so is {PORTS_VARIABLE} in the environment");
        CliError::Usage(wrong)
    })?;
    let dir = std::path::absolute(&dir)
        .map_err(|error| CliError::Usage(format!("--dir {}: {error}", dir.display())))?;
    let speaks = match out::is_json() {
        true => io::stderr().into(),
        false => Stdio::inherit(),
    };
    let program_exit_code = guest::run_with_lines(&dir, &args.command, speaks)?;
    out::answer(&ProgramEnded { program_exit_code });
    Ok(Verdict::Program(program_exit_code))
}
