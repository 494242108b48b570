//! Two infrared thermometers, left and right, and the dispenser of rescue kits.
//!
//! The report plans the sensors without type or registers. The emulated ones are thermometers of 35
//! degrees field of view (MLX90614 and similar). They use the two free converter channels of the
//! fielded base, 13 and 17, in tenths of a degree Celsius. The kits use register 53, behind the
//! fielded map. A read returns the number of kits dropped; a write sets the number to reach. The
//! magazine keeps its state when the board restarts.

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
/// Maximum distance of a detected plate, metres.
const RANGE_M: f64 = 3.0;
/// Noise of a reading, degrees. A guess.
const NOISE_C: f64 = 0.3;

/// Whether the base has thermometers and a dispenser of kits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Heat {
    /// Like the fielded base.
    #[default]
    None,
    /// Thermometers and kits.
    Fitted,
}

/// The thermometers' noise and the kits dropped so far.
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
    /// Poses at which kits were dropped, in order.
    pub fn kits(&self) -> &[Pose] {
        &self.thermometers.kits
    }

    /// Length of the register map: one more register with kits, five more with a gyroscope after
    /// them.
    pub(super) fn map_len(&self) -> usize {
        let own = match (self.config.imu, self.config.heat) {
            (Imu::Fitted, _) => usize::from(YAW - KITS) + 4,
            (Imu::None, Heat::Fitted) => 1,
            (Imu::None, Heat::None) => 0,
        };
        COUNT + own
    }

    /// One run of the analog task: reads both thermometers, and drops requested kits.
    pub(super) fn feel(&mut self, world: &World) {
        if self.config.heat == Heat::None {
            return;
        }
        for (register, side) in [(HEAT_LEFT, 1.0), (HEAT_RIGHT, -1.0)] {
            let reading = self.thermometers.reading(world, side);
            self.memory.write(register, &reading.to_le_bytes());
        }
        for _ in self.dropped()..self.memory.get(KITS) {
            self.thermometers.kits.push(world.pose());
        }
        self.count_kits();
    }

    /// Sets the register with the number of dropped kits.
    pub(super) fn count_kits(&mut self) {
        if self.config.heat == Heat::Fitted {
            self.memory.set(KITS, self.dropped());
        }
    }

    fn dropped(&self) -> u8 {
        u8::try_from(self.kits().len()).unwrap_or(u8::MAX)
    }
}

#[cfg(test)]
mod tests {
    use protocols::Instant;

    use super::super::{AvrBaseConfig, StartCause};
    use super::*;
    use crate::world::{BodyConfig, HeatPlate, Point, Scene, Shape};

    /// A robot at (1, 2) that looks along y, so that smaller x is to its left. A plate of 37
    /// degrees stands beside it at `plate_x`, `half_m` long to either side.
    fn world(plate_x: f64, half_m: f64) -> World {
        let ends = [2.0 - half_m, 2.0 + half_m].map(|y| Point::new(plate_x, y));
        let plate = HeatPlate::new(ends[0], ends[1], 37.0).expect("sound");
        let scene = Scene::new(Vec::<Shape>::new(), vec![]).expect("empty");
        let scene = scene.with_heat_plates(vec![plate]);
        let pose = Pose::new(1.0, 2.0, FRAC_PI_2);
        World::new(scene, BodyConfig::default().ideal(), pose, 1).expect("free")
    }

    /// Both readings, less the noise, which is 0.3 degrees times the numbers of the stream.
    fn readings(world: &World) -> [f64; 2] {
        let mut thermometers = Thermometers::new(5);
        let mut noise = Rng::stream(5, "base.heat");
        [1.0, -1.0].map(|side| {
            let tenths = f64::from(thermometers.reading(world, side));
            tenths / 10.0 - 0.3 * noise.gauss()
        })
    }

    /// Nine rays over 35 degrees: a plate that fills them is 37 degrees, the background is 22.
    #[test]
    fn a_thermometer_feels_what_is_on_its_side() {
        let is = |found: [f64; 2], expected: [f64; 2]| {
            let off = [0, 1].map(|side| (found[side] - expected[side]).abs());
            assert!(
                off.iter().all(|off| *off <= 0.051),
                "{found:?} {expected:?}"
            );
        };
        is(readings(&world(0.5, 3.0)), [37.0, 22.0]);
        is(readings(&world(1.5, 3.0)), [22.0, 37.0]);
        is(readings(&world(-3.0, 9.0)), [22.0, 22.0]);
        // A plate 0.4 m from the sensor, 0.06 m to either side, covers 0.149 of 0.305 radians to
        // either side. There are four rays to either side: the first, at 0.076 radians, meets the
        // plate, the second, at 0.153, does not. So 3 of 9 rays meet it.
        is(readings(&world(0.5, 0.06)), [27.0, 22.0]);
        // 0.065 m to either side are 0.161 radians: 5 of 9 rays.
        is(
            readings(&world(0.5, 0.065)),
            [22.0 + 15.0 * 5.0 / 9.0, 22.0],
        );
    }

    fn base(heat: Heat, imu: Imu) -> AvrBase {
        let config = AvrBaseConfig {
            heat,
            imu,
            ..AvrBaseConfig::default()
        };
        AvrBase::new(config, 5)
    }

    /// Register 53 is the kits', and 54 to 57 are the gyroscope's.
    #[test]
    fn the_map_is_as_long_as_what_is_fitted() {
        let more = |heat, imu| base(heat, imu).map_len() - COUNT;
        assert_eq!(more(Heat::None, Imu::None), 0);
        assert_eq!(more(Heat::Fitted, Imu::None), 1);
        assert_eq!(
            [
                more(Heat::None, Imu::Fitted),
                more(Heat::Fitted, Imu::Fitted)
            ],
            [5, 5]
        );
    }

    /// Three kits drop at the robot's pose. No fourth drops after a repeated order, a lower order
    /// or a restart. Both thermometers are read low byte first.
    #[test]
    fn kits_drop_where_the_robot_is() {
        let world = world(0.5, 3.0);
        let mut bare = base(Heat::None, Imu::None);
        bare.memory.set(KITS, 3);
        bare.feel(&world);
        assert_eq!((bare.kits().len(), bare.memory.get(KITS)), (0, 3));
        let mut base = base(Heat::Fitted, Imu::None);
        base.memory.set(KITS, 3);
        base.feel(&world);
        assert_eq!(
            (base.kits(), base.memory.get(KITS)),
            (&[world.pose(); 3][..], 3)
        );
        let word = |register| {
            let bytes = base.memory.read(register, 2);
            i16::from_le_bytes([bytes[0], bytes[1]])
        };
        assert!((360..=380).contains(&word(HEAT_LEFT)) && (210..=230).contains(&word(HEAT_RIGHT)));
        for told in [3, 0] {
            base.memory.set(KITS, told);
            base.feel(&world);
            assert_eq!((base.kits().len(), base.memory.get(KITS)), (3, 3));
        }
        base.reset(Instant::from_millis(1), StartCause::PowerOn);
        assert_eq!(base.memory.get(KITS), 3);
        base.memory.set(KITS, 4);
        base.feel(&world);
        assert_eq!(base.kits().len(), 4);
        assert_eq!(world.now(), Instant::ZERO);
    }
}
