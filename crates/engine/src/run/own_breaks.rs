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
}
