//! Speed regulator and odometer of one wheel.
//!
//! ```text
//! e = to - is;  if |sum + e| < 200 { sum += e }
//! power = e * (|to| / 3) + sum * (|to| / 10 + 1)     whole numbers, clamped to +-255
//! pulse = 0.84 * |power| + 40                         whole, 0 for power 0
//! ```
//!
//! Source: field firmware b77a6df; build 5f54f4d has no `+ 1`. The loop is closed every 40.16 ms.

use protocols::Instant;

use super::profile::{Gains, Odometer, SET_POINT_MAX};
use super::ticks::Ticks;
use crate::world::Drive;

/// The sum of errors stays below this.
const SUM_LIMIT: i16 = 200;
/// Greatest power.
const POWER_MAX: i16 = 255;

/// One side of the speed regulator. All numbers have the firmware's 16 bits and wrap. Only a master
/// that overwrites them notices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Regulator {
    pub(super) sum: i16,
    /// Power after the last step.
    pub(super) power: i16,
}

impl Regulator {
    /// Next drive of the motor, from set-point and measured speed in ticks per period.
    pub(super) fn step(&mut self, gains: Gains, set_point: i16, is: i16) -> Drive {
        let to = set_point.clamp(-SET_POINT_MAX, SET_POINT_MAX);
        if to == 0 {
            *self = Self::default();
            return Drive::Brake;
        }
        let error = to.wrapping_sub(is);
        let sum = self.sum.wrapping_add(error);
        if sum.wrapping_abs() < SUM_LIMIT {
            self.sum = sum;
        }
        let p = (to.abs() / 3).max(gains.p_min);
        let i = to.abs() / 10 + gains.i_plus;
        let power = error.wrapping_mul(p).wrapping_add(self.sum.wrapping_mul(i));
        self.power = power.clamp(-POWER_MAX, POWER_MAX);
        Drive::Power(pulse(self.power))
    }
}

/// Pulse width of a power, with its sign.
fn pulse(power: i16) -> i16 {
    // 0.84 = 21 / 25; division of positive whole numbers truncates as the firmware does.
    let width = power.abs() * 21 / 25 + 40;
    match power.signum() {
        0 => 0,
        1 => width,
        _ => -width,
    }
}

/// Encoder count of one wheel as the firmware counts it, from the true rotation of the wheel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counter {
    /// Edges of the real wheel at the last look.
    seen: i64,
    /// Time of the last look.
    at: Instant,
    /// Count of the firmware. Wraps at 32 bits as the firmware's does.
    count: i32,
    /// The count at the look before the last.
    before: i32,
    /// Edges in both directions.
    edges: i32,
}

impl Counter {
    /// A counter that stands at 0 with the wheel at `edges`.
    pub(super) const fn started(at: Instant, edges: i64) -> Self {
        Self {
            seen: edges,
            at,
            count: 0,
            before: 0,
            edges: 0,
        }
    }

    /// Counts the wheel's turn to `edges` by `now`.
    pub(super) fn look(&mut self, odometer: Odometer, ticks: Ticks, now: Instant, edges: i64) {
        let turned = edges - self.seen;
        let counted = match odometer {
            Odometer::EveryEdge => turned,
            Odometer::PolledPerTick => {
                let samples = ticks.ticks(self.at, now);
                if samples == 0 {
                    return;
                }
                polled(turned, samples)
            }
        };
        self.before = self.count;
        #[expect(clippy::cast_possible_truncation, reason = "32 bits that wrap")]
        let counted = counted as i32;
        self.count = self.count.wrapping_add(counted);
        self.edges = self.edges.wrapping_add(counted.wrapping_abs());
        (self.seen, self.at) = (edges, now);
    }

    /// Count of the firmware.
    pub(super) const fn count(&self) -> i32 {
        self.count
    }

    /// Edges in both directions.
    pub(super) const fn edges(&self) -> i32 {
        self.edges
    }

    /// Replaces the count: the master has overwritten it.
    pub(super) const fn overwrite(&mut self, count: i32, edges: i32) {
        (self.count, self.before, self.edges) = (count, count, edges);
    }

    /// Skips a turn of the wheel that the firmware does not see.
    pub(super) fn miss(&mut self, now: Instant, edges: i64) {
        (self.seen, self.at) = (edges, now);
    }

    /// Content of the registers if the count changes while they are filled: the old low byte and
    /// the new other bytes. `None` if the change did not carry into a higher byte.
    pub(super) fn torn(&self) -> Option<i32> {
        let low = self.before & 0xFF;
        let torn = (self.count & !0xFF) | low;
        (self.count ^ self.before > 0xFF || (self.count ^ self.before) < 0).then_some(torn)
    }
}

/// Edges counted if `turned` edges came evenly over `samples` looks at the two signals. Two edges
/// between two looks count as none, three as one back, and so on round the four states.
fn polled(turned: i64, samples: u64) -> i64 {
    if turned.unsigned_abs() <= samples {
        return turned;
    }
    let (turned, samples) = (i128::from(turned), i128::from(samples));
    let edge = |sample: i128| turned * sample / samples;
    // Longer silence than a few periods only happens to a rig that was stopped.
    (1..=samples.min(10_000))
        .map(
            |sample| match (edge(sample) - edge(sample - 1)).rem_euclid(4) {
                1 => 1,
                3 => -1,
                _ => 0,
            },
        )
        .sum()
}

