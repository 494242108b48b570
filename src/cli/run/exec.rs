//! A run of a foreign program, judged, its result folder written.

use core::time::Duration;
use std::path::{Path, PathBuf};

use protocols::Instant;

use super::judged::{
    Progress, Ran, Talk, cut_short, finish_capture, make_folder, print_losses, record_to,
    report_trouble, write_results,
};
use crate::capture;
use crate::cli::CliError;
use crate::cli::ends::{EndArgs, print_table};
use crate::cli::exec;
use crate::cli::show::Show;
use crate::cli::stop::Stop;
use crate::realtime::clock::{Clock, WallClock, utc};
use crate::realtime::exec::{Foreign, Trial, pc_end};
use crate::realtime::transport::{PortDir, TransportError};
use crate::robots::{self, Dut, PcEnd};
use crate::run::Run;
use crate::scenario::{Scenario, Source};

/// The surroundings of a program, besides its scenario.
pub(super) struct Placement<'a> {
    /// Folder for the results.
    pub(super) out: &'a Path,
    /// Directory of the ports [default: in the result folder].
    pub(super) dir: Option<&'a Path>,
    /// Links on real ports.
    pub(super) ends: &'a EndArgs,
    /// The page, if there is one.
    pub(super) show: &'a mut Show,
    /// Whether a page is wanted.
    pub(super) is_shown: bool,
    /// The command that repeats the run.
    pub(super) again: Option<String>,
}

/// Runs `scenario` with a foreign program and writes the result folder, also after a signal or an
/// error.
pub(super) fn judged_exec(
    scenario: Scenario,
    source: &Source,
    foreign: Foreign,
    place: Placement<'_>,
    stop: &Stop,
) -> Result<Ran, CliError> {
    let out = place.out;
    make_folder(out)?;
    let clock = WallClock::start();
    let pc = match place.is_shown {
        true => PcEnd::Scripted,
        false => pc_end(&scenario),
    };
    let wired = robots::wire_first(&scenario, source, Dut::External, pc)?;
    let mut dir = PortDir::open(&ports_in(out, place.dir)?)?;
    let (rig, instruments, seats) = place.ends.place(wired, &mut dir)?;
    print_table(&seats);
    let mut run = Run::with_team(scenario, source, (rig, instruments))?;
    record_to(
        out,
        |scenario| capture::about_live(scenario, utc()),
        &mut run,
    )?;
    place.show.begin(&mut run);
    let log = out.join("program.log");
    let command = foreign.command.clone();
    let mut trial = Trial::start(run, seats, dir, foreign, &log)?;
    let ended = follow(&mut trial, place.show, stop);
    let was_cut = cut_short(trial.run(), stop);
    let mut judged = trial.end();
    judged.outcome.checks.extend(was_cut);
    judged.outcome.again = place.again;
    let mut ran = Ran {
        outcome: judged.outcome,
        wall: clock.now() - Instant::ZERO,
        signal: stop.signal(),
        is_doubtful: false,
    };
    ran.doubt(&judged.seen.lateness);
    let ran = write_results(ran, out)?;
    println!("  {}", judged.seen.lateness);
    print_losses(&judged.seen.reports);
    let passed = ran.outcome.passed();
    exec::print(&judged.seen, passed, ran.is_doubtful, &log);
    finish_capture(judged.recorded, out, &ran.outcome, Some(&command))?;
    ended?;
    Ok(ran)
}

/// Rig time between two messages about a late rig.
const STALLS_EVERY: Duration = Duration::from_secs(1);

/// Runs until the run is over, a signal arrives or a real port is lost.
fn follow(trial: &mut Trial, show: &mut Show, stop: &Stop) -> Result<(), TransportError> {
    let mut progress = Progress::new(Talk::Verdict);
    let mut has_begun = false;
    let (mut stalls, mut told) = (0, Instant::ZERO);
    while !trial.is_over() && stop.signal().is_none() {
        trial.turn()?;
        let now = trial.now();
        show.turn(trial.run(), now);
        if trial.has_begun() && !has_begun {
            has_begun = true;
            eprintln!("  the program has opened its ports, rig time runs");
        }
        report_trouble(trial.run());
        let (count, late) = trial.stalls();
        if count > stalls && now - told >= STALLS_EVERY {
            (stalls, told) = (count, now);
            eprintln!(
                "  {now} s  the rig was {} ms late; rig time stood still meanwhile",
                late.as_millis()
            );
        }
        progress.print(trial.run(), now - Instant::ZERO);
    }
    Ok(())
}

/// The absolute directory of the ports, because the program may change its directory.
pub(in crate::cli) fn ports_in(out: &Path, dir: Option<&Path>) -> Result<PathBuf, CliError> {
    let dir = dir.map_or_else(|| out.join("ports"), Path::to_owned);
    std::path::absolute(&dir)
        .map_err(|error| CliError::Usage(format!("--dir {}: {error}", dir.display())))
}
