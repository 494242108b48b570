//! The results of experiments.

use schemars::JsonSchema;
use serde::Serialize;

/// Experiments, done or available.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct Experiments {
    pub(in crate::cli) experiments: Vec<ExperimentDone>,
}

/// An experiment.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct ExperimentDone {
    pub(in crate::cli) name: String,
    /// The place of the experiment in the report.
    pub(in crate::cli) place: String,
    /// The first seed, and the number of consecutive seeds.
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
    /// The measured value, with its unit.
    pub(in crate::cli) ours: String,
    /// The value in the report.
    pub(in crate::cli) report: Option<String>,
}
