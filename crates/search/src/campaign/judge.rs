use core::any::Any;
use core::panic::AssertUnwindSafe;
use std::collections::BTreeSet;
use std::panic::catch_unwind;
use std::path::PathBuf;

use super::manner;
use engine::robots;
use engine::run::check::Status;
use engine::run::{Outcome, Run};
use engine::scenario::{Scenario, ScenarioError, Source};
use realtime::exec::{ExecError, Foreign};
use realtime::guest;

/// The result of one run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// Name of the scenario.
    pub scenario: String,
    /// Seed of the run.
    pub seed: u64,
    /// The cause of the failure without figures; equal for all runs with the same failure.
    pub cause: Option<String>,
    /// The cause of the failure, with the figures.
    pub detail: Option<String>,
    /// Virtual time, milliseconds.
    pub ran_ms: u64,
    /// Fingerprint of all bytes.
    pub trace: String,
    /// Situations that occurred, see [`robots::Robot::situations`].
    pub reached: BTreeSet<String>,
}

/// Runs `scenario` with all checkers and returns the result. A panic of the program under test or
/// of the rig counts as a failure.
///
/// # Errors
/// If the scenario cannot be wired.
pub fn run(
    scenario: &Scenario,
    source: &Source,
) -> Result<(Record, Option<Box<Outcome>>), ScenarioError> {
    run_from(
        scenario,
        || Run::new(scenario.clone(), source, None),
        |_| {},
    )
}

/// Like `run`, for a run of `scenario` that `begin` creates; the run may start at a checkpoint.
/// `watch` is called after every step.
///
/// # Errors
/// Those of `begin`.
pub fn run_from<E>(
    scenario: &Scenario,
    begin: impl FnOnce() -> Result<Run, E>,
    mut watch: impl FnMut(&Run),
) -> Result<(Record, Option<Box<Outcome>>), E> {
    let judged = catch_unwind(AssertUnwindSafe(|| {
        let mut run = begin()?;
        while !run.is_over() {
            run.step();
            watch(&run);
        }
        Ok(Box::new(run.judge_what_is_expected()))
    }));
    let mut record = Record::of(scenario);
    match judged {
        Ok(Err(error)) => Err(error),
        Ok(Ok(outcome)) => {
            record.take(scenario, &outcome);
            Ok((record, Some(outcome)))
        }
        Err(panic) => {
            let (cause, message) = words_of_panic(panic.as_ref());
            (record.cause, record.detail) = (Some(cause), Some(message));
            Ok((record, None))
        }
    }
}

/// Runs `scenario` with a user's program, in real or virtual time. The first of `places` holds the
/// ports, the second receives the output. `None` if `goes_on` returned false.
///
/// # Errors
/// If the program cannot be started.
pub fn run_foreign(
    scenario: &Scenario,
    source: &Source,
    foreign: &Foreign,
    places: [&PathBuf; 2],
    goes_on: &dyn Fn() -> bool,
) -> Result<Option<(Record, Box<Outcome>)>, ExecError> {
    let judged = guest::judge(scenario, source, foreign, places, goes_on)?;
    Ok(judged.map(|outcome| {
        let mut record = Record::of(scenario);
        record.take(scenario, &outcome);
        (record, Box::new(outcome))
    }))
}

impl Record {
    /// A record without a result.
    fn of(scenario: &Scenario) -> Self {
        Self {
            scenario: scenario.name.clone(),
            seed: scenario.seed,
            cause: None,
            detail: None,
            ran_ms: 0,
            trace: String::new(),
            reached: BTreeSet::new(),
        }
    }

    fn take(&mut self, scenario: &Scenario, outcome: &Outcome) {
        self.ran_ms = u64::try_from(outcome.ran.as_millis()).unwrap_or(u64::MAX);
        self.trace.clone_from(&outcome.trace_hash);
        self.reached = situations(scenario, outcome);
        let status = |name: &str| {
            let mut checks = outcome.checks.iter();
            let check = checks.find(|check| check.name == name);
            check.map_or(Status::NotObserved, |check| check.status)
        };
        for rule in rules_of(scenario) {
            self.reached.insert(rule.asked());
            let is_reached = match rule.is_goal {
                true => status(&rule.check) == Status::Pass,
                false => status(&rule.check) != Status::NotObserved,
            };
            if is_reached {
                self.reached.insert(rule.name);
            }
        }
        (self.cause, self.detail) = cause_of(outcome).unzip();
    }
}

/// The cause of a panic without figures, and its message.
pub fn words_of_panic(panic: &(dyn Any + Send)) -> (String, String) {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
    let text = text.unwrap_or("without words");
    (format!("panic: {}", without_figures(text)), text.to_owned())
}

/// The first failed check, without and with figures. Checks of the whole run precede checks of the
/// final state. A run without any judged check has not passed either.
pub(crate) fn cause_of(outcome: &Outcome) -> Option<(String, String)> {
    let failed = |check: &&engine::run::check::Check| check.status == Status::Fail;
    let Some(check) = outcome.checks.iter().find(failed) else {
        let cause = "nothing was judged".to_owned();
        let detail = format!("{cause}: no program sent a byte that a device received");
        return (!outcome.is_judged()).then_some((cause, detail));
    };
    let detail = format!("{}: {}", check.name, check.detail);
    let how = manner::of(&check.name, outcome).map(str::to_owned);
    let cause = match how.or_else(|| first_rule(&check.name, outcome)) {
        Some(how) => format!("{}: {how}", check.name),
        None => check.name.clone(),
    };
    Some((cause, detail))
}

