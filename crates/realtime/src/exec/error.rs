//! Reasons for a run without a verdict.

use std::io;

use crate::transport::TransportError;
use engine::scenario::ScenarioError;

/// The reason why a program cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum ExecError {
    /// The scenario cannot be wired.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A port cannot be opened.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The program cannot be started.
    #[error("--exec: cannot start it: {0}")]
    NotStarted(io::Error),
    /// The program cannot run in virtual time.
    #[error("{0}")]
    Virtual(String),
    /// The program requires a port that does not exist; with the names of all existing ports.
    #[error("--exec-needs {0}: no such port, expected some of {all}", all = .1.join(", "))]
    NoSuchPort(String, Vec<String>),
}
