//! Conditions that are waited for by a mission's step, a client of the control socket, a fault.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{DirectionSpec, Flaw};

/// A condition on a run. Bytes, frames and log entries count from the start of the wait.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Condition {
    /// Bytes arrived at one end of a link.
    Bytes(BytesCondition),
    /// A valid frame arrived at one end of a link.
    Frame(FrameCondition),
    /// A register of a device has a value.
    Register(RegisterCondition),
    /// The robot truly is near a place.
    Pose(PoseCondition),
    /// A device or the rig logged something.
    Event(EventCondition),
    /// The share of known cells in the robot's map.
    Map(MapCondition),
    /// At least this number of waypoints was visited; 1 or more.
    Visited(usize),
    /// The set-point or the measured value of an axis.
    Axis(AxisCondition),
}

/// Bytes to wait for: give `hex` or `count`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BytesCondition {
    /// Name of the link.
    pub link: String,
    /// Direction of the bytes.
    pub direction: DirectionSpec,
    /// Sequence of bytes as hexadecimal digits, spaces allowed: at most 256 bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hex: Option<String>,
    /// Number of bytes, at least 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1))]
    pub count: Option<u64>,
}

/// A frame to wait for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameCondition {
    /// Name of the link.
    pub link: String,
    /// Direction of the frame.
    pub direction: DirectionSpec,
    /// Part of the frame's words, as `hilrig decode` prints them; any frame if empty.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub contains: String,
}

/// A register's value to wait for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterCondition {
    /// Name of the device.
    pub device: String,
    /// Number of the register, 0 to 255.
    pub address: u8,
    /// How its value compares.
    #[serde(default)]
    pub op: Op,
    /// Value for the comparison, 0 to 255.
    pub value: u8,
}

/// A place to wait for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseCondition {
    /// The place, metres in the world's frame.
    pub near_m: [f64; 2],
    /// Maximum distance, metres, more than 0.
    pub within_m: f64,
}

/// An entry of the log to wait for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EventCondition {
    /// Its rule, e.g. `motors-stopped`.
    pub rule: String,
    /// Name of the device or link that logged it; any if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
}

/// Share of the map to wait for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MapCondition {
    /// Minimum share of known cells, 0 to 1.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub known_min: f64,
}

/// Condition on an axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisCondition {
    /// Name of the axis.
    pub name: String,
    /// Which of its figures.
    #[serde(default, skip_serializing_if = "Figure::is_set_point")]
    pub of: Figure,
    /// How it compares.
    #[serde(default)]
    pub op: Op,
    /// Value for the comparison, in the unit of the axis.
    pub value: f64,
}

/// A figure of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Figure {
    /// The set-point in its device.
    #[default]
    SetPoint,
    /// The measured value.
    Actual,
}

impl Figure {
    const fn is_set_point(&self) -> bool {
        matches!(self, Self::SetPoint)
    }
}

/// How two values compare.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Op {
    /// Equal.
    #[default]
    #[serde(rename = "==")]
    Equal,
    /// Not equal.
    #[serde(rename = "!=")]
    Unequal,
    /// Less.
    #[serde(rename = "<")]
    Less,
    /// Less or equal.
    #[serde(rename = "<=")]
    AtMost,
    /// Greater.
    #[serde(rename = ">")]
    Greater,
    /// Greater or equal.
    #[serde(rename = ">=")]
    AtLeast,
}

impl Op {
    /// Whether the comparison of `left` with `right` is true.
    pub fn holds<T: PartialOrd>(self, left: &T, right: &T) -> bool {
        match self {
            Self::Equal => left == right,
            Self::Unequal => left != right,
            Self::Less => left < right,
            Self::AtMost => left <= right,
            Self::Greater => left > right,
            Self::AtLeast => left >= right,
        }
    }
}

/// Longest pattern of bytes.
const PATTERN_MAX: usize = 256;

