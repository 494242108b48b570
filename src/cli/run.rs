use core::time::Duration;
use std::path::{Path, PathBuf};

use clap::Args;
use protocols::Instant;

use super::show::{Show, ShowArgs};
use super::{CliError, Verdict, default_out};
use crate::capture::case::{Case, Judgement};
use crate::capture::{self, Limits, Recording};
use crate::realtime::Realtime;
use crate::realtime::clock::{Clock, WallClock};
use crate::run::{Outcome, Run};
use crate::scenario::{Scenario, ScenarioError, Source};
use crate::show::folder::{self, FolderError, Metrics, Suite};

/// Run scenarios and judge them, for CI.
///
/// Each run leaves a result folder. When something fails, the one command that repeats the case is
/// printed.
#[derive(Debug, Args)]
#[command(
    after_long_help = "Examples:\n  hilrig run scenarios/rescue-flat.toml\n  \
    hilrig run scenarios/*.toml --junit junit.xml\n  \
    hilrig run hilrig-out/rescue-flat-1/case.toml   # a saved case: the same bytes again"
)]
pub(super) struct RunArgs {
    /// Scenario files, or saved cases: of runs, or of bytes
    #[arg(required = true, value_name = "SCENARIO")]
    scenarios: Vec<PathBuf>,
    /// Seed in place of the scenarios' own
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    /// Folder for the results; with several scenarios, one folder in it for each
    /// [default: hilrig-out/NAME-SEED]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// At the pace of the wall clock instead of as fast as possible; the verdicts are the same
    #[arg(long)]
    realtime: bool,
    #[command(flatten)]
    show: ShowArgs,
    /// Write the verdicts of all runs as JUnit XML
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
}

pub(super) fn run(args: RunArgs) -> Result<Verdict, CliError> {
    // All files are read before the first run, so that a typing error in the last one is not
    // found out after an hour.
    let files = args
        .scenarios
        .iter()
        .map(|path| Ok((path, Runnable::read(path)?)));
    let files = files.collect::<Result<Vec<_>, CliError>>()?;
    if args.show.is_wanted() && !args.realtime {
        let expected = "--ui: expected --realtime beside it; \"hilrig ui\" runs at any speed";
        return Err(CliError::Other(expected.to_owned()));
    }
    let mut show = args.show.start()?;
    let several = files.len() > 1;
    let mut ended = Vec::new();
    let mut wall = Duration::ZERO;
    for (path, file) in files {
        let (scenario, source) = match file {
            Runnable::Scenario(scenario) => *scenario,
            Runnable::Case(case) => {
                let judgement = case.0.run(&case.1);
                let judgement = judgement.map_err(|error| CliError::Other(error.to_string()))?;
                println!("{judgement}");
                ended.push(Ended::Case(judgement));
                continue;
            }
        };
        let seed = args.seed.unwrap_or(scenario.seed);
        let out = match &args.out {
            Some(out) if several => out.join(format!("{}-{seed}", scenario.name)),
            Some(out) => out.clone(),
            None => default_out(&scenario.name, seed),
        };
        let pace = match args.realtime {
            true => Pace::Realtime(&mut show),
            false => Pace::Virtual,
        };
        let ran = judged_run(scenario, &source, args.seed, &out, pace, Talk::Verdict)?;
        wall += ran.wall;
        if !ran.outcome.passed() {
            eprintln!("repeat with: hilrig run {} --seed {seed}", path.display());
        }
        ended.push(Ended::Run(Box::new(ran.outcome)));
    }
    if let Some(path) = args.junit {
        let text = folder::junit(ended.iter().map(Ended::suite), wall);
        std::fs::write(&path, text).map_err(|source| FolderError { path, source })?;
    }
    Ok(if ended.iter().all(Ended::passed) {
        Verdict::Pass
    } else {
        Verdict::Fail
    })
}

/// A file that can be run.
enum Runnable {
    Scenario(Box<(Scenario, Source)>),
    /// Bytes of a capture.
    Case(Box<(Case, Source)>),
}

impl Runnable {
    fn read(path: &Path) -> Result<Self, CliError> {
        let text = std::fs::read_to_string(path).map_err(|source| {
            let path = path.to_owned();
            ScenarioError::Read { path, source }
        })?;
        if !Case::is_meant(&text) {
            return Ok(Self::Scenario(Box::new(Scenario::parse(path, text)?)));
        }
        let case = Case::parse(path, text).map_err(|error| CliError::Other(error.to_string()))?;
        Ok(Self::Case(Box::new(case)))
    }
}

/// What was run.
enum Ended {
    Run(Box<Outcome>),
    Case(Judgement),
}

