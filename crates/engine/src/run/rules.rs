//! Observation of the rules of `[[expect.rule]]`, from the start of a run to its end.

mod verdict;

use core::time::Duration;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use emulators::world::Contact;
use protocols::Instant;

use super::line_watch::LineWatches;
use super::mission::Progress;
use super::probe::{Probe, Truth, moments_of};
use crate::rig::Rig;
use crate::robots::conditions::Moment;
use crate::robots::{Axis, Check, Instruments};
use crate::scenario::{Condition, Demand, DeviceSpec, Flaw, RuleSpec, Scenario, UntilSpec};

/// Maximum number of kept triggers that wait for an answer. Later ones are counted only.
const PENDING_MAX: usize = 1024;

/// The rules of a run.
pub(super) struct Rules {
    rules: Vec<Rule>,
    /// Failed checks of rules that name items which this rig lacks.
    refused: Vec<Check>,
    devices: Arc<BTreeMap<String, DeviceSpec>>,
    /// Visited waypoints, for conditions that count them.
    progress: Progress,
}

/// A rule and its observations so far.
struct Rule {
    spec: Arc<RuleSpec>,
    demand: Demand,
    probes: Probes,
    seen: Seen,
}

/// The conditions of a rule.
struct Probes {
    subject: Probe,
    after: Option<Probe>,
    until: Option<Probe>,
}

/// Observations of a rule so far.
#[derive(Clone, Debug, Default)]
struct Seen {
    /// Number of moments in which the rule applied and its condition was true or false.
    moments: u64,
    /// Whether the rule has applied at all.
    has_applied: bool,
    /// Number of triggers: times at which `after` became true.
    triggers: u64,
    last_trigger: Option<Instant>,
    /// Last value of `after`.
    was_after: Truth,
    /// Time from which a rule with `after` applies.
    armed_since: Option<Instant>,
    /// Triggers that wait for their answers, oldest first.
    pending: VecDeque<Instant>,
    /// Number of later triggers that also wait. One answer serves all of them, and the oldest
    /// trigger is due first.
    more_pending: u64,
    /// Whether later triggers were not kept although each needs its own answer.
    is_overfull: bool,
    /// Whether `until` has ended the rule.
    is_over: bool,
    /// Time at which the condition of an `eventually` or `sometimes` first became true, and the
    /// observed value.
    met: Option<(Instant, String)>,
    answers: u64,
    /// Longest time from a trigger to its answer, and the time of the trigger.
    slowest: Option<(Duration, Instant)>,
    /// Time and description of the first break.
    broken: Option<(Instant, String)>,
    breaks: u64,
    was_broken: bool,
    /// Whether the robot has moved; a robot at rest causes no contact.
    has_moved: bool,
    /// Whether the log has lost entries.
    is_log_cut: bool,
}

impl Rules {
    /// The rules of `scenario` on `rig`. A rule that names an unknown item becomes a failed check.
    pub(super) fn of(scenario: &Scenario, rig: &mut Rig, instruments: &dyn Instruments) -> Self {
        let lines = LineWatches::default();
        let progress = Progress::new(&scenario.mission, &scenario.expect);
        let devices = Arc::new(scenario.device.clone());
        let moment = Moment {
            rig,
            instruments,
            axes: None,
            devices: &devices,
            waypoints: [0, progress.waypoints()],
        };
        let (mut rules, mut refused) = (Vec::new(), Vec::new());
        // The wiring of the rig has checked the names; a rig of another crate may lack some.
        for spec in scenario.expect.rules() {
            match Rule::new(spec, &moment, &lines) {
                Ok(rule) => rules.push(rule),
                Err(flaw) => refused.push(Check::new(&spec.check_name(), false, flaw.to_string())),
            }
        }
        if !lines.is_empty() {
            rig.add_tap(Box::new(lines.clone()));
        }
        Self {
            rules,
            refused,
            devices,
            progress,
        }
    }

    /// Copies the rules with their state, for a copy of the rig.
    pub(super) fn fork(&self, rig: &mut Rig) -> Self {
        let lines = LineWatches::default();
        let rules = self.rules.iter().map(|rule| Rule {
            spec: Arc::clone(&rule.spec),
            demand: rule.demand,
            probes: rule.probes.fork(&lines),
            seen: rule.seen.clone(),
        });
        let rules = rules.collect();
        if !lines.is_empty() {
            rig.add_tap(Box::new(lines.clone()));
        }
        Self {
            rules,
            refused: self.refused.clone(),
            devices: Arc::clone(&self.devices),
            progress: self.progress.clone(),
        }
    }

    /// Judges all moments since the last sample, and the current state.
    pub(super) fn look(
        &mut self,
        rig: &Rig,
        instruments: &dyn Instruments,
        axes: &[Axis],
        contacts: &[Contact],
    ) {
        if self.rules.is_empty() {
            return;
        }
        let is_moving = rig.world.is_moving();
        self.progress
            .observe(rig.now(), rig.world.pose(), is_moving);
        let moment = Moment {
            rig,
            instruments,
            axes: Some(axes),
            devices: &self.devices,
            waypoints: [self.progress.visits().len(), self.progress.waypoints()],
        };
        for rule in &mut self.rules {
            rule.seen.has_moved |= is_moving;
            rule.seen.is_log_cut = rig.events_dropped() > 0;
            rule.look(&moment, contacts);
        }
    }

