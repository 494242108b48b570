//! Checks of a run: the interface of checkers, and their verdicts.

use emulators::world::{ActuatorKind, Contact};
use protocols::Instant;
use schemars::JsonSchema;
use serde::Serialize;

use super::axis::Axis;
use crate::rig::Rig;
use crate::scenario::FaultSpec;

/// The status of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The required property holds.
    Pass,
    /// The required property does not hold.
    Fail,
    /// The property was not observed, so nothing is known.
    NotObserved,
}

impl Status {
    /// The status for a property that holds or not.
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

/// A check with its verdict.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Check {
    /// Stable name in kebab case.
    pub name: String,
    /// The verdict.
    pub status: Status,
    /// A sentence with figures.
    pub detail: String,
}

impl Check {
    /// A check that passes or fails.
    pub fn new(name: &str, pass: bool, detail: impl Into<String>) -> Self {
        Self {
            name: name.to_owned(),
            status: Status::of(pass),
            detail: detail.into(),
        }
    }

    /// A check that observed nothing; `detail` names the missing observation.
    pub fn not_observed(name: &str, detail: impl Into<String>) -> Self {
        Self {
            status: Status::NotObserved,
            ..Self::new(name, true, detail)
        }
    }

    /// Returns the check unchanged, or as not observed if `observed` is false.
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

/// The view of a checker at one moment.
#[derive(Clone, Copy)]
pub struct Look<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// The robot's axes; empty if they are not known.
    pub axes: &'a [Axis],
    /// Contacts since the last call.
    pub contacts: &'a [Contact],
}

impl Look<'_> {
    /// The axes that move the robot: all but those with the name of a steering actuator, which is
    /// seldom at 0.
    pub fn drives(&self) -> impl Iterator<Item = &Axis> {
        let actuators = self.rig.world.actuators();
        let steers = |axis: &&Axis| {
            let mut own = actuators.iter().filter(|it| it.name == axis.name);
            own.any(|it| it.kind == ActuatorKind::Steering)
        };
        self.axes.iter().filter(move |axis| !steers(axis))
    }

    /// Whether a set-point moves the robot.
    pub fn is_driven(&self) -> bool {
        self.drives().any(|axis| axis.set_point != 0.0)
    }
}

/// A property that is checked during the run.
pub trait Checker: Send {
    /// Checks the rig; called every few milliseconds of virtual time.
    fn observe(&mut self, look: &Look<'_>);

    /// The verdict so far; not observed if nothing could be checked.
    fn verdict(&self) -> Check;

    /// The faults of the run are now `faults`: some were added, removed, or got other times.
    fn faults_changed(&mut self, _faults: &[FaultSpec], _rig: &Rig) {}

    /// The station gives an order at `at` that has no time in the scenario: by hand, or because a
    /// condition came true.
    fn ordered(&mut self, _at: Instant) {}

    /// Copies the checker with its state, for `rig`, a copy of the rig. Adds its observers to this
    /// copy. `None` if the checker cannot be copied: a run with it has no checkpoints.
    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        None
    }
}