impl BytesCondition {
    /// The bytes of `hex`, if it is given.
    ///
    /// # Errors
    /// If it is no hexadecimal text of 1 to 256 bytes.
    pub fn pattern(&self) -> Result<Option<Vec<u8>>, Flaw> {
        let Some(hex) = &self.hex else {
            return Ok(None);
        };
        let digits: Option<Vec<u8>> = hex
            .chars()
            .filter(|c| !c.is_whitespace())
            .map(|c| c.to_digit(16).and_then(|digit| u8::try_from(digit).ok()))
            .collect();
        let pairs = digits.filter(|digits| digits.len().is_multiple_of(2));
        let bytes = pairs.map(|digits| digits.chunks(2).map(|two| two[0] << 4 | two[1]).collect());
        let bytes = bytes.filter(|bytes: &Vec<u8>| (1..=PATTERN_MAX).contains(&bytes.len()));
        let expected = "expected 1 to 256 bytes as pairs of hexadecimal digits such as \"fa a0\"";
        let flaw = || Flaw::new("hex", format!("is {hex:?}, {expected}"));
        bytes.map(Some).ok_or_else(flaw)
    }
}

impl Condition {
    /// Checks its figures, independent of the robot.
    ///
    /// # Errors
    /// A flaw that names the key.
    pub fn check(&self) -> Result<(), Flaw> {
        match self {
            Self::Bytes(bytes) => {
                bytes.pattern()?;
                match (&bytes.hex, bytes.count) {
                    (Some(_), None) | (None, Some(1..)) => Ok(()),
                    _ => Err(Flaw::new("count", "expected hex, or a count of at least 1")),
                }
            }
            Self::Pose(pose) => {
                let is_place = pose.near_m.iter().all(|metres| metres.is_finite());
                match is_place && pose.within_m > 0.0 {
                    true => Ok(()),
                    false => Err(Flaw::new("within_m", "expected more than 0 metres")),
                }
            }
            Self::Map(map) if !(0.0..=1.0).contains(&map.known_min) => {
                let message = format!("is {}, expected a share from 0 to 1", map.known_min);
                Err(Flaw::new("known_min", message))
            }
            Self::Visited(0) => Err(Flaw::new("visited", "is 0, expected at least 1")),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<(), String> {
        let condition: Condition = serde_json::from_str(text).map_err(|error| error.to_string())?;
        condition.check().map_err(|flaw| flaw.to_string())
    }

    #[test]
    fn conditions_are_read_and_refused_with_the_key() {
        let sound = [
            r#"{"bytes":{"link":"a","direction":"to-master","hex":"FA a0"}}"#,
            r#"{"bytes":{"link":"a","direction":"to-device","count":3}}"#,
            r#"{"frame":{"link":"a","direction":"to-device","contains":"x"}}"#,
            r#"{"register":{"device":"base","address":4,"op":">=","value":7}}"#,
            r#"{"pose":{"near_m":[1,2.5],"within_m":0.1}}"#,
            r#"{"event":{"rule":"motors-on"}}"#,
            r#"{"map":{"known_min":0.5}}"#,
            r#"{"visited":2}"#,
            r#"{"axis":{"name":"left","op":"!=","value":0}}"#,
        ];
        for text in sound {
            assert_eq!(read(text), Ok(()), "{text}");
        }
        let flawed = [
            (
                r#"{"bytes":{"link":"a","direction":"to-master","hex":"f"}}"#,
                "hex",
            ),
            (r#"{"bytes":{"link":"a","direction":"to-master"}}"#, "count"),
            (
                r#"{"bytes":{"link":"a","direction":"to-master","count":0}}"#,
                "count",
            ),
            (r#"{"pose":{"near_m":[1,2],"within_m":0}}"#, "within_m"),
            (r#"{"map":{"known_min":2}}"#, "known_min"),
            (r#"{"visited":0}"#, "visited"),
            (
                r#"{"register":{"device":"base","address":4,"op":"=>","value":7}}"#,
                "=>",
            ),
            (r#"{"event":{"rule":"x","of":1}}"#, "of"),
        ];
        for (text, key) in flawed {
            let said = read(text).expect_err(text);
            assert!(said.contains(key), "{text}: {said}");
        }
    }
}
