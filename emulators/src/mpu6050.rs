//! MPU-6050: gyroscope and accelerometer of three axes each, a chip on an I2C bus.
//!
//! ```text
//! 19  divider of the sample rate 3A        status: 10 FIFO overflowed, 01 a sample is ready
//! 1A  low-pass filter            3B .. 40  acceleration x, y, z     two's complement,
//! 1B  range of the gyroscope     41, 42    temperature              high byte first
//! 1C  range of accelerations     43 .. 48  turn rate x, y, z
//! 23  selection for the FIFO     6A        40 FIFO on, 04 FIFO reset
//! 72, 73  bytes in the FIFO      74        reads them, one after the other
//! 6B  power: 40 sleeps, as after power-up; 80 resets      75  who am I: 68
//! ```
//!
//! Every writable register keeps the written value, except for bits that clear themselves. x points
//! ahead, y to the left, z up. A sample is taken at the beginning of each read: the chip samples a
//! thousand times a second, too often for a master to see the difference. The gyroscope has white
//! noise and a bias that walks. The walk restarts when the body turns the other way, so an
//! integrated heading climbs slowly and starts over (report, page 14).
//!
//! A sample is ready each (1 + divider) / 8 kHz, or / 1 kHz with a filter of 1 to 6; reading the
//! status clears it. All samples that enter the FIFO between two requests have the values of the
//! body at the later request.
//!
//! Sources: register map RM-MPU-6000A, data sheet PS-MPU-6000A. Bias and its walk are guesses that
//! give the report's picture.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::Instant;

use crate::i2c::{Log, RegisterChip, registers};
use crate::rng::Rng;
use crate::world::World;

/// Address in eight bits, with pin AD0 low.
pub const ADDRESS: u8 = 0xD0;
/// Value of register 75.
pub const IDENTITY: u8 = 0x68;

