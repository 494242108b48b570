//! What node programs do wrong.

use core::fmt;
use core::time::Duration;
use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitStatus;

use protocols::Instant;

/// How a program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// By itself, with this exit code.
    Code(i32),
    /// By this signal.
    Signal(i32),
}

/// The exit code of a shell whose program could not be found.
const NOT_FOUND: i32 = 127;
/// Exit codes of a shell whose program was ended by a signal: 128 and its number.
const SHELL_SIGNALS: core::ops::RangeInclusive<i32> = 129..=192;

impl Ending {
    pub(crate) fn of(status: ExitStatus) -> Self {
        match status.signal() {
            Some(signal) => Self::Signal(signal),
            None => Self::Code(status.code().unwrap_or_default()),
        }
    }

    /// The signal that ended it, also if a shell reports it.
    pub fn signal(self) -> Option<i32> {
        match self {
            Self::Signal(signal) => Some(signal),
            Self::Code(code) => SHELL_SIGNALS.contains(&code).then_some(code - 128),
        }
    }
}

impl fmt::Display for Ending {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self, self.signal()) {
            (Self::Signal(signal), _) => write!(f, "signal {signal}"),
            (Self::Code(code), Some(signal)) => {
                write!(
                    f,
                    "exit code {code}: signal {signal}, as its shell reports it"
                )
            }
            (Self::Code(NOT_FOUND), None) => {
                write!(
                    f,
                    "exit code {NOT_FOUND}: the shell did not find the command"
                )
            }
            (Self::Code(code), None) => write!(f, "exit code {code}"),
        }
    }
}

/// Why a node program cannot go on. Each is a sentence whose subject is the program.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NodeError {
    /// The system refused to start it.
    #[error("cannot be started: {0}")]
    NotStarted(String),
    /// It ended while it was needed.
    #[error("exited ({how}) before it answered {to}, expected an answer to each request")]
    Exited {
        /// Exit code or signal.
        how: Ending,
        /// Name of the request.
        to: &'static str,
    },
    /// It runs, and has closed its standard output or input.
    #[error("closed its standard {stream} before it answered {to}, expected it to stay open")]
    Closed {
        /// Which stream.
        stream: &'static str,
        /// Name of the request.
        to: &'static str,
    },
    /// It is silent.
    #[error("gave no answer to {to} within {} of wall time: it hangs", seconds(*.limit))]
    Hung {
        /// Name of the request.
        to: &'static str,
        /// How long the rig waited.
        limit: Duration,
    },
    /// It was silent when the rig was stopped.
    #[error("had not answered {to} when the run was stopped")]
    Stopped {
        /// Name of the request.
        to: &'static str,
    },
    /// It speaks another version.
    #[error("speaks version {found} of the node protocol, expected version 1")]
    Version {
        /// What it said.
        found: String,
    },
    /// What it sent is no message.
    #[error("sent an answer to {to} that cannot be read: {what}")]
    Unreadable {
        /// Name of the request.
        to: &'static str,
        /// What is wrong, and what was expected.
        what: String,
    },
    /// What happened cannot be said in the binary form.
    #[error("could not be sent {to}: {what}")]
    Untold {
        /// Name of the request.
        to: &'static str,
        /// What is too long.
        what: String,
    },
    /// It speaks of the past.
    #[error("moved time backwards: {what} is at {at} s, expected {now} s or later")]
    Backwards {
        /// What is in the past.
        what: &'static str,
        /// When.
        at: Instant,
        /// The present.
        now: Instant,
    },
    /// It sent too much.
    #[error("flooded the rig: {0}")]
    Flood(String),
    /// Time does not pass.
    #[error(
        "asked to be called again {count} times within one microsecond at {now} s, expected a \
         later moment"
    )]
    Restless {
        /// How often.
        count: u32,
        /// The present.
        now: Instant,
    },
    /// It cannot be copied.
    #[error("cannot save its state, expected \"save\": true in its answer to hello")]
    NoSave,
    /// It was told to end and goes on.
    #[error("did not exit within {} of the end message, and was killed", seconds(*.0))]
    NotEnded(Duration),
    /// It ended badly.
    #[error("ended with {0} after the end message, expected exit code 0")]
    EndedWith(Ending),
}

fn seconds(time: Duration) -> String {
    match time.as_millis() % 1000 {
        0 => format!("{} s", time.as_secs()),
        _ => format!("{} ms", time.as_millis()),
    }
}
