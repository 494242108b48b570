//! Checks the program's side of a bus of requests and replies.

use core::time::Duration;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::paused::{PAUSED, has_paused, is_damaged};
use crate::Shared;
use crate::codec::{Codec, FrameBytes};
use crate::rig::Rig;
use crate::rig::line::{Delivery, Direction};
use crate::rig::trace::{Side, Tap};
use crate::robots::{Asking, Instruments};

/// Number of unanswered requests from which the share of repeated ones is judged.
const ENOUGH: u64 = 12;
/// Minimum share of unanswered requests that are repeated, per cent.
const SHARE: u64 = 50;
/// Interval between two comparisons of the counts.
const EVERY: Duration = Duration::from_millis(500);
/// The program may count `AHEAD` replies more than the rig, and one more for each `AHEAD_SHARE`
/// replies.
const AHEAD: u64 = 4;
const AHEAD_SHARE: u64 = 50;
/// The program may also count one more reply for each of this number of damaged deliveries.
const DAMAGED_SHARE: u64 = 5;

/// The program repeats a request that was not answered, or whose answer reports an error, and
/// accepts only matching frames as replies.
pub struct AsksAgain {
    ear: Option<Shared<Ear>>,
    next: Instant,
    broken: Option<(Instant, String)>,
}

#[derive(Clone)]
struct Ear {
    link: usize,
    asking: Asking,
    codec: &'static Codec,
    /// Decoders of requests and replies.
    frames: [FrameBytes; 2],
    heard_at: Instant,
    /// The last request while it is not answered, and the number of times that it was sent.
    open: Option<(Vec<u8>, u32)>,
    /// Number of damaged deliveries of the device: the program may find a reply behind damaged
    /// bytes that the rig counts as part of them.
    damaged: u64,
    /// End of the time in which requests are not judged, and the number of these requests: they
    /// waited for the line, and the reply to the first one arrived meanwhile.
    paused_until: Instant,
    paused: u64,
    requests: u64,
    replies: u64,
    /// Unanswered requests, and repeated ones among them.
    unanswered: u64,
    repeated: u64,
}

impl AsksAgain {
    /// Observes the bus of `instruments` in `rig`, if it has one.
    pub fn listening(rig: &mut Rig, instruments: &dyn Instruments) -> Self {
        let ear = instruments.asking().and_then(|asking| {
            let link = rig.links().iter();
            let link = link.enumerate().find(|(_, link)| link.name == asking.link);
            let (link, _) = link?;
            let codec = instruments.codec_towards(rig, asking.link, Direction::ToDevice)?;
            Some(Ear::new(link, asking, codec))
        });
        Self {
            ear: ear.map(|ear| ear.listening(rig)),
            next: Instant::ZERO + EVERY,
            broken: None,
        }
    }
}

/// Requests and replies.
const BOTH: [Direction; 2] = [Direction::ToDevice, Direction::ToMaster];
const REPLIES: usize = 1;

impl Ear {
    fn new(link: usize, asking: Asking, codec: &'static Codec) -> Self {
        Self {
            link,
            asking,
            codec,
            frames: BOTH.map(|direction| FrameBytes::towards(codec, direction)),
            heard_at: Instant::ZERO,
            open: None,
            damaged: 0,
            paused_until: Instant::ZERO,
            paused: 0,
            requests: 0,
            replies: 0,
            unanswered: 0,
            repeated: 0,
        }
    }

    fn listening(self, rig: &mut Rig) -> Shared<Self> {
        let ear = Shared::new(self);
        rig.add_tap(Box::new(Listener::of(&ear)));
        ear
    }

    fn take(&mut self, to: Direction, at: Instant, bytes: &[u8]) {
        let index = usize::from(to == Direction::ToMaster);
        let mut found = Vec::new();
        let mut visit = |frame: &[u8]| found.push(frame.to_vec());
        // The program sends whole frames, however slowly the line takes them.
        if index == REPLIES && at - self.heard_at > self.codec.idle() {
            self.frames[index].idle(&mut visit);
        }
        if index == REPLIES {
            self.heard_at = at;
        }
        self.frames[index].push(bytes, &mut visit);
        for frame in found {
            match to {
                Direction::ToDevice => self.ask(at, frame),
                Direction::ToMaster => self.answer(&frame),
            }
        }
    }

