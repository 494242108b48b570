//! The result of a comparison of a device with the real one.

use schemars::JsonSchema;
use serde::Serialize;

use crate::cli::fidelity::ledger::Row;

/// Figures of a device, compared with those of another one.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct Figures {
    pub(in crate::cli) figures: Vec<FigureCompared>,
    /// The sources that judge the device, and the properties that cannot be checked.
    pub(in crate::cli) ledger: Vec<Row>,
}

/// A figure.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct FigureCompared {
    pub(in crate::cli) name: String,
    pub(in crate::cli) unit: String,
    /// The value in the reference stream.
    pub(in crate::cli) real: Option<f64>,
    pub(in crate::cli) emulated: Option<f64>,
    /// Whether both values agree; none if that is not judged.
    pub(in crate::cli) holds: Option<bool>,
}
