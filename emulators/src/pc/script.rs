//! Script of the person at the PC.

use core::fmt;
use core::time::Duration;

use protocols::pcui::message::{Mode, Order, WAYPOINTS_MAX};

/// Maximum number of bytes of one [`Action::Raw`].
pub const RAW_MAX: usize = 65_536;
/// Maximum number of steps of a script.
pub const STEPS_MAX: usize = 10_000;

/// Condition of a step. The steps are done in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// This long after the run began.
    At(Duration),
    /// This long after the step before.
    AfterPrevious(Duration),
    /// This long after the present connection began.
    AfterConnected(Duration),
    /// Once the robot has been reporting this mode for this long.
    AfterMode(Mode, Duration),
    /// This long after the last waypoints and the last order were confirmed by the robot.
    AfterConfirmed(Duration),
    /// This long after every row of the map had been seen.
    AfterMapComplete(Duration),
}

/// The action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Opens the port.
    Open,
    /// Closes the port.
    Close,
    /// Sends a list of points to visit, in mm of the robot's map, repeatedly until the robot
    /// returns it.
    Waypoints(Vec<[i16; 2]>),
    /// Sends an order, and again until the robot reports its mode; in manual mode forever.
    Order(Order),
    /// Writes bytes as they are, if the port is open.
    Raw(Vec<u8>),
}

/// An action and its time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Step {
    /// Time or condition of the step.
    pub when: When,
    /// The action.
    pub action: Action,
}

/// Steps that can be done.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Script(Vec<Step>);

impl Script {
    /// Checks the limits of the protocol.
    pub fn new(steps: Vec<Step>) -> Result<Self, ScriptError> {
        if steps.len() > STEPS_MAX {
            return Err(ScriptError::Steps { found: steps.len() });
        }
        for (step, Step { action, .. }) in steps.iter().enumerate() {
            action.check().map_err(|error| match error {
                ScriptError::Waypoints { found, .. } => ScriptError::Waypoints { step, found },
                ScriptError::Raw { found, .. } => ScriptError::Raw { step, found },
                ScriptError::Steps { .. } => error,
            })?;
        }
        Ok(Self(steps))
    }

    /// Opens the port at the beginning and, a second after the connection stands, sends
    /// `waypoints`: the everyday mission.
    pub fn mission(waypoints: Vec<[i16; 2]>) -> Result<Self, ScriptError> {
        Self::new(vec![
            Step {
                when: When::At(Duration::ZERO),
                action: Action::Open,
            },
            Step {
                when: When::AfterConnected(Duration::from_secs(1)),
                action: Action::Waypoints(waypoints),
            },
        ])
    }

    /// The steps in order.
    pub fn steps(&self) -> &[Step] {
        &self.0
    }

    /// Puts `step` in front of the step `index`, or at the end.
    pub(super) fn insert(&mut self, index: usize, step: Step) -> Result<(), ScriptError> {
        step.action.check()?;
        let found = self.0.len() + 1;
        if found > STEPS_MAX {
            return Err(ScriptError::Steps { found });
        }
        self.0.insert(index.min(self.0.len()), step);
        Ok(())
    }
}

impl Action {
    /// Whether the action stays within the limits of the protocol; an error names step 0.
    pub(super) fn check(&self) -> Result<(), ScriptError> {
        match self {
            Self::Waypoints(list) if list.len() > WAYPOINTS_MAX => Err(ScriptError::Waypoints {
                step: 0,
                found: list.len(),
            }),
            Self::Raw(bytes) if bytes.len() > RAW_MAX => Err(ScriptError::Raw {
                step: 0,
                found: bytes.len(),
            }),
            _ => Ok(()),
        }
    }
}

/// Reason for an invalid script.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ScriptError {
    /// More steps than [`STEPS_MAX`].
    Steps {
        /// Number of steps.
        found: usize,
    },
    /// More waypoints than one frame holds.
    Waypoints {
        /// Index of the step.
        step: usize,
        /// Their number.
        found: usize,
    },
    /// More bytes than [`RAW_MAX`].
    Raw {
        /// Index of the step.
        step: usize,
        /// Their number.
        found: usize,
    },
}

impl fmt::Display for ScriptError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Steps { found } => write!(f, "{found} steps, at most {STEPS_MAX} allowed"),
            Self::Waypoints { step, found } => {
                write!(
                    f,
                    "step {step}: {found} waypoints, at most {WAYPOINTS_MAX} fit a frame"
                )
            }
            Self::Raw { step, found } => {
                write!(f, "step {step}: {found} bytes, at most {RAW_MAX} allowed")
            }
        }
    }
}

impl core::error::Error for ScriptError {}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100 waypoints fit 902 bytes of payload, 101 do not; the error names the step.
    #[test]
    fn a_list_that_fits_no_frame_is_refused() {
        assert!(Script::mission(vec![[0, 0]; 100]).is_ok());
        let error = Script::mission(vec![[0, 0]; 101]).expect_err("too long");
        assert_eq!(
            error,
            ScriptError::Waypoints {
                step: 1,
                found: 101
            }
        );
        assert_eq!(
            error.to_string(),
            "step 1: 101 waypoints, at most 100 fit a frame"
        );
    }

    /// A step is inserted before the named one, or after the last. A step that exceeds a frame or
    /// the maximum number is rejected.
    #[test]
    fn a_step_is_put_in_its_place() {
        let at = |seconds: u64| Step {
            when: When::At(Duration::from_secs(seconds)),
            action: Action::Open,
        };
        let mut script = Script::new(vec![at(1), at(2)]).expect("within the limits");
        assert!(script.insert(1, at(3)).is_ok() && script.insert(9, at(4)).is_ok());
        assert_eq!(script.steps(), [at(1), at(3), at(2), at(4)]);
        let raw = |len: usize| Step {
            action: Action::Raw(vec![0; len]),
            ..at(5)
        };
        let found = RAW_MAX + 1;
        let error = ScriptError::Raw { step: 0, found };
        assert_eq!(script.insert(0, raw(RAW_MAX + 1)), Err(error));
        assert!(script.insert(0, raw(RAW_MAX)).is_ok());
        let full = vec![at(1); STEPS_MAX - 1];
        let mut full = Script::new(full).expect("within the limits");
        assert!(full.insert(0, at(1)).is_ok());
        let found = STEPS_MAX + 1;
        assert_eq!(full.insert(0, at(2)), Err(ScriptError::Steps { found }));
        assert_eq!(full.steps().len(), STEPS_MAX);
    }
}