    fn ask(&mut self, at: Instant, request: Vec<u8>) {
        self.requests += 1;
        if at < self.paused_until {
            self.paused += 1;
            // With two or more tries, the next request does not count it as unanswered.
            let tries = self.open.take().map_or(1, |(_, tries)| tries + 1);
            self.open = Some((request, tries.max(2)));
            return;
        }
        let before = self.open.take();
        // The program discards a partial reply before its next request.
        if before.as_ref().is_none_or(|(last, _)| *last != request) {
            self.frames[REPLIES].idle(&mut |_| {});
        }
        let tries = match before {
            Some((last, tries)) if last == request => {
                self.unanswered += u64::from(tries == 1);
                self.repeated += u64::from(tries == 1);
                tries + 1
            }
            Some((_, tries)) => {
                self.unanswered += u64::from(tries == 1);
                1
            }
            None => 1,
        };
        self.open = Some((request, tries));
    }

    fn answer(&mut self, reply: &[u8]) {
        let asking = self.asking;
        let fits = |(request, _): &mut (Vec<u8>, u32)| (asking.is_answer)(request, reply);
        self.replies += u64::from(self.open.take_if(fits).is_some());
    }

    fn contradiction(&self, counted: Option<u64>) -> Option<String> {
        let (unanswered, repeated) = (self.unanswered, self.repeated);
        if unanswered >= ENOUGH && repeated * 100 < unanswered * SHARE {
            return Some(format!(
                "of {unanswered} unanswered requests {repeated} were repeated"
            ));
        }
        let replies = self.replies;
        let most =
            replies + self.paused + AHEAD + replies / AHEAD_SHARE + self.damaged / DAMAGED_SHARE;
        let counted = counted.filter(|&counted| counted > most)?;
        Some(format!(
            "the program counts {counted} answers, {replies} fitting ones arrived"
        ))
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
            self.ear.lock().take(to, at, bytes);
        }
    }

    fn arrived(&mut self, link: usize, to: Direction, delivery: &Delivery) {
        if link != self.link {
            return;
        }
        let mut ear = self.ear.lock();
        if to == Direction::ToDevice && has_paused(delivery) {
            ear.paused_until = delivery.at + PAUSED;
        }
        ear.damaged += u64::from(to == Direction::ToMaster && is_damaged(delivery));
        if to == Direction::ToMaster && !delivery.bytes.is_empty() {
            ear.take(to, delivery.at, &delivery.bytes);
        }
    }
}

impl Checker for AsksAgain {
    fn observe(&mut self, look: &Look<'_>) {
        let now = look.rig.now();
        if now < self.next || self.broken.is_some() {
            return;
        }
        self.next = now + EVERY;
        let Some(ear) = &self.ear else { return };
        let ear = ear.lock();
        let mut counted = None;
        if let Some(program) = look.rig.program() {
            program.counters(&mut |name, value| {
                if name == ear.asking.counter {
                    counted = Some(value);
                }
            });
        }
        self.broken = ear.contradiction(counted).map(|told| (now, told));
    }

