//! What experiments came to.

use schemars::JsonSchema;
use serde::Serialize;

/// Experiments that were done, or can be.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct Experiments {
    pub(in crate::cli) experiments: Vec<ExperimentDone>,
}

/// An experiment.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct ExperimentDone {
    pub(in crate::cli) name: String,
    /// Where the report has it.
    pub(in crate::cli) place: String,
    /// The first seed, and how many there are, one after the other.
    pub(in crate::cli) first_seed: u64,
    pub(in crate::cli) seeds: u64,
    pub(in crate::cli) figures: Vec<ExperimentFigure>,
    /// Table and plot.
    pub(in crate::cli) files: Vec<String>,
}

/// A figure of an experiment.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct ExperimentFigure {
    pub(in crate::cli) name: String,
    /// As found, with its unit.
    pub(in crate::cli) ours: String,
    /// As the report has it.
    pub(in crate::cli) report: Option<String>,
}
