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

#[cfg(test)]
mod tests {
    use super::super::puppet::{copied, cut, puppet, scenario};
    use super::*;
    use crate::rig::bare::linked;
    use crate::robots::checker::Status;

    struct Robot;

    impl Instruments for Robot {
        fn complaints(&self) -> &'static [Alarm] {
            const ALL: [Alarm; 3] = [
                Alarm::new("base", "late replies"),
                Alarm::new("lidar", "lost scans"),
                Alarm::new("radio", "bad orders"),
            ];
            &ALL
        }

        fn station_links(&self) -> &'static [&'static str] {
            &["radio", "pc"]
        }
    }

    struct Watch {
        rig: Rig,
        checker: ComplaintsTrue,
    }

    fn watch(more: &str) -> Watch {
        let (mut rig, _) = linked(["base", "lidar", "radio", "pc"], 1_000_000);
        puppet(&mut rig);
        let checker = ComplaintsTrue::new(&scenario(more).0, &rig, &Robot);
        Watch { rig, checker }
    }

    impl Watch {
        /// The verdict after a look at this millisecond with this value of a counter.
        fn at(&mut self, millis: u64, counter: &'static str, value: u64) -> (Status, String) {
            puppet(&mut self.rig).counters = vec![("other", 900), (counter, value)];
            self.rig.run_until(Instant::from_millis(millis));
            self.checker.observe(&Look {
                rig: &self.rig,
                axes: &[],
                contacts: &[],
            });
            let check = self.checker.verdict();
            (check.status, check.detail)
        }
    }

    const BASE: &str = "late replies";

    /// Three failures may come by chance; counters are read each 500 ms.
    #[test]
    fn the_fourth_failure_without_a_fault_is_told() {
        let mut watch = watch("");
        let three = || "3 counters of failures".to_owned();
        assert_eq!(watch.at(499, BASE, 9), (Status::NotObserved, three()));
        assert_eq!(watch.at(500, BASE, 3), (Status::Pass, three()));
        assert_eq!(watch.at(999, BASE, 4).0, Status::Pass);
        let told = "at 1.000000 s \"late replies\" has grown by 4 without a fault on base";
        assert_eq!(watch.at(1_000, BASE, 4), (Status::Fail, told.to_owned()));
        // The time stays that of the fourth one.
        let told = "at 1.000000 s \"late replies\" has grown by 6 without a fault on base";
        assert_eq!(watch.at(1_600, BASE, 6), (Status::Fail, told.to_owned()));
        assert!(copied(&watch.checker, &watch.rig).ends_with(told));
        let mut slow = self::watch("");
        slow.at(600, BASE, 3);
        assert_eq!(slow.at(1_099, BASE, 4).0, Status::Pass);
        assert_eq!(slow.at(1_100, BASE, 4).0, Status::Fail);
    }

    /// The cut lasts from 2 to 3 s, its effects to 8 s. Failures of that time are no complaint.
    #[test]
    fn failures_during_a_fault_are_founded() {
        let mut watch = watch("");
        watch
            .checker
            .faults_changed(&[cut("base", 2, 3)], &watch.rig);
        assert_eq!(watch.at(2_000, BASE, 50).0, Status::NotObserved);
        assert_eq!(watch.at(7_900, BASE, 60).0, Status::NotObserved);
        assert_eq!(watch.at(8_400, BASE, 63).0, Status::Pass);
        assert_eq!(watch.at(8_900, BASE, 64).0, Status::Fail);
    }

    /// Damage on one link of the station passes through the radio to the other one.
    #[test]
    fn a_fault_founds_failures_of_its_own_link_and_of_its_station() {
        let judged = |link: &str, counter: &'static str| {
            let mut watch = watch("");
            watch.checker.faults_changed(&[cut(link, 0, 9)], &watch.rig);
            watch.at(1_000, counter, 4).0
        };
        assert_eq!(judged("pc", "bad orders"), Status::NotObserved);
        assert_eq!(judged("radio", "bad orders"), Status::NotObserved);
        assert_eq!(judged("base", "bad orders"), Status::Fail);
        assert_eq!(judged("pc", BASE), Status::Fail);
        assert_eq!(judged("lidar", BASE), Status::Fail);
    }

    /// Bytes that the mission puts on the base's line may be no frames.
    #[test]
    fn a_link_with_injected_bytes_is_left_out() {
        let inject = "[mission]\nstep = [{ at = \"1s\", do = { inject = { link = \"base\", \
                      direction = \"to-master\", hex = \"55\" } } }]\n";
        let mut watch = watch(inject);
        let told = "2 counters of failures".to_owned();
        assert_eq!(watch.at(500, BASE, 99), (Status::NotObserved, told));
        assert_eq!(watch.at(1_000, "lost scans", 4).0, Status::Fail);
    }

    #[test]
    fn a_robot_without_such_counters_is_not_judged() {
        let (rig, _) = linked(["base"], 1_000_000);
        let unknown = crate::robots::instruments::Unknown;
        let check = ComplaintsTrue::new(&scenario("").0, &rig, &unknown).verdict();
        assert_eq!(check.status, Status::NotObserved);
        assert_eq!(check.detail, "the robot names no counters of failures");
    }
}
