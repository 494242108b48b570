//! The command line: one file per command.

#[macro_use]
mod out;

mod answer;
mod bench;
mod bugs;
mod campaign;
mod case;
mod completions;
mod conform;
mod debug;
mod decode;
mod demo;
mod describe;
mod described;
mod dut;
mod ends;
mod exec;
mod experiment;
mod export;
mod fault;
mod fidelity;
mod firmware;
mod fuzz;
mod import;
mod learn;
mod link;
mod lockstep;
mod man;
mod map;
mod needs;
mod new;
mod node;
mod outputs;
mod place;
mod port;
mod ports;
mod progress;
mod record;
mod replay;
mod run;
mod schema;
mod show;
mod shrink;
mod slam;
mod stop;
mod talk;
#[cfg(feature = "ui")]
mod ui;
mod up;
mod wireshark;
mod with;

use std::io::{self, ErrorKind, Write as _};
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::thread;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use crate::capture::case::CaseError;
use crate::capture::replay::ReplayError;
use crate::realtime::exec::ExecError;
use crate::realtime::guest::{self, GuestError};
use crate::realtime::playback::PlaybackError;
use crate::realtime::process::LINES_VERB;
use crate::realtime::tap::RecordError;
use crate::realtime::transport::TransportError;
use crate::scenario::ScenarioError;
use crate::search::StoreError;
use crate::search::fuzz::dut::HarnessError;
use crate::show::folder::FolderError;
use crate::slam::map::MapError;
use engine::workers;

/// Hardware-in-the-loop rig for small serial robots.
#[derive(Debug, Parser)]
#[command(
    name = "hilrig",
    version = concat!(env!("CARGO_PKG_VERSION"), env!("HILRIG_BUILD")),
    max_term_width = 100,
    arg_required_else_help = true
)]
#[command(
    after_help = "Exit codes: 0 all expectations hold, 1 some fail, 2 usage or set-up, \
    3 some fail but are not judged, because the rig was late, 129, 130 or 143 a run or a campaign \
    ended by SIGHUP, SIGINT or SIGTERM."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print the result as one JSON object (see "hilrig schema --output"); human-readable output
    /// goes to standard error
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Demo),
    Run(run::RunArgs),
    Debug(debug::DebugArgs),
    New(new::NewArgs),
    Up(up::Up),
    Dut(dut::DutArgs),
    Fault(fault::FaultArgs),
    With(with::WithArgs),
    #[cfg(feature = "ui")]
    Ui(ui::Ui),
    Link(link::LinkArgs),
    Record(record::RecordArgs),
    Replay(replay::ReplayArgs),
    Case(case::CaseArgs),
    Import(import::ImportArgs),
    Export(export::ExportArgs),
    Decode(decode::DecodeArgs),
    Describe(describe::DescribeArgs),
    Learn(learn::LearnArgs),
    Talk(talk::TalkArgs),
    Conform(conform::ConformArgs),
    Node(node::NodeArgs),
    Bugs(bugs::Bugs),
    Campaign(campaign::CampaignArgs),
    Fuzz(fuzz::FuzzArgs),
    Shrink(shrink::ShrinkArgs),
    Fidelity(fidelity::Fidelity),
    Experiment(experiment::ExperimentArgs),
    Slam(slam::SlamArgs),
    Map(map::MapArgs),
    Bench(bench::BenchArgs),
    Schema(schema::SchemaArgs),
    Wireshark(wireshark::Wireshark),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
}

/// The result of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// All expectations hold.
    Pass,
    /// An expectation failed.
    Fail,
    /// An expectation failed, but the rig was so late that the cause is unknown.
    NotJudged,
    /// A program ended with this exit code, in the shell's numbering.
    Program(u8),
    /// Ended by this signal; finished results are judged and written.
    Interrupted(u8),
}

