//! A user's program in a run: its start on the rig's ports, its observation, verdict and end.
//!
//! ```text
//!  start --> opens its ports --> rig time runs --> run over, or program gone --> end, verdict
//!            (rig stands at 0)
//! ```
//!
//! Rig time starts when the program has opened its required ports, so that a slow interpreter costs
//! no time of the mission. Some programs need an answer on one port before they open the next one.
//! If a program has sent a byte and has opened no further port for 1 s, rig time therefore also
//! starts.

mod cause;
mod companion;
mod conclude;
mod cpu;
mod environment;
mod error;
mod exchange;
mod ports;
mod readiness;
mod schedule;
mod verdict;

use core::time::Duration;
use std::io;
use std::path::{Path, PathBuf};

use emulators::{Event, EventKind};
use protocols::Instant;

use crate::clock::Clock;
use crate::control::Control;
use crate::held::Held;
use crate::process::{Ended, Patience, Process};
use crate::transport::{Note, PortDir, Pty, Transport, TransportError};
use crate::{LATE, Lateness, PortReport, Realtime};
use engine::robots::{self, Dut, OpenEnd, PcEnd, Wired};
use engine::run::check::{Check, NODE_PROGRAMS, Status};
use engine::run::{Outcome, Run};
use engine::scenario::{Scenario, Source};

pub use cause::in_lockstep;
pub use companion::{Companion, Supervision};
pub(crate) use conclude::{Ending, SoFar};
pub use cpu::Cpu;
pub use environment::port_variable;
pub(crate) use environment::{environment, terminal_of};
pub use error::ExecError;
pub(crate) use ports::Ports;
pub(crate) use readiness::Readiness;
pub use schedule::Schedule;
pub use verdict::{alive, childless};

/// Environment variable with the directory of the ports.
pub const PORTS_VARIABLE: &str = "HILRIG_DIR";
/// Prefix of the variables with the names of ports in `/dev`.
pub(crate) const TERMINAL_VARIABLE: &str = "HILRIG_TTY_";
/// Rig time for which a run continues after the program's end, so that the devices notice it.
pub(crate) const SETTLE: Duration = Duration::from_secs(2);

/// Rig time between two checks of the reason for unread bytes. Each check lists all processes.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Whether a failed check is valid for a late rig, too. A program's exit with an error code is not,
/// because the program's own timeouts continue while rig time stands.
pub fn is_fact(check: &Check) -> bool {
    match &*check.name {
        "program-connected" | "no-children-left" | NODE_PROGRAMS => true,
        "program-alive" => {
            !check.detail.contains("exit code") || check.detail.contains("exit code 0 ")
        }
        _ => false,
    }
}

/// A user's program, and its permissions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Foreign {
    /// Shell command.
    pub command: String,
    /// Its name among several programs; else empty.
    pub name: String,
    /// Index of its robot, 0 for the first one.
    pub robot: usize,
    /// Further programs of the same run, in virtual time only.
    pub others: Vec<Companion>,
    /// Wall time within which the program must open its required ports.
    pub wait: Duration,
    /// Whether it may end with exit code 0 before the run is over.
    pub may_end: bool,
    /// Whether it may stop sending and reading before the run is over.
    pub may_idle: bool,
    /// Names of its required ports; if empty, all ports that are not optional.
    pub needs: Vec<String>,
    /// Whether its output is its own. The output of firmware is only that of its emulator.
    pub prints: bool,
    /// Whether its ports have modem lines in real time; in virtual time they always have.
    pub has_lines: bool,
    /// Supervision in virtual time; `None` for real time.
    pub supervision: Option<Supervision>,
}

impl Foreign {
    /// Whether the program called `name` may end with exit code 0 before the run is over.
    pub(crate) fn may_end_of(&self, name: &str) -> bool {
        let mut others = self.others.iter();
        let other = others.find(|other| other.name == name);
        other.map_or(self.may_end, |other| other.may_end)
    }
}

/// An end of a link and the port that it is on.
pub struct Seat {
    /// The end.
    pub end: OpenEnd,
    /// Its port.
    pub transport: Box<dyn Transport>,
    /// Whether the program finds the port in the directory of ports. If not, the port is a real
    /// one, and the rig cannot see its clients.
    pub is_terminal: bool,
}

/// The default for the PC end: the mission's script if it gives orders, else an external program.
pub fn pc_end(scenario: &Scenario) -> PcEnd {
    match scenario.mission.gives_orders() {
        true => PcEnd::Scripted,
        false => PcEnd::External,
    }
}

/// A run of the program under test.
pub struct Trial {
    run: Run,
    realtime: Realtime<Held>,
    control: Control,
    dir: PortDir,
    process: Process,
    foreign: Foreign,
    ports: Ports,
    readiness: Readiness,
    has_begun: bool,
    gave_up: bool,
    /// The program's end, and the rig time of it.
    ended: Option<(Ended, Instant)>,
    /// Rig time at which the last client closed its port.
    gone_at: Option<Instant>,
    /// Time and result of the last check whether the machine delays the program.
    held_up: (Instant, bool),
}

