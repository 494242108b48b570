//! The speed of scenarios.

use schemars::JsonSchema;
use serde::Serialize;

/// Scenarios that were measured on a machine.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct Benched {
    /// Name and number of the machine's processors.
    pub(in crate::cli) machine: String,
    pub(in crate::cli) scenarios: Vec<ScenarioBenched>,
}

/// The speed of a scenario.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct ScenarioBenched {
    pub(in crate::cli) scenario: String,
    /// Virtual time of the run, seconds.
    pub(in crate::cli) virtual_s: f64,
    /// Processor time of the fastest run, seconds.
    pub(in crate::cli) cpu_s: f64,
    pub(in crate::cli) virtual_s_per_cpu_s: f64,
    /// Runs with their verdict per minute of processor time.
    pub(in crate::cli) situations_per_cpu_minute: f64,
    /// Instructions of a process that runs the scenario once; none without valgrind.
    pub(in crate::cli) instructions: Option<u64>,
}
