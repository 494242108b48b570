//! Further programs of a run, and how programs are supervised in virtual time.

use core::time::Duration;

use super::{Cpu, Schedule};

/// A further program of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Companion {
    /// Its name, for verdicts.
    pub name: String,
    /// Its shell command.
    pub command: String,
    /// Index of its robot; the names in its environment are those of this robot alone.
    pub robot: usize,
    /// Whether it may end with exit code 0 before the run is over.
    pub may_end: bool,
}

/// How a program is supervised in virtual time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Supervision {
    /// Virtual time that each stopped call takes.
    pub call_cost: Duration,
    /// Processor time for which a thread may compute without a call.
    pub spin_max: Duration,
    /// Another order of threads; `None`: that of their calls.
    pub schedule: Option<Schedule>,
    /// The price of computing; `None`: it takes no virtual time.
    pub cpu: Option<Cpu>,
}

impl Default for Supervision {
    /// The settings of the command line without options.
    fn default() -> Self {
        Self {
            call_cost: Duration::from_micros(1),
            spin_max: Duration::from_secs(10),
            schedule: None,
            cpu: None,
        }
    }
}
