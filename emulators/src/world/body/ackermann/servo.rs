//! The steering servo of a car, and the errors of its angle.

use super::super::motor::{noise_root, part_per_step};
use super::super::{NOISE_STEPS, STEP_S};
use super::AckermannConfig;
use crate::rng::Rng;

/// Speed below which the car stands, for its servo.
const REST_M_S: f64 = 0.02;
/// At rest on PVC the wheels stop this far short of their goal: 4 degrees, a guess; the report only
/// says that the servo is weak there.
const PVC_SHORT_RAD: f64 = 0.07;
/// Maximum deviation of the wheels from the linkage: 6 degrees, a guess.
const WANDER_MAX_RAD: f64 = 0.1;

/// Effect of the floor on the servo of a heavy car: the angle that it reaches at rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Floor {
    /// The servo is as strong at rest as rolling.
    #[default]
    Smooth,
    /// At rest the wheels stop short of their goal by 4 degrees.
    Pvc,
    /// At rest the wheels do not turn.
    Carpet,
}

/// Difference between the true angle of the wheels and the commanded one. It varies from car to car
/// and from hour to hour: `angle = gain * told + trim + wander`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteeringLaw {
    /// Gain of the linkage.
    pub gain: f64,
    /// Angle of the wheels for the command straight ahead, radians, counter-clockwise.
    pub trim_rad: f64,
    /// A random walk while the car rolls: standard deviation after one metre, radians. It stays
    /// within 0.1 rad.
    pub wander_rad: f64,
}

impl Default for SteeringLaw {
    /// The wheels follow the commanded angle without error.
    fn default() -> Self {
        Self {
            gain: 1.0,
            trim_rad: 0.0,
            wander_rad: 0.0,
        }
    }
}

/// The servo with its linkage.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Servo {
    /// Part of the remaining angle, and maximum angle in radians, that the servo turns in one step.
    approach: f64,
    most: f64,
    angle_max: f64,
    law: SteeringLaw,
    floor: Floor,
    wander: f64,
    noise: Rng,
    /// The commanded angle.
    pub(super) wanted: f64,
    /// Angle of the wheels in the current step.
    pub(super) angle: f64,
    pub(super) tangent: f64,
}

impl Servo {
    /// A servo that points straight ahead.
    pub(super) fn new(config: &AckermannConfig, seed: u64) -> Self {
        Self {
            approach: part_per_step(config.steering_lag_s),
            most: config.steering_rate_rad_s * STEP_S,
            angle_max: config.steering_max_rad,
            law: config.steering_law,
            floor: config.floor,
            wander: 0.0,
            noise: Rng::stream(seed, "world.steering"),
            wanted: 0.0,
            angle: 0.0,
            tangent: 0.0,
        }
    }

    /// Sets the commanded angle from the next step on.
    pub(super) fn set(&mut self, angle: f64) {
        self.wanted = angle.clamp(-self.angle_max, self.angle_max);
    }

    /// Runs step `number` of a car whose wheels roll at `speed`, m/s.
    pub(super) fn step(&mut self, number: u64, speed: f64) {
        if number.is_multiple_of(NOISE_STEPS) {
            let way = self.law.wander_rad * noise_root() * speed.abs().sqrt();
            let wander = self.wander + way * self.noise.gauss();
            self.wander = wander.clamp(-WANDER_MAX_RAD, WANDER_MAX_RAD);
        }
        let goal = self.goal(speed);
        if self.angle == goal {
            return;
        }
        let way = (goal - self.angle) * self.approach;
        self.angle += way.clamp(-self.most, self.most);
        self.tangent = libm::tan(self.angle);
    }

