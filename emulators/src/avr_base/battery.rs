//! The battery and its two registers.
//!
//! ```text
//! voltage -> reading (15 mV each, 300 mV offset) -> mV = reading * 15 - 300
//!                                                -> percent = 0.037 * mV - 363
//! ```
//!
//! Source: field firmware b77a6df.

use protocols::Instant;
use protocols::avr::registers;

use super::memory::Memory;
use super::profile::BatteryRegisters;

/// A battery that loses the same voltage every second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatteryConfig {
    /// Voltage at the start, mV.
    pub start_mv: f64,
    /// Lost per second, mV.
    pub drop_mv_per_s: f64,
}

impl Default for BatteryConfig {
    /// Three lithium cells, nearly full, empty after an hour: 12.4 V is 95 percent, 9.9 V is 3.
    fn default() -> Self {
        Self {
            start_mv: 12_400.0,
            drop_mv_per_s: 0.7,
        }
    }
}

/// The battery with the firmware's stored values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Battery {
    config: BatteryConfig,
    since: Instant,
    /// Minimum voltage seen since the firmware started, mV.
    least_mv: u16,
    /// Whether a fault makes the battery almost empty.
    pub(super) is_low: bool,
}

/// Voltage of an almost empty battery, mV: 3 percent.
const LOW_MV: f64 = 9_900.0;

impl Battery {
    pub(super) const fn new(config: BatteryConfig) -> Self {
        Self {
            config,
            since: Instant::ZERO,
            least_mv: u16::MAX,
            is_low: false,
        }
    }

    /// Replaces or charges the battery.
    pub(super) const fn replace(&mut self, now: Instant, config: BatteryConfig) {
        self.config = config;
        self.since = now;
    }

    /// Resets the stored values when the firmware restarts.
    pub(super) const fn forget(&mut self) {
        self.least_mv = u16::MAX;
    }

    /// One run of the analog task.
    pub(super) fn sample(&mut self, now: Instant, kind: BatteryRegisters, memory: &mut Memory) {
        let gone_s = (now - self.since).as_secs_f64();
        let volts_mv = match self.is_low {
            true => LOW_MV,
            false => self.config.start_mv - self.config.drop_mv_per_s * gone_s,
        };
        let raw = whole(((volts_mv + 300.0) / 15.0).clamp(0.0, 1023.0));
        memory.feed_i16(BATTERY_RAW, raw);
        if kind == BatteryRegisters::LowFirst {
            let (mv, percent) = told(raw);
            memory.write(registers::BATTERY_MV, &mv.to_le_bytes());
            let percent = percent.clamp(0, 100).to_le_bytes()[0];
            memory.set(registers::BATTERY_PERCENT, percent);
        }
    }

    /// Converts the reading as the fielded main loop does, whenever the divider has counted.
    pub(super) fn convert(&mut self, memory: &mut Memory) {
        let raw = memory.battery_reading();
        if raw <= 0 {
            return;
        }
        let (mv, percent) = told(raw);
        let is_least = mv < self.least_mv;
        self.least_mv = self.least_mv.min(mv);
        memory.feed_battery(mv, is_least.then_some(percent.to_le_bytes()[0]));
        memory.refill_battery();
    }
}

/// Raw reading of the battery's converter.
const BATTERY_RAW: u8 = 19;

/// Voltage in mV and percent of a reading, 16 bits that wrap.
fn told(raw: i16) -> (u16, i16) {
    let mv = raw.wrapping_mul(15).wrapping_sub(300).cast_unsigned();
    (mv, whole(0.037 * f64::from(mv) - 363.0))
}

fn whole(value: f64) -> i16 {
    #[expect(clippy::cast_possible_truncation, reason = "truncates and saturates")]
    let whole = value as i16;
    whole
}

#[cfg(test)]
mod tests {
    use super::super::memory::MAP_2015;
    use super::*;

    fn sampled(start_mv: f64, kind: BatteryRegisters) -> Memory {
        let mut memory = Memory::new(MAP_2015);
        let mut battery = Battery::new(BatteryConfig {
            start_mv,
            drop_mv_per_s: 0.0,
        });
        battery.sample(Instant::ZERO, kind, &mut memory);
        if kind == BatteryRegisters::HighByteOnly {
            battery.convert(&mut memory);
        }
        memory
    }

    /// 12000 mV is 2EE0 hex and 0.037 * 12000 - 363 = 81 percent.
    #[test]
    fn the_documented_registers_hold_the_voltage_low_byte_first() {
        let memory = sampled(12_000.0, BatteryRegisters::LowFirst);
        assert_eq!(memory.read(33, 3), [0xE0, 0x2E, 81]);
        assert_eq!(memory.read(19, 2), 820_u16.to_le_bytes());
    }

    #[test]
    fn the_fielded_registers_hold_the_high_byte_only() {
        let memory = sampled(12_000.0, BatteryRegisters::HighByteOnly);
        assert_eq!(memory.read(33, 3), [0x2E, 0x00, 81]);
    }

    /// At 13305 mV the percentage is 0.037 * 13305 - 363 = 129.3, which is -127 in eight bits with
    /// sign.
    #[test]
    fn fielded_percent_wrap_above_127() {
        let memory = sampled(13_305.0, BatteryRegisters::HighByteOnly);
        assert_eq!(memory.get(35).cast_signed(), -127);
        let memory = sampled(13_305.0, BatteryRegisters::LowFirst);
        assert_eq!(memory.get(35), 100);
    }

    /// 11000 mV become a reading of 10995 mV: 43 percent. The new battery has 95.
    #[test]
    fn fielded_percent_never_rise() {
        let mut memory = Memory::new(MAP_2015);
        let mut battery = Battery::new(BatteryConfig {
            start_mv: 12_000.0,
            drop_mv_per_s: 100.0,
        });
        let kind = BatteryRegisters::HighByteOnly;
        battery.sample(Instant::from_secs(10), kind, &mut memory);
        battery.convert(&mut memory);
        let low = memory.get(35);
        battery.replace(Instant::from_secs(11), BatteryConfig::default());
        battery.sample(Instant::from_secs(11), kind, &mut memory);
        battery.convert(&mut memory);
        assert_eq!((low, memory.get(35)), (43, 43));
    }
}
