//! What node programs do wrong.

use core::time::Duration;

use protocols::Instant;

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
        how: String,
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
    EndedWith(String),
}

fn seconds(time: Duration) -> String {
    match time.as_millis() % 1000 {
        0 => format!("{} s", time.as_secs()),
        _ => format!("{} ms", time.as_millis()),
    }
}
