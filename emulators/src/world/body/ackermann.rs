//! A car: one motor drives the rear axle, a servo steers the front wheels.
//!
//! ```text
//! steering -> lag, rate limit -> angle delta --+
//! drive -> motor -> shaft -> rear axle -> v ---+-> turn rate = v * tan(delta) / wheelbase
//! ```
//!
//! The reference point is the middle of the rear axle: poses of the world, the footprint and every
//! mount refer to it. Two wheels stand for four (the bicycle model): the differential gear is ideal
//! and tyres do not drift sideways. [`SteeringLaw`] and [`Floor`] describe the servo's true angle;
//! by default it equals the command, both at rest and rolling.

mod servo;
mod wheels;

use core::f64::consts::TAU;

use super::NOISE_STEPS;
use super::chassis::{Actuator, ActuatorKind, Chassis, Command, Encoder, Velocity};
use super::differential::{BodyError, check_ranges};
use super::footprint::Footprint;
use super::motor::{Motor, MotorFigures, Reversing, noise_root};
use crate::rng::Rng;
use servo::Servo;
pub use servo::{Floor, SteeringLaw};
use wheels::RearWheels;

/// Parameters that differ from car to car.
///
/// The defaults are a Tamiya TT-01 as TU Darmstadt used it: wheelbase 0.258 m, track 0.155 m
/// (ucboard documentation), covered floor 0.46 m x 0.33 m (its costmap; taken to be centred between
/// the axles), an encoder of 60 counts a turn on wheels of 32 mm, at most 25 degrees of steering.
/// Full speed, dead zone, lags, servo, slip and noise are guesses.
#[derive(Clone, Debug, PartialEq)]
pub struct AckermannConfig {
    /// Outline for collisions, relative to the middle of the rear axle.
    pub footprint: Footprint,
    /// Distance between the axles.
    pub wheelbase_m: f64,
    /// Distance between the wheels of one axle. It determines the extra distance of the outer
    /// wheel, and the tightest circle: a car cannot turn about a point between its wheels.
    pub track_m: f64,
    /// Radius of the driven wheels, metres.
    pub wheel_radius_m: f64,
    /// Encoder counts of the drive shaft per turn of a wheel.
    pub ticks_per_turn: u32,
    /// Counts per turn of each rear wheel, for the encoders `rear_left` and `rear_right`; `None`:
    /// the car has none.
    pub wheel_ticks_per_turn: Option<u32>,
    /// Maximum steering angle of the (single) front wheel, to either side.
    pub steering_max_rad: f64,
    /// Maximum turn rate of the servo.
    pub steering_rate_rad_s: f64,
    /// Time constant of the servo near its goal.
    pub steering_lag_s: f64,
    /// Difference between the wheels' angle and the commanded one.
    pub steering_law: SteeringLaw,
    /// Grip of the floor under the car.
    pub floor: Floor,
    /// Final speed at drive 255.
    pub full_speed_m_s: f64,
    /// Greatest drive at which the car does not move yet; below 255.
    pub dead_zone_drive: u8,
    /// Reaction of the motor driver while the car still rolls in the other direction.
    pub reversing: Reversing,
    /// Time constant of the driven car.
    pub lag_s: f64,
    /// Time constant of the braked car.
    pub brake_lag_s: f64,
    /// Time constant of the car that runs out.
    pub coast_lag_s: f64,
    /// Part of the wheels' travel that is lost on the floor.
    pub slip: f64,
    /// Noise of the travel: standard deviation in metres after one metre. Grows with the square
    /// root of the distance.
    pub slip_noise_m: f64,
    /// Noise of the heading: standard deviation in radians after one metre of wheel travel.
    pub heading_noise_rad: f64,
    /// Standard deviation of a relative error of the wheels' radius, drawn once for the run.
    pub scale_noise: f64,
}

