//! The result of a campaign.

use std::path::Path;

use schemars::JsonSchema;
use serde::Serialize;

use crate::search::campaign::Merged;
use crate::show::shell::word;

/// The state of a campaign.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct CampaignEnded {
    /// The result folder; none with `--mutants`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::cli) folder: Option<String>,
    pub(in crate::cli) runs: u64,
    pub(in crate::cli) failed: u64,
    /// Runs that no shard has done; none for a shard.
    pub(in crate::cli) missing: Option<u64>,
    /// Fingerprint of all runs; none for a shard.
    pub(in crate::cli) trace_hash: Option<String>,
    /// Failures by cause, the most frequent first.
    pub(in crate::cli) causes: Vec<CauseFound>,
    /// Situations that never occurred.
    pub(in crate::cli) never_came_up: Vec<String>,
    /// Goals (`sometimes`) that no run reached; none for a shard.
    pub(in crate::cli) missed_goals: Vec<String>,
    /// Rules that no run observed; none for a shard.
    pub(in crate::cli) unobserved_rules: Vec<String>,
    /// Rules and goals that no generated mission has, so that no run judged them.
    pub(in crate::cli) unjudged_rules: Vec<String>,
    /// With `--mutants`: planted defects, and the checks that found them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::cli) mutants: Option<Vec<MutantJudged>>,
}

impl CampaignEnded {
    /// The result of a whole campaign in the folder `out`.
    pub(in crate::cli) fn of(merged: &Merged, out: &Path) -> Self {
        let exec = merged.plan.exec.as_deref().unwrap_or_default();
        let repeat = |case: &String| format!("hilrig run {}{exec}", word(&out.join(case)));
        let causes = merged.groups.iter().map(|group| CauseFound {
            cause: group.cause.clone(),
            detail: group.detail.clone(),
            runs: group.runs as u64,
            first: group.first.clone(),
            repeat: group.case.as_ref().map(repeat),
        });
        Self {
            folder: Some(out.display().to_string()),
            runs: merged.runs as u64,
            failed: merged.failed as u64,
            missing: Some(merged.missing as u64),
            trace_hash: Some(merged.trace.clone()),
            causes: causes.collect(),
            never_came_up: merged.missed_situations().map(str::to_owned).collect(),
            missed_goals: merged.missed_goals().map(str::to_owned).collect(),
            unobserved_rules: merged.unobserved_rules().map(str::to_owned).collect(),
            unjudged_rules: merged.lost_rules().map(str::to_owned).collect(),
            mutants: None,
        }
    }
}

/// A planted defect.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct MutantJudged {
    pub(in crate::cli) robot: String,
    pub(in crate::cli) defect: String,
    /// Runs with it until it was found.
    pub(in crate::cli) runs: u64,
    /// The runs among them whose bytes differ from those of the run without the defect.
    pub(in crate::cli) differs: u64,
    /// The check that found it; none: it was not found.
    pub(in crate::cli) found_by: Option<String>,
    /// Scenario and seed of that run.
    pub(in crate::cli) first: Option<(String, u64)>,
}

/// Runs that failed for the same cause.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct CauseFound {
    pub(in crate::cli) cause: String,
    /// The message of the first run.
    pub(in crate::cli) detail: String,
    pub(in crate::cli) runs: u64,
    /// Scenario and seed of the first run.
    pub(in crate::cli) first: (String, u64),
    /// The command that runs the minimised case.
    pub(in crate::cli) repeat: Option<String>,
}
