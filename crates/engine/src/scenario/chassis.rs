//! Drive train and outline of a custom robot.

use emulators::world::{
    Ackermann, AckermannConfig, BodyConfig, BodyError, Chassis, Differential, Floor, Footprint,
    Point, SteeringLaw,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::{ScenarioError, Source};

/// The drive train of a custom robot, one of these tables; for a built-in car, its changed figures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum ChassisSpec {
    /// Two driven wheels, one on either side. Its figures are those of `[world.body]`. Actuators
    /// and encoders `left` and `right`.
    Differential(DifferentialSpec),
    /// A car: driven rear axle, steered front wheels. Actuators `drive` and `steering`, encoders
    /// `drive`, `rear_left` and `rear_right`; its position is the middle of the rear axle.
    Ackermann(Box<AckermannSpec>),
}

/// Settings of a differential chassis in addition to `[world.body]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DifferentialSpec {
    /// Corners of the outline that collides, metres ahead and to the left of the middle of the
    /// axle; the disc of `[world.body]` if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Vec<[f64; 2]>>")]
    pub footprint_m: Option<Spanned<Vec<[f64; 2]>>>,
}

/// Figures of a car; the defaults are those of a Tamiya TT-01 in 1:10, or of the robot's own car.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AckermannSpec {
    /// Corners of the outline that collides, metres ahead and to the left of the middle of the rear
    /// axle; 0.359 m ahead, 0.101 m behind and 0.33 m wide if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Vec<[f64; 2]>>")]
    pub footprint_m: Option<Spanned<Vec<[f64; 2]>>>,
    /// Distance between the axles, metres; 0.258 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wheelbase_m: Option<f64>,
    /// Distance between the wheels of an axle, metres; 0.155 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub track_m: Option<f64>,
    /// Radius of the driven wheels, metres; 0.032 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wheel_radius_m: Option<f64>,
    /// Encoder counts per turn of a wheel; 60 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ticks_per_turn: Option<u32>,
    /// Largest steering angle to either side, degrees; 25 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_max_deg: Option<f64>,
    /// Ratio of the linkage: wheel angle divided by servo angle, 0.1 to 2; 1 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_gain: Option<f64>,
    /// Steering angle when the command is straight ahead, degrees, to the left positive; 0 if not
    /// given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_trim_deg: Option<f64>,
    /// Random change of the trim while the car rolls: standard deviation after one metre, degrees;
    /// 0 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_wander_deg: Option<f64>,
    /// Fastest turn of the servo, degrees per second; 172 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_rate_deg_s: Option<f64>,
    /// Floor under the car: `smooth`, `pvc` or `carpet`; smooth if not given. Below 0.02 m/s the
    /// wheels stop 4 degrees short of the command on PVC and do not turn on carpet. It changes
    /// neither slip nor grip.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<FloorSpec>,
    /// Speed at full drive, metres per second; 1.2 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub full_speed_m_s: Option<f64>,
    /// Time constant of the driven car, seconds; 0.3 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lag_s: Option<f64>,
    /// Share of the wheels' travel that is lost on the floor; 0.005 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slip: Option<f64>,
    /// Noise of the travel after one metre: standard deviation, metres; 0.002 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slip_noise_m: Option<f64>,
    /// Noise of the heading after one metre: standard deviation, radians; 0.004 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading_noise_rad: Option<f64>,
}

/// Kinds of floor, by the steering of a heavy car at rest. Source: the report of the car, page 27:
/// the servo is weak on PVC and useless on carpet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FloorSpec {
    /// The wheels reach the commanded angle at rest.
    Smooth,
    /// At rest the wheels stop 4 degrees short of the commanded angle (guess).
    Pvc,
    /// At rest the wheels do not turn.
    Carpet,
}

impl From<FloorSpec> for Floor {
    fn from(spec: FloorSpec) -> Self {
        match spec {
            FloorSpec::Smooth => Self::Smooth,
            FloorSpec::Pvc => Self::Pvc,
            FloorSpec::Carpet => Self::Carpet,
        }
    }
}

/// Counts per turn of the encoders at the rear wheels of a car.
const WHEEL_TICKS_PER_TURN: u32 = 120;

impl ChassisSpec {
    /// The chassis; `body` has the figures of a differential one, `seed` seeds its random numbers.
    ///
    /// # Errors
    /// If a figure is out of range, or the outline is not a polygon.
    pub fn build(
        &self,
        body: BodyConfig,
        seed: u64,
        source: &Source,
    ) -> Result<Box<dyn Chassis>, ScenarioError> {
        match self {
            Self::Differential(spec) => {
                let bad = |error: BodyError| body_error(source, &error.to_string());
                let chassis = Differential::new(body, seed).map_err(bad)?;
                let key = "chassis.differential.footprint_m";
                Ok(match footprint(spec.footprint_m.as_ref(), key, source)? {
                    Some(footprint) => Box::new(chassis.with_footprint(footprint)),
                    None => Box::new(chassis),
                })
            }
            // The boards of cars count encoders at the rear wheels.
            Self::Ackermann(spec) => {
                let usual = AckermannConfig {
                    wheel_ticks_per_turn: Some(WHEEL_TICKS_PER_TURN),
                    ..AckermannConfig::default()
                };
                spec.build(usual, seed, source)
            }
        }
    }
}

impl AckermannSpec {
    /// The car; `usual` provides missing figures, `seed` seeds its random numbers.
    ///
    /// # Errors
    /// If a figure is out of range, or the outline is not a polygon.
    pub fn build(
        &self,
        usual: AckermannConfig,
        seed: u64,
        source: &Source,
    ) -> Result<Box<dyn Chassis>, ScenarioError> {
        let key = "chassis.ackermann.footprint_m";
        let footprint = footprint(self.footprint_m.as_ref(), key, source)?;
        let chassis = Ackermann::new(self.config(usual, footprint), seed).map_err(|error| {
            let span = source.find("ackermann");
            source.invalid(span, "chassis.ackermann", error.to_string())
        })?;
        Ok(Box::new(chassis))
    }

