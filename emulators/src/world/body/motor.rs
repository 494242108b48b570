//! A motor behind its driver, and the wheel it turns.

use super::chassis::Command;
use super::{NOISE_STEPS, STEP_S};
use crate::rng::Rng;

/// Speed below which friction holds a wheel without drive.
const STICTION_M_S: f64 = 1e-3;

/// Slower than this counts as standing for a driver that brakes before it reverses; a guess.
const REVERSES_BELOW_M_S: f64 = 0.03;

/// Drive mode of the motor driver for one motor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Pulse width as in an 8-bit compare register, -255..=255; positive drives forward. Larger
    /// values count as 255. Up to [`BodyConfig::dead_zone_drive`](super::BodyConfig) the wheel does
    /// not turn.
    Power(i16),
    /// Both ends of the winding shorted: stops quickly. The state after power-up.
    #[default]
    Brake,
    /// The winding left open: runs out.
    Coast,
}

/// The figures of a motor; those of a [`BodyConfig`](super::BodyConfig) of the same names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MotorFigures {
    pub(super) full_speed_m_s: f64,
    pub(super) dead_zone_drive: u8,
    pub(super) lag_s: f64,
    pub(super) brake_lag_s: f64,
    pub(super) coast_lag_s: f64,
    pub(super) slip_noise_m: f64,
    pub(super) reversing: Reversing,
}

/// Reaction of a motor driver to a command in the other direction while the wheel still turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reversing {
    /// Drives in the other direction.
    #[default]
    AtOnce,
    /// Brakes until the wheel almost stands, as the speed controllers of model cars do.
    BrakesFirst,
}

impl MotorFigures {
    /// Final speed of a driven wheel, m/s.
    pub(super) fn steady_speed_m_s(&self, drive: Drive) -> f64 {
        let Drive::Power(power) = drive else {
            return 0.0;
        };
        let power = f64::from(power.clamp(-255, 255));
        let dead = f64::from(self.dead_zone_drive);
        let part = (power.abs() - dead).max(0.0) / (255.0 - dead);
        part.copysign(power) * self.full_speed_m_s
    }
}

/// One wheel with its motor.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Motor {
    figures: MotorFigures,
    command: Command,
    /// Speed that the drive leads to, and the part of the difference covered in one step.
    target: f64,
    approach: f64,
    /// Speed of the rim, m/s; holds for the current step.
    pub(super) speed: f64,
    /// Travel of the rim at the beginning of the current step, metres.
    travel: f64,
    /// Metres on the floor per metre of rim, noise left out.
    grip: f64,
    noise: Rng,
    /// Floor speed gained per square root of rim speed; see
    /// [`BodyConfig::slip_noise_m`](super::BodyConfig).
    noise_now: f64,
}

impl Motor {
    /// A motor at rest, brakes on. Its noise is that of the streams of `seed` that end in `name`.
    pub(super) fn new(
        figures: MotorFigures,
        (slip, scale_noise): (f64, f64),
        seed: u64,
        name: &str,
    ) -> Self {
        let scale = Rng::stream(seed, &format!("world.scale.{name}")).gauss();
        Self {
            command: Command::Brake,
            target: 0.0,
            approach: part_per_step(figures.brake_lag_s),
            speed: 0.0,
            travel: 0.0,
            grip: (1.0 - slip) * (1.0 + scale_noise * scale),
            noise: Rng::stream(seed, &format!("world.slip.{name}")),
            noise_now: 0.0,
            figures,
        }
    }

    /// Sets a command from the next step on. Angles are not for motors and change nothing.
    pub(super) fn set(&mut self, command: Command) {
        if self.command == command {
            return;
        }
        let figures = &self.figures;
        let full = figures.full_speed_m_s;
        let (target, lag_s) = match command {
            Command::Power(power) => {
                let target = figures.steady_speed_m_s(Drive::Power(power));
                (target, figures.lag_s)
            }
            Command::Speed(speed) => (speed.clamp(-full, full), figures.lag_s),
            Command::Brake => (0.0, figures.brake_lag_s),
            Command::Coast => (0.0, figures.coast_lag_s),
            Command::Angle(_) => return,
        };
        (self.command, self.target) = (command, target);
        self.approach = part_per_step(lag_s);
    }

    pub(super) fn command(&self) -> Command {
        self.command
    }

    pub(super) fn step(&mut self) {
        self.travel += self.speed * STEP_S;
        let is_reversed = self.target * self.speed < 0.0 && self.speed.abs() > REVERSES_BELOW_M_S;
        if is_reversed && self.figures.reversing == Reversing::BrakesFirst {
            self.speed -= self.speed * part_per_step(self.figures.brake_lag_s);
            return;
        }
        self.speed += (self.target - self.speed) * self.approach;
        if self.target == 0.0 && self.speed.abs() < STICTION_M_S {
            self.speed = 0.0;
        }
    }

    pub(super) fn floor_speed(&self) -> f64 {
        if self.speed == 0.0 {
            return 0.0;
        }
        self.speed * self.grip + self.noise_now * self.speed.abs().sqrt()
    }

    /// Whole encoder counts `after_s` into the current step, each worth `tick_m` of rim.
    pub(super) fn ticks(&self, after_s: f64, tick_m: f64) -> i64 {
        let travel = self.travel + self.speed * after_s;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a robot lives less than 2^63 ticks"
        )]
        let ticks = (travel / tick_m).floor() as i64;
        ticks
    }

    pub(super) fn draw_noise(&mut self) {
        self.noise_now = self.figures.slip_noise_m / noise_root() * self.noise.gauss();
    }
}

