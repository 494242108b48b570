//! Lateness of events: a histogram of fixed size.

use core::fmt;
use core::time::Duration;

/// Width of the fine classes, up to [`FINE_US`].
const FINE_STEP_US: u64 = 10;
const FINE_US: u64 = 2_000;
const FINE: usize = (FINE_US / FINE_STEP_US) as usize;
/// Width of the coarse classes, up to [`COARSE_US`]; the last class contains all later events.
const COARSE_STEP_US: u64 = 1_000;
const COARSE_US: u64 = 500_000;
const CLASSES: usize = FINE + ((COARSE_US - FINE_US) / COARSE_STEP_US) as usize + 1;

/// A rig that is later than this stops its clock, and its lateness may explain a failure.
pub const LATE: Duration = Duration::from_millis(20);
/// Maximum lateness of a single event.
const LATE_ONCE: Duration = Duration::from_millis(250);
/// Maximum time for which rig time may stand in total, because timeouts of clients continue
/// meanwhile.
const STOOD_MAX: Duration = Duration::from_millis(500);

/// Lateness of many events.
#[derive(Clone, Debug)]
pub struct Lateness {
    classes: Vec<u64>,
    count: u64,
    max: Duration,
    stood: Duration,
}

impl Default for Lateness {
    fn default() -> Self {
        Self {
            classes: vec![0; CLASSES],
            count: 0,
            max: Duration::ZERO,
            stood: Duration::ZERO,
        }
    }
}

impl Lateness {
    /// Records an event that was `late` late.
    pub fn record(&mut self, late: Duration) {
        self.classes[class_of(late)] += 1;
        self.count += 1;
        self.max = self.max.max(late);
    }

    /// Adds `time` during which rig time stood while the wall clock continued.
    pub fn stand(&mut self, time: Duration) {
        self.stood += time;
    }

    /// Total time during which rig time stood.
    pub const fn stood(&self) -> Duration {
        self.stood
    }

    /// Number of recorded events.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// Whether clients may have suffered: more than 20 ms in 1 % of the events, more than 250 ms
    /// once, or rig time that stood for more than 500 ms in total.
    pub fn is_too_much(&self) -> bool {
        self.quantile(990) > LATE || self.max > LATE_ONCE || self.stood > STOOD_MAX
    }

    /// Maximum lateness.
    pub const fn max(&self) -> Duration {
        self.max
    }

    /// Lateness that `per_mille` of a thousand events did not exceed; rounded up to 10 us, above 2
    /// ms to 1 ms, and never more than the maximum. Zero if no event was recorded.
    pub fn quantile(&self, per_mille: u64) -> Duration {
        let wanted = (self.count * per_mille).div_ceil(1000);
        let mut seen = 0;
        for (class, &count) in self.classes.iter().enumerate() {
            seen += count;
            if seen >= wanted && seen > 0 {
                return end_of(class).min(self.max);
            }
        }
        self.max
    }
}

impl fmt::Display for Lateness {
    /// `late by 0.09 ms (p50), 0.12 ms (p99), 3.40 ms (max) over 12345 events`; then `, rig time
    /// stood for 1.234 s in all` if it stood.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |late: Duration| late.as_secs_f64() * 1e3;
        write!(
            f,
            "late by {:.2} ms (p50), {:.2} ms (p99), {:.2} ms (max) over {} events",
            ms(self.quantile(500)),
            ms(self.quantile(990)),
            ms(self.max),
            self.count
        )?;
        if self.stood.is_zero() {
            return Ok(());
        }
        let stood = self.stood.as_secs_f64();
        write!(f, ", rig time stood for {stood:.3} s in all")
    }
}

fn class_of(late: Duration) -> usize {
    let us = u64::try_from(late.as_micros()).unwrap_or(u64::MAX);
    let class = if us < FINE_US {
        us / FINE_STEP_US
    } else {
        FINE as u64 + (us - FINE_US) / COARSE_STEP_US
    };
    usize::try_from(class).map_or(CLASSES - 1, |class| class.min(CLASSES - 1))
}

/// Upper end of a class; the last class has none.
fn end_of(class: usize) -> Duration {
    let class = class as u64;
    let fine = FINE as u64;
    match class {
        _ if class + 1 == CLASSES as u64 => Duration::MAX,
        _ if class < fine => Duration::from_micros((class + 1) * FINE_STEP_US),
        _ => Duration::from_micros(FINE_US + (class + 1 - fine) * COARSE_STEP_US),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lateness(us: impl IntoIterator<Item = u64>) -> Lateness {
        let mut lateness = Lateness::default();
        us.into_iter()
            .for_each(|us| lateness.record(Duration::from_micros(us)));
        lateness
    }

    /// 99 events at 84 us and one at 2817 us: figures of a sleep to a deadline at 460800 baud.
    #[test]
    fn one_late_event_in_a_hundred_shows_in_the_maximum_only() {
        let lateness = lateness(core::iter::repeat_n(84, 99).chain([2817]));
        assert_eq!(
            lateness.to_string(),
            "late by 0.09 ms (p50), 0.09 ms (p99), 2.82 ms (max) over 100 events"
        );
        assert_eq!(lateness.quantile(1000), Duration::from_micros(2817));
    }

    /// A client with a timeout of 2 s gives up after 0.9 s of rig time if rig time stood for 1.1 s.
    /// The number of late events does not matter.
    #[test]
    fn rig_time_that_stood_is_told_and_is_too_much_above_half_a_second() {
        let mut lateness = lateness(core::iter::repeat_n(84, 1000));
        lateness.stand(Duration::from_millis(500));
        assert!(!lateness.is_too_much());
        lateness.stand(Duration::from_millis(600));
        assert!(lateness.is_too_much());
        let told = lateness.to_string();
        assert!(
            told.ends_with("over 1000 events, rig time stood for 1.100 s in all"),
            "{told}"
        );
    }

    #[test]
    fn a_quantile_is_never_later_than_the_latest() {
        assert_eq!(lateness([3]).quantile(500), Duration::from_micros(3));
        assert_eq!(lateness([]).quantile(990), Duration::ZERO);
        assert_eq!(
            lateness([700_000, 900_000]).quantile(500),
            Duration::from_micros(900_000)
        );
    }

    #[test]
    fn classes_meet_without_gap_where_their_width_changes() {
        assert_eq!(class_of(Duration::from_micros(1_999)), FINE - 1);
        assert_eq!(class_of(Duration::from_micros(2_000)), FINE);
        assert_eq!(end_of(FINE - 1), Duration::from_micros(2_000));
        assert_eq!(end_of(FINE), Duration::from_micros(3_000));
    }
}
