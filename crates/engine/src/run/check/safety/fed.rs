//! Checks that the program commands its drive often enough.

use core::time::Duration;
use std::collections::BTreeSet;

use protocols::Instant;

use super::super::{Check, Checker, Look, WATCHDOG};
use super::Calm;
use crate::rig::line::Direction;
use crate::rig::{LogPoint, Rig};
use crate::scenario::FaultSpec;

/// Interval at which the logs of the devices are read.
const EVERY: Duration = Duration::from_millis(100);

/// The program commands its drive so often that no watchdog of the drive expires while the
/// set-points are not zero.
pub struct DriveFed {
    /// Links with the commands of the drive, and their devices.
    links: Vec<String>,
    devices: BTreeSet<String>,
    within: Duration,
    /// Times without a fault on these links.
    calm: Calm,
    log: LogPoint,
    next: Instant,
    delivered: u64,
    commanded_at: Instant,
    looks: u64,
    longest: Duration,
    broken: Option<(Instant, String)>,
}

impl DriveFed {
    /// Observes the drive with these links of `rig`. Its commands must not be farther apart than
    /// `within`, while the links are `calm`.
    pub fn new(rig: &Rig, links: Vec<String>, within: Duration, calm: Calm) -> Self {
        let of_drive = rig.links().iter();
        let of_drive = of_drive.filter(|link| links.contains(&link.name));
        let ends = of_drive.flat_map(|link| &link.lines);
        let names = ends.map(|line| rig.node_name(line.from.node).to_owned());
        let devices = rig.device_names().map(str::to_owned).collect();
        Self {
            devices: names
                .collect::<BTreeSet<_>>()
                .intersection(&devices)
                .cloned()
                .collect(),
            links,
            within,
            calm,
            log: rig.log_end(),
            next: Instant::ZERO,
            delivered: 0,
            commanded_at: Instant::ZERO,
            looks: 0,
            longest: Duration::ZERO,
            broken: None,
        }
    }

    /// For tests: the log entries of `device` are those of the drive.
    #[cfg(test)]
    pub(super) fn watch(&mut self, device: &str) {
        self.devices.insert(device.to_owned());
    }

    /// The first stop by a watchdog since the last call.
    fn stopped(&mut self, rig: &Rig) -> Option<(Instant, String)> {
        let (moments, _) = rig.log_since(&self.log);
        let mut moments = moments.into_iter();
        let found = moments.find(|moment| {
            let is_stop = WATCHDOG.contains(&moment.rule) && self.devices.contains(moment.source);
            is_stop && self.calm.is(moment.at)
        });
        let found = found.map(|moment| (moment.at, format!("{} stopped by itself", moment.source)));
        self.log = rig.log_end();
        found
    }
}

