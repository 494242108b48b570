//! Players of a case: the rig in real time, or a program in virtual time.

use core::time::Duration;
use std::path::Path;

use protocols::Instant;

use super::case::Known;
use super::harness::{Harness, HarnessError, Whose};
use super::wiring::Placed;
use engine::rig::{Paced, Rig};
use engine::run::Run;
use realtime::clock::Clock;
use realtime::exec::{Foreign, PORTS_VARIABLE, Seat, port_variable};
use realtime::guest::{GuestError, Trial, TrialMoment};
use realtime::held::Held;
use realtime::process::{Ended, Patience, Process};
use realtime::transport::PortDir;
use realtime::{Realtime, Sign};

/// The reason why a case cannot continue.
#[derive(Debug)]
pub(super) enum Halt {
    /// The program ended.
    Ended(Ended),
    /// A port disappeared.
    Lost(String),
    /// A thread of the program computes without end.
    Spins(String),
    /// The program cannot be supervised.
    Guest(GuestError),
    /// The user interrupted the search.
    Interrupted,
}

/// The rig of a case, its clock, and the program.
pub(super) enum Player {
    /// In real time.
    Live(Box<Live>),
    /// In virtual time.
    Guest(Box<Trial>),
}

/// The rig in real time.
pub(super) struct Live {
    run: Endless,
    realtime: Realtime<Held>,
    dir: Option<PortDir>,
    process: Option<Process>,
}

/// A run that continues after its mission has ended.
struct Endless(Run);

impl Paced for Endless {
    fn rig(&mut self) -> &mut Rig {
        &mut self.0.rig
    }

    fn run_until(&mut self, deadline: Instant) {
        self.0.go_on_until(deadline);
    }
}

impl Player {
    /// Connects `ports` to the ends of `run` and starts the program, if required. `known` is its
    /// usual behaviour.
    pub(super) fn start(
        harness: &Harness<'_>,
        run: Run,
        dir: Option<PortDir>,
        ports: Vec<Placed>,
        known: &Known,
    ) -> Result<Self, HarnessError> {
        match (&harness.whose, harness.supervision, dir) {
            (Whose::Command { command, .. }, Some(supervision), Some(dir)) => {
                let foreign = Foreign {
                    command: harness.command(command),
                    name: String::new(),
                    robot: 0,
                    others: Vec::new(),
                    wait: harness.start,
                    may_end: false,
                    may_idle: true,
                    needs: known.opens.iter().cloned().collect(),
                    prints: true,
                    has_lines: false,
                    supervision: Some(supervision),
                };
                let seats = ports.into_iter().map(|(end, transport)| Seat {
                    end,
                    transport,
                    is_terminal: true,
                });
                let nowhere = Path::new("/dev/null");
                let mut trial = Trial::start(run, seats.collect(), dir, foreign, None, nowhere)?;
                trial.make_endless();
                Ok(Self::Guest(Box::new(trial)))
            }
            (_, _, dir) => Ok(Self::Live(Box::new(Live::start(harness, run, dir, ports)?))),
        }
    }

    pub(super) fn rig(&mut self) -> &mut Rig {
        match self {
            Self::Live(live) => &mut live.run.0.rig,
            Self::Guest(trial) => &mut trial.run().rig,
        }
    }

    /// The virtual time.
    pub(super) fn now(&self) -> Instant {
        match self {
            Self::Live(live) => live.realtime.clock().now(),
            Self::Guest(trial) => trial.now(),
        }
    }

    /// Time since the start of the program, in wall or virtual time.
    pub(super) fn waited(&self) -> Duration {
        match self {
            Self::Live(live) => live.realtime.clock().waited(),
            Self::Guest(trial) => trial.waited(),
        }
    }

    /// Whether the program was started here.
    pub(super) const fn is_started(&self) -> bool {
        match self {
            Self::Live(live) => live.process.is_some(),
            Self::Guest(_) => true,
        }
    }

    /// The processes of the program; none if it was not started here.
    pub(super) fn processes(&self) -> Vec<u32> {
        match self {
            Self::Live(live) => live.process.as_ref().map_or_else(Vec::new, Process::ids),
            Self::Guest(trial) => trial.processes(),
        }
    }

    /// The current moment of the program, if it can be put back to it.
    pub(super) fn moment(&mut self) -> Option<TrialMoment> {
        match self {
            Self::Live(_) => None,
            Self::Guest(trial) => trial.moment(),
        }
    }

