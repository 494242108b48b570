//! Where there is no supervisor: programs are refused in words.

use core::time::Duration;
use std::ffi::OsString;
use std::io;
use std::path::Path;
use std::process::{ExitCode, Stdio};

use protocols::Instant;

use super::GuestError;
use crate::exec::{Foreign, Seat};
use crate::process::Ended;
use crate::transport::PortDir;
use crate::{PortReport, Sign};
use engine::run::{Outcome, Run};

/// The hidden command.
pub const VERB: &str = "__guest";

/// The same for a program in real time that has modem lines.
pub const LINES_VERB: &str = "__guest-lines";

/// A program on trial: there never is one.
pub enum Trial {}

/// What came of it.
pub struct Played {
    /// The run.
    pub outcome: Outcome,
    /// Whether the captures of the run were written.
    pub recorded: io::Result<()>,
    /// The end of what the program said.
    pub said: String,
    /// What left virtual time.
    pub notes: Vec<String>,
    /// What the program's calls were, in words.
    pub spent: String,
    /// What was decided, call by call.
    pub calls: Calls,
    /// What passed each port.
    pub reports: Vec<PortReport>,
}

/// What was decided, call by call.
pub struct Calls;

impl Calls {
    /// How many calls there were.
    pub(crate) const fn count(&self) -> u64 {
        0
    }

    /// Where two runs part.
    pub(crate) const fn part_from(&self, _: &Self) -> Option<String> {
        None
    }
}

impl Trial {
    /// Refuses.
    ///
    /// # Errors
    /// Always.
    pub(crate) fn start(
        _: Run,
        _: Vec<Seat>,
        _: PortDir,
        _: Foreign,
        _: Option<&Path>,
        _: &Path,
    ) -> Result<Self, GuestError> {
        Err(GuestError::NotHere)
    }

    /// The run.
    pub(crate) const fn run(&mut self) -> &mut Run {
        match *self {}
    }

    /// Whether there is nothing more to see.
    pub(crate) const fn is_over(&self) -> bool {
        match *self {}
    }

    /// Goes on for some milliseconds.
    ///
    /// # Errors
    /// Never.
    pub(crate) const fn turns(&mut self) -> Result<(), GuestError> {
        match *self {}
    }

    /// Goes on.
    ///
    /// # Errors
    /// Never.
    pub(crate) const fn turn(&mut self) -> Result<(), GuestError> {
        match *self {}
    }

    /// From now on the run goes on when its mission is over.
    pub(crate) const fn make_endless(&mut self) {
        match *self {}
    }

    /// Lets the rig's time run.
    pub(crate) const fn begin(&mut self) {
        match *self {}
    }

    /// Whether the rig's time runs.
    pub(crate) const fn has_begun(&self) -> bool {
        match *self {}
    }

    /// The program's time since it was started.
    pub(crate) const fn waited(&self) -> Duration {
        match *self {}
    }

    /// The rig's time.
    pub(crate) const fn now(&self) -> Instant {
        match *self {}
    }

    /// What can be seen of the program at its ports.
    pub(crate) fn signs(&mut self) -> impl Iterator<Item = Sign<'_>> {
        match *self {}
        #[expect(unreachable_code, reason = "names the type")]
        core::iter::empty()
    }

    /// How the program ended.
    pub(crate) const fn ended(&self) -> Option<Ended> {
        match *self {}
    }

    /// Where the program was when a signal such as SIGSEGV came.
    pub const fn fault(&self) -> Option<&str> {
        match *self {}
    }

    /// The thread that computes without a system call.
    pub(crate) const fn spins(&self) -> Option<&str> {
        match *self {}
    }

    /// Its processes.
    pub const fn processes(&self) -> Vec<u32> {
        match *self {}
    }

    /// The program now.
    pub const fn moment(&mut self) -> Option<TrialMoment> {
        match *self {}
    }

    /// Puts the program back.
    pub const fn put_back(&mut self, _: &TrialMoment) -> bool {
        match *self {}
    }

    /// What it said so far.
    pub(crate) const fn said(&self) -> String {
        match *self {}
    }

    /// Ends it without a verdict.
    pub(crate) const fn quit(self) -> (String, Run) {
        match self {}
    }

    /// Ends it.
    pub(crate) const fn end(self) -> Played {
        match self {}
    }
}

/// A program at one moment.
pub enum TrialMoment {}

/// How a program is debugged.
#[derive(Clone, Debug, Default)]
pub struct DebugSettings {
    /// Port where the debugger connects.
    pub port: u16,
    /// Name of the program's file.
    pub program: Option<String>,
    /// Time at which the program first stands.
    pub at: Option<Duration>,
    /// It runs once, and then again to the place where a check failed.
    pub on_fail: bool,
}

/// How a debugger's session ended.
pub enum Debugged {
    /// The run ended and was judged.
    Judged(Box<Played>),
    /// The debugger killed the program.
    Killed(Box<Played>),
    /// The caller did not go on.
    Cut(Box<Played>),
    /// The program could not be started.
    NotStarted,
}

/// The outside of a session.
pub struct Surroundings<'a> {
    /// Starts the program from the beginning.
    pub start: &'a mut dyn FnMut() -> Option<Trial>,
    /// Whether the session goes on.
    pub goes_on: &'a dyn Fn() -> bool,
    /// Prints a line for people.
    pub say: &'a dyn Fn(&str),
}

/// Refuses.
///
/// # Errors
/// Always.
pub fn debug(_: DebugSettings, _: Surroundings<'_>) -> Result<Debugged, GuestError> {
    Err(GuestError::NotHere)
}

/// Refuses.
///
/// # Errors
/// Always.
pub fn run_with_lines(_: &Path, _: &[OsString], _: Stdio) -> Result<u8, GuestError> {
    Err(GuestError::NotHere)
}

/// Refuses.
pub fn become_guest_with_lines(_: impl IntoIterator<Item = OsString>) -> ExitCode {
    become_guest("")
}

/// Refuses.
pub fn become_shell_with_lines(_: OsString) -> ExitCode {
    become_guest("")
}

/// Refuses.
pub fn become_guest(_: &str) -> ExitCode {
    eprintln!("error: {}", GuestError::NotHere);
    ExitCode::from(2)
}
