//! The test harness of a program: its input and its observation.

use core::cell::{Cell, OnceCell, RefCell};
use core::time::Duration;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::constants::Constants;
use super::coverage::{Counters, VARIABLE};
use super::errors::ErrorRule;
use super::learn::Lesson;
use super::speech::Speech;
use super::wiring::{self, Placed};
use crate::learn::CorpusError;
use engine::robots::OpenEnd;
use engine::scenario::{Scenario, ScenarioError, Source};
use realtime::exec::Supervision;
use realtime::guest::GuestError;
use realtime::transport::{PortDir, Transport, TransportError};

/// The source of the program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Whose {
    /// A program that is started for each case; its ports are pseudo-terminals in a directory.
    Command {
        /// The shell command.
        command: String,
        /// The directory of its ports.
        dir: PathBuf,
    },
    /// A program that is already running, behind the ports in this directory.
    Ports(PathBuf),
}

/// The time spent on cases.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spent {
    /// Wall time until the program had opened its ports.
    pub starts: Duration,
    /// Total wall time.
    pub wall: Duration,
    /// Virtual time after the start.
    pub rig: Duration,
}

/// The harness in which programs are tested.
pub struct Harness<'a> {
    /// The program.
    pub whose: Whose,
    /// The origin of the scenario, for messages.
    pub source: Source,
    /// Time within which the program must prove that it is alive.
    pub alive: Duration,
    /// Time within which the program must open a port.
    pub start: Duration,
    /// The exits with an error that count as findings.
    pub errors: ErrorRule,
    /// Whether any baud rate is accepted, because the user gave none.
    pub is_any_rate: bool,
    /// Whether no device is at the port: requests get no reply in the first run.
    pub is_mute: bool,
    /// Whether rules about time are judged too.
    pub is_strict: bool,
    /// The supervision of the program in virtual time; `None`: it runs in real time.
    pub supervision: Option<Supervision>,
    /// The time spent on cases.
    pub(super) spent: Cell<Spent>,
    /// Whether to continue; called a thousand times a second.
    pub goes_on: &'a dyn Fn() -> bool,
    /// Coverage counters that are shared with programs.
    pub(super) counters: Option<Counters>,
    /// Constants of the program, as soon as it has run.
    pub(super) constants: OnceCell<Constants>,
    /// The knowledge about the device of each link.
    pub(super) lessons: RefCell<BTreeMap<String, Arc<Lesson>>>,
    /// Real ports, which stay open between cases: opening a port may reset the board.
    open: RefCell<Vec<Box<dyn Transport>>>,
}

/// The reason why no case can be run.
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
    /// The program cannot be tested; the text names the missing behaviour.
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
    /// A corpus contains no usable data.
    #[error(transparent)]
    Corpus(#[from] CorpusError),
    /// The user interrupted the search.
    #[error("interrupted")]
    Interrupted,
}

impl<'a> Harness<'a> {
    /// A harness for a program.
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
            is_mute: false,
            spent: Cell::default(),
            is_strict: false,
            supervision: None,
            counters: None,
            goes_on,
            constants: OnceCell::new(),
            lessons: RefCell::default(),
            open: RefCell::default(),
        }
    }

    /// The time spent on all cases so far.
    pub const fn spent(&self) -> Spent {
        self.spent.get()
    }

    /// Enables guidance by coverage for programs that are compiled to count it. The file of the
    /// counters is in `dir` if the system has no file system in memory.
    ///
    /// # Errors
    /// If the file of the counters cannot be created.
    pub fn watch_coverage(&mut self, dir: &Path) -> Result<(), HarnessError> {
        let wrong = |error| HarnessError::File(dir.to_owned(), error);
        self.counters = Some(Counters::new(dir).map_err(wrong)?);
        Ok(())
    }

    /// The shell command, with the variable of the counters.
    pub(super) fn command(&self, command: &str) -> String {
        match &self.counters {
            Some(counters) => {
                let path = counters.path().display();
                format!("export {VARIABLE}='{path}'\n{command}")
            }
            None => command.to_owned(),
        }
    }

    /// The ends of the scenario's links to which a program can connect; the end of `link` is
    /// included if possible.
    pub fn ends(
        &self,
        scenario: &Scenario,
        link: Option<&str>,
    ) -> Result<Vec<(OpenEnd, Speech)>, HarnessError> {
        let (run, ends, _) = wiring::wire(&self.source, scenario, link)?;
        // Wired with its devices: the base defines the byte order of its checksums.
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

    /// The ports for `ends`, and the directory if it was created for them.
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

    /// Keeps real ports open for the next case.
    pub(super) fn keep_open(&self, ports: Vec<Box<dyn Transport>>) {
        *self.open.borrow_mut() = ports;
    }
}
