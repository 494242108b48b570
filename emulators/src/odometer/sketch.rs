//! The program on the microcontroller, in the arithmetic that it has: 32-bit floats.

use protocols::Instant;
use protocols::odometer::{Dialect, Measurement, print_float};

use super::encoder::PolledEncoder;
use crate::i2c::RegisterChip as _;
use crate::mpu6050::{ADDRESS, IDENTITY, Mpu6050, register};
use crate::world::World;

/// Distance that the program assumes for a count: 2 pi / 60 * 0.032 m.
const COUNT_M: f32 = 0.003_351;
/// Degrees a second of a count at 2000 degrees a second, as the sensor's library has it.
const RATE_UNIT_DPS: f32 = 0.060_975;
/// The program's unit of the rate that it prints: 25 / 2000, which is 4.88 times too small.
const PRINTED_UNIT_DPS: f32 = 25.0 / 2000.0;
/// Time that the program assumes for a loop.
const STEP_S: f32 = 0.01;
/// Number of samples at rest whose mean is the offset.
const CALIBRATION_SAMPLES: i16 = 50;
/// Field that the motor's current adds along the car's own x, uT at full speed: a guess. It makes a
/// compass useless while driving (report, page 10).
const CURRENT_UT: f32 = 15.0;
/// Speed at which [`CURRENT_UT`] is added, m/s.
const FULL_SPEED_M_S: f32 = 1.2;
/// Horizontal part of the earth's field along x of the world, and the part into the floor, uT.
const FIELD_UT: [f32; 2] = [20.0, -44.0];

/// Output of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// Distance, rate, heading, time and a sum. The documented and the sound dialect print the true
    /// rate, `AsCoded` the one that is scaled wrong and has the sensor's offset.
    Pose(Dialect),
    /// The later sketch: distance, turn rates in radians a second without their offsets,
    /// accelerations in m/s², and a magnetic field, which reads 0 unless the sensor has a
    /// magnetometer (microtesla then, a guess).
    Raw,
}

impl Default for Program {
    fn default() -> Self {
        Self::Pose(Dialect::AsCoded)
    }
}

/// Reaction of the program to a loop that takes more than its 10 ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overrun {
    /// `delay` of a negative time, which is 49 days: as coded.
    #[default]
    Hangs,
    /// The next loop is late.
    IsLate,
}

/// Variables of the program.
#[derive(Clone, Debug, Default)]
pub(super) struct Sketch {
    began: Instant,
    encoder: PolledEncoder,
    /// Edges at the reset.
    edges_zero: i64,
    /// Reading of each axis of the gyroscope at rest.
    offsets: [f32; 3],
    yaw_rad: f32,
}

impl Sketch {
    pub(super) const fn counted(&self) -> i64 {
        self.encoder.count()
    }

    /// Sets the sensor up and calibrates it; `true` if it answers. The program began at `began`.
    pub(super) fn begin(
        &mut self,
        (now, began): (Instant, Instant),
        edges: i64,
        imu: &mut Mpu6050,
        world: &World,
    ) -> bool {
        imu.write(now, register::POWER, &[0], world);
        imu.write(now, register::GYRO_CONFIG, &[0x18, 0x00], world);
        let mut sums = [0.0_f32; 3];
        for _ in 0..CALIBRATION_SAMPLES {
            let Some(words) = read(now, imu, world) else {
                return false;
            };
            for (sum, word) in sums.iter_mut().zip(&words[4..]) {
                *sum += f32::from(*word);
            }
        }
        *self = Self {
            began,
            edges_zero: edges,
            offsets: sums.map(|sum| sum / f32::from(CALIBRATION_SAMPLES)),
            ..Self::default()
        };
        true
    }

