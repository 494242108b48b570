//! Rules of devices that the program broke.

use protocols::Instant;

use super::safety::EFFECTS;
use super::{Check, Checker, Look, VIOLATIONS};
use crate::rig::Rig;
use crate::rig::fault::Window;
use crate::scenario::{FaultSpec, Scenario};

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
    /// Begin of each fault that has an end, and the end of its effects: violations in between do
    /// not count. A fault that waits for a condition may begin at any time.
    faults: Vec<[Instant; 2]>,
    /// The violations when the current time of counting began, and now.
    tallies: Option<[Tally; 2]>,
    /// The violations of earlier times of counting.
    found: Tally,
    is_observed: bool,
    /// Whether the time from which violations count has come.
    has_come: bool,
}

/// Violations up to a moment, or between two.
#[derive(Clone, Debug, Default)]
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

    /// Adds the violations between two moments.
    fn add(&mut self, [before, now]: &[Self; 2]) {
        self.total += now.total.saturating_sub(before.total);
        for (device, rule, count) in &now.rules {
            let more = count.saturating_sub(before.count(device, rule));
            let mut rules = self.rules.iter_mut();
            match rules.find(|(of, known, _)| of == device && known == rule) {
                Some((.., sum)) => *sum += more,
                None => self.rules.push((device.clone(), rule, more)),
            }
        }
    }
}

impl ViolationsLater {
    /// The checker of the expectations of `scenario`; `None` if they judge the whole run.
    pub fn of(scenario: &Scenario) -> Option<Self> {
        let expect = &scenario.expect;
        let safety = expect.safety.as_ref();
        Some(Self {
            max: expect.violations_max?,
            from: expect.violations_from?.instant(),
            exempt: safety.map_or(Vec::new(), |safety| safety.alive_without.clone()),
            faults: times(&scenario.fault),
            tallies: None,
            found: Tally::default(),
            is_observed: false,
            has_come: false,
        })
    }
}

/// Begin of each of `faults` that has begun or will begin at its time and has an end, and the end
/// of its effects.
fn times(faults: &[FaultSpec]) -> Vec<[Instant; 2]> {
    let faults = faults
        .iter()
        .filter(|fault| !fault.waits_for_condition() && !fault.waits_for_trigger());
    let times = faults.filter_map(|fault| {
        let Window { from, until } = fault.window();
        (until < Window::ALWAYS.until).then(|| [from, until + EFFECTS])
    });
    times.collect()
}

impl Checker for ViolationsLater {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        let mut faults = self.faults.iter();
        let counts =
            now >= self.from && !faults.any(|[from, until]| (*from..*until).contains(&now));
        match &mut self.tallies {
            Some(tallies) if !counts => {
                self.found.add(tallies);
                self.tallies = None;
            }
            None if counts => self.tallies = Some([Tally::of(rig), Tally::of(rig)]),
            Some([_, now]) if now.total != rig.violations() => *now = Tally::of(rig),
            _ => {}
        }
        self.is_observed |= counts;
        self.has_come |= now >= self.from;
    }

    fn verdict(&self) -> Check {
        let from = self.from;
        if !self.is_observed {
            let detail = match self.has_come {
                true => format!("from {from} s on, faults and their effects lasted to the end"),
                false => format!("the run ended before {from} s, the time of the judgement"),
            };
            return Check::not_observed(VIOLATIONS, detail);
        }
        let mut all = self.found.clone();
        if let Some(tallies) = &self.tallies {
            all.add(tallies);
        }
        let (mut exempt, mut words) = (0, Vec::new());
        for (device, rule, count) in &all.rules {
            match self.exempt.contains(device) {
                true => exempt += count,
                false if *count > 0 => words.push(format!("{count} times {rule} of {device}")),
                false => {}
            }
        }
        let (found, max) = (all.total.saturating_sub(exempt), self.max);
        let mut detail = format!("{found} broken rules from {from} s on, at most {max}");
        if found > 0 {
            detail += &format!(": {}", words.join(", "));
        }
        Check::new(VIOLATIONS, found <= max, detail)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], _rig: &Rig) {
        self.faults = times(faults);
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}
