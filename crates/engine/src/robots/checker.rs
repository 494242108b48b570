//! What watches a run: the contract of every checker, and the verdict that it comes to.

use emulators::world::Contact;
use schemars::JsonSchema;
use serde::Serialize;

use super::axis::Axis;
use crate::rig::Rig;

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// What was demanded held.
    Pass,
    /// It did not.
    Fail,
    /// There was nothing to watch: nothing is known.
    NotObserved,
}

impl Status {
    /// Whether something held.
    pub const fn of(holds: bool) -> Self {
        match holds {
            true => Self::Pass,
            false => Self::Fail,
        }
    }

    /// Four characters for the beginning of a line.
    pub const fn mark(self) -> &'static str {
        match self {
            Self::Pass => "ok  ",
            Self::Fail => "FAIL",
            Self::NotObserved => "--  ",
        }
    }
}

/// One verdict.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Check {
    /// Stable name in kebab case.
    pub name: String,
    /// How it ended.
    pub status: Status,
    /// A sentence with the figures.
    pub detail: String,
}

impl Check {
    /// A verdict: `pass` or not.
    pub fn new(name: &str, pass: bool, detail: impl Into<String>) -> Self {
        Self {
            name: name.to_owned(),
            status: Status::of(pass),
            detail: detail.into(),
        }
    }

    /// A verdict about nothing; `detail` says what was missing.
    pub fn not_observed(name: &str, detail: impl Into<String>) -> Self {
        Self {
            status: Status::NotObserved,
            ..Self::new(name, true, detail)
        }
    }

    /// The same verdict, if there was something to watch.
    #[must_use]
    pub fn if_observed(self, observed: bool) -> Self {
        match self.status {
            Status::Pass if !observed => Self {
                status: Status::NotObserved,
                ..self
            },
            _ => self,
        }
    }
}

impl core::fmt::Display for Check {
    /// `FAIL set-points-in-range        40, 0 at 3.01 s, limit +-35`.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let about = match self.status {
            Status::NotObserved => "not observed: ",
            Status::Pass | Status::Fail => "",
        };
        let (mark, name) = (self.status.mark(), &self.name);
        write!(f, "{mark} {name:<25} {about}{}", self.detail)
    }
}

/// What a checker sees at one moment.
#[derive(Clone, Copy)]
pub struct Look<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// What the robot was told to do; empty if it is not known.
    pub axes: &'a [Axis],
    /// Contacts since the last look.
    pub contacts: &'a [Contact],
}

/// An invariant that is watched during the run.
pub trait Checker: Send {
    /// Checks the rig; called every few milliseconds of virtual time.
    fn observe(&mut self, look: &Look<'_>);

    /// The verdict so far. One that had nothing to watch says so.
    fn verdict(&self) -> Check;

    /// The same checker in the same state, for a copy of the rig it looks at; what it listens with
    /// it adds to `rig`, that copy. `None`: it cannot be copied, and a run that it watches has no
    /// checkpoints.
    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        None
    }
}
