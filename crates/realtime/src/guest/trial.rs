//! A run of a foreign program in virtual time: its start, run and end, and its judgement by the
//! same checks as in real time.

mod checks;
mod environment;
mod processor;
mod rewind;

use core::time::Duration;
use std::fs::File;
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::ExitStatus;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use protocols::Instant;
use rustix::process::{Pid, Signal, kill_process_group};
use rustix::thread::{CpuSet, sched_setaffinity};

use super::computing::Computing;
use super::stage::Stage;
use super::supervisor::{Settings, Supervisor};
use super::trace::Calls;
use super::{GuestError, launch};
use crate::clock::counter::Hidden;
use crate::clock::{Clock as _, SimClock, WallClock};
use crate::exec::{Ending, ExecError, Foreign, SETTLE, Seat, ports_of};
use crate::process::waits::{Wait, waits};
use crate::process::words::{Words, listen};
use crate::process::{Ended, Farewell, Left, command_of};
use crate::transport::{Note, PortDir};
use crate::{PortReport, Realtime, Sign};
use engine::rig::Paced as _;
use engine::run::check::Check;
use engine::run::{Outcome, Run};
use engine::scenario::Scenario;
use environment::environment_of;
use processor::stay_here;
pub use rewind::TrialMoment;

/// Virtual time within which a program must end after a request, and then its child processes.
const PATIENCE: Duration = Duration::from_secs(2);
const TOGETHER: Duration = Duration::from_millis(100);
const PATIENCE_CHILDREN: Duration = Duration::from_secs(1);
/// The same limit in wall time.
const PATIENCE_WALL: Duration = Duration::from_secs(5);
/// Maximum number of turns between two checks whether the run must end. The watchdog ends the turns
/// after 50 ms of wall time.
const TURNS_MAX: u32 = 10_000;
/// Maximum wait for the program's last output.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// A foreign program and its run.
pub struct Trial {
    supervisor: Supervisor,
    programs: Vec<Started>,
    dir: PortDir,
    foreign: Foreign,
    words: Arc<Mutex<Words>>,
    listener: JoinHandle<()>,
    /// Time at which the last client left the ports, in the program's time.
    gone_at: Option<Instant>,
    /// The thread that computes without a system call.
    spins: Option<String>,
    /// The set of processors on which this thread may run.
    processors: Option<CpuSet>,
}

/// One of the programs.
struct Started {
    name: String,
    /// Its first process.
    root: i32,
    /// Its end, and rig time at that moment.
    ended: Option<(Ended, Instant)>,
}

/// Result of a supervised program.
pub struct Played {
    /// The run; its first checks are about the program.
    pub outcome: Outcome,
    /// Whether the captures of the run were written.
    pub recorded: io::Result<()>,
    /// The last part of the program's output.
    pub said: String,
    /// Notes about actions outside of virtual time.
    pub notes: Vec<String>,
    /// Summary of the program's calls, as text.
    pub spent: String,
    /// The decisions, call by call.
    pub calls: Calls,
    /// Traffic of each port.
    pub reports: Vec<PortReport>,
}