impl Checker for DriveFed {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        if self.broken.is_some() || self.links.is_empty() {
            return;
        }
        let links = self.links.iter().filter_map(|link| rig.link(link));
        let sums = links.map(|link| link.line(Direction::ToDevice).traffic().delivered);
        let delivered = sums.sum();
        let is_driven = look.is_driven();
        if delivered != self.delivered || !is_driven || !self.calm.is(now) {
            (self.delivered, self.commanded_at) = (delivered, now);
        }
        self.looks += u64::from(is_driven);
        let silence = now - self.commanded_at;
        self.longest = self.longest.max(silence);
        if silence > self.within {
            let told = format!("no command for {} ms at set-points", silence.as_millis());
            self.broken = Some((now, told));
        }
        if now >= self.next {
            self.next = now + EVERY;
            self.broken = self.stopped(rig).or(self.broken.take());
        }
    }

    fn verdict(&self) -> Check {
        let name = "drive-fed";
        let detail = match &self.broken {
            Some((at, told)) => format!("at {at} s {told}, without a fault on its links"),
            None if self.links.is_empty() => "the robot names no link of its drive".to_owned(),
            None => format!(
                "commands at most {} ms apart at set-points",
                self.longest.as_millis()
            ),
        };
        Check::new(name, self.broken.is_none(), detail).if_observed(self.looks > 0)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.calm.renew(faults, rig);
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(Self {
            links: self.links.clone(),
            devices: self.devices.clone(),
            calm: self.calm.clone(),
            log: rig.log_end(),
            broken: self.broken.clone(),
            ..*self
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::super::puppet::{copied, cut, scenario};
    use super::super::tests::{linked, look_at};
    use super::*;
    use crate::robots::checker::Status;
    use crate::run::Run;

    const WITHIN: Duration = Duration::from_millis(300);

    fn fed(rig: &Rig) -> DriveFed {
        let is_meant = |link: &str| link == "base";
        let calm = Calm::of(&scenario("").0, rig, &is_meant);
        DriveFed::new(rig, vec!["base".to_owned()], WITHIN, calm)
    }

    /// The robot's program is at the other end of these links, and is no device.
    #[test]
    fn the_devices_of_the_drive_are_those_at_its_links() {
        let (scenario, source) = scenario("");
        let run = Run::new(scenario, &source, None).expect("can be wired");
        let of = |links: &[&str]| {
            let links = links.iter().map(|&link| link.to_owned()).collect();
            let fed = DriveFed::new(&run.rig, links, WITHIN, Calm::default());
            fed.devices.into_iter().collect::<Vec<_>>()
        };
        assert_eq!(of(&["base"]), ["base"]);
        assert_eq!(of(&["base", "lidar"]), ["base", "lidar"]);
        assert_eq!(of(&[]), [""; 0]);
    }

    /// A fault from 1 to 2 s, with effects to 7 s: the silence counts from then on. At rest no
    /// command is needed.
    #[test]
    fn a_drive_need_not_be_fed_during_a_fault() {
        let (mut rig, _) = linked("base");
        let mut fed = fed(&rig);
        fed.faults_changed(&[cut("base", 1, 2)], &rig);
        for millis in [900, 999] {
            look_at(&mut fed, &mut rig, millis, 0.0);
        }
        let check = fed.verdict();
        assert_eq!(
            (check.status, &*check.detail),
            (
                Status::NotObserved,
                "commands at most 0 ms apart at set-points"
            )
        );
        for millis in [1_000, 5_000, 6_999, 7_000, 7_299] {
            look_at(&mut fed, &mut rig, millis, 1.0);
        }
        assert_eq!(fed.verdict().status, Status::Pass);
        look_at(&mut fed, &mut rig, 7_300, 1.0);
        let told =
            "at 7.300000 s no command for 301 ms at set-points, without a fault on its links";
        assert_eq!(fed.verdict().detail, told);
        assert!(copied(&fed, &rig).ends_with(told));
    }

    /// A watchdog that fires during a fault does its work.
    #[test]
    fn a_watchdog_may_fire_during_a_fault() {
        let told = |event_ms: u64| {
            let (mut rig, _) = linked("base");
            let mut fed = fed(&rig);
            fed.faults_changed(&[cut("base", 1, 2)], &rig);
            fed.watch("base");
            let event = emulators::Event {
                at: Instant::from_millis(event_ms),
                kind: emulators::EventKind::Note,
                rule: "watchdog",
                detail: String::new(),
                bytes: Vec::new(),
            };
            rig.log("base", event);
            look_at(&mut fed, &mut rig, 7_500, 0.0);
            fed.verdict().status
        };
        use Status::{Fail, NotObserved};
        assert_eq!(
            [999, 1_000, 6_999, 7_000].map(told),
            [Fail, NotObserved, NotObserved, Fail]
        );
    }

    #[test]
    fn a_robot_without_a_drive_is_not_judged() {
        let (mut rig, _) = linked("base");
        let mut fed = DriveFed::new(&rig, Vec::new(), WITHIN, Calm::default());
        look_at(&mut fed, &mut rig, 9_000, 1.0);
        let check = fed.verdict();
        assert_eq!(check.status, Status::NotObserved);
        assert_eq!(check.detail, "the robot names no link of its drive");
    }
}
