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
    link: usize,
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
            link,
            decoder,
            count: 0,
            damaged: 0,
        });
        rig.add_tap(Box::new(Listener(shared.clone())));
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

struct Listener(Shared<Turns>);

impl Tap for Listener {
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        let mut turns = self.0.lock();
        if direction == Direction::ToMaster && link == turns.link {
            let turn = turns.decoder.push(&delivery.bytes);
            turns.damaged += u64::from(is_damaged(delivery) && !delivery.bytes.is_empty());
            turns.count += u64::from(turn.is_some_and(|beams| !beams.is_empty()));
        }
    }
}