    /// Whether the run must continue because an `eventually` rule still waits.
    pub(super) fn awaits(&self, now: Instant) -> bool {
        self.rules.iter().any(|rule| rule.awaits(now))
    }

    /// The verdict of each rule. If `is_over`, no condition can become true any more.
    pub(super) fn checks(&self, now: Instant, is_over: bool) -> impl Iterator<Item = Check> {
        let checks = self.rules.iter();
        let checks = checks.map(move |rule| rule.check(now, is_over));
        checks.chain(self.refused.iter().cloned())
    }
}

impl core::fmt::Debug for Rules {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let names = self.rules.iter().map(|rule| &rule.spec.name);
        f.debug_list().entries(names).finish()
    }
}

impl Probes {
    fn all(&self) -> impl Iterator<Item = &Probe> {
        core::iter::once(&self.subject)
            .chain(&self.after)
            .chain(&self.until)
    }

    fn look(&mut self, moment: &Moment<'_>, contacts: &[Contact]) {
        self.subject.look(moment, contacts);
        let others = self.after.iter_mut().chain(&mut self.until);
        others.for_each(|probe| probe.look(moment, contacts));
    }

    fn fork(&self, lines: &LineWatches) -> Self {
        let fork = |probe: &Probe| probe.fork(lines);
        Self {
            subject: fork(&self.subject),
            after: self.after.as_ref().map(fork),
            until: self.until.as_ref().map(fork),
        }
    }
}

impl Rule {
    fn new(spec: &RuleSpec, moment: &Moment<'_>, lines: &LineWatches) -> Result<Self, Flaw> {
        let probe = |condition: &Condition| Probe::new(condition, moment, lines, false);
        let (demand, subject) = spec
            .demand()
            .ok_or_else(|| Flaw::new("always", "is missing"))?;
        let until = spec.until.as_ref().and_then(UntilSpec::condition);
        Ok(Self {
            demand,
            probes: Probes {
                subject: probe(subject)?,
                after: spec.after.as_ref().map(probe).transpose()?,
                until: until.map(probe).transpose()?,
            },
            seen: Seen::default(),
            spec: Arc::new(spec.clone()),
        })
    }

    fn look(&mut self, moment: &Moment<'_>, contacts: &[Contact]) {
        self.probes.look(moment, contacts);
        for place in moments_of(self.probes.all()) {
            self.judge(place.0, Some(place));
        }
        self.judge(moment.rig.now(), None);
    }

    /// The first and the last time at which the rule applies.
    fn window(&self) -> (Instant, Option<Instant>) {
        let from = self.spec.from.unwrap_or_default().instant();
        let until = self.spec.until.as_ref().and_then(UntilSpec::time);
        let within = self.spec.within.filter(|_| self.spec.after.is_none());
        let until = until.map(|until| until.instant());
        (from, until.or(within.map(|within| from + within.0)))
    }

    fn awaits(&self, now: Instant) -> bool {
        let (_, until) = self.window();
        let is_late = until.is_some_and(|until| now > until);
        match (self.demand, &self.spec.after) {
            (Demand::Eventually, Some(_)) => !self.seen.pending.is_empty(),
            (Demand::Eventually, None) => self.seen.met.is_none() && !is_late && !self.seen.is_over,
            _ => false,
        }
    }

    fn judge(&mut self, at: Instant, place: Option<(Instant, usize)>) {
        if self.seen.is_over {
            return;
        }
        // `after` is evaluated at all times. Otherwise a lasting state would trigger the rule again
        // when its window begins.
        let is_begun = self.has_begun_again(place);
        let (from, until) = self.window();
        let is_late = until.is_some_and(|until| at > until);
        if at < from || (is_late && self.seen.pending.is_empty()) {
            return;
        }
        self.seen.has_applied = true;
        let ended = self.probes.until.as_mut();
        if ended.and_then(|until| until.judge(place)) == Some(true) {
            return self.seen.end(self.spec.after.is_some());
        }
        let truth = self.probes.subject.judge(place);
        match self.demand {
            Demand::Always | Demand::Never => self.hold(at, truth, place.is_some()),
            Demand::Eventually | Demand::Sometimes => self.await_it(at, truth),
        }
        if is_begun && !is_late {
            self.start(at, truth, place.is_some());
        }
    }

    /// Whether `after` has changed from false to true at this moment.
    fn has_begun_again(&mut self, place: Option<(Instant, usize)>) -> bool {
        let Some(after) = &mut self.probes.after else {
            return false;
        };
        let truth = after.judge(place);
        let is_momentary = self.spec.after.as_ref();
        let is_momentary = is_momentary.is_some_and(Condition::is_momentary);
        let is_again = self.seen.was_after == Some(true) && !(place.is_some() && is_momentary);
        if truth.is_some() {
            self.seen.was_after = truth;
        }
        truth == Some(true) && !is_again
    }

