//! The ten infrared distance sensors: mounting, measurement and conversion curves.
//!
//! The world gives a distance and the sensor turns it into a reading of the converter. The firmware
//! turns the reading into millimetres with one curve per sensor. The curves are the fielded
//! firmware's. On the falling branch the sensor is their inverse, so a wall at 150 mm reads as 150
//! mm. Nearer, the reading is a straight line up to the reading at contact. A very near object
//! therefore reads as on the fielded robot: negative, or farther again.

use core::f64::consts::{FRAC_PI_2, PI};

use super::memory::Memory;
use super::profile::NearObjects;
use crate::rng::Rng;
use crate::world::World;

/// Sensors that are powered together, one block per run of the analog task, as indices into
/// [`SENSORS`]. Each sensor is refreshed every 150.6 ms.
const BLOCKS: [&[Sensor]; 3] = [
    &[
        SHORT[0], // front left
        SHORT[1], // right front
        SHORT[2], // back right
        SHORT[3], // left back
    ],
    &[
        SHORT[4], // front right
        SHORT[5], // right back
        SHORT[6], // back left
        SHORT[7], // left front
    ],
    &LONG,
];

/// Registers of the sensor that looks at the floor.
const FLOOR_REGISTER: u8 = 15;
/// Reading of the sensor that looks at the floor, on a floor. A guess; nothing is calibrated.
const FLOOR_RAW: i16 = 500;

/// One sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sensor {
    /// First of its two registers.
    register: u8,
    mount: Mount,
    curve: Curve,
}

/// Position of a sensor on the robot, metres and radians in the robot's frame. The report shows a
/// round robot of about 150 mm radius with pairs of sensors on four sides; the figures are guesses.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mount {
    ahead: f64,
    left: f64,
    angle: f64,
}

/// Conversion of a reading to millimetres by the firmware.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Curve {
    /// c4 r^4 - c3 r^3 + c2 r^2 - c1 r + c0, the first four cut to whole numbers one by one;
    /// 200 unless r is above the threshold.
    Short { above: u16, c: [f64; 5] },
    /// offset - slope r; 400 unless r is above the threshold.
    Long { above: u16, offset: f64, slope: f64 },
}

const fn short(register: u8, mount: [f64; 3], above: u16, c: [f64; 5]) -> Sensor {
    Sensor {
        register,
        mount: Mount {
            ahead: mount[0],
            left: mount[1],
            angle: mount[2],
        },
        curve: Curve::Short { above, c },
    }
}

/// Distance of a sensor from the middle, along its line of sight and across it.
const OUT: f64 = 0.130;
const ASIDE: f64 = 0.060;

const SHORT: [Sensor; 8] = [
    short(
        21,
        [OUT, ASIDE, 0.0],
        96,
        [
            1.785_321_8e-8,
            2.770_541e-5,
            0.016_060_371,
            4.317_962_105,
            489.25,
        ],
    ),
    short(
        29,
        [ASIDE, -OUT, -FRAC_PI_2],
        104,
        [
            2.268_745e-8,
            3.321_157e-5,
            0.018_261_673_7,
            4.700_906_244,
            518.8,
        ],
    ),
    short(
        1,
        [-OUT, -ASIDE, PI],
        120,
        [
            1.970_995_2e-8,
            3.146_821e-5,
            0.018_957_799_9,
            5.335_285_586,
            633.18,
        ],
    ),
    short(
        5,
        [-ASIDE, OUT, FRAC_PI_2],
        96,
        [
            4.063_280_6e-8,
            5.436_834e-5,
            0.026_689_958,
            5.997_356_831,
            571.55,
        ],
    ),
    short(
        31,
        [OUT, -ASIDE, 0.0],
        105,
        [
            1.973_850_2e-8,
            2.997_331e-5,
            0.017_128_970_5,
            4.593_806_035,
            528.0,
        ],
    ),
    short(
        3,
        [-ASIDE, -OUT, -FRAC_PI_2],
        104,
        [
            2.173_990_6e-8,
            3.207_395e-5,
            0.017_757_410_8,
            4.611_348_918,
            515.3,
        ],
    ),
    short(
        7,
        [-OUT, ASIDE, PI],
        100,
        [
            2.396_035_3e-8,
            3.446_703e-5,
            0.018_550_769_8,
            4.681_772_179,
            511.37,
        ],
    ),
    short(
        23,
        [ASIDE, OUT, FRAC_PI_2],
        96,
        [
            2.537_338_1e-8,
            3.589_565e-5,
            0.019_048_178_9,
            4.729_367_296,
            504.85,
        ],
    ),
];

