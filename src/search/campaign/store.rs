//! What a shard leaves in its folder: the plan, a line for each run, and a case for each cause.

use core::ops::Range;
use core::str::FromStr;
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Record;
use crate::scenario::Scenario;
use crate::search::error::{StoreError, failed};

/// Which part of a campaign: every `of`-th run, from `index` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Shard {
    /// Number of this shard, from 0.
    pub index: usize,
    /// How many there are.
    pub of: usize,
}

impl Shard {
    /// All of it.
    pub(crate) const WHOLE: Self = Self { index: 0, of: 1 };

    /// Whether the run with this number in the list belongs to it.
    pub(crate) const fn has(self, number: usize) -> bool {
        number % self.of == self.index
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once('/').and_then(|(index, of)| {
            let (index, of) = (index.parse().ok()?, of.parse().ok()?);
            (index < of).then_some(Self { index, of })
        });
        parsed.ok_or_else(|| "expected I/N with I from 0 to N-1, e.g. 0/4".to_owned())
    }
}

/// What a campaign runs: equal plans may be merged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CampaignPlan {
    /// Tool and version.
    pub tool: String,
    /// Name and text of each scenario.
    pub scenarios: BTreeMap<String, String>,
    /// First seed, and the one after the last.
    pub seeds: Range<u64>,
    /// What is made anew for each seed, as on the command line.
    pub vary: String,
    /// Options that name somebody's program, as on the command line, if it is one: its runs are in
    /// real time, so that no two are the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exec: Option<String>,
}

impl CampaignPlan {
    /// All runs in order: number, name of the scenario, seed.
    pub(crate) fn runs(&self) -> impl Iterator<Item = (usize, &str, u64)> {
        let pairs = self.scenarios.keys().flat_map(|name| {
            let seeds = self.seeds.clone();
            seeds.map(move |seed| (name.as_str(), seed))
        });
        pairs
            .enumerate()
            .map(|(number, (name, seed))| (number, name, seed))
    }
}

/// The folder of a shard.
#[derive(Debug)]
pub(crate) struct Store {
    dir: PathBuf,
    lines: Option<File>,
    records: BTreeMap<(String, u64), Record>,
    /// For each cause the first run in order that has it.
    first: BTreeMap<String, (String, u64)>,
}

const PLAN: &str = "plan.json";
const RUNS: &str = "runs.jsonl";

impl Store {
    /// Opens `dir`, or makes it, to go on with `plan`.
    ///
    /// # Errors
    /// If it cannot be written, or belongs to another campaign.
    pub(crate) fn create(dir: &Path, plan: &CampaignPlan) -> Result<Self, StoreError> {
        fs::create_dir_all(dir.join("cases")).map_err(failed(dir))?;
        let path = dir.join(PLAN);
        if path.exists() {
            if &read_plan(dir)? != plan {
                let message = "is of another campaign, expected the same scenarios, seeds, --vary, \
                    --exec and version, or another --out";
                return Err(StoreError::Content {
                    path,
                    message: message.to_owned(),
                });
            }
        } else {
            let text = serde_json::to_string_pretty(plan).expect("plain data");
            fs::write(&path, text + "\n").map_err(failed(&path))?;
        }
        let mut store = Self::open(dir)?;
        let path = dir.join(RUNS);
        // What a kill left of a line is dropped with the file written anew.
        let known: Vec<String> = store.records.values().map(line).collect();
        fs::write(&path, known.concat()).map_err(failed(&path))?;
        let lines = OpenOptions::new().append(true).open(&path);
        store.lines = Some(lines.map_err(failed(&path))?);
        Ok(store)
    }

    /// Reads what a shard left in `dir`. A last line that was cut off is left out.
    pub(crate) fn open(dir: &Path) -> Result<Self, StoreError> {
        let mut store = Self {
            dir: dir.to_owned(),
            lines: None,
            records: BTreeMap::new(),
            first: BTreeMap::new(),
        };
        let path = dir.join(RUNS);
        if !path.exists() {
            return Ok(store);
        }
        let text = fs::read_to_string(&path).map_err(failed(&path))?;
        let whole = text
            .split_inclusive('\n')
            .filter(|line| line.ends_with('\n'));
        for (number, line) in (1..).zip(whole) {
            let record = serde_json::from_str(line).map_err(|error| StoreError::Content {
                path: path.clone(),
                message: format!("line {number}: {error}, expected a run"),
            })?;
            store.note(record);
        }
        Ok(store)
    }

    /// Keeps `record` in memory; whether it is the first of its cause.
    fn note(&mut self, record: Record) -> bool {
        let key = (record.scenario.clone(), record.seed);
        let mut is_first = false;
        if let Some(cause) = &record.cause {
            let first = self
                .first
                .entry(cause.clone())
                .or_insert_with(|| key.clone());
            *first = key.clone().min(first.clone());
            is_first = *first == key;
        }
        self.records.insert(key, record);
        is_first
    }

    /// Whether this run is done.
    pub(crate) fn has(&self, scenario: &str, seed: u64) -> bool {
        self.records.contains_key(&(scenario.to_owned(), seed))
    }

    /// The runs done so far, in order.
    pub(crate) fn records(&self) -> impl Iterator<Item = &Record> {
        self.records.values()
    }

    /// Adds what a run came to; its `case` is kept if it is the first of its cause.
    pub(crate) fn add(
        &mut self,
        record: Record,
        case: Option<&Scenario>,
    ) -> Result<(), StoreError> {
        let path = self.dir.join(RUNS);
        let text = line(&record);
        let case_path = case_path(&self.dir, &record.scenario, record.seed);
        let before = record
            .cause
            .as_ref()
            .and_then(|cause| self.first.get(cause).cloned());
        if self.note(record)
            && let Some(case) = case
        {
            fs::write(&case_path, case.to_toml()).map_err(failed(&case_path))?;
            if let Some((scenario, seed)) = before {
                // The other one was first until now; its case is of no use any more.
                let _ = fs::remove_file(self::case_path(&self.dir, &scenario, seed));
            }
        }
        let Some(lines) = &mut self.lines else {
            return Ok(());
        };
        lines.write_all(text.as_bytes()).map_err(failed(&path))
    }

    /// The case of a run that was the first of its cause in this shard.
    pub(crate) fn case(&self, scenario: &str, seed: u64) -> PathBuf {
        case_path(&self.dir, scenario, seed)
    }
}

fn case_path(dir: &Path, scenario: &str, seed: u64) -> PathBuf {
    dir.join("cases").join(format!("{scenario}-{seed}.toml"))
}

fn line(record: &Record) -> String {
    serde_json::to_string(record).expect("plain data") + "\n"
}

/// The plan of the shard in `dir`.
pub(super) fn read_plan(dir: &Path) -> Result<CampaignPlan, StoreError> {
    let path = dir.join(PLAN);
    let text = fs::read_to_string(&path).map_err(failed(&path))?;
    serde_json::from_str(&text).map_err(|error| StoreError::Content {
        path,
        message: format!("{error}, expected the plan of a campaign"),
    })
}