    /// Whether an `always` or `never` applies at `at`.
    fn applies(&self, at: Instant) -> bool {
        if self.spec.after.is_none() {
            return true;
        }
        let (Some(since), Some(last)) = (self.seen.armed_since, self.seen.last_trigger) else {
            return false;
        };
        let within = self.spec.within.unwrap_or_default().0;
        let begins = since + within;
        let has_begun = at >= begins && at > since;
        has_begun && self.ends_after(last).is_none_or(|end| at <= end)
    }

    /// End of an `always` or `never` whose last trigger was at `last`.
    fn ends_after(&self, last: Instant) -> Option<Instant> {
        let within = self.spec.within.unwrap_or_default().0;
        self.spec.lasting.map(|lasting| last + within + lasting.0)
    }

    fn hold(&mut self, at: Instant, truth: Truth, is_momentary: bool) {
        if !self.applies(at) {
            return;
        }
        // A value that cannot be compared breaks the rule, so that the verdict shows it.
        let is_broken = match truth {
            Some(truth) => truth != (self.demand == Demand::Always),
            None if self.probes.subject.is_incomparable() => true,
            None => return,
        };
        self.seen.moments += 1;
        if is_broken && (is_momentary || !self.seen.was_broken) {
            self.seen.breaks += 1;
            if self.seen.broken.is_none() {
                self.seen.broken = Some((at, self.probes.subject.words()));
            }
        }
        self.seen.was_broken = is_broken;
    }

    fn await_it(&mut self, at: Instant, truth: Truth) {
        self.seen.moments += u64::from(truth.is_some());
        if self.spec.after.is_some() {
            return self.answer(at, truth == Some(true));
        }
        if truth == Some(true) && self.seen.met.is_none() {
            self.seen.met = Some((at, self.probes.subject.words()));
        }
    }

    /// Breaks overdue triggers and, if the condition holds at `at`, answers the waiting ones: the
    /// oldest one with `each`, otherwise all.
    fn answer(&mut self, at: Instant, holds: bool) {
        if let Some(within) = self.spec.within {
            let is_due = |asked: &Instant| at > *asked + within.0;
            while let Some(asked) = self.seen.pending.pop_front_if(|asked| is_due(asked)) {
                self.miss(asked, asked + within.0);
            }
        }
        if !holds {
            return;
        }
        let waiting = self.seen.pending.len();
        let answered = match self.spec.each {
            true => waiting.min(1),
            false => waiting,
        };
        for asked in self.seen.pending.drain(..answered) {
            self.seen.answers += 1;
            let took = at - asked;
            if self.seen.slowest.is_none_or(|(most, _)| took > most) {
                self.seen.slowest = Some((took, asked));
            }
        }
        self.seen.answers += core::mem::take(&mut self.seen.more_pending);
        if answered > 0 && self.seen.met.is_none() {
            self.seen.met = Some((at, self.probes.subject.words()));
        }
    }

    /// Records that the trigger at `asked` got no answer until `deadline`.
    fn miss(&mut self, asked: Instant, deadline: Instant) {
        self.seen.breaks += 1;
        if self.seen.broken.is_none() {
            let words = format!("asked at {asked} s, not {} until then", self.subject());
            self.seen.broken = Some((deadline, words));
        }
    }

    /// Handles a trigger: `after` has become true.
    fn start(&mut self, at: Instant, truth: Truth, is_moment: bool) {
        self.seen.triggers += 1;
        let is_done = self
            .seen
            .last_trigger
            .and_then(|last| self.ends_after(last));
        if self.seen.armed_since.is_none() || is_done.is_some_and(|end| at > end) {
            self.seen.armed_since = Some(at);
        }
        self.seen.last_trigger = Some(at);
        if !matches!(self.demand, Demand::Eventually | Demand::Sometimes) {
            return;
        }
        match (self.seen.pending.len() < PENDING_MAX, self.spec.each) {
            (true, _) => self.seen.pending.push_back(at),
            (false, true) => self.seen.is_overfull = true,
            (false, false) => self.seen.more_pending += 1,
        }
        // A frame at the same instant is an answer if it is on another line or of another device. A
        // state is an answer only at its own sample, not at the moments judged before the sample.
        let is_answer = match (self.is_moment(), &self.probes.after) {
            (true, Some(after)) => self.probes.subject.answers(after),
            (true, None) => true,
            (false, _) => !is_moment,
        };
        if truth == Some(true) && is_answer {
            self.answer(at, true);
        }
    }

    fn subject(&self) -> String {
        let demand = self.spec.demand();
        demand.map_or_else(String::new, |(_, condition)| condition.to_string())
    }

    fn is_moment(&self) -> bool {
        let demand = self.spec.demand();
        demand.is_some_and(|(_, condition)| condition.is_momentary())
    }
}

impl Seen {
    /// Ends the rule because `until` holds. A rule with `after` applies again at the next trigger.
    fn end(&mut self, is_for_now: bool) {
        self.armed_since = None;
        self.pending.clear();
        self.more_pending = 0;
        self.was_broken = false;
        self.is_over = !is_for_now;
    }
}

#[cfg(test)]
mod tests;
