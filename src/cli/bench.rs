use core::time::Duration;
use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Args;

use super::answer::{Benched, ScenarioBenched};
use super::exec::refuse_programs;
use super::{CliError, Verdict, out, progress};
use crate::realtime::clock::thread_cpu_time;
use crate::run::Run;
use crate::scenario::{Scenario, Source};

/// The folder whose scenarios run if none is named.
const SHIPPED: &str = "scenarios";

/// Headings of the table.
const HEAD: [&str; 5] = [
    "scenario",
    "virtual s",
    "virtual s per CPU s",
    "situations per CPU min",
    "instructions",
];

/// Measure how fast scenarios run in virtual time.
///
/// Each scenario runs in this process with its own seed, is judged, and writes no result folder.
/// Printed are virtual seconds per second of processor time, and situations per minute of processor
/// time; a situation is one run with its verdict. Processor time depends on the machine and its
/// load. Instructions do not: they are counted if valgrind is installed, which takes about 50 times
/// as long as the run. Verdicts do not change the exit code.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig bench                                  # all files of the folder scenarios\n  \
    hilrig bench scenarios/rescue-flat.toml --rounds 10\n  \
    hilrig bench mine.toml --no-instructions --json\n  \
    hilrig bench --markdown > speed.md            # a table for your docs")]
pub(super) struct BenchArgs {
    /// Scenario files [default: all files of the folder scenarios]
    #[arg(value_name = "SCENARIO")]
    scenarios: Vec<PathBuf>,
    /// Runs of each scenario; the one with the least processor time counts
    #[arg(long, value_name = "N", default_value_t = 3)]
    #[arg(value_parser = clap::value_parser!(u16).range(1..))]
    rounds: u16,
    /// Do not count instructions, even if valgrind is installed
    #[arg(long)]
    no_instructions: bool,
    /// Print the table in Markdown, with the name of the machine
    #[arg(long)]
    markdown: bool,
}

pub(super) fn run(args: &BenchArgs) -> Result<Verdict, CliError> {
    let files = match args.scenarios.as_slice() {
        [] => shipped()?,
        named => named.to_vec(),
    };
    // All files are read before the first run.
    let mut scenarios = Vec::new();
    for path in &files {
        let (scenario, source) = Scenario::read(path)?;
        refuse_programs("bench", path, &scenario)?;
        scenarios.push((path, scenario, source));
    }
    if cfg!(debug_assertions) {
        eprintln!("warning: this is a debug build; a release is faster");
    }
    let machine = machine();
    match args.markdown {
        true => {
            println!("hilrig {} on {machine}\n", env!("CARGO_PKG_VERSION"));
            println!("| {} |\n|---|--:|--:|--:|--:|", HEAD.join(" | "));
        }
        false => println!("{machine}\n{}", line(HEAD.map(str::to_owned))),
    }
    let mut rows = Vec::new();
    for (path, scenario, source) in scenarios {
        let row = measured(path, &scenario, &source, args)?;
        match args.markdown {
            true => println!("| {} |", row.cells().join(" | ")),
            false => println!("{}", line(row.cells())),
        }
        rows.push(row);
    }
    out::answer(&Benched {
        machine,
        scenarios: rows,
    });
    Ok(Verdict::Pass)
}

/// The scenarios of the folder [`SHIPPED`], by name.
fn shipped() -> Result<Vec<PathBuf>, CliError> {
    let usage = |what: &str| CliError::Usage(format!("no scenario is named, and {what}"));
    let entries = std::fs::read_dir(SHIPPED)
        .map_err(|error| usage(&format!("the folder {SHIPPED} cannot be read: {error}")))?;
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut files: Vec<PathBuf> = paths
        .filter(|path| path.extension().is_some_and(|end| end == "toml"))
        .collect();
    if files.is_empty() {
        return Err(usage(&format!("the folder {SHIPPED} has no TOML file")));
    }
    files.sort();
    Ok(files)
}

fn measured(
    path: &Path,
    scenario: &Scenario,
    source: &Source,
    args: &BenchArgs,
) -> Result<ScenarioBenched, CliError> {
    let (mut ran, mut least) = (Duration::ZERO, Duration::MAX);
    for _ in 0..args.rounds {
        let before = cpu_time()?;
        ran = judged(Run::new(scenario.clone(), source, None)?);
        least = least.min(cpu_time()?.saturating_sub(before));
    }
    let (virtual_s, cpu_s) = (ran.as_secs_f64(), least.as_secs_f64());
    Ok(ScenarioBenched {
        scenario: scenario.name.clone(),
        virtual_s,
        cpu_s,
        virtual_s_per_cpu_s: virtual_s / cpu_s,
        situations_per_cpu_minute: 60.0 / cpu_s,
        instructions: match args.no_instructions {
            true => None,
            false => instructions(path, &scenario.name),
        },
    })
}

/// Processor time so far. A run has one thread.
fn cpu_time() -> Result<Duration, CliError> {
    let message = "bench: this system does not report the processor time of a thread";
    thread_cpu_time().ok_or_else(|| CliError::Usage(message.to_owned()))
}

/// Runs to the end and judges; returns the virtual time.
fn judged(mut run: Run) -> Duration {
    while !run.is_over() {
        run.step();
    }
    run.judge_what_is_expected().ran
}

/// Instructions of a process that runs the scenario once, its start included; `None` without
/// valgrind.
fn instructions(path: &Path, name: &str) -> Option<u64> {
    if progress::is_watched() {
        eprint!("{name}: counting instructions\r");
    }
    let mut valgrind = Command::new("valgrind");
    valgrind.args(["--tool=callgrind", "--callgrind-out-file=/dev/null"]);
    valgrind.arg(std::env::current_exe().ok()?).arg("bench");
    valgrind
        .args(["--rounds", "1", "--no-instructions", "--"])
        .arg(path);
    let ended = valgrind.output();
    let printed = String::from_utf8(ended.ok()?.stderr).ok()?;
    let (_, count) = printed.rsplit_once("Collected : ")?;
    count.split_whitespace().next()?.parse().ok()
}

impl ScenarioBenched {
    /// The row of the table.
    fn cells(&self) -> [String; 5] {
        let millions = self.instructions.map(|count| count as f64 / 1e6);
        [
            self.scenario.clone(),
            format!("{:.1}", self.virtual_s),
            format!("{:.0}", self.virtual_s_per_cpu_s),
            format!("{:.0}", self.situations_per_cpu_minute),
            millions.map_or_else(|| "-".to_owned(), |count| format!("{count:.0} M")),
        ]
    }
}

fn line([name, figures @ ..]: [String; 5]) -> String {
    let figures = HEAD[1..].iter().zip(figures);
    let figures = figures.map(|(head, figure)| format!("  {figure:>0$}", head.len().max(9)));
    format!("{name:<22}{}", figures.collect::<String>())
}

/// The machine's processor by name, and the number of processors.
fn machine() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info
        .lines()
        .find_map(|line| line.strip_prefix("model name"));
    let model = model.map_or("unknown processor", |model| {
        model.trim_start_matches([' ', '\t', ':'])
    });
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{model}, {processors} processors")
}
