//! One run of a scenario in this process, judged, its result folder written.

use core::time::Duration;
use std::path::Path;

use protocols::Instant;

use crate::capture::{self, Conclusion, Limits, Recording, Section};
use crate::cli::answer::RunEnded;
use crate::cli::exec::show_words;
use crate::cli::progress;
use crate::cli::show::Show;
use crate::cli::stop::{Stop, name_of};
use crate::cli::{CliError, Verdict};
use crate::realtime::clock::{Clock, WallClock};
use crate::realtime::{Lateness, PortReport, Realtime, exec};
use crate::run::check::{Check, Status};
use crate::run::{Outcome, Run};
use crate::scenario::{Scenario, Source};
use crate::show::Summary;
use crate::show::folder::{self, FolderError, Metrics};
use safefs::Dir;

/// Amount of output during a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::cli) enum Talk {
    /// Prints the robot's events as they happen.
    Story,
    /// Prints the verdict only, and progress of long runs.
    Verdict,
}

/// The source of a run's time.
pub(in crate::cli) enum Clocking<'a> {
    /// Virtual time, which jumps from event to event.
    Virtual,
    /// The wall clock, and a page that may show the run.
    Realtime(&'a mut Show),
}

/// A finished run.
pub(in crate::cli) struct Ran {
    pub(in crate::cli) outcome: Outcome,
    /// Wall time of the run.
    pub(in crate::cli) wall: Duration,
    /// Number of the signal that ended the run early.
    pub(in crate::cli) signal: Option<u8>,
    /// Whether the run failed in a manner that the rig's own lateness may have caused.
    pub(in crate::cli) is_doubtful: bool,
}

impl Ran {
    /// Does not judge failed checks if the rig was too late, except facts about the program; adds a
    /// check that says so.
    pub(in crate::cli) fn doubt(&mut self, lateness: &Lateness) {
        let checks = &mut self.outcome.checks;
        let mut failed = checks.iter().filter(|check| check.status == Status::Fail);
        let is_doubted =
            failed.clone().next().is_some() && failed.all(|check| !exec::is_fact(check));
        self.is_doubtful = is_doubted && lateness.is_too_much();
        if self.is_doubtful {
            let node = self.outcome.slow_node.as_ref();
            let node = node.map_or(String::new(), |node| format!("; {node}"));
            let detail = format!("{lateness}{node}: this may be the reason for the failures");
            let checks = &mut self.outcome.checks;
            checks.insert(0, Check::not_observed("rig-on-time", detail));
        }
    }

    /// The run in the form of `--json`, with its results in `folder`.
    pub(in crate::cli) fn answer(&self, folder: &Path, repeat: Option<String>) -> RunEnded {
        let outcome = &self.outcome;
        RunEnded {
            name: outcome.case.name.clone(),
            seed: Some(outcome.seed),
            verdict: Status::of(outcome.passed()),
            checks: outcome.checks.clone(),
            metrics: Some(Metrics::of(outcome, self.wall)),
            probable_cause: outcome.probable_cause.clone(),
            trace_hash: Some(outcome.trace_hash.clone()),
            folder: Some(folder.display().to_string()),
            repeat,
        }
    }

    pub(in crate::cli) fn verdict(&self) -> Verdict {
        match (self.signal, self.outcome.passed()) {
            (Some(signal), _) => Verdict::Interrupted(signal),
            (None, true) => Verdict::Pass,
            (None, false) if self.is_doubtful => Verdict::NotJudged,
            (None, false) => Verdict::Fail,
        }
    }
}

/// The capture in a result folder.
pub(super) const CAPTURE: &str = "capture.pcapng";

/// Time without output after which a long run prints its progress.
const PATIENCE: Duration = Duration::from_secs(2);

/// Creates the result folder before the run, so that an unwritable folder does not waste a run.
pub(in crate::cli) fn make_folder(out: &Path) -> Result<(), FolderError> {
    let made = Dir::create(out).map(drop);
    made.map_err(|source| FolderError {
        path: out.to_owned(),
        source,
    })
}

/// Runs one scenario in this process and writes its result folder, also if a signal ends it early.
pub(in crate::cli) fn judged_run(
    scenario: Scenario,
    source: &Source,
    seed: Option<u64>,
    out: &Path,
    pace: Clocking<'_>,
    talk: Talk,
    stop: &Stop,
) -> Result<Ran, CliError> {
    make_folder(out)?;
    let run = Run::new(scenario, source, seed)?;
    judged_with(run, out, pace, talk, None, stop)
}

/// Runs and judges a run that is already wired. `again` is the command that repeats it with its
/// program in lockstep; `None` for the robot's own program.
pub(super) fn judged_with(
    mut run: Run,
    out: &Path,
    mut pace: Clocking<'_>,
    talk: Talk,
    again: Option<String>,
    stop: &Stop,
) -> Result<Ran, CliError> {
    make_folder(out)?;
    let clock = WallClock::start();
    record_to(out, capture::about, &mut run)?;
    if talk == Talk::Story {
        let scenario = run.scenario();
        let (name, seed, duration) = (&scenario.name, scenario.seed, scenario.duration);
        eprintln!("{name}, seed {seed}: up to {duration} of virtual time");
    }
    if let Clocking::Realtime(show) = &mut pace {
        show.begin(&mut run);
    }
    let mut realtime = Realtime::new(clock);
    let mut progress = Progress::new(talk);
    while !run.is_over() && stop.signal().is_none() {
        match &mut pace {
            Clocking::Virtual => run.step(),
            Clocking::Realtime(show) => {
                realtime.turn(&mut run)?;
                show.turn(&mut run, clock.now());
            }
        }
        report_trouble(&mut run);
        progress.print(&run, clock.now() - Instant::ZERO);
    }
    let was_cut = cut_short(&run, stop);
    let recorded = run.finish_taps();
    let mut outcome = run.judge();
    outcome.checks.extend(was_cut);
    if again.is_some() {
        outcome.probable_cause = exec::in_lockstep(&outcome);
    }
    outcome.again = again;
    let wall = clock.now() - Instant::ZERO;
    let signal = stop.signal();
    let ran = Ran {
        outcome,
        wall,
        signal,
        is_doubtful: false,
    };
    let ran = write_results(ran, out)?;
    finish_capture(recorded, out, &ran.outcome, None)?;
    if matches!(pace, Clocking::Realtime(_)) {
        println!("  {}", realtime.lateness());
    }
    Ok(ran)
}

