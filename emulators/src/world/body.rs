//! The robot's body as physics sees it: two motors, two wheels, a disc.
//!
//! ```text
//! drive -> dead zone, full speed -> first-order lag -> wheel speed -> encoder ticks
//!                                                          |
//!                                                 slip, noise, axle -> speed and turn rate
//! ```

use core::f64::consts::TAU;
use core::fmt;

use super::geometry::{Point, Pose};
use crate::rng::Rng;

/// Length of one step of the physics.
pub(super) const STEP_NANOS: u64 = 1_000_000;
/// The same in seconds.
pub(super) const STEP_S: f64 = 1e-3;
/// Steps for which one draw of the noise holds. Wheel slip changes with the floor, not within a
/// millisecond; drawing seldom also makes it nearly free.
const NOISE_STEPS: u64 = 20;
/// A wheel that nothing drives and that is slower than this is held by friction.
const STICTION_M_S: f64 = 1e-3;

/// One of the two driven wheels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Wheel {
    /// On the y side.
    Left,
    /// On the other side.
    Right,
}

/// What the motor driver does to one motor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Pulse width as in an 8-bit compare register, -255..=255; positive drives forward. Larger
    /// values count as 255. Up to [`BodyConfig::dead_zone_drive`] the wheel does not turn.
    Power(i16),
    /// Both ends of the winding shorted: stops quickly. The state after power-up.
    #[default]
    Brake,
    /// The winding left open: runs out.
    Coast,
}

/// Everything about the body that differs from robot to robot.
///
/// The defaults are the seed report's base: 26 mm wheels 260 mm apart, 360 encoder ticks a turn,
/// 350 mm/s at full drive (31 ticks in 40.16 ms), motion from pulse width 40 of 255. Lags, slip and
/// noise are not in the report; they are guesses for a small gear motor on a hard floor.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyConfig {
    /// Of the disc that collides.
    pub radius_m: f64,
    /// Of the wheels.
    pub wheel_radius_m: f64,
    /// Between the wheels.
    pub axle_m: f64,
    /// Encoder counts per turn of a wheel.
    pub ticks_per_turn: u32,
    /// Of a wheel at drive 255 in the long run.
    pub full_speed_m_s: f64,
    /// Greatest drive at which a wheel does not turn yet; below 255.
    pub dead_zone_drive: u8,
    /// Time constant of a driven wheel.
    pub lag_s: f64,
    /// Time constant of a braked wheel.
    pub brake_lag_s: f64,
    /// Time constant of a wheel that runs out.
    pub coast_lag_s: f64,
    /// Part of the wheel's travel that is lost on the floor, left and right.
    pub slip: [f64; 2],
    /// Noise of the travel of each wheel: standard deviation in metres after one metre. Grows with
    /// the square root of the way.
    pub slip_noise_m: f64,
    /// Noise of the heading: standard deviation in radians after one metre of wheel travel.
    pub heading_noise_rad: f64,
    /// Standard deviation of a relative error of each wheel's radius, drawn once for the run.
    pub scale_noise: f64,
}

impl Default for BodyConfig {
    fn default() -> Self {
        Self {
            radius_m: 0.16,
            wheel_radius_m: 0.026,
            axle_m: 0.260,
            ticks_per_turn: 360,
            full_speed_m_s: 0.350,
            dead_zone_drive: 40,
            lag_s: 0.060,
            brake_lag_s: 0.020,
            coast_lag_s: 0.150,
            slip: [0.005, 0.005],
            slip_noise_m: 0.002,
            heading_noise_rad: 0.004,
            scale_noise: 0.001,
        }
    }
}

impl BodyConfig {
    /// The same body on a perfect floor: no slip, no noise. For tests whose figures are to be
    /// derived by hand.
    #[must_use]
    pub fn ideal(self) -> Self {
        Self {
            slip: [0.0; 2],
            slip_noise_m: 0.0,
            heading_noise_rad: 0.0,
            scale_noise: 0.0,
            ..self
        }
    }

    /// Wheel travel per encoder tick; 0.45379 mm with the default figures.
    pub fn tick_m(&self) -> f64 {
        TAU * self.wheel_radius_m / f64::from(self.ticks_per_turn)
    }

