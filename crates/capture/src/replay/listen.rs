//! Bytes that the program of a run sends on its lines.

use protocols::Instant;

use super::Played;
use crate::divergence::Track;
use engine::Shared;
use engine::rig::Rig;
use engine::rig::line::{Delivery, Direction};
use engine::rig::trace::{Side, Tap};

/// Bytes that the program of a run sends on each of its links.
#[derive(Clone, Debug)]
pub struct Eavesdrop {
    links: Vec<(usize, String)>,
    sent: Shared<Vec<Track>>,
}

impl Eavesdrop {
    /// Listens to the links of `rig` that have these names.
    pub fn of(rig: &mut Rig, names: &[String]) -> Self {
        let links = rig.links().iter().enumerate();
        let links = links.filter(|(_, link)| names.contains(&link.name));
        let links = links
            .map(|(index, link)| (index, link.name.clone()))
            .collect();
        let sent = Shared::new(vec![Track::default(); rig.links().len()]);
        rig.add_tap(Box::new(Listener(sent.clone())));
        Self { links, sent }
    }

    /// Bytes received so far.
    pub fn played(&self) -> Vec<Played> {
        let sent = self.sent.lock();
        let links = self.links.iter().map(|(index, link)| Played {
            link: link.clone(),
            expected: Track::default(),
            got: sent[*index].clone(),
            talk: None,
        });
        links.collect()
    }
}

/// Notes what the program sent, when it has arrived, as a capture does.
pub(super) struct Listener(pub(super) Shared<Vec<Track>>);

impl Tap for Listener {
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        if direction == Direction::ToDevice {
            let sent = match delivery.original.as_deref() {
                Some(original) => (original.at, &original.bytes),
                None => (delivery.at, &delivery.bytes),
            };
            self.0.lock()[link].push(sent.0, sent.1);
        }
    }
}