    /// Runs one loop; returns the line that it prints, `None` if the sensor does not answer. The
    /// contacts are at `edges`, contact A open or not. The sensor has a magnetometer if `iron_ut`
    /// is given.
    pub(super) fn turn(
        &mut self,
        now: Instant,
        (edges, is_open): (i64, bool),
        (program, iron_ut): (Program, Option<f32>),
        imu: &mut Mpu6050,
        world: &World,
    ) -> Option<Vec<u8>> {
        self.encoder.look(edges - self.edges_zero, is_open);
        let words = read(now, imu, world)?;
        let raw = f32::from(words[6]);
        let rate = |axis: usize| {
            let counts = f32::from(words[4 + axis]) - self.offsets[axis];
            (counts * RATE_UNIT_DPS).to_radians()
        };
        let rates = [0, 1, 2].map(rate);
        let rate_rad_s = rates[2];
        self.yaw_rad += rate_rad_s * STEP_S;
        #[expect(clippy::cast_precision_loss, reason = "as the microcontroller does it")]
        let distance_m = self.encoder.count() as f32 * COUNT_M;
        Some(match program {
            Program::Raw => {
                let field = iron_ut.map_or([0.0; 3], |iron_ut| field(iron_ut, world));
                raw_line(distance_m, rates, &words, field)
            }
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
        })
    }
}

/// Whether the sensor is there and is the right one.
pub(super) fn finds(now: Instant, imu: &mut Mpu6050, world: &World) -> bool {
    let mut identity = [0];
    if imu.acknowledges(now, ADDRESS) {
        imu.read(now, register::WHO_AM_I, &mut identity, world);
    }
    identity == [IDENTITY]
}

/// Accelerations, temperature and turn rates; `None` from a sensor that does not acknowledge.
fn read(now: Instant, imu: &mut Mpu6050, world: &World) -> Option<[i16; 7]> {
    if !imu.acknowledges(now, ADDRESS) {
        return None;
    }
    let mut bytes = [0; 14];
    imu.read(now, register::ACCEL, &mut bytes, world);
    let mut words = bytes.chunks_exact(2);
    Some(core::array::from_fn(|_| {
        let word = words.next().and_then(|word| word.try_into().ok());
        i16::from_be_bytes(word.unwrap_or_default())
    }))
}

/// The magnetic field in the car's axes, uT. `iron_ut`: field of nearby iron along y of the world.
fn field(iron_ut: f32, world: &World) -> [f32; 3] {
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
    [
        ahead * cos + iron_ut * sin + current,
        iron_ut * cos - ahead * sin,
        up,
    ]
}

fn raw_line(distance_m: f32, rates: [f32; 3], words: &[i16; 7], field: [f32; 3]) -> Vec<u8> {
    let gravity = 9.806_65 / 16_384.0;
    let accelerations = [words[0], words[1], words[2]].map(|word| f32::from(word) * gravity);
    let figures = [[distance_m; 1].as_slice(), &rates, &accelerations, &field].concat();
    let mut line = "#".to_owned();
    for figure in figures {
        // Writing to a string does not fail. A figure that rounds to zero has no sign.
        let shown = if figure.abs() < 0.005 { 0.0 } else { figure };
        let _ = print_float(&mut line, shown, 2);
        line.push('*');
    }
    line.push('\n');
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

    /// The accelerations are 1, -0.5 and 0.25 times 9.80665 m/s². A field of 20 uT along x and 10
    /// uT along y reads 17.32 + 5 and 8.66 - 10 in a car that is turned by 30 degrees. Without a
    /// magnetometer it reads 0, and a line ends with LF alone.
    #[test]
    fn the_later_sketch_prints_what_its_sensors_tell() {
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).expect("empty");
        let car = Ackermann::new(AckermannConfig::default().ideal(), 1).expect("sound");
        let pose = Pose::new(0.0, 0.0, 30_f64.to_radians());
        let world = World::with_chassis(scene, Box::new(car), pose).expect("free");
        let words = [16_384, -8_192, 4_096, 7, 100, -400, 40];
        let rates = [0.11, -0.43, 0.04];
        let line = |field| String::from_utf8(raw_line(1.5, rates, &words, field));
        let expected = "#1.50*0.11*-0.43*0.04*9.81*-4.90*2.45*22.32*-1.34*-44.00*\n";
        assert_eq!(line(field(10.0, &world)).as_deref(), Ok(expected));
        let expected = "#1.50*0.11*-0.43*0.04*9.81*-4.90*2.45*0.00*0.00*0.00*\n";
        assert_eq!(line([0.0; 3]).as_deref(), Ok(expected));
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