    /// Speed of a wheel that is driven for long, m/s.
    pub fn steady_speed_m_s(&self, drive: Drive) -> f64 {
        let Drive::Power(power) = drive else {
            return 0.0;
        };
        let power = f64::from(power.clamp(-255, 255));
        let dead = f64::from(self.dead_zone_drive);
        let part = (power.abs() - dead).max(0.0) / (255.0 - dead);
        if power < 0.0 {
            -part * self.full_speed_m_s
        } else {
            part * self.full_speed_m_s
        }
    }

    /// Names the first field that is out of range.
    pub fn check(&self) -> Result<(), BodyError> {
        let fields = [
            ("radius_m", self.radius_m, 0.02, 2.0),
            ("wheel_radius_m", self.wheel_radius_m, 0.001, 1.0),
            ("axle_m", self.axle_m, 0.01, 4.0),
            ("ticks_per_turn", f64::from(self.ticks_per_turn), 1.0, 1e6),
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
            ("slip[0]", self.slip[0], -0.5, 0.9),
            ("slip[1]", self.slip[1], -0.5, 0.9),
            ("slip_noise_m", self.slip_noise_m, 0.0, 0.1),
            ("heading_noise_rad", self.heading_noise_rad, 0.0, 0.5),
            ("scale_noise", self.scale_noise, 0.0, 0.1),
        ];
        for (field, found, min, max) in fields {
            if !(min..=max).contains(&found) {
                return Err(BodyError {
                    field,
                    found,
                    min,
                    max,
                });
            }
        }
        Ok(())
    }
}

/// A figure of a [`BodyConfig`] that physics cannot work with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyError {
    /// Which.
    pub field: &'static str,
    /// As given.
    pub found: f64,
    /// Least allowed.
    pub min: f64,
    /// Greatest allowed.
    pub max: f64,
}

impl fmt::Display for BodyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            field,
            found,
            min,
            max,
        } = self;
        write!(f, "body.{field} is {found}; expected {min} to {max}")
    }
}

impl core::error::Error for BodyError {}

/// One wheel with its motor.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Motor {
    drive: Drive,
    /// Speed that the drive leads to, and the part of the way there made in one step.
    target: f64,
    approach: f64,
    /// Of the rim, m/s; holds for the current step.
    pub(super) speed: f64,
    /// Of the rim at the beginning of the current step, metres.
    pub(super) travel: f64,
    /// Metres on the floor per metre of rim, noise left out.
    grip: f64,
    noise: Rng,
    /// Floor speed gained per square root of rim speed; see [`BodyConfig::slip_noise_m`].
    noise_now: f64,
}

impl Motor {
    fn step(&mut self) {
        self.travel += self.speed * STEP_S;
        self.speed += (self.target - self.speed) * self.approach;
        if self.target == 0.0 && self.speed.abs() < STICTION_M_S {
            self.speed = 0.0;
        }
    }

    fn floor_speed(&self) -> f64 {
        if self.speed == 0.0 {
            return 0.0;
        }
        self.speed * self.grip + self.noise_now * self.speed.abs().sqrt()
    }
}

/// Both wheels, and what they do to the body.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Chassis {
    pub(super) config: BodyConfig,
    pub(super) motors: [Motor; 2],
    heading_noise: Rng,
    heading_noise_now: f64,
}

impl Chassis {
    pub(super) fn new(config: BodyConfig, seed: u64) -> Self {
        let motor = |side: usize, name: &str| Motor {
            drive: Drive::Brake,
            target: 0.0,
            approach: part_per_step(config.brake_lag_s),
            speed: 0.0,
            travel: 0.0,
            grip: (1.0 - config.slip[side])
                * (1.0
                    + config.scale_noise
                        * Rng::stream(seed, &format!("world.scale.{name}")).gauss()),
            noise: Rng::stream(seed, &format!("world.slip.{name}")),
            noise_now: 0.0,
        };
        Self {
            motors: [motor(0, "left"), motor(1, "right")],
            heading_noise: Rng::stream(seed, "world.heading"),
            heading_noise_now: 0.0,
            config,
        }
    }

