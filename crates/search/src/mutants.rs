//! Strength of a campaign: planted defects are activated one by one, and the share that the checks
//! detect is counted.
//!
//! Each seed runs without a defect first. A defect is detected by a check that fails with it and
//! not without it. A check that also fails without a defect, at other seeds, counts only if it
//! fails more than twice as often with the defect. The verdict is updated after each run without a
//! defect, so that the order of the seeds does not matter.

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

/// Required number of failures beyond twice the number without the defect, if that is not 0.
const MORE: u64 = 3;

/// A planted defect, and the check that detected it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mutant {
    /// Name of the robot.
    pub robot: String,
    /// Number of the defect.
    pub defect: String,
    /// Number of runs with the defect.
    pub runs: u64,
    /// Number of these runs whose bytes differ from those of the run without the defect. If it is
    /// 0, the defect never came into play; otherwise no check noticed its effect.
    pub differs: u64,
    /// The check that detected it, with scenario and seed of the run.
    pub found: Option<(String, String, u64)>,
}

/// Failures by check: their number, and the first scenario and seed at which the check fails with
/// the defect but not without it.
type Counts = BTreeMap<String, Count>;
type Count = (u64, Option<(String, u64)>);

/// The search for all defects of the robots in some scenarios.
#[derive(Debug)]
pub struct Mutants<'a> {
    scenarios: &'a BTreeMap<String, (Scenario, Source)>,
    profile: &'a Profile,
    vary: Vary,
    mutants: Vec<(Mutant, Counts)>,
    /// Number of runs without a defect, and of failed ones among them.
    pub sound: [u64; 2],
    /// Failures without a defect, by check.
    pub sound_failures: BTreeMap<String, u64>,
    /// Failures without a defect, by robot and check.
    sound_by_robot: BTreeMap<String, BTreeMap<String, u64>>,
}

impl<'a> Mutants<'a> {
    /// All defects of the robots of `scenarios`; if `only` is not empty, those in `only`.
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
                differs: 0,
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
            sound_by_robot: BTreeMap::new(),
        }
    }

    /// The defects in order of their numbers.
    pub fn all(&self) -> impl Iterator<Item = &Mutant> {
        self.mutants.iter().map(|(mutant, _)| mutant)
    }

    /// Runs one seed of each scenario, without a defect and with each defect that is not yet
    /// detected, on `jobs` threads. Stops when `is_over` returns true, and then returns false.
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
            let mut made = generate::scenario(base, source, self.vary, self.profile, &mut dice);
            made.seed = seed;
            // Defects that the scenario itself activates belong to the run without a planted
            // defect.
            let (sound, trace) = failures(&made, source)?;
            self.sound[0] += 1;
            self.sound[1] += u64::from(!sound.is_empty());
            let by_robot = self.sound_by_robot.entry(base.robot.clone()).or_default();
            for check in &sound {
                *self.sound_failures.entry(check.clone()).or_default() += 1;
                *by_robot.entry(check.clone()).or_default() += 1;
            }
            self.settle(&base.robot);
            let todo: Vec<usize> = (0..self.mutants.len())
                .filter(|&index| {
                    let mutant = &self.mutants[index].0;
                    mutant.robot == base.robot && mutant.found.is_none()
                })
                .collect();
            let failed = self.run_with_defects(&made, source, &todo, jobs, is_over)?;
            for (index, (found, own)) in failed {
                let mutant = &mut self.mutants[index];
                mutant.take(&sound, &found, name, seed);
                mutant.0.differs += u64::from(own != trace);
            }
            self.settle(&base.robot);
        }
        Ok(true)
    }

    /// Judges the defects of `robot` by all runs without a defect so far. A defect that counted as
    /// detected may have to be searched again.
    fn settle(&mut self, robot: &str) {
        let none = BTreeMap::new();
        let sound = self.sound_by_robot.get(robot).unwrap_or(&none);
        let own = self.mutants.iter_mut();
        for mutant in own.filter(|(mutant, _)| mutant.robot == robot) {
            mutant.settle(sound);
        }
    }

    /// The checks that fail with each defect of `todo`, and the trace.
    fn run_with_defects(
        &self,
        made: &Scenario,
        source: &Source,
        todo: &[usize],
        jobs: usize,
        is_over: &(dyn Fn() -> bool + Sync),
    ) -> Result<BTreeMap<usize, Judgement>, ScenarioError> {
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
    fn settle(&mut self, sound: &BTreeMap<String, u64>);
    fn take(&mut self, sound: &BTreeSet<String>, failed: &BTreeSet<String>, name: &str, seed: u64);
}

impl Judged for (Mutant, Counts) {
    /// Adds the checks that failed at a seed, without and with the defect.
    fn take(&mut self, sound: &BTreeSet<String>, failed: &BTreeSet<String>, name: &str, seed: u64) {
        let (mutant, counts) = self;
        mutant.runs += 1;
        for check in failed {
            let (count, first) = counts.entry(check.clone()).or_default();
            *count += 1;
            if !sound.contains(check) {
                first.get_or_insert_with(|| (name.to_owned(), seed));
            }
        }
    }

    /// Compares with the failures in all runs without a defect.
    fn settle(&mut self, sound: &BTreeMap<String, u64>) {
        let (mutant, counts) = self;
        let shows = |(check, (with, first)): (&String, &Count)| {
            let without = sound.get(check).copied().unwrap_or_default();
            let (name, seed) = first.clone()?;
            let is_found = without == 0 || *with >= 2 * without + MORE;
            is_found.then(|| (check.clone(), name, seed))
        };
        mutant.found = counts.iter().find_map(shows);
    }
}

/// The names of the failed checks, `panic` if the program panics, and the fingerprint of all bytes.
type Judgement = (BTreeSet<String>, String);

fn failures(made: &Scenario, source: &Source) -> Result<Judgement, ScenarioError> {
    let (_, outcome) = campaign::run(made, source)?;
    let Some(outcome) = outcome else {
        return Ok((BTreeSet::from(["panic".to_owned()]), String::new()));
    };
    let failed = outcome.checks.into_iter();
    let failed = failed.filter(|check| check.status == Status::Fail);
    let failed = failed.map(|check| check.name).collect();
    Ok((failed, outcome.trace_hash))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(names: &[&str]) -> BTreeSet<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    /// A check that never fails without a defect detects it at once. If the check later fails at a
    /// seed without the defect, it needs five failures (twice one, and three). The order of the
    /// seeds does not matter.
    #[test]
    fn a_check_that_fails_without_a_defect_finds_it_only_if_it_fails_more_often() {
        let judged = |seeds: [u64; 6], failures: usize| {
            let mutant = Mutant {
                robot: "r".to_owned(),
                defect: "D-1".to_owned(),
                runs: 0,
                differs: 0,
                found: None,
            };
            let mut judged = (mutant, Counts::new());
            let mut sound = BTreeMap::new();
            for seed in seeds {
                // Without the defect the check fails at seed 0 only.
                let without = set(if seed == 0 { &["a"] } else { &[] });
                for check in &without {
                    *sound.entry(check.clone()).or_default() += 1;
                }
                let fails = seed != 0 && seed <= failures as u64;
                let with = set(if fails { &["a"] } else { &[] });
                judged.take(&without, &with, "room", seed);
                judged.settle(&sound);
            }
            judged.0.found.map(|(check, ..)| check)
        };
        for seeds in [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]] {
            assert_eq!(judged(seeds, 4), None);
            assert_eq!(judged(seeds, 5), Some("a".to_owned()));
        }
        // Seeds that pass without a defect only.
        assert_eq!(judged([1; 6], 1), Some("a".to_owned()));
    }
}
