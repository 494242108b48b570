//! The times in which no fault of a run acts on some links.

use core::time::Duration;

use protocols::Instant;

use super::touches;
use crate::rig::Rig;
use crate::rig::fault::Window;
use crate::robots::Instruments;
use crate::scenario::{FaultSpec, Scenario};

/// Time from the end of a fault until its effects are over: queues are empty, devices work again.
pub(crate) const EFFECTS: Duration = Duration::from_secs(5);

/// The times in which no fault acts on some links.
#[derive(Clone, Debug, Default)]
pub struct Calm {
    links: Vec<String>,
    /// Time after the effects of a fault.
    more: Duration,
    /// Start and end of each fault with its effects.
    faults: Vec<(Instant, Option<Instant>)>,
}

impl Calm {
    /// The faults of `scenario` on links of `rig` that `is_meant` selects, and on their devices.
    pub(super) fn of(scenario: &Scenario, rig: &Rig, is_meant: &dyn Fn(&str) -> bool) -> Self {
        let links = rig.links().iter().map(|link| link.name.clone());
        let mut new = Self {
            links: links.filter(|link| is_meant(link)).collect(),
            ..Self::default()
        };
        new.renew(&scenario.fault, rig);
        new
    }

    /// The same times with `more` after each fault.
    pub(super) fn longer_by(mut self, more: Duration) -> Self {
        for until in self
            .faults
            .iter_mut()
            .filter_map(|(_, until)| until.as_mut())
        {
            *until += more;
        }
        self.more += more;
        self
    }

    /// Replaces the faults by those that the run has now. A fault that waits for a condition, a
    /// byte or a frame does not act yet.
    pub(super) fn renew(&mut self, faults: &[FaultSpec], rig: &Rig) {
        let is_meant = |link: &str| self.links.iter().any(|own| own == link);
        let faults = faults
            .iter()
            .filter(|fault| !fault.waits_for_condition() && !fault.waits_for_trigger());
        let faults = faults.filter(|fault| touches(fault, rig, &is_meant));
        let times = |fault: &FaultSpec| {
            let Window { from, until } = fault.window();
            let has_end = until < Window::ALWAYS.until;
            (from, has_end.then(|| until + EFFECTS + self.more))
        };
        self.faults = faults.map(times).collect();
    }

    /// Whether no fault acts at `now`.
    pub(super) fn is(&self, now: Instant) -> bool {
        let acts = |(from, until): &(Instant, Option<Instant>)| {
            now >= *from && until.is_none_or(|until| now < until)
        };
        !self.faults.iter().any(acts)
    }

    /// Start of the first fault.
    fn first(&self) -> Option<Instant> {
        self.faults.iter().map(|(from, _)| *from).min()
    }
}

/// The time until the first event that may mislead a robot's sensors: a push, a contact, or a
/// fault, except on a link of its station.
#[derive(Clone, Debug, Default)]
pub struct Undisturbed {
    calm: Calm,
    /// The first push or contact.
    hit: Option<Instant>,
}

impl Undisturbed {
    pub(super) fn of(scenario: &Scenario, rig: &Rig, instruments: &dyn Instruments) -> Self {
        let station = instruments.station_links();
        let pushes = scenario.world.push.iter().map(|push| push.at.instant());
        Self {
            calm: Calm::of(scenario, rig, &|link| !station.contains(&link)),
            hit: pushes.min(),
        }
    }

    /// Ends the undisturbed time with a push or contact at `now`.
    pub(super) fn hit_at(&mut self, now: Instant) {
        self.hit = Some(self.hit.map_or(now, |hit| hit.min(now)));
    }

    /// Whether the undisturbed time has ended.
    pub(super) fn is_over(&self, now: Instant) -> bool {
        let mut ends = self.hit.into_iter().chain(self.calm.first());
        ends.any(|end| now >= end)
    }

