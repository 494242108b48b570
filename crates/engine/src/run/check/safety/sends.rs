//! Checks that the program sends only whole, valid frames.

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::paused::{PAUSED, has_paused};
use crate::Shared;
use crate::codec::{Codec, Counter};
use crate::rig::Rig;
use crate::rig::line::{Delivery, Direction};
use crate::rig::trace::{Side, Tap};
use crate::robots::Instruments;

/// Maximum number of bytes outside frames without a failure: commands that set up a radio module.
const SETUP: u64 = 160;
/// One byte of this many may be outside a frame: a port that closes cuts a frame.
const SHARE: u64 = 50;

/// The program sends only valid frames, as its lines carry them before any fault.
pub struct SendsSoundFrames {
    ears: Vec<Shared<Ear>>,
}

#[derive(Clone)]
struct Ear {
    link: usize,
    name: String,
    codec: &'static Codec,
    counter: Counter,
    sent_at: Instant,
    bytes: u64,
    framed: u64,
    /// Bytes outside frames so far, and those that a pause of the line explains: the program gives
    /// up the rest of a frame that the line did not take in time.
    outside: u64,
    excused: u64,
    paused_until: Instant,
    broken: Option<(Instant, u64)>,
}

impl SendsSoundFrames {
    /// Observes the links of `rig` whose frames are known.
    pub fn listening(rig: &mut Rig, instruments: &dyn Instruments) -> Self {
        let program = rig.links_under_test(instruments.station_links());
        let ears: Vec<Ear> = program
            .into_iter()
            .filter_map(|link| {
                let name = rig.links()[link].name.clone();
                let codec = instruments.codec_towards(rig, &name, Direction::ToDevice)?;
                Some(Ear::new(link, name, codec))
            })
            .collect();
        let ears = ears.into_iter().map(|ear| ear.listening(rig));
        Self {
            ears: ears.collect(),
        }
    }
}

impl Ear {
    fn new(link: usize, name: String, codec: &'static Codec) -> Self {
        Self {
            link,
            name,
            codec,
            counter: Counter::towards(codec, Direction::ToDevice),
            sent_at: Instant::ZERO,
            bytes: 0,
            framed: 0,
            outside: 0,
            excused: 0,
            paused_until: Instant::ZERO,
            broken: None,
        }
    }

    fn listening(self, rig: &mut Rig) -> Shared<Self> {
        let ear = Shared::new(self);
        rig.add_tap(Box::new(Listener(ear.clone())));
        ear
    }

    fn take(&mut self, at: Instant, bytes: &[u8]) {
        if self.codec.is_ended_by(at - self.sent_at) {
            self.framed += self.counter.idle().bytes;
        }
        self.sent_at = at;
        self.bytes += bytes.len() as u64;
        self.framed += self.counter.push(bytes).bytes;
        let outside = self.bytes - self.framed - self.counter.pending() as u64;
        if at < self.paused_until {
            self.excused += outside.saturating_sub(self.outside);
        }
        self.outside = outside;
        let outside = outside.saturating_sub(self.excused);
        if outside > SETUP + self.bytes / SHARE && self.broken.is_none() {
            self.broken = Some((at, outside));
        }
    }
}

struct Listener(Shared<Ear>);

impl Tap for Listener {
    fn record(&mut self, link: usize, to: Direction, side: Side, at: Instant, bytes: &[u8]) {
        let mut ear = self.0.lock();
        if to == Direction::ToDevice && side == Side::Sent && link == ear.link {
            ear.take(at, bytes);
        }
    }

    fn arrived(&mut self, link: usize, to: Direction, delivery: &Delivery) {
        let mut ear = self.0.lock();
        if to == Direction::ToDevice && link == ear.link && has_paused(delivery) {
            ear.paused_until = delivery.at + PAUSED;
        }
    }
}

impl Checker for SendsSoundFrames {
    fn observe(&mut self, _: &Look<'_>) {}

    fn verdict(&self) -> Check {
        let name = "sends-sound-frames";
        let ears: Vec<_> = self.ears.iter().map(Shared::lock).collect();
        let broken = ears.iter().find_map(|ear| Some((ear, ear.broken?)));
        let framed: u64 = ears.iter().map(|ear| ear.framed).sum();
        let detail = match broken {
            Some((ear, (at, outside))) => format!(
                "{outside} bytes that the program sent on {} until {at} s are outside frames",
                ear.name
            ),
            None if ears.is_empty() => "no link of the program whose frames are known".to_owned(),
            None => format!("{framed} bytes in valid frames"),
        };
        Check::new(name, broken.is_none(), detail).if_observed(framed > 0 || broken.is_some())
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let ears = self.ears.iter().map(|ear| {
            let ear = ear.lock().clone();
            ear.listening(rig)
        });
        Some(Box::new(Self {
            ears: ears.collect(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::BUS_HIGH_FIRST;

    fn ear() -> Ear {
        Ear::new(0, "base".to_owned(), &BUS_HIGH_FIRST)
    }

    const FRAME: [u8; 5] = [0xAB, 0x24, 0x0A, 0x00, 0xD9];

    /// 160 bytes may set up a radio, and one of 50 may be outside of frames.
    #[test]
    fn bytes_outside_of_frames_are_few() {
        let at = Instant::from_secs(1);
        let after = |frames: usize, outside: usize| {
            let mut ear = ear();
            ear.take(at, &FRAME.repeat(frames));
            assert_eq!((ear.framed, ear.broken), (5 * frames as u64, None));
            ear.take(at, &vec![0x55; outside]);
            ear.broken
        };
        // Of 163 bytes, all may be outside: 160, and one for each 50. Of 1163 bytes, 183 may be.
        assert_eq!((after(0, 163), after(0, 164)), (None, Some((at, 164))));
        assert_eq!((after(200, 183), after(200, 184)), (None, Some((at, 184))));
    }

    /// Bytes in the 200 ms after a pause of the line are excused.
    #[test]
    fn what_a_pause_of_the_line_cuts_is_excused() {
        let at = Instant::from_millis;
        let mut ear = ear();
        ear.paused_until = at(100);
        ear.take(at(99), &[0x55; 500]);
        assert_eq!((ear.outside, ear.excused, ear.broken), (500, 500, None));
        ear.take(at(100), &[0x55; 173]);
        assert_eq!((ear.excused, ear.broken), (500, None));
        ear.take(at(101), &[0x55; 1]);
        assert_eq!(ear.broken, Some((at(101), 174)));
    }
}
