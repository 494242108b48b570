//! Checks that the program notices a silent device.

use core::time::Duration;
use std::sync::Arc;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use super::eyes::Eyes;
use crate::Shared;
use crate::codec::Counter;
use crate::rig::Rig;
use crate::rig::line::{Delivery, Direction};
use crate::rig::trace::{Side, Tap};
use crate::robots::{Alarm, Instruments};
use crate::scenario::{FaultSpec, Scenario};

/// A device counts as at work after this number of valid frames, a lidar after this number of turns
/// with a distance: a lidar without rotation also sends valid frames.
const AT_WORK: u64 = 180;
const TURNS: u64 = 2;
/// It must also have sent for this long, because a program does not use a new device at once.
const AT_WORK_FOR: Duration = Duration::from_secs(2);

/// The program counts a failure of each device that was at work and fell silent.
pub struct NoticesSilence {
    watched: Vec<Watched>,
    eyes: Option<Eyes>,
    instruments: Arc<dyn Instruments>,
    within: Duration,
}

struct Watched {
    alarm: Alarm,
    /// Decoder of the link. Without a codec, each byte counts as a sign of work.
    ear: Option<Shared<Ear>>,
    delivered: u64,
    heard_at: Instant,
    /// Times without a fault on the link. While a fault delays or damages its bytes, the program
    /// may treat the device as silent and count this before the real silence.
    calm: Calm,
    /// Valid frames or turns so far, and since the last silence.
    frames: u64,
    worked: u64,
    worked_since: Instant,
    /// Value of the failure counter at the last valid frame. Garbage also increments the counter.
    counted: u64,
    silences: u64,
    is_judged: bool,
    broken: Option<Instant>,
}

impl NoticesSilence {
    /// Observes the links of `rig` whose silence the program must count `within` this time.
    pub fn listening(
        scenario: &Scenario,
        rig: &mut Rig,
        instruments: &Arc<dyn Instruments>,
        within: Duration,
    ) -> Self {
        let eyes = Eyes::open(rig, &**instruments);
        let watched = instruments.alarms().iter().map(|&alarm| {
            let link = rig.links().iter().position(|link| link.name == alarm.link);
            let codec = instruments.codec_towards(rig, alarm.link, Direction::ToMaster);
            let ear = link.zip(codec).map(|(link, codec)| Ear {
                link,
                counter: Counter::towards(codec, Direction::ToMaster),
                frames: 0,
            });
            Watched {
                alarm,
                ear: ear.map(|ear| ear.listening(rig)),
                delivered: 0,
                heard_at: Instant::ZERO,
                calm: Calm::of(scenario, rig, &|link| link == alarm.link),
                frames: 0,
                worked: 0,
                worked_since: Instant::ZERO,
                counted: 0,
                silences: 0,
                is_judged: false,
                broken: None,
            }
        });
        Self {
            watched: watched.collect(),
            eyes,
            instruments: Arc::clone(instruments),
            within,
        }
    }

    /// The turns of the lidar, if `link` is the lidar's link.
    fn turns(&self, link: &str) -> Option<u64> {
        let eyes = self.eyes.as_ref()?;
        (eyes.link() == link).then(|| eyes.turns())
    }
}

/// Counts the valid frames of a link.
#[derive(Clone)]
struct Ear {
    link: usize,
    counter: Counter,
    frames: u64,
}

impl Ear {
    fn listening(self, rig: &mut Rig) -> Shared<Self> {
        let ear = Shared::new(self);
        rig.add_tap(Box::new(Listener::of(&ear)));
        ear
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
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        if direction == Direction::ToMaster && link == self.link {
            let mut ear = self.ear.lock();
            ear.frames += ear.counter.push(&delivery.bytes).frames;
        }
    }
}

