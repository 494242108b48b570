//! The program of `hilrig demo` alone, compiled with only the parts that the demo needs.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;

use engine::run::Run;
use engine::scenario::Scenario;
use recording::{Limits, Recording, about};
use show::{Summary, folder};

/// The scenario that the demo runs.
const SCENARIO: &str = include_str!("../scenarios/rescue-flat.toml");

/// The demo of hilrig, a hardware-in-the-loop rig for serial robots and devices.
#[derive(Debug, Parser)]
#[command(
    name = "cargo demo",
    version,
    after_help = "All commands: cargo install --path ."
)]
struct Demo {
    /// Seed of all randomness [default: the scenario's, 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    /// Folder for the results [default: hilrig-out/rescue-flat-SEED]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the demo. Exit codes: 0 all expectations hold, 1 some fail, 2 usage or set-up.
fn main() -> ExitCode {
    let Demo { seed, out } = Demo::parse();
    match run(seed, out) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

/// Runs the mission, writes its result folder and prints its verdict; returns whether it passed.
#[expect(
    clippy::disallowed_methods,
    reason = "tells how long the run took; no verdict depends on it"
)]
fn run(seed: Option<u64>, out: Option<PathBuf>) -> Result<bool, Box<dyn core::error::Error>> {
    let start = Instant::now();
    let path = Path::new("<built-in>/rescue-flat.toml");
    let (scenario, source) = Scenario::parse(path, SCENARIO.to_owned())?;
    let seed = seed.unwrap_or(scenario.seed);
    let out = out.unwrap_or_else(|| format!("hilrig-out/{}-{seed}", scenario.name).into());
    safefs::Dir::create(&out).map_err(|error| format!("{}: {error}", out.display()))?;
    let mut run = Run::new(scenario, &source, Some(seed))?;
    let scenario = run.scenario();
    let (name, duration) = (&scenario.name, scenario.duration);
    eprintln!("{name}, seed {seed}: up to {duration} of virtual time");
    let capture = out.join("capture.pcapng");
    let section = about(run.scenario());
    let recording = Recording::create(&capture, &run.rig, section, Limits::default())?;
    run.rig.add_tap(Box::new(recording));
    let mut visits = 0;
    while !run.is_over() {
        run.step();
        let mission = run.progress();
        if mission.visits().len() > visits {
            visits = mission.visits().len();
            let (now, all) = (run.rig.now(), mission.waypoints());
            eprintln!("  {now} s  waypoint {visits} of {all} visited");
        }
    }
    let recorded = run.rig.finish_taps();
    let outcome = run.judge();
    let wall = start.elapsed();
    let written = folder::write(&out, &outcome, wall);
    let folder = &out;
    print!(
        "{}",
        Summary {
            outcome: &outcome,
            wall,
            folder
        }
    );
    written?;
    recorded?;
    Ok(outcome.passed())
}
