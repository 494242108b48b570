//! Checks that the program reports no failures of links and devices that work.

use core::time::Duration;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use crate::rig::Rig;
use crate::robots::{Alarm, Instruments};
use crate::scenario::{Action, FaultSpec, Scenario};

/// Interval between two observations.
const EVERY: Duration = Duration::from_millis(500);
/// Number of failures without a fault that a program may count: bytes at the start, or a reply that
/// is late by chance.
const PERMITTED: u64 = 3;

/// The program counts no failures of a link while no fault acts on it.
#[derive(Clone)]
pub struct ComplaintsTrue {
    watched: Vec<Watched>,
    next: Instant,
}

#[derive(Clone)]
struct Watched {
    alarm: Alarm,
    calm: Calm,
    counted: u64,
    unfounded: u64,
    looks: u64,
    broken: Option<Instant>,
}

impl ComplaintsTrue {
    /// Observes the counters of failures that `instruments` names.
    pub fn new(scenario: &Scenario, rig: &Rig, instruments: &dyn Instruments) -> Self {
        let station = instruments.station_links();
        // Bytes that the scenario itself injects may be no valid frames.
        let is_injected = |link: &str| {
            let mut steps = scenario.mission.step.iter();
            steps.any(|step| matches!(&step.action, Action::Inject(spec) if spec.link == link))
        };
        let alarms = instruments.complaints().iter();
        let alarms = alarms.filter(|alarm| !is_injected(alarm.link));
        let watched = alarms.map(|&alarm| Watched {
            alarm,
            calm: Calm::of(scenario, rig, &|other| {
                // Damage on one link of the station passes through the radio.
                let both = [alarm.link, other];
                other == alarm.link || both.iter().all(|link| station.contains(link))
            }),
            counted: 0,
            unfounded: 0,
            looks: 0,
            broken: None,
        });
        Self {
            watched: watched.collect(),
            next: Instant::ZERO + EVERY,
        }
    }
}

impl Checker for ComplaintsTrue {
    fn observe(&mut self, look: &Look<'_>) {
        let now = look.rig.now();
        if now < self.next {
            return;
        }
        self.next = now + EVERY;
        let Some(program) = look.rig.program() else {
            return;
        };
        let watched = &mut self.watched;
        program.counters(&mut |name, value| {
            for one in watched.iter_mut().filter(|one| one.alarm.counter == name) {
                let more = value.saturating_sub(one.counted);
                one.counted = value;
                if !one.calm.is(now) {
                    continue;
                }
                one.looks += 1;
                one.unfounded += more;
                if one.unfounded > PERMITTED && one.broken.is_none() {
                    one.broken = Some(now);
                }
            }
        });
    }

    fn verdict(&self) -> Check {
        let name = "complaints-true";
        let broken = self.watched.iter().find_map(|one| Some((one, one.broken?)));
        let looks: u64 = self.watched.iter().map(|one| one.looks).sum();
        let detail = match broken {
            Some((one, at)) => format!(
                "at {at} s \"{}\" has grown by {} without a fault on {}",
                one.alarm.counter, one.unfounded, one.alarm.link
            ),
            None if self.watched.is_empty() => "the robot names no counters of failures".to_owned(),
            None => format!("{} counters of failures", self.watched.len()),
        };
        Check::new(name, broken.is_none(), detail).if_observed(looks > 0)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        for one in &mut self.watched {
            one.calm.renew(faults, rig);
        }
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}
