//! How long a node program takes for its answers, in wall time.

use core::time::Duration;
use std::sync::Arc;

/// A clock that says how much wall time has passed.
pub type Stopwatch = Arc<dyn Fn() -> Duration + Send + Sync>;

/// How long a node program took for its answers, in wall time; measured in real time only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slowness {
    /// Answers that took longer than [`SLOW`].
    pub answers: u64,
    /// The longest time for an answer.
    pub longest: Duration,
}

/// An answer that takes longer than this makes a rig in real time late.
pub const SLOW: Duration = Duration::from_millis(5);