/// An error that stops a command: usage or set-up, exit code 2.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// A scenario cannot be run.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A result cannot be written.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// A port cannot be opened, or disappeared.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// A capture cannot be recorded.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// A map cannot be read.
    #[error(transparent)]
    Map(#[from] MapError),
    /// A program cannot be fuzzed.
    #[error(transparent)]
    Fuzz(#[from] HarnessError),
    /// A case cannot be made or run.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// A capture cannot be replayed into a program.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// A capture cannot be replayed into a port.
    #[error(transparent)]
    Playback(#[from] PlaybackError),
    /// The folder of a campaign or of a fuzzer cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A foreign program cannot be put on the ports.
    #[error(transparent)]
    Exec(#[from] ExecError),
    /// A foreign program cannot be run in virtual time.
    #[error(transparent)]
    Guest(#[from] GuestError),
    /// A file cannot be read.
    #[error("cannot read {}: {error}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        error: io::Error,
    },
    /// A file or the standard output cannot be written.
    #[error("cannot write {what}: {error}")]
    Write {
        /// The file, after its option if it has one.
        what: String,
        /// The error of the operating system.
        error: io::Error,
    },
    /// The operating system does not let the command handle signals.
    #[error("cannot listen for signals: {0}")]
    Signals(io::Error),
    /// A file has the wrong content for the command.
    #[error("{}: {what}", .path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The error, and the expected content.
        what: String,
    },
    /// Arguments that contradict each other or name something that does not exist, and the expected
    /// ones.
    #[error("{0}")]
    Usage(String),
}

impl CliError {
    fn read(path: &Path, error: io::Error) -> Self {
        let path = path.to_owned();
        Self::Read { path, error }
    }

    fn write(what: impl ToString, error: io::Error) -> Self {
        let what = what.to_string();
        Self::Write { what, error }
    }

    /// The error for a file at `path` with the wrong content.
    fn content(path: &Path, what: impl ToString) -> Self {
        Self::Content {
            path: path.to_owned(),
            what: what.to_string(),
        }
    }
}

/// The text of the file that the command was given, or of the file `name` in the given folder.
fn read_text(path: &Path, name: &str) -> Result<(PathBuf, String), CliError> {
    let (path, read) = match path.is_dir() {
        true => (path.join(name), safefs::read_text(&path.join(name))),
        // The user may name a pipe.
        false => (path.to_owned(), std::fs::read_to_string(path)),
    };
    let text = read.map_err(|error| CliError::read(&path, error))?;
    Ok((path, text))
}

/// The path of the file `name` in a folder. A pipe in its place, whose writer may never come, is an
/// error.
fn file_of(folder: &Path, name: &str) -> Result<PathBuf, CliError> {
    let path = folder.join(name);
    match safefs::open(&path) {
        Ok(_) => Ok(path),
        Err(error) => Err(CliError::read(&path, error)),
    }
}

/// All bytes of a file that the command was given.
fn read(path: &Path) -> Result<Vec<u8>, CliError> {
    std::fs::read(path).map_err(|error| CliError::read(path, error))
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    // The raw arguments of the system: arguments for other programs need not be text.
    let mut words = std::env::args_os().skip(1);
    let first = words.next().unwrap_or_default();
    if first == guest::VERB {
        let command = words.next().unwrap_or_default();
        return guest::become_guest(&command.to_string_lossy());
    }
    if first == guest::LINES_VERB {
        return guest::become_guest_with_lines(words);
    }
    if first == LINES_VERB {
        return guest::become_shell_with_lines(words.next().unwrap_or_default());
    }
    let command = Cli::command();
    let matches = match command.clone().try_get_matches() {
        Ok(matches) => matches,
        Err(told) => return explain(&told, &command),
    };
    let cli = match Cli::from_arg_matches(&matches) {
        Ok(cli) => cli,
        Err(told) => return explain(&told, &command),
    };
    out::begin(cli.json);
    let checked = needs::check(&command, &matches);
    let checked = checked.and_then(|()| outputs::check(&command, &matches));
    let result = checked.and_then(|()| match cfg!(feature = "large") {
        true => thread::scope(|scope| workers::spawn(scope, || perform(cli.command)).join())
            .unwrap_or_else(|panic| resume_unwind(panic)),
        false => perform(cli.command),
    });
    if let Err(error) = &result {
        eprintln!("error: {error}");
    }
    let exit_code = match &result {
        // The verdict is valid, but its output is incomplete.
        Ok(Verdict::Pass) if out::is_incomplete() => 2,
        Ok(Verdict::Pass) => 0,
        Ok(Verdict::Fail) => 1,
        Ok(Verdict::NotJudged) => 3,
        Ok(Verdict::Interrupted(signal)) => 128 + signal,
        Ok(Verdict::Program(code)) => *code,
        Err(_) => 2,
    };
    match out::is_json() {
        true => {
            let command = matches.subcommand_name().unwrap_or_default();
            print_document(command, &result, exit_code)
        }
        false => ExitCode::from(exit_code),
    }
}

/// Prints help, version, or the error in the arguments; help that cannot be written is an error.
fn explain(told: &clap::Error, command: &clap::Command) -> ExitCode {
    let printed = told.print().and_then(|()| io::stdout().flush());
    let code = if told.use_stderr() { 2 } else { 0 };
    // Words after two dashes belong to another program.
    let words = std::env::args_os().skip(1).take_while(|word| word != "--");
    let words: Vec<String> = words
        .map(|word| word.to_string_lossy().into_owned())
        .collect();
    if code != 0 && words.iter().any(|word| word == "--json") {
        let mut named = words
            .iter()
            .filter_map(|word| command.find_subcommand(word));
        let name = named.next().map_or("", clap::Command::get_name);
        let text = told.to_string();
        let text = text.split("\n\nUsage:").next().unwrap_or_default();
        let error = text
            .strip_prefix("error: ")
            .unwrap_or(text)
            .trim()
            .to_owned();
        return print_document(name, &Err(CliError::Usage(error)), code);
    }
    match printed {
        Err(error) if code == 0 && error.kind() != ErrorKind::BrokenPipe => {
            eprintln!("error: cannot write to standard output: {error}");
            ExitCode::from(2)
        }
        _ => ExitCode::from(code),
    }
}

/// Prints the object of `--json`; an output that cannot be written is an error of its own.
fn print_document(command: &str, result: &Result<Verdict, CliError>, exit_code: u8) -> ExitCode {
    let document = answer::document(command, result, exit_code, out::take_answer());
    match out::write_all(format!("{document:#}\n").as_bytes()) {
        Ok(()) => ExitCode::from(exit_code),
        Err(error) => {
            eprintln!("error: cannot write to standard output: {error}");
            ExitCode::from(2)
        }
    }
}

fn perform(command: Command) -> Result<Verdict, CliError> {
    match command {
        Command::Demo(args) => demo::run(args),
        Command::Run(args) => run::run(args),
        Command::Debug(args) => debug::run(args),
        Command::New(args) => new::run(&args),
        Command::Up(args) => up::run(args),
        Command::Dut(args) => dut::run(args),
        Command::Fault(args) => fault::run(&args),
        Command::With(args) => with::run(args),
        #[cfg(feature = "ui")]
        Command::Ui(args) => ui::run(args),
        Command::Link(args) => link::run(&args),
        Command::Record(args) => record::run(args),
        Command::Replay(args) => replay::run(args),
        Command::Case(args) => case::run(args),
        Command::Import(args) => import::run(args),
        Command::Export(args) => export::run(args),
        Command::Decode(args) => decode::run(args),
        Command::Describe(args) => describe::run(&args),
        Command::Learn(args) => learn::run(&args),
        Command::Talk(args) => talk::run(&args),
        Command::Conform(args) => conform::run(&args),
        Command::Node(args) => node::run(&args),
        Command::Bugs(args) => bugs::run(args),
        Command::Campaign(args) => campaign::run(args),
        Command::Fuzz(args) => fuzz::run(&args),
        Command::Shrink(args) => shrink::run(&args),
        Command::Fidelity(args) => fidelity::run(&args),
        Command::Experiment(args) => experiment::run(&args),
        Command::Slam(args) => slam::run(args),
        Command::Map(args) => map::run(args),
        Command::Bench(args) => bench::run(&args),
        Command::Schema(args) => schema::run(&args),
        Command::Wireshark(args) => wireshark::run(args),
        Command::Completions(args) => completions::run(&args),
        Command::Man(args) => man::run(&args),
    }
}

/// Default folder of results.
fn default_out(name: &str, seed: u64) -> PathBuf {
    PathBuf::from("hilrig-out").join(format!("{name}-{seed}"))
}
