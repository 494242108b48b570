//! Broken rules that no fault explains: a frame that a fault damages on its way to the device is no
//! mistake of the program.

use core::time::Duration;

use protocols::Instant;

use crate::rig::line::Direction;
use crate::rig::{LogPoint, NO_FRAME, Rig};
use crate::scenario::{DirectionSpec, FaultKind, FaultSpec, is_place_of};

/// Maximum time from damage to the report of the device: it may wait for the rest of a cut frame
/// until the next request.
const REACH: Duration = Duration::from_secs(2);
/// Number of reports that one damaged byte explains: its own frame in up to two pieces, and the
/// next one, whose start is taken for the missing rest.
const REPORTS: u32 = 4;

/// A rule of a device that the program broke.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OwnBreaks {
    /// Name of the device.
    pub device: String,
    /// The rule.
    pub rule: &'static str,
    /// Number of breaks without those of damaged frames.
    pub count: u64,
    /// Number of breaks of damaged frames.
    pub explained: u64,
    /// Time and words of the first break that no fault explains, if it is in the log. An entry that
    /// stands for several breaks has no words of the later ones.
    pub first: Option<(Instant, String)>,
    /// Time of the last such break that the device keeps.
    pub last: Option<Instant>,
}

/// The broken rules of all devices of `rig`, split by whether one of `faults` explains them.
pub fn own_breaks(rig: &Rig, faults: &[FaultSpec]) -> Vec<OwnBreaks> {
    let mut found: Vec<OwnBreaks> = Vec::new();
    let mut devices: Vec<(String, Damage<'_>)> = Vec::new();
    for (device, rule, count) in rig.mistakes() {
        if devices.iter().all(|(known, _)| *known != device) {
            devices.push((device.clone(), Damage::of(rig, faults, &device)));
        }
        found.push(OwnBreaks {
            device,
            rule,
            count,
            explained: 0,
            first: None,
            last: None,
        });
    }
    let (moments, _) = rig.log_since(&LogPoint::default());
    for moment in moments {
        let device = devices.iter_mut().find(|(name, _)| name == moment.source);
        let is_it = |one: &&mut OwnBreaks| one.device == moment.source && one.rule == moment.rule;
        let (Some((_, damage)), Some(broken)) = (device, found.iter_mut().find(is_it)) else {
            continue;
        };
        if broken.count > 0 && damage.explains(moment.at) {
            broken.count -= 1;
            broken.explained += 1;
            continue;
        }
        broken.last = Some(moment.at);
        if broken.first.is_none() {
            let mut events = rig.events().iter();
            let logged = events.find(|logged| {
                let event = &logged.event;
                (&*logged.source, event.rule, event.at) == (moment.source, moment.rule, moment.at)
            });
            let detail = logged.map(|logged| logged.event.detail.clone());
            broken.first = Some((moment.at, detail.unwrap_or_default()));
        }
    }
    // A device keeps a limited number of moments. If a lasting fault explains all kept ones, it
    // also explains the others.
    for broken in found.iter_mut().filter(|broken| broken.first.is_none()) {
        let damage = devices.iter().find(|(name, _)| *name == broken.device);
        if broken.explained > 0 && damage.is_some_and(|(_, damage)| !damage.lasting.is_empty()) {
            broken.explained += core::mem::take(&mut broken.count);
        }
    }
    // A device that finds no frame logs nothing.
    for broken in found.iter_mut().filter(|broken| broken.rule == NO_FRAME) {
        let damage = devices.iter().find(|(name, _)| *name == broken.device);
        let explained = damage.map_or(0, |(_, damage)| damage.frames().min(broken.count));
        broken.count -= explained;
        broken.explained += explained;
    }
    found
}

/// Damage on the way to one device.
struct Damage<'a> {
    /// Damaged bytes: the time of each, and the number of reports that it can still explain.
    strikes: Vec<(Instant, u32)>,
    /// Faults that last.
    lasting: Vec<&'a FaultSpec>,
}

impl<'a> Damage<'a> {
    fn of(rig: &Rig, faults: &'a [FaultSpec], device: &str) -> Self {
        let links = rig.links().iter();
        let links = links.filter(|link| is_place_of(device, &link.name));
        let struck = links.flat_map(|link| link.line(Direction::ToDevice).faults.struck_times());
        let mut strikes: Vec<_> = struck.map(|(_, at)| (at, REPORTS)).collect();
        strikes.sort_unstable();
        let acts = |fault: &&FaultSpec| {
            let is_towards = fault.direction != Some(DirectionSpec::ToMaster);
            // An echo lets a device receive its own bytes.
            let is_both = matches!(fault.kind, FaultKind::Unplugged | FaultKind::Echo);
            fault.is_at(device) && (is_towards || is_both) && !fault.kind.is_strike()
        };
        Self {
            strikes,
            lasting: faults.iter().filter(acts).collect(),
        }
    }

