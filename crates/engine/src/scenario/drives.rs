//! A value of your own slave that drives an actuator of the robot's chassis.

use emulators::quantity::{Sink, SinkKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

/// Actuator of the chassis that follows a value. One of the other keys gives the scale.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DrivesSpec {
    /// Name of the actuator: `left` and `right` of a differential chassis, `drive` and `steering`
    /// of an Ackermann chassis.
    #[schemars(with = "String")]
    pub actuator: Spanned<String>,
    /// Motor power per count; 255 is full power, as in an 8-bit compare register.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub power: Option<f64>,
    /// Regulated speed per count, metres per second.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_m_s: Option<f64>,
    /// Steering angle per count, degrees counter-clockwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<f64>,
}

impl DrivesSpec {
    /// Returns the actuator and its scale.
    ///
    /// # Errors
    /// A sentence, if the keys do not give exactly one scale.
    pub(super) fn sink(&self) -> Result<Sink, String> {
        let angle = self.angle_deg.map(f64::to_radians);
        let ways = [
            (SinkKind::Power, self.power),
            (SinkKind::Speed, self.speed_m_s),
            (SinkKind::Angle, angle),
        ];
        let mut given = ways
            .into_iter()
            .filter_map(|(kind, scale)| Some((kind, scale?)));
        match (given.next(), given.next()) {
            (Some((kind, scale)), None) if scale.is_finite() && scale != 0.0 => Ok(Sink {
                actuator: self.actuator.get_ref().clone(),
                scale,
                kind,
            }),
            _ => Err(format!(
                "drives \"{}\" without a scale or with several, \
                 expected one of power, speed_m_s and angle_deg, other than 0",
                self.actuator.get_ref()
            )),
        }
    }
}