/// Prints the progress of a run from time to time.
pub(super) struct Progress {
    talk: Talk,
    visits: usize,
    said: Duration,
}

impl Progress {
    pub(super) const fn new(talk: Talk) -> Self {
        Self {
            talk,
            visits: 0,
            said: Duration::ZERO,
        }
    }

    /// Checks `run` at `elapsed` of the wall clock. Progress and remaining time are printed only on
    /// a terminal.
    pub(super) fn print(&mut self, run: &Run, elapsed: Duration) {
        let mission = run.progress();
        let is_new = mission.visits().len() > self.visits;
        self.visits = mission.visits().len();
        let is_due = elapsed.saturating_sub(self.said) >= PATIENCE;
        let is_watched = is_due && progress::is_watched();
        if (self.talk == Talk::Story && is_new) || is_watched {
            self.said = elapsed;
            let mode = run.rig.program().map_or("", |program| program.mode());
            let (now, visits, all) = (run.rig.now(), self.visits, mission.waypoints());
            let done = now - Instant::ZERO;
            let share = done.as_secs_f64() / run.scenario().duration.0.as_secs_f64();
            // The share refers to the maximum time; the run may end earlier.
            let left = match is_watched {
                true => progress::left(elapsed, share).replace("about", "at most about"),
                false => String::new(),
            };
            eprintln!("  {now} s  waypoint {visits} of {all} visited  {mode}{left}");
        }
    }
}

/// The verdict on a run that a signal ended early: the missing part is unknown, so it cannot pass.
pub(super) fn cut_short(run: &Run, stop: &Stop) -> Option<Check> {
    let signal = stop.signal().filter(|_| !run.is_over())?;
    let name = name_of(signal);
    let (now, all) = (run.rig.now(), run.scenario().duration);
    let detail = format!("ended by {name} at {now} s, expected to run for {all}");
    Some(Check::new("ran-to-its-end", false, detail))
}

/// Reports a capture error immediately, while disk space can still be freed.
pub(super) fn report_trouble(run: &mut Run) {
    if let Some(trouble) = run.take_tap_trouble() {
        eprintln!("  {trouble}");
    }
}

/// Prints the ports that lost bytes because the program did not read them.
pub(super) fn print_losses(reports: &[PortReport]) {
    for report in reports.iter().filter(|report| report.lost.overrun > 0) {
        let (name, lost) = (&report.name, report.lost.overrun);
        println!("  port {name}: {lost} B lost because the program did not read");
    }
}

/// Writes the end of the run into the capture in `out`, if the capture is complete, and into those
/// of the further robots; `command` is that of the foreign program.
pub(super) fn finish_capture(
    recorded: std::io::Result<()>,
    out: &Path,
    outcome: &Outcome,
    command: Option<&str>,
) -> Result<(), FolderError> {
    let path = out.join(CAPTURE);
    let concluded = recorded.and_then(|()| Conclusion::of(outcome, command).append(&path));
    concluded.map_err(|source| FolderError { path, source })?;
    for (name, member) in &outcome.team {
        finish_capture(Ok(()), &folder::of_member(out, name)?, member, None)?;
    }
    Ok(())
}

/// Writes the result folder of a run and prints its verdicts.
pub(in crate::cli) fn write_results(ran: Ran, out: &Path) -> Result<Ran, FolderError> {
    let written = folder::write(out, &ran.outcome, ran.wall);
    // Printed even if the disk is full, because the result is known.
    print_summary(&ran.outcome, ran.wall, out);
    let words = ran.outcome.node_words.iter();
    if let Some(slow) = &ran.outcome.slow_node {
        println!("  {slow}");
    }
    for (name, words) in words.filter(|_| !ran.outcome.passed()) {
        let log = out.join(format!("node-{name}.log"));
        show_words(&format!("node program {name}"), words, &log);
    }
    written?;
    Ok(ran)
}

/// Makes `run`, and the further robots in it, write their captures; the result folder is `out`.
pub(super) fn record_to(
    out: &Path,
    about: impl Fn(&Scenario) -> Section,
    run: &mut Run,
) -> Result<(), FolderError> {
    record_one(out, &about, run)?;
    for member in run.team_mut() {
        let out = folder::of_member(out, &member.name)?;
        record_one(&out, &about, &mut member.run)?;
    }
    Ok(())
}

fn record_one(
    out: &Path,
    about: impl Fn(&Scenario) -> Section,
    run: &mut Run,
) -> Result<(), FolderError> {
    let path = out.join(CAPTURE);
    let recording = Recording::create(&path, &run.rig, about(run.scenario()), Limits::default());
    let recording = recording.map_err(|source| FolderError { path, source })?;
    run.rig.add_tap(Box::new(recording));
    Ok(())
}

fn print_summary(outcome: &Outcome, wall: Duration, folder: &Path) {
    let summary = Summary {
        outcome,
        wall,
        folder,
    };
    for line in summary.to_string().lines() {
        println!("{line}");
    }
}
