//! Task of the robot, and expectations.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use toml::Spanned;

use super::{
    BytesCondition, Condition, DirectionSpec, Flaw, GoldenSpec, Operand, RuleSpec, SafetySpec, Span,
};

/// Task of the robot.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Mission {
    /// Waypoints in their order, metres in the world's frame, -10000 to 10000; the robot must end
    /// at the last. The PC sends them 200 ms after it is connected.
    #[serde(default)]
    pub waypoints_m: Vec<[f64; 2]>,
    /// When the PC connects to the radio, counted from the start of the run.
    #[serde(default = "default_connect")]
    pub connect: Span,
    /// Further orders of the PC, at given times or after a condition.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub step: Vec<Step>,
    /// Whether the run continues until the scenario's `duration` after all waypoints are visited.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub to_the_end: bool,
    /// Whether the waypoints count in any order, for a robot that finds them itself.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub any_order: bool,
}

impl Mission {
    /// Whether the file gives no time of connection, or the usual one.
    pub(crate) fn connects_as_usual(&self) -> bool {
        [Span::default(), default_connect()].contains(&self.connect)
    }

    /// Whether the mission orders anything: it has waypoints or steps.
    pub fn gives_orders(&self) -> bool {
        !self.waypoints_m.is_empty() || !self.step.is_empty()
    }
}

/// An order of the PC: at a time, or after a condition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Time of the order, counted from the start of the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<Span>,
    /// Instead of `at`: condition for the order, as in `docs/control.md`. The rig checks it after
    /// the earlier steps are done. If it stays false, the run fails.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub when: Option<Condition>,
    /// With `when`: maximum wait; until the end of the run if not given. After a timeout, later
    /// steps with a condition are also skipped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timeout: Option<Span>,
    /// Order of the PC.
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

    /// Checks that the keys do not contradict each other.
    ///
    /// # Errors
    /// A flaw that names the key.
    pub fn check(&self) -> Result<(), Flaw> {
        if let Action::Inject(inject) = &self.action {
            inject.bytes()?;
        }
        match (self.at, &self.when, self.timeout) {
            (Some(_), None, None) => Ok(()),
            (None, Some(when), _) => when.check(),
            (Some(_), None, Some(_)) => Err(Flaw::new("timeout", "expected only beside when")),
            _ => Err(Flaw::new("at", "expected at or when, and not both")),
        }
    }
}

/// Orders of the PC.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Action {
    /// Connects to the radio.
    Connect,
    /// Disconnects.
    Disconnect,
    /// Replaces the robot's list of waypoints, metres in the world's frame, -10000 to 10000.
    WaypointsM(Vec<[f64; 2]>),
    /// Orders a mode by its name; each robot has its own modes. Figures follow the names of some:
    /// yellow's `reactive 0.2` sets the speed, 0.03 to 1.8 m/s; `set-pose 0.5 1.2 90` and `go-to
    /// 0.5 1.2 90` of yellow and the car have metres and degrees.
    Mode(String),
    /// Drives by hand: a set-point for each of the robot's axes, in their order and unit.
    Drive(Vec<SetPoint>),
    /// Not an order of the PC: puts bytes on a line, as if the line's sender had sent them. Faults
    /// of the line do not change these bytes.
    Inject(InjectSpec),
    /// Not an order of the PC: sets a value of your own device.
    Set(SetSpec),
}

impl Action {
    /// Whether the rig itself executes the action, also for a robot without a PC.
    pub const fn is_of_the_rig(&self) -> bool {
        matches!(self, Self::Inject(_) | Self::Set(_))
    }
}

/// Bytes to put on a line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InjectSpec {
    /// Name of the link.
    pub link: String,
    /// Direction of the bytes.
    pub direction: DirectionSpec,
    /// Bytes as hexadecimal digits, spaces allowed: 1 to 256 bytes.
    pub hex: String,
}

impl InjectSpec {
    /// The bytes.
    ///
    /// # Errors
    /// If `hex` is no hexadecimal text of 1 to 256 bytes.
    pub fn bytes(&self) -> Result<Vec<u8>, Flaw> {
        let bytes = BytesCondition {
            link: self.link.clone(),
            direction: self.direction,
            hex: Some(self.hex.clone()),
            count: None,
        };
        Ok(bytes.pattern()?.unwrap_or_default())
    }
}

