//! Detection of a driven wheel whose encoder counts nothing.
//!
//! The encoder has failed, or the wheel is blocked. The regulator of the base then drives the wheel
//! at full power, whatever speed was ordered, so the robot must stop at once.

use core::time::Duration;

use protocols::Instant;

/// Longest time without a count at a set-point: five readings. A wheel starts within 100 ms.
const COUNTLESS_MAX: Duration = Duration::from_millis(200);
/// Time for which the robot rests before it tries again.
const RESTS: Duration = Duration::from_secs(2);
/// Minimum set-point that counts in each reading, ticks per 40 ms.
const DRIVEN: u8 = 3;

/// The wheels that are driven and do not count.
#[derive(Clone, Debug)]
pub(super) struct Stall {
    counters: Option<[i32; 2]>,
    /// Encoders that have worked: before its first count an encoder proves nothing.
    has_counted: [bool; 2],
    /// Time since which a driven wheel does not count.
    countless_since: [Option<Instant>; 2],
    rests_until: Option<Instant>,
    pub(super) stalls: u32,
}

impl Stall {
    pub(super) const NEW: Self = Self {
        counters: None,
        has_counted: [false; 2],
        countless_since: [None; 2],
        rests_until: None,
        stalls: 0,
    };

    /// Takes a reading of both counters; `driven` are the set-points that the base has
    /// acknowledged.
    pub(super) fn take(&mut self, at: Instant, counters: [i32; 2], driven: [i8; 2]) {
        let before = self.counters.replace(counters).unwrap_or(counters);
        for side in 0..2 {
            let counts = counters[side] != before[side];
            self.has_counted[side] |= counts;
            let is_driven = driven[side].unsigned_abs() >= DRIVEN && self.has_counted[side];
            if counts || !is_driven {
                self.countless_since[side] = None;
                continue;
            }
            let since = *self.countless_since[side].get_or_insert(at);
            if at - since >= COUNTLESS_MAX && self.rests_until.is_none() {
                self.rests_until = Some(at + RESTS);
                self.stalls = self.stalls.saturating_add(1);
            }
        }
    }

    /// Ends the rest that is over at `now`.
    pub(super) fn tick(&mut self, now: Instant) {
        if self.rests_until.is_some_and(|until| now >= until) {
            self.rests_until = None;
            self.countless_since = [None; 2];
        }
    }

    /// Whether the robot must rest.
    pub(super) const fn is_stalled(&self) -> bool {
        self.rests_until.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings each 40 ms; the right wheel counts nothing from the fourth one on. The robot rests
    /// 200 ms later, for two seconds.
    #[test]
    fn a_driven_wheel_that_does_not_count_is_noticed() {
        let noticed = |driven: [i8; 2], first: i32| {
            let mut stall = Stall::NEW;
            let times = (0..14_u64).map(|n| (Instant::from_millis(40 * n), n));
            let found = times.map(|(at, n)| {
                let count = i32::try_from(n).expect("small");
                stall.take(at, [10 * count, first * count.min(3)], driven);
                stall.tick(at);
                stall.is_stalled()
            });
            let after = found.take_while(|is_stalled| !is_stalled).count();
            let ends = Instant::from_millis(40 * after as u64 + 2_000);
            stall.tick(ends);
            (after, stall.is_stalled(), stall.stalls)
        };
        // The first reading without a count is that at 160 ms.
        assert_eq!(noticed([10, 10], 10), (9, false, 1));
        assert_eq!(noticed([10, -10], -10), (9, false, 1));
        assert_eq!(noticed([10, 2], 10), (14, false, 0));
        // An encoder that has never counted proves nothing.
        assert_eq!(noticed([10, 10], 0), (14, false, 0));
    }
}
