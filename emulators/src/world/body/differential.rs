//! Two driven wheels on one axle. The reference point is the middle between them.

use core::f64::consts::TAU;
use core::fmt;

use super::NOISE_STEPS;
use super::chassis::{Actuator, ActuatorKind, Chassis, Command, Encoder, Velocity};
use super::footprint::Footprint;
use super::motor::{Drive, Motor, MotorFigures, Reversing, noise_root};
use crate::rng::Rng;

/// One of the two driven wheels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Wheel {
    /// The wheel at positive y.
    Left,
    /// The wheel at negative y.
    Right,
}

impl Wheel {
    /// Left, then right.
    pub const ALL: [Self; 2] = [Self::Left, Self::Right];

    /// Name of its motor and its encoder.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// Everything about the body that differs from robot to robot.
///
/// The defaults are the seed report's base: 26 mm wheels 260 mm apart, 360 encoder ticks a turn,
/// 350 mm/s at full drive (31 ticks in 40.16 ms), motion from pulse width 40 of 255. Lags, slip and
/// noise are not in the report; they are guesses for a small gear motor on a hard floor.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyConfig {
    /// Radius of the colliding disc.
    pub radius_m: f64,
    /// Radius of the wheels.
    pub wheel_radius_m: f64,
    /// Distance between the wheels.
    pub axle_m: f64,
    /// Encoder counts per turn of a wheel.
    pub ticks_per_turn: u32,
    /// Final speed of a wheel at drive 255.
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
    /// the square root of the distance.
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
    /// The same body on a perfect floor: no slip, no noise. For tests with figures derived by hand.
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

    /// Final speed of a driven wheel, m/s.
    pub fn steady_speed_m_s(&self, drive: Drive) -> f64 {
        self.motor().steady_speed_m_s(drive)
    }

