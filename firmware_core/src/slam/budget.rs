//! Maximum number of candidates of a search, regulated so that a scan is done in time.

use core::time::Duration;

/// Settings of the regulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Tries of the first search.
    pub start: u16,
    /// A search shorter than this may try more candidates next time.
    pub target: Duration,
    /// Tries added after a search below the target.
    pub step_up: u16,
    /// Tries taken away after a search at or above the target.
    pub step_down: u16,
    /// Upper bound; without it, scans without points raise the budget endlessly (SL-04).
    pub max: u16,
}

impl Budget {
    /// The seed report's constants, with its "about 150 ms" as target and an upper bound.
    pub const DOCUMENT: Self = Self {
        start: 1300,
        target: Duration::from_millis(150),
        step_up: 20,
        step_down: 60,
        max: 2000,
    };
}

/// The regulator's state.
#[derive(Clone, Debug)]
pub(super) struct Regulator {
    tries: i32,
    is_bounded: bool,
}

impl Regulator {
    pub(super) const fn new(budget: &Budget, is_bounded: bool) -> Self {
        Self {
            tries: budget.start as i32,
            is_bounded,
        }
    }

    /// Takes the duration of the last scan, from reading the wheels to the end of the map update.
    pub(super) fn search_took(&mut self, elapsed: Duration, budget: &Budget) {
        let step = if elapsed < budget.target {
            i32::from(budget.step_up)
        } else {
            -i32::from(budget.step_down)
        };
        self.tries += step;
        if self.is_bounded {
            self.tries = self.tries.clamp(0, i32::from(budget.max));
        } else {
            // The fielded code stores 16 bits with sign.
            self.tries = (self.tries + 0x8000).rem_euclid(0x1_0000) - 0x8000;
        }
    }

    /// Tries of the next search. Unbounded, a negative budget is read as unsigned: -50 tries
    /// become 65486 (SL-03).
    pub(super) const fn tries(&self) -> u32 {
        (self.tries & 0xFFFF).cast_unsigned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn millis(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// The document's time per try with 36 points: 0.15 ms, plus 14 ms.
    fn model(tries: u32) -> Duration {
        Duration::from_micros(14_000 + u64::from(tries) * 150)
    }

    /// Seed figure S6: 150 +- 10 ms after settling, within 60 scans (F-09).
    #[test]
    fn scan_time_settles_at_150_ms() {
        let budget = Budget::DOCUMENT;
        let mut regulator = Regulator::new(&budget, true);
        for _ in 0..60 {
            regulator.search_took(model(regulator.tries()), &budget);
        }
        for _ in 0..200 {
            let took = model(regulator.tries());
            assert!(took >= millis(140) && took <= millis(160), "{took:?}");
            regulator.search_took(took, &budget);
        }
    }

    /// SL-03: seventeen overruns in a row, from 970 tries on.
    #[test]
    fn overruns_never_make_the_budget_huge() {
        let after_17 = |is_bounded| {
            let budget = Budget {
                start: 970,
                ..Budget::DOCUMENT
            };
            let mut regulator = Regulator::new(&budget, is_bounded);
            (0..17).for_each(|_| regulator.search_took(millis(400), &budget));
            regulator.tries()
        };
        assert_eq!(after_17(true), 0);
        assert_eq!(after_17(false), 65_486, "the fielded code's figure");
    }

    /// SL-04: 60 s without a valid beam, each scan done in a moment. By its own cost model, the
    /// fielded code's first real search then takes 1.06 s, and 1.96 s after 120 s.
    #[test]
    fn a_blackout_does_not_wind_the_budget_up() {
        let first_search_after = |scans: u32, is_bounded| {
            let budget = Budget {
                start: 950,
                ..Budget::DOCUMENT
            };
            let mut regulator = Regulator::new(&budget, is_bounded);
            (0..scans).for_each(|_| regulator.search_took(millis(14), &budget));
            model(regulator.tries())
        };
        assert!(first_search_after(300, true) < millis(320));
        assert!(first_search_after(300, false) > millis(1_050));
        assert!(first_search_after(600, false) > millis(1_950));
    }

    /// A search of exactly the target time took too long; 16 bits with sign end at 32767.
    #[test]
    fn tries_go_up_by_20_and_down_by_60() {
        let budget = Budget::DOCUMENT;
        let mut regulator = Regulator::new(&budget, true);
        let mut took = |ms| {
            regulator.search_took(millis(ms), &budget);
            regulator.tries()
        };
        assert_eq!([took(149), took(150), took(151)], [1_320, 1_260, 1_200]);
        let wide = Budget {
            start: 32_760,
            ..budget
        };
        let mut regulator = Regulator::new(&wide, false);
        let mut took = |ms| {
            regulator.search_took(millis(ms), &wide);
            regulator.tries
        };
        assert_eq!(
            [took(1), took(1), took(200), took(200)],
            [-32_756, -32_736, 32_740, 32_680]
        );
        let mut regulator = Regulator::new(&budget, true);
        (0..100).for_each(|_| regulator.search_took(millis(1), &budget));
        assert_eq!(regulator.tries(), 2_000);
    }
}
