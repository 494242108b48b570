//! A car: one motor drives the rear axle, a servo steers the front wheels.
//!
//! ```text
//! steering -> lag, rate limit -> angle delta --+
//! drive -> motor -> shaft -> rear axle -> v ---+-> turn rate = v * tan(delta) / wheelbase
//! ```
//!
//! The reference point is the middle of the rear axle: poses of the world, the footprint and every
//! mount are seen from there. Two wheels stand for four (the bicycle model): the differential gear
//! is ideal, tyres do not drift sideways, and the servo is as strong at rest as rolling.

use core::f64::consts::TAU;

use super::chassis::{Actuator, ActuatorKind, Chassis, Command, Encoder, Velocity};
use super::differential::{BodyError, check_ranges};
use super::footprint::Footprint;
use super::motor::{Motor, MotorFigures, noise_root, part_per_step};
use super::{NOISE_STEPS, STEP_S};
use crate::rng::Rng;

/// Everything about a car that differs from one to the other.
///
/// The defaults are a Tamiya TT-01 as TU Darmstadt used it: wheelbase 0.258 m, track 0.155 m
/// (ucboard documentation), covered floor 0.46 m x 0.33 m (its costmap; taken to be centred between
/// the axles), an encoder of 60 counts a turn on wheels of 32 mm, at most 25 degrees of steering.
/// Full speed, dead zone, lags, servo, slip and noise are guesses.
#[derive(Clone, Debug, PartialEq)]
pub struct AckermannConfig {
    /// What collides, seen from the middle of the rear axle.
    pub footprint: Footprint,
    /// Between the axles.
    pub wheelbase_m: f64,
    /// Between the wheels of one axle. The bicycle model does not need it but for its own limit: a
    /// car cannot turn about a point between its wheels.
    pub track_m: f64,
    /// Of the driven wheels.
    pub wheel_radius_m: f64,
    /// Encoder counts of the drive shaft per turn of a wheel.
    pub ticks_per_turn: u32,
    /// Steering angle of the (single) front wheel at most, to either side.
    pub steering_max_rad: f64,
    /// The servo turns no faster.
    pub steering_rate_rad_s: f64,
    /// Time constant of the servo near its goal.
    pub steering_lag_s: f64,
    /// At drive 255 in the long run.
    pub full_speed_m_s: f64,
    /// Greatest drive at which the car does not move yet; below 255.
    pub dead_zone_drive: u8,
    /// Time constant of the driven car.
    pub lag_s: f64,
    /// Time constant of the braked car.
    pub brake_lag_s: f64,
    /// Time constant of the car that runs out.
    pub coast_lag_s: f64,
    /// Part of the wheels' travel that is lost on the floor.
    pub slip: f64,
    /// Noise of the travel: standard deviation in metres after one metre. Grows with the square
    /// root of the way.
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
            steering_max_rad: 0.436,
            steering_rate_rad_s: 3.0,
            steering_lag_s: 0.020,
            full_speed_m_s: 1.2,
            dead_zone_drive: 20,
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
    /// The same car on a perfect floor: no slip, no noise. For tests whose figures are to be
    /// derived by hand.
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
        }
    }
}

/// Places in the list of actuators.
const DRIVE: usize = 0;
const STEERING: usize = 1;

/// The car: actuators `drive` and `steering`, encoder `drive`.
#[derive(Clone, Debug, PartialEq)]
pub struct Ackermann {
    config: AckermannConfig,
    actuators: [Actuator; 2],
    encoders: [Encoder; 1],
    motor: Motor,
    servo: Servo,
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
            encoders: [Encoder {
                name: "drive".to_owned(),
                counts_per_m: 1.0 / config.tick_m(),
            }],
            motor: Motor::new(config.motor(), noise, seed, "drive"),
            servo: Servo {
                approach: part_per_step(config.steering_lag_s),
                most: config.steering_rate_rad_s * STEP_S,
                wanted: 0.0,
                angle: 0.0,
                tangent: 0.0,
            },
            heading_noise: Rng::stream(seed, "world.heading"),
            heading_noise_now: 0.0,
            config,
        })
    }
}

/// What turns the front wheels.
#[derive(Clone, Debug, PartialEq)]
struct Servo {
    /// Part of the way to its goal, and radians, that it makes in one step at most.
    approach: f64,
    most: f64,
    wanted: f64,
    /// Holds for the current step.
    angle: f64,
    tangent: f64,
}

impl Servo {
    fn step(&mut self) {
        if self.angle == self.wanted {
            return;
        }
        let way = (self.wanted - self.angle) * self.approach;
        self.angle += way.clamp(-self.most, self.most);
        self.tangent = libm::tan(self.angle);
    }
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
            (STEERING, Command::Angle(angle)) => {
                let most = self.config.steering_max_rad;
                self.servo.wanted = angle.clamp(-most, most);
            }
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
        self.servo.step();
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

    fn count(&self, _: usize, after_s: f64) -> i64 {
        self.motor.ticks(after_s, self.config.tick_m())
    }

    fn axis_speed(&self, _: usize) -> f64 {
        self.motor.speed
    }

    fn clone_box(&self) -> Box<dyn Chassis> {
        Box::new(self.clone())
    }
}