    fn motor(&self) -> MotorFigures {
        MotorFigures {
            full_speed_m_s: self.full_speed_m_s,
            dead_zone_drive: self.dead_zone_drive,
            lag_s: self.lag_s,
            brake_lag_s: self.brake_lag_s,
            coast_lag_s: self.coast_lag_s,
            slip_noise_m: self.slip_noise_m,
            reversing: Reversing::AtOnce,
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
        check_ranges(&fields)
    }
}

/// Names the first of some fields, each with its value, least and greatest, that is out of range.
pub(super) fn check_ranges(fields: &[(&'static str, f64, f64, f64)]) -> Result<(), BodyError> {
    for &(field, found, min, max) in fields {
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

/// A figure of a body that physics cannot work with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyError {
    /// Name of the field.
    pub field: &'static str,
    /// The given value.
    pub found: f64,
    /// Minimum allowed.
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

/// Both wheels and their effect on the body: actuators and encoders `left` and `right`.
#[derive(Clone, Debug, PartialEq)]
pub struct Differential {
    config: BodyConfig,
    footprint: Footprint,
    actuators: [Actuator; 2],
    encoders: [Encoder; 2],
    motors: [Motor; 2],
    heading_noise: Rng,
    heading_noise_now: f64,
}

impl Differential {
    /// A round body at rest, brakes on. The noise of the floor follows from `seed`.
    ///
    /// # Errors
    /// If a figure is out of range.
    pub fn new(config: BodyConfig, seed: u64) -> Result<Self, BodyError> {
        config.check()?;
        let footprint = Footprint::circle(config.radius_m).expect("the check allows these radii");
        let full = config.full_speed_m_s;
        let counts_per_m = 1.0 / config.tick_m();
        let motor = |wheel: Wheel| {
            let slip = config.slip[wheel as usize];
            Motor::new(
                config.motor(),
                (slip, config.scale_noise),
                seed,
                wheel.name(),
            )
        };
        Ok(Self {
            footprint,
            actuators: Wheel::ALL.map(|wheel| Actuator {
                name: wheel.name().to_owned(),
                kind: ActuatorKind::Motor,
                range: [-full, full],
            }),
            encoders: Wheel::ALL.map(|wheel| Encoder {
                name: wheel.name().to_owned(),
                counts_per_m,
            }),
            motors: Wheel::ALL.map(motor),
            heading_noise: Rng::stream(seed, "world.heading"),
            heading_noise_now: 0.0,
            config,
        })
    }

    /// The same wheels under a body of another shape; its `radius_m` has no effect then.
    #[must_use]
    pub fn with_footprint(self, footprint: Footprint) -> Self {
        Self { footprint, ..self }
    }
}

impl Chassis for Differential {
    fn footprint(&self) -> &Footprint {
        &self.footprint
    }

    fn actuators(&self) -> &[Actuator] {
        &self.actuators
    }

    fn actuate(&mut self, actuator: usize, command: Command) {
        self.motors[actuator].set(command);
    }

    fn command(&self, actuator: usize) -> Command {
        self.motors[actuator].command()
    }

    fn actual(&self, actuator: usize) -> f64 {
        self.motors[actuator].speed
    }

    fn begin_step(&mut self, number: u64) -> Velocity {
        if number.is_multiple_of(NOISE_STEPS) {
            for motor in &mut self.motors {
                motor.draw_noise();
            }
            self.heading_noise_now =
                self.config.heading_noise_rad / noise_root() * self.heading_noise.gauss();
        }
        for motor in &mut self.motors {
            motor.step();
        }
        let [left, right] = &self.motors;
        let (left_m_s, right_m_s) = (left.floor_speed(), right.floor_speed());
        let rolling = ((left.speed.abs() + right.speed.abs()) * 0.5).sqrt();
        let turn = (right_m_s - left_m_s) / self.config.axle_m;
        Velocity {
            speed_m_s: (left_m_s + right_m_s) * 0.5,
            turn_rad_s: turn + self.heading_noise_now * rolling,
        }
    }

    fn encoders(&self) -> &[Encoder] {
        &self.encoders
    }

    fn count(&self, encoder: usize, after_s: f64) -> i64 {
        self.motors[encoder].ticks(after_s, self.config.tick_m())
    }

    fn axis_speed(&self, encoder: usize) -> f64 {
        self.motors[encoder].speed
    }

    fn clone_box(&self) -> Box<dyn Chassis> {
        Box::new(self.clone())
    }

    fn body(&self) -> Option<&BodyConfig> {
        Some(&self.config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_differential_drive_tells_its_figures() {
        let config = BodyConfig {
            axle_m: 0.123,
            ..BodyConfig::default()
        };
        let drive = Differential::new(config.clone(), 1).unwrap();
        assert_eq!(drive.body(), Some(&config));
    }

    /// A drive without a lag: the wheels lose a tenth and a fifth of their travel on the floor.
    fn drive(heading_noise_rad: f64) -> Differential {
        let config = BodyConfig {
            axle_m: 0.25,
            full_speed_m_s: 1.0,
            lag_s: 0.0,
            slip: [0.1, 0.2],
            heading_noise_rad,
            ..BodyConfig::default()
        };
        let config = BodyConfig {
            slip_noise_m: 0.0,
            scale_noise: 0.0,
            ..config
        };
        Differential::new(config, 1).expect("sound")
    }

    /// 0.16 and 0.48 m/s are 0.144 and 0.384 on the floor: 0.264 m/s, and 0.24 over an axle of a
    /// quarter. The noise of the heading counts by the root of the wheels' mean speed, 0.32.
    #[test]
    fn two_wheels_move_a_body_by_their_mean_and_their_difference() {
        let moved = |left: f64, right: f64, noise: f64| {
            let mut drive = drive(0.0);
            drive.actuate(0, Command::Speed(left));
            drive.actuate(1, Command::Speed(right));
            drive.heading_noise_now = noise;
            let Velocity {
                speed_m_s,
                turn_rad_s,
            } = drive.begin_step(1);
            assert_eq!([drive.actual(0), drive.actual(1)], [left, right]);
            assert_eq!([drive.axis_speed(0), drive.axis_speed(1)], [left, right]);
            [speed_m_s, turn_rad_s]
        };
        let noise = 0.3 * 0.32_f64.sqrt();
        for (left, right, by, expected) in [
            (0.16, 0.48, 0.0, [0.264, 0.96]),
            (0.16, 0.48, 0.3, [0.264, 0.96 + noise]),
            (-0.16, 0.48, 0.3, [0.12, 2.112 + noise]),
            (-0.16, -0.48, -0.3, [-0.264, -0.96 - noise]),
            (0.0, 0.0, 0.3, [0.0, 0.0]),
        ] {
            let found = moved(left, right, by);
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-12, "{left} {right}: {found}");
            }
        }
    }

    /// Drawn every 20 steps, 0.02 s, with a deviation of 0.5 by the root of 0.02.
    #[test]
    fn the_noise_of_the_heading_holds_for_twenty_steps() {
        let mut drive = drive(0.5);
        let mut all = Vec::new();
        for number in 0..20_000 {
            let before = drive.heading_noise_now;
            drive.begin_step(number);
            let is_drawn = drive.heading_noise_now != before;
            assert_eq!(is_drawn, number % 20 == 0, "{number}");
            if is_drawn {
                all.push(drive.heading_noise_now);
            }
        }
        let square = all.iter().map(|noise| noise * noise).sum::<f64>() / 1_000.0;
        assert!((square / (0.25 / 0.02) - 1.0).abs() < 0.15, "{square}");
    }

    /// A wheel of 26 mm with 360 counts: 0.45379 mm each, 2203.7 a metre.
    #[test]
    fn encoders_and_motors_have_their_figures() {
        let drive = Differential::new(BodyConfig::default(), 1).expect("sound");
        for (wheel, encoder) in Wheel::ALL.iter().zip(drive.encoders()) {
            assert_eq!(encoder.name, wheel.name());
            assert!((encoder.counts_per_m - 2_203.68).abs() < 0.01);
        }
        assert_eq!(drive.actuators()[1].range, [-0.350, 0.350]);
    }
}
