//! The faults of a run: listed, added during the run, and saved with their effects.

use core::time::Duration;

use emulators::{Event, EventKind};
use protocols::Instant;
use serde::Serialize;

use super::{Run, Watch};
use crate::rig::fault::{Activity, FaultId, LineFaults, Window};
use crate::rig::line::{Direction, Line};
use crate::scenario::{
    ComputingSpec, DirectionSpec, FaultKind, FaultSpec, Flaw, Origin, Scenario, Span,
};

/// Maximum number of faults that a run accepts while it continues.
pub const FAULTS_MAX: usize = 10_000;

/// State of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FaultState {
    /// Its time or its condition has not come yet.
    Planned,
    /// The fault is active, or will be active again.
    Active,
    /// Its time is over, or it was removed.
    Over,
}

/// A fault of a run, for a list of them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultReport {
    /// Its number, see [`Run::inject`].
    pub id: FaultId,
    /// Its state.
    pub state: FaultState,
    /// The fault itself; times count from the start of the run.
    pub fault: FaultSpec,
}

/// Minimum delay of a change after the rig's current time.
const NEXT: Duration = Duration::from_nanos(1);
/// Maximum number of active periods of a clogged line in a saved case.
const SPELLS_MAX: u128 = 100_000;

impl Run {
    /// Adds a fault to the run, from now on or from its own later time. Its times count from the
    /// start of the run. The fault becomes part of the scenario: the saved [`case`](Self::case)
    /// contains the fault with the time of its start.
    ///
    /// # Errors
    /// If the keys of the fault contradict each other, if it names an unknown link or a byte that
    /// has already passed, or if there are [`FAULTS_MAX`] faults. The run does not change then.
    pub fn inject(&mut self, mut fault: FaultSpec) -> Result<FaultId, Flaw> {
        if self.scenario.fault.len() >= FAULTS_MAX {
            let message = format!("the run already has {FAULTS_MAX} faults, the maximum");
            return Err(Flaw::new("kind", message));
        }
        let id = FaultId(self.scenario.fault.len());
        let now = self.next_instant();
        let sent = self.line_of(&fault).map_or(0, |line| line.traffic().sent);
        for (key, wanted) in [("byte", fault.byte), ("at_byte", fault.at_byte)] {
            if let Some(byte) = wanted.filter(|&byte| byte < sent) {
                let message = format!("is {byte}, expected a later byte: {sent} have passed");
                return Err(Flaw::new(key, message));
            }
        }
        let waits = fault.byte.is_some()
            || fault.at_byte.is_some()
            || fault.at_frame.is_some()
            || fault.waits_for_condition();
        for (key, condition) in fault.conditions() {
            let flawed = |flaw: Flaw| Flaw::new(key, format!("{}: {}", flaw.key, flaw.message));
            self.moment().check(condition).map_err(flawed)?;
        }
        if let (Some(_), Some(condition)) = (&fault.when, fault.begin_condition()?) {
            self.moment().check(&condition)?;
        }
        if !waits {
            let begins = fault.window().from.max(now);
            fault.from = Some(Span(begins - Instant::ZERO));
        }
        self.plan(&fault, id)?;
        let words = format!("fault {id}: {} on {}", fault.kind.name(), fault.place());
        self.scenario.fault.push(fault);
        self.tell_checkers();
        self.watch_faults();
        self.note("fault-added", words);
        Ok(id)
    }

    /// Schedules a fault on the rig, and its actions on the agenda.
    pub(super) fn plan(&mut self, fault: &FaultSpec, id: FaultId) -> Result<(), Flaw> {
        let what = self.rig.plan_fault(fault, id, self.seed)?;
        if fault.waits_for_condition() {
            self.waiting.push(id);
        } else {
            self.agenda.add(id, fault.activity(id, self.seed), what);
        }
        if fault.waits_for_trigger() {
            self.triggers.push(id);
        }
        Ok(())
    }

