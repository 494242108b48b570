//! What the robot has to do, and what must have come true.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Condition, Flaw, Span};

/// What the robot has to do.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Mission {
    /// Places to visit in this order, metres in the world's frame, -10000 to 10000; the last is
    /// where the robot has to be in the end. Sent by the PC 200 ms after it is connected.
    #[serde(default)]
    pub waypoints_m: Vec<[f64; 2]>,
    /// When the PC connects to the radio, counted from the start of the run.
    #[serde(default = "default_connect")]
    pub connect: Span,
    /// What else the PC does, at given times or when something has come true.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub step: Vec<Step>,
    /// Goes on until the scenario's `duration`, even if all waypoints are visited before.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub to_the_end: bool,
    /// The waypoints count in any order: a robot that finds them by itself chooses.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub any_order: bool,
}

impl Mission {
    /// Whether the robot needs orders.
    pub fn gives_orders(&self) -> bool {
        !self.waypoints_m.is_empty() || !self.step.is_empty()
    }
}

/// Something that the PC does: at a time, or when a condition has come true.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// When, counted from the start of the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<Span>,
    /// Instead of `at`: what is waited for, as in `docs/control.md`, from when the steps before it
    /// are done. If it does not come true, the run fails.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub when: Option<Condition>,
    /// With `when`: how long is waited at most; until the end of the run if not given. The steps
    /// with a condition that come after it are then not done either.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timeout: Option<Span>,
    /// What the PC does then.
    #[serde(rename = "do")]
    pub action: Action,
}

impl Step {
    /// `action` at a time.
    pub const fn at(at: Span, action: Action) -> Self {
        Self {
            at: Some(at),
            when: None,
            timeout: None,
            action,
        }
    }

    /// Whether its keys make sense together.
    ///
    /// # Errors
    /// A flaw that names the key.
    pub fn check(&self) -> Result<(), Flaw> {
        match (self.at, &self.when, self.timeout) {
            (Some(_), None, None) => Ok(()),
            (None, Some(when), _) => when.check(),
            (Some(_), None, Some(_)) => Err(Flaw::new("timeout", "expected only beside when")),
            _ => Err(Flaw::new("at", "expected at or when, and not both")),
        }
    }
}

/// What the PC can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Action {
    /// Connects to the radio.
    Connect,
    /// Disconnects.
    Disconnect,
    /// Replaces the robot's list of waypoints, metres in the world's frame, -10000 to 10000.
    WaypointsM(Vec<[f64; 2]>),
    /// Orders a mode by its name; which there are, the robot says.
    Mode(String),
    /// Drives by hand: a set-point for each of the robot's axes, in their order and unit.
    Drive(Vec<SetPoint>),
}

/// A set-point of an axis, in the axis's unit; written without a fraction if it has none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct SetPoint(pub f64);

impl SetPoint {
    /// Set-points of several axes.
    pub fn list(values: impl IntoIterator<Item = impl Into<f64>>) -> Vec<Self> {
        values.into_iter().map(|value| Self(value.into())).collect()
    }

    /// It as a whole number, if it is one that `i64` holds.
    pub fn whole(self) -> Option<i64> {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "whole and far below the limit"
        )]
        (self.0.fract() == 0.0 && self.0.abs() < 1e15).then_some(self.0 as i64)
    }
}

impl Serialize for SetPoint {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.whole() {
            Some(whole) => serializer.serialize_i64(whole),
            None => serializer.serialize_f64(self.0),
        }
    }
}

/// What must have come true in the end; what is not given is not demanded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// Each waypoint is visited in order, at most this far off, millimetres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub visit_within_mm: Option<f64>,
    /// In the end the robot rests at the last waypoint, at most this far off, millimetres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub return_within_mm: Option<f64>,
    /// In the end the robot, having searched by itself, says that it is home and rests where it
    /// started, at most this far off, millimetres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub home_within_mm: Option<f64>,
    /// Share of the floor that the robot's body covers wherever it can get to, of which its map
    /// says anything, 0 to 1, at least. Slits of 20 mm between beams count as seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub explored_min: Option<f64>,
    /// Each victim of the world is marked by the robot at most this far off, millimetres, nothing
    /// else is, and a rescue kit was dropped once for each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub victims_within_mm: Option<f64>,
    /// Having visited its waypoints, the robot rests for this long, and nothing goes wrong then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settle: Option<Span>,
    /// Root mean square of the error of the believed position, millimetres, at most.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub pose_rms_mm_max: Option<f64>,
    /// Root mean square of the error of the believed heading, degrees, at most.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub heading_rms_deg_max: Option<f64>,
    /// Share of walls found, and of found walls that are there, within one cell or
    /// `wall_within_mm`: the smaller one, 0 to 1, at least.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub wall_overlap_min: Option<f64>,
    /// So far from where it is a wall may be drawn, millimetres along x and y, in whole cells; one
    /// cell if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub wall_within_mm: Option<f64>,
    /// How often the program broke a rule of a device, at most.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub violations_max: Option<u64>,
    /// Whether the PC must have received every row of the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_received: Option<bool>,
}

fn default_connect() -> Span {
    Span::from_millis(500)
}