/// Registers that a master needs.
pub mod register {
    /// The sample rate is divided by one more than this.
    pub const DIVIDER: u8 = 0x19;
    /// Low-pass filter in bits 2 to 0.
    pub const FILTER: u8 = 0x1A;
    /// Sources of the FIFO: 80 temperature, 40 20 10 turn rates, 08 accelerations.
    pub const FIFO_ENABLE: u8 = 0x23;
    /// Sources of interrupts: 10 overflow, 01 a sample is ready.
    pub const INT_ENABLE: u8 = 0x38;
    /// Events so far; reading it clears it.
    pub const INT_STATUS: u8 = 0x3A;
    /// FIFO on in bit 6, its reset in bit 2.
    pub const USER_CONTROL: u8 = 0x6A;
    /// Bytes in the FIFO, high byte first.
    pub const FIFO_COUNT: u8 = 0x72;
    /// The FIFO itself: reads do not continue to the next register.
    pub const FIFO: u8 = 0x74;
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
/// Bits of the status.
const READY: u8 = 0x01;
const OVERFLOW: u8 = 0x10;
/// Bits of the user control.
const FIFO_ON: u8 = 0x40;
const FIFO_RESET: u8 = 0x04;
/// Bits of the user control that clear themselves.
const SELF_CLEARING: u8 = 0x07;
/// Bytes that the FIFO holds; beyond them the oldest are lost.
const FIFO_MAX: usize = 1_024;
/// Registers that only the chip writes, and those that always read 0.
const READ_ONLY: [core::ops::RangeInclusive<u8>; 4] = [
    register::INT_STATUS..=0x60,
    0x72..=0x74,
    0x75..=0x75,
    0x76..=0xFF,
];
const WRITE_ONLY: [u8; 1] = [0x68];
/// Counts per degree a second and per g, by range.
const GYRO_COUNTS: [f64; 4] = [131.0, 65.5, 32.8, 16.4];
const ACCEL_COUNTS: [f64; 4] = [16_384.0, 8_192.0, 4_096.0, 2_048.0];
/// Standard acceleration of free fall, m/s².
const G_M_S2: f64 = 9.806_65;
/// Duration of the accelerometer's filter. Its widest, 260 Hz, takes about 4 ms; this one is
/// longer, because a wheel that slips changes its speed at once in this world.
const ACCEL_FILTER: Duration = Duration::from_millis(10);
/// A body that turns slower than this counts as not turning, degrees a second.
const TURNS_DPS: f64 = 2.0;
/// First and last data register.
const DATA: core::ops::RangeInclusive<u8> = register::ACCEL..=0x48;

/// Accuracy of a chip.
#[derive(Clone, Debug, PartialEq)]
pub struct Mpu6050Config {
    /// Turn rates that it shows at rest, degrees a second, x, y, z.
    pub bias_dps: [f64; 3],
    /// Walk of the bias: standard deviation after a second, degrees a second.
    pub bias_walk_dps: f64,
    /// Noise of each turn rate, degrees a second.
    pub gyro_noise_dps: f64,
    /// Noise of each acceleration, m/s².
    pub accel_noise_m_s2: f64,
    /// Temperature of the chip, degrees Celsius.
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
    /// All registers as they were written.
    registers: [u8; 128],
    data: [u8; 14],
    /// Bits of the status that reading it will clear.
    status: u8,
    fifo: VecDeque<u8>,
    /// The last byte read from the FIFO: an empty FIFO repeats it.
    fifo_last: u8,
    /// Time up to which samples are in the FIFO and in the status.
    sampled_at: Instant,
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
            registers: RESET_VALUES,
            data: [0; 14],
            status: 0,
            fifo: VecDeque::new(),
            fifo_last: 0,
            sampled_at: Instant::ZERO,
            walked: [0.0; 3],
            walked_at: Instant::ZERO,
            way: 0,
            is_off: false,
            is_stuck: false,
            is_wrong: false,
            log: Log::default(),
        }
    }

    /// Sets all registers as after power-up.
    fn reset(&mut self) {
        self.registers = RESET_VALUES;
        self.data = [0; 14];
        self.status = 0;
        self.fifo.clear();
    }

    fn is_asleep(&self) -> bool {
        self.registers[usize::from(register::POWER)] & SLEEP != 0
    }

    /// From one sample to the next.
    fn sample_period(&self) -> Duration {
        let filter = self.registers[usize::from(register::FILTER)] & 0x07;
        let rate_hz = if matches!(filter, 1..=6) {
            1_000
        } else {
            8_000
        };
        let divider = u32::from(self.registers[usize::from(register::DIVIDER)]) + 1;
        Duration::from_secs(1) * divider / rate_hz
    }

    /// Adds the samples since the last look: to the status and to the FIFO.
    fn catch_up(&mut self, now: Instant, world: &World) {
        let period = self.sample_period();
        if self.is_asleep() || self.is_stuck {
            self.sampled_at = now;
            return;
        }
        let passed = (now - self.sampled_at).as_nanos() / period.as_nanos();
        let Ok(passed @ 1..) = u64::try_from(passed) else {
            return;
        };
        let nanos = u64::try_from(period.as_nanos()).unwrap_or(u64::MAX);
        self.sampled_at += Duration::from_nanos(nanos.saturating_mul(passed));
        self.status |= READY;
        let wanted = self.registers[usize::from(register::FIFO_ENABLE)];
        let is_on = self.registers[usize::from(register::USER_CONTROL)] & FIFO_ON != 0;
        if !is_on || wanted & 0xF8 == 0 {
            return;
        }
        self.sample(now, world);
        // In the order of the registers.
        let parts = [
            (0x08, 0..6),
            (0x80, 6..8),
            (0x40, 8..10),
            (0x20, 10..12),
            (0x10, 12..14),
        ];
        let parts = parts.into_iter().filter(|(bit, _)| wanted & bit != 0);
        let sample: Vec<u8> = parts
            .flat_map(|(_, range)| self.data[range].to_vec())
            .collect();
        // Samples beyond the FIFO's size are lost whatever their values.
        let fits = u64::try_from(FIFO_MAX / sample.len() + 1).unwrap_or(1);
        for _ in 0..passed.min(fits) {
            self.fifo.extend(&sample);
        }
        let lost = self.fifo.len().saturating_sub(FIFO_MAX);
        if lost > 0 || passed > fits {
            self.fifo.drain(..lost);
            self.status |= OVERFLOW;
        }
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
            words[axis] = whole(shown / G_M_S2 * ACCEL_COUNTS[self.range(register::ACCEL_CONFIG)]);
        }
        words[3] = whole((self.config.temperature_c - 36.53) * 340.0);
        for (axis, rate) in rates.into_iter().enumerate() {
            let bias = self.config.bias_dps[axis] + self.walked[axis];
            let shown = rate + bias + self.config.gyro_noise_dps * self.noise.gauss();
            words[4 + axis] = whole(shown * GYRO_COUNTS[self.range(register::GYRO_CONFIG)]);
        }
        for (bytes, word) in self.data.chunks_exact_mut(2).zip(words) {
            bytes.copy_from_slice(&word.to_be_bytes());
        }
    }

    /// Lets the biases walk; from zero if the body changed its direction of rotation.
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

    /// Range of a sensor by its register: bits 4 and 3.
    fn range(&self, register: u8) -> usize {
        usize::from(self.registers[usize::from(register)] >> 3 & 3)
    }

    fn register(&mut self, register: u8) -> u8 {
        let [high, low] = u16::try_from(self.fifo.len())
            .unwrap_or(u16::MAX)
            .to_be_bytes();
        match register {
            register::INT_STATUS => core::mem::take(&mut self.status),
            register::FIFO_COUNT => high,
            0x73 => low,
            register::FIFO => {
                self.fifo_last = self.fifo.pop_front().unwrap_or(self.fifo_last);
                self.fifo_last
            }
            register::WHO_AM_I if self.is_wrong => 0x98,
            register::WHO_AM_I => IDENTITY,
            _ if DATA.contains(&register) => self.data[usize::from(register - DATA.start())],
            _ if WRITE_ONLY.contains(&register) => 0,
            _ => self
                .registers
                .get(usize::from(register))
                .copied()
                .unwrap_or(0),
        }
    }

    fn set_register(&mut self, register: u8, byte: u8) {
        if READ_ONLY.iter().any(|range| range.contains(&register)) {
            return;
        }
        match register {
            register::POWER if byte & RESET != 0 => return self.reset(),
            register::USER_CONTROL if byte & FIFO_RESET != 0 => self.fifo.clear(),
            _ => {}
        }
        let kept = match register {
            register::USER_CONTROL => byte & !SELF_CLEARING,
            _ => byte,
        };
        self.registers[usize::from(register)] = kept;
    }
}

