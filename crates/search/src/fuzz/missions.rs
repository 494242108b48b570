use core::cell::RefCell;
use core::time::Duration;
use std::path::Path;

use super::subject::{Behaviour, Kept, Subject, Violation, size};
use crate::campaign::{self, Record};
use crate::generate::{self, Dice, Profile, Vary};
use crate::shrink::{self, Branches, Effort, Judged};
use engine::run::Outcome;
use engine::scenario::{Expect, SafetySpec, Scenario, Source, Span};
use show::shell::word;

/// Scenarios as a subject: choices determine world, mission, timing and faults; all checkers watch
/// the run.
#[derive(Debug)]
pub struct Missions {
    scenario: Scenario,
    source: Source,
    vary: Vary,
    profile: Profile,
}

/// The cause of a case that cannot be wired.
const UNWIRED: &str = "can-be-wired";
/// File name of a finding's case.
const CASE: &str = "case.toml";

impl Missions {
    /// Variations of `scenario` in the parts `vary`, with the faults of `profile`.
    pub const fn new(scenario: Scenario, source: Source, vary: Vary, profile: Profile) -> Self {
        Self {
            scenario,
            source,
            vary,
            profile,
        }
    }

    fn made(&self, choices: &[u8]) -> Scenario {
        let made = generate::scenario(
            &self.scenario,
            &self.source,
            self.vary,
            &self.profile,
            &mut Dice::of_bytes(choices),
        );
        in_time_of(made, &self.scenario)
    }

    fn judged(&self, scenario: &Scenario) -> (Option<Violation>, Option<Box<Outcome>>) {
        match campaign::run(scenario, &self.source) {
            Ok((record, outcome)) => (fault_of(record), outcome),
            // A generated scenario must be valid.
            Err(error) => (Some(Violation::new(UNWIRED, error.to_string())), None),
        }
    }
}

/// Maximum length of a case relative to its scenario, per cent: applies if goals are judged after
/// the faults.
const LONGER_PERCENT: u32 = 150;
/// The part of a case in which faults may occur, per cent.
const ADVERSITY_PERCENT: u32 = 80;

/// Shortens `made` to the duration of `base` if it is much longer. Faults begin earlier in
/// proportion, and no goal is expected, because there is no time to reach it afterwards.
fn in_time_of(mut made: Scenario, base: &Scenario) -> Scenario {
    if made.duration.0 <= base.duration.0 * LONGER_PERCENT / 100 {
        return made;
    }
    made.duration = base.duration;
    made.phases = None;
    made.expect = Expect {
        violations_max: base.expect.violations_max,
        violations_from: made.expect.violations_from,
        // The run ends earlier, and faults may last until then.
        safety: made.expect.safety.take().map(|safety| SafetySpec {
            alive_for: None,
            ..safety
        }),
        rule: made.expect.rules_throughout(),
        ..Expect::default()
    };
    let times = made
        .fault
        .iter()
        .flat_map(|fault| [fault.from, fault.until]);
    let last = times.flatten().map(|time| time.0).max();
    let most = base.duration.0 * ADVERSITY_PERCENT / 100;
    let Some(last) = last.filter(|last| *last > most) else {
        return made;
    };
    let sooner = |time: Span| {
        let nanos = time.0.as_nanos() * most.as_nanos() / last.as_nanos().max(1);
        Span(Duration::from_nanos(
            u64::try_from(nanos).unwrap_or(u64::MAX),
        ))
    };
    for fault in &mut made.fault {
        fault.from = fault.from.map(sooner);
        // A window must not be empty.
        let least = Span(fault.from.map_or(Duration::ZERO, |from| from.0) + MOMENT);
        fault.until = fault.until.map(|until| sooner(until).max(least));
    }
    made
}

/// Minimum duration of a fault.
const MOMENT: Duration = Duration::from_millis(1);

/// The kinds of failure that a smaller case must share. Every goal is missed in a very short run or
/// in a world without walls, so such a case proves nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// A forbidden event occurs.
    Event,
    /// A goal is missed because of the faults.
    Spoilt,
    /// A goal is missed even without the faults.
    Hopeless,
}

