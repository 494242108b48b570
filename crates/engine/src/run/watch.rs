//! The checkers and observers of a run: the same for a run and for a replay.

use std::sync::Arc;

use emulators::world::Contact;

use protocols::Instant;

use super::check::{self, Check, Checker, Look};
use super::rules::Rules;
use crate::rig::Rig;
use crate::robots::Instruments;
use crate::scenario::{FaultSpec, SafetySpec, Scenario};

/// The checkers of a run, selected by its robot and its rig.
pub struct Watchers {
    checkers: Vec<Box<dyn Checker>>,
    rules: Rules,
    safety: Option<SafetySpec>,
}

impl Watchers {
    /// The watchers that suit `scenario`, wired as `rig`.
    pub fn of(scenario: &Scenario, rig: &mut Rig, instruments: &Arc<dyn Instruments>) -> Self {
        let safety = scenario.expect.safety.as_ref();
        let contacts_until = safety.and_then(|safety| safety.contacts_until);
        let contacts_until = contacts_until.map(|until| until.instant());
        let mut checkers = check::standard(rig, &**instruments, contacts_until);
        if let Some(phases) = scenario.phases {
            checkers.push(Box::new(check::AtWorkAgain::new(
                phases.windows(),
                instruments.sporadic_links(),
            )));
        }
        checkers.extend(check::safety::asked_for(scenario, rig, instruments));
        let later = check::ViolationsLater::of(scenario, instruments.station_links());
        checkers.extend(later.map(|later| Box::new(later) as Box<dyn Checker>));
        let safety = scenario.expect.safety.clone();
        Self {
            checkers,
            rules: Rules::of(scenario, rig, &**instruments),
            safety,
        }
    }

    /// The same watchers for a copy of the rig; `None` if one of them cannot be copied.
    pub(crate) fn fork(&self, rig: &mut Rig) -> Option<Self> {
        let checkers = self.checkers.iter().map(|checker| checker.fork(rig));
        let checkers = checkers.collect::<Option<Vec<_>>>()?;
        let safety = self.safety.clone();
        Some(Self {
            checkers,
            rules: self.rules.fork(rig),
            safety,
        })
    }

    /// The faults of the run are now `faults`.
    pub(crate) fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        let checkers = self.checkers.iter_mut();
        checkers.for_each(|checker| checker.faults_changed(faults, rig));
    }

    /// The station gives an order at `at` that has no time in the scenario.
    pub(super) fn ordered(&mut self, at: Instant) {
        let checkers = self.checkers.iter_mut();
        checkers.for_each(|checker| checker.ordered(at));
    }

    /// Adds a checker.
    pub(crate) fn add(&mut self, checker: Box<dyn Checker>) {
        self.checkers.push(checker);
    }

    /// Updates all checkers; `contacts` are the contacts since the last update.
    pub fn look(&mut self, rig: &Rig, instruments: &dyn Instruments, contacts: &[Contact]) {
        let axes = instruments.axes(rig);
        let look = Look {
            rig,
            axes: &axes,
            contacts,
        };
        let checkers = self.checkers.iter_mut();
        checkers.for_each(|checker| checker.observe(&look));
        self.rules.look(rig, instruments, &axes, contacts);
    }

    /// Whether a rule still waits for an event that must come before the run ends.
    pub(super) fn awaits(&self, now: Instant) -> bool {
        self.rules.awaits(now)
    }

    /// The result of each checker and rule at `now`; failures that the scenario excuses are not
    /// observed. `is_over`: no condition can become true any more.
    pub fn verdicts(&self, now: Instant, is_over: bool) -> Vec<Check> {
        let checkers = self.checkers.iter();
        let mut checks: Vec<Check> = checkers.map(|checker| checker.verdict()).collect();
        checks.extend(self.rules.checks(now, is_over));
        if let Some(safety) = &self.safety {
            checks.iter_mut().for_each(|check| safety.excuse(check));
        }
        checks
    }
}
