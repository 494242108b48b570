mod rows;

use core::num::NonZeroUsize;
use core::ops::Range;
use std::path::PathBuf;
use std::thread;

use clap::Args;

use super::answer::{ExperimentDone, ExperimentFigure, Experiments};
use super::{CliError, Verdict, out, progress};
use crate::experiment::{self, Experiment, Findings, Plan};
use safefs::Dir;

/// Repeat an experiment of a robot's report, or judge all figures of the reports.
///
/// All runs are in virtual time, over many seeds. A named experiment gives a table and a plot; its
/// output shows medians beside the report's figures, without a verdict. `--all` judges each
/// figure, table and measured statement of the three reports by a band: reproduced, or differs.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig experiment                      # list all\n  \
    hilrig experiment push                 # figure 8 of the report, 20 seeds\n  \
    hilrig experiment mazes --out mazes    # 100 mazes; mazes/mazes.csv and mazes/mazes.svg\n  \
    hilrig experiment mazes --seeds 500..520 # other mazes, on which nothing was tuned\n  \
    hilrig experiment turning --seeds 5 --json\n  \
    hilrig experiment --all                # every figure of the reports, judged; one page\n  \
    hilrig experiment --all --rows rescue-push,car-wall")]
pub(super) struct ExperimentArgs {
    /// Name of the experiment [default: list them]
    name: Option<String>,
    /// Judge all figures, tables and measured statements of the reports: a plot for each, and one
    /// page. Exit code 1 if a row that must be reproduced differs
    #[arg(long, conflicts_with = "name")]
    all: bool,
    /// Only these rows
    #[arg(
        long,
        value_name = "ROW,..",
        value_delimiter = ',',
        requires = "all",
        conflicts_with = "name"
    )]
    rows: Vec<String>,
    /// Measure each row with a model that is wrong on purpose. Exit code 1 if the verdict of a row
    /// does not change, except for open rows
    #[arg(long, requires = "all", conflicts_with = "name")]
    planted: bool,
    /// Seeds A up to B, or a number of the experiment's own seeds [default: all of its own; with
    /// --all, 10]
    #[arg(long, value_name = "N|A..B", value_parser = seeds)]
    seeds: Option<Seeds>,
    /// Number of parallel runs [default: one per core]
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    /// Folder of table and plot
    #[arg(long, value_name = "DIR", default_value = "hilrig-out/experiments")]
    out: PathBuf,
}

/// Maximum number of seeds at a time.
const SEEDS_MAX: u64 = 10_000;

/// The selected seeds.
#[derive(Clone, Debug)]
enum Seeds {
    /// This number of seeds, from the experiment's first one.
    Count(u64),
    /// A range of seeds.
    These(Range<u64>),
}

impl Seeds {
    /// The first seed, and the number of seeds, of an experiment whose own seeds begin at `first`.
    const fn from(&self, first: u64) -> [u64; 2] {
        match self {
            Self::Count(count) => [first, *count],
            Self::These(seeds) => [seeds.start, seeds.end - seeds.start],
        }
    }
}

fn seeds(text: &str) -> Result<Seeds, String> {
    let seeds = match text.parse() {
        Ok(count) => Seeds::Count(count),
        Err(_) => Seeds::These(super::campaign::seeds(text)?),
    };
    let count = match &seeds {
        Seeds::Count(count) => *count,
        Seeds::These(seeds) => seeds.end - seeds.start,
    };
    match count {
        1..=SEEDS_MAX => Ok(seeds),
        _ => Err(format!("expected 1 to {SEEDS_MAX} seeds")),
    }
}

pub(super) fn run(args: &ExperimentArgs) -> Result<Verdict, CliError> {
    if args.all {
        return rows::run(args);
    }
    let Some(name) = &args.name else {
        list();
        return Ok(Verdict::Pass);
    };
    let all = experiment::all();
    let found = all.iter().find(|one| one.name == name);
    let found = found.ok_or_else(|| {
        let known: Vec<&str> = all.iter().map(|one| one.name).collect();
        CliError::Usage(format!(
            "no experiment \"{name}\", expected {}",
            known.join(", ")
        ))
    })?;
    let own = Seeds::These(found.seeds.clone());
    let [first_seed, seeds] = args.seeds.as_ref().unwrap_or(&own).from(found.seeds.start);
    let plan = Plan {
        first_seed,
        seeds,
        jobs: jobs(args),
    };
    let is_watched = progress::is_watched();
    let findings = (found.perform)(&plan, &|done, all| {
        if is_watched && done.is_multiple_of((all / 10).max(1)) {
            eprintln!("{done} of {all} runs");
        }
    });
    let files = write(args, found, &findings)?;
    answer(found, &plan, &findings, &files);
    Ok(Verdict::Pass)
}

/// Number of parallel runs.
fn jobs(args: &ExperimentArgs) -> usize {
    let jobs = args.jobs.or_else(|| thread::available_parallelism().ok());
    jobs.map_or(1, NonZeroUsize::get)
}

fn list() {
    let experiments = experiment::all().iter().map(|one| ExperimentDone {
        name: one.name.to_owned(),
        place: one.place.to_owned(),
        first_seed: one.seeds.start,
        seeds: one.seeds.end - one.seeds.start,
        figures: Vec::new(),
        files: Vec::new(),
    });
    out::answer(&Experiments {
        experiments: experiments.collect(),
    });
    for one in experiment::all() {
        println!("{:<10} {} ({})", one.name, one.about, one.place);
    }
}

/// Writes table and plot, and returns their paths.
fn write(
    args: &ExperimentArgs,
    experiment: &Experiment,
    findings: &Findings,
) -> Result<[PathBuf; 2], CliError> {
    let failed = |error| CliError::write(format!("--out {}", args.out.display()), error);
    let out = Dir::create(&args.out).map_err(failed)?;
    let names = ["csv", "svg"].map(|kind| format!("{}.{kind}", experiment.name));
    out.write(&names[0], findings.table.csv()).map_err(failed)?;
    out.write(&names[1], findings.plot.svg()).map_err(failed)?;
    Ok(names.map(|name| args.out.join(name)))
}

fn answer(experiment: &Experiment, plan: &Plan, findings: &Findings, files: &[PathBuf; 2]) {
    let figure = |one: &experiment::Figure| ExperimentFigure {
        name: one.name.clone(),
        ours: one.ours.clone(),
        report: Some(one.report.to_owned()).filter(|report| !report.is_empty()),
    };
    let done = ExperimentDone {
        name: experiment.name.to_owned(),
        place: experiment.place.to_owned(),
        first_seed: plan.first_seed,
        seeds: plan.seeds,
        figures: findings.figures.iter().map(figure).collect(),
        files: files
            .iter()
            .map(|file| file.display().to_string())
            .collect(),
    };
    out::answer(&Experiments {
        experiments: vec![done],
    });
    println!(
        "{} ({}), {} seeds from {} on",
        experiment.about, experiment.place, plan.seeds, plan.first_seed
    );
    println!("  {:<48} {:<44} report", "", "rig");
    for one in &findings.figures {
        println!("  {:<48} {:<44} {}", one.name, one.ours, one.report);
    }
    let [table, plot] = files;
    println!("table {}, plot {}", table.display(), plot.display());
}
