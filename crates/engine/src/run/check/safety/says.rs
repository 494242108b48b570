//! Checks that the program notices a silent device.

use core::time::Duration;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::robots::Alarm;

/// The program counts a failure of each device that fell silent.
#[derive(Clone, Debug)]
pub struct NoticesSilence {
    watched: Vec<Watched>,
    within: Duration,
}

#[derive(Clone, Debug)]
struct Watched {
    alarm: Alarm,
    delivered: u64,
    heard_at: Instant,
    /// The counter when the last byte arrived.
    counted: u64,
    silences: u64,
    is_judged: bool,
    broken: Option<Instant>,
}

impl NoticesSilence {
    /// Watches a program that must have counted each silence `within` this time.
    pub fn new(alarms: &[Alarm], within: Duration) -> Self {
        let watched = alarms.iter().map(|&alarm| Watched {
            alarm,
            delivered: 0,
            heard_at: Instant::ZERO,
            counted: 0,
            silences: 0,
            is_judged: false,
            broken: None,
        });
        Self {
            watched: watched.collect(),
            within,
        }
    }
}

impl Checker for NoticesSilence {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        let Some(program) = rig.program() else { return };
        for one in &mut self.watched {
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
                one.delivered = delivered;
                one.heard_at = now;
                one.counted = count;
                one.is_judged = false;
                continue;
            }
            one.is_judged = true;
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

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}
