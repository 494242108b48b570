//! The steering servo of a car, and the errors of its angle.

use super::super::motor::{noise_root, part_per_step};
use super::super::{NOISE_STEPS, STEP_S};
use super::AckermannConfig;
use crate::rng::Rng;

/// A car slower than this stands, for its servo.
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
    /// Holds for the current step.
    pub(super) angle: f64,
    pub(super) tangent: f64,
}

impl Servo {
    /// Straight ahead.
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

    /// Takes effect at the next step.
    pub(super) fn set(&mut self, angle: f64) {
        self.wanted = angle.clamp(-self.angle_max, self.angle_max);
    }

    /// Step `number` of a car whose wheels roll at `speed`, m/s.
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