    /// Puts the program back to `moment`; returns whether this was possible.
    pub(super) fn put_back(&mut self, moment: &TrialMoment) -> bool {
        match self {
            Self::Live(_) => false,
            Self::Guest(trial) => trial.put_back(moment),
        }
    }

    /// Whether virtual time is already running.
    pub(super) const fn has_begun(&self) -> bool {
        match self {
            Self::Live(_) => false,
            Self::Guest(trial) => trial.has_begun(),
        }
    }

    /// Starts virtual time.
    pub(super) fn let_go(&mut self) {
        match self {
            Self::Live(live) => live.realtime.clock().let_go(),
            Self::Guest(trial) => trial.begin(),
        }
    }

    /// The maximum lateness of the rig; always zero in virtual time.
    pub(super) fn late(&self) -> Duration {
        match self {
            Self::Live(live) => live.realtime.lateness().max(),
            Self::Guest(_) => Duration::ZERO,
        }
    }

    /// Advances the rig.
    pub(super) fn turn(&mut self) -> Result<(), Halt> {
        match self {
            Self::Live(live) => {
                let turned = live.realtime.turn(&mut live.run);
                turned.map_err(|error| Halt::Lost(error.to_string()))
            }
            Self::Guest(trial) => {
                trial.turn().map_err(|error| match error {
                    GuestError::Transport(error) => Halt::Lost(error.to_string()),
                    error => Halt::Guest(error),
                })?;
                match trial.spins() {
                    Some(who) => Err(Halt::Spins(who.to_owned())),
                    None => Ok(()),
                }
            }
        }
    }

    /// Passes the program's activity on its ports to `see`.
    pub(super) fn look(&mut self, see: impl FnMut(Sign<'_>)) {
        match self {
            Self::Live(live) => live.realtime.signs().for_each(see),
            Self::Guest(trial) => trial.signs().for_each(see),
        }
    }

    /// The end of the program, if it has ended.
    pub(super) fn ended(&mut self) -> Option<Ended> {
        match self {
            Self::Live(live) => live.process.as_mut().and_then(Process::ended),
            Self::Guest(trial) => trial.ended(),
        }
    }

    /// The program's location when a signal such as SIGSEGV came; in virtual time only.
    pub(super) fn fault(&self) -> Option<&str> {
        match self {
            Self::Live(_) => None,
            Self::Guest(trial) => trial.fault(),
        }
    }

    /// The output of the program so far.
    pub(super) fn said(&self) -> String {
        match self {
            Self::Live(live) => {
                let said = live.process.as_ref().map(Process::said);
                said.unwrap_or_default()
            }
            Self::Guest(trial) => trial.said(),
        }
    }

    /// Ends the program; returns its output and the run.
    pub(super) fn end(self, harness: &Harness<'_>) -> (String, Run) {
        match self {
            Self::Live(live) => live.end(harness),
            Self::Guest(trial) => trial.quit(),
        }
    }
}

impl Live {
    fn start(
        harness: &Harness<'_>,
        run: Run,
        dir: Option<PortDir>,
        ports: Vec<Placed>,
    ) -> Result<Self, HarnessError> {
        let mut realtime = Realtime::new(Held::at(run.rig.now()));
        let mut names = Vec::new();
        for (end, port) in ports {
            names.push(end.name.clone());
            realtime.serve(end, port);
        }
        let process = match &harness.whose {
            Whose::Command { command, dir } => {
                let mut variables = vec![(PORTS_VARIABLE.to_owned(), dir.clone().into())];
                let own = names.iter();
                let own = own.map(|name| (port_variable(name), Path::new(dir).join(name).into()));
                variables.extend(own);
                Some(Process::start(&harness.command(command), &variables, None))
            }
            Whose::Ports(_) => None,
        };
        Ok(Self {
            run: Endless(run),
            realtime,
            dir,
            process: process.transpose().map_err(HarnessError::NotStarted)?,
        })
    }

    fn end(mut self, harness: &Harness<'_>) -> (String, Run) {
        let process = self.process.take();
        let said = process.map(|process| process.end(Patience::LITTLE).said);
        let transports = self.realtime.into_transports();
        if self.dir.is_none() {
            harness.keep_open(transports);
        }
        // The capture is only for display; an error in writing it must not lose the finding.
        let _ = self.run.0.rig.finish_taps();
        (said.unwrap_or_default(), self.run.0)
    }
}
