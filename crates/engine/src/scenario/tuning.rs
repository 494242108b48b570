//! Tuning of the robot's program: figures that the seed report compares.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Flaw;

/// Figures that replace the program's own; each robot supports some of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TuningSpec {
    /// Number of scan points that rate each pose of a search, 1 to 360.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 360))]
    pub points: Option<u16>,
    /// Number of tries per search, 1 to 20000, instead of a time limit; only for the document's
    /// mapper.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 20000))]
    pub tries: Option<u16>,
    /// Width of the hole that a beam's end draws into the map, mm, 20 to 2000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 20, max = 2000))]
    pub hole_mm: Option<u16>,
    /// Weight of a map update, of 256, 1 to 255. The report's 10 on a scale of 0 to 100 is 26; the
    /// published code, and the mapper `document` without this key, take 10 of 256.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 255))]
    pub weight: Option<u16>,
    /// Reduction of `weight` while the robot turns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fading: Option<FadingSpec>,
    /// Whether scans stay distorted by the robot's motion, instead of being corrected.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub smear: bool,
    /// Radius of the body that the program keeps free, mm, 50 to 500.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 50, max = 500))]
    pub radius_mm: Option<u16>,
    /// Safety distance between the body and all obstacles, mm, 0 to 500.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0, max = 500))]
    pub clearance_mm: Option<u16>,
    /// Uses the base's infrared sensors: an object that only they detect, such as glass or a low
    /// object, is an obstacle.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub infrared: bool,
    /// Method of following walls.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub walls: Option<WallsSpec>,
}

/// How the weight of a map update falls with the difference of the wheels' speeds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FadingSpec {
    /// Not at all.
    None,
    /// By a tenth for each tick.
    Linear,
    /// By the square of `linear`.
    Quadratic,
}

/// How walls are followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WallsSpec {
    /// By a single beam, as in the seed document.
    Beam,
    /// By the nearest point.
    Nearest,
}

impl TuningSpec {
    /// Checks the figures.
    ///
    /// # Errors
    /// A flaw that names the key.
    pub fn check(&self) -> Result<(), Flaw> {
        for (key, value, [least, most]) in [
            ("points", self.points, [1, 360]),
            ("tries", self.tries, [1, 20_000]),
            ("hole_mm", self.hole_mm, [20, 2_000]),
            ("weight", self.weight, [1, 255]),
            ("radius_mm", self.radius_mm, [50, 500]),
            ("clearance_mm", self.clearance_mm, [0, 500]),
        ] {
            if let Some(value) = value.filter(|value| !(least..=most).contains(value)) {
                let message = format!("is {value}, expected {least} to {most}");
                return Err(Flaw::new(key, message));
            }
        }
        Ok(())
    }
}
