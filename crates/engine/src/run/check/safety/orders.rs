//! Checks that damaged frames do not move the robot.

use protocols::Instant;

use super::super::{Check, Checker, Look};
use crate::Shared;
use crate::codec::{Codec, Stream};
use crate::rig::Rig;
use crate::rig::line::{Delivery, Direction};
use crate::rig::trace::{Side, Tap};
use crate::robots::Instruments;

/// Number of bytes of orders that are decoded again for a copy of the rig: longer than any frame of
/// an order.
const TAIL: usize = 4096;

/// The robot does not move before a frame with a valid checksum has arrived on the link of its
/// orders.
pub struct MovesOnSoundOrders {
    ear: Option<Shared<Ear>>,
    moved_first: Option<Instant>,
    has_moved: bool,
}

struct Ear {
    link: usize,
    name: String,
    codec: &'static Codec,
    stream: Stream,
    tail: Vec<u8>,
    sound: u64,
    damaged: u64,
}

impl MovesOnSoundOrders {
    /// Observes `link` of `rig`; without a link, or without its codec, nothing is observed.
    pub fn listening(rig: &mut Rig, instruments: &dyn Instruments, link: Option<&str>) -> Self {
        let name = link.unwrap_or_default();
        let index = rig.links().iter().position(|known| known.name == name);
        let codec = instruments.codec_towards(rig, name, Direction::ToMaster);
        let ear = index.zip(codec).map(|(link, codec)| Ear {
            link,
            name: name.to_owned(),
            codec,
            stream: Stream::towards(codec, Direction::ToMaster),
            tail: Vec::new(),
            sound: 0,
            damaged: 0,
        });
        let ear = ear.map(Shared::new);
        if let Some(ear) = &ear {
            rig.add_tap(Box::new(Listener(ear.clone())));
        }
        Self {
            ear,
            moved_first: None,
            has_moved: false,
        }
    }
}

struct Listener(Shared<Ear>);

impl Tap for Listener {
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        let mut ear = self.0.lock();
        if direction == Direction::ToMaster && link == ear.link && ear.sound == 0 {
            let found = ear.stream.push(&delivery.bytes);
            ear.tail.extend_from_slice(&delivery.bytes);
            let behind = ear.tail.len().saturating_sub(TAIL);
            ear.tail.drain(..behind);
            for stretch in found {
                match stretch.is_frame() {
                    true => ear.sound += 1,
                    false => ear.damaged += 1,
                }
            }
        }
    }
}

impl Checker for MovesOnSoundOrders {
    fn observe(&mut self, look: &Look<'_>) {
        let Some(ear) = &self.ear else { return };
        let is_driven = look.rig.world.is_moving();
        self.has_moved |= is_driven;
        if is_driven && self.moved_first.is_none() && ear.lock().sound == 0 {
            self.moved_first = Some(look.rig.now());
        }
    }

    fn verdict(&self) -> Check {
        let name = "moves-on-sound-orders";
        let Some(ear) = &self.ear else {
            let detail = "no link of orders whose frames are known; set orders_link";
            return Check::not_observed(name, detail);
        };
        let ear = ear.lock();
        let (link, damaged) = (&ear.name, ear.damaged);
        let detail = match self.moved_first {
            Some(at) => format!(
                "moved at {at} s, before any valid frame on {link}; {damaged} sections of damaged bytes"
            ),
            None => format!("no motion before a valid frame on {link}"),
        };
        let check = Check::new(name, self.moved_first.is_none(), detail);
        check.if_observed(ear.damaged > 0 || (ear.sound > 0 && self.has_moved))
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let ear = self.ear.as_ref().map(|ear| {
            let old = ear.lock();
            let mut stream = Stream::towards(old.codec, Direction::ToMaster);
            // The last bytes determine the state of a decoder.
            let _ = stream.push(&old.tail);
            Shared::new(Ear {
                link: old.link,
                name: old.name.clone(),
                codec: old.codec,
                stream,
                tail: old.tail.clone(),
                sound: old.sound,
                damaged: old.damaged,
            })
        });
        if let Some(ear) = &ear {
            rig.add_tap(Box::new(Listener(ear.clone())));
        }
        Some(Box::new(Self {
            ear,
            moved_first: self.moved_first,
            has_moved: self.has_moved,
        }))
    }
}