    /// Replaces the faults by those that the run has now.
    pub(super) fn renew(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.calm.renew(faults, rig);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fault from 2 to 3 s, whose effects last to 8 s, and one from 20 s without an end.
    #[test]
    fn it_is_calm_before_a_fault_and_behind_its_effects() {
        let at = Instant::from_secs;
        let calm = Calm {
            faults: vec![(at(2), Some(at(3) + EFFECTS)), (at(20), None)],
            ..Calm::default()
        };
        let seconds = [0, 1, 2, 5, 7, 8, 19, 20, 999];
        let found = seconds.map(|second| calm.is(at(second)));
        assert_eq!(
            found,
            [true, true, false, false, false, true, true, false, false]
        );
        let longer = calm.clone().longer_by(Duration::from_secs(2));
        assert_eq!([9, 10].map(|second| longer.is(at(second))), [false, true]);
        assert_eq!(longer.more, Duration::from_secs(2));
        assert_eq!((calm.first(), Calm::default().first()), (Some(at(2)), None));
        assert!(Calm::default().is(at(0)));
    }

    /// The first push, contact or fault ends the undisturbed time.
    #[test]
    fn the_first_hit_or_fault_disturbs() {
        let at = Instant::from_secs;
        let mut quiet = Undisturbed::default();
        assert!(!quiet.is_over(at(999)));
        quiet.hit_at(at(9));
        quiet.hit_at(at(5));
        quiet.hit_at(at(7));
        assert_eq!(
            [4, 5, 6].map(|second| quiet.is_over(at(second))),
            [false, true, true]
        );
        quiet.calm.faults = vec![(at(3), Some(at(4)))];
        assert_eq!(
            [2, 3].map(|second| quiet.is_over(at(second))),
            [false, true]
        );
    }

    /// Start and end, in seconds, of the faults of `faults` that act on `links`.
    fn times(links: &[&str], faults: &str) -> Vec<(u64, Option<u64>)> {
        let (rig, _) = crate::rig::bare::linked(["lidar", "base"], 1_000_000);
        let (scenario, _) = super::super::puppet::scenario(faults);
        let calm = Calm::of(&scenario, &rig, &|link| links.contains(&link));
        let seconds = |at: Instant| at.as_millis() / 1_000;
        let faults = calm.faults.iter();
        faults
            .map(|(from, until)| (seconds(*from), until.map(seconds)))
            .collect()
    }

    /// Effects last for 5 s. A fault of a device acts on its links, one between two links on both.
    #[test]
    fn faults_act_on_links_and_on_the_links_of_devices() {
        let cut = "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\n";
        let timed = format!("{cut}from = \"2s\"\nuntil = \"3s\"\n");
        assert_eq!(times(&["lidar"], &timed), [(2, Some(8))]);
        assert_eq!(times(&["base", "lidar"], &timed), [(2, Some(8))]);
        assert_eq!(times(&["base"], &timed), []);
        assert_eq!(times(&[], &timed), []);
        assert_eq!(times(&["lidar"], cut), [(0, None)]);
        let lasting = format!("{cut}from = \"2s\"\nlasting = \"4s\"\n");
        assert_eq!(times(&["lidar"], &lasting), [(2, Some(11))]);
        let device = "[[fault]]\nkind = \"off\"\ndevice = \"lidar\"\nfrom = \"4s\"\n";
        assert_eq!(times(&["lidar"], device), [(4, None)]);
        assert_eq!(times(&["base"], device), []);
        let devices = "[[fault]]\nkind = \"power-dip\"\ndevices = [\"base\", \"lidar\"]\n\
                       from = \"4s\"\nuntil = \"5s\"\n";
        assert_eq!(times(&["lidar"], devices), [(4, Some(10))]);
        let both = "[[fault]]\nkind = \"swizzle\"\nlink = \"lidar\"\nwith = \"base\"\n\
                    direction = \"to-master\"\nfrom = \"1s\"\nuntil = \"2s\"\n";
        assert_eq!(times(&["base"], both), [(1, Some(7))]);
    }

    /// A fault that waits does not act yet.
    #[test]
    fn a_fault_that_waits_is_calm() {
        let cut = "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\n\
                   lasting = \"1s\"\n";
        for key in [
            "at_byte = 50",
            "at_frame = 5",
            "begins_when = { robot = { of = \"x-m\", op = \">\", value = 99 } }",
        ] {
            assert_eq!(times(&["lidar"], &format!("{cut}{key}\n")), [], "{key}");
        }
    }

    /// What was added to the effects stays when the faults change.
    #[test]
    fn other_faults_have_the_same_effects() {
        use super::super::puppet::{cut, scenario};
        let (rig, _) = crate::rig::bare::linked(["lidar"], 1_000_000);
        let calm = Calm::of(&scenario("").0, &rig, &|link| link == "lidar");
        let mut calm = calm.longer_by(Duration::from_secs(2));
        calm.renew(&[cut("lidar", 1, 2), cut("base", 20, 21)], &rig);
        let at = Instant::from_secs;
        assert_eq!(calm.faults, [(at(1), Some(at(9)))]);
        calm.renew(&[], &rig);
        assert_eq!(calm.faults, []);
    }

    /// Two pushes, and faults at the lidar and at the station's radio.
    #[test]
    fn the_first_push_or_fault_of_a_sensor_disturbs() {
        use super::super::puppet::{cut, scenario};
        struct Robot;
        impl Instruments for Robot {
            fn station_links(&self) -> &'static [&'static str] {
                &["radio"]
            }
        }
        let (rig, _) = crate::rig::bare::linked(["lidar", "radio"], 1_000_000);
        let push = |at: u32| {
            format!("[[world.push]]\nat = \"{at}s\"\nby_m = [0.1, 0]\nover = \"100ms\"\n")
        };
        let pushed = scenario(&(push(9) + &push(4))).0;
        let at = Instant::from_secs;
        let mut quiet = Undisturbed::of(&pushed, &rig, &Robot);
        assert_eq!(
            [3, 4].map(|second| quiet.is_over(at(second))),
            [false, true]
        );
        quiet.renew(&[cut("radio", 1, 2)], &rig);
        assert!(!quiet.is_over(at(3)));
        quiet.renew(&[cut("lidar", 2, 3)], &rig);
        assert_eq!(
            [1, 2].map(|second| quiet.is_over(at(second))),
            [false, true]
        );
    }
}
