use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::judge::{self, rules_of, situations_of};
use super::strip::Strip;
use super::{CampaignPlan, Comparison, Store, compare, page};
use crate::error::{StoreError, failed};
use crate::files;
use crate::shrink::{self, Branches, Effort};
use engine::scenario::Scenario;
use show::moment;

/// Maximum number of seeds named for a group.
const SEEDS_MAX: usize = 20;
/// Maximum number of runs that minimise the case of a group. The limit is a number, not a time, so
/// that a merge gives the same bytes on every machine.
const TRIES: u32 = 150;
/// The same for a case with more than [`MANY_FAULTS`] faults: each try takes many seconds.
const TRIES_OF_MANY: u32 = 15;
const MANY_FAULTS: usize = 5_000;

/// Runs with the same failure.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Group {
    /// Checker and first broken rule, without figures.
    pub cause: String,
    /// The message of the first run, with figures.
    pub detail: String,
    /// Number of runs.
    pub runs: usize,
    /// The first run: scenario and seed.
    pub first: (String, u64),
    /// Some of the other runs.
    pub others: Vec<(String, u64)>,
    /// The smallest case of this cause, relative to the merged folder; none if the first run left
    /// no case, because it panicked. If the program is not available here, the case of the first
    /// run.
    pub case: Option<String>,
    /// The content of the case in words.
    pub left: Option<String>,
    /// Whether the case was minimised.
    pub is_minimised: bool,
    /// The case at its failure, as SVG; none if the program is not available here.
    #[serde(skip)]
    pub picture: Option<String>,
}

/// Kinds of items that a campaign counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Counted {
    /// A situation of the robot.
    Situation,
    /// A goal of a scenario, without which the campaign fails.
    Goal,
    /// A rule of a scenario, which a run must have observed, or the campaign fails.
    Rule,
    /// A rule or goal that the generated missions of all runs have lost.
    LostRule,
}

/// Number of runs that reached a situation or a goal, or observed a rule.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SituationCount {
    /// Name of the situation, goal or rule.
    pub situation: String,
    /// Situation, goal or rule.
    pub kind: Counted,
    /// Number of runs.
    pub runs: usize,
}

/// The result of a whole campaign.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Merged {
    /// Plan of the campaign.
    pub plan: CampaignPlan,
    /// Number of finished runs.
    pub runs: usize,
    /// Number of runs that no shard has done.
    pub missing: usize,
    /// Number of failed runs.
    pub failed: usize,
    /// Virtual time of all runs, milliseconds.
    pub ran_ms: u64,
    /// Fingerprint over the fingerprints of all runs.
    pub trace: String,
    /// Failures by cause, the most frequent first.
    pub groups: Vec<Group>,
    /// Situations that must occur at least once in a campaign, with their numbers of runs.
    pub situations: Vec<SituationCount>,
    /// The comparison with an earlier campaign, if the user named one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub comparison: Option<Comparison>,
    /// Whether a situation that no run had fails the campaign.
    #[serde(skip)]
    pub demand: Demand,
    /// All runs in order.
    #[serde(skip)]
    pub strip: Strip,
}

/// Whether situations that no run had fail the campaign.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Demand {
    /// No; they are listed.
    #[default]
    Listed,
    /// Yes, by `--all-situations`.
    Needed,
}

impl Merged {
    /// The virtual time of all runs, in words: `48 s`, `13.4 min`, `2.1 h`.
    pub fn virtual_time(&self) -> String {
        let seconds = self.ran_ms as f64 / 1e3;
        match seconds {
            ..120.0 => format!("{seconds:.0} s"),
            ..3600.0 => format!("{:.1} min", seconds / 60.0),
            _ => format!("{:.1} h", seconds / 3600.0),
        }
    }

    /// Goals that no run reached, in the order of their scenarios.
    pub fn missed_goals(&self) -> impl Iterator<Item = &str> {
        self.missed(Counted::Goal)
    }

    /// Rules that no run observed.
    pub fn unobserved_rules(&self) -> impl Iterator<Item = &str> {
        self.missed(Counted::Rule)
    }

