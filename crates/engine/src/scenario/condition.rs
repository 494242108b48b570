//! Conditions on a run. Mission steps, faults, rules and clients of the control socket use the same
//! conditions.

mod check;
mod value;
mod words;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{DirectionSpec, Flaw};

pub use value::{Op, Operand};

/// A condition on a run. In a wait, bytes, frames, contacts and log entries count from its start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Condition {
    /// Bytes arrived at one end of a link.
    Bytes(BytesCondition),
    /// A valid frame arrived at one end of a link.
    Frame(FrameCondition),
    /// A register of a device has a value.
    Register(RegisterCondition),
    /// The robot's true position is near a point.
    Pose(PoseCondition),
    /// A device or the rig logged an event.
    Event(EventCondition),
    /// The share of known cells in the robot's map.
    Map(MapCondition),
    /// At least this number of waypoints was visited; 1 or more.
    Visited(usize),
    /// The set-point or the measured value of an axis.
    Axis(AxisCondition),
    /// A true figure of the robot: speed, turn rate, pose, contacts, clearance.
    Robot(RobotCondition),
    /// The robot touched something.
    Contact(ContactCondition),
    /// All conditions of a list hold.
    All(Vec<Self>),
    /// At least one condition of a list holds.
    Any(Vec<Self>),
    /// A condition does not hold; not for conditions on bytes, frames, contacts or events.
    Not(Box<Self>),
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
    /// A field of the frame, by the name that `hilrig decode` prints; frames without it do not
    /// count.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field: Option<String>,
    /// With `field`: how its value compares.
    #[serde(default, skip_serializing_if = "Op::is_equal")]
    pub op: Op,
    /// With `field`: number or text for the comparison.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<Operand>,
}

/// A value of a device to wait for: give `address` or `name`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterCondition {
    /// Name of the device.
    pub device: String,
    /// Number of the register: one byte of a built-in base, or the whole value of your own device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub address: Option<u32>,
    /// Name of the register, variable or field of state.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// How its value compares.
    #[serde(default)]
    pub op: Op,
    /// Number or text for the comparison.
    pub value: Operand,
}

/// A place to wait for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseCondition {
    /// The point, metres in the world's frame.
    pub near_m: [f64; 2],
    /// Maximum distance, metres, more than 0.
    pub within_m: f64,
}

/// An entry of the log to wait for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EventCondition {
    /// Rule of the event, e.g. `motors-stopped`.
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
    /// Figure of the axis: set-point or measured value.
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

impl Op {
    const fn is_equal(&self) -> bool {
        matches!(self, Self::Equal)
    }
}

impl Figure {
    const fn is_set_point(&self) -> bool {
        matches!(self, Self::SetPoint)
    }
}

/// A true figure of the robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RobotCondition {
    /// Figure of the robot.
    pub of: Quantity,
    /// How it compares.
    #[serde(default)]
    pub op: Op,
    /// Value for the comparison, in the figure's unit.
    pub value: f64,
}

/// True figures of the robot, in the units of their names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// Ground speed, whatever the direction.
    SpeedMS,
    /// Turn rate, counter-clockwise positive.
    TurnRateDegS,
    /// Position in the world.
    XM,
    /// Position in the world.
    YM,
    /// Heading in the world, -180 to 180.
    HeadingDeg,
    /// Number of contacts so far.
    Contacts,
    /// Distance from the body's outline to the nearest obstacle.
    ClearanceM,
}

/// A contact to wait for.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ContactCondition {
    /// Only contacts in which the robot itself was faster than this, metres per second.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub faster_than_m_s: Option<f64>,
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
            r#"{"register":{"device":"scale","name":"state","value":"idle"}}"#,
            r#"{"frame":{"link":"a","direction":"to-device","field":"w","op":"<","value":3}}"#,
            r#"{"robot":{"of":"speed-m-s","op":"<=","value":0.5}}"#,
            r#"{"contact":{}}"#,
            r#"{"all":[{"visited":1},{"any":[{"contact":{"faster_than_m_s":0.1}}]}]}"#,
            r#"{"not":{"robot":{"of":"contacts","value":0}}}"#,
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
            (r#"{"register":{"device":"base","value":7}}"#, "address"),
            (
                r#"{"register":{"device":"base","address":4,"name":"x","value":7}}"#,
                "address",
            ),
            (
                r#"{"register":{"device":"base","name":"x","op":"<","value":"y"}}"#,
                "op",
            ),
            (
                r#"{"frame":{"link":"a","direction":"to-device","field":"w"}}"#,
                "value",
            ),
            (
                r#"{"frame":{"link":"a","direction":"to-device","value":1}}"#,
                "field",
            ),
            (r#"{"contact":{"faster_than_m_s":-1}}"#, "faster_than_m_s"),
            (r#"{"all":[]}"#, "all"),
            (r#"{"not":{"event":{"rule":"x"}}}"#, "not"),
            (r#"{"not":{"all":[{"contact":{}}]}}"#, "not"),
        ];
        for (text, key) in flawed {
            let said = read(text).expect_err(text);
            assert!(said.contains(key), "{text}: {said}");
        }
    }
}
