//! What a fault waits for.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Flaw;
use crate::scenario::condition::{Condition, Op, PoseCondition, RegisterCondition};

/// A condition that begins a fault: a register's value, or where the robot truly is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WhenSpec {
    /// Whose register: name of a device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Which register, 0 to 255.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub register: Option<u8>,
    /// The register has this value, 0 to 255.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub equals: Option<u8>,
    /// The register has this value or a greater one, 0 to 255.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_least: Option<u8>,
    /// The robot is near this place, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near_m: Option<[f64; 2]>,
    /// How near, metres, more than 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_m: Option<f64>,
}

impl WhenSpec {
    /// What can be waited for, in words, and the keys that say it.
    pub(super) const FORMS: [(&str, &[&str]); 3] = [
        ("a register has a value", &["device", "register", "equals"]),
        (
            "a register has a value or more",
            &["device", "register", "at_least"],
        ),
        ("the robot is at a place", &["near_m", "within_m"]),
    ];

    /// What is meant.
    ///
    /// # Errors
    /// If the keys do not go together.
    pub fn condition(&self) -> Result<Condition, Flaw> {
        let expected = "expected device, register and equals or at_least, or near_m and within_m";
        let flaw = || Flaw::new("when", expected);
        match (&self.device, self.register, self.near_m, self.within_m) {
            (Some(device), Some(register), None, None) => {
                let (op, value) = match (self.equals, self.at_least) {
                    (Some(value), None) => (Op::Equal, value),
                    (None, Some(least)) => (Op::AtLeast, least),
                    _ => return Err(flaw()),
                };
                Ok(Condition::Register(RegisterCondition {
                    device: device.clone(),
                    address: register,
                    op,
                    value,
                }))
            }
            (None, None, Some(near_m), Some(within_m))
                if self.equals.is_none() && self.at_least.is_none() && within_m > 0.0 =>
            {
                Ok(Condition::Pose(PoseCondition { near_m, within_m }))
            }
            _ => Err(flaw()),
        }
    }
}
