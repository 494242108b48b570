use std::path::Path;

use super::subject::{Behaviour, Fault, Kept, Subject, size};
use crate::campaign::{self, Record};
use crate::generate::{self, Dice, Vary};
use crate::run::Outcome;
use crate::scenario::{Scenario, Source};
use crate::shrink::{self, Effort};

/// A scenario: world, mission, timing and faults made of choices, run with everything that watches
/// a run.
#[derive(Debug)]
pub struct Missions {
    scenario: Scenario,
    source: Source,
    vary: Vary,
}

/// A file of a finding.
const CASE: &str = "case.toml";

impl Missions {
    /// What is made of `scenario` when `vary` of it is made anew.
    pub const fn new(scenario: Scenario, source: Source, vary: Vary) -> Self {
        Self {
            scenario,
            source,
            vary,
        }
    }

    fn made(&self, choices: &[u8]) -> Scenario {
        generate::scenario(&self.scenario, self.vary, &mut Dice::of_bytes(choices))
    }

    fn judged(&self, scenario: &Scenario) -> (Option<Fault>, Option<Box<Outcome>>) {
        match campaign::run(scenario, &self.source) {
            Ok((record, outcome)) => (fault_of(record), outcome),
            // What was generated must make sense.
            Err(error) => (Some(Fault::new("can-be-wired", error.to_string())), None),
        }
    }
}

fn fault_of(record: Record) -> Option<Fault> {
    let cause = record.cause?;
    Some(Fault::new(cause, record.detail.unwrap_or_default()))
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

    /// As many as a campaign spends on a cause.
    fn tries(&self) -> u32 {
        150
    }

    fn run(&self, choices: &[u8], behaviour: &mut Behaviour) -> Result<(), Fault> {
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

    fn keep(&self, choices: &[u8], fault: &Fault, effort: &mut Effort<'_>) -> Kept {
        let made = self.made(choices);
        let fails = |case: &Scenario| {
            let cause = self.judged(case).0.map(|fault| fault.cause);
            cause.as_ref() == Some(&fault.cause)
        };
        // As the bytes that they hit, random faults can be left out one by one.
        let expanded = self.judged(&made).1.map(|outcome| outcome.case);
        let start = expanded.filter(|case| effort.spend() && fails(case));
        let small = shrink::scenario(&start.unwrap_or(made), fails, effort);
        let fault = self.judged(&small).0.unwrap_or_else(|| fault.clone());
        Kept {
            fault: Fault {
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
        format!("hilrig run {}", dir.join(CASE).display())
    }

    /// A scenario is not made of choices that could be found again.
    fn choices_of(&self, _: &str) -> Result<Option<Vec<u8>>, String> {
        Ok(None)
    }

    fn repeated(&self, text: &str) -> Result<Result<(), Fault>, String> {
        let case = Scenario::parse(Path::new(CASE), text.to_owned());
        let (case, _) = case.map_err(|error| error.to_string())?;
        Ok(self.judged(&case).0.map_or(Ok(()), Err))
    }
}