    /// Whether damage explains a report at `at`; each damaged byte explains few.
    fn explains(&mut self, at: Instant) -> bool {
        let is_near = |from: Instant, until: Instant| from <= at && at - until.min(at) <= REACH;
        let lasts = |fault: &&FaultSpec| {
            let is_known = !fault.waits_for_condition() && !fault.waits_for_trigger();
            !is_known || is_near(fault.window().from, fault.window().until)
        };
        if self.lasting.iter().any(lasts) {
            return true;
        }
        let mut near = self.strikes.iter_mut().rev();
        let near = near.find(|(struck, left)| *left > 0 && is_near(*struck, *struck));
        near.is_some_and(|(_, left)| {
            *left -= 1;
            true
        })
    }

    /// Number of frames that damage can spoil.
    fn frames(&self) -> u64 {
        match self.lasting.is_empty() {
            true => self.strikes.iter().map(|(_, left)| u64::from(*left)).sum(),
            false => u64::MAX,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes damaged at 10 and 11 s explain four reports each, in the two seconds after them; the
    /// later one is used first.
    #[test]
    fn damaged_bytes_explain_few_reports() {
        let at = Instant::from_secs;
        let damage = || Damage {
            strikes: vec![(at(10), REPORTS), (at(11), REPORTS)],
            lasting: Vec::new(),
        };
        let explains = |second: u64| damage().explains(at(second));
        assert_eq!(
            [9, 10, 12, 13, 14].map(explains),
            [false, true, true, true, false]
        );
        let mut damage = damage();
        assert_eq!(damage.frames(), 8);
        let found: Vec<bool> = (0..9).map(|_| damage.explains(at(12))).collect();
        assert_eq!(found, [vec![true; 8], vec![false]].concat());
        assert_eq!((damage.frames(), damage.strikes[0].1), (0, 0));
    }

    /// A fault that lasts explains everything in its time and two seconds after it.
    #[test]
    fn a_lasting_fault_explains_all_reports_of_its_time() {
        let text = "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"60s\"\n\
            [world]\nstart = { x_m = 1, y_m = 1, heading_deg = 0 }\n\
            [[fault]]\nlink = \"base\"\nkind = \"wrong-baud\"\nbaud = 9600\nfrom = \"10s\"\nuntil = \"20s\"\n";
        let (scenario, _) = crate::scenario::Scenario::from_text(text).expect("sound");
        let mut damage = Damage {
            strikes: Vec::new(),
            lasting: scenario.fault.iter().collect(),
        };
        let explains = |second| damage.explains(Instant::from_secs(second));
        assert_eq!(
            [9, 10, 20, 22, 23].map(explains),
            [false, true, true, true, false]
        );
        let damage = Damage {
            strikes: Vec::new(),
            lasting: scenario.fault.iter().collect(),
        };
        assert_eq!(damage.frames(), u64::MAX);
    }

    use emulators::{Event, EventKind};

    use crate::rig::bare::linked;
    use crate::run::check::safety::puppet::cut;

    fn broken(rig: &mut Rig, second: u64, device: &str, rule: &'static str) {
        let event = Event {
            at: Instant::from_secs(second),
            kind: EventKind::Violation,
            rule,
            detail: format!("of {second} s"),
            bytes: Vec::new(),
        };
        rig.log(device, event);
    }

    /// A fault on the way to the base from 10 to 20 s; the arm has none.
    #[test]
    fn breaks_in_the_time_of_a_fault_are_explained() {
        let (mut rig, _) = linked(["base", "arm"], 1_000_000);
        for (second, device, rule) in [
            (9, "base", "bad-checksum"),
            (10, "base", "bad-checksum"),
            (15, "arm", "bad-checksum"),
            (21, "base", "too-soon"),
            (22, "base", "bad-checksum"),
            (23, "base", "bad-checksum"),
        ] {
            broken(&mut rig, second, device, rule);
        }
        let to_device = |fault: FaultSpec| FaultSpec {
            direction: Some(DirectionSpec::ToDevice),
            ..fault
        };
        let found = |faults: &[FaultSpec]| {
            let all = own_breaks(&rig, faults).into_iter();
            all.map(|one| {
                (
                    one.device,
                    one.rule,
                    one.count,
                    one.explained,
                    one.first,
                    one.last,
                )
            })
            .collect::<Vec<_>>()
        };
        let at = Instant::from_secs;
        let first = |second: u64| Some((at(second), format!("of {second} s")));
        let base = |rule, count, explained, from: Option<u64>, last: Option<u64>| {
            let from = from.and_then(first);
            (
                "base".to_owned(),
                rule,
                count,
                explained,
                from,
                last.map(at),
            )
        };
        let arm = (
            "arm".to_owned(),
            "bad-checksum",
            1,
            0,
            first(15),
            Some(at(15)),
        );
        let none = [
            base("bad-checksum", 4, 0, Some(9), Some(23)),
            arm.clone(),
            base("too-soon", 1, 0, Some(21), Some(21)),
        ];
        assert_eq!(found(&[]), none);
        // The way back does not matter.
        assert_eq!(found(&[cut("base", 10, 20)]), none);
        let explained = [
            base("bad-checksum", 2, 2, Some(9), Some(23)),
            arm,
            base("too-soon", 0, 1, None, None),
        ];
        assert_eq!(found(&[to_device(cut("base", 10, 20))]), explained);
    }

    /// An echo and an unplugged cable act both ways; a fault of a single byte is known by its
    /// strikes.
    #[test]
    fn some_faults_of_the_way_back_reach_the_device() {
        let (rig, _) = linked(["base"], 1_000_000);
        let lasting = |kind: FaultKind, direction| {
            let fault = FaultSpec::on("base", direction, kind);
            let faults = [fault];
            Damage::of(&rig, &faults, "base").lasting.len()
        };
        let (up, down) = (DirectionSpec::ToMaster, DirectionSpec::ToDevice);
        for (kind, expected) in [
            (FaultKind::Cut, [0, 1]),
            (FaultKind::Echo, [1, 1]),
            (FaultKind::Unplugged, [1, 1]),
            (FaultKind::Flip, [0, 0]),
        ] {
            let found = [up, down].map(|direction| lasting(kind, direction));
            assert_eq!(found, expected, "{kind:?}");
        }
        let other = [FaultSpec::on("arm", down, FaultKind::Cut)];
        assert!(Damage::of(&rig, &other, "base").lasting.is_empty());
        assert_eq!(Damage::of(&rig, &other, "base").frames(), 0);
    }

    /// A fault that waits may begin at any time.
    #[test]
    fn a_fault_that_waits_explains_everything() {
        let mut fault = cut("base", 10, 20);
        let mut damage = Damage {
            strikes: Vec::new(),
            lasting: vec![&fault],
        };
        assert!(!damage.explains(Instant::from_secs(5)));
        fault.at_byte = Some(9);
        let mut damage = Damage {
            strikes: Vec::new(),
            lasting: vec![&fault],
        };
        assert!(damage.explains(Instant::from_secs(5)));
    }

    /// A device that found no frame among 40 bytes made three mistakes. Two damaged bytes on its
    /// line explain up to eight, a fault that lasts any number.
    #[test]
    fn damage_explains_that_a_device_found_no_frame() {
        use emulators::Device;
        use emulators::world::World;
        use protocols::{LineConfig, Port};

        use crate::rig::fault::{Damage as Strikes, Strike};
        use crate::rig::line::End;

        #[derive(Clone)]
        struct Lost(u64);

        impl Device for Lost {
            fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}
            fn poll(&mut self, _: Instant, _: &mut World) {}
            fn transmit(&mut self, _: Port, _: &mut [u8]) -> usize {
                0
            }
            fn poll_at(&self) -> Option<Instant> {
                None
            }
            fn line_config(&self, _: Port) -> LineConfig {
                LineConfig::new_8n1(1_000_000)
            }
            fn take_events(&mut self) -> Vec<Event> {
                Vec::new()
            }
            fn unframed(&self) -> u64 {
                self.0
            }
        }

        let found = |bytes: u64, strikes: u64, faults: &[FaultSpec]| {
            let mut rig = crate::rig::bare::rig();
            let device = rig.add_device("base", Lost(bytes));
            let master = rig.add_outside("master", LineConfig::new_8n1(1_000_000));
            let [device, master] = [device, master].map(|node| End {
                node,
                port: Port(0),
            });
            rig.connect("base", device, master, 1);
            let line = rig.line_mut(0, Direction::ToDevice);
            for byte in 0..strikes {
                let damage = Strikes::Drop;
                line.faults.add_strike(Strike { byte, damage });
            }
            rig.inject(master.node, &[0x55; 9]);
            rig.run_until(Instant::from_secs(1));
            let all = own_breaks(&rig, faults);
            assert_eq!(all.len(), 1);
            assert_eq!((&*all[0].device, all[0].rule), ("base", NO_FRAME));
            [all[0].count, all[0].explained]
        };
        assert_eq!(found(40, 0, &[]), [3, 0]);
        assert_eq!(found(40, 2, &[]), [0, 3]);
        assert_eq!(found(160, 2, &[]), [2, 8]);
        let down = FaultSpec::on("base", DirectionSpec::ToDevice, FaultKind::Cut);
        assert_eq!(found(160, 0, &[down]), [0, 10]);
    }
}