/// Result of a trial.
pub struct Judged {
    /// Outcome of the run; its first checks are about the program.
    pub outcome: Outcome,
    /// Whether the captures of the run were written.
    pub recorded: io::Result<()>,
    /// Further observations.
    pub seen: ProgramEnd,
}

/// Observations of a program besides its verdicts.
pub struct ProgramEnd {
    /// The last part of the program's output.
    pub said: String,
    /// Lateness of the rig.
    pub lateness: Lateness,
    /// Traffic of each port.
    pub reports: Vec<PortReport>,
}

impl Trial {
    /// Starts the program on the ports of `run`; `seats` are the ends of its links. The program's
    /// output is written to `log`.
    ///
    /// # Errors
    /// If the program cannot be started, or requires a port that does not exist.
    pub fn start(
        mut run: Run,
        seats: Vec<Seat>,
        mut dir: PortDir,
        foreign: Foreign,
        log: &Path,
    ) -> Result<Self, ExecError> {
        let mut control = Control::open(&dir)?;
        dir.leave_note(Note::Scenario, &run.scenario().to_toml())?;
        let ports = ports_of(&seats, &foreign)?;
        let env = environment(&seats, &dir, &run, 0);
        let mut realtime = Realtime::new(Held::at(run.rig.now()));
        for seat in seats {
            realtime.serve(seat.end, seat.transport);
        }
        let scenario = run.scenario().clone();
        realtime.plug_in(&scenario, &mut run.rig);
        control.offer(realtime.places());
        let process = match foreign.has_lines {
            true => Process::start_with_lines(&foreign.command, &env, Some(log)),
            false => Process::start(&foreign.command, &env, Some(log)),
        };
        Ok(Self {
            process: process.map_err(ExecError::NotStarted)?,
            run,
            realtime,
            control,
            dir,
            readiness: Readiness::new(foreign.wait),
            foreign,
            ports,
            has_begun: false,
            gave_up: false,
            ended: None,
            gone_at: None,
            held_up: (Instant::ZERO, false),
        })
    }

    /// The run.
    pub const fn run(&mut self) -> &mut Run {
        &mut self.run
    }

    /// Rig time by the wall clock.
    pub fn now(&self) -> Instant {
        self.realtime.clock().now()
    }

    /// Number of times that rig time stopped because the rig was late, and the length of the last
    /// stop.
    pub const fn stalls(&self) -> (u64, Duration) {
        self.realtime.stalls()
    }

    /// Whether rig time runs.
    pub const fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// The program's end and its time, if the program has ended.
    pub const fn ended(&self) -> Option<(Ended, Instant)> {
        self.ended
    }

    /// Whether the trial is over.
    pub fn is_over(&self) -> bool {
        let now = self.run.rig.now();
        let is_done = self.run.is_over() || self.control.has_quit();
        is_done || self.gave_up || self.gone_at.is_some_and(|at| now - at >= SETTLE)
    }

    /// Advances the rig and checks the program.
    ///
    /// # Errors
    /// If a real port disappeared.
    pub fn turn(&mut self) -> Result<(), TransportError> {
        let before = self.run.rig.now();
        let behind = self.realtime.clock().now() - before;
        let mut turned = self.realtime.turn(&mut self.run);
        // A program that reads the modem lines immediately after it opens a port sees them on.
        if self.control.hear() {
            turned = turned.and(self.realtime.carry(&mut self.run));
        }
        let now = self.run.rig.now();
        log_contacts(&mut self.run);
        let on_time = match behind > LATE || self.is_held_up(now) {
            true => Duration::ZERO,
            false => now - before,
        };
        for sign in self.realtime.signs() {
            self.ports.observe(now, on_time, &sign);
            self.control.see(&sign, &mut self.run);
        }
        self.control
            .serve(&mut self.run, Some(self.realtime.clock()), now);
        self.look_at_process(now);
        if !self.has_begun {
            self.begin_if_ready();
        }
        turned
    }

    /// Whether the machine delays a program that does not read, according to the last check.
    fn is_held_up(&mut self, now: Instant) -> bool {
        if !self.ports.any_waits_long() {
            return false;
        }
        let (at, is_held_up) = self.held_up;
        if now - at >= LOOK_EVERY {
            self.held_up = (now, self.process.is_held_up());
            return self.held_up.1;
        }
        is_held_up
    }

    fn look_at_process(&mut self, now: Instant) {
        if self.ended.is_none() {
            self.ended = self.process.ended().map(|ended| (ended, now));
        }
        // A program that may end can leave child processes that still use the ports.
        let is_gone = self.ended.is_some_and(|(ended, _)| {
            !(self.foreign.may_end && ended == Ended::Code(0) && self.ports.any_open())
        });
        if is_gone && self.gone_at.is_none() {
            self.gone_at = Some(now);
        }
    }

    fn begin_if_ready(&mut self) {
        let waited = self.realtime.clock().waited();
        let is_ready = self.readiness.is_ready(&self.ports, waited);
        if self.gone_at.is_some() || self.readiness.has_given_up(&self.ports, waited) {
            self.gave_up = true;
        } else if is_ready {
            self.realtime.clock().let_go();
            self.has_begun = true;
        }
    }

