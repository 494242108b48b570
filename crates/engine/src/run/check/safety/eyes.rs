//! The turns of a lidar that show a distance.

use protocols::Instant;

use super::paused::is_damaged;
use crate::Shared;
use crate::rig::Rig;
use crate::rig::line::{Delivery, Direction};
use crate::rig::trace::{Side, Tap};
use crate::robots::{Instruments, ScanDecoder};

/// An observer of the robot's lidar.
pub(super) struct Eyes {
    name: String,
    shared: Shared<Turns>,
}

struct Turns {
    decoder: Box<dyn ScanDecoder>,
    count: u64,
    /// Number of damaged deliveries. The rig does not know which turns end in them.
    damaged: u64,
}

impl Eyes {
    /// Observes the lidar of the robot in `rig`; `None` without one.
    pub(super) fn open(rig: &mut Rig, instruments: &dyn Instruments) -> Option<Self> {
        let (name, decoder) = instruments.scanner(rig)?;
        let link = rig.links().iter().position(|link| link.name == name)?;
        let shared = Shared::new(Turns {
            decoder,
            count: 0,
            damaged: 0,
        });
        rig.add_tap(Box::new(Listener {
            link,
            turns: shared.clone(),
        }));
        Some(Self { name, shared })
    }

    /// The same for a copy of the rig. An incomplete turn does not count.
    pub(super) fn fork(&self, rig: &mut Rig, instruments: &dyn Instruments) -> Option<Self> {
        let copy = Self::open(rig, instruments)?;
        {
            let (own, mut other) = (self.shared.lock(), copy.shared.lock());
            (other.count, other.damaged) = (own.count, own.damaged);
        }
        Some(copy)
    }

    /// The link of the lidar.
    pub(super) fn link(&self) -> &str {
        &self.name
    }

    /// Number of turns with at least one distance.
    pub(super) fn turns(&self) -> u64 {
        self.shared.lock().count
    }
}

impl Eyes {
    /// Number of deliveries that a fault damaged but did not remove completely: a program may still
    /// find distances in them.
    pub(super) fn damaged(&self) -> u64 {
        self.shared.lock().damaged
    }
}

struct Listener {
    /// Link of the turns, which are locked only for bytes of this link.
    link: usize,
    turns: Shared<Turns>,
}

impl Tap for Listener {
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        if direction == Direction::ToMaster && link == self.link {
            let mut turns = self.turns.lock();
            let turn = turns.decoder.push(&delivery.bytes);
            turns.damaged += u64::from(is_damaged(delivery) && !delivery.bytes.is_empty());
            turns.count += u64::from(turn.is_some_and(|beams| !beams.is_empty()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::bare::linked;
    use crate::rig::fault::{Damage, Strike};
    use crate::robots::{Beam, ScanDecoder};

    /// The first byte of a turn is its number of beams and one more; 0 completes no turn.
    struct Numbers;

    impl ScanDecoder for Numbers {
        fn push(&mut self, bytes: &[u8]) -> Option<Vec<Beam>> {
            let beam = Beam {
                bearing: 0.0,
                distance_m: 1.0,
            };
            let count = bytes.first()?.checked_sub(1)?;
            Some(vec![beam; usize::from(count)])
        }
    }

    struct Robot(&'static str);

    impl Instruments for Robot {
        fn scanner(&self, _: &Rig) -> Option<(String, Box<dyn ScanDecoder>)> {
            Some((self.0.to_owned(), Box::new(Numbers)))
        }
    }

    /// Only a turn with a beam, from the lidar, counts.
    #[test]
    fn turns_with_a_distance_are_counted() {
        let (mut rig, [lidar, base]) = linked(["lidar", "base"], 1_000_000);
        let eyes = Eyes::open(&mut rig, &Robot("lidar")).expect("it has a lidar");
        assert_eq!((eyes.link(), eyes.turns()), ("lidar", 0));
        for (node, byte, turns) in [
            (lidar[0].node, 0, 0),
            (lidar[0].node, 1, 0),
            (lidar[1].node, 5, 0),
            (base[0].node, 5, 0),
            (lidar[0].node, 2, 1),
            (lidar[0].node, 9, 2),
        ] {
            rig.inject(node, &[byte]);
            rig.run_for(core::time::Duration::from_millis(1));
            assert_eq!(eyes.turns(), turns, "{byte}");
        }
        assert_eq!(eyes.damaged(), 0);
        let mut copy = rig.fork().expect("plain");
        let copied = eyes.fork(&mut copy, &Robot("lidar")).expect("the same");
        copy.inject(lidar[0].node, &[3]);
        copy.run_for(core::time::Duration::from_millis(1));
        assert_eq!((eyes.turns(), copied.turns()), (2, 3));
        assert!(Eyes::open(&mut rig, &Robot("camera")).is_none());
    }

    /// The second byte is garbled, the third one is lost: nothing of it is left to see by.
    #[test]
    fn damaged_deliveries_are_counted_if_something_is_left() {
        let (mut rig, [lidar]) = linked(["lidar"], 1_000_000);
        let faults = &mut rig.line_mut(0, Direction::ToMaster).faults;
        for (byte, damage) in [(1, Damage::Flip { bit: 7 }), (2, Damage::Drop)] {
            faults.add_strike(Strike { byte, damage });
        }
        let eyes = Eyes::open(&mut rig, &Robot("lidar")).expect("it has a lidar");
        let damaged = [0, 0, 0, 0].map(|byte| {
            rig.inject(lidar[0].node, &[byte]);
            rig.run_for(core::time::Duration::from_millis(1));
            eyes.damaged()
        });
        assert_eq!(damaged, [0, 1, 1, 1]);
        let mut copy = rig.fork().expect("plain");
        let copied = eyes.fork(&mut copy, &Robot("lidar")).expect("the same");
        assert_eq!(copied.damaged(), 1);
    }
}
