//! The harness on which a program is put: what it is told, and what is seen of it.

use core::cell::{Cell, RefCell};
use core::time::Duration;
use std::io;
use std::path::{Path, PathBuf};

use super::coverage::{Counters, VARIABLE};
use super::errors::ErrorRule;
use super::speech::Speech;
use super::wiring::{self, Placed};
use crate::learn::CorpusError;
use engine::robots::OpenEnd;
use engine::scenario::{Scenario, ScenarioError, Source};
use realtime::exec::Supervision;
use realtime::guest::GuestError;
use realtime::transport::{PortDir, Transport, TransportError};

/// Whose program it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Whose {
    /// Started again for each case, its ports being pseudo-terminals in a directory.
    Command {
        /// For the shell.
        command: String,
        /// Where its ports are.
        dir: PathBuf,
    },
    /// At work already, behind the ports in this directory.
    Ports(PathBuf),
}

/// Where the time of cases went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spent {
    /// Wall time until the program had opened its ports.
    pub starts: Duration,
    /// Wall time of all.
    pub wall: Duration,
    /// The rig's time after that.
    pub rig: Duration,
}

/// Where programs are put on trial.
pub struct Harness<'a> {
    /// The program.
    pub whose: Whose,
    /// Where the scenario comes from, for messages.
    pub source: Source,
    /// Time within which it must show that it lives.
    pub alive: Duration,
    /// Time within which it must open a port.
    pub start: Duration,
    /// Which exits with an error are findings.
    pub errors: ErrorRule,
    /// Whether any baud rate of the program is right, because the user gave none.
    pub is_any_rate: bool,
    /// Whether rules about time are judged too.
    pub is_strict: bool,
    /// How the program is put into virtual time; `None`: it runs in real time.
    pub supervision: Option<Supervision>,
    /// Where the time of the cases went.
    pub(super) spent: Cell<Spent>,
    /// Whether to continue; asked a thousand times a second.
    pub goes_on: &'a dyn Fn() -> bool,
    /// What programs share with us of what they reach.
    pub(super) counters: Option<Counters>,
    /// Real ports stay open from case to case: to open one may reset the board behind it.
    open: RefCell<Vec<Box<dyn Transport>>>,
}

/// Why nothing can be tried.
#[derive(Debug, thiserror::Error)]
pub enum HarnessError {
    /// The scenario cannot be run.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A port cannot be opened.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// There is no shell.
    #[error("sh: {0}; expected a shell that starts")]
    NotStarted(io::Error),
    /// The program is of no use: what it does not do.
    #[error("{0}")]
    Useless(String),
    /// A file cannot be written or read.
    #[error("{path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// A file has the wrong content.
    #[error("{path}: {1}", path = .0.display())]
    Content(PathBuf, String),
    /// The program cannot be put into virtual time.
    #[error(transparent)]
    Guest(#[from] GuestError),
    /// Nothing can be learned from a corpus.
    #[error(transparent)]
    Corpus(#[from] CorpusError),
    /// The user interrupted the search.
    #[error("interrupted")]
    Interrupted,
}

impl<'a> Harness<'a> {
    /// A harness for that program.
    pub fn new(
        whose: Whose,
        source: Source,
        [alive, start]: [Duration; 2],
        goes_on: &'a dyn Fn() -> bool,
    ) -> Self {
        Self {
            whose,
            source,
            alive,
            start,
            errors: ErrorRule::default(),
            is_any_rate: false,
            spent: Cell::default(),
            is_strict: false,
            supervision: None,
            counters: None,
            goes_on,
            open: RefCell::default(),
        }
    }

    /// Where the time of all cases so far went.
    pub const fn spent(&self) -> Spent {
        self.spent.get()
    }

    /// Lets programs that count what they reach lead the search; in `dir` if the system has no file
    /// system in memory.
    ///
    /// # Errors
    /// If there is no room for the counters.
    pub fn watch_coverage(&mut self, dir: &Path) -> Result<(), HarnessError> {
        let wrong = |error| HarnessError::File(dir.to_owned(), error);
        self.counters = Some(Counters::new(dir).map_err(wrong)?);
        Ok(())
    }

    /// The command for the shell, with what it is told of counters.
    pub(super) fn command(&self, command: &str) -> String {
        match &self.counters {
            Some(counters) => {
                let path = counters.path().display();
                format!("export {VARIABLE}='{path}'\n{command}")
            }
            None => command.to_owned(),
        }
    }

    /// The ends of the scenario's links at which a program can be; with `link`, that one is among
    /// them if it can be.
    pub fn ends(
        &self,
        scenario: &Scenario,
        link: Option<&str>,
    ) -> Result<Vec<(OpenEnd, Speech)>, HarnessError> {
        let (run, ends, _) = wiring::wire(&self.source, scenario, link)?;
        // As wired with its devices: which order the checksums have, the base says.
        let (whole, ..) = wiring::wire(&self.source, scenario, None)?;
        drop(run);
        let speech = |end: &OpenEnd| {
            let own = scenario.device.get(&end.link).and_then(Speech::of_device);
            let codec = whole.instruments().codec(&whole.rig, &end.link);
            own.unwrap_or(Speech::of_codec(codec))
        };
        Ok(ends
            .into_iter()
            .map(|end| {
                let speech = speech(&end);
                (end, speech)
            })
            .collect())
    }

    /// The ports for `ends`; the directory too, if it was made for them.
    pub(super) fn ports(
        &self,
        ends: &[OpenEnd],
        scenario: &Scenario,
    ) -> Result<(Option<PortDir>, Vec<Placed>), HarnessError> {
        let dir = match &self.whose {
            Whose::Command { dir, .. } => {
                let (dir, ports) = wiring::terminals(dir, ends, scenario)?;
                return Ok((Some(dir), ports));
            }
            Whose::Ports(dir) => dir,
        };
        let mut open = self.open.borrow_mut();
        if open.is_empty() {
            let ports = wiring::serials(dir, ends)?;
            open.extend(ports.into_iter().map(|(_, port)| port));
        }
        if open.is_empty() {
            let names: Vec<&str> = ends.iter().map(|end| end.name.as_str()).collect();
            return Err(HarnessError::Useless(format!(
                "--dut-dir {}: no port there, expected one of {}",
                dir.display(),
                names.join(", ")
            )));
        }
        let ports = core::mem::take(&mut *open).into_iter().filter_map(|port| {
            let end = ends.iter().find(|end| dir.join(&end.name) == port.path())?;
            Some((end.clone(), port))
        });
        Ok((None, ports.collect()))
    }

    /// Keeps real ports for the next case.
    pub(super) fn keep_open(&self, ports: Vec<Box<dyn Transport>>) {
        *self.open.borrow_mut() = ports;
    }
}
