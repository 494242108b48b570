//! Rules of devices that the program broke.

use protocols::Instant;

use super::{Check, Checker, Look, VIOLATIONS};
use crate::rig::Rig;
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
    /// The violations when the time began, and now.
    tallies: Option<[Tally; 2]>,
}

/// Violations up to a moment.
#[derive(Clone, Debug)]
struct Tally {
    total: u64,
    /// Device, rule and number.
    rules: Vec<(String, &'static str, u64)>,
}

impl Tally {
    fn of(rig: &Rig) -> Self {
        Self {
            total: rig.violations(),
            rules: rig.all_broken_rules(),
        }
    }

    fn count(&self, device: &str, rule: &str) -> u64 {
        let mut rules = self.rules.iter();
        let found = rules.find(|(of, known, _)| of == device && *known == rule);
        found.map_or(0, |(.., count)| *count)
    }
}

impl ViolationsLater {
    /// The checker of the expectations `expect`; `None` if they judge the whole run.
    pub fn of(expect: &Expect) -> Option<Self> {
        let safety = expect.safety.as_ref();
        Some(Self {
            max: expect.violations_max?,
            from: expect.violations_from?.instant(),
            exempt: safety.map_or(Vec::new(), |safety| safety.alive_without.clone()),
            tallies: None,
        })
    }
}

impl Checker for ViolationsLater {
    fn observe(&mut self, look: &Look<'_>) {
        let rig = look.rig;
        if rig.now() < self.from {
            return;
        }
        match &mut self.tallies {
            None => self.tallies = Some([Tally::of(rig), Tally::of(rig)]),
            Some([_, now]) if now.total == rig.violations() => {}
            Some([_, now]) => *now = Tally::of(rig),
        }
    }

    fn verdict(&self) -> Check {
        let from = self.from;
        let Some([before, now]) = &self.tallies else {
            let detail = format!("the run ended before {from} s, the time of the judgement");
            return Check::not_observed(VIOLATIONS, detail);
        };
        let (mut exempt, mut words) = (0, Vec::new());
        for (device, rule, count) in &now.rules {
            let more = count - before.count(device, rule);
            match self.exempt.contains(device) {
                true => exempt += more,
                false if more > 0 => words.push(format!("{more} times {rule} of {device}")),
                false => {}
            }
        }
        let (found, max) = ((now.total - before.total).saturating_sub(exempt), self.max);
        let mut detail = format!("{found} broken rules from {from} s on, at most {max}");
        if found > 0 {
            detail += &format!(": {}", words.join(", "));
        }
        Check::new(VIOLATIONS, found <= max, detail)
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}