/// The first broken rule, for the check that counts violations: the count itself does not identify
/// the cause.
fn first_rule(check: &str, outcome: &Outcome) -> Option<String> {
    let mut broken = outcome.events.iter().filter(|logged| logged.is_violation());
    let first = broken.next().filter(|_| check == "violations")?;
    Some(format!("{} {}", first.source, first.event.rule))
}

/// `text` with each number as `#`: counts, addresses and process numbers differ from run to run.
pub fn without_figures(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '0'..='9' if out.ends_with('#') => {}
            '0'..='9' => out.push('#'),
            _ => out.push(c),
        }
    }
    out
}

/// The situations that the scenario's robot should reach.
pub(super) fn situations_of(scenario: &Scenario) -> &'static [&'static str] {
    robots::find(&scenario.robot).map_or(&[], |robot| robot.situations())
}

/// A rule of a scenario, as a campaign counts it.
pub(super) struct CountedRule {
    /// Name of its check.
    check: String,
    /// Name for the count of runs that observed the rule, or reached the goal.
    pub(super) name: String,
    /// Whether the rule is a goal.
    pub(super) is_goal: bool,
}

impl CountedRule {
    /// Name for the count of runs whose scenario has the rule: a generated mission may have lost
    /// it.
    pub(super) fn asked(&self) -> String {
        format!("asked: {}", self.name)
    }
}

/// The rules and goals of the scenario that a campaign must observe or reach.
pub(super) fn rules_of(scenario: &Scenario) -> impl Iterator<Item = CountedRule> {
    let rules = scenario.expect.rules();
    rules.map(|rule| {
        let is_goal = rule.sometimes.is_some();
        let kind = if is_goal { "goal" } else { "rule" };
        CountedRule {
            check: rule.check_name(),
            name: format!("{kind} {} of {}", rule.name, scenario.name),
            is_goal,
        }
    })
}

fn situations(scenario: &Scenario, outcome: &Outcome) -> BTreeSet<String> {
    let wanted = situations_of(scenario);
    let reached = wanted.iter().filter(|name| {
        let count = outcome.counters.get(*name).copied();
        count.unwrap_or(0) > 0
    });
    reached.map(|&name| name.to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use core::time::Duration;
    use std::path::Path;

    use super::*;
    use crate::generate::{self, Dice, Profile, Vary};
    use engine::scenario::Span;

    /// Replaying the case of a run gives the same result: for each shipped scenario, with all
    /// variations, over the first 16 s, in which most faults occur.
    #[test]
    fn a_case_does_again_what_its_run_did() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios");
        let files = std::fs::read_dir(folder).expect("a folder");
        let mut paths: Vec<_> = files.map(|file| file.expect("a file").path()).collect();
        paths.retain(|path| path.extension().is_some_and(|end| end == "toml"));
        paths.sort();
        // Every third scenario at a landing, all of them with `tests/run.sh --all`.
        let is_whole = std::env::var("HILRIG_TESTS").is_ok_and(|tests| tests == "all");
        let step = if is_whole { 1 } else { 3 };
        let mut tried = 0;
        for path in paths.into_iter().step_by(step) {
            let (shipped, source) = Scenario::read(&path).expect("sound");
            let mut dice = Dice::of_seed(7, &shipped.name);
            let mut made =
                generate::scenario(&shipped, &source, Vary::ALL, &Profile::default(), &mut dice);
            made.duration = made.duration.min(Span(Duration::from_secs(16)));
            // Phases would be longer.
            made.phases = None;
            let name = &made.name;
            let Ok((record, outcome)) = run(&made, &source) else {
                assert_eq!(name, "custom-robot", "it alone has no program");
                continue;
            };
            let case = outcome.expect("no panic").case.to_toml();
            let (case, source) = Scenario::from_text(&case).expect("a case is a scenario");
            let (again, _) = run(&case, &source).expect("can be wired");
            assert_eq!(again, record, "{name}");
            tried += 1;
        }
        assert!(tried * step >= 20, "{tried}");
    }

    /// A robot without a program keeps each rule, and has shown nothing.
    #[test]
    fn a_run_without_a_judged_check_has_not_passed() {
        let text = "schema = 1\nname = \"cart\"\nrobot = \"custom\"\nduration = \"1s\"\n\
            [chassis.differential]\n[device.wheels.registers]\nbaud = 9600\nregister = [\n\
            { address = 1, name = \"left\", width = \"i8\", access = \"write\", \
            drives = { actuator = \"left\", speed_m_s = 0.01 } },\n\
            { address = 2, name = \"right\", width = \"i8\", access = \"write\", \
            drives = { actuator = \"right\", speed_m_s = 0.01 } },\n]\n\
            [world]\nstart = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }\n\
            [[world.wall]]\npath_m = [[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]\n\
            [[expect.rule]]\nname = \"slow\"\n\
            always = { robot = { of = \"speed-m-s\", op = \"<=\", value = 0.1 } }\n";
        let (scenario, source) = Scenario::from_text(text).expect("sound");
        let (record, _) = run(&scenario, &source).expect("can be wired");
        assert_eq!(record.cause.as_deref(), Some("nothing was judged"));
    }

    #[test]
    fn figures_do_not_tell_causes_apart() {
        assert_eq!(without_figures("index 1234 of 90"), "index # of #");
        assert_eq!(without_figures("none"), "none");
    }
}
