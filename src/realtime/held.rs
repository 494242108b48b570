//! A clock that stands until somebody's program is ready.

use core::cell::Cell;
use core::time::Duration;

use protocols::Instant;

use super::clock::{Clock, WallClock};

/// A wall clock that stands at a moment until it is let go: the rig waits there, its devices at
/// work, until somebody's program has opened its ports.
#[derive(Debug)]
pub struct Held {
    wall: WallClock,
    stands_at: Instant,
    let_go_at: Cell<Option<Instant>>,
}

impl Held {
    /// Stands at `moment`.
    pub fn at(moment: Instant) -> Self {
        Self {
            wall: WallClock::start(),
            stands_at: moment,
            let_go_at: Cell::new(None),
        }
    }

    /// Time since it was made, standing or not.
    pub fn waited(&self) -> Duration {
        self.wall.now() - Instant::ZERO
    }

    /// From now on it goes.
    pub fn let_go(&self) {
        self.let_go_at.set(Some(self.wall.now()));
    }
}

impl Clock for Held {
    fn now(&self) -> Instant {
        let since = self.let_go_at.get();
        self.stands_at + since.map_or(Duration::ZERO, |since| self.wall.now() - since)
    }

    fn sleep_until(&self, deadline: Instant) {
        self.wall
            .sleep_until(self.wall.now() + (deadline - self.now()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_stands_until_it_is_let_go_and_waits_all_the_same() {
        let (held, moment) = (Held::at(Instant::from_secs(5)), Instant::from_secs(5));
        held.sleep_until(moment + Duration::from_millis(2));
        assert!(held.waited() >= Duration::from_millis(2));
        assert_eq!(held.now(), moment);
        held.let_go();
        held.sleep_until(moment + Duration::from_millis(2));
        assert!(held.now() >= moment + Duration::from_millis(2));
    }
}
