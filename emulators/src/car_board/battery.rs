//! The pack that the board and its motor run from.

use core::time::Duration;

/// A battery that loses the same voltage every second, and some more while the motor turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatteryConfig {
    /// Voltage at the start, mV.
    pub start_mv: f64,
    /// Lost per second, mV.
    pub drop_mv_per_s: f64,
    /// Voltage drop at full level, mV.
    pub sag_mv: f64,
}

impl Default for BatteryConfig {
    /// A pack of 3200 mAh that is empty after an hour (6.8 V, below which the electronics fail).
    /// Guesses: the report gives neither running time nor voltage drop under load.
    fn default() -> Self {
        Self {
            start_mv: 8_000.0,
            drop_mv_per_s: 0.33,
            sag_mv: 300.0,
        }
    }
}

impl BatteryConfig {
    /// Voltage after `gone` at this part of full level, 0 to 1.
    pub(super) fn millivolts(&self, gone: Duration, part: f64) -> u16 {
        let voltage = self.start_mv - self.drop_mv_per_s * gone.as_secs_f64() - self.sag_mv * part;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates, which is meant"
        )]
        let voltage = voltage.round() as u16;
        voltage
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After 600 s, 8000 mV less 0.33 mV/s are 7802 mV. At 0.2 m/s, level 2, they sag by 0.2 * 300
    /// mV. An empty battery reads 0 and not less.
    #[test]
    fn a_battery_runs_down_and_sags() {
        let battery = BatteryConfig::default();
        assert_eq!(battery.millivolts(Duration::ZERO, 0.0), 8_000);
        assert_eq!(battery.millivolts(Duration::from_secs(600), 0.0), 7_802);
        assert_eq!(battery.millivolts(Duration::from_secs(600), 0.2), 7_742);
        assert_eq!(battery.millivolts(Duration::from_secs(100_000), 0.0), 0);
    }
}