    /// Schedules the actions of the scenario's faults. Their effects on lines were scheduled when
    /// the rig was built.
    pub(super) fn plan_agenda(&mut self) {
        for (index, fault) in self.scenario.fault.iter().enumerate() {
            let id = FaultId(index);
            if fault.waits_for_condition() {
                self.waiting.push(id);
            } else if let Ok(what) = self.rig.disturbances(fault) {
                self.agenda.add(id, fault.activity(id, self.seed), what);
            }
        }
        self.find_triggers();
    }

    /// Lists the faults that wait for a byte or a frame; those that have begun are removed at the
    /// next look.
    pub(super) fn find_triggers(&mut self) {
        let faults = self.scenario.fault.iter().enumerate();
        let triggers = faults.filter(|(_, fault)| fault.waits_for_trigger());
        self.triggers = triggers.map(|(index, _)| FaultId(index)).collect();
    }

    /// Tells the checkers if faults that waited for a byte or a frame have begun.
    pub(super) fn see_triggers(&mut self) {
        if self.triggers.is_empty() {
            return;
        }
        let mut triggers = core::mem::take(&mut self.triggers);
        let before = triggers.len();
        triggers.retain(|id| {
            let fault = &self.scenario.fault[id.0];
            self.activity_of(*id, fault).trigger.is_some()
        });
        let has_begun = triggers.len() != before;
        self.triggers = triggers;
        if has_begun {
            self.tell_checkers();
        }
    }

    /// Watches the conditions of faults. A condition that starts a fault is watched from the
    /// beginning of the run, a condition that ends a fault from the start of the fault.
    pub(super) fn watch_faults(&mut self) {
        let now = self.rig.now();
        let mut wanted = Vec::new();
        for (index, fault) in self.scenario.fault.iter().enumerate() {
            let id = FaultId(index);
            let is_new = |key| !self.fault_watches.contains_key(&(id, key));
            if let Some(begins) = fault.begins_when.as_ref().filter(|_| is_new("begins_when")) {
                wanted.push(((id, "begins_when"), begins.clone()));
            }
            if let Some(ends) = fault.ends_when.as_ref().filter(|_| is_new("ends_when"))
                && self.state_of(id, fault, now) == FaultState::Active
            {
                wanted.push(((id, "ends_when"), ends.clone()));
            }
        }
        for (key, condition) in wanted {
            // The names were checked during the wiring of the rig, or when the fault was added.
            if let Ok(watch) = self.watch(&condition) {
                self.fault_watches.insert(key, watch);
            }
        }
    }

