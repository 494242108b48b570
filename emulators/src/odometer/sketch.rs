//! The program on the microcontroller, in the arithmetic that it has: 32-bit floats.

use protocols::Instant;
use protocols::odometer::{Dialect, Measurement, print_float};

use super::encoder::PolledEncoder;
use crate::i2c::RegisterChip as _;
use crate::mpu6050::{ADDRESS, IDENTITY, Mpu6050, register};
use crate::world::World;

/// Distance that the program takes for a count: 2 pi / 60 * 0.032 m.
const COUNT_M: f32 = 0.003_351;
/// Degrees a second of a count at 2000 degrees a second, as the sensor's library has it.
const RATE_UNIT_DPS: f32 = 0.060_975;
/// The same as the program has it for the rate that it prints: 25 / 2000, which is 4.88 times too
/// small.
const PRINTED_UNIT_DPS: f32 = 25.0 / 2000.0;
/// Time that the program takes for a loop.
const STEP_S: f32 = 0.01;
/// Samples at rest whose mean is taken for the offset.
const CALIBRATION_SAMPLES: i16 = 50;
/// What the motor's current adds to the field along the car's own x, uT at full speed: a guess.
/// With it a compass is of no use while driving (report, page 10).
const CURRENT_UT: f32 = 15.0;
/// Speed at which [`CURRENT_UT`] is added, m/s.
const FULL_SPEED_M_S: f32 = 1.2;
/// Horizontal part of the earth's field along x of the world, and the part into the floor, uT.
const FIELD_UT: [f32; 2] = [20.0, -44.0];

/// What the program prints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// Distance, rate, heading, time and a sum. The documented and the sound dialect print the true
    /// rate, `AsCoded` the one that is scaled wrong and has the sensor's offset.
    Pose(Dialect),
    /// The later sketch: distance and the nine figures of a sensor with a magnetometer. Their units
    /// are not documented: degrees a second, m/s² and microtesla are guesses.
    Raw,
}

impl Default for Program {
    fn default() -> Self {
        Self::Pose(Dialect::AsCoded)
    }
}

/// What the program does with a loop that takes more than its 10 ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overrun {
    /// `delay` of a negative time, which is 49 days: as coded.
    #[default]
    Hangs,
    /// The next loop is late.
    IsLate,
}

/// Its variables.
#[derive(Clone, Debug, Default)]
pub(super) struct Sketch {
    began: Instant,
    encoder: PolledEncoder,
    /// Edges at the reset.
    edges_zero: i64,
    offset: f32,
    yaw_rad: f32,
}

impl Sketch {
    pub(super) const fn counted(&self) -> i64 {
        self.encoder.count()
    }

    /// Sets the sensor up and calibrates it; whether it is there. The program began at `began`.
    pub(super) fn begin(
        &mut self,
        (now, began): (Instant, Instant),
        edges: i64,
        imu: &mut Mpu6050,
        world: &World,
    ) -> bool {
        let mut identity = [0];
        if !imu.acknowledges(now, ADDRESS) {
            return false;
        }
        imu.read(now, register::WHO_AM_I, &mut identity, world);
        if identity != [IDENTITY] {
            return false;
        }
        imu.write(now, register::POWER, &[0], world);
        imu.write(now, register::GYRO_CONFIG, &[0x18, 0x00], world);
        let samples = (0..CALIBRATION_SAMPLES).map(|_| f32::from(read(now, imu, world)[6]));
        *self = Self {
            began,
            edges_zero: edges,
            offset: samples.sum::<f32>() / f32::from(CALIBRATION_SAMPLES),
            ..Self::default()
        };
        true
    }

    /// One loop; the line that it prints. The contacts are at `edges`, contact A open or not.
    pub(super) fn turn(
        &mut self,
        now: Instant,
        (edges, is_open): (i64, bool),
        (program, iron_ut): (Program, f32),
        imu: &mut Mpu6050,
        world: &World,
    ) -> Vec<u8> {
        self.encoder.look(edges - self.edges_zero, is_open);
        let words = read(now, imu, world);
        let raw = f32::from(words[6]);
        let rate_rad_s = ((raw - self.offset) * RATE_UNIT_DPS).to_radians();
        self.yaw_rad += rate_rad_s * STEP_S;
        #[expect(clippy::cast_precision_loss, reason = "as the microcontroller does it")]
        let distance_m = self.encoder.count() as f32 * COUNT_M;
        match program {
            Program::Raw => raw_line(distance_m, &words, iron_ut, world),
            Program::Pose(dialect) => {
                let printed = match dialect {
                    Dialect::AsCoded => (raw * PRINTED_UNIT_DPS).to_radians(),
                    Dialect::Seed | Dialect::Fixed => rate_rad_s,
                };
                let measured = Measurement {
                    distance_m,
                    rate_rad_s: printed,
                    yaw_rad: self.yaw_rad,
                    time_ms: millis(now, self.began),
                };
                dialect.line(&measured).as_bytes().to_vec()
            }
        }
    }
}