/// A value of a device to set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SetSpec {
    /// Name of the device.
    pub device: String,
    /// Name of the register or variable.
    pub name: String,
    /// Its new value.
    pub value: Operand,
}

/// A set-point of an axis, in the axis's unit; whole numbers are written without a fraction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct SetPoint(pub f64);

impl SetPoint {
    /// Set-points of several axes.
    pub fn list(values: impl IntoIterator<Item = impl Into<f64>>) -> Vec<Self> {
        values.into_iter().map(|value| Self(value.into())).collect()
    }

    /// The value as `i64`, if it is a whole number in range.
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

/// Expectations at the end of the run; keys that are not given are not checked.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// Each waypoint is visited in order, within this distance, millimetres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub visit_within_mm: Option<f64>,
    /// At the end the robot rests within this distance of the last waypoint, millimetres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub return_within_mm: Option<f64>,
    /// At the end of its own search, the robot reports that it is home and rests within this
    /// distance of its start, millimetres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub home_within_mm: Option<f64>,
    /// Minimum share of the reachable floor that is known in the robot's map, 0 to 1. The reachable
    /// floor is the area that the robot's body can cover. Gaps of 20 mm between beams count as
    /// seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub explored_min: Option<f64>,
    /// The robot marks each victim of the world within this distance, millimetres, marks nothing
    /// else, and drops one rescue kit for each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub victims_within_mm: Option<f64>,
    /// After its last waypoint, the robot rests for this time without a failure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settle: Option<Span>,
    /// Maximum root mean square error of the believed position, millimetres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub pose_rms_mm_max: Option<f64>,
    /// Maximum root mean square error of the believed heading, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub heading_rms_deg_max: Option<f64>,
    /// Minimum of two shares, 0 to 1: the share of true walls that are in the map, and the share of
    /// mapped walls that are true; within one cell or `wall_within_mm`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub wall_overlap_min: Option<f64>,
    /// Maximum distance of a mapped wall from the true wall, millimetres along x and y, in whole
    /// cells; one cell if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub wall_within_mm: Option<f64>,
    /// Maximum number of violations of device rules by the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub violations_max: Option<u64>,
    /// Time from which violations count for `violations_max`, except during a fault that has an end
    /// and for 5 s after it; those of links in `safety.alive_without` never count, nor those of a
    /// PC that waits behind a radio that was without power. All violations count if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub violations_from: Option<Span>,
    /// Whether the PC must receive every row of the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_received: Option<bool>,
    /// Earlier results that the run must resemble.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub golden: Option<GoldenSpec>,
    /// Safety during the whole run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub safety: Option<SafetySpec>,
    /// Rules of your own robot, and goals of a campaign.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<RuleSpec>")]
    pub rule: Vec<Spanned<RuleSpec>>,
}

impl Expect {
    /// The rules.
    pub fn rules(&self) -> impl Iterator<Item = &RuleSpec> {
        self.rule.iter().map(Spanned::get_ref)
    }

    /// The rules that apply to a run of any length: all except those that only the end of a run
    /// breaks.
    pub fn rules_throughout(&self) -> Vec<Spanned<RuleSpec>> {
        let rules = self.rule.iter();
        let rules = rules.filter(|rule| !rule.get_ref().is_of_the_end());
        rules.cloned().collect()
    }

    /// The rules that apply to a run of any length, for a run that is shorter than its scenario: it
    /// need not observe them, except that of the check `kept`.
    pub fn rules_of_shorter_runs(&self, kept: &str) -> Vec<Spanned<RuleSpec>> {
        let mut rules = self.rules_throughout();
        for rule in rules.iter_mut().map(Spanned::get_mut) {
            rule.may_be_unobserved |= rule.sometimes.is_none() && rule.check_name() != kept;
        }
        rules
    }

    /// Whether the check `name` belongs to a rule that only the end of a run can break.
    pub fn has_rule_of_the_end(&self, name: &str) -> bool {
        let mut rules = self.rules();
        rules.any(|rule| rule.is_of_the_end() && rule.check_name() == name)
    }
}

fn default_connect() -> Span {
    Span::from_millis(500)
}