/// All registers are 0 after a reset, except the power register.
const RESET_VALUES: [u8; 128] = {
    let mut values = [0; 128];
    values[register::POWER as usize] = SLEEP;
    values
};

impl RegisterChip for Mpu6050 {
    fn acknowledges(&self, _now: Instant, address: u8) -> bool {
        address == ADDRESS && !self.is_off
    }

    fn write(&mut self, now: Instant, register: u8, data: &[u8], world: &World) {
        self.catch_up(now, world);
        for (register, &byte) in registers(register).zip(data) {
            self.set_register(register, byte);
        }
    }

    fn read(&mut self, now: Instant, register: u8, data: &mut [u8], world: &World) {
        self.catch_up(now, world);
        let mut asked = registers(register).take(data.len());
        let asks_for_data = asked.any(|it| DATA.contains(&it));
        if asks_for_data && !self.is_asleep() && !self.is_stuck {
            self.sample(now, world);
        }
        let mut register = register;
        for byte in data {
            *byte = self.register(register);
            register = self.next_register(register, 1);
        }
    }

    /// A read of the FIFO stays there.
    fn next_register(&self, register: u8, count: u8) -> u8 {
        let next = register.wrapping_add(count);
        let passes = (register..=register::FIFO).contains(&register) && next > register::FIFO;
        if passes { register::FIFO } else { next }
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &FAULTS
    }

    /// `off`: does not acknowledge. `restart`: sleeps as after a dip of its supply. `stuck`: the
    /// last sample forever. `wrong`: a clone with another name.
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

/// Rounded, and limited to the range of a word.
#[expect(clippy::cast_possible_truncation, reason = "saturates, which is meant")]
fn whole(value: f64) -> i16 {
    value.round() as i16
}

#[cfg(test)]
mod tests;
