//! How strong a campaign is: planted defects are switched on one by one, and the share that its
//! checkers find is counted.
//!
//! Each seed is run without a defect first. A defect is found by a check that fails with it and not
//! without it. A check that also fails without a defect, at other seeds, counts only if it fails
//! more than twice as often with it.

use core::sync::atomic::{AtomicUsize, Ordering};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;
use std::thread;

use engine::robots;
use engine::run::check::Status;
use engine::scenario::{Scenario, ScenarioError, Source};
use engine::workers;

use crate::campaign;
use crate::generate::{self, Dice, Profile, Vary};

/// Failures beyond twice those without a defect that are needed if there are any.
const MORE: u64 = 3;

/// A planted defect, and what found it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mutant {
    /// Name of the robot.
    pub robot: String,
    /// Number of the defect.
    pub defect: String,
    /// Runs that were made with it.
    pub runs: u64,
    /// The check that found it, and the scenario and seed of that run.
    pub found: Option<(String, String, u64)>,
}

/// Counts of failures by check, without and with a defect, at the same seeds.
type Counts = BTreeMap<String, [u64; 2]>;

/// The search for all defects of the robots of some scenarios.
#[derive(Debug)]
pub struct Mutants<'a> {
    scenarios: &'a BTreeMap<String, (Scenario, Source)>,
    profile: &'a Profile,
    vary: Vary,
    mutants: Vec<(Mutant, Counts)>,
    /// Runs without a defect that were made, and how many of them failed.
    pub sound: [u64; 2],
    /// Failures without a defect, by check.
    pub sound_failures: BTreeMap<String, u64>,
}

impl<'a> Mutants<'a> {
    /// All defects of the robots of `scenarios`, or those in `only` if there are any.
    pub fn new(
        scenarios: &'a BTreeMap<String, (Scenario, Source)>,
        profile: &'a Profile,
        vary: Vary,
        only: &[String],
    ) -> Self {
        let names: BTreeSet<&str> = scenarios.values().map(|(base, _)| &*base.robot).collect();
        let known = names.into_iter().filter_map(robots::find);
        let mutants = known.flat_map(|robot| {
            let ids = robot.defects().into_iter();
            let ids = ids.filter(|id| only.is_empty() || only.iter().any(|one| one == id));
            ids.map(|id| Mutant {
                robot: robot.name().to_owned(),
                defect: id.to_owned(),
                runs: 0,
                found: None,
            })
        });
        Self {
            scenarios,
            profile,
            vary,
            mutants: mutants.map(|mutant| (mutant, Counts::new())).collect(),
            sound: [0; 2],
            sound_failures: BTreeMap::new(),
        }
    }

    /// The defects, in the order of their numbers.
    pub fn all(&self) -> impl Iterator<Item = &Mutant> {
        self.mutants.iter().map(|(mutant, _)| mutant)
    }

    /// Runs one seed of each scenario, without and with each defect that was not found yet, on
    /// `jobs` threads. Stops when `is_over`, and returns false then.
    ///
    /// # Errors
    /// If a scenario cannot be wired.
    pub fn round(
        &mut self,
        seed: u64,
        jobs: usize,
        is_over: &(dyn Fn() -> bool + Sync),
    ) -> Result<bool, ScenarioError> {
        for (name, (base, source)) in self.scenarios {
            if is_over() {
                return Ok(false);
            }
            let mut dice = Dice::of_seed(seed, name);
            let mut made = generate::scenario(base, self.vary, self.profile, &mut dice);
            made.seed = seed;
            // What the scenario switches on itself is part of the sound run.
            let sound = failures(&made, source)?;
            self.sound[0] += 1;
            self.sound[1] += u64::from(!sound.is_empty());
            for check in &sound {
                *self.sound_failures.entry(check.clone()).or_default() += 1;
            }
            let todo: Vec<usize> = (0..self.mutants.len())
                .filter(|&index| {
                    let mutant = &self.mutants[index].0;
                    mutant.robot == base.robot && mutant.found.is_none()
                })
                .collect();
            let failed = self.run_with_defects(&made, source, &todo, jobs, is_over)?;
            for (index, found) in failed {
                self.mutants[index].take(&sound, &found, name, seed);
            }
        }
        Ok(true)
    }

