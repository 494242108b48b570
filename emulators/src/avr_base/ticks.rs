//! The processor's time: a tick of 1.004 ms, the divider and tasks that count it, and how long the
//! main loop takes to answer when they are in its way.
//!
//! ```text
//! timer 1, 16 MHz / 64, 251 counts -> tick 1.004 ms -+- x 25 = 25.1 ms   divider of all time-outs
//!                                                    +- x 40 = 40.16 ms  speed regulator
//!                                                    +- x 50 = 50.2 ms   analog task, 1 ms long
//! ```
//!
//! Measured on field firmware b77a6df in a simulated ATmega2560: 4980 ticks in 5000 ms; replies
//! begin 23 / 38 / 144 us (least, median, most of 60) after a read and 35 / 49 / 1182 us after a
//! write, the last one with a task in front.

use core::time::Duration;

use protocols::Instant;

use super::request::RequestKind;
use crate::rng::Rng;

/// One tick of the scheduler, ns.
const TICK: u64 = 1_004_000;
/// One count of the divider behind all time-outs.
pub(super) const DIVIDER: Duration = Duration::from_nanos(25 * TICK);
/// Period of the speed regulator.
pub(super) const REGULATOR: Duration = Duration::from_nanos(40 * TICK);
/// Period of the analog task.
pub(super) const ANALOG: Duration = Duration::from_nanos(50 * TICK);
/// After this time divider and tasks meet as before: 200 ticks.
pub(super) const CYCLE: Duration = Duration::from_nanos(200 * TICK);

/// What the tasks keep the main loop from working. The sum of all is chosen so that the longest
/// reply of the measurement (1.4 ms for ten registers) comes out; the split is a guess.
const DIVIDER_LOAD: u64 = 30_000;
const REGULATOR_LOAD: u64 = 60_000;
const ANALOG_LOAD: u64 = 1_000_000;

/// Distribution of the time from the end of a read to its reply without a task in the way: the
/// main loop's place when the request came in. Points of (share, ns), straight lines between:
/// the measured least, median and most, and the shares that a second request sent 50 and 100 us
/// later showed (12 and 17 of 20 answered).
const REPLY: [(f64, f64); 5] = [
    (0.0, 23_000.0),
    (0.5, 38_000.0),
    (0.62, 60_000.0),
    (0.87, 110_000.0),
    (1.0, 144_000.0),
];
/// What a write takes longer than a read.
const WRITE_EXTRA: Duration = Duration::from_micros(12);

/// Where the tasks stand: they run at the multiples of their periods in a time that is `ahead` of
/// the rig's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ticks {
    ahead: u64,
}

impl Ticks {
    /// All tasks ran together `phase` before the start of the run.
    pub(super) fn with_phase(phase: Duration) -> Self {
        Self {
            ahead: nanos(phase) % nanos(CYCLE),
        }
    }

    /// The counter starts at `now`.
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
        self.runs(from, to, Duration::from_nanos(TICK))
    }

    /// When the main loop has done `work` that it begins at `start`, given that the tasks come
    /// first whenever they are due.
    pub(super) fn finish(self, start: Instant, work: Duration) -> Instant {
        // From here on in the processor's own time, which is `ahead` of the rig's.
        let mut at = start.as_nanos() + self.ahead;
        let mut left = nanos(work);
        let mut boundary = at / (5 * TICK) * (5 * TICK);
        at = at.max(boundary + load(boundary));
        // Every slice between two boundaries is longer than any load, so that work of a few
        // milliseconds ends within a few rounds.
        loop {
            let next = boundary + 5 * TICK;
            if at + left <= next {
                return Instant::from_nanos(at + left - self.ahead);
            }
            left -= next - at;
            boundary = next;
            at = next + load(next);
        }
    }
}

/// What the tasks due at `boundary` take, a multiple of 5 ticks in the processor's own time: every
/// task's period is one.
fn load(boundary: u64) -> u64 {
    let due = |period: Duration, load: u64| {
        if boundary.is_multiple_of(nanos(period)) {
            load
        } else {
            0
        }
    };
    due(DIVIDER, DIVIDER_LOAD) + due(REGULATOR, REGULATOR_LOAD) + due(ANALOG, ANALOG_LOAD)
}

/// What the main loop does between the end of a request and its reply. One draw.
pub(super) fn reply_work(rng: &mut Rng, kind: RequestKind) -> Duration {
    let read = Duration::from_nanos(quantile(rng.uniform()));
    match kind {
        RequestKind::Read => read,
        RequestKind::Write => read + WRITE_EXTRA,
    }
}

fn quantile(share: f64) -> u64 {
    let next = REPLY.partition_point(|&(at, _)| at <= share);
    let (from, to) = (REPLY[next - 1], REPLY[next.min(REPLY.len() - 1)]);
    let part = (share - from.0) / (to.0 - from.0).max(f64::MIN_POSITIVE);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "between the first and the last point"
    )]
    let nanos = (from.1 + (to.1 - from.1) * part) as u64;
    nanos
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

    /// 1.03 ms of divider and analog task come first at 50.2 ms, and 30 us at 25.1 ms.
    #[test]
    fn tasks_come_before_the_main_loop() {
        let work = Duration::from_micros(40);
        let finish = |micros| AT_ZERO.finish(Instant::from_micros(micros), work);
        assert_eq!(finish(10_000).as_micros(), 10_040);
        assert_eq!(finish(50_190).as_micros(), 50_200 + 1_030 + 30);
        assert_eq!(finish(50_200).as_micros(), 50_200 + 1_030 + 40);
        assert_eq!(finish(51_240).as_micros(), 51_280);
        assert_eq!(finish(25_110).as_micros(), 25_130 + 40);
        assert_eq!(finish(200_800).as_micros(), 200_800 + 1_090 + 40);
    }

    #[test]
    fn replies_to_reads_take_23_to_144_us_and_38_in_the_middle() {
        assert_eq!(quantile(0.0), 23_000);
        assert_eq!(quantile(0.5), 38_000);
        assert_eq!(quantile(0.999_999_999), 143_999);
    }
}
