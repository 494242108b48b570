//! `mpu6050`: gyroscope and accelerometer on a separate I2C bus.

use emulators::i2c::OnBus;
use emulators::mpu6050::{Mpu6050, Mpu6050Config};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::srf08::bus;
use super::{BuildContext, Built, DeviceKind, Settings, read_settings, schema_of};
use crate::scenario::ScenarioError;

/// Settings of a gyroscope and accelerometer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Mpu6050Spec {
    /// Measured turn rates about x, y and z at rest, degrees per second, -20 to 20; a guess if not
    /// given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gyro_bias_dps: Option<[f64; 3]>,
    /// Standard deviation of a turn rate, degrees per second, 0 to 10; 0.05 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub gyro_noise_dps: Option<f64>,
    /// Standard deviation of an acceleration, m/s², 0 to 10; 0.04 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub accel_noise_m_s2: Option<f64>,
}

const EXAMPLE: &str = r#"[device.gyro.mpu6050]
gyro_bias_dps = [0, 0, 0.5]
gyro_noise_dps = 0.02
accel_noise_m_s2 = 0.01
"#;

/// The kind `mpu6050`.
pub const MPU6050: &dyn DeviceKind = &Mpu6050Kind;

struct Mpu6050Kind;

impl DeviceKind for Mpu6050Kind {
    fn name(&self) -> &'static str {
        "mpu6050"
    }

    fn about(&self) -> &'static str {
        "MPU-6050 gyroscope and accelerometer on an I2C bus"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<Mpu6050Spec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<Mpu6050Spec>(settings)
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &Mpu6050Spec = context.settings()?;
        for bias in spec.gyro_bias_dps.into_iter().flatten() {
            context.within("gyro_bias_dps", Some(bias), -20.0..=20.0)?;
        }
        context.within("gyro_noise_dps", spec.gyro_noise_dps, 0.0..=10.0)?;
        context.within("accel_noise_m_s2", spec.accel_noise_m_s2, 0.0..=10.0)?;
        let usual = Mpu6050Config::default();
        let config = Mpu6050Config {
            bias_dps: spec.gyro_bias_dps.unwrap_or(usual.bias_dps),
            gyro_noise_dps: spec.gyro_noise_dps.unwrap_or(usual.gyro_noise_dps),
            accel_noise_m_s2: spec.accel_noise_m_s2.unwrap_or(usual.accel_noise_m_s2),
            ..usual
        };
        Ok(Built {
            device: Box::new(OnBus::new(Mpu6050::new(config, context.seed, context.name))),
            ports: vec![bus("the robot's I2C bus")],
        })
    }
}
