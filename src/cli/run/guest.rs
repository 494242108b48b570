//! A run of a foreign program in virtual time, judged, its result folder written.

use core::time::Duration;
use std::path::{Path, PathBuf};

use protocols::Instant;

use super::exec::{Placement, ports_in};
use super::judged::{
    Progress, Ran, Talk, cut_short, finish_capture, make_folder, print_losses, record_to,
    report_trouble, write_results,
};
use super::twice::{LOG, same};
use crate::capture;
use crate::cli::CliError;
use crate::cli::ends::{EndArgs, print_table};
use crate::cli::exec::{is_bare, show_words};
use crate::cli::stop::Stop;
use crate::realtime::Place;
use crate::realtime::clock::{Clock as _, WallClock};
use crate::realtime::control::Control;
use crate::realtime::exec::{Cpu, Foreign, Seat, pc_end};
use crate::realtime::guest::{GuestError, Played, Trial};
use crate::realtime::transport::PortDir;
use crate::robots::{self, Dut, PcEnd, Wired};
use crate::run::{Run, wire_members};
use crate::scenario::{Scenario, Source};
use safefs::Dir;

/// A program and how it is supervised.
pub(super) struct Guest {
    pub(super) foreign: Foreign,
    /// File for the answer to each call.
    pub(super) trace: Option<PathBuf>,
    /// Whether the program is run twice to compare the runs.
    pub(super) is_checked: bool,
    /// Whether clients of the control socket decide when time passes.
    pub(super) is_controlled: bool,
}

/// Runs `scenario` with a foreign program in virtual time and writes the result folder, also after
/// a signal or an error.
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
        let mut foreign = guest.foreign.clone();
        if let Some(supervision) = &mut foreign.supervision {
            supervision.cpu = supervision.cpu.map(|_| Cpu::OfCase);
        }
        let second = Guest {
            foreign,
            trace: None,
            is_checked: false,
            is_controlled: false,
        };
        // Both runs charge the same for computing.
        let mut scenario = scenario.clone();
        scenario
            .computing
            .clone_from(&played.outcome.case.computing);
        let second = play((&scenario, source), &second, place, &again, stop)?;
        let check = same(&played, &second, [out, &again]);
        played.outcome.checks.push(check);
        let _ = Dir::open(out).and_then(|out| out.remove_tree("again"));
    }
    played.outcome.again.clone_from(&place.again);
    report(played, wall, &guest.foreign.command, out, stop)
}

/// Writes the result folder of a finished run and prints the result.
pub(in crate::cli) fn report(
    played: Played,
    wall: Duration,
    command: &str,
    out: &Path,
    stop: &Stop,
) -> Result<Ran, CliError> {
    let ran = Ran {
        outcome: played.outcome,
        wall,
        signal: stop.signal(),
        is_doubtful: false,
    };
    let ran = write_results(ran, out)?;
    println!("  {}", played.spent);
    print_losses(&played.reports);
    for note in &played.notes {
        println!("  leaves virtual time: {note}");
    }
    if !ran.outcome.passed() {
        show_words("the program", &played.said, &out.join(LOG));
    }
    finish_capture(played.recorded, out, &ran.outcome, Some(command))?;
    Ok(ran)
}

/// A program and its places, to be started.
pub(in crate::cli) struct Beginning<'a> {
    pub(in crate::cli) foreign: &'a Foreign,
    /// File for the answer to each call.
    pub(in crate::cli) trace: Option<&'a Path>,
    pub(in crate::cli) ends: &'a EndArgs,
    /// Directory of the ports.
    pub(in crate::cli) ports: &'a Path,
    /// Folder for the results.
    pub(in crate::cli) out: &'a Path,
    /// Whether the table of ports is printed.
    pub(in crate::cli) is_first: bool,
}

