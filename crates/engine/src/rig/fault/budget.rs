//! Limits of random faults.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::Instant;

/// Limits of random damage on all lines together. Damage with a selected byte is not counted,
/// because it was ordered.
#[derive(Clone, Debug, Default)]
pub struct Budget {
    /// Maximum number of strikes in the run.
    pub total: Option<u64>,
    /// Maximum number of strikes within [`AT_ONCE`].
    pub at_once: Option<u32>,
    spent: u64,
    recent: VecDeque<Instant>,
}

/// Length of the window for `at_once`.
pub const AT_ONCE: Duration = Duration::from_millis(100);

impl Budget {
    /// Limits without any strike so far.
    pub const fn new(total: Option<u64>, at_once: Option<u32>) -> Self {
        Self {
            total,
            at_once,
            spent: 0,
            recent: VecDeque::new(),
        }
    }

    /// Counts one more strike at `now`, if the budget allows it; `false` if not.
    pub fn spend(&mut self, now: Instant) -> bool {
        if self.total.is_some_and(|total| self.spent >= total) {
            return false;
        }
        if let Some(most) = self.at_once {
            while self.recent.front().is_some_and(|&at| now >= at + AT_ONCE) {
                self.recent.pop_front();
            }
            if self.recent.len() >= usize::try_from(most).unwrap_or(usize::MAX) {
                return false;
            }
            self.recent.push_back(now);
        }
        self.spent += 1;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_is_spent_than_there_is() {
        let mut budget = Budget::new(Some(3), Some(2));
        let spent: Vec<bool> = [0, 50, 99, 100, 200]
            .map(|ms| budget.spend(Instant::from_millis(ms)))
            .into();
        // The third comes too soon after two others, the fifth is beyond the total.
        assert_eq!(spent, [true, true, false, true, false]);
        let mut unbounded = Budget::default();
        assert!((0..1000).all(|_| unbounded.spend(Instant::ZERO)));
    }
}