    /// Rules and goals that no run has judged, because no generated mission or world has them.
    pub fn lost_rules(&self) -> impl Iterator<Item = &str> {
        self.missed(Counted::LostRule)
    }

    /// Situations that no run reached, without rules and goals.
    pub fn missed_situations(&self) -> impl Iterator<Item = &str> {
        self.missed(Counted::Situation)
    }

    fn missed(&self, kind: Counted) -> impl Iterator<Item = &str> {
        let all = self.situations.iter();
        let missed = all.filter(move |one| one.kind == kind && one.runs == 0);
        missed.map(|one| one.situation.as_str())
    }
}

impl Demand {
    /// The demand of `--all-situations`.
    pub const fn of_flag(all_situations: bool) -> Self {
        match all_situations {
            true => Self::Needed,
            false => Self::Listed,
        }
    }
}

/// Merges the shards in `dirs` into the folder `out`, together with runs of the same campaign that
/// `out` already contains. The result can be continued or merged again.
///
/// # Errors
/// If a folder cannot be read, the shards belong to different campaigns, or `out` cannot be
/// written.
pub fn merge(dirs: &[PathBuf], out: &Path) -> Result<Store, StoreError> {
    let stores = dirs.iter().map(|dir| Store::open(dir));
    let stores: Vec<Store> = stores.collect::<Result<_, _>>()?;
    let first = stores.first().ok_or_else(|| StoreError::Content {
        path: out.to_owned(),
        message: "nothing to merge, expected at least one folder".to_owned(),
    })?;
    if let Some(other) = stores
        .iter()
        .find(|store| first.plan().difference(store.plan()).is_some())
    {
        return Err(StoreError::Content {
            path: other.dir().to_owned(),
            message: format!("is of another campaign than {}", first.dir().display()),
        });
    }
    let mut merged = Store::create(out, first.plan())?;
    merged.take_over(&stores)?;
    Ok(merged)
}

/// Summarises `store`, compared with `earlier` if given. Writes `campaign.json`, `campaign.html`
/// and a minimised case for each cause into the folder of `store`. When `is_over` returns true,
/// minimisation stops and the cases keep their size.
///
/// # Errors
/// If a case cannot be read, or the folder cannot be written.
pub fn summarise(
    store: &Store,
    earlier: Option<&(PathBuf, Store)>,
    demand: Demand,
    is_over: &dyn Fn() -> bool,
) -> Result<Merged, StoreError> {
    let mut merged = count(store);
    merged.demand = demand;
    for (number, group) in (1..).zip(&mut merged.groups) {
        minimise(group, number, store, is_over)?;
    }
    merged.comparison = earlier.map(|(dir, earlier)| compare(store, earlier, dir));
    write(&merged, store.dir())?;
    store.show(&page(&merged))?;
    Ok(merged)
}

fn count(store: &Store) -> Merged {
    let plan = store.plan();
    let mut groups: BTreeMap<&str, Group> = BTreeMap::new();
    let mut traces = String::with_capacity(store.len().saturating_mul(16));
    let mut reached: BTreeMap<&[String], usize> = BTreeMap::new();
    let mut ran_ms = 0_u64;
    for run in store.runs() {
        traces += &run.trace();
        ran_ms = ran_ms.saturating_add(run.ran_ms);
        *reached.entry(run.reached).or_default() += 1;
        let Some(cause) = run.cause else { continue };
        let place = (run.scenario.to_owned(), run.seed);
        let group = groups.entry(cause).or_insert_with(|| Group {
            cause: cause.to_owned(),
            detail: run.detail.unwrap_or_default().to_owned(),
            runs: 0,
            first: place.clone(),
            others: Vec::new(),
            case: None,
            left: None,
            is_minimised: false,
            picture: None,
        });
        group.runs += 1;
        if group.runs > 1 && group.others.len() < SEEDS_MAX {
            group.others.push(place);
        }
    }
    let mut groups: Vec<Group> = groups.into_values().collect();
    groups.sort_by(|a, b| b.runs.cmp(&a.runs).then_with(|| a.cause.cmp(&b.cause)));
    let numbers: BTreeMap<&str, usize> = groups.iter().map(|one| &*one.cause).zip(0..).collect();
    let causes = store.runs().map(|run| run.cause);
    let strip = Strip::of(causes, |cause| numbers.get(cause).copied());
    Merged {
        strip,
        runs: store.len(),
        missing: plan.len().saturating_sub(store.len()),
        failed: store.failed(),
        ran_ms,
        trace: engine::rig::trace::fingerprint(traces.as_bytes()),
        situations: situations(plan, &reached),
        groups,
        plan: plan.clone(),
        comparison: None,
        demand: Demand::default(),
    }
}