impl Default for AckermannConfig {
    fn default() -> Self {
        Self {
            footprint: Footprint::rectangle(0.359, 0.101, 0.33).expect("a rectangle is an outline"),
            wheelbase_m: 0.258,
            track_m: 0.155,
            wheel_radius_m: 0.032,
            ticks_per_turn: 60,
            wheel_ticks_per_turn: None,
            steering_max_rad: 0.436,
            steering_rate_rad_s: 3.0,
            steering_lag_s: 0.020,
            steering_law: SteeringLaw::default(),
            floor: Floor::Smooth,
            full_speed_m_s: 1.2,
            dead_zone_drive: 20,
            reversing: Reversing::AtOnce,
            lag_s: 0.300,
            brake_lag_s: 0.080,
            coast_lag_s: 0.600,
            slip: 0.005,
            slip_noise_m: 0.002,
            heading_noise_rad: 0.004,
            scale_noise: 0.001,
        }
    }
}

impl AckermannConfig {
    /// The same car on a perfect floor: no slip, no noise. For tests with figures derived by hand.
    #[must_use]
    pub fn ideal(self) -> Self {
        Self {
            slip: 0.0,
            slip_noise_m: 0.0,
            heading_noise_rad: 0.0,
            scale_noise: 0.0,
            ..self
        }
    }

    /// Wheel travel per encoder count; 3.351 mm with the default figures.
    pub fn tick_m(&self) -> f64 {
        TAU * self.wheel_radius_m / f64::from(self.ticks_per_turn)
    }

    fn wheel_tick_m(&self) -> Option<f64> {
        let ticks = self.wheel_ticks_per_turn?;
        Some(TAU * self.wheel_radius_m / f64::from(ticks))
    }

    /// Names the first field that is out of range.
    ///
    /// # Errors
    /// The field, its value and its range.
    pub fn check(&self) -> Result<(), BodyError> {
        // The tightest circle goes around the inner rear wheel at the closest.
        let track_max_m = (2.0 * self.wheelbase_m / libm::tan(self.steering_max_rad)).min(4.0);
        check_ranges(&[
            ("wheelbase_m", self.wheelbase_m, 0.02, 4.0),
            ("wheel_radius_m", self.wheel_radius_m, 0.001, 1.0),
            ("ticks_per_turn", f64::from(self.ticks_per_turn), 1.0, 1e6),
            (
                "wheel_ticks_per_turn",
                f64::from(self.wheel_ticks_per_turn.unwrap_or(1)),
                1.0,
                1e6,
            ),
            ("steering_law.gain", self.steering_law.gain, 0.1, 2.0),
            (
                "steering_law.trim_rad",
                self.steering_law.trim_rad,
                -0.5,
                0.5,
            ),
            (
                "steering_law.wander_rad",
                self.steering_law.wander_rad,
                0.0,
                0.5,
            ),
            ("steering_max_rad", self.steering_max_rad, 0.01, 1.4),
            ("track_m", self.track_m, 0.01, track_max_m),
            ("steering_rate_rad_s", self.steering_rate_rad_s, 0.01, 100.0),
            ("steering_lag_s", self.steering_lag_s, 0.0, 10.0),
            ("full_speed_m_s", self.full_speed_m_s, 0.0, 5.0),
            (
                "dead_zone_drive",
                f64::from(self.dead_zone_drive),
                0.0,
                254.0,
            ),
            ("lag_s", self.lag_s, 0.0, 10.0),
            ("brake_lag_s", self.brake_lag_s, 0.0, 10.0),
            ("coast_lag_s", self.coast_lag_s, 0.0, 10.0),
            ("slip", self.slip, -0.5, 0.9),
            ("slip_noise_m", self.slip_noise_m, 0.0, 0.1),
            ("heading_noise_rad", self.heading_noise_rad, 0.0, 0.5),
            ("scale_noise", self.scale_noise, 0.0, 0.1),
        ])
    }

    fn motor(&self) -> MotorFigures {
        MotorFigures {
            full_speed_m_s: self.full_speed_m_s,
            dead_zone_drive: self.dead_zone_drive,
            lag_s: self.lag_s,
            brake_lag_s: self.brake_lag_s,
            coast_lag_s: self.coast_lag_s,
            slip_noise_m: self.slip_noise_m,
            reversing: self.reversing,
        }
    }
}

/// Places in the list of actuators.
const DRIVE: usize = 0;
const STEERING: usize = 1;

/// Place of the first rear wheel's encoder, behind that of the shaft.
const REAR_LEFT: usize = 1;

