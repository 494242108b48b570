//! `odometer`: a microcontroller that prints distance and heading.

use emulators::odometer::{Odometer, OdometerConfig, Overrun, Program};
use emulators::world::World;
use protocols::LineConfig;
use protocols::odometer::{BAUD, Dialect};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::{BuildContext, Built, DeviceKind, PortInfo, Settings, read_settings, schema_of};
use crate::codec;
use crate::rig::AnyDevice;
use crate::scenario::ScenarioError;

/// Settings of an odometer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OdometerSpec {
    /// Format of its lines.
    #[serde(default)]
    pub program: LinesSpec,
    /// Whether a loop that takes too long delays the next one, instead of blocking it for 49 days.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub survives_overrun: bool,
    /// Whether the sensor of the program `raw` has a magnetometer; the published sketch prints 0
    /// for the three figures of the field.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub compass: bool,
    /// Encoder of the chassis that it counts; `drive` if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub encoder: Option<String>,
    /// Bias of the gyroscope at rest, degrees per second, -20 to 20; a guess if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -20.0, max = 20.0))]
    pub gyro_bias_dps: Option<f64>,
}

/// Lines of an odometer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LinesSpec {
    /// The lines of the sketch of March 2016.
    #[default]
    AsCoded,
    /// The lines of the report.
    Seed,
    /// Whole numbers and a CRC.
    Fixed,
    /// The later sketch: distance, three turn rates in rad/s, three accelerations in m/s², and
    /// three figures of a magnetic field.
    Raw,
}

impl LinesSpec {
    /// Meaning of the numbers of a pose; `None`: the device has no pose.
    pub const fn dialect(self) -> Option<Dialect> {
        match self {
            Self::AsCoded => Some(Dialect::AsCoded),
            Self::Seed => Some(Dialect::Seed),
            Self::Fixed => Some(Dialect::Fixed),
            Self::Raw => None,
        }
    }
}

const EXAMPLE: &str = r#"[device.wheel.odometer]
program = "fixed"
survives_overrun = true
encoder = "left"
gyro_bias_dps = 0.05
"#;

/// The kind `odometer`.
pub const ODOMETER: &dyn DeviceKind = &OdometerKind;

struct OdometerKind;

impl DeviceKind for OdometerKind {
    fn name(&self) -> &'static str {
        "odometer"
    }

    fn about(&self) -> &'static str {
        "Microcontroller that prints distance and heading"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<OdometerSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<OdometerSpec>(settings)
    }

    fn check(
        &self,
        context: &BuildContext<'_>,
        _: &dyn AnyDevice,
        world: &World,
    ) -> Result<(), ScenarioError> {
        let spec: &OdometerSpec = context.settings()?;
        let usual = OdometerConfig::default().encoder;
        context.needs_encoder(spec.encoder.as_ref().unwrap_or(&usual), world)
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &OdometerSpec = context.settings()?;
        context.within("gyro_bias_dps", spec.gyro_bias_dps, -20.0..=20.0)?;
        let program = spec.program.dialect().map_or(Program::Raw, Program::Pose);
        let mut config = OdometerConfig {
            has_compass: spec.compass,
            overrun: match spec.survives_overrun {
                true => Overrun::IsLate,
                false => Overrun::Hangs,
            },
            seed: context.seed,
            ..OdometerConfig::of(program)
        };
        if let Some(encoder) = &spec.encoder {
            config.encoder.clone_from(encoder);
        }
        if let Some(bias_dps) = spec.gyro_bias_dps {
            config.imu.bias_dps[2] = bias_dps;
        }
        let line = LineConfig::new_8n1(BAUD);
        let uart = PortInfo::uart("uart", Odometer::UART, line, "the robot's odometer input")
            .speaking(&codec::ODOMETER);
        Ok(Built {
            device: Box::new(Odometer::new(config)),
            ports: vec![uart],
        })
    }
}
