//! Why a program gets no verdict.

use std::io;

use crate::transport::TransportError;
use engine::scenario::ScenarioError;

/// Why a program cannot be put on trial.
#[derive(Debug, thiserror::Error)]
pub enum ExecError {
    /// The scenario cannot be wired.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A port cannot be opened.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// It cannot be started.
    #[error("--exec: cannot start it: {0}")]
    NotStarted(io::Error),
    /// It cannot be put into virtual time.
    #[error("{0}")]
    Virtual(String),
    /// It is said to need a port that there is not.
    #[error("--exec-needs {0}: no such port, expected some of {all}", all = .1.join(", "))]
    NoSuchPort(String, Vec<String>),
}
