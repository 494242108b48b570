//! The condition of a fault.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Flaw;
use crate::scenario::condition::{Condition, Op, Operand, PoseCondition, RegisterCondition};

/// A condition that begins a fault: a register's value, or the robot's true position.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WhenSpec {
    /// Name of the device with the register.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Number of the register, or its name; of a described device also the name of a variable.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub register: Option<RegisterName>,
    /// The register has this value: a number, a text, true or false.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub equals: Option<Operand>,
    /// The register has at least this value, a number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_least: Option<Operand>,
    /// The robot is near this point, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near_m: Option<[f64; 2]>,
    /// Maximum distance, metres, more than 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_m: Option<f64>,
}

/// A register by its number or by its name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected the number or the name of a register")]
pub enum RegisterName {
    /// Its number.
    Number(u32),
    /// Its name.
    Name(String),
}

impl WhenSpec {
    /// The possible conditions in words, and their keys.
    pub(super) const FORMS: [(&str, &[&str]); 3] = [
        ("a register has a value", &["device", "register", "equals"]),
        (
            "a register has a value or more",
            &["device", "register", "at_least"],
        ),
        ("the robot is near a position", &["near_m", "within_m"]),
    ];

    /// The key in `when` from which `key` of the condition was made.
    pub(crate) fn key_of(&self, key: &'static str) -> &'static str {
        match key {
            "address" | "name" => "register",
            "value" if self.equals.is_some() => "equals",
            "value" => "at_least",
            other => other,
        }
    }

    /// The condition.
    ///
    /// # Errors
    /// If the keys do not go together.
    pub fn condition(&self) -> Result<Condition, Flaw> {
        let expected = "expected device, register and equals or at_least, or near_m and within_m";
        let flaw = || Flaw::new("when", expected);
        match (&self.device, &self.register, self.near_m, self.within_m) {
            (Some(device), Some(register), None, None) => {
                let (op, value) = match (&self.equals, &self.at_least) {
                    (Some(value), None) => (Op::Equal, value),
                    (None, Some(least)) => (Op::AtLeast, least),
                    _ => return Err(flaw()),
                };
                let (address, name) = match register {
                    RegisterName::Number(number) => (Some(*number), None),
                    RegisterName::Name(name) => (None, Some(name.clone())),
                };
                Ok(Condition::Register(RegisterCondition {
                    device: device.clone(),
                    address,
                    name,
                    op,
                    value: value.clone(),
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
