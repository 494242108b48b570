//! Effect of an active fault on a line.

use core::time::Duration;

use emulators::rng::Rng;
use protocols::{Instant, LineConfig};

use super::{DamageKind, HostDamage};

/// Effect of a fault on a line.
#[derive(Clone, Debug)]
pub enum Effect {
    /// Damages bytes at random.
    Strikes {
        /// Damage to bytes.
        kind: DamageKind,
        /// Probability per byte, 0 to 1.
        chance: f64,
        /// Number of remaining strikes, after which the fault ends; `None`: no limit.
        left: Option<u32>,
        /// The dice.
        rng: Box<Rng>,
    },
    /// Treats bytes as text.
    Host(HostDamage),
    /// The sender receives its own bytes.
    Echo,
    /// All bytes are lost.
    Cut,
    /// Bytes are withheld until the end of the fault, then delivered at once.
    Stall,
    /// Like a stall, with a receive buffer of this many bytes; further bytes are lost.
    Overrun {
        /// Room for bytes.
        fifo: usize,
    },
    /// Bytes are handed over in pieces of at most this length.
    ShortRead {
        /// Length of a piece.
        len: usize,
    },
    /// Bytes take longer.
    Latency {
        /// Added delay.
        by: Duration,
    },
    /// Bytes are delayed by random times, but never overtake each other.
    Jitter {
        /// Maximum added delay.
        by: Duration,
        /// The dice.
        rng: Box<Rng>,
    },
    /// The sender runs at another rate.
    WrongBaud(Rate),
}

impl Effect {
    /// Its name in a capture.
    pub const fn words(&self) -> &'static str {
        match self {
            Self::Strikes { .. } => "strikes",
            Self::Host(HostDamage::StripNul) => "strip NUL",
            Self::Host(HostDamage::CrToLf) => "CR to LF",
            Self::Host(HostDamage::EatXonXoff) => "eat XON and XOFF",
            Self::Host(HostDamage::ClearBit7) => "clear bit 7",
            Self::Echo => "echo",
            Self::Cut => "line cut",
            Self::Stall => "stall",
            Self::Overrun { .. } => "overrun",
            Self::ShortRead { .. } => "short read",
            Self::Latency { .. } => "latency",
            Self::Jitter { .. } => "jitter",
            Self::WrongBaud(_) => "wrong baud rate",
        }
    }
}

/// A rate that differs from the configured one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// Rate of the sender during the fault; `None`: its own.
    pub baud: Option<u32>,
    /// Deviation of the rate at the start, millionths; positive is too fast.
    pub ppm: f64,
    /// Change of the deviation per second, millionths.
    pub ppm_per_s: f64,
}

/// Step of a drifting rate.
const DRIFT_STEP: Duration = Duration::from_millis(10);

impl Rate {
    /// Line coding of a sender with `line`, at the time `since` after the start of the fault.
    pub fn of(self, line: LineConfig, since: Duration) -> LineConfig {
        let steps = since.as_nanos() / DRIFT_STEP.as_nanos();
        let seconds = steps as f64 * DRIFT_STEP.as_secs_f64();
        let ppm = self.ppm + self.ppm_per_s * seconds;
        let baud = f64::from(self.baud.unwrap_or(line.baud)) * (1.0 + ppm * 1e-6);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "clamped to the rates that a line can have"
        )]
        let baud = libm::round(baud).clamp(f64::from(BAUD_MIN), f64::from(BAUD_MAX)) as u32;
        LineConfig { baud, ..line }
    }
}

/// Slowest rate of a line.
pub const BAUD_MIN: u32 = 50;
/// Fastest rate of a line.
pub const BAUD_MAX: u32 = 50_000_000;

/// Withheld bytes, and the time of their delivery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Gate {
    /// Time at which all bytes are delivered.
    pub(crate) opens: Instant,
    /// Maximum number of withheld bytes; `None`: no limit.
    pub(crate) fifo: Option<usize>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 115200 x 1.03 = 118656; after 2 s at -10,000 ppm/s 115200 x 1.01 = 116352.
    #[test]
    fn a_rate_is_off_by_millionths_and_drifts() {
        let line = LineConfig::new_8n1(115_200);
        let rate = Rate {
            baud: None,
            ppm: 30_000.0,
            ppm_per_s: -10_000.0,
        };
        assert_eq!(rate.of(line, Duration::ZERO).baud, 118_656);
        assert_eq!(rate.of(line, Duration::from_secs(2)).baud, 116_352);
        assert_eq!(rate.of(line, Duration::from_secs(1000)).baud, BAUD_MIN);
        let fixed = Rate {
            baud: Some(57_600),
            ppm: 0.0,
            ppm_per_s: 0.0,
        };
        assert_eq!(fixed.of(line, Duration::from_secs(9)).baud, 57_600);
    }

    /// A drift of 1,000,000 ppm in a second changes the rate each 10 ms, by 1 %: at 19.999 ms there
    /// was one step. A rate has its limits at 50 and 50,000,000 baud.
    #[test]
    fn a_rate_drifts_in_steps_of_10_ms_within_its_limits() {
        let line = LineConfig::new_8n1(100_000);
        let rate = |ppm, ppm_per_s, baud| Rate {
            baud,
            ppm,
            ppm_per_s,
        };
        let drift = |us| {
            let drifting = rate(0.0, 1_000_000.0, None);
            drifting.of(line, Duration::from_micros(us)).baud
        };
        let bauds = [0, 9_999, 10_000, 19_999, 20_000, 1_000_000].map(drift);
        assert_eq!(
            bauds,
            [100_000, 100_000, 101_000, 101_000, 102_000, 200_000]
        );
        let fast = rate(0.0, 0.0, Some(60_000_000));
        assert_eq!(fast.of(line, Duration::ZERO).baud, 50_000_000);
        let slow = rate(-999_999.0, 0.0, None);
        assert_eq!(slow.of(line, Duration::ZERO).baud, 50);
        let even = LineConfig {
            parity: protocols::Parity::Even,
            ..line
        };
        let changed = rate(0.0, 0.0, Some(300)).of(even, Duration::ZERO);
        assert_eq!((changed.baud, changed.parity), (300, even.parity));
    }

    #[test]
    fn each_effect_has_its_name() {
        let rng = || Box::new(Rng::stream(1, "test"));
        let by = Duration::ZERO;
        let rate = Rate {
            baud: None,
            ppm: 0.0,
            ppm_per_s: 0.0,
        };
        let effects = [
            (Effect::Echo, "echo"),
            (Effect::Cut, "line cut"),
            (Effect::Stall, "stall"),
            (Effect::Overrun { fifo: 1 }, "overrun"),
            (Effect::ShortRead { len: 1 }, "short read"),
            (Effect::Latency { by }, "latency"),
            (Effect::Jitter { by, rng: rng() }, "jitter"),
            (Effect::WrongBaud(rate), "wrong baud rate"),
            (Effect::Host(HostDamage::StripNul), "strip NUL"),
            (Effect::Host(HostDamage::CrToLf), "CR to LF"),
            (Effect::Host(HostDamage::EatXonXoff), "eat XON and XOFF"),
            (Effect::Host(HostDamage::ClearBit7), "clear bit 7"),
        ];
        for (effect, name) in effects {
            assert_eq!(effect.words(), name);
        }
    }
}
