//! Rules of devices that the program broke.

use protocols::Instant;

use super::{Check, Checker, Look, VIOLATIONS};
use crate::rig::{Logged, Rig};
use crate::scenario::Expect;

/// Whether at most `max` rules were broken in the whole run.
pub(crate) fn violations(max: u64, rig: &Rig) -> Check {
    let found = rig.violations();
    let mut detail = format!("{found} broken rules, at most {max}");
    let mut events = rig.events().iter();
    if let Some(first) = events.find(|logged| logged.is_violation()) {
        detail += &format!("; first: {first}");
    }
    let is_asked = rig.was_asked();
    if !is_asked && found == 0 {
        "no device received a byte".clone_into(&mut detail);
    }
    Check::new(VIOLATIONS, found <= max, detail).if_observed(is_asked)
}

/// At most so many rules were broken after the faults of a run.
#[derive(Clone, Debug)]
pub struct ViolationsLater {
    max: u64,
    from: Instant,
    /// Links with faults to the end.
    exempt: Vec<String>,
    /// Numbers of violations when the time began, and now.
    counts: [Option<u64>; 2],
    first: Option<String>,
}

impl ViolationsLater {
    /// The checker of the expectations `expect`; `None` if they judge the whole run.
    pub fn of(expect: &Expect) -> Option<Self> {
        let safety = expect.safety.as_ref();
        Some(Self {
            max: expect.violations_max?,
            from: expect.violations_from?.instant(),
            exempt: safety.map_or(Vec::new(), |safety| safety.alive_without.clone()),
            counts: [None; 2],
            first: None,
        })
    }

    fn count(&self, rig: &Rig) -> u64 {
        let broken = rig.broken_rules();
        let counted = broken.filter(|(device, ..)| !self.is_exempt(device));
        counted.map(|(.., count)| count).sum()
    }

    fn is_exempt(&self, device: &str) -> bool {
        self.exempt.iter().any(|link| link == device)
    }

    fn is_first(&self, logged: &Logged) -> bool {
        logged.is_violation() && logged.event.at >= self.from && !self.is_exempt(&logged.source)
    }
}

impl Checker for ViolationsLater {
    fn observe(&mut self, look: &Look<'_>) {
        let rig = look.rig;
        if rig.now() < self.from {
            return;
        }
        let count = self.count(rig);
        self.counts[0].get_or_insert(count);
        if self.counts[1].replace(count) < Some(count) && self.first.is_none() {
            let mut events = rig.events().iter();
            let first = events.find(|logged| self.is_first(logged));
            self.first = first.map(ToString::to_string);
        }
    }

    fn verdict(&self) -> Check {
        let from = self.from;
        let [Some(before), Some(now)] = self.counts else {
            let detail = format!("the run ended before {from} s, the time of the judgement");
            return Check::not_observed(VIOLATIONS, detail);
        };
        let (found, max) = (now - before, self.max);
        let mut detail = format!("{found} broken rules from {from} s on, at most {max}");
        if let Some(first) = &self.first {
            detail += &format!("; first: {first}");
        }
        Check::new(VIOLATIONS, found <= max, detail)
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}