const LONG: [Sensor; 2] = [
    Sensor {
        register: 9,
        mount: Mount {
            ahead: 0.150,
            left: 0.0,
            angle: 0.0,
        },
        curve: Curve::Long {
            above: 76,
            offset: 607.144,
            slope: 1.405_676_598_75,
        },
    },
    Sensor {
        register: 11,
        mount: Mount {
            ahead: -0.150,
            left: 0.0,
            angle: PI,
        },
        curve: Curve::Long {
            above: 105,
            offset: 662.874,
            slope: 1.390_474_576,
        },
    },
];

/// The sensors, the block that is measured next, and their noise.
#[derive(Clone, Debug)]
pub(super) struct Sensors {
    block: usize,
    noise: Rng,
}

impl Sensors {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            block: 0,
            noise: Rng::stream(seed, "base.infrared"),
        }
    }

    /// The base restarts.
    pub(super) const fn restart(&mut self) {
        self.block = 0;
    }

    /// Index of the block that is measured next.
    pub(super) const fn block(&self) -> usize {
        self.block
    }

    /// Measures with one block, and the floor.
    pub(super) fn measure(&mut self, world: &World, near: NearObjects, memory: &mut Memory) {
        for sensor in BLOCKS[self.block] {
            let (reading, distance) = sensor.measure(world, near, self.noise.gauss());
            memory.feed_reading(sensor.register, reading);
            memory.feed_i16(sensor.register, distance);
        }
        memory.has_block(self.block);
        let next = [1, 2].map(|ahead| (self.block + ahead) % BLOCKS.len());
        let wanted = next.into_iter().find(|&block| memory.wants_block(block));
        self.block = wanted.unwrap_or(self.block);
        memory.feed_i16(FLOOR_REGISTER, FLOOR_RAW);
    }
}

impl Sensor {
    /// The converter's reading and the value of its registers; `noise` is in standard deviations.
    fn measure(&self, world: &World, near: NearObjects, noise: f64) -> (u16, i16) {
        let pose = world.pose();
        let from = pose.offset(self.mount.ahead, self.mount.left);
        let hit = world.cast_ray(from, pose.theta + self.mount.angle, RANGE_M);
        match near {
            NearObjects::FollowCurve => {
                let raw = hit.map_or(0, |hit| self.curve.raw(hit.distance * 1_000.0));
                (raw, self.curve.distance_mm(raw))
            }
            NearObjects::Clamped => (0, documented_mm(hit.map(|hit| hit.distance), noise)),
        }
    }
}

/// Maximum distance that makes a difference.
const RANGE_M: f64 = 1.0;
/// All curves fall up to this reading; some of the short ones rise again a little later.
const FALLING_UP_TO: u16 = 430;

/// Distance of a sensor as the report has it: range 1 m, and noise. Without an object the distance
/// is 1 m. The deviation of 3 mm and one part in a hundred is a guess.
fn documented_mm(distance_m: Option<f64>, noise: f64) -> i16 {
    let Some(distance_m) = distance_m else {
        return 1_000;
    };
    let mm = distance_m * 1_000.0;
    let mm = (mm + noise * (3.0 + 0.01 * mm)).clamp(0.0, RANGE_M * 1_000.0);
    #[expect(clippy::cast_possible_truncation, reason = "at most 1000")]
    let whole = mm.round() as i16;
    whole
}

