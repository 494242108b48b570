//! The result of a comparison of a device with the real one.

use schemars::JsonSchema;
use serde::Serialize;

use crate::cli::fidelity::ledger::Row;

/// Figures of a device, compared with those of another one.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(in crate::cli) struct Figures {
    pub(in crate::cli) figures: Vec<FigureCompared>,
    /// The blind test: whether a classifier tells the capture from the emulation.
    pub(in crate::cli) blind: Vec<GroupTold>,
    /// Bytes that never change in the capture and differ in the emulation, in words.
    pub(in crate::cli) constants: Vec<String>,
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

/// A group of figures in the blind test.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct GroupTold {
    pub(in crate::cli) group: String,
    /// Part of the windows whose origin the classifier found, percent; 50 is chance. None if the
    /// group was not compared.
    pub(in crate::cli) accuracy: Option<f64>,
    /// Windows of the capture that were compared.
    pub(in crate::cli) windows: usize,
    /// Whether the accuracy is within its limit; none if that is not judged or not compared.
    pub(in crate::cli) holds: Option<bool>,
    /// The verdict in words, as in the table.
    pub(in crate::cli) verdict: String,
}
