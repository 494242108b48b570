//! The processor's timer: a tick of 1.004 ms, and the divider and tasks that count it.
//!
//! ```text
//! timer 1, 16 MHz / 64, 251 counts -> tick 1.004 ms -+- x 25 = 25.1 ms   divider of all time-outs
//!                                                    +- x 40 = 40.16 ms  speed regulator
//!                                                    +- x 50 = 50.2 ms   analog task, 1 ms long
//! ```
//!
//! Measured on field firmware b77a6df in a simulated ATmega2560: 4980 ticks in 5000 ms, and the
//! times of the interrupts.

use core::time::Duration;

use protocols::Instant;

/// One tick of the scheduler.
pub(super) const TICK: Duration = Duration::from_nanos(TICK_NANOS);
const TICK_NANOS: u64 = 1_004_000;
/// One count of the divider behind all time-outs.
pub(super) const DIVIDER: Duration = Duration::from_nanos(25 * TICK_NANOS);
/// Period of the speed regulator.
pub(super) const REGULATOR: Duration = Duration::from_nanos(40 * TICK_NANOS);
/// Period of the analog task.
pub(super) const ANALOG: Duration = Duration::from_nanos(50 * TICK_NANOS);
/// Period after which divider and tasks coincide again: 200 ticks.
pub(super) const CYCLE: Duration = Duration::from_nanos(200 * TICK_NANOS);

/// The tick interrupt with the tasks of every tick.
const TICK_WORK: Duration = Duration::from_nanos(97_875);
/// The tick interrupt once its tasks are gone. A guess.
const BARE_TICK: Duration = Duration::from_micros(10);
/// Additional time of the tick interrupt when the divider counts.
const DIVIDER_WORK: Duration = Duration::from_nanos(3_000);
/// Additional time of the regulator, with both wheels standing and with both driven.
const REGULATOR_WORK: [Duration; 2] = [Duration::from_micros(34), Duration::from_micros(140)];
/// The tick interrupt with each of the analog task's three blocks.
const ANALOG_WORK: [Duration; 3] = [
    Duration::from_nanos(967_700),
    Duration::from_nanos(967_700),
    Duration::from_nanos(539_000),
];

/// Phase of the tasks: they run at the multiples of their periods in a time that is `ahead` of the
/// rig's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ticks {
    ahead: u64,
}

impl Ticks {
    /// Ticks of tasks that all ran together `phase` before the start of the run.
    pub(super) fn with_phase(phase: Duration) -> Self {
        Self {
            ahead: nanos(phase) % nanos(CYCLE),
        }
    }

    /// Ticks of a counter that starts at `now`.
    pub(super) fn started_at(now: Instant) -> Self {
        let cycle = nanos(CYCLE);
        Self {
            ahead: (cycle - now.as_nanos() % cycle) % cycle,
        }
    }

    /// The moment at which a task of `period` runs the `count`th time after `now`; a run right at
    /// `now` is over.
    pub(super) fn after(self, now: Instant, period: Duration, count: u16) -> Instant {
        let period = nanos(period);
        let runs = (now.as_nanos() + self.ahead) / period + u64::from(count);
        Instant::from_nanos((runs * period).saturating_sub(self.ahead))
    }

    /// Runs of a task of `period` in (`from`, `to`].
    pub(super) fn runs(self, from: Instant, to: Instant, period: Duration) -> u64 {
        let period = nanos(period);
        let until = |at: Instant| (at.as_nanos() + self.ahead) / period;
        until(to).saturating_sub(until(from))
    }

    /// Ticks of the scheduler in (`from`, `to`].
    pub(super) fn ticks(self, from: Instant, to: Instant) -> u64 {
        self.runs(from, to, TICK)
    }

    /// The tasks of the tick that begins at `at`.
    pub(super) fn due(self, at: Instant) -> Due {
        let at = at.as_nanos() + self.ahead;
        let tick = at / nanos(TICK) * nanos(TICK);
        let due = |period: Duration| tick.is_multiple_of(nanos(period));
        Due {
            divider: due(DIVIDER),
            regulator: due(REGULATOR),
            analog: due(ANALOG),
        }
    }
}