    fn verdict(&self) -> Check {
        let name = "asks-again";
        let Some(ear) = &self.ear else {
            return Check::not_observed(name, "the robot names no bus of requests and replies");
        };
        let ear = ear.lock();
        let detail = match &self.broken {
            Some((at, told)) => format!("at {at} s on {}: {told}", ear.asking.link),
            None => format!(
                "{} requests, {} answers; {} of {} unanswered requests repeated",
                ear.requests, ear.replies, ear.repeated, ear.unanswered
            ),
        };
        Check::new(name, self.broken.is_none(), detail).if_observed(ear.replies > 0)
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let ear = self.ear.as_ref().map(|ear| {
            let ear = ear.lock().clone();
            ear.listening(rig)
        });
        Some(Box::new(Self {
            ear,
            next: self.next,
            broken: self.broken.clone(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::BUS_HIGH_FIRST;

    /// A reply answers the request that begins with its first byte.
    fn ear() -> Ear {
        let asking = Asking {
            link: "bus",
            is_answer: |request, reply| request.first() == reply.first(),
            counter: "answers",
        };
        Ear::new(0, asking, &BUS_HIGH_FIRST)
    }

    fn ask(ear: &mut Ear, requests: &str) {
        for request in requests.bytes() {
            ear.ask(Instant::from_secs(1), vec![request]);
        }
    }

    /// Each unanswered request counts once, whether it is repeated or not.
    #[test]
    fn unanswered_and_repeated_requests_are_counted() {
        let counts = |requests: &str| {
            let mut ear = ear();
            ask(&mut ear, requests);
            [ear.requests, ear.unanswered, ear.repeated]
        };
        assert_eq!(counts("a"), [1, 0, 0]);
        assert_eq!(counts("aa"), [2, 1, 1]);
        assert_eq!(counts("aaa"), [3, 1, 1]);
        assert_eq!(counts("aab"), [3, 1, 1]);
        assert_eq!(counts("ab"), [2, 1, 0]);
        assert_eq!(counts("abb"), [3, 2, 1]);
    }

    #[test]
    fn a_reply_answers_one_request() {
        let mut ear = ear();
        ask(&mut ear, "a");
        ear.answer(b"b");
        assert_eq!((ear.replies, ear.open.is_some()), (0, true));
        ear.answer(b"a1");
        ear.answer(b"a2");
        assert_eq!((ear.replies, ear.open.is_some()), (1, false));
        ask(&mut ear, "b");
        assert_eq!(ear.unanswered, 0, "the first one was answered");
    }

    /// Requests in the 200 ms after a pause of the line are not judged.
    #[test]
    fn requests_that_waited_for_the_line_are_not_judged() {
        let mut ear = ear();
        ear.paused_until = Instant::from_millis(1_001);
        ask(&mut ear, "aa");
        ear.paused_until = Instant::from_secs(1);
        assert_eq!((ear.paused, ear.unanswered), (2, 0));
        ask(&mut ear, "b");
        assert_eq!((ear.paused, ear.unanswered), (2, 0), "it follows a pause");
        ask(&mut ear, "c");
        assert_eq!(ear.unanswered, 1);
    }

    /// Of twelve unanswered requests, half must be repeated; fewer requests are not judged. The
    /// program may count 4 answers more than the rig, one more of 50, one more for each request in
    /// a pause, and one more for each five damaged deliveries.
    #[test]
    fn shares_and_counts_contradict_from_their_limits_on() {
        let told = |unanswered, repeated| {
            let ear = Ear {
                unanswered,
                repeated,
                ..ear()
            };
            ear.contradiction(None)
        };
        assert_eq!((told(11, 0), told(12, 6)), (None, None));
        let words = "of 12 unanswered requests 5 were repeated";
        assert_eq!(told(12, 5).as_deref(), Some(words));
        let counted = |damaged, paused, counted| {
            let ear = Ear {
                replies: 100,
                damaged,
                paused,
                ..ear()
            };
            ear.contradiction(Some(counted))
        };
        assert_eq!(
            (counted(0, 0, 106), counted(10, 0, 108), counted(4, 3, 109)),
            (None, None, None)
        );
        let words = "the program counts 107 answers, 100 fitting ones arrived";
        assert_eq!(counted(0, 0, 107).as_deref(), Some(words));
        assert!(counted(10, 0, 109).is_some() && counted(4, 3, 110).is_some());
    }

    /// Requests and replies are frames on their lines. Two parts of a reply are not a frame if the
    /// pause between them is longer than the decoder's idle time.
    #[test]
    fn frames_are_taken_from_both_directions() {
        let frame = [0xAB, 0x24, 0x0A, 0x00, 0xD9];
        let at = Instant::from_millis;
        let idle = BUS_HIGH_FIRST.idle();
        for (pause, replies) in [(idle, 1), (idle + Duration::from_millis(1), 0)] {
            let mut ear = ear();
            ear.take(Direction::ToDevice, at(1_000), &frame);
            assert_eq!((ear.requests, ear.replies), (1, 0));
            ear.take(Direction::ToMaster, at(1_010), &frame[..2]);
            ear.take(Direction::ToMaster, at(1_010) + pause, &frame[2..]);
            assert_eq!((ear.requests, ear.replies), (1, replies));
        }
    }

    use super::super::puppet::{copied, puppet};
    use super::super::tests::look_at;
    use crate::rig::bare::linked;
    use crate::rig::fault::{Damage, Strike};
    use crate::robots::checker::Status;

    const FRAME: [u8; 5] = [0xAB, 0x24, 0x0A, 0x00, 0xD9];

    struct Robot(&'static str);

    impl Instruments for Robot {
        fn asking(&self) -> Option<Asking> {
            Some(Asking {
                link: self.0,
                is_answer: |request, reply| request == reply,
                counter: "answers",
            })
        }

        fn codec(&self, _: &Rig, _: &str) -> Option<&'static Codec> {
            Some(&BUS_HIGH_FIRST)
        }
    }

    /// Requests and replies of a bus, one of each 10 ms; then the program tells this count.
    fn judged(replies: u64, counted: u64, looks: &[u64]) -> (Status, String) {
        let (mut rig, [bus, other]) = linked(["bus", "other"], 1_000_000);
        let mut checker = AsksAgain::listening(&mut rig, &Robot("bus"));
        for number in 0..20 {
            rig.inject(bus[1].node, &FRAME);
            rig.inject(other[1].node, &FRAME);
            rig.run_for(Duration::from_millis(5));
            let node = if number < replies {
                bus[0].node
            } else {
                other[0].node
            };
            rig.inject(node, &FRAME);
            rig.run_for(Duration::from_millis(5));
        }
        puppet(&mut rig).counters = vec![("others", 99), ("answers", counted)];
        for &millis in looks {
            look_at(&mut checker, &mut rig, millis, 0.0);
        }
        let check = checker.verdict();
        assert_eq!(copied(&checker, &rig), check.to_string());
        (check.status, check.detail)
    }

    /// Of 20 requests 15 are answered; the rest is the same request, repeated.
    #[test]
    fn requests_and_replies_of_the_bus_are_counted() {
        let sound = "20 requests, 15 answers; 1 of 1 unanswered requests repeated".to_owned();
        assert_eq!(judged(15, 19, &[500]), (Status::Pass, sound.clone()));
        assert_eq!(judged(15, 20, &[499]), (Status::Pass, sound));
        let more = "at 0.500000 s on bus: the program counts 20 answers, 15 fitting ones arrived";
        assert_eq!(
            judged(15, 20, &[500, 1_000]),
            (Status::Fail, more.to_owned())
        );
        assert_eq!(judged(0, 0, &[500]).0, Status::NotObserved);
        let (mut rig, _) = linked(["bus"], 1_000_000);
        let none = AsksAgain::listening(&mut rig, &Robot("gone")).verdict();
        assert_eq!(none.status, Status::NotObserved);
        assert_eq!(
            none.detail,
            "the robot names no bus of requests and replies"
        );
    }

    /// Counts are compared each 500 ms.
    #[test]
    fn counts_are_compared_twice_a_second() {
        let (mut rig, _) = linked(["bus"], 1_000_000);
        let mut checker = AsksAgain::listening(&mut rig, &Robot("bus"));
        look_at(&mut checker, &mut rig, 700, 0.0);
        puppet(&mut rig).counters = vec![("answers", 9)];
        look_at(&mut checker, &mut rig, 1_199, 0.0);
        assert!(checker.broken.is_none());
        look_at(&mut checker, &mut rig, 1_200, 0.0);
        assert_eq!(
            checker.broken.map(|(at, _)| at),
            Some(Instant::from_millis(1_200))
        );
    }

    /// Replies that a fault damages are counted, and pauses of the requests, of this bus alone.
    #[test]
    fn damage_of_replies_and_pauses_of_requests_are_noted() {
        let noted = |to: Direction, damage: Damage| {
            let (mut rig, [bus, other]) = linked(["bus", "other"], 1_000_000);
            for link in [0, 1] {
                let faults = &mut rig.line_mut(link, to).faults;
                faults.add_strike(Strike { byte: 2, damage });
            }
            let checker = AsksAgain::listening(&mut rig, &Robot("bus"));
            for end in other {
                rig.inject(end.node, &FRAME);
            }
            rig.run_for(Duration::from_millis(500));
            for end in bus {
                rig.inject(end.node, &FRAME);
            }
            rig.run_for(Duration::from_millis(10));
            let ear = checker.ear.as_ref().expect("a bus").lock();
            (ear.damaged, ear.paused_until.as_millis())
        };
        let flip = Damage::Flip { bit: 7 };
        let idle = Damage::Idle {
            by: Duration::from_millis(1),
        };
        assert_eq!(noted(Direction::ToMaster, flip), (1, 0));
        assert_eq!(noted(Direction::ToDevice, flip), (0, 0));
        assert_eq!(noted(Direction::ToMaster, idle), (0, 0));
        // 30 us of bytes and the pause of 1 ms end at 501.03 ms; 200 ms follow.
        assert_eq!(noted(Direction::ToDevice, idle), (0, 701));
    }

    /// A repeated request keeps the part of a reply that has come; another one discards it.
    #[test]
    fn another_request_discards_a_partial_reply() {
        let replies = |second: [u8; 5]| {
            let mut ear = ear();
            let at = Instant::from_millis(10);
            ear.take(Direction::ToDevice, at, &FRAME);
            ear.take(Direction::ToMaster, at, &FRAME[..2]);
            ear.take(Direction::ToDevice, at, &second);
            ear.take(Direction::ToMaster, at, &FRAME[2..]);
            ear.replies
        };
        // A read of eleven registers.
        assert_eq!(
            [replies(FRAME), replies([0xAB, 0x24, 0x0B, 0x00, 0xDA])],
            [1, 0]
        );
    }
}
