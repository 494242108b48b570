//! Clocks that begin again, at midnight or at the full hour.

use super::{Clock, DAY, HOUR, SECOND};

/// Puts the times of a clock in order that begins again at midnight or at the full hour.
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
        let is_late = self.before > 0 && earlier < self.last && earlier + SECOND > self.last;
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
