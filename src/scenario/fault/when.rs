//! What a fault waits for.

use emulators::world::Pose;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Flaw;

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

/// A condition that makes sense.
#[derive(Clone, Debug, PartialEq)]
pub enum Condition {
    /// A register's value lies in a range.
    Register {
        /// Whose.
        device: String,
        /// Which.
        register: u8,
        /// Least and greatest value.
        range: [u8; 2],
    },
    /// The robot is in a circle.
    Near {
        /// Middle, m.
        place: [f64; 2],
        /// Radius, m.
        within: f64,
    },
}

impl WhenSpec {
    /// What is meant.
    ///
    /// # Errors
    /// If the keys do not go together.
    pub fn condition(&self) -> Result<Condition, Flaw> {
        let expected = "expected device, register and equals or at_least, or near_m and within_m";
        let flaw = || Flaw::new("when", expected);
        match (&self.device, self.register, self.near_m, self.within_m) {
            (Some(device), Some(register), None, None) => {
                let range = match (self.equals, self.at_least) {
                    (Some(value), None) => [value; 2],
                    (None, Some(least)) => [least, u8::MAX],
                    _ => return Err(flaw()),
                };
                Ok(Condition::Register {
                    device: device.clone(),
                    register,
                    range,
                })
            }
            (None, None, Some(place), Some(within))
                if self.equals.is_none() && self.at_least.is_none() && within > 0.0 =>
            {
                Ok(Condition::Near { place, within })
            }
            _ => Err(flaw()),
        }
    }
}

impl Condition {
    /// Whether it holds; `register` looks a register of a device up.
    pub fn holds(&self, pose: Pose, register: impl FnOnce(&str, u8) -> Option<u8>) -> bool {
        match self {
            Self::Register {
                device,
                register: address,
                range: [least, most],
            } => register(device, *address).is_some_and(|value| (*least..=*most).contains(&value)),
            Self::Near { place, within } => {
                libm::hypot(pose.x - place[0], pose.y - place[1]) <= *within
            }
        }
    }
}
