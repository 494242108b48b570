use core::fmt;
use core::ops::{Add, AddAssign, Sub};
use core::time::Duration;

/// A point in time: nanoseconds since the run began.
///
/// Nanoseconds because a byte at 460800 baud takes 21,701 ns; whole microseconds would run that
/// line 3 % fast. There is no "now": time is an argument.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instant(u64);

impl Instant {
    /// The beginning of the run.
    pub const ZERO: Self = Self(0);

    /// The instant `nanos` nanoseconds after the run began.
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// The instant `micros` microseconds after the run began.
    pub const fn from_micros(micros: u64) -> Self {
        Self(micros * 1_000)
    }

    /// The instant `millis` milliseconds after the run began.
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis * 1_000_000)
    }

    /// The instant `secs` seconds after the run began.
    pub const fn from_secs(secs: u64) -> Self {
        Self(secs * 1_000_000_000)
    }

    /// Nanoseconds since the run began.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Whole microseconds since the run began.
    pub const fn as_micros(self) -> u64 {
        self.0 / 1_000
    }

    /// Whole milliseconds since the run began.
    pub const fn as_millis(self) -> u64 {
        self.0 / 1_000_000
    }

    /// Seconds since the run began, for reports and physics.
    pub fn as_secs_f64(self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "exact up to 104 days")]
        let nanos = self.0 as f64;
        nanos / 1e9
    }
}

impl Add<Duration> for Instant {
    type Output = Self;

    /// Saturates at the end of time, 584 years after the run began.
    #[inline]
    fn add(self, rhs: Duration) -> Self {
        // Numbers of 64 bits: a run adds spans a million times a second.
        let nanos = rhs.as_secs().saturating_mul(1_000_000_000);
        let nanos = nanos.saturating_add(u64::from(rhs.subsec_nanos()));
        Self(self.0.saturating_add(nanos))
    }
}

impl AddAssign<Duration> for Instant {
    fn add_assign(&mut self, rhs: Duration) {
        *self = *self + rhs;
    }
}

impl Sub for Instant {
    type Output = Duration;

    /// Zero if `rhs` is later.
    #[inline]
    fn sub(self, rhs: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(rhs.0))
    }
}

impl fmt::Display for Instant {
    /// Seconds with six decimals, as in every log and report.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}.{:06}",
            self.0 / 1_000_000_000,
            self.0 / 1_000 % 1_000_000
        )
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    /// The maximum is 584 years; the minimum is zero.
    #[test]
    fn time_saturates_at_both_ends() {
        let end = Instant::from_nanos(u64::MAX);
        assert_eq!(end + Duration::from_nanos(1), end);
        assert_eq!(Instant::ZERO + Duration::MAX, end);
        assert_eq!(Instant::ZERO - Instant::from_secs(1), Duration::ZERO);
        assert_eq!(
            Instant::from_secs(3) - Instant::from_millis(1),
            Duration::from_millis(2_999)
        );
    }

    /// Finding T1: 2 s, 345 ms, 678 us and 901 ns, in each unit, the rest cut off.
    #[test]
    fn conversions_agree_with_arithmetic_by_hand() {
        let instant = Instant::from_nanos(2_345_678_901);
        assert_eq!(instant.as_nanos(), 2_345_678_901);
        assert_eq!(instant.as_micros(), 2_345_678);
        assert_eq!(instant.as_millis(), 2_345);
        assert!((instant.as_secs_f64() - 2.345_678_901).abs() < 1e-12);
        assert_eq!(Instant::from_secs(7).as_nanos(), 7_000_000_000);
        assert_eq!(Instant::from_millis(7).as_nanos(), 7_000_000);
        assert_eq!(Instant::from_micros(7).as_nanos(), 7_000);
        let mut later = instant;
        later += Duration::from_nanos(99);
        assert_eq!(later.as_nanos(), 2_345_679_000);
        assert_eq!(later - instant, Duration::from_nanos(99));
    }

    #[test]
    fn an_instant_reads_as_seconds_with_six_decimals() {
        let instant = Instant::from_micros(12_000_034) + Duration::from_nanos(999);
        assert_eq!(std::format!("{instant}"), "12.000034");
    }
}