impl Trial {
    /// Starts the program on the ports of `run`, whose ends are on `seats`. The program's output is
    /// written to `log`, the decisions call by call to `trace`.
    ///
    /// # Errors
    /// If it cannot be started or supervised, or needs a port that does not exist.
    pub fn start(
        mut run: Run,
        seats: Vec<Seat>,
        mut dir: PortDir,
        foreign: Foreign,
        trace: Option<&Path>,
        log: &Path,
    ) -> Result<Self, GuestError> {
        dir.leave_note(Note::Scenario, &run.scenario().to_toml())?;
        for member in run.team() {
            let text = member.run.scenario().to_toml();
            dir.leave_note_in(&member.name, Note::Scenario, &text)?;
        }
        let ports = ports_of(&seats, &foreign)?;
        let supervision = foreign.supervision.ok_or(GuestError::NotHere)?;
        let computing = Computing::of(supervision.cpu, run.scenario())?;
        let robots = 0..=run.team().len();
        let envs: Vec<_> = robots
            .map(|robot| environment_of(&seats, &dir, &run, robot))
            .collect();
        let mut realtime = Realtime::new(SimClock::default());
        for seat in seats {
            realtime.serve(seat.end, seat.transport);
        }
        let scenarios: Vec<Scenario> = run.scenarios().cloned().collect();
        for (robot, scenario) in scenarios.iter().enumerate() {
            realtime.plug_in_of(robot, scenario, run.rig_of_mut(robot));
        }
        let not_started = |error| GuestError::Exec(ExecError::NotStarted(error));
        let words = Words::new(Some(safefs::create(log).map_err(not_started)?));
        let (ears, mouth) = io::pipe().map_err(not_started)?;
        let mouth = File::from(std::os::fd::OwnedFd::from(mouth));
        let pipe = mouth.metadata().map_err(not_started)?;
        let processors = stay_here();
        let mut programs = Vec::new();
        let first = (&foreign.name, &foreign.command, foreign.robot);
        let others = foreign.others.iter();
        let others = others.map(|one| (&one.name, &one.command, one.robot));
        for (name, command, robot) in core::iter::once(first).chain(others) {
            let mouth = mouth.try_clone().map_err(not_started)?;
            let child = launch::start(command, &envs[robot], mouth).map_err(not_started)?;
            programs.push(Started {
                name: name.clone(),
                root: i32::try_from(child.id()).unwrap_or_default(),
                ended: None,
            });
        }
        drop(mouth);
        let hearing = Arc::clone(&words);
        let listener = thread::spawn(move || listen(ears, &hearing));
        let seed = run.scenario().seed;
        let settings = Settings { seed, supervision };
        let stage = Stage::new(run, realtime, ports, foreign.wait, (pipe.dev(), pipe.ino()));
        let roots: Vec<i32> = programs.iter().map(|one| one.root).collect();
        Ok(Self {
            supervisor: Supervisor::new(&roots, stage, settings, computing, trace)?,
            programs,
            dir,
            foreign,
            words,
            listener,
            gone_at: None,
            spins: None,
            processors,
        })
    }

    /// The run.
    pub fn run(&mut self) -> &mut Run {
        self.supervisor.stage.forget_foreseen();
        &mut self.supervisor.stage.run
    }

    /// All threads of the program, and the rig.
    pub(super) const fn supervisor(&mut self) -> &mut Supervisor {
        &mut self.supervisor
    }

    /// The same, for reading.
    pub(super) const fn supervisor_ref(&self) -> &Supervisor {
        &self.supervisor
    }

    /// Whether the run is over.
    pub fn is_over(&self) -> bool {
        let stage = &self.supervisor.stage;
        let is_gone = self
            .gone_at
            .is_some_and(|at| !stage.has_begun() || stage.now() - at >= SETTLE);
        stage.run.is_over() || stage.gave_up() || is_gone || self.spins.is_some()
    }

    /// Takes turns until the run is over, or for some milliseconds of wall time.
    ///
    /// # Errors
    /// As [`turn`](Self::turn).
    pub fn turns(&mut self) -> Result<(), GuestError> {
        let _hidden = self.supervisor.hides_counter.then(Hidden::begin);
        let beats = self.supervisor.beats();
        for _ in 0..TURNS_MAX {
            self.turn()?;
            if self.is_over() || self.supervisor.beats() != beats {
                break;
            }
        }
        Ok(())
    }

    /// Lets a thread run until it waits, or lets time pass.
    ///
    /// # Errors
    /// If a real port went away, or the program cannot be supervised.
    pub fn turn(&mut self) -> Result<(), GuestError> {
        match self.supervisor.turn() {
            Err(
                error @ (GuestError::Spins(..) | GuestError::Stands(..) | GuestError::Overwritten),
            ) => self.spins = Some(error.to_string()),
            done => done?,
        }
        let stage = &self.supervisor.stage;
        let now = stage.run.rig.now();
        for program in self.programs.iter_mut().filter(|one| one.ended.is_none()) {
            let Some(status) = self.supervisor.status(program.root) else {
                continue;
            };
            let ended = Ended::of(ExitStatus::from_raw(status));
            let is_launched = self.supervisor.is_launched(program.root);
            if ended == Ended::Code(launch::NOT_LAUNCHED) && !is_launched {
                return Err(GuestError::NotLaunched(self.said()));
            }
            program.ended = Some((ended, now));
        }
        if self.is_gone() && self.gone_at.is_none() {
            self.gone_at = Some(self.supervisor.stage.now());
        }
        Ok(())
    }

