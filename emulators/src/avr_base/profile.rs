//! Firmware of the base: names, and the differences as data.
//!
//! No other module uses the name of a profile; they read [`Quirks`]. A build of the fielded
//! firmware is a set of quirks, the base of the seed report is another.

use core::fmt;
use core::time::Duration;

use protocols::avr::ChecksumOrder;

use super::memory::{MAP_2014, MAP_2015};

/// A firmware of the base.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Profile {
    /// The base as the seed report of 2015 describes it, sound where the report is silent.
    #[default]
    Document,
    /// Field firmware b77a6df of May 2015 with all its defects.
    Rcj2015,
    /// Field firmware 5f54f4d of September 2014: the same, and two more defects.
    Rcj2014,
}

impl Profile {
    /// All profiles.
    pub const ALL: [Self; 3] = [Self::Document, Self::Rcj2015, Self::Rcj2014];

    /// The profile that scenarios call `name`.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|profile| profile.name() == name)
    }

    /// Name in scenarios.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Document => "document",
            Self::Rcj2015 => "rcj2015-2015",
            Self::Rcj2014 => "rcj2015-2014",
        }
    }

    /// Longest time from the end of a write of the speeds until the watchdog has made them zero;
    /// `None` if it never does.
    pub const fn silence_max(self) -> Option<Duration> {
        match self.quirks().watchdog {
            Watchdog::AnyFrame { timeout } => Some(timeout),
            Watchdog::Divider {
                clears: Registers::Kept,
                ..
            } => None,
            // Observed for 40 counts of 25.1 ms: 1006.2 ms at most.
            Watchdog::Divider { counts, .. } => {
                Some(Duration::from_micros(25_100 * counts as u64 + 2_200))
            }
        }
    }

    /// Peculiarities of the firmware.
    pub const fn quirks(self) -> Quirks {
        match self {
            Self::Document => DOCUMENT,
            Self::Rcj2015 => RCJ_2015,
            Self::Rcj2014 => RCJ_2014,
        }
    }
}

impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Everything in which one firmware differs from another. The ids in brackets are those of the
/// field-bug catalogue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quirks {
    /// Byte order of the checksum (AV-01).
    pub checksum: ChecksumOrder,
    /// Method to find frames in the byte stream (AV-04, AV-06 to AV-10).
    pub receiver: ReceiverKind,
    /// Behaviour outside the register map (AV-03, AV-11, AV-20).
    pub bounds: Bounds,
    /// Address of the register map in the processor's memory.
    pub map: u16,
    /// Condition under which the motors stop by themselves (AV-02, H-AV-1).
    pub watchdog: Watchdog,
    /// Conversion of a set-point register to a set-point (AV-13, H-AV-2).
    pub set_points: SetPoints,
    /// Content of the two registers of the battery voltage, and conversion to percent (AV-05,
    /// AV-18).
    pub battery: BatteryRegisters,
    /// Whether a count can change while it is copied to its registers (AV-12).
    pub encoder: EncoderCopy,
    /// Sampling of the two encoder signals (AV-15).
    pub odometer: Odometer,
    /// Gains of the speed regulator (AV-14).
    pub gains: Gains,
    /// Reading of an object nearer than the infrared curves allow for (AV-19).
    pub near_objects: NearObjects,
    /// Effect of the stop button.
    pub button: Button,
    /// Content of the status register.
    pub status: Status,
    /// Speed of the processor (AV-07, AV-17).
    pub processor: Processor,
    /// Cost of a restart by the processor's own watchdog (AV-16).
    pub restart: Restart,
}

/// Method to find frames in the byte stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReceiverKind {
    /// A state machine in the receive interrupt. It is deaf while the main loop works on a request,
    /// and never examines misread bytes again. Its counter is signed, 8 bits. The next count of a
    /// free-running divider ends an unfinished frame.
    Interrupt,
    /// A buffer that is searched again after a rejected candidate, and a queue of requests.
    Buffered {
        /// Silence that ends an unfinished frame, never less.
        idle_gap: Duration,
        /// Requests that wait at most; further ones are refused with an error frame.
        queue: usize,
    },
}

/// Behaviour outside the register map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    /// Any address is read and written: behind the registers lies the firmware's memory.
    Memory,
    /// Unknown and read-only registers are refused with an error frame, without side effect.
    Refused,
}

/// Condition under which the motors stop by themselves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Watchdog {
    /// Armed by writes that begin at a drive register, counted by the 25.1 ms divider.
    Divider {
        /// Counts of the divider.
        counts: u16,
        /// Whether expiry also clears the registers from which the set-points are copied. If not,
        /// the next pass of the main loop restores the set-points.
        clears: Registers,
    },
    /// Restarted by every valid frame; stops the motors at once.
    AnyFrame {
        /// Silence allowed.
        timeout: Duration,
    },
}

/// Effect of the expired watchdog on registers 46 and 47.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Registers {
    /// Sets them to zero.
    Cleared,
    /// Leaves the registers unchanged.
    Kept,
}

/// Conversion of a set-point register to a set-point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetPoints {
    /// Signed, limited in the regulator; the register keeps the written value.
    Signed,
    /// Signed, and the register shows the limited value.
    SignedAndReported,
    /// Taken for unsigned: every negative value means full ahead.
    Unsigned,
}

