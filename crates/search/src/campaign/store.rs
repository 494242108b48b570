//! The folder of a shard: the plan, one line for each run, and one case for each cause.
//!
//! Finished runs are never at risk: runs are appended, all other files are written under a
//! temporary name and renamed, and only one process writes.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufReader, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use super::lines::{self, Line, LinesError};
use super::lock::Lock;
use super::runs::Runs;
use super::{CampaignPlan, Record, Run};
use crate::error::{StoreError, failed};
use crate::files;
use engine::scenario::Scenario;
use safefs::Dir;

/// A run of a campaign: scenario and seed.
type RunKey = (String, u64);

/// Runs with the same failure, while the campaign is running.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failures<'a> {
    /// The cause of the failure.
    pub cause: &'a str,
    /// Number of runs.
    pub runs: usize,
    /// The first run: scenario and seed.
    pub first: (&'a str, u64),
}

/// The folder of a shard, or of merged shards.
#[derive(Debug)]
pub struct Store {
    dir: PathBuf,
    plan: CampaignPlan,
    runs: Runs,
    /// The first run of each cause.
    first: BTreeMap<String, RunKey>,
    /// `None` if the folder is only read.
    writer: Option<Writer>,
}

/// Files that only the writing process has open.
#[derive(Debug)]
struct Writer {
    lines: File,
    _lock: Lock,
}

const PLAN: &str = "plan.json";
const RUNS: &str = "runs.jsonl";
const CASES: &str = "cases";
const PAGE: &str = "campaign.html";
/// Size of the read buffer, bytes.
const READ_AT_ONCE: usize = 1 << 16;

impl Store {
    /// Opens or creates `dir` to continue with `plan`, and locks out other processes. Removes a
    /// truncated last line.
    ///
    /// # Errors
    /// If the folder cannot be written, belongs to another campaign, or another process holds its
    /// lock.
    pub fn create(dir: &Path, plan: &CampaignPlan) -> Result<Self, StoreError> {
        files::make_folder(dir)?;
        let lock = Lock::take(dir)?;
        let wrong = |path: &Path, message: &str| StoreError::Content {
            path: path.to_owned(),
            message: message.to_owned(),
        };
        let (plan_path, runs_path) = (dir.join(PLAN), dir.join(RUNS));
        if plan_path.exists() {
            if let Some(message) = CampaignPlan::read(&plan_path)?.difference(plan) {
                return Err(wrong(&plan_path, &message));
            }
        } else if runs_path.exists() {
            let message = "has no plan.json in its folder, expected both files or another --out";
            return Err(wrong(&runs_path, message));
        } else {
            plan.write(dir, PLAN)?;
        }
        files::make_folder(&dir.join(CASES))?;
        let (mut store, whole) = Self::read(dir, plan.clone())?;
        let lines = append_to(dir)?;
        let cut = lines.metadata().and_then(|file| {
            let is_torn = file.len() > whole;
            if is_torn {
                lines.set_len(whole)
            } else {
                Ok(())
            }
        });
        cut.map_err(failed(&runs_path))?;
        store.writer = Some(Writer { lines, _lock: lock });
        Ok(store)
    }

    /// Reads the shard in `dir`. Ignores a truncated last line.
    ///
    /// # Errors
    /// If the folder is not that of a campaign, or one of its files cannot be read.
    pub fn open(dir: &Path) -> Result<Self, StoreError> {
        let plan = CampaignPlan::read(&dir.join(PLAN))?;
        Ok(Self::read(dir, plan)?.0)
    }

    /// Reads the runs of `plan` in `dir`; also returns the length of their lines in bytes.
    fn read(dir: &Path, plan: CampaignPlan) -> Result<(Self, u64), StoreError> {
        let path = dir.join(RUNS);
        let mut runs = Runs::new(plan.scenarios.keys().cloned());
        let whole = if path.exists() {
            let file = files::open(&path, "the runs of a campaign")?;
            let read = lines::read(BufReader::with_capacity(READ_AT_ONCE, file), |line| {
                let (scenario, seed) = (&line.scenario, line.seed);
                if plan.has(scenario, seed) && runs.insert(line) {
                    return Ok(());
                }
                Err(format!(
                    "{scenario:?} seed {seed} is not in plan.json, expected a run of this campaign"
                ))
            });
            read.map_err(|error| match error {
                LinesError::Read(error) => failed(&path)(error),
                LinesError::Content(message) => StoreError::Content { path, message },
            })?
        } else {
            0
        };
        let store = Self {
            dir: dir.to_owned(),
            plan,
            first: first_of_causes(&runs),
            runs,
            writer: None,
        };
        Ok((store, whole))
    }

    /// The plan of the campaign.
    pub const fn plan(&self) -> &CampaignPlan {
        &self.plan
    }

    /// The folder.
    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    /// Whether this run is finished.
    pub fn has(&self, scenario: &str, seed: u64) -> bool {
        self.runs.has(scenario, seed)
    }

    /// Number of finished runs.
    pub fn len(&self) -> usize {
        self.runs.len()
    }

    /// Whether no run is finished.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of failed runs.
    pub fn failed(&self) -> usize {
        self.runs.failed()
    }

