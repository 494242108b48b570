//! One processor for a rig and its node programs.
//!
//! Rig and program take turns, so a second processor gains nothing, and waking a process on another
//! one takes ten times as long as the exchange itself.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use rustix::thread::{CpuSet, Pid, gettid, sched_getaffinity, sched_getcpu, sched_setaffinity};

/// Processors that threads of this process are kept on, and by how many.
static KEPT: Mutex<BTreeMap<usize, u32>> = Mutex::new(BTreeMap::new());

/// Keeps the thread that made it, and the processes that it starts, on one processor until it is
/// dropped.
#[derive(Debug)]
pub(crate) struct SameProcessor {
    before: CpuSet,
    kept: usize,
    /// The thread that was moved is the one to be released, from whichever thread.
    thread: Pid,
}

impl SameProcessor {
    /// `None`: the system refuses, or this thread is on one processor already.
    pub(crate) fn keep() -> Option<Self> {
        let before = sched_getaffinity(None).ok()?;
        if before.count() < 2 {
            return None;
        }
        let mut all = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        let now = sched_getcpu();
        let allowed = (0..CpuSet::MAX_CPU).filter(|&cpu| before.is_set(cpu));
        // The one that fewest runs are on, so that the workers of a campaign keep apart.
        let kept = allowed.min_by_key(|cpu| {
            let runs = all.get(cpu).copied().unwrap_or_default();
            (runs, *cpu != now)
        })?;
        let mut only = CpuSet::new();
        only.set(kept);
        sched_setaffinity(None, &only).ok()?;
        *all.entry(kept).or_default() += 1;
        Some(Self {
            before,
            kept,
            thread: gettid(),
        })
    }
}

impl Drop for SameProcessor {
    fn drop(&mut self) {
        let _ = sched_setaffinity(Some(self.thread), &self.before);
        let mut all = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(runs) = all.get_mut(&self.kept) {
            *runs = runs.saturating_sub(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thread is on one processor as long as it is kept there, and a second wish changes nothing.
    #[test]
    fn a_thread_is_kept_and_released() {
        let before = sched_getaffinity(None).expect("a set");
        if before.count() < 2 {
            assert!(SameProcessor::keep().is_none());
            return;
        }
        let kept = SameProcessor::keep().expect("two processors");
        assert_eq!(sched_getaffinity(None).expect("a set").count(), 1);
        assert!(SameProcessor::keep().is_none());
        drop(kept);
        assert_eq!(
            sched_getaffinity(None).expect("a set").count(),
            before.count()
        );
    }
}