impl Ended {
    fn passed(&self) -> bool {
        match self {
            Self::Run(outcome) => outcome.passed(),
            Self::Case(judgement) => judgement.passed(),
        }
    }

    fn suite(&self) -> Suite<'_> {
        match self {
            Self::Run(outcome) => Suite::from(&**outcome),
            Self::Case(Judgement { name, checks, .. }) => {
                let seed = None;
                Suite { name, seed, checks }
            }
        }
    }
}

/// How much is said while a run goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Talk {
    /// What the robot does, as it does it.
    Story,
    /// The verdict only, and progress when it takes long.
    Verdict,
}

/// What moves a run's clock.
pub(super) enum Pace<'a> {
    /// Jumps from event to event.
    Virtual,
    /// The wall clock, and a page on which the run may be shown.
    Realtime(&'a mut Show),
}

/// A finished run.
pub(super) struct Ran {
    pub(super) outcome: Outcome,
    pub(super) wall: Duration,
}

/// Time of silence after which a long run says how far it is.
const PATIENCE: Duration = Duration::from_secs(2);

/// Runs one scenario in this process and writes its result folder.
pub(super) fn judged_run(
    scenario: Scenario,
    source: &Source,
    seed: Option<u64>,
    out: &Path,
    mut pace: Pace<'_>,
    talk: Talk,
) -> Result<Ran, CliError> {
    // Before the run: a folder that cannot be written must not cost a whole run.
    let make = std::fs::create_dir_all(out);
    make.map_err(|source| FolderError {
        path: out.to_owned(),
        source,
    })?;
    let clock = WallClock::start();
    let mut run = Run::new(scenario, source, seed)?;
    let capture = out.join("capture.pcapng");
    record_to(&capture, &mut run)?;
    let name = run.scenario().name.clone();
    let seed = run.scenario().seed;
    if talk == Talk::Story {
        eprintln!(
            "{name}, seed {seed}: up to {} of virtual time",
            run.scenario().duration
        );
    }
    if let Pace::Realtime(show) = &mut pace {
        show.begin(&mut run);
    }
    let mut realtime = Realtime::new(clock);
    let (mut visits, mut said) = (0, Duration::ZERO);
    while !run.is_over() {
        match &mut pace {
            Pace::Virtual => run.step(),
            Pace::Realtime(show) => {
                realtime.turn(&mut run)?;
                show.turn(&mut run, clock.now());
            }
        }
        let progress = run.progress();
        let elapsed = clock.now() - Instant::ZERO;
        let new_visit = progress.visits().len() > visits;
        visits = progress.visits().len();
        if (talk == Talk::Story && new_visit) || elapsed - said >= PATIENCE {
            said = elapsed;
            let mode = run.rig.program().map_or("", |program| program.mode());
            let (now, all) = (run.rig.now(), progress.waypoints());
            eprintln!("  {now} s  waypoint {visits} of {all} visited  {mode}");
        }
    }
    let recorded = run.rig.finish_taps();
    recorded.map_err(|source| FolderError {
        path: capture,
        source,
    })?;
    let outcome = run.judge();
    let wall = clock.now() - Instant::ZERO;
    folder::write(out, &outcome, wall)?;
    print_summary(&outcome, wall, out);
    if matches!(pace, Pace::Realtime(_)) {
        println!("  {}", realtime.lateness());
    }
    Ok(Ran { outcome, wall })
}

/// Makes `run` write its capture.
fn record_to(path: &Path, run: &mut Run) -> Result<(), FolderError> {
    let about = capture::about(run.scenario());
    let recording = Recording::create(path, &run.rig, about, Limits::default());
    let recording = recording.map_err(|source| FolderError {
        path: path.to_owned(),
        source,
    })?;
    run.rig.add_tap(Box::new(recording));
    Ok(())
}

fn print_summary(outcome: &Outcome, wall: Duration, out: &Path) {
    let metrics = Metrics::of(outcome, wall);
    let verdict = if outcome.passed() { "PASS" } else { "FAIL" };
    println!("{verdict} {} seed {}", outcome.case.name, outcome.seed);
    for check in &outcome.checks {
        println!("  {check}");
    }
    let (sim_s, wall_s) = (metrics.sim_s, metrics.wall_s);
    println!(
        "  {sim_s:.1} s simulated in {wall_s:.2} s, {:.0} times real time",
        metrics.speedup
    );
    if let Some(error) = outcome.pose_error {
        let (mm, deg) = (error.rms_mm, error.rms_deg);
        println!(
            "  pose error {mm:.1} mm and {deg:.2} deg RMS, at worst {:.1} mm",
            error.max_mm
        );
    }
    println!("  trace {}", outcome.trace_hash);
    println!("  results in {}", out.display());
}
