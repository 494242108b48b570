//! Why a program gets no verdict.

use core::fmt;
use std::io;

use crate::realtime::transport::TransportError;
use crate::scenario::ScenarioError;

/// Why a program cannot be put on trial.
#[derive(Debug)]
pub enum ExecError {
    /// The scenario cannot be wired.
    Scenario(ScenarioError),
    /// A port cannot be had.
    Transport(TransportError),
    /// It cannot be started.
    NotStarted(io::Error),
    /// It is said to need a port that there is not.
    NoSuchPort(String, Vec<String>),
}

impl fmt::Display for ExecError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scenario(error) => error.fmt(f),
            Self::Transport(error) => error.fmt(f),
            Self::NotStarted(error) => write!(f, "--exec: cannot start it: {error}"),
            Self::NoSuchPort(name, all) => {
                let all = all.join(", ");
                write!(
                    f,
                    "--exec-needs {name}: no such port, expected some of {all}"
                )
            }
        }
    }
}

impl core::error::Error for ExecError {}

impl From<ScenarioError> for ExecError {
    fn from(error: ScenarioError) -> Self {
        Self::Scenario(error)
    }
}

impl From<TransportError> for ExecError {
    fn from(error: TransportError) -> Self {
        Self::Transport(error)
    }
}