impl Kind {
    fn of(start: &Scenario, fails: impl Fn(&Scenario) -> bool) -> Self {
        let mut moment = start.clone();
        moment.duration = Span::from_millis(50);
        if !fails(&moment) {
            Self::Event
        } else if fails(&without_faults(start)) {
            Self::Hopeless
        } else {
            Self::Spoilt
        }
    }

    fn is_alike(
        self,
        case: &Scenario,
        start: &Scenario,
        fails: impl Fn(&Scenario) -> bool,
    ) -> bool {
        let same = || {
            (&case.duration, &case.world, &case.mission)
                == (&start.duration, &start.world, &start.mission)
        };
        match self {
            Self::Event => fails(case),
            Self::Spoilt => fails(case) && !fails(&without_faults(case)),
            Self::Hopeless => same() && fails(case),
        }
    }
}

fn without_faults(case: &Scenario) -> Scenario {
    Scenario {
        fault: Vec::new(),
        ..case.clone()
    }
}

fn fault_of(record: Record) -> Option<Violation> {
    let cause = record.cause?;
    Some(Violation::new(cause, record.detail.unwrap_or_default()))
}

fn note(outcome: &Outcome, behaviour: &mut Behaviour) {
    for (name, &count) in &outcome.counters {
        behaviour.named(name, count);
    }
    for logged in &outcome.events {
        behaviour.named(logged.event.rule, 1);
    }
    for fault in &outcome.case.fault {
        behaviour.named(fault.kind.name(), 1);
    }
    let [visited, all] = outcome.waypoints.map(|count| count as u64);
    behaviour.note(&[visited, all, size(outcome.ran.as_secs())]);
}

impl Subject for Missions {
    fn name(&self) -> &str {
        &self.scenario.name
    }

    fn round(&self) -> u64 {
        8
    }

    /// The number of tries for a cause in a campaign.
    fn tries(&self) -> u32 {
        150
    }

    fn run(&self, choices: &[u8], behaviour: &mut Behaviour) -> Result<(), Violation> {
        let (fault, outcome) = self.judged(&self.made(choices));
        if let Some(outcome) = outcome {
            note(&outcome, behaviour);
        }
        fault.map_or(Ok(()), Err)
    }

    fn seeds(&self) -> Vec<Vec<u8>> {
        vec![Vec::new()]
    }

    fn in_words(&self, choices: &[u8]) -> String {
        self.made(choices).to_toml()
    }

    fn keep(&self, choices: &[u8], fault: &Violation, effort: &mut Effort<'_>) -> Kept {
        let made = self.made(choices);
        // Each try begins at a checkpoint of a similar one, and none is run twice.
        let branches = RefCell::new(Branches::new(&self.source, &fault.cause));
        let tried = |case: &Scenario| match fault.cause == UNWIRED {
            true => {
                let found = self.judged(case).0.map(|fault| fault.cause);
                Judged::of(found.as_deref(), UNWIRED)
            }
            false => branches.borrow_mut().judge(case),
        };
        let fails = |case: &Scenario| tried(case) == Judged::FailsAlike;
        // Written as the bytes that they hit, random faults can be removed one by one.
        let expanded = self.judged(&made).1.map(|outcome| outcome.case);
        let start = expanded.filter(|case| effort.spend() && fails(case));
        let start = start.unwrap_or(made);
        let kind = Kind::of(&start, fails);
        let judge = |case: &Scenario| match tried(case) {
            Judged::Passes => Judged::Passes,
            _ if kind.is_alike(case, &start, fails) => Judged::FailsAlike,
            _ => Judged::FailsOtherwise,
        };
        let small = shrink::scenario(&start, &fault.cause, judge, effort);
        let fault = self.judged(&small).0.unwrap_or_else(|| fault.clone());
        Kept {
            fault: Violation {
                detail: format!("{}\n{}", fault.detail, shrink::in_words(&small)),
                ..fault
            },
            files: vec![(CASE, small.to_toml().into_bytes())],
        }
    }