/// Counts the runs that reached each required situation; `reached` counts runs by sets of
/// situations.
fn situations(plan: &CampaignPlan, reached: &BTreeMap<&[String], usize>) -> Vec<SituationCount> {
    let runs_with = |name: &String| -> usize {
        let sets = reached.iter().filter(|(set, _)| set.contains(name));
        sets.map(|(_, runs)| runs).sum()
    };
    let mut wanted: Vec<(String, Counted)> = Vec::new();
    for text in plan.scenarios.values() {
        let parsed = Scenario::parse(Path::new("<campaign>"), text.clone());
        let Ok((scenario, _)) = parsed else { continue };
        wanted.extend(rules_of(&scenario).map(|rule| {
            let kind = match (runs_with(&rule.asked()), rule.is_goal) {
                (0, _) => Counted::LostRule,
                (_, true) => Counted::Goal,
                (_, false) => Counted::Rule,
            };
            (rule.name, kind)
        }));
        // Only the built-in program counts its situations.
        if plan.exec.is_none() {
            let situations = situations_of(&scenario).iter();
            wanted.extend(situations.map(|&name| (name.to_owned(), Counted::Situation)));
        }
    }
    let mut known = BTreeSet::new();
    wanted.retain(|(name, _)| known.insert(name.clone()));
    let counts = wanted.into_iter().map(|(situation, kind)| SituationCount {
        runs: runs_with(&situation),
        situation,
        kind,
    });
    counts.collect()
}

/// Finds the smallest case that fails for the cause of `group`, and writes it.
fn minimise(
    group: &mut Group,
    number: u32,
    store: &Store,
    is_over: &dyn Fn() -> bool,
) -> Result<(), StoreError> {
    let (scenario, seed) = &group.first;
    let path = store.case(scenario, *seed);
    if !path.exists() {
        return Ok(());
    }
    safefs::open(&path).map_err(failed(&path))?;
    let (case, source) = Scenario::read(&path).map_err(|error| StoreError::Content {
        path,
        message: error.to_string(),
    })?;
    // A foreign program is not available here: `hilrig shrink --exec` runs it.
    let is_here = store.plan().exec.is_none();
    let tries = match case.fault.len() > MANY_FAULTS {
        true => TRIES_OF_MANY,
        false => TRIES,
    };
    let mut effort = Effort::until(tries, is_over);
    let small = match is_here {
        true => {
            let cause = group.cause.clone();
            let mut branches = Branches::new(&source, &cause);
            let judge = |case: &Scenario| branches.judge(case);
            shrink::scenario(&case, &cause, judge, &mut effort)
        }
        false => Scenario {
            // The path of the original file does not apply to the new case.
            origin: None,
            ..case
        },
    };
    group.is_minimised = is_here && (effort.spent() > 0 || !is_over());
    let name = format!("groups/{number:02}.toml");
    files::make_folder(&store.dir().join("groups"))?;
    files::replace(store.dir(), &name, small.to_toml().as_bytes())?;
    group.left = Some(match group.is_minimised {
        true => shrink::in_words(&small),
        false => shrink::unminimised_in_words(&small),
    });
    if is_here {
        // A case that cannot be wired any more, or that panics, has no picture.
        let ran = judge::run(&small, &source)
            .ok()
            .and_then(|(_, outcome)| outcome);
        group.picture = ran.map(|outcome| moment::of_failure(&outcome));
    }
    group.case = Some(name);
    Ok(())
}

fn write(merged: &Merged, out: &Path) -> Result<(), StoreError> {
    let json = serde_json::to_string_pretty(merged).expect("plain data") + "\n";
    files::replace(out, "campaign.json", json.as_bytes())?;
    Ok(())
}
