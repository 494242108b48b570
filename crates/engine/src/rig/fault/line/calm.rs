//! Times in which no fault of a line is active: its bytes pass as on a line without faults.

use protocols::{Instant, LineConfig};

use super::{LineFaults, Window};

impl LineFaults {
    /// Whether the `len` bytes from number `first` on, sent back to back from `start` on, certainly
    /// pass unchanged. If so, they are counted, and [`pass`](Self::pass) must not be called.
    #[inline]
    pub(crate) fn spare(&mut self, first: u64, len: u64, start: Instant, line: LineConfig) -> bool {
        self.is_clean() || self.spare_in_calm(first, len, start, line)
    }

    /// As [`spare`](Self::spare), for a line with a fault.
    fn spare_in_calm(&mut self, first: u64, len: u64, start: Instant, line: LineConfig) -> bool {
        let is_spared = self.is_calm(start) && self.is_harmless(first, len);
        if is_spared {
            self.notice(first, len, start, line);
            self.count(len, start, line);
        }
        is_spared
    }

    /// Whether certainly no fault is active at `at`.
    pub(crate) fn is_calm(&self, at: Instant) -> bool {
        let calm = self.order.calm.filter(|_| self.order.is_known);
        calm.is_some_and(|calm| calm.contains(at))
    }

    /// The time from `now` on in which no entry becomes active; none is active at `now`.
    pub(super) fn calm_from(&self, now: Instant) -> Option<Window> {
        if !self.order.waiting.is_empty() {
            return None;
        }
        let coming = self.order.later.iter().chain(&self.order.others);
        let begins = coming.filter_map(|&index| self.entries[index].activity.next_begin(now));
        let until = begins.fold(Window::ALWAYS.until, Instant::min);
        Some(Window { from: now, until })
    }
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use emulators::rng::Rng;

    use crate::rig::fault::{Activity, Budget, DamageKind, Effect, FaultId, Passed, Spells};

    use super::*;

    /// A cut of a second in each 3 s from 10 s to 20 s, and flips from 30 s to 40 s. The first byte
    /// after each of them shows that the line is calm, and the bytes behind it are spared. Bytes
    /// and random numbers are the same as on a line that spares none.
    #[test]
    fn a_line_spares_its_bytes_while_no_fault_is_active() {
        let window = |from, until| Window {
            from: Instant::from_secs(from),
            until: Instant::from_secs(until),
        };
        let spells = Spells {
            every: Duration::from_secs(3),
            lasting: Duration::from_secs(1),
            count: None,
            dice: None,
        };
        let cuts = Activity {
            spells: Some(spells),
            ..Activity::from(window(10, 20))
        };
        let mut faults = LineFaults::default();
        faults.add(FaultId(0), cuts, Effect::Cut);
        let rng = Rng::stream(1, "test.calm");
        faults.add_rate(FaultId(1), DamageKind::Flip, window(30, 40), 0.5, rng);
        let mut sparing_none = faults.clone();
        let line = LineConfig::new_8n1(9600);
        let mut budget = Budget::default();
        let mut spared = Vec::new();
        for second in 0..45 {
            let start = Instant::from_secs(second);
            let mut pass = |faults: &mut LineFaults| {
                let mut passed = Passed::default();
                faults.pass(second, &[7], start, line, &mut budget, &mut passed);
                passed.bytes
            };
            let all = pass(&mut sparing_none);
            if faults.spare(second, 1, start, line) {
                spared.push(second);
                assert_eq!(all, [7]);
            } else {
                assert_eq!(all, pass(&mut faults));
            }
        }
        let calm = (1..10).chain([12, 15, 18]).chain(21..30).chain(41..45);
        assert_eq!(spared, calm.collect::<Vec<_>>());
        assert_eq!(faults.counted, sparing_none.counted);
    }

    /// Damage is planned for byte 4. The bytes before and behind it are spared, in pieces that do
    /// not contain it.
    #[test]
    fn bytes_beside_planned_damage_are_spared() {
        use crate::rig::fault::{Damage, Strike};
        let line = LineConfig::new_8n1(1_000_000);
        let at = Instant::from_micros;
        let budget = &mut Budget::default();
        let faults = || {
            let mut faults = LineFaults::default();
            let damage = Damage::Drop;
            faults.add_strike(Strike { byte: 4, damage });
            faults
        };
        // The first byte shows that no fault is active.
        let calm = |faults: &mut LineFaults, budget: &mut Budget| {
            let mut passed = Passed::default();
            faults.pass(0, &[7], at(0), line, budget, &mut passed);
        };
        for (len, is_spared) in [(1, true), (3, true), (4, false), (9, false)] {
            let mut faults = faults();
            assert!(!faults.spare(0, 1, at(0), line));
            calm(&mut faults, budget);
            assert_eq!(faults.spare(1, len, at(10), line), is_spared, "{len}");
            assert_eq!(faults.counted, if is_spared { 1 + len } else { 1 });
        }
        let mut struck = faults();
        calm(&mut struck, budget);
        let mut passed = Passed::default();
        struck.pass(1, &[1, 2, 3, 4, 5], at(10), line, budget, &mut passed);
        assert_eq!(passed.bytes, [1, 2, 3, 5]);
        assert!(struck.is_clean() && struck.spare(6, 100, at(60), line));
    }

    /// While a fault waits for its byte, no byte is spared.
    #[test]
    fn no_byte_is_spared_while_a_fault_waits() {
        use crate::rig::fault::Trigger;
        let line = LineConfig::new_8n1(1_000_000);
        let mut activity = Activity::from(Window {
            from: Instant::ZERO,
            until: Instant::from_micros(15),
        });
        activity.trigger = Some(Trigger::Byte(3));
        let mut faults = LineFaults::default();
        faults.add(FaultId(0), activity, Effect::Cut);
        let spared = (0..8).filter(|&number| {
            let start = Instant::from_micros(10 * number);
            let is_spared = faults.spare(number, 1, start, line);
            if !is_spared {
                let (mut budget, mut passed) = (Budget::default(), Passed::default());
                faults.pass(number, &[7], start, line, &mut budget, &mut passed);
                let is_cut = (3..5).contains(&number);
                assert_eq!(passed.bytes.is_empty(), is_cut, "{number}");
            }
            is_spared
        });
        // Byte 5 shows that the fault is over.
        assert_eq!(spared.collect::<Vec<_>>(), [6, 7]);
    }
}
