//! What the robot has to do, and what must have come true.

use serde::{Deserialize, Serialize};

use super::Span;

/// What the robot has to do.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mission {
    /// Places to visit in this order, metres in the world's frame; the last is where the robot has
    /// to be in the end. Sent by the PC once it is connected.
    #[serde(default)]
    pub waypoints_m: Vec<[f64; 2]>,
    /// When the PC connects to the radio.
    #[serde(default = "default_connect")]
    pub connect: Span,
    /// What else the PC does, at given times.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub step: Vec<Step>,
    /// Goes on until the scenario's `duration`, even if all waypoints are visited before.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub to_the_end: bool,
}

/// Something that the PC does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// When.
    pub at: Span,
    /// What.
    #[serde(rename = "do")]
    pub action: Action,
}

/// What the PC can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Action {
    /// Connects to the radio.
    Connect,
    /// Disconnects.
    Disconnect,
    /// Replaces the robot's list of waypoints, metres in the world's frame.
    WaypointsM(Vec<[f64; 2]>),
    /// Orders a mode.
    Mode(ModeSpec),
    /// Orders manual mode with these set-points, left and right, in ticks per 40 ms.
    Drive([i8; 2]),
}

/// Modes that can be ordered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ModeSpec {
    /// Motors off.
    Stop,
    /// Drive by itself.
    Exploration,
    /// Visit the waypoints.
    Waypoint,
}

/// What must have come true in the end; what is not given is not demanded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// Each waypoint is visited in order, at most this far off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visit_within_mm: Option<f64>,
    /// In the end the robot rests at the last waypoint, at most this far off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub return_within_mm: Option<f64>,
    /// Having visited its waypoints, the robot rests for this long, and nothing goes wrong then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settle: Option<Span>,
    /// Root mean square of the error of the believed position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_rms_mm_max: Option<f64>,
    /// Root mean square of the error of the believed heading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading_rms_deg_max: Option<f64>,
    /// Share of walls found, and of found walls that are there, within one cell; the smaller one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wall_overlap_min: Option<f64>,
    /// Rules of devices that the program broke.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub violations_max: Option<u64>,
    /// The PC has received every row of the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_received: Option<bool>,
}

fn default_connect() -> Span {
    Span::from_millis(500)
}