    /// The checks that fail with each defect of `todo`.
    fn run_with_defects(
        &self,
        made: &Scenario,
        source: &Source,
        todo: &[usize],
        jobs: usize,
        is_over: &(dyn Fn() -> bool + Sync),
    ) -> Result<BTreeMap<usize, BTreeSet<String>>, ScenarioError> {
        let (next, done) = (AtomicUsize::new(0), Mutex::new(BTreeMap::new()));
        thread::scope(|scope| {
            for _ in 0..jobs.clamp(1, todo.len().max(1)) {
                let (next, done) = (&next, &done);
                workers::spawn(scope, move || {
                    while let Some(&index) = todo.get(next.fetch_add(1, Ordering::Relaxed)) {
                        if is_over() {
                            break;
                        }
                        let mut with = made.clone();
                        let id = self.mutants[index].0.defect.clone();
                        with.program.defects.push(toml::Spanned::new(0..0, id));
                        let failed = failures(&with, source);
                        done.lock().expect("no worker panics").insert(index, failed);
                    }
                });
            }
        });
        let done = done.into_inner().expect("no worker panics");
        done.into_iter()
            .map(|(index, failed)| Ok((index, failed?)))
            .collect()
    }
}

trait Judged {
    fn take(&mut self, sound: &BTreeSet<String>, failed: &BTreeSet<String>, name: &str, seed: u64);
}

impl Judged for (Mutant, Counts) {
    /// Takes the checks that failed at a seed, without and with the defect.
    fn take(&mut self, sound: &BTreeSet<String>, failed: &BTreeSet<String>, name: &str, seed: u64) {
        let (mutant, counts) = self;
        mutant.runs += 1;
        for check in sound {
            counts.entry(check.clone()).or_default()[0] += 1;
        }
        for check in failed {
            counts.entry(check.clone()).or_default()[1] += 1;
        }
        let shows = |check: &&String| {
            let [without, with] = counts.get(*check).copied().unwrap_or_default();
            !sound.contains(*check) && (without == 0 || with >= 2 * without + MORE)
        };
        if let Some(check) = failed.iter().find(shows) {
            mutant.found = Some((check.clone(), name.to_owned(), seed));
        }
    }
}

/// Names of the checks that fail; `panic` if the program does.
fn failures(made: &Scenario, source: &Source) -> Result<BTreeSet<String>, ScenarioError> {
    let (_, outcome) = campaign::run(made, source)?;
    let Some(outcome) = outcome else {
        return Ok(BTreeSet::from(["panic".to_owned()]));
    };
    let failed = outcome.checks.into_iter();
    let failed = failed.filter(|check| check.status == Status::Fail);
    Ok(failed.map(|check| check.name).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(names: &[&str]) -> BTreeSet<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    /// A check that never fails without a defect finds it at once. One that fails without it at one
    /// of ten seeds finds it after five failures (twice one, and three).
    #[test]
    fn a_check_that_fails_without_a_defect_finds_it_only_if_it_fails_more_often() {
        let new = || {
            let mutant = Mutant {
                robot: "r".to_owned(),
                defect: "D-1".to_owned(),
                runs: 0,
                found: None,
            };
            (mutant, Counts::new())
        };
        let mut judged = new();
        judged.take(&set(&["a"]), &set(&["a"]), "room", 0);
        assert_eq!(judged.0.found, None);
        judged.take(&set(&["a"]), &set(&["a", "b"]), "room", 1);
        assert_eq!(judged.0.found, Some(("b".to_owned(), "room".to_owned(), 1)));

        let mut judged = new();
        judged.take(&set(&["a"]), &set(&[]), "room", 0);
        for seed in 1..5 {
            judged.take(&set(&[]), &set(&["a"]), "room", seed);
            assert_eq!(judged.0.found, None);
        }
        judged.take(&set(&[]), &set(&["a"]), "room", 5);
        assert!(judged.0.found.is_some());
    }
}
