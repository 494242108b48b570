//! Two infrared thermometers, left and right, and what drops the rescue kits.
//!
//! The report looks forward to the sensors without naming type or registers. Ours are as a
//! thermometer of 35 degrees field of view (MLX90614 and its like) on the two converter channels
//! that the fielded base has free, 13 and 17, in tenths of a degree Celsius; the kits have register
//! 53, behind the fielded map: how many shall be dropped.

use core::f64::consts::FRAC_PI_2;

use protocols::avr::registers::{COUNT, HEAT_LEFT, HEAT_RIGHT, KITS, YAW};

use super::{AvrBase, Imu};
use crate::rng::Rng;
use crate::world::{Pose, World};

/// Half of the field of view.
const HALF_VIEW_RAD: f64 = 0.305;
/// Rays on each side of its middle.
const RAYS: i8 = 4;
/// Distance of a sensor from the robot's middle, metres.
const MOUNT_M: f64 = 0.1;
/// As far as it is looked for warm things, metres.
const RANGE_M: f64 = 3.0;
/// Noise of a reading, degrees. A guess.
const NOISE_C: f64 = 0.3;

/// Whether the base has them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Heat {
    /// As the fielded base.
    #[default]
    None,
    /// Thermometers and kits.
    Fitted,
}

/// What they have felt and dropped.
#[derive(Clone, Debug)]
pub(super) struct Thermometers {
    noise: Rng,
    kits: Vec<Pose>,
}

impl Thermometers {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            noise: Rng::stream(seed, "base.heat"),
            kits: Vec::new(),
        }
    }

    fn reading(&mut self, world: &World, side: f64) -> i16 {
        let pose = world.pose();
        let from = pose.offset(0.0, side * MOUNT_M);
        let rays = (-RAYS..=RAYS).map(|ray| {
            let beside = f64::from(ray) / f64::from(RAYS) * HALF_VIEW_RAD;
            let angle = pose.theta + side * FRAC_PI_2 + beside;
            world.scene().temperature(world.now(), from, angle, RANGE_M)
        });
        let mean = rays.sum::<f64>() / (2.0 * f64::from(RAYS) + 1.0);
        let tenths = (mean + NOISE_C * self.noise.gauss()) * 10.0;
        #[expect(clippy::cast_possible_truncation, reason = "at most 150 degrees")]
        let tenths = tenths.round() as i16;
        tenths
    }
}

impl AvrBase {
    /// Where kits were dropped, in their order.
    pub fn kits(&self) -> &[Pose] {
        &self.thermometers.kits
    }

    /// One more register if there are kits, five if there is a gyroscope behind them.
    pub(super) fn map_len(&self) -> usize {
        let own = match (self.config.imu, self.config.heat) {
            (Imu::Fitted, _) => usize::from(YAW - KITS) + 4,
            (Imu::None, Heat::Fitted) => 1,
            (Imu::None, Heat::None) => 0,
        };
        COUNT + own
    }

    /// One run of the analog task: both thermometers, and kits that are to be dropped.
    pub(super) fn feel(&mut self, world: &World) {
        if self.config.heat == Heat::None {
            return;
        }
        for (register, side) in [(HEAT_LEFT, 1.0), (HEAT_RIGHT, -1.0)] {
            let reading = self.thermometers.reading(world, side);
            self.memory.write(register, &reading.to_le_bytes());
        }
        for _ in 0..self.memory.get(KITS) {
            self.thermometers.kits.push(world.pose());
        }
        self.memory.set(KITS, 0);
    }
}
