//! Verdicts in a few letters.

use crate::run::check::Status;

/// How a check ended, in four letters.
pub(super) const fn mark(status: Status) -> &'static str {
    match status {
        Status::Pass => "ok  ",
        Status::Fail => "FAIL",
    }
}
