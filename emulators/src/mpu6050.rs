//! MPU-6050: gyroscope and accelerometer of three axes each, a chip on an I2C bus.
//!
//! ```text
//! 1A  low-pass filter            3B .. 40  acceleration x, y, z     two's complement,
//! 1B  range of the gyroscope     41, 42    temperature              high byte first
//! 1C  range of accelerations     43 .. 48  turn rate x, y, z
//! 6B  power: 40 sleeps, as after power-up; 80 resets      75  who am I: 68
//! ```
//!
//! x looks ahead, y to the left, z up. A sample is taken at the beginning of each read: the chip's
//! own thousand a second are never older than what a master can tell apart. The gyroscope has white
//! noise and a bias that walks; the walk begins anew when the body turns the other way, which makes
//! an integrated heading climb slowly and start over (report, page 14).
//!
//! Sources: register map RM-MPU-6000A, data sheet PS-MPU-6000A. Bias and its walk are guesses that
//! give the report's picture.

use core::time::Duration;

use protocols::Instant;

use crate::i2c::{Log, RegisterChip, registers};
use crate::rng::Rng;
use crate::world::World;

/// Address in eight bits, with pin AD0 low.
pub const ADDRESS: u8 = 0xD0;
/// What register 75 reads.
pub const IDENTITY: u8 = 0x68;

/// Registers that a master needs.
pub mod register {
    /// Range of the gyroscope in bits 4 and 3.
    pub const GYRO_CONFIG: u8 = 0x1B;
    /// Range of accelerations in bits 4 and 3.
    pub const ACCEL_CONFIG: u8 = 0x1C;
    /// Acceleration along x, high byte; y, z, temperature and turn rates follow.
    pub const ACCEL: u8 = 0x3B;
    /// Turn rate about x, high byte; y and z follow.
    pub const GYRO: u8 = 0x43;
    /// Reset in bit 7, sleep in bit 6.
    pub const POWER: u8 = 0x6B;
    /// The chip's name.
    pub const WHO_AM_I: u8 = 0x75;
}

const RESET: u8 = 0x80;
const SLEEP: u8 = 0x40;
/// Counts per degree a second and per g, by range.
const GYRO_COUNTS: [f64; 4] = [131.0, 65.5, 32.8, 16.4];
const ACCEL_COUNTS: [f64; 4] = [16_384.0, 8_192.0, 4_096.0, 2_048.0];
/// Standard acceleration of free fall, m/s².
const G_M_S2: f64 = 9.806_65;
/// How long the accelerometer's filter takes: its widest, 260 Hz, about 4 ms; longer, because a
/// wheel that slips changes its speed at once in this world.
const ACCEL_FILTER: Duration = Duration::from_millis(10);
/// A body that turns slower than this turns neither way, degrees a second.
const TURNS_DPS: f64 = 2.0;
/// First and last data register.
const DATA: core::ops::RangeInclusive<u8> = register::ACCEL..=0x48;

/// How good a chip is.
#[derive(Clone, Debug, PartialEq)]
pub struct Mpu6050Config {
    /// Turn rates that it shows at rest, degrees a second, x, y, z.
    pub bias_dps: [f64; 3],
    /// Walk of the bias: standard deviation after a second, degrees a second.
    pub bias_walk_dps: f64,
    /// Of each turn rate, degrees a second.
    pub gyro_noise_dps: f64,
    /// Of each acceleration, m/s².
    pub accel_noise_m_s2: f64,
    /// Of the chip, degrees Celsius.
    pub temperature_c: f64,
}

impl Default for Mpu6050Config {
    /// Within the data sheet's limits (bias up to 20 degrees a second, noise 0.05).
    fn default() -> Self {
        Self {
            bias_dps: [-1.1, 0.6, 0.5],
            bias_walk_dps: 0.02,
            gyro_noise_dps: 0.05,
            accel_noise_m_s2: 0.04,
            temperature_c: 28.0,
        }
    }
}

/// Names of the faults.
const FAULTS: [&str; 4] = ["off", "restart", "stuck", "wrong"];

/// The chip.
#[derive(Clone, Debug)]
pub struct Mpu6050 {
    config: Mpu6050Config,
    noise: Rng,
    power: u8,
    gyro_range: usize,
    accel_range: usize,
    /// Written and read back, without effect.
    filter: u8,
    data: [u8; 14],
    /// Part of the biases that has walked, degrees a second.
    walked: [f64; 3],
    walked_at: Instant,
    /// 1 if the body turned to the left last, -1 if to the right, at first 0.
    way: i8,
    is_off: bool,
    is_stuck: bool,
    is_wrong: bool,
    log: Log,
}

impl Mpu6050 {
    /// A chip that has just been switched on, and so sleeps. Its noise is that of the stream `name`
    /// of `seed`.
    pub fn new(config: Mpu6050Config, seed: u64, name: &str) -> Self {
        Self {
            config,
            noise: Rng::stream(seed, name),
            power: SLEEP,
            gyro_range: 0,
            accel_range: 0,
            filter: 0,
            data: [0; 14],
            walked: [0.0; 3],
            walked_at: Instant::ZERO,
            way: 0,
            is_off: false,
            is_stuck: false,
            is_wrong: false,
            log: Log::default(),
        }
    }

