//! Comparison with an earlier campaign, cause by cause.
//!
//! Two runs are the same if scenario, seed and variation are equal. Only such runs show that a
//! defect is fixed. A cause without failures is not known to be fixed if its seeds were not run
//! again, or if its runs now fail earlier for another cause.

use core::fmt;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::Serialize;

use super::{CampaignPlan, Run, Store};
use engine::scenario::Scenario;

/// The change of a cause, most urgent first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Change {
    /// No run of the earlier campaign failed for this cause.
    New,
    /// Runs of both campaigns fail for this cause.
    StillFailing,
    /// No run fails for this cause now, but some earlier ones were not run again or fail for
    /// another cause.
    NotKnown,
    /// Each run that failed for this cause passes now.
    Fixed,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::New => "new",
            Self::StillFailing => "still failing",
            Self::NotKnown => "not known",
            Self::Fixed => "fixed",
        })
    }
}

/// Runs that fail for a cause, counted by their results in the other campaign. The runs that are
/// not counted below fail there for the same cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Elsewhere {
    /// Number of runs.
    pub runs: usize,
    /// Number of runs that pass in the other campaign.
    pub pass: usize,
    /// Number of runs that fail there for another cause.
    pub fail_otherwise: usize,
    /// Number of runs that were not run there.
    pub not_run: usize,
}

/// The change of one cause between two campaigns.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct CauseChange {
    /// The cause, as in the groups.
    pub cause: String,
    /// The kind of change.
    pub change: Change,
    /// Runs that fail for the cause now, by their earlier results.
    pub now: Elsewhere,
    /// Runs that failed for the cause earlier, by their results now.
    pub earlier: Elsewhere,
    /// An example run, preferably the first that fails now: scenario and seed.
    pub first: (String, u64),
}

impl CauseChange {
    /// The numbers of failures in words.
    pub fn in_words(&self) -> String {
        let (now, earlier) = (self.now.runs, self.earlier.runs);
        let counts = match self.change {
            Change::New => format!("{now} runs{}", self.now.in_words("before")),
            Change::StillFailing => {
                format!(
                    "{now} runs, {earlier} before{}",
                    self.earlier.in_words("now")
                )
            }
            Change::NotKnown | Change::Fixed => {
                format!("{earlier} runs before{}", self.earlier.in_words("now"))
            }
        };
        let (scenario, seed) = &self.first;
        format!("{counts}, first {scenario} seed {seed}")
    }
}

impl Elsewhere {
    /// The results in the other campaign in words; `when` names that campaign.
    fn in_words(self, when: &str) -> String {
        let alike = self.runs - self.pass - self.fail_otherwise - self.not_run;
        let parts = [
            (alike, "fail alike"),
            (self.pass, "pass"),
            (self.fail_otherwise, "fail otherwise"),
            (self.not_run, "not run"),
        ];
        let parts = parts.iter().filter(|(count, _)| *count > 0);
        let parts: Vec<String> = parts
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        format!(" ({when}: {})", parts.join(", "))
    }
}

/// The comparison with an earlier campaign.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Comparison {
    /// Folder of the earlier campaign.
    pub against: String,
    /// Name and version of the tool that ran the earlier campaign.
    pub tool: String,
    /// Number of runs in both campaigns.
    pub runs_in_both: usize,
    /// Whether `--vary` or `--profile` differs: then no runs are comparable.
    pub vary_differs: bool,
    /// Scenarios with the same name and different content: their runs are not comparable.
    pub differing_scenarios: Vec<String>,
    /// The change of each cause.
    pub causes: Vec<CauseChange>,
}

impl Comparison {
    /// The comparison in one line.
    pub fn in_words(&self) -> String {
        let kinds = [
            Change::New,
            Change::StillFailing,
            Change::NotKnown,
            Change::Fixed,
        ];
        let counts = kinds.map(|kind| {
            let count = self.causes.iter().filter(|cause| cause.change == kind);
            format!("{} {kind}", count.count())
        });
        let (against, both) = (&self.against, self.runs_in_both);
        let tool = &self.tool;
        let counts = counts.join(", ");
        format!("compared with {against} ({tool}): {counts}; {both} runs in both")
    }

    /// The runs that were not compared, with the reason.
    pub fn left_out(&self) -> Vec<String> {
        if self.vary_differs {
            return vec!["--vary or --profile differs: no run is compared".to_owned()];
        }
        let names = self.differing_scenarios.iter();
        names
            .map(|name| format!("scenario {name} differs: its runs are not compared"))
            .collect()
    }
}

