//! The plan of a campaign, and the part of each shard.

use core::ops::Range;
use core::str::FromStr;
use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::StoreError;
use crate::files;

/// A part of a campaign: every `of`-th seed of each scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shard {
    /// Number of this shard, from 0.
    pub index: usize,
    /// Number of shards.
    pub of: usize,
}

impl Shard {
    /// The whole campaign.
    pub const WHOLE: Self = Self { index: 0, of: 1 };

    /// Whether this shard executes the runs of the turn `turn`, see [`CampaignPlan::runs`].
    pub const fn has(self, turn: usize) -> bool {
        turn % self.of == self.index
    }
}

/// The selected part of a campaign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShardChoice {
    /// The shard that the queue assigns to this task, see [`array`](super::array).
    Auto,
    /// The given shard.
    Given(Shard),
}

impl FromStr for ShardChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            text => text.parse().map(Self::Given),
        }
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once('/').and_then(|(index, of)| {
            let (index, of) = (index.parse().ok()?, of.parse().ok()?);
            (index < of).then_some(Self { index, of })
        });
        parsed.ok_or_else(|| "expected I/N with I from 0 to N-1, e.g. 0/4, or auto".to_owned())
    }
}

/// The runs of a campaign; shards with equal plans can be merged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CampaignPlan {
    /// Name and version of the tool.
    pub tool: String,
    /// Name and text of each scenario.
    pub scenarios: BTreeMap<String, String>,
    /// The seeds, without the end.
    pub seeds: Range<u64>,
    /// The parts of the scenario that vary with the seed, as on the command line.
    pub vary: String,
    /// The fault profile: the name of a built-in profile, or the text of a file; `None` is gentle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// Options that select a user's program, as on the command line; `None` for the robot's own
    /// program. Runs with a user's program take place in real time, so two runs differ.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exec: Option<String>,
    /// Scale of the measured computing of the program; `exec` repeats what a case has recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu: Option<String>,
    /// Name and fingerprint of each file that the command of the program names.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub programs: BTreeMap<String, String>,
}

impl CampaignPlan {
    /// All runs in order: turn, name of the scenario, seed. All scenarios run with the first seed,
    /// then with the second, so that a stopped campaign covers all scenarios equally. Each scenario
    /// is one turn later than the previous one, so that each shard gets runs of each scenario.
    pub fn runs(&self) -> impl Iterator<Item = (usize, &str, u64)> {
        let names: Vec<&str> = self.scenarios.keys().map(String::as_str).collect();
        self.seeds
            .clone()
            .enumerate()
            .flat_map(move |(round, seed)| {
                let names = names.clone().into_iter().enumerate();
                names.map(move |(index, name)| (round + index, name, seed))
            })
    }

    /// The reason why runs of `other` do not belong to this plan; `None` if they do. A file that is
    /// new since this plan was made does not count: the program may have written it.
    pub(super) fn difference(&self, other: &Self) -> Option<String> {
        let programs = self.programs.clone();
        let same_programs = Self {
            programs,
            ..other.clone()
        };
        if &same_programs != self {
            let message = "is of another campaign, expected the same scenarios, seeds, --vary, \
                --profile, --exec and version, or another --out";
            return Some(message.to_owned());
        }
        let advice = "use another --out or delete the folder";
        if self.programs.is_empty() && !other.programs.is_empty() {
            return Some(format!(
                "does not record which program made these runs; {advice}"
            ));
        }
        let mut programs = self.programs.iter();
        let changed = programs.find(|(name, print)| other.programs.get(*name) != Some(print));
        changed
            .map(|(name, _)| format!("the program {name} has changed since these runs; {advice}"))
    }

    /// Name of the fault profile.
    pub fn profile_name(&self) -> String {
        let Some(kept) = &self.profile else {
            return "gentle".to_owned();
        };
        // The name of a built-in profile is not valid TOML.
        let read = toml::from_str::<toml::Table>(kept).ok();
        let name = read.as_ref().and_then(|keys| keys.get("name")?.as_str());
        name.map_or_else(|| kept.clone(), str::to_owned)
    }

    /// Number of runs.
    pub(crate) fn len(&self) -> usize {
        let seeds = self.seeds.end.saturating_sub(self.seeds.start);
        let seeds = usize::try_from(seeds).unwrap_or(usize::MAX);
        seeds.saturating_mul(self.scenarios.len())
    }