/// Tasks of a tick, besides those of every tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Due {
    pub(super) divider: bool,
    pub(super) regulator: bool,
    pub(super) analog: bool,
}

impl Due {
    /// Duration of the tick interrupt, with the analog task at `block`.
    pub(super) fn work(self, block: usize, driven: bool) -> Duration {
        let mut work = if self.analog {
            ANALOG_WORK[block % ANALOG_WORK.len()]
        } else {
            TICK_WORK
        };
        if self.divider {
            work += DIVIDER_WORK;
        }
        if self.regulator {
            work += REGULATOR_WORK[usize::from(driven)];
        }
        work
    }

    /// Duration of a tick whose tasks were overwritten.
    pub(super) const fn bare_work() -> Duration {
        BARE_TICK
    }
}

const fn nanos(duration: Duration) -> u64 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "at most a few hours, 2^64 ns are 584 years"
    )]
    let nanos = duration.as_nanos() as u64;
    nanos
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT_ZERO: Ticks = Ticks { ahead: 0 };

    #[test]
    fn divider_and_tasks_run_at_multiples_of_the_tick() {
        let now = Instant::from_millis(26);
        let at = |period, count| AT_ZERO.after(now, period, count).as_micros();
        assert_eq!(at(DIVIDER, 1), 50_200);
        assert_eq!(at(DIVIDER, 40), 1_029_100);
        assert_eq!(at(REGULATOR, 1), 40_160);
        assert_eq!(at(ANALOG, 1), 50_200);
    }

    #[test]
    fn a_run_right_now_is_over() {
        let now = Instant::from_micros(25_100);
        assert_eq!(AT_ZERO.after(now, DIVIDER, 1).as_micros(), 50_200);
        assert_eq!(AT_ZERO.runs(Instant::ZERO, now, DIVIDER), 1);
    }

    #[test]
    fn the_phase_moves_all_runs() {
        let ticks = Ticks::with_phase(Duration::from_millis(5));
        let first = ticks.after(Instant::ZERO, DIVIDER, 1);
        assert_eq!(first.as_micros(), 20_100);
    }

    #[test]
    fn a_restart_begins_a_new_count() {
        let now = Instant::from_millis(777);
        let ticks = Ticks::started_at(now);
        assert_eq!(ticks.after(now, DIVIDER, 1), now + DIVIDER);
    }

    /// At 50.2 ms the analog task runs, at 25.1 ms only the divider counts, and at 200.8 ms all
    /// tasks run.
    #[test]
    fn the_work_of_a_tick_is_that_of_its_tasks() {
        let work = |nanos| {
            let due = AT_ZERO.due(Instant::from_nanos(nanos));
            due.work(0, true).as_nanos()
        };
        assert_eq!(work(1_004_000), 97_875);
        assert_eq!(work(25_100_000), 97_875 + 3_000);
        assert_eq!(work(40_160_000), 97_875 + 140_000);
        assert_eq!(work(50_200_000), 967_700 + 3_000);
        assert_eq!(work(200_800_000), 967_700 + 3_000 + 140_000);
    }

    /// A counter that starts with the run, or a whole cycle later, has no phase.
    #[test]
    fn a_counter_that_starts_with_a_cycle_has_no_phase() {
        for cycles in 0..3 {
            let start = Instant::ZERO + CYCLE * cycles;
            assert_eq!(Ticks::started_at(start), AT_ZERO);
        }
        assert_eq!(Ticks::with_phase(CYCLE), AT_ZERO);
        let later = Instant::ZERO + CYCLE + TICK;
        assert_eq!(Ticks::started_at(later), Ticks::with_phase(CYCLE - TICK));
    }

    /// Ticks whose tasks are gone take 10 us; the analog task takes as long as its block's sensors.
    #[test]
    fn each_block_has_its_own_work() {
        assert_eq!(Due::bare_work(), Duration::from_micros(10));
        let analog = Due {
            divider: false,
            regulator: false,
            analog: true,
        };
        let work = [0, 1, 2, 3, 5].map(|block| analog.work(block, false).as_nanos());
        assert_eq!(work, [967_700, 967_700, 539_000, 967_700, 539_000]);
    }
}