/// A random walk over the distance: drawn for a time T, the deviation per square root of speed is
/// `noise / sqrt(T)`. The clock alone decides the draws, moving or not, so the robot's behaviour
/// never shifts the noise.
pub(super) fn noise_root() -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a small constant")]
    let steps = NOISE_STEPS as f64;
    (steps * STEP_S).sqrt()
}

/// Part of the difference to the final value that a first-order lag covers in one step.
pub(super) fn part_per_step(lag_s: f64) -> f64 {
    if lag_s > 0.0 {
        1.0 - libm::exp(-STEP_S / lag_s)
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lags of one step, so that 1 - 1/e of a difference is covered in each; running out takes ten.
    fn figures(reversing: Reversing) -> MotorFigures {
        MotorFigures {
            full_speed_m_s: 1.0,
            dead_zone_drive: 55,
            lag_s: STEP_S,
            brake_lag_s: STEP_S,
            coast_lag_s: 10.0 * STEP_S,
            slip_noise_m: 0.0,
            reversing,
        }
    }

    fn motor(reversing: Reversing) -> Motor {
        Motor::new(figures(reversing), (0.1, 0.0), 1, "left")
    }

    const COVERED: f64 = 1.0 - 0.367_879_441_171_442_3;

    fn is(found: f64, expected: f64) -> bool {
        (found - expected).abs() < 1e-12
    }

    /// Above the dead zone of 55 there are 200 values: 155 is half of the speed.
    #[test]
    fn the_drive_sets_the_final_speed() {
        let speed = |power| figures(Reversing::AtOnce).steady_speed_m_s(Drive::Power(power));
        let speeds = [255, 300, 155, 55, 0, -155, -999].map(speed);
        let expected = [1.0, 1.0, 0.5, 0.0, 0.0, -0.5, -1.0];
        assert!(
            speeds.iter().zip(expected).all(|(a, b)| is(*a, b)),
            "{speeds:?}"
        );
        for drive in [Drive::Brake, Drive::Coast] {
            assert!(is(figures(Reversing::AtOnce).steady_speed_m_s(drive), 0.0));
        }
    }

    #[test]
    fn a_lag_covers_a_part_of_the_difference() {
        assert!(is(part_per_step(0.0), 1.0) && is(part_per_step(STEP_S), COVERED));
        assert!((part_per_step(1.0) - 0.000_999_5).abs() < 1e-6);
        assert!(is(noise_root(), 0.02_f64.sqrt()));
    }

    /// The rim travels by the speed of the step before: nothing in the first one.
    #[test]
    fn a_wheel_follows_its_command() {
        let mut motor = motor(Reversing::AtOnce);
        motor.set(Command::Speed(5.0));
        motor.step();
        assert!(is(motor.speed, COVERED) && is(motor.travel, 0.0));
        motor.step();
        let speed = COVERED + (1.0 - COVERED) * COVERED;
        assert!(is(motor.speed, speed) && is(motor.travel, COVERED * STEP_S));
        assert_eq!(motor.ticks(0.0, 1e-4), 6, "0.632 mm in counts of 0.1 mm");
        assert_eq!(motor.ticks(STEP_S, 1e-4), 14, "and 0.865 mm more");
        assert!(is(motor.floor_speed(), 0.9 * speed));
        motor.set(Command::Coast);
        let before = motor.speed;
        motor.step();
        assert!(is(motor.speed, before * libm::exp(-0.1)));
        motor.set(Command::Brake);
        assert_eq!(motor.command(), Command::Brake);
        for _ in 0..6 {
            motor.step();
        }
        assert!(motor.speed > 0.0);
        motor.step();
        assert!(
            is(motor.speed, 0.0) && is(motor.floor_speed(), 0.0),
            "friction holds it"
        );
        motor.set(Command::Angle(1.0));
        assert_eq!(motor.command(), Command::Brake);
        motor.set(Command::Power(-155));
        motor.step();
        assert!(is(motor.speed, -0.5 * COVERED));
    }

    /// A driver that brakes first turns the other way below 0.03 m/s.
    #[test]
    fn a_reversed_motor_brakes_first_if_its_driver_does() {
        let reversed = |reversing| {
            let mut motor = motor(reversing);
            motor.speed = 1.0;
            motor.set(Command::Speed(-1.0));
            let mut speeds = Vec::new();
            for _ in 0..6 {
                motor.step();
                speeds.push(motor.speed);
            }
            speeds
        };
        assert!(is(reversed(Reversing::AtOnce)[0], 1.0 - 2.0 * COVERED));
        let speeds = reversed(Reversing::BrakesFirst);
        assert!(is(speeds[0], 1.0 - COVERED) && speeds[..4].iter().all(|speed| *speed > 0.0));
        // e^-4 is 0.018: from there on it reverses.
        assert!(speeds[4] < 0.0 && speeds[5] < speeds[4], "{speeds:?}");
    }

    /// Noise is drawn for 20 steps at a time; its deviation is that of one second times the root of
    /// their time.
    #[test]
    fn slip_has_noise_by_the_root_of_the_speed() {
        let mut motor = motor(Reversing::AtOnce);
        (motor.figures.slip_noise_m, motor.speed) = (0.001, 0.25);
        let mut drawn = Rng::stream(1, "world.slip.left");
        motor.draw_noise();
        let noise = 0.001 / 0.02_f64.sqrt() * drawn.gauss();
        assert!(is(motor.floor_speed(), 0.9 * 0.25 + noise * 0.5));
    }
}