/// Accelerations, temperature and turn rates; all ones from a sensor that does not acknowledge.
fn read(now: Instant, imu: &mut Mpu6050, world: &World) -> [i16; 7] {
    let mut bytes = [0xFF; 14];
    if imu.acknowledges(now, ADDRESS) {
        imu.read(now, register::ACCEL, &mut bytes, world);
    }
    let mut words = bytes.chunks_exact(2);
    core::array::from_fn(|_| {
        let word = words.next().and_then(|word| word.try_into().ok());
        i16::from_be_bytes(word.unwrap_or_default())
    })
}

/// `iron_ut`: what iron nearby adds to the field along y of the world.
fn raw_line(distance_m: f32, words: &[i16; 7], iron_ut: f32, world: &World) -> Vec<u8> {
    let [ax, ay, az, _, wx, wy, wz] = words.map(f32::from);
    let (sin, cos) = libm::sincos(world.pose().theta);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "to 32 bits, which is meant"
    )]
    let (sin, cos) = (sin as f32, cos as f32);
    let [ahead, up] = FIELD_UT;
    #[expect(
        clippy::cast_possible_truncation,
        reason = "to 32 bits, which is meant"
    )]
    let speed = world.axis_speed("drive").unwrap_or_default() as f32;
    let current = CURRENT_UT * speed / FULL_SPEED_M_S;
    let gravity = 9.806_65 / 16_384.0;
    let figures = [
        distance_m,
        wx * RATE_UNIT_DPS,
        wy * RATE_UNIT_DPS,
        wz * RATE_UNIT_DPS,
        ax * gravity,
        ay * gravity,
        az * gravity,
        ahead * cos + iron_ut * sin + current,
        iron_ut * cos - ahead * sin,
        up,
    ];
    let mut line = "#".to_owned();
    for figure in figures {
        // Writing to a string does not fail.
        let _ = print_float(&mut line, figure, 2);
        line.push('*');
    }
    line.push_str("\r\n");
    line.into_bytes()
}

/// Since the program began; wraps after 49 days.
fn millis(now: Instant, began: Instant) -> u32 {
    let millis = (now - began).as_millis() & u128::from(u32::MAX);
    u32::try_from(millis).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{Ackermann, AckermannConfig, Fixture, Pose, Scene};

    /// 100, -400 and 40 counts of 0.060975 degrees a second; 1, -0.5 and 0.25 of 9.80665 m/s²; a
    /// field of 20 uT along x and 10 along y, seen by a car that is turned by 30 degrees: 17.32 + 5
    /// and 8.66 - 10.
    #[test]
    fn the_later_sketch_prints_what_its_sensors_tell() {
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).expect("empty");
        let car = Ackermann::new(AckermannConfig::default().ideal(), 1).expect("sound");
        let pose = Pose::new(0.0, 0.0, 30_f64.to_radians());
        let world = World::with_chassis(scene, Box::new(car), pose).expect("free");
        let words = [16_384, -8_192, 4_096, 7, 100, -400, 40];
        let line = raw_line(1.5, &words, 10.0, &world);
        let expected = "#1.50*6.10*-24.39*2.44*9.81*-4.90*2.45*22.32*-1.34*-44.00*\r\n";
        assert_eq!(String::from_utf8(line).as_deref(), Ok(expected));
    }

    /// 2^32 ms are 49.7 days.
    #[test]
    fn milliseconds_wrap_after_49_days() {
        let began = Instant::from_millis(100);
        let told = [100, 350, 4_294_967_395, 4_294_967_396, 4_294_967_400]
            .map(|at| millis(Instant::from_millis(at), began));
        assert_eq!(told, [0, 250, u32::MAX, 0, 4]);
    }
}
