//! Clocks that begin again, at midnight or at the full hour.

use super::{Clock, DAY, HOUR, SECOND};

/// Puts in order the times of a clock that begins again at midnight or at the full hour.
pub(in crate::import) struct Turns {
    /// Time after which the clock begins again.
    period: Option<u64>,
    before: u64,
    last: u64,
    /// Line of the first turn, and the number of turns.
    lines: Option<(usize, usize)>,
}

impl Turns {
    /// The turns of a clock with these times.
    pub(in crate::import) fn of(clock: Clock, times: impl Iterator<Item = u64>) -> Self {
        let mut times = times;
        let period = match clock {
            Clock::Day => Some(DAY),
            // Minutes above 59 are counted from the start.
            Clock::Hour => (!times.any(|at| at >= HOUR)).then_some(HOUR),
            _ => None,
        };
        Self {
            period,
            before: 0,
            last: 0,
            lines: None,
        }
    }

    /// Nanoseconds from the beginning of the first period, of a time in a line.
    pub(in crate::import) fn nanos(&mut self, at: u64, line: usize) -> u64 {
        let Some(period) = self.period else {
            return at;
        };
        if at + self.before + period / 2 < self.last {
            self.before += period;
            let (first, count) = self.lines.unwrap_or((line, 0));
            self.lines = Some((first, count + 1));
        }
        let here = at + self.before;
        // A line that is late by less than a second may belong before the turn.
        let earlier = here.saturating_sub(period);
        let is_late = self.before > 0 && earlier <= self.last && earlier + SECOND > self.last;
        self.last = if is_late { earlier } else { here };
        self.last
    }

    /// The note about the turns.
    pub(in crate::import) fn note(&self) -> Option<String> {
        let (first, count) = self.lines?;
        let clock = match self.period? {
            DAY => "time of day begins again, as at midnight",
            _ => "minutes begin again, as at the full hour",
        };
        let more = match count {
            1 => String::new(),
            _ => format!(" (in the whole file {count} times)"),
        };
        Some(format!("line {first}: the {clock}{more}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Times in milliseconds, in and out.
    fn told(clock: Clock, times: &[u64]) -> (Vec<u64>, Option<String>) {
        let nanos = |ms: &u64| ms * 1_000_000;
        let mut turns = Turns::of(clock, times.iter().map(nanos));
        let found = (1..)
            .zip(times)
            .map(|(line, ms)| turns.nanos(nanos(ms), line) / 1_000_000);
        (found.collect(), turns.note())
    }

    const DAY_MS: u64 = 86_400_000;

    /// A clock that goes back by more than half a day has begun again.
    #[test]
    fn a_clock_begins_again_at_midnight() {
        let (found, note) = told(Clock::Day, &[DAY_MS - 1_000, 200, 300]);
        assert_eq!(found, [DAY_MS - 1_000, DAY_MS + 200, DAY_MS + 300]);
        let words = "line 2: the time of day begins again, as at midnight";
        assert_eq!(note.as_deref(), Some(words));
        let (found, note) = told(Clock::Day, &[DAY_MS - 1, 5, DAY_MS - 2_000, 5]);
        assert_eq!(found[3], 2 * DAY_MS + 5);
        assert!(note.expect("two").ends_with(" (in the whole file 2 times)"));
        let half = DAY_MS / 2;
        assert_eq!(told(Clock::Day, &[half + 9, 9]).0, [half + 9, 9]);
        assert_eq!(told(Clock::Day, &[half + 10, 9]).0, [half + 10, DAY_MS + 9]);
    }

    /// A line that is late by less than a second is that of the day before.
    #[test]
    fn a_late_line_stays_before_midnight() {
        let times = [DAY_MS - 1_000, 200, DAY_MS - 500, 300];
        let expected = [DAY_MS - 1_000, DAY_MS + 200, DAY_MS - 500, DAY_MS + 300];
        assert_eq!(told(Clock::Day, &times).0, expected);
        // Another line may have the same time.
        let times = [DAY_MS - 1_000, 200, DAY_MS - 500, DAY_MS - 500, 300];
        let found = told(Clock::Day, &times).0;
        assert_eq!(found[2..], [DAY_MS - 500, DAY_MS - 500, DAY_MS + 300]);
        let later = told(Clock::Day, &[DAY_MS - 1_000, 600, DAY_MS - 400]).0;
        assert_eq!(later[2], 2 * DAY_MS - 400, "a second later");
        let just = told(Clock::Day, &[DAY_MS - 1_000, 600, DAY_MS - 399]).0;
        assert_eq!(just[2], DAY_MS - 399);
        assert_eq!(told(Clock::Day, &[500, 400]).0, [500, 400]);
    }

    /// Minutes below 60 begin again at the hour; above, they count from the start.
    #[test]
    fn minutes_begin_again_at_the_hour() {
        let (found, note) = told(Clock::Hour, &[3_599_000, 1_000]);
        assert_eq!(found, [3_599_000, 3_601_000]);
        assert!(
            note.expect("a turn")
                .ends_with("the minutes begin again, as at the full hour")
        );
        assert_eq!(
            told(Clock::Hour, &[3_600_000, 1_000]),
            (vec![3_600_000, 1_000], None)
        );
        assert_eq!(
            told(Clock::Seconds, &[90_000_000, 1]),
            (vec![90_000_000, 1], None)
        );
    }
}
