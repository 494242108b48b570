//! The robot's body: two wheels under a round deck.

use emulators::world::{BodyConfig, Chassis, Differential};

use crate::robots::refuse_chassis;
use crate::scenario::world::BodySpec;
use crate::scenario::{Scenario, ScenarioError, Source, body_error};

/// Wheel radius 37.5 mm, track 180 mm and 1200 counts per turn come from the published code; 60 ms
/// of lag and the radius of the deck are guesses.
pub(super) const RADIUS_M: f64 = 0.12;
const WHEEL_RADIUS_M: f64 = 0.0375;
const AXLE_M: f64 = 0.18;
const COUNTS_PER_TURN: u32 = 1_200;
const LAG_S: f64 = 0.060;
/// Above the speed of the fastest motor on a full battery: 504 rpm are 1.98 m/s.
const FULL_SPEED_M_S: f64 = 2.0;
/// Floor noise that keeps the odometry within 1 % of the path, as the course's acceptance list
/// assumes: the smaller the track, the more the same difference turns the robot.
const SCALE_NOISE: f64 = 0.0003;
const HEADING_NOISE_RAD: f64 = 0.002;

/// The chassis; values of `[world.body]` override it if they differ from the defaults.
pub(super) fn chassis(
    scenario: &Scenario,
    source: &Source,
) -> Result<Box<dyn Chassis>, ScenarioError> {
    refuse_chassis(scenario, source)?;
    let body = body(scenario.world.body);
    let chassis = Differential::new(body, scenario.seed)
        .map_err(|error| body_error(source, &error.to_string()))?;
    Ok(Box::new(chassis))
}

fn body(spec: BodySpec) -> BodyConfig {
    let (given, usual) = (BodyConfig::from(spec), BodyConfig::default());
    let or = |given: f64, usual: f64, own: f64| {
        if given.to_bits() == usual.to_bits() {
            own
        } else {
            given
        }
    };
    BodyConfig {
        radius_m: or(given.radius_m, usual.radius_m, RADIUS_M),
        wheel_radius_m: or(given.wheel_radius_m, usual.wheel_radius_m, WHEEL_RADIUS_M),
        axle_m: or(given.axle_m, usual.axle_m, AXLE_M),
        ticks_per_turn: if given.ticks_per_turn == usual.ticks_per_turn {
            COUNTS_PER_TURN
        } else {
            given.ticks_per_turn
        },
        full_speed_m_s: or(given.full_speed_m_s, usual.full_speed_m_s, FULL_SPEED_M_S),
        lag_s: or(given.lag_s, usual.lag_s, LAG_S),
        scale_noise: or(given.scale_noise, usual.scale_noise, SCALE_NOISE),
        heading_noise_rad: or(
            given.heading_noise_rad,
            usual.heading_noise_rad,
            HEADING_NOISE_RAD,
        ),
        ..given
    }
}
