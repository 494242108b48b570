//! What `case` comes to.

use schemars::JsonSchema;
use serde::Serialize;

use crate::robots::checker::Check;

/// A case that was made of a capture.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct CaseMade {
    pub(in crate::cli) file: String,
    /// What it comes to today; empty if it was not run.
    pub(in crate::cli) checks: Vec<Check>,
    /// Whether it is green today; null if it was not run.
    pub(in crate::cli) passes_today: Option<bool>,
    /// The command that runs it.
    pub(in crate::cli) repeat: String,
}

/// A case that was run with some programs.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct CaseChecked {
    pub(in crate::cli) file: String,
    /// The programs, in their order.
    pub(in crate::cli) programs: Vec<CaseTry>,
}

/// What a case came to with one program.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct CaseTry {
    /// The shell command.
    pub(in crate::cli) command: String,
    pub(in crate::cli) is_green: bool,
    pub(in crate::cli) checks: Vec<Check>,
}