    fn config(&self, usual: AckermannConfig, footprint: Option<Footprint>) -> AckermannConfig {
        let law = usual.steering_law;
        let radians = |degrees: Option<f64>, usual: f64| degrees.map_or(usual, f64::to_radians);
        AckermannConfig {
            footprint: footprint.unwrap_or(usual.footprint),
            wheelbase_m: self.wheelbase_m.unwrap_or(usual.wheelbase_m),
            track_m: self.track_m.unwrap_or(usual.track_m),
            wheel_radius_m: self.wheel_radius_m.unwrap_or(usual.wheel_radius_m),
            ticks_per_turn: self.ticks_per_turn.unwrap_or(usual.ticks_per_turn),
            steering_max_rad: radians(self.steering_max_deg, usual.steering_max_rad),
            steering_law: SteeringLaw {
                gain: self.steering_gain.unwrap_or(law.gain),
                trim_rad: radians(self.steering_trim_deg, law.trim_rad),
                wander_rad: radians(self.steering_wander_deg, law.wander_rad),
            },
            steering_rate_rad_s: radians(self.steering_rate_deg_s, usual.steering_rate_rad_s),
            floor: self.floor.map_or(usual.floor, Floor::from),
            full_speed_m_s: self.full_speed_m_s.unwrap_or(usual.full_speed_m_s),
            lag_s: self.lag_s.unwrap_or(usual.lag_s),
            slip: self.slip.unwrap_or(usual.slip),
            slip_noise_m: self.slip_noise_m.unwrap_or(usual.slip_noise_m),
            heading_noise_rad: self.heading_noise_rad.unwrap_or(usual.heading_noise_rad),
            ..usual
        }
    }
}

fn footprint(
    corners: Option<&Spanned<Vec<[f64; 2]>>>,
    key: &str,
    source: &Source,
) -> Result<Option<Footprint>, ScenarioError> {
    let Some(corners) = corners else {
        return Ok(None);
    };
    let points = corners.get_ref().iter().map(|&[x, y]| Point::new(x, y));
    let outline = Footprint::polygon(points.collect());
    let bad = |error: emulators::world::FootprintError| {
        source.invalid(Some(corners.span()), key, error.to_string())
    };
    outline.map(Some).map_err(bad)
}

/// The error of a figure of `[world.body]`, at its key; `message` is that of the body.
pub(crate) fn body_error(source: &Source, message: &str) -> ScenarioError {
    let named = message.strip_prefix("body.");
    match named.and_then(|rest| rest.split_once(' ')) {
        Some((key, rest)) => {
            let rest = rest.replace("; expected", ", expected");
            source.invalid(source.find(key), format!("world.body.{key}"), rest)
        }
        None => source.invalid(source.find("body"), "world.body", message),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use emulators::world::Command;

    use super::*;
    use crate::scenario::Scenario;

    /// The car of a scenario with these lines in `[chassis.ackermann]`; no noise of the travel.
    fn car(lines: &str) -> Result<Box<dyn Chassis>, ScenarioError> {
        let text = format!(
            "schema = 1\nname = \"floor\"\nrobot = \"custom\"\nduration = \"1s\"\n\
             [chassis.ackermann]\n{lines}\n[world]\n\
             start = {{ x_m = 1, y_m = 1, heading_deg = 0 }}\n"
        );
        let (scenario, source) = Scenario::parse(Path::new("floor.toml"), text)?;
        let chassis = scenario.chassis.expect("the text has one");
        chassis.build(BodyConfig::default(), 1, &source)
    }

    /// Angle of the wheels in radians: half a second after the command of 0.2 rad to a standing
    /// car, and half a second after the car drives. The servo's lag is 20 ms.
    fn angles(lines: &str) -> [f64; 2] {
        let mut car = car(lines).expect("sound");
        let actuator = |name| {
            let mut all = car.actuators().iter();
            all.position(|actuator| actuator.name == name).expect(name)
        };
        let [drive, steering] = ["drive", "steering"].map(actuator);
        car.actuate(steering, Command::Angle(0.2));
        for number in 0..500 {
            car.begin_step(number);
        }
        let at_rest = car.actual(steering);
        car.actuate(drive, Command::Speed(0.5));
        for number in 500..1_000 {
            car.begin_step(number);
        }
        [at_rest, car.actual(steering)]
    }

    /// Of 0.2 rad a standing car reaches all, 0.07 rad (4 degrees) less, or nothing; a rolling car
    /// reaches all.
    #[test]
    fn the_floor_of_a_scenario_weakens_the_servo_at_rest() {
        for (lines, expected) in [
            ("", 0.2),
            ("floor = \"smooth\"", 0.2),
            ("floor = \"pvc\"", 0.13),
            ("floor = \"carpet\"", 0.0),
        ] {
            let [at_rest, rolling] = angles(lines);
            assert!((at_rest - expected).abs() < 1e-6, "{lines}: {at_rest}");
            assert!((rolling - 0.2).abs() < 1e-6, "{lines}: {rolling}");
        }
    }

    #[test]
    fn an_unknown_floor_is_refused_with_the_choices() {
        let said = car("floor = \"ice\"")
            .map(drop)
            .expect_err("refused")
            .to_string();
        let expected = "floor.toml:6: chassis.ackermann.floor: is \"ice\", expected one of \
                        smooth, pvc, carpet";
        assert_eq!(said, expected);
    }
}
