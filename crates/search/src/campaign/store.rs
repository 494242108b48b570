//! What a shard leaves in its folder: the plan, a line for each run, and a case for each cause.
//!
//! Nothing that is finished is ever at risk: runs are appended, all else is written beside and
//! renamed, and one process at a time writes.

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

/// A run of a campaign: name of its scenario, seed.
type RunKey = (String, u64);

/// Runs that fail alike, as far as is known while others run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failures<'a> {
    /// Why they fail.
    pub cause: &'a str,
    /// Their number.
    pub runs: usize,
    /// The first of them: scenario and seed.
    pub first: (&'a str, u64),
}

/// The folder of a shard, or of shards that were merged.
#[derive(Debug)]
pub struct Store {
    dir: PathBuf,
    plan: CampaignPlan,
    runs: Runs,
    /// For each cause its first run.
    first: BTreeMap<String, RunKey>,
    /// `None` if it is only read.
    writer: Option<Writer>,
}

/// What only the process has that works in the folder.
#[derive(Debug)]
struct Writer {
    lines: File,
    _lock: Lock,
}

const PLAN: &str = "plan.json";
const RUNS: &str = "runs.jsonl";
const CASES: &str = "cases";
const PAGE: &str = "campaign.html";
/// Bytes of the runs that are read at once.
const READ_AT_ONCE: usize = 1 << 16;

impl Store {
    /// Opens `dir`, or makes it, to continue with `plan`, and keeps other processes out of it. A
    /// line that was cut off is cut away.
    ///
    /// # Errors
    /// If it cannot be written, belongs to another campaign, or another process works in it.
    pub fn create(dir: &Path, plan: &CampaignPlan) -> Result<Self, StoreError> {
        files::make_folder(dir)?;
        let lock = Lock::take(dir)?;
        let wrong = |path: &Path, message: &str| StoreError::Content {
            path: path.to_owned(),
            message: message.to_owned(),
        };
        let (plan_path, runs_path) = (dir.join(PLAN), dir.join(RUNS));
        if plan_path.exists() {
            if &CampaignPlan::read(&plan_path)? != plan {
                let message = "is of another campaign, expected the same scenarios, seeds, --vary, \
                    --profile, --exec and version, or another --out";
                return Err(wrong(&plan_path, message));
            }
        } else if runs_path.exists() {
            let message = "has no plan.json beside it, expected both or another --out";
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

    /// Reads what a shard left in `dir`. A last line that was cut off is left out.
    ///
    /// # Errors
    /// If it is not the folder of a campaign, or one of its files cannot be read.
    pub fn open(dir: &Path) -> Result<Self, StoreError> {
        let plan = CampaignPlan::read(&dir.join(PLAN))?;
        Ok(Self::read(dir, plan)?.0)
    }

    /// Reads the runs of `plan` in `dir`, and how long their lines are in bytes.
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

    /// The campaign that it belongs to.
    pub const fn plan(&self) -> &CampaignPlan {
        &self.plan
    }

    /// Its folder.
    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    /// Whether this run is done.
    pub fn has(&self, scenario: &str, seed: u64) -> bool {
        self.runs.has(scenario, seed)
    }

    /// How many runs are done.
    pub fn len(&self) -> usize {
        self.runs.len()
    }

    /// Whether no run is done.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How many of them failed.
    pub fn failed(&self) -> usize {
        self.runs.failed()
    }

    /// The runs done so far, in order.
    pub(crate) fn runs(&self) -> impl Iterator<Item = Run<'_>> {
        self.runs.iter()
    }

    /// Result of this run, if it is done.
    pub fn run(&self, scenario: &str, seed: u64) -> Option<Run<'_>> {
        self.runs.get(scenario, seed)
    }

    /// Each cause so far, and how many runs failed for it.
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

    /// Adds what a run of the plan came to; its `case` is kept if it is the first of its cause.
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
        // After the case: a run that has its line has its case as well.
        if let Some(writer) = &mut self.writer {
            let written = writer.lines.write_all(line.text().as_bytes());
            written.map_err(failed(&self.dir.join(RUNS)))?;
        }
        self.runs.insert(&line);
        if let Some((scenario, seed)) = replaced {
            // It was the first until now; its case is of no use any more.
            self.forget(&scenario, seed);
        }
        Ok(())
    }

    /// Takes over what `others` have done, with the cases of causes; of two results of one run the
    /// later counts. The lines are in order then, whatever was merged in which order.
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

    /// The case of a run that was the first of its cause in this shard.
    pub(crate) fn case(&self, scenario: &str, seed: u64) -> PathBuf {
        self.dir.join(case_name(scenario, seed))
    }

    /// Removes a case that is of use no more. One that stays costs nothing but its space.
    fn forget(&self, scenario: &str, seed: u64) {
        let name = case_name(scenario, seed);
        let _ = Dir::open(&self.dir).and_then(|dir| dir.remove_file(name));
    }
}

/// For each cause its first run.
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

/// Where the case of a run is, in the folder of its shard.
fn case_name(scenario: &str, seed: u64) -> PathBuf {
    Path::new(CASES).join(format!("{scenario}-{seed}.toml"))
}

fn append_to(dir: &Path) -> Result<File, StoreError> {
    let file = Dir::open(dir).and_then(|dir| dir.append(RUNS));
    file.map_err(failed(&dir.join(RUNS)))
}
