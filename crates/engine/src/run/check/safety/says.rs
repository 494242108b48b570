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
        rig.add_tap(Box::new(Listener(ear.clone())));
        ear
    }
}

struct Listener(Shared<Ear>);

impl Tap for Listener {
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        let mut ear = self.0.lock();
        if direction == Direction::ToMaster && link == ear.link {
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