    fn case_file(&self) -> &'static str {
        CASE
    }

    fn repeat(&self, dir: &Path) -> String {
        format!("hilrig run {}", word(&dir.join(CASE)))
    }

    /// Choices cannot be reconstructed from a scenario.
    fn choices_of(&self, _: &str) -> Result<Option<Vec<u8>>, String> {
        Ok(None)
    }

    fn repeated(&self, text: &str) -> Result<Result<(), Violation>, String> {
        let case = Scenario::parse(Path::new(CASE), text.to_owned());
        let (case, _) = case.map_err(|error| error.to_string())?;
        Ok(self.judged(&case).0.map_or(Ok(()), Err))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scenario of ninety seconds with a fault.
    fn start() -> Scenario {
        let text = "schema = 1\nname = \"a\"\nrobot = \"rescue\"\nduration = \"90s\"\n\
            [world]\nstart = { x_m = 1.5, y_m = 1.5, heading_deg = 90 }\n[[fault]]\n\
            link = \"base\"\ndirection = \"to-master\"\nkind = \"drop\"\nrate = 0.1\n";
        let parsed = Scenario::parse(Path::new("<test>"), text.to_owned());
        parsed.expect("sound").0
    }

    fn of_a_moment(case: &Scenario) -> Scenario {
        Scenario {
            duration: Span::from_millis(50),
            ..case.clone()
        }
    }

    /// A case of five seconds keeps this length with any variation, and all faults end within it. A
    /// mission of ninety seconds may last half as long again: its goals are judged then.
    #[test]
    fn a_case_lasts_as_long_as_its_scenario() {
        for (duration, most) in [(5, 5), (90, 135)] {
            let mut scenario = start();
            scenario.fault.clear();
            scenario.duration = Span::from_millis(duration * 1000);
            let source = Source {
                path: Path::new("<test>").to_owned(),
                text: String::new(),
            };
            let missions = Missions::new(scenario, source, Vary::ALL, Profile::default());
            let mut faults = 0;
            for seed in 0..40_u8 {
                let choices: Vec<u8> = (0..=255).map(|at: u8| at.wrapping_mul(seed)).collect();
                let made = missions.made(&choices);
                assert!(made.duration <= Span::from_millis(most * 1000), "{seed}");
                for fault in &made.fault {
                    assert_eq!(fault.check(), Ok(()), "{fault:?}");
                    assert!(fault.from < Some(made.duration), "{fault:?}");
                    faults += 1;
                }
            }
            assert!(faults > 40, "{faults}");
        }
    }

    /// A goal that takes a minute, and that the fault prevents.
    #[test]
    fn a_goal_missed_in_a_moment_is_another_failure() {
        let start = start();
        let is_long = |case: &Scenario| case.duration >= Span::from_millis(60_000);
        let fails = |case: &Scenario| !is_long(case) || !case.fault.is_empty();
        let kind = Kind::of(&start, fails);
        assert_eq!(kind, Kind::Spoilt);
        assert!(kind.is_alike(&start, &start, fails));
        assert!(!kind.is_alike(&of_a_moment(&start), &start, fails));
        assert!(!kind.is_alike(&without_faults(&start), &start, fails));
    }

    #[test]
    fn a_goal_missed_without_faults_keeps_its_time() {
        let start = start();
        let kind = Kind::of(&start, |_| true);
        assert_eq!(kind, Kind::Hopeless);
        assert!(kind.is_alike(&without_faults(&start), &start, |_| true));
        assert!(!kind.is_alike(&of_a_moment(&start), &start, |_| true));
    }

    #[test]
    fn what_must_not_happen_may_happen_sooner() {
        let start = start();
        let fails = |case: &Scenario| case.duration >= Span::from_millis(1000);
        let kind = Kind::of(&start, fails);
        assert_eq!(kind, Kind::Event);
        let sooner = Scenario {
            duration: Span::from_millis(1000),
            ..start.clone()
        };
        assert!(kind.is_alike(&sooner, &start, fails));
    }
}
