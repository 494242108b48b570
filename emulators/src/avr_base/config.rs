//! Configuration of a base.

use core::time::Duration;

use super::battery::BatteryConfig;
use super::heat::Heat;
use super::imu::Imu;
use super::profile::{Profile, Quirks};

/// Configuration of a base.
#[derive(Clone, Debug, PartialEq)]
pub struct AvrBaseConfig {
    /// Its firmware.
    pub profile: Profile,
    /// Quirks in place of the profile's, to mix firmwares.
    pub quirks: Option<Quirks>,
    /// Time before the run at which all tasks ran together, up to 200.8 ms; `None`: drawn.
    pub phase: Option<Duration>,
    /// Its battery.
    pub battery: BatteryConfig,
    /// Unsolicited messages: the status register whenever the stop button changes it. Only firmware
    /// that reports a status sends them.
    pub announce: Announce,
    /// The text that the fielded builds print for each request when a button is held at the start,
    /// see [`AvrBase::DEBUG`](super::AvrBase::DEBUG); it makes every reply some 7 ms late.
    pub debug_text: DebugText,
    /// Chance that a read of an encoder returns a torn count: the count carried into a higher byte
    /// while the registers were filled. Applies if it carried since the last sample. See
    /// [`NATURAL_TEAR`].
    pub encoder_tear: f64,
    /// Thermometers and rescue kits. Only firmware that refuses registers beyond its map has them.
    pub heat: Heat,
    /// A gyroscope. Only firmware that refuses registers beyond its map has one.
    pub imu: Imu,
}

impl AvrBaseConfig {
    /// Peculiarities of the firmware.
    pub fn quirks(&self) -> Quirks {
        self.quirks.unwrap_or_else(|| self.profile.quirks())
    }
}

/// Whether the base sends unsolicited messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Announce {
    /// Answers only.
    #[default]
    Nothing,
    /// A message when the stop button changes the status.
    StopButton,
}

/// Whether the debug build's text is on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DebugText {
    /// No button was held at the start.
    #[default]
    Off,
    /// A button was held.
    On,
}

/// Chance of a torn encoder count, derived from the firmware: a copy of 1 us in a main loop of 38
/// us. Only the copy before the reply counts, and the last sample was up to 25 ms ago. An estimate;
/// no torn count has been observed.
pub const NATURAL_TEAR: f64 = 4e-5;

impl Default for AvrBaseConfig {
    fn default() -> Self {
        Self {
            profile: Profile::Document,
            quirks: None,
            phase: None,
            battery: BatteryConfig::default(),
            announce: Announce::Nothing,
            debug_text: DebugText::Off,
            encoder_tear: NATURAL_TEAR,
            heat: Heat::None,
            imu: Imu::None,
        }
    }
}

/// Cause of the processor's start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartCause {
    /// Power, or the reset button.
    PowerOn,
    /// Its own watchdog, after the main loop had stood still for a second.
    Watchdog,
}