    pub(super) fn set_drive(&mut self, wheel: Wheel, drive: Drive) {
        let motor = &mut self.motors[wheel as usize];
        if motor.drive == drive {
            return;
        }
        motor.drive = drive;
        motor.target = self.config.steady_speed_m_s(drive);
        motor.approach = part_per_step(match drive {
            Drive::Power(_) => self.config.lag_s,
            Drive::Brake => self.config.brake_lag_s,
            Drive::Coast => self.config.coast_lag_s,
        });
    }

    pub(super) fn drive(&self, wheel: Wheel) -> Drive {
        self.motors[wheel as usize].drive
    }

    /// Begins step `number`; returns speed and turn rate over the floor that hold for it.
    pub(super) fn step(&mut self, number: u64) -> (f64, f64) {
        if number.is_multiple_of(NOISE_STEPS) {
            self.draw_noise();
        }
        for motor in &mut self.motors {
            motor.step();
        }
        let [left, right] = &self.motors;
        let (left_m_s, right_m_s) = (left.floor_speed(), right.floor_speed());
        let rolling = ((left.speed.abs() + right.speed.abs()) * 0.5).sqrt();
        let speed = (left_m_s + right_m_s) * 0.5;
        let turn = (right_m_s - left_m_s) / self.config.axle_m + self.heading_noise_now * rolling;
        (speed, turn)
    }

    /// A random walk over the way: drawn for a time T, the deviation per square root of speed is
    /// `noise / sqrt(T)`. Drawn by the clock, moving or not, so that what the robot does never
    /// shifts the noise.
    fn draw_noise(&mut self) {
        #[expect(clippy::cast_precision_loss, reason = "a small constant")]
        let root = (NOISE_STEPS as f64 * STEP_S).sqrt();
        for motor in &mut self.motors {
            motor.noise_now = self.config.slip_noise_m / root * motor.noise.gauss();
        }
        self.heading_noise_now = self.config.heading_noise_rad / root * self.heading_noise.gauss();
    }
}

/// Part of the way to its final value that a first-order lag makes in one step.
fn part_per_step(lag_s: f64) -> f64 {
    if lag_s > 0.0 {
        1.0 - libm::exp(-STEP_S / lag_s)
    } else {
        1.0
    }
}

/// How the body moves during one step: an arc, and what pushes it over the floor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    /// Pose at the beginning of the step.
    pub(super) start: Pose,
    /// Forward, m/s.
    pub(super) speed: f64,
    /// Counter-clockwise, rad/s.
    pub(super) turn: f64,
    /// Of a push, m/s, in world axes.
    pub(super) drift: Point,
}

impl Motion {
    /// At rest.
    pub(super) fn rest(start: Pose) -> Self {
        Self {
            start,
            ..Self::default()
        }
    }

    /// The pose `after` seconds: exact for constant speed and turn rate. The chord of an arc of
    /// angle 2h is shorter than the arc by sin(h) / h, whose series ends below rounding here.
    pub(super) fn pose(&self, after: f64) -> Pose {
        if self.speed == 0.0 && self.turn == 0.0 && self.drift == Point::default() {
            return self.start;
        }
        let half = 0.5 * self.turn * after;
        let square = half * half;
        let chord = self.speed * after * (1.0 - square / 6.0 * (1.0 - square / 20.0));
        let (sin, cos) = libm::sincos(self.start.theta + half);
        Pose {
            x: self.start.x + chord * cos + self.drift.x * after,
            y: self.start.y + chord * sin + self.drift.y * after,
            theta: self.start.theta + self.turn * after,
        }
    }

    /// The same turn, and `part` of the way.
    pub(super) fn slowed(self, part: f64) -> Self {
        let drift = Point::new(self.drift.x * part, self.drift.y * part);
        Self {
            speed: self.speed * part,
            drift,
            ..self
        }
    }

    /// Speed over the floor, m/s.
    pub(super) fn floor_speed(&self) -> f64 {
        let (sin, cos) = libm::sincos(self.start.theta);
        let velocity = Point::new(
            self.speed * cos + self.drift.x,
            self.speed * sin + self.drift.y,
        );
        Point::default().distance(velocity)
    }
}
