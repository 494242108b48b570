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
        rig.add_tap(Box::new(Listener::of(&ear)));
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

struct Listener {
    /// Link of the ear, which is locked only for bytes of this link.
    link: usize,
    ear: Shared<Ear>,
}

impl Listener {
    fn of(ear: &Shared<Ear>) -> Self {
        Self {
            link: ear.lock().link,
            ear: ear.clone(),
        }
    }
}

impl Tap for Listener {
    fn record(&mut self, link: usize, to: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if to == Direction::ToDevice && side == Side::Sent && link == self.link {
            self.ear.lock().take(at, bytes);
        }
    }

    fn arrived(&mut self, link: usize, to: Direction, delivery: &Delivery) {
        if to == Direction::ToDevice && link == self.link && has_paused(delivery) {
            self.ear.lock().paused_until = delivery.at + PAUSED;
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

    struct Robot;

    impl Instruments for Robot {
        fn codec(&self, _: &Rig, link: &str) -> Option<&'static Codec> {
            (link != "unknown").then_some(&BUS_HIGH_FIRST)
        }

        fn station_links(&self) -> &'static [&'static str] {
            &["pc"]
        }
    }

    use super::super::puppet::copied;
    use crate::rig::bare::linked;
    use crate::rig::fault::{Damage, Strike};
    use crate::robots::checker::Status;

    /// Only the bytes to the device of a link whose frames are known count, as they are sent.
    #[test]
    fn frames_are_those_that_the_program_sends() {
        let (mut rig, [base, unknown]) = linked(["base", "unknown"], 1_000_000);
        let faults = &mut rig.line_mut(0, Direction::ToDevice).faults;
        faults.add_strike(Strike {
            byte: 2,
            damage: Damage::Drop,
        });
        let checker = SendsSoundFrames::listening(&mut rig, &Robot);
        let none = checker.verdict();
        assert_eq!(
            (none.status, &*none.detail),
            (Status::NotObserved, "0 bytes in valid frames")
        );
        for (node, bytes) in [
            (base[1].node, &FRAME.repeat(2)[..]),
            (base[0].node, &FRAME),
            (unknown[1].node, &FRAME),
        ] {
            rig.inject(node, bytes);
            rig.run_for(core::time::Duration::from_millis(5));
        }
        let sound = checker.verdict();
        assert_eq!(
            (sound.status, &*sound.detail),
            (Status::Pass, "10 bytes in valid frames")
        );
        rig.inject(base[1].node, &[0x55; 200]);
        rig.run_for(core::time::Duration::from_millis(50));
        let check = checker.verdict();
        assert_eq!(check.status, Status::Fail);
        // 160 bytes and the 50th part of 174 bytes are 163.
        let told = "164 bytes that the program sent on base until ";
        assert!(check.detail.starts_with(told), "{check}");
        assert_eq!(copied(&checker, &rig), check.to_string());
        let unknown = crate::robots::instruments::Unknown;
        let check = SendsSoundFrames::listening(&mut rig, &unknown).verdict();
        assert_eq!(
            check.detail,
            "no link of the program whose frames are known"
        );
    }

    /// A pause of the line ends 200 ms before the bytes are judged again: only one to the device.
    #[test]
    fn a_pause_of_the_line_excuses_what_follows() {
        let excused = |to: Direction, ahead: bool| {
            let (mut rig, [base]) = linked(["base"], 1_000_000);
            let damage = Damage::Idle {
                by: core::time::Duration::from_millis(3),
            };
            rig.line_mut(0, to)
                .faults
                .add_strike(Strike { byte: 0, damage });
            let checker = SendsSoundFrames::listening(&mut rig, &Robot);
            for end in base {
                rig.inject(end.node, &[0x55]);
            }
            let pause = if ahead { 190 } else { 210 };
            rig.run_for(core::time::Duration::from_millis(pause));
            rig.inject(base[1].node, &[0x55; 30]);
            rig.run_for(core::time::Duration::from_millis(5));
            checker.ears[0].lock().excused
        };
        assert_eq!(excused(Direction::ToDevice, true), 30);
        assert_eq!(excused(Direction::ToDevice, false), 0);
        assert_eq!(excused(Direction::ToMaster, true), 0);
    }

    /// A format whose frames a pause ends: two bytes of a text, and the rest after a pause.
    #[test]
    fn a_pause_ends_a_frame_of_some_formats() {
        let format = crate::codec::all();
        let mut ended = format
            .into_iter()
            .filter(|codec| codec.is_ended_by(core::time::Duration::from_secs(9)));
        let codec = ended.next().expect("Modbus is one");
        let mut ear = Ear::new(0, "bus".to_owned(), codec);
        ear.take(Instant::from_secs(1), &[0x55]);
        assert_eq!((ear.outside, ear.counter.pending()), (0, 1));
        ear.take(Instant::from_secs(1) + codec.idle(), &[0x55]);
        assert_eq!(ear.outside, 0);
        let before = ear.sent_at;
        assert_eq!(before, Instant::from_secs(1) + codec.idle());
        ear.take(
            before + codec.idle() + core::time::Duration::from_nanos(1),
            &[0x55],
        );
        assert_eq!((ear.outside, ear.counter.pending()), (2, 1));
    }
}