/// The car: actuators `drive` and `steering`, encoder `drive`, and if wanted `rear_left` and
/// `rear_right`.
#[derive(Clone, Debug, PartialEq)]
pub struct Ackermann {
    config: AckermannConfig,
    actuators: [Actuator; 2],
    encoders: Vec<Encoder>,
    motor: Motor,
    servo: Servo,
    wheels: RearWheels,
    heading_noise: Rng,
    heading_noise_now: f64,
}

impl Ackermann {
    /// A car at rest, brakes on, wheels straight ahead. The noise of the floor follows from `seed`.
    ///
    /// # Errors
    /// If a figure is out of range.
    pub fn new(config: AckermannConfig, seed: u64) -> Result<Self, BodyError> {
        config.check()?;
        let actuator = |name: &str, kind, most: f64| Actuator {
            name: name.to_owned(),
            kind,
            range: [-most, most],
        };
        let noise = (config.slip, config.scale_noise);
        Ok(Self {
            actuators: [
                actuator("drive", ActuatorKind::Motor, config.full_speed_m_s),
                actuator("steering", ActuatorKind::Steering, config.steering_max_rad),
            ],
            encoders: encoders(&config),
            motor: Motor::new(config.motor(), noise, seed, "drive"),
            servo: Servo::new(&config, seed),
            wheels: RearWheels::default(),
            heading_noise: Rng::stream(seed, "world.heading"),
            heading_noise_now: 0.0,
            config,
        })
    }
}

/// The encoders of the shaft, then of the rear wheels if they have any.
fn encoders(config: &AckermannConfig) -> Vec<Encoder> {
    let encoder = |name: &str, tick_m: f64| Encoder {
        name: name.to_owned(),
        counts_per_m: 1.0 / tick_m,
    };
    let mut encoders = vec![encoder("drive", config.tick_m())];
    if let Some(tick_m) = config.wheel_tick_m() {
        encoders.extend(["rear_left", "rear_right"].map(|name| encoder(name, tick_m)));
    }
    encoders
}

impl Chassis for Ackermann {
    fn footprint(&self) -> &Footprint {
        &self.config.footprint
    }

    fn actuators(&self) -> &[Actuator] {
        &self.actuators
    }

    fn actuate(&mut self, actuator: usize, command: Command) {
        match (actuator, command) {
            (DRIVE, command) => self.motor.set(command),
            (STEERING, Command::Angle(angle)) => self.servo.set(angle),
            _ => {}
        }
    }

    fn command(&self, actuator: usize) -> Command {
        match actuator {
            DRIVE => self.motor.command(),
            _ => Command::Angle(self.servo.wanted),
        }
    }

    fn actual(&self, actuator: usize) -> f64 {
        match actuator {
            DRIVE => self.motor.speed,
            _ => self.servo.angle,
        }
    }

    fn begin_step(&mut self, number: u64) -> Velocity {
        if number.is_multiple_of(NOISE_STEPS) {
            self.motor.draw_noise();
            self.heading_noise_now =
                self.config.heading_noise_rad / noise_root() * self.heading_noise.gauss();
        }
        self.motor.step();
        self.servo.step(number, self.motor.speed);
        let curvature = self.servo.tangent / self.config.wheelbase_m;
        let bend = 0.5 * self.config.track_m * curvature;
        self.wheels.step(self.motor.speed, bend);
        let speed_m_s = self.motor.floor_speed();
        let rolling = self.motor.speed.abs().sqrt();
        let turn = speed_m_s * self.servo.tangent / self.config.wheelbase_m;
        Velocity {
            speed_m_s,
            turn_rad_s: turn + self.heading_noise_now * rolling,
        }
    }

    fn encoders(&self) -> &[Encoder] {
        &self.encoders
    }

    fn count(&self, encoder: usize, after_s: f64) -> i64 {
        match (encoder.checked_sub(REAR_LEFT), self.config.wheel_tick_m()) {
            (Some(wheel), Some(tick_m)) => self.wheels.ticks(wheel, after_s, tick_m),
            _ => self.motor.ticks(after_s, self.config.tick_m()),
        }
    }

    fn axis_speed(&self, encoder: usize) -> f64 {
        match encoder.checked_sub(REAR_LEFT) {
            Some(wheel) => self.wheels.speed[wheel],
            None => self.motor.speed,
        }
    }

    fn clone_box(&self) -> Box<dyn Chassis> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;
