//! The turns of a lidar that show a distance.

use protocols::Instant;

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
        });
        rig.add_tap(Box::new(Listener(shared.clone())));
        Some(Self { name, shared })
    }

    /// The same for a copy of the rig. An incomplete turn does not count.
    pub(super) fn fork(&self, rig: &mut Rig, instruments: &dyn Instruments) -> Option<Self> {
        let copy = Self::open(rig, instruments)?;
        copy.shared.lock().count = self.turns();
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

struct Listener(Shared<Turns>);

impl Tap for Listener {
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        let mut turns = self.0.lock();
        if direction == Direction::ToMaster && link == turns.link {
            let turn = turns.decoder.push(&delivery.bytes);
            turns.count += u64::from(turn.is_some_and(|beams| !beams.is_empty()));
        }
    }
}
