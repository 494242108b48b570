//! The processor on which supervisor and program run.

use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

/// Keeps this thread and the processes that it starts on its current processor: one of them runs at
/// a time, and waking on another processor takes three times as long. Returns the previous set.
pub(super) fn stay_here() -> Option<CpuSet> {
    let before = sched_getaffinity(None).ok()?;
    let mut here = CpuSet::new();
    here.set(sched_getcpu());
    sched_setaffinity(None, &here).ok()?;
    Some(before)
}