/// Compares `now` with `earlier`; `against` is the folder of the earlier campaign.
pub fn compare(now: &Store, earlier: &Store, against: &Path) -> Comparison {
    let (mut same, differing) = scenarios_in_both(now.plan(), earlier.plan());
    let made = |store: &Store| (store.plan().vary.clone(), store.plan().profile.clone());
    let vary_differs = made(now) != made(earlier);
    if vary_differs {
        same.clear();
    }
    let causes: BTreeSet<&str> = [now, earlier].into_iter().flat_map(causes_of).collect();
    let now_by_cause = elsewhere(now, earlier, &same);
    let earlier_by_cause = elsewhere(earlier, now, &same);
    let changes = causes.into_iter().map(|cause| {
        let now = now_by_cause.get(cause);
        let before = earlier_by_cause.get(cause);
        let first = now
            .or(before)
            .map(|(_, first)| (first.0.to_owned(), first.1));
        let now = now.map(|(counts, _)| *counts).unwrap_or_default();
        let before = before.map(|(counts, _)| *counts).unwrap_or_default();
        let change = match (now.runs, before.runs) {
            (0, runs) if runs == before.pass => Change::Fixed,
            (0, _) => Change::NotKnown,
            (_, 0) => Change::New,
            _ => Change::StillFailing,
        };
        CauseChange {
            cause: cause.to_owned(),
            change,
            now,
            earlier: before,
            first: first.unwrap_or_default(),
        }
    });
    let mut causes: Vec<CauseChange> = changes.collect();
    causes.sort_by_key(|cause| {
        let runs = core::cmp::Reverse(cause.now.runs.max(cause.earlier.runs));
        (cause.change, runs, cause.cause.clone())
    });
    let in_both = now.runs().filter(|run| twin(run, earlier, &same).is_some());
    Comparison {
        against: against.display().to_string(),
        tool: earlier.plan().tool.clone(),
        runs_in_both: in_both.count(),
        vary_differs,
        differing_scenarios: differing.into_iter().map(str::to_owned).collect(),
        causes,
    }
}

fn causes_of(store: &Store) -> impl Iterator<Item = &str> {
    store.causes().map(|(cause, _)| cause)
}

/// Names of scenarios in both plans: the equal ones, then the different ones.
fn scenarios_in_both<'a>(
    now: &'a CampaignPlan,
    earlier: &CampaignPlan,
) -> (BTreeSet<&'a str>, BTreeSet<&'a str>) {
    let both = now.scenarios.iter().filter_map(|(name, text)| {
        let before = earlier.scenarios.get(name)?;
        Some((name.as_str(), is_same(text, before)))
    });
    let (same, differing): (Vec<_>, Vec<_>) = both.partition(|(_, is_same)| *is_same);
    let names = |pairs: Vec<(&'a str, bool)>| pairs.into_iter().map(|(name, _)| name).collect();
    (names(same), names(differing))
}

/// Whether two texts define the same scenario, apart from comments and layout.
fn is_same(text: &str, other: &str) -> bool {
    let parsed = |text: &str| {
        let parsed = Scenario::parse(Path::new("<campaign>"), text.to_owned());
        parsed.map(|(scenario, _)| scenario.to_toml()).ok()
    };
    text == other || parsed(text).is_some_and(|text| Some(text) == parsed(other))
}

/// The same run in `other`, if it exists there.
fn twin<'a>(run: &Run<'_>, other: &'a Store, same: &BTreeSet<&str>) -> Option<Run<'a>> {
    let is_same = same.contains(run.scenario);
    let key = is_same.then_some((run.scenario, run.seed));
    key.and_then(|(scenario, seed)| other.run(scenario, seed))
}

/// Scenario and seed of a run.
type RunKey<'a> = (&'a str, u64);

/// For each cause in `store`: the results of its runs in `other`, and its first run.
fn elsewhere<'a>(
    store: &'a Store,
    other: &Store,
    same: &BTreeSet<&str>,
) -> BTreeMap<&'a str, (Elsewhere, RunKey<'a>)> {
    let mut causes = BTreeMap::new();
    for run in store.runs() {
        let Some(cause) = run.cause else {
            continue;
        };
        let first = (run.scenario, run.seed);
        let (counts, _) = causes.entry(cause).or_insert((Elsewhere::default(), first));
        counts.runs += 1;
        match twin(&run, other, same).map(|twin| twin.cause) {
            None => counts.not_run += 1,
            Some(None) => counts.pass += 1,
            Some(Some(theirs)) => counts.fail_otherwise += usize::from(theirs != cause),
        }
    }
    causes
}