    /// Whether the plan contains this run.
    pub(super) fn has(&self, scenario: &str, seed: u64) -> bool {
        self.seeds.contains(&seed) && self.scenarios.contains_key(scenario)
    }

    /// Reads the plan from the file `path`.
    ///
    /// # Errors
    /// If the file does not exist or has other content.
    pub(super) fn read(path: &Path) -> Result<Self, StoreError> {
        let wrong = |what: &str| StoreError::Content {
            path: path.to_owned(),
            message: format!("{what}, expected the plan of a campaign"),
        };
        let text = files::read(path, "the plan of a campaign")?;
        let plan: Self =
            serde_json::from_slice(&text).map_err(|error| wrong(&error.to_string()))?;
        // Files of cases are named after their scenarios.
        let leads_elsewhere = |name: &&String| name.contains(['/', '\0']);
        match plan.scenarios.keys().find(leads_elsewhere) {
            Some(name) => Err(wrong(&format!("{name:?} is not the name of a scenario"))),
            None => Ok(plan),
        }
    }

    /// Writes the plan to the file `name` in `dir`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn write(&self, dir: &Path, name: &str) -> Result<(), StoreError> {
        let text = serde_json::to_string_pretty(self).expect("plain data");
        files::replace_for_good(dir, name, (text + "\n").as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A campaign must not spend a whole night on its first scenario. After any number of runs,
    /// whole or in a shard, no scenario is more than two runs ahead.
    #[test]
    fn scenarios_take_turns() {
        let names = ["a", "b", "c", "d"].map(|name| (name.to_owned(), String::new()));
        let plan = CampaignPlan {
            tool: String::new(),
            scenarios: names.into(),
            seeds: 5..25,
            vary: "none".to_owned(),
            profile: None,
            exec: None,
            cpu: None,
            programs: BTreeMap::new(),
        };
        assert_eq!(plan.runs().count(), 80);
        for shard in [
            Shard::WHOLE,
            Shard { index: 1, of: 4 },
            Shard { index: 2, of: 8 },
        ] {
            let mut counts: BTreeMap<&str, u32> = BTreeMap::new();
            plan.scenarios
                .keys()
                .for_each(|name| _ = counts.insert(name, 0));
            for (turn, name, _) in plan.runs() {
                *counts.entry(name).or_default() += u32::from(shard.has(turn));
                let (least, most) = (counts.values().min(), counts.values().max());
                assert!(most <= least.map(|least| least + 2).as_ref(), "{counts:?}");
            }
        }
    }

    /// Each run belongs to one shard. The numbers of seeds that shards get of a scenario differ by
    /// at most one.
    #[test]
    fn shards_share_each_scenario_evenly() {
        for count in 1..=8 {
            let names = (0..count).map(|number| (number.to_string(), String::new()));
            let plan = CampaignPlan {
                tool: String::new(),
                scenarios: names.collect(),
                seeds: 3..70,
                vary: "none".to_owned(),
                profile: None,
                exec: None,
                cpu: None,
                programs: BTreeMap::new(),
            };
            let all: Vec<_> = plan.runs().collect();
            assert_eq!(all.len(), 67 * count);
            for of in 1..=32 {
                for name in plan.scenarios.keys() {
                    let own = |index| {
                        let shard = Shard { index, of };
                        let own = all.iter().filter(|run| run.1 == name && shard.has(run.0));
                        own.count()
                    };
                    let counts: Vec<usize> = (0..of).map(own).collect();
                    assert_eq!(counts.iter().sum::<usize>(), 67);
                    let (least, most) = (counts.iter().min(), counts.iter().max());
                    assert!(most <= least.map(|least| least + 1).as_ref(), "{counts:?}");
                }
            }
        }
    }

    /// The spelling of the key in the file does not matter.
    #[test]
    fn a_profile_of_a_file_is_shown_by_its_name() {
        let named = |kept: &str| {
            let plan = CampaignPlan {
                tool: String::new(),
                scenarios: BTreeMap::new(),
                seeds: 0..1,
                vary: "all".to_owned(),
                profile: Some(kept.to_owned()),
                exec: None,
                cpu: None,
                programs: BTreeMap::new(),
            };
            plan.profile_name()
        };
        assert_eq!(named("harsh"), "harsh");
        assert_eq!(
            named("schema = 1\nname='my \"own\"' # of 2026\n"),
            "my \"own\""
        );
    }
}