    /// Ends the active faults whose end condition has become true.
    fn end_what_is_held(&mut self) {
        let has_come = |((id, key), watch): (&(FaultId, &'static str), &Watch)| {
            (*key == "ends_when" && self.has_come(watch)).then_some(*id)
        };
        let over: Vec<FaultId> = self.fault_watches.iter().filter_map(has_come).collect();
        for id in over {
            self.fault_watches.remove(&(id, "ends_when"));
            let ends = self.scenario.fault[id.0].ends_when.take();
            // A fault whose time is over has ended by itself.
            if self.end_fault(id).is_ok() {
                let ends = ends.map(|ends| ends.to_string()).unwrap_or_default();
                self.note("fault-ended", format!("fault {id} ended by {ends}"));
            }
        }
    }

    /// Begins and ends the faults whose conditions have become true.
    pub(super) fn begin_what_waited(&mut self) {
        if !self.fault_watches.is_empty() {
            self.end_what_is_held();
        }
        self.begin_faults();
        if self
            .scenario
            .fault
            .iter()
            .any(|fault| fault.ends_when.is_some())
        {
            self.watch_faults();
        }
    }

    fn begin_faults(&mut self) {
        if self.waiting.is_empty() {
            return;
        }
        let from = Some(Span(self.next_instant() - Instant::ZERO));
        for id in core::mem::take(&mut self.waiting) {
            let fault = &self.scenario.fault[id.0];
            let condition = fault.when.as_ref().and_then(|when| when.condition().ok());
            let watch = self.fault_watches.get(&(id, "begins_when"));
            let begins = condition.is_some_and(|condition| self.holds_now(&condition))
                || watch.is_some_and(|watch| self.has_come(watch));
            if begins {
                let begun = FaultSpec {
                    from,
                    when: None,
                    begins_when: None,
                    ..fault.clone()
                };
                self.fault_watches.remove(&(id, "begins_when"));
                let words = format!("fault {id}: {} on {}", begun.kind.name(), begun.place());
                if self.plan(&begun, id).is_ok() {
                    self.note("fault-begun", words);
                }
                self.scenario.fault[id.0] = begun;
                self.tell_checkers();
            } else {
                self.waiting.push(id);
            }
        }
    }

    /// Passes the current faults to the checkers, because some checkers excuse the effects of
    /// faults.
    pub(super) fn tell_checkers(&mut self) {
        let faults = self.scenario.fault.iter().enumerate();
        let faults = faults.map(|(index, fault)| self.in_time(FaultId(index), fault));
        let faults: Vec<FaultSpec> = faults.collect();
        self.watchers.faults_changed(&faults, &self.rig);
    }

    /// The fault with its times, if it waited for a byte or a frame that has come.
    fn in_time(&self, id: FaultId, fault: &FaultSpec) -> FaultSpec {
        let mut fault = fault.clone();
        if !fault.waits_for_trigger() {
            return fault;
        }
        let activity = self.activity_of(id, &fault);
        if activity.trigger.is_none() {
            let span = |at: Instant| (at < Window::ALWAYS.until).then(|| Span(at - Instant::ZERO));
            (fault.at_byte, fault.at_frame) = (None, None);
            fault.from = span(activity.window.from);
            fault.until = span(activity.window.until);
            fault.lasting = fault.lasting.filter(|_| fault.every.is_some());
        }
        fault
    }

    /// Ends a fault now. It stays in the list, with its end.
    ///
    /// # Errors
    /// If the fault does not exist, or is over.
    pub fn withdraw(&mut self, id: FaultId) -> Result<(), Flaw> {
        self.end_fault(id)?;
        self.note("fault-ended", format!("fault {id} withdrawn"));
        Ok(())
    }

    fn end_fault(&mut self, id: FaultId) -> Result<(), Flaw> {
        let (now, next) = (self.rig.now(), self.next_instant());
        let count = self.scenario.fault.len();
        let Some(fault) = self.scenario.fault.get(id.0).cloned() else {
            let message = match count {
                0 => format!("is {id}, but there are no faults yet"),
                1 => format!("is {id}, expected 0, the only fault"),
                _ => format!("is {id}, expected one of the faults 0 to {}", count - 1),
            };
            return Err(Flaw::new("id", message));
        };
        if self.state_of(id, &fault, now) == FaultState::Over {
            return Err(Flaw::new("id", format!("fault {id} is over already")));
        }
        if let Some(strike) = fault.strike()?
            && let Some(faults) = self.faults_on(&fault)
        {
            faults.remove_strike(strike);
        }
        self.rig.end_fault(id, next);
        self.agenda.end(id, next);
        self.waiting.retain(|&waiting| waiting != id);
        // A fault that never began has an empty window from now on.
        let fault = &mut self.scenario.fault[id.0];
        fault.until = Some(Span(next - Instant::ZERO));
        fault.lasting = fault.lasting.filter(|_| fault.every.is_some());
        fault.ends_when = None;
        self.tell_checkers();
        self.fault_watches.retain(|(watched, _), _| *watched != id);
        Ok(())
    }

    /// All faults, those of the scenario first, then those added since.
    pub fn faults(&self) -> impl Iterator<Item = FaultReport> {
        let now = self.rig.now();
        let faults = self.scenario.fault.iter().enumerate();
        faults.map(move |(index, fault)| FaultReport {
            id: FaultId(index),
            state: self.state_of(FaultId(index), fault, now),
            fault: fault.clone(),
        })
    }

    /// The faults that have not begun, each with the reason.
    pub(super) fn unbegun(&self) -> impl Iterator<Item = String> {
        let planned = self.faults().filter(|one| one.state == FaultState::Planned);
        planned.map(|FaultReport { id, fault, .. }| {
            let what = if fault.byte.is_some() || fault.at_byte.is_some() {
                "byte did not come"
            } else if fault.at_frame.is_some() {
                "frame did not come"
            } else if fault.waits_for_condition() {
                "condition did not come true"
            } else {
                "time did not come"
            };
            let (FaultId(number), kind, place) = (id, fault.kind.name(), fault.place());
            format!("fault[{number}], {kind} on {place}: its {what}")
        })
    }

    pub(super) fn line_of(&self, fault: &FaultSpec) -> Option<&Line> {
        let link = self.rig.link(fault.link.as_deref()?)?;
        Some(link.line(fault.direction?.into()))
    }

    pub(super) fn faults_on(&mut self, fault: &FaultSpec) -> Option<&mut LineFaults> {
        let link = self.rig.link_mut(fault.link.as_deref()?)?;
        Some(&mut link.line_mut(fault.direction?.into()).faults)
    }

    /// Active times of the fault, including its trigger.
    fn activity_of(&self, id: FaultId, fault: &FaultSpec) -> Activity {
        let on_line = self
            .line_of(fault)
            .and_then(|line| line.faults.activity(id));
        on_line
            .cloned()
            .unwrap_or_else(|| fault.activity(id, self.seed))
    }

    fn state_of(&self, id: FaultId, fault: &FaultSpec, now: Instant) -> FaultState {
        let withdrawn = fault
            .until
            .is_some_and(|until| until.instant() <= now + NEXT);
        let activity = self.activity_of(id, fault);
        let passed = fault.byte.is_some_and(|byte| {
            self.line_of(fault)
                .is_some_and(|line| line.traffic().sent > byte)
        });
        let waits =
            activity.trigger.is_some() || fault.waits_for_condition() || fault.byte.is_some();
        let is_over = activity.window.until <= now + NEXT;
        if withdrawn || passed || (is_over && !waits) {
            FaultState::Over
        } else if waits || activity.window.from > now + NEXT {
            FaultState::Planned
        } else {
            FaultState::Active
        }
    }

    /// The first instant after all sent bytes.
    fn next_instant(&self) -> Instant {
        self.rig.now() + NEXT
    }

    pub(super) fn note(&mut self, rule: &'static str, detail: String) {
        let event = Event {
            at: self.rig.now(),
            kind: EventKind::Note,
            rule,
            detail,
            bytes: Vec::new(),
        };
        self.rig.log("rig", event);
    }

    /// The run until now as a scenario with explicit seed and defaults. Lists of damaged bytes
    /// replace random damage, and times replace the conditions of faults. A run of this scenario
    /// has the same faults, independent of the random numbers of later versions.
    pub fn case(&self) -> Scenario {
        let mut case = self.scenario.clone();
        case.seed = self.seed;
        case.origin = Some(Origin {
            tool: concat!("hilrig ", env!("CARGO_PKG_VERSION")).to_owned(),
            trace_hash: self.rig.trace_hash(),
        });
        // A step with a condition waits again, and the mission is not over before it is done.
        case.mission.step.clone_from(&self.asked.mission.step);
        case.mission.step.extend(self.steps.by_hand.iter().cloned());
        let ran = self.rig.now() - Instant::ZERO;
        case.duration = case.duration.max(Span(ran));
        // The damaged bytes are listed, so a budget is not needed any more.
        case.budget = None;
        let faults = self.scenario.fault.iter().enumerate();
        let faults = faults.filter(|(_, fault)| !fault.kind.is_strike());
        case.fault = faults
            .flat_map(|(index, fault)| self.resolved(FaultId(index), fault))
            .collect();
        for link in self.rig.links() {
            for (direction, spec) in [
                (Direction::ToMaster, DirectionSpec::ToMaster),
                (Direction::ToDevice, DirectionSpec::ToDevice),
            ] {
                let faults = &link.line(direction).faults;
                let strikes = faults.struck().copied().chain(faults.to_come());
                let specs = strikes.map(|strike| FaultSpec::of_strike(&link.name, spec, strike));
                case.fault.extend(specs);
            }
        }
        case
    }

    /// Stores the measured computing times of a program in the case of this run.
    pub fn set_computing(&mut self, computing: ComputingSpec) {
        self.scenario.computing = Some(computing);
    }

    /// The fault with its real times, and without random values where possible.
    fn resolved(&self, id: FaultId, fault: &FaultSpec) -> Vec<FaultSpec> {
        let activity = self.activity_of(id, fault);
        let mut fault = fault.clone();
        if fault.waits_for_condition() || activity.trigger.is_some() {
            // The fault has not begun, but may begin in a longer run, unless it was withdrawn.
            return Vec::from_iter(fault.until.is_none().then_some(fault));
        }
        let span = |at: Instant| (at < Window::ALWAYS.until).then(|| Span(at - Instant::ZERO));
        fault = self.in_time(id, &fault);
        if activity.window.is_empty() {
            return Vec::new();
        }
        match fault.kind {
            FaultKind::Clog => {
                let spells = (0..SPELLS_MAX).map_while(|number| activity.spell(number));
                let spells = spells.take_while(|spell| spell.from <= self.rig.now());
                let stall = |spell: Window| FaultSpec {
                    kind: FaultKind::Stall,
                    from: span(spell.from),
                    until: span(spell.until),
                    lasting: None,
                    every: None,
                    count: None,
                    stream: None,
                    ..fault.clone()
                };
                let real = spells.filter(|spell| !spell.is_empty());
                real.map(stall).collect()
            }
            FaultKind::Jitter => {
                fault.stream = Some(fault.dice(id));
                vec![fault]
            }
            _ => vec![fault],
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn run() -> Run {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/empty-room.toml");
        let (scenario, source) = Scenario::read(&path).expect("sound");
        Run::new(scenario, &source, None).expect("can be wired")
    }

    fn on_the_bus(keys: &str) -> FaultSpec {
        let bus = "link = \"base\"\ndirection = \"to-device\"\n";
        toml::from_str(&format!("{bus}{keys}")).expect("a fault")
    }

    fn states(run: &Run) -> Vec<FaultState> {
        run.faults().map(|report| report.state).collect()
    }

    /// An action takes effect a nanosecond later. So the fault counts as active a nanosecond before
    /// its start, and as over a nanosecond before its end.
    #[test]
    fn a_fault_is_planned_then_active_then_over() {
        use FaultState::{Active, Over, Planned};
        let mut run = run();
        let fault = on_the_bus("kind = \"cut\"\nfrom = \"200ms\"\nuntil = \"300ms\"\n");
        run.inject(fault).expect("sound");
        let told = [1, 199_999_998, 199_999_999, 299_999_998, 299_999_999].map(|nanos| {
            run.go_on_until(Instant::from_nanos(nanos));
            states(&run)
        });
        let expected = [Planned, Planned, Active, Active, Over];
        assert_eq!(told, expected.map(|state| vec![state]));
    }

    /// A fault that never begins tests nothing: the outcome names it.
    #[test]
    fn faults_that_never_began_are_named() {
        let mut run = run();
        for keys in [
            "kind = \"cut\"\nfrom = \"200ms\"\nuntil = \"300ms\"\n",
            "kind = \"flip\"\nbyte = 100000000\nbit = 1\n",
            "kind = \"cut\"\nfrom = \"60s\"\n",
            "kind = \"cut\"\nbegins_when = { robot = { of = \"x-m\", op = \">\", value = 99 } }\n",
        ] {
            run.inject(on_the_bus(keys)).expect("sound");
        }
        run.go_on_until(Instant::from_secs(1));
        let told: Vec<String> = run.unbegun().collect();
        let expected = [
            "fault[1], flip on base: its byte did not come",
            "fault[2], cut on base: its time did not come",
            "fault[3], cut on base: its condition did not come true",
        ];
        assert_eq!(told, expected);
    }

    /// A bus is cut from the time at which the robot drives until the base has stopped its motors.
    /// A case contains the times, and gives the same bytes.
    #[test]
    fn a_fault_is_held_until_a_condition_comes_true() {
        use FaultState::{Over, Planned};
        let mut run = run();
        let cut = "kind = \"cut\"\n\
                   begins_when = { robot = { of = \"speed-m-s\", op = \">\", value = 0.05 } }\n\
                   ends_when = { event = { rule = \"motors-stopped\", source = \"base\" } }";
        let misspelt = on_the_bus(&cut.replace("\"base\" } }", "\"bsae\" } }"));
        let refused = run.inject(misspelt).expect_err("no such source");
        assert!(refused.key == "ends_when" && refused.message.contains("did you mean"));
        run.inject(on_the_bus(cut)).expect("sound");
        assert_eq!(states(&run), [Planned]);
        run.go_on_until(Instant::from_secs(8));
        assert_eq!(states(&run), [Over]);
        let told = |rule: &str| {
            let mut events = run.rig.events().iter();
            events
                .find(|one| one.event.rule == rule)
                .map(|one| one.event.at)
        };
        let [begun, stopped, ended] = ["fault-begun", "motors-stopped", "fault-ended"].map(told);
        let [begun, stopped, ended] = [begun, stopped, ended].map(|at| at.expect("logged"));
        assert!(
            begun < stopped && stopped <= ended,
            "{begun} {stopped} {ended}"
        );
        assert!(
            ended - stopped <= crate::run::LOOK_EVERY,
            "{stopped} {ended}"
        );
        let case = run.case();
        assert!(case.fault[0].from.is_some() && case.fault[0].until.is_some());
        let (read, source) = Scenario::from_text(&case.to_toml()).expect("sound");
        let mut again = Run::new(read, &source, None).expect("can be wired");
        again.go_on_until(Instant::from_secs(8));
        assert_eq!(again.rig.trace_hash(), run.rig.trace_hash());
    }

    /// A fault on a byte is over after that byte has passed. A fault that lasts for a time from a
    /// byte on is then over, too. The log contains both.
    #[test]
    fn a_fault_that_waits_for_a_byte_is_over_behind_it() {
        use FaultState::{Over, Planned};
        let mut run = run();
        run.go_on_until(Instant::from_millis(500));
        let drop = on_the_bus("kind = \"drop\"");
        let sent = run.line_of(&drop).expect("a bus").traffic().sent;
        let byte = sent + 3;
        for keys in [
            format!("kind = \"drop\"\nbyte = {byte}"),
            format!("kind = \"cut\"\nat_byte = {byte}\nlasting = \"50ms\""),
        ] {
            run.inject(on_the_bus(&keys)).expect("sound");
        }
        assert_eq!(states(&run), [Planned, Planned]);
        run.go_on_until(Instant::from_secs(3));
        assert_eq!(states(&run), [Over, Over]);
        let logged = run.rig.events().iter().filter(|one| one.source == "rig");
        let logged: Vec<&str> = logged.map(|one| one.event.rule).collect();
        assert_eq!(logged, ["fault-added", "fault-added"]);
        let id = run.inject(on_the_bus("kind = \"cut\"")).expect("sound");
        run.withdraw(id).expect("active");
        let last = run.rig.events().last().map(|one| one.event.rule);
        assert_eq!(last, Some("fault-ended"));
    }

    /// Bytes count from 0: the number of the next byte equals the number of bytes that have passed.
    #[test]
    fn the_next_byte_is_to_come_and_the_last_one_has_passed() {
        let mut run = run();
        run.go_on_until(Instant::from_millis(500));
        let drop = on_the_bus("kind = \"drop\"");
        let sent = run.line_of(&drop).expect("a bus").traffic().sent;
        for (key, keys) in [
            ("byte", "kind = \"drop\""),
            ("at_byte", "kind = \"cut\"\nlasting = \"50ms\""),
        ] {
            let mut inject = |byte| run.inject(on_the_bus(&format!("{keys}\n{key} = {byte}")));
            assert!(inject(sent).is_ok(), "{key}");
            let last = sent - 1;
            let refused = inject(last).expect_err("it has passed").message;
            let expected = format!("is {last}, expected a later byte: {sent} have passed");
            assert_eq!(refused, expected, "{key}");
        }
    }

    /// A clogged line with the random stream `clogs` becomes one stall per active period in a case,
    /// without random numbers: one every 300 ms, of 100 ms on average.
    #[test]
    fn a_case_has_the_spells_of_a_clog_as_stalls() {
        let mut run = run();
        let clog = "kind = \"clog\"\nevery = \"300ms\"\nlasting = \"100ms\"\nstream = \"clogs\"";
        run.inject(on_the_bus(clog)).expect("sound");
        run.go_on_until(Instant::from_secs(3));
        let case = run.case();
        assert!((9..=10).contains(&case.fault.len()), "{:?}", case.fault);
        let stalls = |fault: &FaultSpec| fault.kind == FaultKind::Stall && fault.stream.is_none();
        assert!(case.fault.iter().all(stalls), "{:?}", case.fault);
        for stall in &case.fault {
            let [from, until] = [stall.from, stall.until].map(|at| at.expect("it has times"));
            assert!(from < until, "{stall:?}");
            assert_eq!(
                (stall.lasting, stall.every, stall.count),
                (None, None, None)
            );
        }
        let read = Scenario::parse(Path::new("case.toml"), case.to_toml());
        assert_eq!(read.expect("sound").0.fault, case.fault);
    }

    /// The number of the fault in the run selects the random stream. In a case the fault may have
    /// another number, so the case names the stream.
    #[test]
    fn a_case_names_the_dice_of_what_is_late_by_chance() {
        let mut run = run();
        run.inject(on_the_bus("kind = \"jitter\"\nby = \"1ms\""))
            .expect("sound");
        run.go_on_until(Instant::from_millis(100));
        let case = run.case();
        assert_eq!(case.fault.len(), 1);
        assert!(case.fault[0].stream.is_some() && run.scenario.fault[0].stream.is_none());
    }

    const LATE: &str = "kind = \"cut\"\nfrom = \"60s\"";

    /// A number without a fault, and a fault that is over.
    #[test]
    fn only_a_fault_that_is_not_over_can_be_withdrawn() {
        let mut run = run();
        let refused = |run: &mut Run, id| run.withdraw(FaultId(id)).expect_err("none").to_string();
        assert_eq!(
            refused(&mut run, 3),
            "id: is 3, but there are no faults yet"
        );
        run.inject(on_the_bus(LATE)).expect("sound");
        assert_eq!(refused(&mut run, 3), "id: is 3, expected 0, the only fault");
        run.inject(on_the_bus(LATE)).expect("sound");
        assert_eq!(
            refused(&mut run, 2),
            "id: is 2, expected one of the faults 0 to 1"
        );
        assert_eq!(run.withdraw(FaultId(1)), Ok(()));
        assert_eq!(refused(&mut run, 1), "id: fault 1 is over already");
        assert_eq!(states(&run), [FaultState::Planned, FaultState::Over]);
        // The withdrawn one never began, so a case leaves it out.
        assert_eq!(run.case().fault.len(), 1);
    }

    #[test]
    fn a_run_has_ten_thousand_faults_at_most() {
        let mut run = run();
        let late = on_the_bus(LATE);
        run.scenario.fault = vec![late.clone(); FAULTS_MAX - 1];
        assert_eq!(run.inject(late.clone()), Ok(FaultId(FAULTS_MAX - 1)));
        let refused = run.inject(late).expect_err("too many").to_string();
        assert_eq!(
            refused,
            "kind: the run already has 10000 faults, the maximum"
        );
    }

    /// Faults that wait for a byte or a frame far in the future.
    #[test]
    fn what_a_fault_waited_for_is_named() {
        let mut run = run();
        for key in ["at_byte = 100000000", "at_frame = 100000000"] {
            let cut = format!("kind = \"cut\"\nlasting = \"1s\"\n{key}");
            run.inject(on_the_bus(&cut)).expect("sound");
        }
        run.go_on_until(Instant::from_millis(100));
        let told: Vec<String> = run.unbegun().collect();
        let expected = [
            "fault[0], cut on base: its byte did not come",
            "fault[1], cut on base: its frame did not come",
        ];
        assert_eq!(told, expected);
        // A longer run may still begin them.
        assert_eq!(run.case().fault.len(), 2);
        run.withdraw(FaultId(0)).expect("it waits");
        assert_eq!(run.case().fault.len(), 1);
    }

    /// A fault that began with a byte has its times in a case, and no trigger.
    #[test]
    fn a_case_has_the_times_of_a_fault_that_began_with_a_byte() {
        let mut run = run();
        run.go_on_until(Instant::from_millis(500));
        let drop = on_the_bus("kind = \"drop\"");
        let byte = run.line_of(&drop).expect("a bus").traffic().sent + 3;
        let cut = format!("kind = \"cut\"\nat_byte = {byte}\nlasting = \"50ms\"");
        run.inject(on_the_bus(&cut)).expect("sound");
        run.go_on_until(Instant::from_secs(3));
        let [fault] = &run.case().fault[..] else {
            panic!("one fault");
        };
        assert_eq!((fault.at_byte, fault.lasting), (None, None));
        let [from, until] = [fault.from, fault.until].map(|at| at.expect("it began").0);
        assert_eq!(until - from, Duration::from_millis(50));
        assert!(from > Duration::from_millis(500), "{from:?}");
    }

    /// The case lasts as long as the scenario asks for, or as the run did.
    #[test]
    fn a_case_is_as_long_as_the_run() {
        let mut run = run();
        run.go_on_until(Instant::from_secs(1));
        let asked = run.scenario.duration;
        assert!(asked > Span::from_millis(1_000));
        assert_eq!(run.case().duration, asked);
        run.scenario.duration = Span::from_millis(999);
        assert_eq!(run.case().duration, Span::from_millis(1_000));
        assert_eq!(run.case().budget, None);
        assert_eq!(
            run.case().origin.map(|one| one.trace_hash),
            Some(run.rig.trace_hash())
        );
    }

    /// Two faults wait for a condition that holds from the first look on. The one that is withdrawn
    /// before never begins, the other one does.
    #[test]
    fn a_withdrawn_fault_does_not_begin() {
        let mut run = run();
        let cut = "kind = \"cut\"\n\
                   begins_when = { robot = { of = \"x-m\", op = \">\", value = -99 } }\n";
        for _ in 0..3 {
            run.inject(on_the_bus(cut)).expect("sound");
        }
        run.withdraw(FaultId(1)).expect("it waits");
        assert_eq!(run.waiting, [FaultId(0), FaultId(2)]);
        run.go_on_until(Instant::from_millis(50));
        use FaultState::{Active, Over};
        assert_eq!(states(&run), [Active, Over, Active]);
        assert!(run.waiting.is_empty());
    }

    /// A fault on the next byte is planned, until that byte has passed.
    #[test]
    fn a_fault_on_the_next_byte_is_planned() {
        let mut run = run();
        run.go_on_until(Instant::from_millis(500));
        let drop = on_the_bus("kind = \"drop\"");
        let sent = run.line_of(&drop).expect("a bus").traffic().sent;
        let next = on_the_bus(&format!("kind = \"drop\"\nbyte = {sent}"));
        run.inject(next).expect("sound");
        assert_eq!(states(&run), [FaultState::Planned]);
    }
}
