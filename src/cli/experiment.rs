use core::num::NonZeroUsize;
use std::path::PathBuf;
use std::thread;

use clap::Args;

use super::answer::{ExperimentDone, ExperimentFigure, Experiments};
use super::{CliError, Verdict, out, progress};
use crate::experiment::{self, Experiment, Findings, Plan};

/// Do an experiment of a robot's report again: table and plot beside the report's own figures.
///
/// Everything runs in virtual time over many seeds; medians are told. Nothing is judged: the
/// report's figures stand beside ours.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig experiment                      # which there are\n  \
    hilrig experiment push                 # figure 8 of the report, 20 seeds\n  \
    hilrig experiment mazes --out mazes    # 100 mazes; mazes/mazes.csv and mazes/mazes.svg\n  \
    hilrig experiment turning --seeds 5 --json")]
pub(super) struct ExperimentArgs {
    /// Which [default: list them]
    name: Option<String>,
    /// Seeds, from 1 on [default: the experiment's own]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: Option<u64>,
    /// Runs at a time [default: one for each processor]
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    /// Folder of table and plot
    #[arg(long, value_name = "DIR", default_value = "hilrig-out/experiments")]
    out: PathBuf,
}

pub(super) fn run(args: &ExperimentArgs) -> Result<Verdict, CliError> {
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
    let jobs = args.jobs.or_else(|| thread::available_parallelism().ok());
    let plan = Plan {
        seeds: args.seeds.unwrap_or(found.seeds),
        jobs: jobs.map_or(1, NonZeroUsize::get),
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

fn list() {
    let experiments = experiment::all().iter().map(|one| ExperimentDone {
        name: one.name.to_owned(),
        place: one.place.to_owned(),
        seeds: one.seeds,
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

/// Writes table and plot; where they are.
fn write(
    args: &ExperimentArgs,
    experiment: &Experiment,
    findings: &Findings,
) -> Result<[PathBuf; 2], CliError> {
    let failed = |error| CliError::write(format!("--out {}", args.out.display()), error);
    std::fs::create_dir_all(&args.out).map_err(failed)?;
    let [table, plot] =
        ["csv", "svg"].map(|kind| args.out.join(format!("{}.{kind}", experiment.name)));
    std::fs::write(&table, findings.table.csv()).map_err(failed)?;
    std::fs::write(&plot, findings.plot.svg()).map_err(failed)?;
    Ok([table, plot])
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
        "{} ({}), {} seeds",
        experiment.about, experiment.place, plan.seeds
    );
    println!("  {:<48} {:<44} report", "", "rig");
    for one in &findings.figures {
        println!("  {:<48} {:<44} {}", one.name, one.ours, one.report);
    }
    let [table, plot] = files;
    println!("table {}, plot {}", table.display(), plot.display());
}