    /// The finished runs in order.
    pub(crate) fn runs(&self) -> impl Iterator<Item = Run<'_>> {
        self.runs.iter()
    }

    /// The result of this run, if it is finished.
    pub fn run(&self, scenario: &str, seed: u64) -> Option<Run<'_>> {
        self.runs.get(scenario, seed)
    }

    /// Each cause so far with its number of failed runs.
    pub(super) fn causes(&self) -> impl Iterator<Item = (&str, usize)> {
        self.runs.causes()
    }

    /// Failures so far by cause, the most frequent first.
    pub fn failures(&self) -> Vec<Failures<'_>> {
        let known = self.causes().filter_map(|(cause, runs)| {
            let (scenario, seed) = self.first.get(cause)?;
            Some(Failures {
                cause,
                runs,
                first: (scenario, *seed),
            })
        });
        let mut known: Vec<Failures<'_>> = known.collect();
        known.sort_by(|a, b| b.runs.cmp(&a.runs).then_with(|| a.cause.cmp(b.cause)));
        known
    }

    /// Adds the result of a run; keeps its `case` if it is the first of its cause.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn add(&mut self, record: &Record, case: Option<&Scenario>) -> Result<(), StoreError> {
        let key = (record.scenario.clone(), record.seed);
        let replaced = match &record.cause {
            Some(cause) if self.first.get(cause).is_none_or(|first| key < *first) => {
                if let Some(case) = case {
                    let name = case_name(&key.0, key.1);
                    files::replace_for_good(&self.dir, name, case.to_toml().as_bytes())?;
                }
                self.first.insert(cause.clone(), key.clone())
            }
            _ => None,
        };
        let line = Line::of(record);
        // Written after the case, so that every run with a line has its case.
        if let Some(writer) = &mut self.writer {
            let written = writer.lines.write_all(line.text().as_bytes());
            written.map_err(failed(&self.dir.join(RUNS)))?;
        }
        self.runs.insert(&line);
        if let Some((scenario, seed)) = replaced {
            // The other run was the first until now; its case is no longer needed.
            self.forget(&scenario, seed);
        }
        Ok(())
    }

    /// Adds the runs of `others` with the cases of their causes; of two results of one run the
    /// later one counts. Sorts the lines, so that the order of merging does not matter.
    ///
    /// # Errors
    /// If a case cannot be read or the folder cannot be written.
    pub(super) fn take_over(&mut self, others: &[Self]) -> Result<(), StoreError> {
        for other in others {
            for run in other.runs() {
                self.runs.insert(&Line::of_kept(&run));
            }
        }
        let before = core::mem::replace(&mut self.first, first_of_causes(&self.runs));
        for (scenario, seed) in self.first.values() {
            let run = self.run(scenario, *seed);
            let has_it = |other: &&Self| other.run(scenario, *seed) == run;
            let cases = others.iter().filter(has_it);
            let mut cases = cases.map(|other| other.case(scenario, *seed));
            if let Some(from) = cases.find(|path| path.exists()) {
                let case = files::read(&from, "a case")?;
                files::replace_for_good(&self.dir, case_name(scenario, *seed), &case)?;
            }
        }
        if let Some(writer) = &mut self.writer {
            files::replace_with(&self.dir, RUNS, |file| {
                let mut file = BufWriter::new(file);
                for run in self.runs.iter() {
                    file.write_all(Line::of_kept(&run).text().as_bytes())?;
                }
                file.flush()
            })?;
            writer.lines = append_to(&self.dir)?;
        }
        let needed: BTreeSet<&RunKey> = self.first.values().collect();
        for key in before.values().filter(|key| !needed.contains(key)) {
            self.forget(&key.0, key.1);
        }
        Ok(())
    }

    /// Writes `page` into the folder, for readers that look at it while runs continue.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn show(&self, page: &str) -> Result<(), StoreError> {
        files::replace(&self.dir, PAGE, page.as_bytes())
    }

    /// The case of the first run of a cause in this shard.
    pub(crate) fn case(&self, scenario: &str, seed: u64) -> PathBuf {
        self.dir.join(case_name(scenario, seed))
    }

    /// Removes a case that is no longer needed. A failure only wastes disk space.
    fn forget(&self, scenario: &str, seed: u64) {
        let name = case_name(scenario, seed);
        let _ = Dir::open(&self.dir).and_then(|dir| dir.remove_file(name));
    }
}

/// The first run of each cause.
fn first_of_causes(runs: &Runs) -> BTreeMap<String, RunKey> {
    let mut first = BTreeMap::<String, RunKey>::new();
    for run in runs.iter() {
        match run.cause {
            Some(cause) if !first.contains_key(cause) => {
                first.insert(cause.to_owned(), (run.scenario.to_owned(), run.seed));
            }
            _ => {}
        }
    }
    first
}

/// The path of a case within the folder.
fn case_name(scenario: &str, seed: u64) -> PathBuf {
    Path::new(CASES).join(format!("{scenario}-{seed}.toml"))
}

fn append_to(dir: &Path) -> Result<File, StoreError> {
    let file = Dir::open(dir).and_then(|dir| dir.append(RUNS));
    file.map_err(failed(&dir.join(RUNS)))
}