    /// Angle that the servo can reach now.
    fn goal(&self, speed: f64) -> f64 {
        let goal = self.wanted * self.law.gain + self.law.trim_rad + self.wander;
        let goal = goal.clamp(-self.angle_max, self.angle_max);
        if speed.abs() > REST_M_S {
            return goal;
        }
        match self.floor {
            Floor::Smooth => goal,
            Floor::Pvc if goal > self.angle => (goal - PVC_SHORT_RAD).max(self.angle),
            Floor::Pvc => (goal + PVC_SHORT_RAD).min(self.angle),
            Floor::Carpet => self.angle,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A servo without a lag that turns by 0.01 rad in a step, at most to half a radian.
    fn servo(floor: Floor, law: SteeringLaw) -> Servo {
        let config = AckermannConfig {
            steering_lag_s: 0.0,
            steering_rate_rad_s: 10.0,
            steering_max_rad: 0.5,
            steering_law: law,
            floor,
            ..AckermannConfig::default().ideal()
        };
        Servo::new(&config, 1)
    }

    /// The angle after many steps at this speed, from the first to the second wanted angle.
    fn reached(floor: Floor, speed: f64, wanted: [f64; 2]) -> f64 {
        let mut servo = servo(floor, SteeringLaw::default());
        servo.set(wanted[0]);
        (1..200).for_each(|number| servo.step(number, 1.0));
        servo.set(wanted[1]);
        (201..400).for_each(|number| servo.step(number, speed));
        servo.angle
    }

    fn is(found: f64, expected: f64) -> bool {
        (found - expected).abs() < 1e-9
    }

    #[test]
    fn a_servo_turns_at_its_speed_to_its_limit() {
        let mut servo = servo(Floor::Smooth, SteeringLaw::default());
        servo.set(0.3);
        servo.step(1, 0.0);
        assert!(is(servo.angle, 0.01) && is(servo.tangent, libm::tan(0.01)));
        (2..=30).for_each(|number| servo.step(number, 0.0));
        assert!(is(servo.angle, 0.3));
        servo.set(-9.0);
        servo.step(31, 0.0);
        assert!(is(servo.wanted, -0.5) && is(servo.angle, 0.29));
    }

    /// At rest, which is up to 0.02 m/s, the wheels stop 0.07 rad short on PVC and do not turn on a
    /// carpet.
    #[test]
    fn a_heavy_car_steers_badly_at_rest() {
        assert!(is(reached(Floor::Smooth, 0.0, [0.0, 0.3]), 0.3));
        assert!(is(reached(Floor::Pvc, 0.02, [0.0, 0.3]), 0.23));
        assert!(is(reached(Floor::Pvc, -0.03, [0.0, 0.3]), 0.3));
        assert!(is(reached(Floor::Pvc, 0.0, [0.3, -0.3]), -0.23));
        assert!(
            is(reached(Floor::Pvc, 0.0, [0.3, 0.35]), 0.3),
            "it does not turn back"
        );
        assert!(is(reached(Floor::Pvc, 0.0, [0.3, 0.25]), 0.3));
        assert!(is(reached(Floor::Carpet, 0.0, [0.1, 0.3]), 0.1));
        assert!(is(reached(Floor::Carpet, 0.03, [0.1, 0.3]), 0.3));
    }

    /// The law gives half of the wanted 0.2 rad and a trim of 0.1 rad. Then the angle wanders with
    /// the root of the distance: 20 steps at 4 m/s are 0.08 m. It stays within 0.1 rad of the law.
    #[test]
    fn the_wheels_stand_as_the_law_says() {
        let law = |wander_rad| SteeringLaw {
            gain: 0.5,
            trim_rad: 0.1,
            wander_rad,
        };
        let mut plain = servo(Floor::Smooth, law(0.0));
        plain.set(0.2);
        (1..99).for_each(|number| plain.step(number, 4.0));
        assert!(is(plain.angle, 0.2));
        let mut walks = servo(Floor::Smooth, law(0.05));
        let mut drawn = Rng::stream(1, "world.steering");
        let first = 0.05 * 0.08_f64.sqrt() * drawn.gauss();
        (1..=20).for_each(|number| walks.step(number, 4.0));
        assert!(
            is(walks.wander, first.clamp(-0.1, 0.1)),
            "{} {first}",
            walks.wander
        );
        let mut wild = servo(Floor::Smooth, law(99.0));
        (1..=20).for_each(|number| wild.step(number, 4.0));
        assert!(is(wild.wander.abs(), 0.1));
    }
}
