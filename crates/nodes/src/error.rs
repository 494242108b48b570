//! Errors of node programs.

use core::fmt;
use core::time::Duration;
use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitStatus;

use protocols::Instant;

/// The end of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Exit with this code.
    Code(i32),
    /// Killed by this signal.
    Signal(i32),
}

/// Exit code of a shell that cannot find the program.
const NOT_FOUND: i32 = 127;
/// Exit codes of a shell whose program was killed by a signal: 128 plus its number.
const SHELL_SIGNALS: core::ops::RangeInclusive<i32> = 129..=192;

impl Ending {
    pub(crate) fn of(status: ExitStatus) -> Self {
        match status.signal() {
            Some(signal) => Self::Signal(signal),
            None => Self::Code(status.code().unwrap_or_default()),
        }
    }

    /// The signal that ended the program, also if a shell reports it.
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

/// The reason why a node program cannot continue. Each message is a sentence whose subject is the
/// program.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NodeError {
    /// The operating system refused to start the program.
    #[error("cannot be started: {0}")]
    NotStarted(String),
    /// The program ended while it was needed.
    #[error("exited ({how}) before it answered {to}, expected an answer to each request")]
    Exited {
        /// Exit code or signal.
        how: Ending,
        /// Name of the request.
        to: &'static str,
    },
    /// The program is running, but has closed its standard output or input.
    #[error("closed its standard {stream} before it answered {to}, expected it to stay open")]
    Closed {
        /// The closed stream.
        stream: &'static str,
        /// Name of the request.
        to: &'static str,
    },
    /// The program does not answer.
    #[error("gave no answer to {to} within {} of wall time: it hangs", seconds(*.limit))]
    Hung {
        /// Name of the request.
        to: &'static str,
        /// The timeout.
        limit: Duration,
    },
    /// The program did not answer before the rig was stopped.
    #[error("had not answered {to} when the run was stopped")]
    Stopped {
        /// Name of the request.
        to: &'static str,
    },
    /// The program uses another version of the contract.
    #[error("speaks version {found} of the node protocol, expected version 1")]
    Version {
        /// The version in its greeting.
        found: String,
    },
    /// The program sent an invalid message.
    #[error("sent an answer to {to} that cannot be read: {what}")]
    Unreadable {
        /// Name of the request.
        to: &'static str,
        /// The error, and the expected content.
        what: String,
    },
    /// An input cannot be expressed in the binary form.
    #[error("could not be sent {to}: {what}")]
    Untold {
        /// Name of the request.
        to: &'static str,
        /// The part that is too long.
        what: String,
    },
    /// The program gave a time in the past.
    #[error("moved time backwards: {what} is at {at} s, expected {now} s or later")]
    Backwards {
        /// The item with that time.
        what: &'static str,
        /// The given time.
        at: Instant,
        /// The current time.
        now: Instant,
    },
    /// The program sent too much data.
    #[error("flooded the rig: {0}")]
    Flood(String),
    /// The program stops virtual time.
    #[error(
        "asked {count} times in a row to be called again at once, the last time at {now} s: \
         expected a later moment"
    )]
    Restless {
        /// Number of calls.
        count: u32,
        /// The current time.
        now: Instant,
    },
    /// The program cannot save its state.
    #[error("cannot save its state, expected \"save\": true in its answer to hello")]
    NoSave,
    /// The program did not exit on request.
    #[error("did not exit within {} of the end message, and was killed", seconds(*.0))]
    NotEnded(Duration),
    /// The program ended with an error.
    #[error("ended with {0} after the end message, expected exit code 0")]
    EndedWith(Ending),
}

fn seconds(time: Duration) -> String {
    match time.as_millis() % 1000 {
        0 => format!("{} s", time.as_secs()),
        _ => format!("{} ms", time.as_millis()),
    }
}
