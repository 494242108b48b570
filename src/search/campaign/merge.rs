use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::judge::situations_of;
use super::store::read_plan;
use super::{CampaignPlan, Record, Store, page, run};
use crate::scenario::Scenario;
use crate::search::error::{StoreError, failed};
use crate::search::shrink::{self, Effort};

/// Most seeds named for a group.
const SEEDS_MAX: usize = 20;
/// Most runs spent on making the case of a group smaller. A number, not a time: merged anywhere, a
/// campaign comes to the same bytes.
const TRIES: u32 = 150;

/// Runs that failed alike.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Group {
    /// Checker and first broken rule, without figures.
    pub cause: String,
    /// What the first of them says, with figures.
    pub detail: String,
    /// How many there are.
    pub runs: usize,
    /// The first of them: scenario and seed.
    pub first: (String, u64),
    /// Some of the others.
    pub others: Vec<(String, u64)>,
    /// The smallest case of this cause, relative to the merged folder; none if the first run left
    /// no case, because it panicked.
    pub case: Option<String>,
    /// What is left in the case, in words.
    pub left: Option<String>,
}

/// How many runs came into a situation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct SituationCount {
    /// Which.
    pub situation: String,
    /// How many runs.
    pub runs: usize,
}

/// What a whole campaign came to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Merged {
    /// What was run.
    pub plan: CampaignPlan,
    /// Runs done.
    pub runs: usize,
    /// Runs that no shard has done.
    pub missing: usize,
    /// Runs that failed.
    pub failed: usize,
    /// Virtual time of all runs, milliseconds.
    pub ran_ms: u64,
    /// Fingerprint of all runs' fingerprints.
    pub trace: String,
    /// Failures by cause, the most frequent first.
    pub groups: Vec<Group>,
    /// Situations that must come up at least once in a campaign, and how often they did.
    pub situations: Vec<SituationCount>,
}

/// Merges the shards in `dirs`, and writes `campaign.json`, `campaign.html` and a minimised case
/// for each cause into `out`.
///
/// # Errors
/// If a folder cannot be read, the shards are of different campaigns, or `out` cannot be written.
pub(crate) fn merge(dirs: &[PathBuf], out: &Path) -> Result<Merged, StoreError> {
    let mut stores = Vec::new();
    let mut plan: Option<CampaignPlan> = None;
    for dir in dirs {
        let read = read_plan(dir)?;
        let known = plan.get_or_insert_with(|| read.clone());
        if *known != read {
            return Err(StoreError::Content {
                path: dir.clone(),
                message: format!("is of another campaign than {}", dirs[0].display()),
            });
        }
        stores.push(Store::open(dir)?);
    }
    let plan = plan.ok_or_else(|| StoreError::Content {
        path: out.to_owned(),
        message: "nothing to merge, expected at least one folder".to_owned(),
    })?;
    let records: BTreeMap<(&str, u64), &Record> = stores
        .iter()
        .flat_map(Store::records)
        .map(|record| ((record.scenario.as_str(), record.seed), record))
        .collect();
    let mut merged = count(plan, &records);
    for (number, group) in (1..).zip(&mut merged.groups) {
        minimise(group, number, (&merged.plan, &stores), out)?;
    }
    write(&merged, out)?;
    Ok(merged)
}

fn count(plan: CampaignPlan, records: &BTreeMap<(&str, u64), &Record>) -> Merged {
    let mut groups: BTreeMap<&str, Group> = BTreeMap::new();
    let mut traces = String::new();
    for record in records.values() {
        traces += &record.trace;
        let Some(cause) = &record.cause else { continue };
        let place = (record.scenario.clone(), record.seed);
        let group = groups.entry(cause).or_insert_with(|| Group {
            cause: cause.clone(),
            detail: record.detail.clone().unwrap_or_default(),
            runs: 0,
            first: place.clone(),
            others: Vec::new(),
            case: None,
            left: None,
        });
        group.runs += 1;
        if group.runs > 1 && group.others.len() < SEEDS_MAX {
            group.others.push(place);
        }
    }
    let mut groups: Vec<Group> = groups.into_values().collect();
    groups.sort_by(|a, b| b.runs.cmp(&a.runs).then_with(|| a.cause.cmp(&b.cause)));
    // Situations are counted inside the robot's own program.
    let inside = plan.scenarios.values().filter(|_| plan.exec.is_none());
    let wanted = inside.filter_map(|text| {
        let parsed = Scenario::parse(Path::new("<campaign>"), text.clone());
        parsed.ok().map(|(scenario, _)| situations_of(&scenario))
    });
    let mut names: Vec<&str> = wanted.flatten().copied().collect();
    names.dedup();
    let situations = names.into_iter().map(|name| SituationCount {
        situation: name.to_owned(),
        runs: records
            .values()
            .filter(|record| record.reached.contains(name))
            .count(),
    });
    Merged {
        runs: records.len(),
        missing: plan.runs().count().saturating_sub(records.len()),
        failed: records
            .values()
            .filter(|record| record.cause.is_some())
            .count(),
        ran_ms: records.values().map(|record| record.ran_ms).sum(),
        trace: crate::rig::trace::fingerprint(traces.as_bytes()),
        situations: situations.collect(),
        groups,
        plan,
    }
}

/// Finds the smallest case that fails for the cause of `group`, and writes it.
fn minimise(
    group: &mut Group,
    number: u32,
    (plan, stores): (&CampaignPlan, &[Store]),
    out: &Path,
) -> Result<(), StoreError> {
    let (scenario, seed) = &group.first;
    let paths = stores.iter().map(|store| store.case(scenario, *seed));
    let Some(path) = paths.into_iter().find(|path| path.exists()) else {
        return Ok(());
    };
    let (case, source) = Scenario::read(&path).map_err(|error| StoreError::Content {
        path,
        message: error.to_string(),
    })?;
    let cause = group.cause.clone();
    let fails = |case: &Scenario| {
        run(case, &source).is_ok_and(|(record, _)| record.cause.as_deref() == Some(&cause))
    };
    // A foreign program is not here to be asked: `hilrig shrink --exec` does so.
    let tries = if plan.exec.is_some() { 0 } else { TRIES };
    let small = shrink::scenario(&case, &cause, fails, &mut Effort::tries(tries));
    let name = format!("groups/{number:02}.toml");
    let dir = out.join("groups");
    fs::create_dir_all(&dir).map_err(failed(&dir))?;
    let path = out.join(&name);
    fs::write(&path, small.to_toml()).map_err(failed(&path))?;
    group.left = Some(shrink::in_words(&small));
    group.case = Some(name);
    Ok(())
}

fn write(merged: &Merged, out: &Path) -> Result<(), StoreError> {
    fs::create_dir_all(out).map_err(failed(out))?;
    let json = serde_json::to_string_pretty(merged).expect("plain data") + "\n";
    for (name, text) in [("campaign.json", json), ("campaign.html", page(merged))] {
        let path = out.join(name);
        fs::write(&path, text).map_err(failed(&path))?;
    }
    Ok(())
}
