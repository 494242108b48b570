use emulators::world::BodyConfig;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The robot's body; the defaults are the rescue robot's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BodySpec {
    /// Radius of the disc that collides, metres, 0.02 to 2.
    #[schemars(range(min = 0.02, max = 2.0))]
    pub radius_m: f64,
    /// Radius of the wheels, metres, 0.001 to 1.
    #[schemars(range(min = 0.001, max = 1.0))]
    pub wheel_radius_m: f64,
    /// Distance between the wheels, metres, 0.01 to 4.
    #[schemars(range(min = 0.01, max = 4.0))]
    pub axle_m: f64,
    /// Encoder ticks per turn of a wheel, 1 to 1000000.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub ticks_per_turn: u32,
    /// Speed of a wheel at full drive, metres per second, 0 to 5.
    #[schemars(range(min = 0.0, max = 5.0))]
    pub full_speed_m_s: f64,
    /// Time constant of a driven wheel, seconds, 0 to 10.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub lag_s: f64,
    /// Share of the wheels' travel that is lost on the floor, left and right, -0.5 to 0.9.
    pub slip: [f64; 2],
    /// Noise of each wheel's travel after one metre: standard deviation, metres, 0 to 0.1.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub slip_noise_m: f64,
    /// Noise of the heading after one metre: standard deviation, radians, 0 to 0.5.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub heading_noise_rad: f64,
    /// Relative error of each wheel's radius, drawn once a run: standard deviation, 0 to 0.1.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub scale_noise: f64,
}

impl Default for BodySpec {
    fn default() -> Self {
        let config = BodyConfig::default();
        Self {
            radius_m: config.radius_m,
            wheel_radius_m: config.wheel_radius_m,
            axle_m: config.axle_m,
            ticks_per_turn: config.ticks_per_turn,
            full_speed_m_s: config.full_speed_m_s,
            lag_s: config.lag_s,
            slip: config.slip,
            slip_noise_m: config.slip_noise_m,
            heading_noise_rad: config.heading_noise_rad,
            scale_noise: config.scale_noise,
        }
    }
}

impl From<BodySpec> for BodyConfig {
    fn from(spec: BodySpec) -> Self {
        Self {
            radius_m: spec.radius_m,
            wheel_radius_m: spec.wheel_radius_m,
            axle_m: spec.axle_m,
            ticks_per_turn: spec.ticks_per_turn,
            full_speed_m_s: spec.full_speed_m_s,
            lag_s: spec.lag_s,
            slip: spec.slip,
            slip_noise_m: spec.slip_noise_m,
            heading_noise_rad: spec.heading_noise_rad,
            scale_noise: spec.scale_noise,
            ..Self::default()
        }
    }
}
