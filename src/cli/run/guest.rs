//! A run of somebody's program in virtual time, judged, its result folder written.

use std::path::{Path, PathBuf};

use protocols::Instant;

use super::exec::{Placement, ports_in};
use super::judged::{
    Progress, Ran, Talk, cut_short, finish_capture, make_folder, record_to, report_trouble,
    write_results,
};
use crate::capture;
use crate::cli::CliError;
use crate::cli::ends::print_table;
use crate::cli::exec::show_words;
use crate::cli::stop::Stop;
use crate::realtime::clock::{Clock as _, WallClock};
use crate::realtime::exec::{Foreign, pc_end};
use crate::realtime::guest::{Played, Trial};
use crate::realtime::transport::PortDir;
use crate::robots::{self, Dut};
use crate::run::Run;
use crate::run::check::Check;
use crate::scenario::{Scenario, Source};

/// A program and how it is supervised.
pub(super) struct Guest {
    pub(super) foreign: Foreign,
    /// File for what is decided, call by call.
    pub(super) trace: Option<PathBuf>,
    /// Whether it is run twice, to see whether it does the same.
    pub(super) is_checked: bool,
}

/// Runs `scenario` with somebody's program in virtual time and writes the result folder, whatever
/// ends it.
pub(super) fn judged_guest(
    (scenario, source): (&Scenario, &Source),
    guest: &Guest,
    place: &Placement<'_>,
    stop: &Stop,
) -> Result<Ran, CliError> {
    let out = place.out;
    make_folder(out)?;
    let clock = WallClock::start();
    let mut played = play((scenario, source), guest, place, out, stop)?;
    let wall = clock.now() - Instant::ZERO;
    if guest.is_checked && stop.signal().is_none() {
        let again = out.join("again");
        make_folder(&again)?;
        let second = Guest {
            foreign: guest.foreign.clone(),
            trace: None,
            is_checked: false,
        };
        let second = play((scenario, source), &second, place, &again, stop)?;
        let check = same(&played, &second);
        played.outcome.checks.push(check);
        let _ = std::fs::remove_dir_all(&again);
    }
    let ran = Ran {
        outcome: played.outcome,
        wall,
        signal: stop.signal(),
        is_doubtful: false,
    };
    let ran = write_results(ran, out)?;
    for note in &played.notes {
        println!("  leaves virtual time: {note}");
    }
    if !ran.outcome.passed() {
        show_words(&played.said, &out.join("program.log"));
    }
    finish_capture(played.recorded, out)?;
    Ok(ran)
}

/// Whether two runs were the same.
fn same(first: &Played, second: &Played) -> Check {
    let hashes = [&first.outcome.trace_hash, &second.outcome.trace_hash];
    let parts = first.calls.part_from(&second.calls);
    let detail = match (&parts, hashes[0] == hashes[1]) {
        (None, true) => format!("twice the same bytes, {} calls", first.calls.count()),
        (Some(parts), true) => format!("the same bytes, but other calls: {parts}"),
        (parts, false) => {
            let parts = parts.as_deref().unwrap_or("no call that was seen differs");
            format!("two runs part: {parts}")
        }
    };
    Check::new("deterministic", hashes[0] == hashes[1], detail)
}

/// Runs it once; what is written while it runs goes to `out`.
fn play(
    (scenario, source): (&Scenario, &Source),
    guest: &Guest,
    place: &Placement<'_>,
    out: &Path,
    stop: &Stop,
) -> Result<Played, CliError> {
    let wired = robots::wire(scenario, source, Dut::External, pc_end(scenario))?;
    let dir = PortDir::open(&ports_in(place.out, place.dir)?)?;
    let (rig, instruments, seats) = place.ends.place(wired, &dir)?;
    if guest.is_checked || out == place.out {
        print_table(&seats);
    }
    let mut run = Run::with_rig(scenario.clone(), rig, instruments);
    record_to(
        &out.join("capture.pcapng"),
        capture::about(run.scenario()),
        &mut run,
    )?;
    let log: PathBuf = out.join("program.log");
    let (foreign, trace) = (guest.foreign.clone(), guest.trace.as_deref());
    let mut trial = Trial::start(run, seats, dir, foreign, trace, &log)?;
    let clock = WallClock::start();
    let mut progress = Progress::new(Talk::Verdict);
    let mut turned = Ok(());
    while !trial.is_over() && stop.signal().is_none() && turned.is_ok() {
        turned = trial.turn();
        report_trouble(trial.run());
        progress.print(trial.run(), clock.now() - Instant::ZERO);
    }
    let was_cut = cut_short(trial.run(), stop);
    let mut played = trial.end();
    turned?;
    played.outcome.checks.extend(was_cut);
    Ok(played)
}