/// Speed as the firmware has it: 16 bits, of which its register shows the low eight.
pub(super) fn speed(ticks: i32) -> i16 {
    #[expect(clippy::cast_possible_truncation, reason = "the variable wraps")]
    let speed = ticks as i16;
    speed
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use super::*;

    const GAINS: Gains = Gains {
        p_min: 0,
        i_plus: 1,
    };

    /// Seen in the simulated ATmega2560: with the wheels held, set-point 20 drives pulse widths
    /// BF, F1, FE in a row. By hand: 20*6 + 20*3 = 180, 120 + 120 = 240, 120 + 180 = 300.
    #[test]
    fn a_held_wheel_winds_the_regulator_up_to_full_drive() {
        let mut regulator = Regulator::default();
        let pulses: Vec<_> = (0..3).map(|_| regulator.step(GAINS, 20, 0)).collect();
        assert_eq!(pulses, [0xBF, 0xF1, 0xFE].map(Drive::Power));
    }

    /// The counter misses 100 edges and then sees 7: only these count.
    #[test]
    fn edges_that_turned_by_unseen_are_never_counted() {
        let ticks = Ticks::with_phase(Duration::ZERO);
        let mut counter = Counter::started(Instant::ZERO, 0);
        counter.miss(Instant::from_secs(1), 100);
        counter.look(Odometer::EveryEdge, ticks, Instant::from_secs(2), 107);
        assert_eq!(counter.count(), 7);
    }

    #[test]
    fn the_2014_build_has_a_weaker_integral() {
        let gains = Gains {
            p_min: 0,
            i_plus: 0,
        };
        // The regulator gives 20*6 + 20*2 = 160, and the pulse width is 0.84 * 160 + 40 = 174.4.
        let drive = Regulator::default().step(gains, 20, 0);
        assert_eq!(drive, Drive::Power(174));
    }

    #[test]
    fn speed_zero_brakes_and_forgets_the_sum() {
        let mut regulator = Regulator::default();
        regulator.step(GAINS, 20, 0);
        assert_eq!(regulator.step(GAINS, 0, 15), Drive::Brake);
        assert_eq!(regulator, Regulator::default());
    }

    /// Errors of 35 add up to 175 and no further, as 210 is too much. Then an error of -35 gives
    /// -35 * 11 + 140 * 4 = 175, and the pulse width is 0.84 * 175 + 40 = 187.
    #[test]
    fn the_sum_of_errors_is_bounded() {
        let mut regulator = Regulator::default();
        for _ in 0..100 {
            regulator.step(GAINS, 35, 0);
        }
        assert_eq!(regulator.step(GAINS, 35, 70), Drive::Power(187));
    }

    #[test]
    fn a_set_point_beyond_35_counts_as_35() {
        let [mut wild, mut limited] = [Regulator::default(); 2];
        assert_eq!(wild.step(GAINS, -100, 0), limited.step(GAINS, -35, 0));
    }

    #[test]
    fn power_zero_is_pulse_zero() {
        assert_eq!([0, 1, -1, 255, -255].map(pulse), [0, 40, -40, 254, -254]);
    }

    /// 996 looks a second: one edge a look is the limit, two are invisible, three go backwards.
    #[test]
    fn edges_faster_than_the_tick_are_lost_or_reversed() {
        assert_eq!(polled(40, 40), 40);
        assert_eq!(polled(60, 40), 20);
        assert_eq!(polled(80, 40), 0);
        assert_eq!(polled(-120, 40), 40);
    }

    fn at_counts(before: i32, count: i32) -> Counter {
        Counter {
            before,
            count,
            ..Counter::default()
        }
    }

    #[test]
    fn a_carry_during_the_copy_tears_the_count() {
        assert_eq!(at_counts(0x00FF, 0x0100).torn(), Some(0x01FF));
        assert_eq!(at_counts(0x00FE, 0x00FF).torn(), None);
        assert_eq!(at_counts(0, -1).torn(), Some(-256));
    }

    /// The torn count has the old low byte and the new other bytes. There is none if only the low
    /// byte changed.
    #[test]
    fn a_torn_count_has_the_low_byte_of_before() {
        let torn = |before: i32, count: i32| {
            let mut counter = Counter::started(Instant::ZERO, 0);
            (counter.before, counter.count) = (before, count);
            counter.torn()
        };
        assert_eq!(torn(0x00FF, 0x0100), Some(0x01FF));
        assert_eq!(torn(0x0100, 0x00FF), Some(0x0000));
        assert_eq!(
            [torn(0x10, 0x12), torn(0x100, 0x1FF), torn(-2, -1)],
            [None; 3]
        );
        assert_eq!(torn(-1, 0), Some(0xFF));
        assert_eq!(torn(0, -1), Some(-256));
    }

    /// 3 edges in 3 looks count as 3. 2 edges in one look count as none, 3 as one back, 5 as one.
    #[test]
    fn edges_between_two_looks_are_told_by_the_state_alone() {
        let seen = [3, 6, 9, 12, 15].map(|turned| polled(turned, 3));
        assert_eq!(seen, [3, 0, -3, 0, 3]);
        assert_eq!([polled(-3, 3), polled(-6, 3), polled(-9, 3)], [-3, 0, 3]);
        // Four edges in three looks come as 1, 1 and 2.
        assert_eq!([polled(4, 3), polled(2, 3)], [2, 2]);
    }
}