    /// Whether a required program has ended, or all programs have ended and left no port open.
    fn is_gone(&self) -> bool {
        let is_wrong = |one: &Started| {
            let may_end = self.foreign.may_end_of(&one.name);
            one.ended
                .is_some_and(|(ended, _)| !(may_end && ended == Ended::Code(0)))
        };
        let are_all_gone = self.programs.iter().all(|one| one.ended.is_some());
        self.programs.iter().any(is_wrong)
            || are_all_gone && !self.supervisor.stage.ports.any_open()
    }

    /// Lets the run continue after its mission is over.
    pub const fn make_endless(&mut self) {
        self.supervisor.stage.is_endless = true;
    }

    /// Starts rig time, if it has not started yet.
    pub fn begin(&mut self) {
        self.supervisor.stage.begin();
    }

    /// Whether rig time runs.
    pub const fn has_begun(&self) -> bool {
        self.supervisor.stage.has_begun()
    }

    /// The program's time since it was started.
    pub fn waited(&self) -> Duration {
        self.supervisor.stage.now() - Instant::ZERO
    }

    /// Rig time.
    pub const fn now(&self) -> Instant {
        self.supervisor.stage.run.rig.now()
    }

    /// Observations of the program at its ports.
    pub fn signs(&mut self) -> impl Iterator<Item = Sign<'_>> {
        self.supervisor.stage.realtime.signs()
    }

    /// The end of the program; of several programs, the one that ended first.
    pub fn ended(&self) -> Option<Ended> {
        self.first_end().map(|(ended, _)| ended)
    }

    /// The end of the program and its time; of several programs, the one that ended first.
    fn first_end(&self) -> Option<(Ended, Instant)> {
        let ends = self.programs.iter().filter_map(|one| one.ended);
        ends.min_by_key(|(_, at)| *at)
    }

    /// The place of the program when a signal such as SIGSEGV came.
    pub fn fault(&self) -> Option<&str> {
        self.supervisor.fault()
    }

    /// The thread that computes without a system call.
    pub fn spins(&self) -> Option<&str> {
        self.spins.as_deref()
    }

    /// Ends the program without a verdict; returns its output, and the run.
    pub fn quit(mut self) -> (String, Run) {
        let farewell = self.finish();
        let mut run = self.supervisor.stage.run;
        // The capture is only for the user; an error while writing it must not lose the case.
        let _ = run.finish_taps();
        (farewell.said, run)
    }

    /// Ends the program at once. Nothing of its run is kept except the charges for its computing.
    pub(super) fn abandon(mut self) -> Option<Computing> {
        let computing = self.supervisor.computing().cloned();
        self.supervisor.stage.is_frozen = true;
        self.supervisor.kill_all();
        self.is_silent();
        if let Ok(mut words) = self.words.lock() {
            words.close();
        }
        if let Some(processors) = &self.processors {
            let _ = sched_setaffinity(None, processors);
        }
        let _ = self.supervisor.stage.run.finish_taps();
        computing
    }

    /// Ends the program and judges the run so far.
    pub fn end(mut self) -> Played {
        let is_over = self.supervisor.stage.run.is_over();
        self.supervisor.note_halted();
        let computing = self.supervisor.computing();
        let repeats = computing.and_then(Computing::check);
        // A case keeps its own record: a changed program would give another record each time.
        let spec = computing.filter(|it| it.measures()).map(Computing::spec);
        let waits = self.waits();
        let ended = self.first_end();
        let each = self
            .programs
            .iter()
            .map(|one| (one.name.clone(), one.ended));
        let each = each.collect();
        let farewell = self.finish();
        let notes = self.supervisor.notes().to_vec();
        let spent = self.supervisor.spent_on();
        let Supervisor { stage, calls, .. } = self.supervisor;
        let Stage {
            mut run,
            realtime,
            ports,
            busy,
            ..
        } = stage;
        spec.into_iter().for_each(|spec| run.set_computing(spec));
        let recorded = run.finish_taps();
        let reports = realtime.reports().collect();
        // The ports exist until the program has ended, so that it does not notice their end.
        drop((realtime, self.dir));
        let mut outcome = run.judge();
        let spins = self.spins.or(busy);
        let ending = Ending {
            ports: &ports,
            foreign: &self.foreign,
            ended,
            each,
            waits: &waits,
            farewell: &farewell,
            is_over,
            more: spins.map(|spins| Check::new("program-yields", false, spins)),
        };
        ending.conclude(&mut outcome);
        outcome.checks.extend(repeats);
        Played {
            outcome,
            recorded,
            said: farewell.said,
            notes,
            spent,
            calls,
            reports,
        }
    }

    /// The events for which the program's threads wait.
    fn waits(&self) -> Vec<Wait> {
        waits(self.processes())
    }

    /// Ends the program.
    fn finish(&mut self) -> Farewell {
        // The rig may not have seen the program's last actions.
        let _ = self.supervisor.stage.carry();
        self.supervisor.stage.look();
        self.supervisor.stage.is_frozen = true;
        self.supervisor.end_all_delays();
        let (left, was_killed) = self.stop();
        let end = |one: &Started| {
            let status = self.supervisor.status(one.root);
            let status = status.filter(|_| one.ended.is_none() && !was_killed)?;
            Some(Ended::when_asked(status, &self.supervisor.last_ends))
        };
        let ends = self.programs.iter().map(end).collect();
        self.is_silent();
        let said = self.said();
        if let Ok(mut words) = self.words.lock() {
            words.close();
        }
        if let Some(processors) = &self.processors {
            let _ = sched_setaffinity(None, processors);
        }
        Farewell {
            said,
            left,
            was_killed,
            ends,
        }
    }

    /// Ends the program and its child processes: first by a request, then by SIGKILL. Returns the
    /// processes that were left behind, and whether the program itself was killed.
    fn stop(&mut self) -> (Vec<Left>, bool) {
        let is_running = !self.supervisor.have_all_ended();
        let mut left = match is_running {
            true => Vec::new(),
            false => self.others(),
        };
        for group in self
            .programs
            .iter()
            .filter_map(|one| Pid::from_raw(one.root))
        {
            let _ = kill_process_group(group, Signal::TERM);
        }
        self.supervisor.expect_signals();
        let mut was_killed = false;
        if is_running {
            self.go_on(PATIENCE, Supervisor::have_all_ended);
            was_killed = !self.supervisor.have_all_ended();
            if !was_killed {
                self.go_on(TOGETHER, |it| !it.is_anybody_there());
                left = self.others();
            }
        }
        if !was_killed {
            self.go_on(PATIENCE_CHILDREN, |it| !it.is_anybody_there());
        }
        let stubborn = self.others();
        for one in &mut left {
            one.was_killed = stubborn.iter().any(|other| other.pid == one.pid);
        }
        self.supervisor.kill_all();
        (left, was_killed)
    }

    /// Lets the program continue for at most `most` of its time, until `is_enough`.
    fn go_on(&mut self, most: Duration, is_enough: impl Fn(&Supervisor) -> bool) {
        let until = self.supervisor.stage.now() + most;
        let clock = WallClock::start();
        let is_time = |it: &Supervisor| it.stage.now() < until;
        while !is_enough(&self.supervisor) && is_time(&self.supervisor) {
            let is_late = clock.now() - Instant::ZERO > PATIENCE_WALL;
            if is_late || self.supervisor.turn().is_err() {
                break;
            }
        }
    }

    /// All living processes besides the program itself.
    fn others(&self) -> Vec<Left> {
        let others = self
            .supervisor
            .others()
            .filter_map(|pid| u32::try_from(pid).ok());
        others
            .map(|pid| Left {
                pid,
                command: command_of(pid),
                was_killed: false,
            })
            .collect()
    }

    /// The program's output so far.
    pub fn said(&self) -> String {
        let words = self.words.lock();
        words.map(|words| words.text()).unwrap_or_default()
    }

    /// Waits until no process can write output any more, with a time limit.
    fn is_silent(&self) {
        let clock = WallClock::start();
        while !self.listener.is_finished() && clock.now() - Instant::ZERO < LAST_WORDS {
            clock.sleep_until(clock.now() + Duration::from_millis(1));
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
