use std::path::{Path, PathBuf};

use clap::Args;

use super::answer::Runs;
use super::run::{self, Clocking, Talk};
use super::stop::Stop;
use super::{CliError, Verdict, default_out};
use crate::scenario::Scenario;

/// The scenario that the demo runs.
const SCENARIO: &str = include_str!("../../scenarios/rescue-flat.toml");

/// Run the built-in mission in virtual time: the rescue robot maps a furnished flat.
///
/// Everything is emulated down to the bytes on three serial lines. The PC sends waypoints through
/// the radio, the robot maps the flat, visits them in order and returns.
#[derive(Debug, Args)]
#[command(
    after_long_help = "Example:\n  hilrig demo --seed 7 --out /tmp/flat\n  # then look at /tmp/flat/map.png"
)]
pub(super) struct Demo {
    /// Seed of all randomness [default: the scenario's, 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    /// Folder for the results [default: hilrig-out/rescue-flat-SEED]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(super) fn run(args: Demo) -> Result<Verdict, CliError> {
    let path = Path::new("<built-in>/rescue-flat.toml");
    let (scenario, source) = Scenario::parse(path, SCENARIO.to_owned())?;
    let out = args
        .out
        .unwrap_or_else(|| default_out(&scenario.name, args.seed.unwrap_or(scenario.seed)));
    let ran = run::judged_run(
        scenario,
        &source,
        args.seed,
        &out,
        Clocking::Virtual,
        Talk::Story,
        &Stop::new(None)?,
    )?;
    let seed = ran.outcome.seed;
    let repeat = (!ran.outcome.passed()).then(|| format!("hilrig demo --seed {seed}"));
    let runs = vec![ran.answer(&out, repeat)];
    super::out::answer(&Runs { runs });
    Ok(ran.verdict())
}
