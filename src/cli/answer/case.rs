//! The results of `case`.

use schemars::JsonSchema;
use serde::Serialize;

use crate::robots::checker::Check;

/// A case made from a capture.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct CaseMade {
    pub(in crate::cli) file: String,
    /// The checks of today's run; empty if it was not run.
    pub(in crate::cli) checks: Vec<Check>,
    /// Whether the case is green today; null if the case was not run.
    pub(in crate::cli) passes_today: Option<bool>,
    /// The command that runs it.
    pub(in crate::cli) repeat: String,
}

/// A case run with several programs.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct CaseChecked {
    pub(in crate::cli) file: String,
    /// The programs, in the order given.
    pub(in crate::cli) programs: Vec<CaseTry>,
}

/// The cases of a folder, each run with several programs.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct CasesChecked {
    /// The cases that can be read, by name.
    pub(in crate::cli) cases: Vec<CaseChecked>,
}

/// The result of a case with one program.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct CaseTry {
    /// The shell command.
    pub(in crate::cli) command: String,
    pub(in crate::cli) is_green: bool,
    pub(in crate::cli) checks: Vec<Check>,
}