impl Curve {
    /// Distance at which the falling branch ends, and reading at contact. Guesses, chosen so that
    /// the readings that the fielded robot showed (600 short, 620 long) are those at contact.
    const fn near_end(&self) -> (f64, u16) {
        match self {
            Self::Short { .. } => (20.0, 600),
            Self::Long { .. } => (100.0, 620),
        }
    }

    const fn threshold(&self) -> u16 {
        match self {
            Self::Short { above, .. } | Self::Long { above, .. } => *above,
        }
    }

    /// Distance that the firmware computes from a reading, mm.
    fn distance_mm(&self, raw: u16) -> i16 {
        let r = f64::from(raw);
        let value = match *self {
            Self::Short { above, .. } if raw <= above => 200.0,
            Self::Long { above, .. } if raw <= above => 400.0,
            Self::Short { c, .. } => {
                let square = r * r;
                (c[0] * square * square).trunc() - (c[1] * square * r).trunc()
                    + (c[2] * square).trunc()
                    - (c[3] * r).trunc()
                    + c[4]
            }
            Self::Long { offset, slope, .. } => offset - slope * r,
        };
        #[expect(clippy::cast_possible_truncation, reason = "a few hundred at most")]
        let whole = value as i16;
        whole
    }

    /// The least reading above the threshold that the curve converts to `mm` or less.
    fn first_at_most(&self, mm: f64) -> u16 {
        // The branch falls, so the range can be halved until one reading is left.
        let (mut low, mut high) = (self.threshold() + 1, FALLING_UP_TO);
        while low < high {
            let middle = low.midpoint(high);
            if f64::from(self.distance_mm(middle)) <= mm {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        low
    }

    /// Reading of the converter for an object `mm` away.
    fn raw(&self, mm: f64) -> u16 {
        let (near_mm, contact) = self.near_end();
        if mm >= near_mm {
            let raw = self.first_at_most(mm);
            let first = self.threshold() + 1;
            let farthest = f64::from(self.distance_mm(first));
            return if raw == first && mm > farthest {
                0
            } else {
                raw
            };
        }
        let near = f64::from(self.first_at_most(near_mm));
        let part = 1.0 - mm.max(0.0) / near_mm;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between two readings of ten bits"
        )]
        let raw = (near + (f64::from(contact) - near) * part) as u16;
        raw
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{BodyConfig, Point, Pose, Scene, Shape};

    fn sensor(register: u8) -> Sensor {
        *BLOCKS
            .iter()
            .flat_map(|block| block.iter())
            .find(|sensor| sensor.register == register)
            .expect("a distance register")
    }

    /// Field firmware b77a6df: value just above the threshold and least value below reading 600,
    /// in the order of the blocks.
    #[test]
    fn the_curves_are_those_of_the_fielded_firmware() {
        let first_and_least = SHORT.map(|sensor| {
            let first = sensor.curve.threshold() + 1;
            let values = (first..600).map(|raw| sensor.curve.distance_mm(raw));
            (sensor.curve.distance_mm(first), values.min())
        });
        let expected = [
            (198, -4),
            (190, 0),
            (214, 0),
            (195, -13),
            (201, -1),
            (191, -2),
            (195, -3),
            (195, 0),
        ];
        assert_eq!(first_and_least, expected.map(|(a, b)| (a, Some(b))));
    }

    /// Seen on the wire of field firmware b77a6df near reading 620: F8 FE and 38 FF. By hand the
    /// second is -199.2 at 620 and -200.6 at 621, so its converter must have been one step higher.
    #[test]
    fn the_long_range_sensors_go_negative_when_near() {
        assert_eq!(LONG[0].curve.distance_mm(620), -264);
        assert_eq!(LONG[1].curve.distance_mm(621), -200);
        assert_eq!(LONG[0].curve.distance_mm(77), 498);
        assert_eq!(LONG[1].curve.distance_mm(106), 515);
        assert_eq!(LONG.map(|s| s.curve.distance_mm(76)), [400, 400]);
    }

    /// The back-left curve rises from reading 502 on, and reads 104 mm at contact.
    #[test]
    fn a_very_near_object_looks_far() {
        let curve = sensor(5).curve;
        assert_eq!(curve.distance_mm(curve.raw(0.0)), 104);
    }

    #[test]
    fn sensor_and_curve_are_inverse_on_the_falling_branch() {
        let worst = SHORT.map(|sensor| {
            (21..180)
                .map(|mm| (sensor.curve.distance_mm(sensor.curve.raw(f64::from(mm))) - mm).abs())
                .max()
        });
        assert!(worst.iter().all(|&worst| worst <= Some(2)), "{worst:?}");
        let far = LONG[0].curve;
        assert!((far.distance_mm(far.raw(300.0)) - 300).abs() <= 2);
    }

    /// A wall 0.3 m ahead of the middle: 170 mm from the front pair, 150 mm from the long-range
    /// sensor, nothing on the other sides.
    #[test]
    fn each_sensor_looks_where_its_name_says() {
        let wall = Shape::Wall {
            from: Point::new(0.3, -1.0),
            to: Point::new(0.3, 1.0),
        };
        let scene = Scene::new([wall], vec![]).unwrap();
        let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap();
        let read = |register| {
            sensor(register)
                .measure(&world, NearObjects::FollowCurve, 9.0)
                .1
        };
        assert_eq!([21, 31].map(|r| (read(r) - 170).abs() <= 3), [true; 2]);
        assert!((read(9) - 150).abs() <= 2, "{}", read(9));
        assert_eq!([29, 1, 5, 3, 7, 23].map(read), [200; 6]);
        assert_eq!(read(11), 400);
        // The report's: a metre far, and with noise; 170 mm and a deviation of 4.7 mm.
        let read = |register, noise| {
            sensor(register)
                .measure(&world, NearObjects::Clamped, noise)
                .1
        };
        assert_eq!(
            [read(21, 0.0), read(21, 1.0), read(11, 1.0)],
            [170, 175, 1_000]
        );
    }

    /// 3 mm and a hundredth of the distance: 8 mm of 500.
    #[test]
    fn a_documented_sensor_deviates_by_three_millimetres_and_a_hundredth() {
        let told = |distance_m, noise| documented_mm(Some(distance_m), noise);
        assert_eq!(
            [told(0.5, 0.0), told(0.5, 1.0), told(0.5, -2.0)],
            [500, 508, 484]
        );
        assert_eq!([told(0.1, 1.0), told(0.1, -3.0)], [104, 88]);
        assert_eq!([told(0.995, 3.0), told(0.001, -1.0)], [1_000, 0]);
        assert_eq!(documented_mm(None, 5.0), 1_000);
    }

    /// Between the falling branch and contact the reading is a straight line. At contact it is 600
    /// for a short sensor and 620 for a long one.
    #[test]
    fn a_reading_rises_on_to_contact() {
        for (sensors, near_mm, contact) in [(&SHORT[..], 20.0, 600), (&LONG[..], 100.0, 620)] {
            for curve in sensors.iter().map(|sensor| sensor.curve) {
                let end = curve.raw(near_mm);
                assert_eq!([0.0, -5.0].map(|mm| curve.raw(mm)), [contact; 2]);
                assert_eq!(curve.raw(near_mm / 2.0), end.midpoint(contact));
                assert_eq!(curve.raw(near_mm / 4.0), end + (contact - end) * 3 / 4);
            }
        }
    }

    /// A reading just above the threshold is the curve's farthest distance; objects beyond read
    /// nothing.
    #[test]
    fn what_is_farther_than_a_curve_tells_reads_nothing() {
        for sensor in SHORT.iter().chain(&LONG) {
            let curve = sensor.curve;
            let first = curve.threshold() + 1;
            let farthest = f64::from(curve.distance_mm(first));
            assert_eq!(curve.raw(farthest), first);
            assert_eq!(
                [0.1, 1.0, 900.0].map(|more| curve.raw(farthest + more)),
                [0; 3]
            );
            let nearer = curve.raw(farthest - 20.0);
            assert!(nearer > first && f64::from(curve.distance_mm(nearer)) <= farthest - 20.0);
        }
    }
}