impl Beginning<'_> {
    /// Starts the program in front of the rig of `scenario`.
    pub(in crate::cli) fn begin(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Trial, CliError> {
        let (trial, _) = self.begin_with(scenario, source, false)?;
        Ok(trial)
    }

    /// The rig of the first robot. If all programs are those of other robots, it has its built-in
    /// program.
    fn first_robot(&self, scenario: &Scenario, source: &Source) -> Result<Wired, CliError> {
        let is_own = is_of_others(self.foreign) && !is_bare(scenario, source)?;
        let (dut, pc) = match is_own {
            true => (Dut::Internal, PcEnd::Scripted),
            false => (Dut::External, pc_end(scenario)),
        };
        Ok(robots::wire_first(scenario, source, dut, pc)?)
    }

    /// The same with a control socket, if `is_controlled`.
    fn begin_with(
        &self,
        scenario: &Scenario,
        source: &Source,
        is_controlled: bool,
    ) -> Result<(Trial, Option<Control>), CliError> {
        let wired = self.first_robot(scenario, source)?;
        let mut members = wire_members(scenario, source, Dut::External)?;
        let ends = members
            .iter_mut()
            .flat_map(|member| core::mem::take(&mut member.open_ends));
        let ends = ends.collect();
        let mut dir = PortDir::open(self.ports)?;
        let (rig, instruments, seats) = self.ends.place_all(wired, ends, &mut dir)?;
        if self.is_first {
            print_table(&seats);
        }
        let control = match is_controlled {
            true => Some(control_of(&dir, &seats)?),
            false => None,
        };
        let first = (rig, instruments);
        let mut run = Run::with_members(scenario.clone(), source, first, members)?;
        record_to(self.out, capture::about, &mut run)?;
        let log = self.out.join(LOG);
        let foreign = self.foreign.clone();
        let trial = Trial::start(run, seats, dir, foreign, self.trace, &log)?;
        Ok((trial, control))
    }
}

/// Whether all programs of `foreign` are those of further robots.
fn is_of_others(foreign: &Foreign) -> bool {
    let others = foreign.others.iter().map(|one| one.robot);
    core::iter::once(foreign.robot)
        .chain(others)
        .all(|robot| robot > 0)
}

/// The control socket of a run with the ports `seats` in `dir`.
fn control_of(dir: &PortDir, seats: &[Seat]) -> Result<Control, CliError> {
    let mut control = Control::open(dir)?;
    // Its requests are about the first robot.
    let seats = seats.iter().filter(|seat| seat.end.robot == 0);
    control.offer(seats.map(|seat| Place {
        name: &seat.end.name,
        path: seat.transport.path(),
        baud: seat.end.line.baud,
        node: seat.end.node,
    }));
    Ok(control)
}

/// Runs the program once; its output goes to `out`.
fn play(
    (scenario, source): (&Scenario, &Source),
    guest: &Guest,
    place: &Placement<'_>,
    out: &Path,
    stop: &Stop,
) -> Result<Played, CliError> {
    let ports = ports_in(place.out, place.dir)?;
    let begun = Beginning {
        foreign: &guest.foreign,
        trace: guest.trace.as_deref(),
        ends: place.ends,
        ports: &ports,
        out,
        is_first: guest.is_checked || out == place.out,
    };
    let (mut trial, mut control) = begun.begin_with(scenario, source, guest.is_controlled)?;
    let clock = WallClock::start();
    let mut progress = Progress::new(Talk::Verdict);
    let mut turned = Ok(());
    let has_quit = |control: &Option<Control>| control.as_ref().is_some_and(Control::has_quit);
    while !trial.is_over() && stop.signal().is_none() && turned.is_ok() && !has_quit(&control) {
        turned = match &mut control {
            Some(control) => controlled_turns(&mut trial, control, &clock),
            None => trial.turns(),
        };
        report_trouble(trial.run());
        progress.print(trial.run(), clock.now() - Instant::ZERO);
    }
    // Before the directory of the ports.
    drop(control);
    let was_cut = cut_short(trial.run(), stop);
    let mut played = trial.end();
    turned?;
    played.outcome.checks.extend(was_cut);
    Ok(played)
}

/// Wall time between two looks at the program's output and at signals.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// Wall time between two looks at a socket without requests.
const REQUEST_EVERY: Duration = Duration::from_millis(1);

/// Takes turns while clients wait, and executes their requests between two turns. Each change of
/// a client that waits for conditions has the same virtual time in every run.
fn controlled_turns(
    trial: &mut Trial,
    control: &mut Control,
    clock: &WallClock,
) -> Result<(), GuestError> {
    let until = clock.now() + LOOK_EVERY;
    while clock.now() < until && !trial.is_over() {
        control.hear();
        let now = trial.now();
        control.serve(trial.run(), None, now);
        if control.has_quit() {
            break;
        }
        match (control.is_awaited(), control.is_deserted()) {
            (true, _) => trial.turn()?,
            (false, true) => return trial.turns(),
            (false, false) => clock.sleep_until(clock.now() + REQUEST_EVERY),
        }
    }
    Ok(())
}