impl Checker for NoticesSilence {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        let Some(program) = rig.program() else { return };
        let turns = self.watched.iter();
        let turns: Vec<Option<u64>> = turns.map(|one| self.turns(one.alarm.link)).collect();
        for (one, turns) in self.watched.iter_mut().zip(turns) {
            let Some(link) = rig.link(one.alarm.link) else {
                continue;
            };
            let delivered = link.line(Direction::ToMaster).traffic().delivered;
            let is_new = delivered != one.delivered;
            let is_due = !one.is_judged && one.delivered > 0 && now - one.heard_at > self.within;
            if !is_new && !is_due {
                continue;
            }
            let mut count = 0;
            program.counters(&mut |name, value| {
                if name == one.alarm.counter {
                    count = value;
                }
            });
            if is_new {
                let ear = one.ear.as_ref();
                let frames = || ear.map_or(delivered, |ear| ear.lock().frames);
                let frames = turns.unwrap_or_else(frames);
                if frames != one.frames {
                    // The program noticed a failure while frames still arrived, for instance from a
                    // lidar that stands still. The later silence is no new failure.
                    if count > one.counted || !one.calm.is(now) {
                        one.worked = 0;
                    }
                    if one.worked == 0 {
                        one.worked_since = now;
                    }
                    one.worked += frames - one.frames;
                    one.frames = frames;
                    one.counted = count;
                }
                one.delivered = delivered;
                one.heard_at = now;
                one.is_judged = false;
                continue;
            }
            one.is_judged = true;
            let enough = match (turns, &one.ear) {
                (Some(_), _) => TURNS,
                (None, Some(_)) => AT_WORK,
                (None, None) => 1,
            };
            let is_short = one.ear.is_some() && one.heard_at - one.worked_since < AT_WORK_FOR;
            if core::mem::take(&mut one.worked) < enough || is_short {
                continue;
            }
            one.silences += 1;
            if count <= one.counted && one.broken.is_none() {
                one.broken = Some(one.heard_at);
            }
        }
    }

    fn verdict(&self) -> Check {
        let name = "notices-silence";
        let broken = self.watched.iter().find_map(|one| Some((one, one.broken?)));
        let silences: u64 = self.watched.iter().map(|one| one.silences).sum();
        let within = self.within.as_secs_f64();
        let detail = match broken {
            Some((one, at)) => format!(
                "{} is silent since {at} s, and \"{}\" did not grow within {within} s",
                one.alarm.link, one.alarm.counter
            ),
            None if self.watched.is_empty() => {
                "the robot names no counter of silent devices".to_owned()
            }
            None => format!("each of {silences} silences was counted within {within} s"),
        };
        Check::new(name, broken.is_none(), detail).if_observed(silences > 0)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        for one in &mut self.watched {
            one.calm.renew(faults, rig);
        }
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let watched = self.watched.iter().map(|one| {
            let ear = one.ear.as_ref().map(|ear| ear.lock().clone());
            Watched {
                ear: ear.map(|ear| ear.listening(rig)),
                calm: one.calm.clone(),
                ..*one
            }
        });
        let watched = watched.collect();
        let instruments = Arc::clone(&self.instruments);
        let eyes = self.eyes.as_ref();
        Some(Box::new(Self {
            watched,
            eyes: eyes.and_then(|eyes| eyes.fork(rig, &*instruments)),
            instruments,
            within: self.within,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::super::puppet::{copied, cut, puppet, scenario};
    use super::*;
    use crate::codec::{BUS_HIGH_FIRST, Codec};
    use crate::rig::bare::linked;
    use crate::robots::checker::Status;

    const LOST: &str = "lost replies";
    /// A read of ten registers from 36.
    const FRAME: [u8; 5] = [0xAB, 0x24, 0x0A, 0x00, 0xD9];

    /// A robot that counts the silences of its base; without a codec, each byte is a sign of work.
    struct Robot(Option<&'static Codec>);

    impl Instruments for Robot {
        fn alarms(&self) -> &'static [Alarm] {
            const ALL: [Alarm; 2] = [Alarm::new("base", LOST), Alarm::new("gone", "other")];
            &ALL
        }

        fn codec(&self, _: &Rig, _: &str) -> Option<&'static Codec> {
            self.0
        }
    }

    struct Course {
        rig: Rig,
        base: usize,
        says: NoticesSilence,
    }

    fn course(codec: Option<&'static Codec>) -> Course {
        let (mut rig, [base]) = linked(["base"], 1_000_000);
        puppet(&mut rig);
        let robot: Arc<dyn Instruments> = Arc::new(Robot(codec));
        let within = Duration::from_secs(3);
        let says = NoticesSilence::listening(&scenario("").0, &mut rig, &robot, within);
        Course {
            rig,
            base: base[0].node,
            says,
        }
    }

    impl Course {
        /// Sends these bytes each 10 ms until `until`, with this value of the counter.
        fn go(&mut self, until: u64, bytes: &[u8], counted: u64) {
            puppet(&mut self.rig).counters = vec![("other", 99), (LOST, counted)];
            let from = self.rig.now().as_millis();
            for millis in (from + 10..=until).step_by(10) {
                self.rig.inject(self.base, bytes);
                self.rig.run_until(Instant::from_millis(millis));
                self.says.observe(&Look {
                    rig: &self.rig,
                    axes: &[],
                    contacts: &[],
                });
            }
        }

        fn told(&self) -> (Status, String) {
            let check = self.says.verdict();
            (check.status, check.detail)
        }
    }

    use Status::{Fail, NotObserved, Pass};

    fn counted(silences: u64) -> String {
        format!("each of {silences} silences was counted within 3 s")
    }

    /// A frame each 10 ms until 3 s: 300 of them. The silence is judged at 6.01 s.
    #[test]
    fn a_device_that_falls_silent_is_counted() {
        let mut silent = course(Some(&BUS_HIGH_FIRST));
        silent.go(3_000, &FRAME, 2);
        silent.go(6_000, &[], 2);
        assert_eq!(silent.told(), (NotObserved, counted(0)));
        silent.go(6_010, &[], 2);
        let words = "base is silent since 3.000000 s, and \"lost replies\" did not grow within 3 s";
        assert_eq!(silent.told(), (Fail, words.to_owned()));
        assert!(copied(&silent.says, &silent.rig).ends_with(words));
        let mut noticed = course(Some(&BUS_HIGH_FIRST));
        noticed.go(3_000, &FRAME, 2);
        noticed.go(9_000, &[], 3);
        assert_eq!(noticed.told(), (Pass, counted(1)));
        noticed.go(12_000, &FRAME, 3);
        noticed.go(20_000, &[], 4);
        assert_eq!(noticed.told(), (Pass, counted(2)));
    }

    /// 180 valid frames, and two seconds from the first to the last one; without a codec one byte
    /// is enough.
    #[test]
    fn a_device_has_to_have_been_at_work() {
        let after = |codec, until: u64, bytes: &[u8]| {
            let mut course = course(codec);
            course.go(until, bytes, 0);
            course.go(20_000, &[], 0);
            course.told().0
        };
        let codec = Some(&BUS_HIGH_FIRST);
        assert_eq!(after(codec, 2_010, &FRAME), Fail);
        assert_eq!(after(codec, 2_000, &FRAME), NotObserved);
        assert_eq!(after(codec, 9_000, &[0x55]), NotObserved);
        let slow = |frames: u64| {
            let mut course = course(codec);
            for frame in 1..=frames {
                course.go(20 * frame - 10, &FRAME, 0);
                course.go(20 * frame, &[], 0);
            }
            course.go(20_000, &[], 0);
            course.told().0
        };
        assert_eq!([slow(179), slow(180)], [NotObserved, Fail]);
        assert_eq!(
            [after(None, 10, &[7]), after(None, 9_000, &[])],
            [Fail, NotObserved]
        );
    }

    /// A failure that is counted while frames still arrive, or a fault at the link, begins the work
    /// anew.
    #[test]
    fn work_begins_anew_after_a_failure() {
        let mut failed = course(Some(&BUS_HIGH_FIRST));
        failed.go(3_000, &FRAME, 0);
        failed.go(4_000, &FRAME, 1);
        failed.go(9_000, &[], 1);
        assert_eq!(failed.told(), (NotObserved, counted(0)));
        let faulted = |until_s: u64| {
            let mut course = course(Some(&BUS_HIGH_FIRST));
            let fault = cut("base", 1, until_s);
            course.says.faults_changed(&[fault], &course.rig);
            course.go(9_000, &FRAME, 0);
            course.go(20_000, &[], 0);
            course.told().0
        };
        // With the effects of 5 s, to 7 s and to 8 s.
        assert_eq!([faulted(2), faulted(3)], [Fail, NotObserved]);
        // Garbage counts no work, but it is not silence.
        let mut garbage = course(Some(&BUS_HIGH_FIRST));
        garbage.go(3_000, &FRAME, 0);
        garbage.go(9_000, &[0x55], 0);
        assert_eq!(garbage.told().0, NotObserved);
        garbage.go(20_000, &[], 0);
        assert_eq!(garbage.told().0, Fail);
    }

    #[test]
    fn a_robot_without_such_counters_is_not_judged() {
        let (mut rig, _) = linked(["base"], 1_000_000);
        let unknown: Arc<dyn Instruments> = Arc::new(crate::robots::instruments::Unknown);
        let within = Duration::from_secs(3);
        let says = NoticesSilence::listening(&scenario("").0, &mut rig, &unknown, within);
        assert_eq!(
            says.verdict().detail,
            "the robot names no counter of silent devices"
        );
    }
}
