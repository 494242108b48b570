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

/// Rows of the reports, judged.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct RowsJudged {
    /// Whether each model has its planted change.
    pub(in crate::cli) planted: bool,
    pub(in crate::cli) rows: Vec<RowJudged>,
    /// Number of rows by verdict.
    pub(in crate::cli) reproduced: usize,
    pub(in crate::cli) differ: usize,
    /// Rows whose values follow from the rig's own settings.
    pub(in crate::cli) by_construction: usize,
    pub(in crate::cli) refused: usize,
    pub(in crate::cli) not_run: usize,
    /// Whether rows are missing, were interrupted, or have too few seeds.
    pub(in crate::cli) is_partial: bool,
    /// The pages.
    pub(in crate::cli) files: Vec<String>,
}

/// A row of a report.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct RowJudged {
    pub(in crate::cli) name: String,
    pub(in crate::cli) report: &'static str,
    pub(in crate::cli) place: String,
    /// `reproduced`, `differs`, `by construction`, `refused` or `not run`.
    pub(in crate::cli) verdict: &'static str,
    /// Whether the verdict is the documented one.
    pub(in crate::cli) is_expected: bool,
    pub(in crate::cli) seeds: u64,
    pub(in crate::cli) bands: Vec<BandJudged>,
    /// Why the row differs or is refused, or how it is measured.
    pub(in crate::cli) reason: String,
    pub(in crate::cli) plot: Option<String>,
}

/// A band of a row.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct BandJudged {
    pub(in crate::cli) value: String,
    /// The value in the report.
    pub(in crate::cli) report: String,
    /// Share of the runs that must lie inside, and number of those that do.
    pub(in crate::cli) share: f64,
    pub(in crate::cli) inside: usize,
    pub(in crate::cli) least: f64,
    pub(in crate::cli) most: f64,
    /// Our value of each seed; `null`: the run had none.
    pub(in crate::cli) values: Vec<Option<f64>>,
    pub(in crate::cli) median: Option<f64>,
    pub(in crate::cli) holds: bool,
}
