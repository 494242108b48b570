//! The command line: one file per command.

mod bugs;
mod campaign;
mod case;
mod decode;
mod demo;
mod dut;
mod ends;
mod exec;
mod export;
mod fault;
mod fidelity;
mod fuzz;
mod import;
mod map;
mod marks;
mod place;
mod ports;
mod record;
mod replay;
mod run;
mod show;
mod shrink;
mod slam;
mod stop;
#[cfg(feature = "ui")]
mod ui;
mod up;
mod wireshark;

use std::fmt;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::realtime::exec::ExecError;
use crate::realtime::transport::TransportError;
use crate::scenario::ScenarioError;
use crate::show::folder::FolderError;

/// Hardware-in-the-loop rig for small serial robots.
#[derive(Debug, Parser)]
#[command(
    name = "hilrig",
    version,
    max_term_width = 100,
    arg_required_else_help = true
)]
#[command(
    after_help = "Exit codes: 0 all expectations hold, 1 some fail, 2 usage or set-up, \
    130 or 143 a run ended by SIGINT or SIGTERM."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Demo),
    Run(run::RunArgs),
    Up(up::Up),
    Dut(dut::DutArgs),
    Fault(fault::FaultArgs),
    #[cfg(feature = "ui")]
    Ui(ui::Ui),
    Record(record::RecordArgs),
    Replay(replay::ReplayArgs),
    Case(case::CaseArgs),
    Import(import::ImportArgs),
    Export(export::ExportArgs),
    Decode(decode::DecodeArgs),
    Bugs(bugs::Bugs),
    Campaign(campaign::CampaignArgs),
    Fuzz(fuzz::FuzzArgs),
    Shrink(shrink::ShrinkArgs),
    Fidelity(fidelity::Fidelity),
    Slam(slam::SlamArgs),
    Map(map::MapArgs),
    Wireshark(wireshark::Wireshark),
}

/// What a command came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Everything held.
    Pass,
    /// An expectation failed.
    Fail,
    /// Ended by this signal; what there was is judged and written.
    Interrupted(u8),
}

/// Why a command could not do its work: usage or set-up, exit code 2.
#[derive(Debug)]
pub enum CliError {
    /// A scenario cannot be run.
    Scenario(ScenarioError),
    /// A result cannot be written.
    Folder(FolderError),
    /// A port cannot be had, or went away.
    Transport(TransportError),
    /// Anything else, as a sentence that names what is wrong and what was expected.
    Other(String),
}

impl fmt::Display for CliError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scenario(error) => error.fmt(f),
            Self::Folder(error) => error.fmt(f),
            Self::Transport(error) => error.fmt(f),
            Self::Other(error) => f.write_str(error),
        }
    }
}

impl core::error::Error for CliError {}

impl From<ScenarioError> for CliError {
    fn from(error: ScenarioError) -> Self {
        Self::Scenario(error)
    }
}

impl From<FolderError> for CliError {
    fn from(error: FolderError) -> Self {
        Self::Folder(error)
    }
}

impl From<ExecError> for CliError {
    fn from(error: ExecError) -> Self {
        match error {
            ExecError::Scenario(error) => error.into(),
            ExecError::Transport(error) => error.into(),
            other => Self::Other(other.to_string()),
        }
    }
}

impl From<TransportError> for CliError {
    fn from(error: TransportError) -> Self {
        Self::Transport(error)
    }
}

/// Runs the command that the process was started with.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match cli.command {
        Command::Demo(args) => demo::run(args),
        Command::Run(args) => run::run(args),
        Command::Up(args) => up::run(args),
        Command::Dut(args) => dut::run(args),
        Command::Fault(args) => fault::run(&args),
        #[cfg(feature = "ui")]
        Command::Ui(args) => ui::run(args),
        Command::Record(args) => record::run(args),
        Command::Replay(args) => replay::run(args),
        Command::Case(args) => case::run(args),
        Command::Import(args) => import::run(args),
        Command::Export(args) => export::run(args),
        Command::Decode(args) => decode::run(args),
        Command::Bugs(args) => bugs::run(args),
        Command::Campaign(args) => campaign::run(args),
        Command::Fuzz(args) => fuzz::run(&args),
        Command::Shrink(args) => shrink::run(&args),
        Command::Fidelity(args) => fidelity::run(args),
        Command::Slam(args) => slam::run(args),
        Command::Map(args) => map::run(args),
        Command::Wireshark(args) => wireshark::run(args),
    };
    match result {
        Ok(Verdict::Pass) => ExitCode::SUCCESS,
        Ok(Verdict::Fail) => ExitCode::from(1),
        Ok(Verdict::Interrupted(signal)) => ExitCode::from(128 + signal),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

/// Where results go unless told otherwise.
fn default_out(name: &str, seed: u64) -> PathBuf {
    PathBuf::from("hilrig-out").join(format!("{name}-{seed}"))
}
