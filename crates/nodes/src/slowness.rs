//! The wall time of a node program's answers.

use core::time::Duration;
use std::sync::Arc;

/// A clock that measures elapsed wall time.
pub type Stopwatch = Arc<dyn Fn() -> Duration + Send + Sync>;

/// The wall time of a node program's answers; measured in real time only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slowness {
    /// Number of answers that took longer than [`SLOW`].
    pub answers: u64,
    /// The maximum time of an answer.
    pub longest: Duration,
}

/// Time of an answer above which a rig in real time becomes late.
pub const SLOW: Duration = Duration::from_millis(5);
