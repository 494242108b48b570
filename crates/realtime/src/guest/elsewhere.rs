//! A build without a supervisor: all programs are refused with a message.

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

/// The hidden command of a program in virtual time.
pub const VERB: &str = "__guest";

/// The same for a program in real time that has modem lines.
pub const LINES_VERB: &str = "__guest-lines";

/// A supervised program: it never exists in this build.
pub enum Trial {}

/// Result of a supervised program.
pub struct Played {
    /// The run.
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

/// The decisions, call by call.
pub struct Calls;

impl Calls {
    /// Number of calls.
    pub(crate) const fn count(&self) -> u64 {
        0
    }

    /// The first difference between two runs.
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

    /// Whether the run is over.
    pub(crate) const fn is_over(&self) -> bool {
        match *self {}
    }

    /// Continues for some milliseconds.
    ///
    /// # Errors
    /// Never.
    pub(crate) const fn turns(&mut self) -> Result<(), GuestError> {
        match *self {}
    }

    /// Continues.
    ///
    /// # Errors
    /// Never.
    pub(crate) const fn turn(&mut self) -> Result<(), GuestError> {
        match *self {}
    }

    /// Lets the run continue after its mission is over.
    pub(crate) const fn make_endless(&mut self) {
        match *self {}
    }

    /// Starts rig time.
    pub(crate) const fn begin(&mut self) {
        match *self {}
    }

    /// Whether rig time runs.
    pub(crate) const fn has_begun(&self) -> bool {
        match *self {}
    }

    /// The program's time since it was started.
    pub(crate) const fn waited(&self) -> Duration {
        match *self {}
    }

    /// Rig time.
    pub(crate) const fn now(&self) -> Instant {
        match *self {}
    }

    /// Observations of the program at its ports.
    pub(crate) fn signs(&mut self) -> impl Iterator<Item = Sign<'_>> {
        match *self {}
        #[expect(unreachable_code, reason = "names the type")]
        core::iter::empty()
    }

    /// The end of the program.
    pub(crate) const fn ended(&self) -> Option<Ended> {
        match *self {}
    }

    /// The place of the program when a signal such as SIGSEGV came.
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

    /// The current state of the program.
    pub const fn moment(&mut self) -> Option<TrialMoment> {
        match *self {}
    }

    /// Restores an earlier state of the program.
    pub const fn put_back(&mut self, _: &TrialMoment) -> bool {
        match *self {}
    }

    /// The program's output so far.
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

/// Settings of a debugger session.
#[derive(Clone, Debug, Default)]
pub struct DebugSettings {
    /// Port where the debugger connects.
    pub port: u16,
    /// Name of the program's file.
    pub program: Option<String>,
    /// Rig time at which the program first stops.
    pub at: Option<Duration>,
    /// Whether it runs once, and then again up to the place where a check failed.
    pub on_fail: bool,
}

/// The end of a debugger session.
pub enum Debugged {
    /// The run ended and was judged.
    Judged(Box<Played>),
    /// The debugger killed the program.
    Killed(Box<Played>),
    /// The caller stopped the session; the run until then.
    Cut(Box<Played>),
    /// The program could not be started.
    NotStarted,
}

/// Functions of the caller that a session uses.
pub struct Surroundings<'a> {
    /// Starts the program from the beginning.
    pub start: &'a mut dyn FnMut() -> Option<Trial>,
    /// Whether the session may continue.
    pub goes_on: &'a dyn Fn() -> bool,
    /// Prints a line for the user.
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