    /// As after power-up.
    fn reset(&mut self) {
        self.power = SLEEP;
        (self.gyro_range, self.accel_range, self.filter) = (0, 0, 0);
        self.data = [0; 14];
    }

    fn sample(&mut self, now: Instant, world: &World) {
        let rate_dps = world.turn_rate().to_degrees();
        self.walk(now, rate_dps);
        let felt = world.acceleration(ACCEL_FILTER);
        let accelerations = [felt.x, felt.y, G_M_S2];
        let rates = [0.0, 0.0, rate_dps];
        let mut words = [0_i16; 7];
        for (axis, acceleration) in accelerations.into_iter().enumerate() {
            let shown = acceleration + self.config.accel_noise_m_s2 * self.noise.gauss();
            words[axis] = whole(shown / G_M_S2 * ACCEL_COUNTS[self.accel_range]);
        }
        words[3] = whole((self.config.temperature_c - 36.53) * 340.0);
        for (axis, rate) in rates.into_iter().enumerate() {
            let bias = self.config.bias_dps[axis] + self.walked[axis];
            let shown = rate + bias + self.config.gyro_noise_dps * self.noise.gauss();
            words[4 + axis] = whole(shown * GYRO_COUNTS[self.gyro_range]);
        }
        for (bytes, word) in self.data.chunks_exact_mut(2).zip(words) {
            bytes.copy_from_slice(&word.to_be_bytes());
        }
    }

    /// Lets the biases walk, from nothing if the body turns the other way than before.
    fn walk(&mut self, now: Instant, rate_dps: f64) {
        let root = (now - self.walked_at).as_secs_f64().sqrt();
        self.walked_at = now;
        for walked in &mut self.walked {
            *walked += self.config.bias_walk_dps * root * self.noise.gauss();
        }
        let way = match rate_dps {
            rate if rate > TURNS_DPS => 1,
            rate if rate < -TURNS_DPS => -1,
            _ => return,
        };
        if way != self.way {
            self.way = way;
            self.walked = [0.0; 3];
        }
    }

    fn register(&self, register: u8) -> u8 {
        match register {
            0x1A => self.filter,
            register::GYRO_CONFIG => range_bits(self.gyro_range),
            register::ACCEL_CONFIG => range_bits(self.accel_range),
            register::POWER => self.power,
            register::WHO_AM_I if self.is_wrong => 0x98,
            register::WHO_AM_I => IDENTITY,
            _ if DATA.contains(&register) => self.data[usize::from(register - DATA.start())],
            _ => 0,
        }
    }
}

impl RegisterChip for Mpu6050 {
    fn acknowledges(&self, _now: Instant, address: u8) -> bool {
        address == ADDRESS && !self.is_off
    }

    fn write(&mut self, _now: Instant, register: u8, data: &[u8], _world: &World) {
        for (register, &byte) in registers(register).zip(data) {
            match register {
                0x1A => self.filter = byte & 0x3F,
                register::GYRO_CONFIG => self.gyro_range = range(byte),
                register::ACCEL_CONFIG => self.accel_range = range(byte),
                register::POWER if byte & RESET != 0 => self.reset(),
                register::POWER => self.power = byte,
                _ => {}
            }
        }
    }

    fn read(&mut self, now: Instant, register: u8, data: &mut [u8], world: &World) {
        let mut asked = registers(register).take(data.len());
        let asks_for_data = asked.any(|it| DATA.contains(&it));
        if asks_for_data && self.power & SLEEP == 0 && !self.is_stuck {
            self.sample(now, world);
        }
        for (register, byte) in registers(register).zip(data) {
            *byte = self.register(register);
        }
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &FAULTS
    }

    /// `off`: does not acknowledge. `restart`: sleeps as after a dip of its supply. `stuck`: the
    /// last sample for ever. `wrong`: a clone with another name.
    fn set_fault(&mut self, _now: Instant, fault: &str, _figure: Option<f64>, begins: bool) {
        match fault {
            "off" => self.is_off = begins,
            "restart" if begins => self.reset(),
            "stuck" => self.is_stuck = begins,
            "wrong" => self.is_wrong = begins,
            _ => {}
        }
    }

    fn log(&mut self) -> &mut Log {
        &mut self.log
    }
}

/// Bits 4 and 3.
fn range(byte: u8) -> usize {
    usize::from(byte >> 3 & 3)
}

fn range_bits(range: usize) -> u8 {
    u8::try_from(range << 3).unwrap_or_default()
}

/// Rounded, and held within what a word shows.
#[expect(clippy::cast_possible_truncation, reason = "saturates, which is meant")]
fn whole(value: f64) -> i16 {
    value.round() as i16
}

#[cfg(test)]
mod tests;
