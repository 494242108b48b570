//! Rescue kits: each is dropped exactly once, even if messages are lost.
//!
//! The base counts the kits that have left its magazine, over restarts as well, and drops kits
//! until its count equals the ordered target. A repeated order therefore drops no extra kit, and
//! the program repeats an order that the base has lost.

/// Kits that are still to be dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kits {
    waiting: u8,
    /// Target of the base's count; `None` until the base has reported its count.
    target: Option<u8>,
}

impl Kits {
    pub(super) const NONE: Self = Self {
        waiting: 0,
        target: None,
    };

    /// Adds a kit.
    pub(super) fn add(&mut self) {
        self.waiting = self.waiting.saturating_add(1);
        self.target = self.target.map(|target| target.saturating_add(1));
    }

    /// Whether kits are waiting, so the base's count is needed.
    pub(super) const fn is_waiting(&self) -> bool {
        self.waiting > 0
    }

    /// Takes the base's count `dropped`; returns the target to send, if kits are missing.
    pub(super) fn counted(&mut self, dropped: u8) -> Option<u8> {
        let all = dropped.saturating_add(self.waiting);
        let target = *self.target.get_or_insert(all);
        if dropped >= target {
            *self = Self::NONE;
            return None;
        }
        Some(target)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The robot finds a victim when two kits were dropped: it sends three to the base until the
    /// base reports three, also if the base forgets the order.
    #[test]
    fn the_base_is_told_until_its_count_is_right() {
        let mut kits = Kits::NONE;
        kits.add();
        assert!(kits.is_waiting());
        assert_eq!([2, 2, 2].map(|told| kits.counted(told)), [Some(3); 3]);
        assert_eq!(kits.counted(3), None);
        assert!(!kits.is_waiting());
        assert_eq!((kits.counted(3), kits), (None, Kits::NONE));
    }

    /// Another victim is found before the first kit was dropped.
    #[test]
    fn one_more_on_the_way_is_one_more() {
        let mut kits = Kits::NONE;
        kits.add();
        assert_eq!(kits.counted(0), Some(1));
        kits.add();
        assert_eq!((kits.counted(0), kits.counted(1)), (Some(2), Some(2)));
        assert!(kits.is_waiting());
        assert_eq!((kits.counted(2), kits), (None, Kits::NONE));
    }

    /// After 255 kits the magazine is empty.
    #[test]
    fn more_than_there_are_is_not_waited_for() {
        let mut kits = Kits::NONE;
        kits.add();
        assert_eq!((kits.counted(255), kits), (None, Kits::NONE));
    }
}