    /// Ends the program and judges the run so far.
    pub fn end(mut self) -> Judged {
        self.look_at_process(self.run.rig.now());
        let waits = self.process.waits();
        let farewell = self.process.end(Patience::FAIR);
        let is_over = self.run.is_over() || self.control.has_quit();
        let recorded = self.run.finish_taps();
        let lateness = self.realtime.lateness().clone();
        let reports = self.realtime.reports().collect();
        // The ports exist until the program has ended, so that it does not notice their end.
        drop((self.realtime, self.control, self.dir));
        let mut outcome = self.run.judge();
        let ending = Ending {
            ports: &self.ports,
            foreign: &self.foreign,
            ended: self.ended,
            each: vec![(String::new(), self.ended)],
            waits: &waits,
            farewell: &farewell,
            is_over,
            more: None,
        };
        ending.conclude(&mut outcome);
        Judged {
            outcome,
            recorded,
            seen: ProgramEnd {
                said: farewell.said,
                lateness,
                reports,
            },
        }
    }
}

/// Puts the checks of a program before those of its run.
pub(crate) fn add_checks(outcome: &mut Outcome, own: Vec<Check>) {
    // The run has its own checks with some of these names, which observed no program.
    let others = core::mem::take(&mut outcome.checks);
    let is_new = |check: &Check| {
        // Those of the other robots' programs are judged together with this one.
        let name = match check.status {
            Status::NotObserved => check.name.rsplit('/').next(),
            _ => None,
        };
        let name = name.unwrap_or(&check.name);
        own.iter().all(|one| one.name != name)
    };
    for (_, member) in &mut outcome.team {
        member.checks.retain(is_new);
    }
    let others: Vec<Check> = others.into_iter().filter(is_new).collect();
    outcome.checks.extend(own);
    outcome.checks.extend(others);
}

/// The ports of a program on `seats`, for observation.
///
/// # Errors
/// If the program requires a port that does not exist.
pub(crate) fn ports_of(seats: &[Seat], foreign: &Foreign) -> Result<Ports, ExecError> {
    let seen = || seats.iter().filter(|seat| seat.is_terminal);
    for name in &foreign.needs {
        if !seen().any(|seat| seat.end.name == *name) {
            let all = seen().map(|seat| seat.end.name.clone()).collect();
            return Err(ExecError::NoSuchPort(name.clone(), all));
        }
    }
    let mut ports = Ports::default();
    for Seat { end, transport, .. } in seen() {
        let is_needed = match foreign.needs.is_empty() {
            true => !end.is_optional,
            false => foreign.needs.contains(&end.name),
        };
        let path = transport.path();
        let terminal = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        ports.add(&end.name, terminal, is_needed);
    }
    Ok(ports)
}

/// Logs the contacts of the robot.
pub fn log_contacts(run: &mut Run) {
    for contact in run.take_contacts() {
        let (place, both, own) = (contact.place, contact.speed_m_s, contact.own_m_s);
        let detail = format!(
            "robot touched something at ({:.2}, {:.2}) m with {both:.3} m/s, {own:.3} its own",
            place.x, place.y
        );
        let event = Event {
            at: contact.at,
            kind: EventKind::Note,
            rule: "touch",
            detail,
            bytes: Vec::new(),
        };
        run.rig.log("robot", event);
    }
}

/// Runs `scenario` with the program from start to end, with ports in `dir` and output in `log`, for
/// callers that only need the verdict. `None` if `goes_on` returned false.
///
/// # Errors
/// If the program cannot be started.
pub(crate) fn judge(
    scenario: &Scenario,
    source: &Source,
    foreign: &Foreign,
    [dir, log]: [&PathBuf; 2],
    goes_on: &dyn Fn() -> bool,
) -> Result<Option<Judged>, ExecError> {
    let (run, seats, dir) = stage(scenario, source, dir)?;
    let mut trial = Trial::start(run, seats, dir, foreign.clone(), log)?;
    while !trial.is_over() {
        if !goes_on() {
            return Ok(None);
        }
        trial.turn()?;
    }
    Ok(Some(trial.end()))
}

/// Wires `scenario` for a user's program, with all its ports in `dir`.
///
/// # Errors
/// If the scenario cannot be wired, or a port cannot be created.
pub fn stage(
    scenario: &Scenario,
    source: &Source,
    dir: &Path,
) -> Result<(Run, Vec<Seat>, PortDir), ExecError> {
    let pc = pc_end(scenario);
    let Wired {
        rig,
        open_ends,
        instruments,
    } = robots::wire(scenario, source, Dut::External, pc)?;
    let dir = PortDir::open(dir)?;
    let mut seats = Vec::new();
    for end in open_ends {
        let transport = Box::new(Pty::open(&dir, &end.name, end.line)?);
        seats.push(Seat {
            end,
            transport,
            is_terminal: true,
        });
    }
    let run = Run::with_rig(scenario.clone(), rig, instruments);
    Ok((run, seats, dir))
}