/// Content of the battery registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BatteryRegisters {
    /// The high byte lies where the low byte belongs, the high byte's place is never written.
    /// Percent start at 0, wrap at 127 and only ever fall.
    HighByteOnly,
    /// Low byte first. Percent are between 0 and 100 and known from the start.
    LowFirst,
}

/// Whether a count can change while it is copied to its registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncoderCopy {
    /// Byte by byte while the timer interrupt counts on.
    Torn,
    /// In one piece.
    Snapshot,
}

/// Sampling of the two encoder signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Odometer {
    /// Once per tick of the timer: two edges in a tick count as none, three as one back.
    PolledPerTick,
    /// Every edge.
    EveryEdge,
}

/// Gains of the speed regulator: power = error * max(|to| / 3, `p_min`) + sum * (|to| / 10 +
/// `i_plus`), all in whole numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gains {
    /// Minimum proportional factor.
    pub p_min: i16,
    /// Added to the integral factor.
    pub i_plus: i16,
}

/// Reading of an object nearer than the infrared curves allow for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NearObjects {
    /// The curve's value: negative, or farther again.
    FollowCurve,
    /// The true distance down to zero, up to a metre and with noise.
    Clamped,
}

/// Effect of the stop button.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// Stops while pressed and for 120 counts of the divider after.
    HoldAndDelay,
    /// Each press stops or releases.
    Toggle,
}

/// Content of the status register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Nothing: always 0.
    Zero,
    /// Bit 0: error, bit 1: motors off. A guess from the headers of both field programs, which
    /// agree if the master's count bits from one.
    Reported,
}

/// Speed of the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Processor {
    /// 16 MHz with all tasks in interrupts, as measured.
    Measured,
    /// Answers after a fixed time, and sends without gaps.
    Steady {
        /// From the end of a request to the first byte of the reply.
        latency: Duration,
    },
}

/// Cost of a restart by the processor's own watchdog.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Restart {
    /// Five seconds without main loop, but with interrupts: one request is kept and answered late.
    FiveSecondsStale,
    /// Like any other start: deaf until it is up.
    Normal,
}

/// Greatest set-point that the regulator obeys, ticks per 40.16 ms.
pub const SET_POINT_MAX: i16 = 35;

const DOCUMENT: Quirks = Quirks {
    checksum: ChecksumOrder::LowFirst,
    receiver: ReceiverKind::Buffered {
        // The report gives no figure. Long against a byte (10 us), short against a master's timeout
        // (4 to 8 ms in the field), so that the base always receives a repeated request.
        idle_gap: Duration::from_millis(2),
        queue: 4,
    },
    bounds: Bounds::Refused,
    map: MAP_2015,
    watchdog: Watchdog::AnyFrame {
        // The report: "no messages for a short time". The figure is the field firmware's.
        timeout: Duration::from_secs(1),
    },
    set_points: SetPoints::SignedAndReported,
    battery: BatteryRegisters::LowFirst,
    encoder: EncoderCopy::Snapshot,
    odometer: Odometer::EveryEdge,
    gains: Gains {
        p_min: 1,
        i_plus: 1,
    },
    near_objects: NearObjects::Clamped,
    button: Button::HoldAndDelay,
    status: Status::Reported,
    processor: Processor::Steady {
        latency: Duration::from_micros(50),
    },
    restart: Restart::Normal,
};

const RCJ_2015: Quirks = Quirks {
    checksum: ChecksumOrder::HighFirst,
    receiver: ReceiverKind::Interrupt,
    bounds: Bounds::Memory,
    map: MAP_2015,
    watchdog: Watchdog::Divider {
        counts: 40,
        clears: Registers::Cleared,
    },
    set_points: SetPoints::Signed,
    battery: BatteryRegisters::HighByteOnly,
    encoder: EncoderCopy::Torn,
    odometer: Odometer::PolledPerTick,
    gains: Gains {
        p_min: 0,
        i_plus: 1,
    },
    near_objects: NearObjects::FollowCurve,
    button: Button::HoldAndDelay,
    status: Status::Zero,
    processor: Processor::Measured,
    restart: Restart::FiveSecondsStale,
};

const RCJ_2014: Quirks = Quirks {
    watchdog: Watchdog::Divider {
        // "2000 ms" in the source; taken as 80 counts, twice what the later build has for 1000.
        counts: 80,
        clears: Registers::Kept,
    },
    set_points: SetPoints::Unsigned,
    map: MAP_2014,
    gains: Gains {
        p_min: 0,
        i_plus: 0,
    },
    button: Button::Toggle,
    ..RCJ_2015
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_profile_is_found_by_its_name() {
        assert_eq!(Profile::from_name("document"), Some(Profile::Document));
        assert_eq!(Profile::from_name("rcj2015-2015"), Some(Profile::Rcj2015));
        assert_eq!(Profile::from_name("rcj2015-2014"), Some(Profile::Rcj2014));
        assert_eq!(Profile::from_name("rcj2015"), None);
    }

    #[test]
    fn a_profile_is_shown_by_its_name() {
        let profiles = [Profile::Document, Profile::Rcj2015, Profile::Rcj2014];
        let shown = profiles.map(|profile| profile.to_string());
        assert_eq!(shown, ["document", "rcj2015-2015", "rcj2015-2014"]);
    }
}
