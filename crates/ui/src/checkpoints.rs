//! Checkpoints of a run from which it can branch. Their number is limited: in a longer run they are
//! farther apart.

use core::time::Duration;

use protocols::Instant;

use super::wire::Counted;
use engine::run::{Checkpoint, Run};

/// Maximum number of checkpoints; when it is reached, every second one is dropped.
const MOST: usize = 24;
/// Virtual time between two checkpoints while there are few.
const PERIOD: Duration = Duration::from_secs(4);

/// A checkpoint with the page's counters.
#[derive(Debug)]
pub(super) struct Kept {
    pub(super) run: Checkpoint,
    pub(super) counted: Counted,
}

/// All checkpoints in order of time.
#[derive(Debug)]
pub(super) struct Checkpoints {
    all: Vec<Kept>,
    period: Duration,
}

impl Default for Checkpoints {
    fn default() -> Self {
        Self {
            all: Vec::new(),
            period: PERIOD,
        }
    }
}

impl Checkpoints {
    /// Stores a checkpoint of `run`, if it is due and the run can be copied.
    pub(super) fn offer(&mut self, run: &Run, counted: impl FnOnce() -> Counted) {
        let last = self.all.last().map(|kept| kept.run.at());
        if last.is_some_and(|last| run.rig.now() - last < self.period) {
            return;
        }
        let Some(checkpoint) = run.checkpoint() else {
            return;
        };
        if self.all.len() >= MOST {
            // The first checkpoint stays, because there is none before it.
            let mut index = 0;
            self.all.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.period *= 2;
        }
        self.all.push(Kept {
            run: checkpoint,
            counted: counted(),
        });
    }

    /// Time of the first checkpoint.
    pub(super) fn first(&self) -> Option<Instant> {
        Some(self.all.first()?.run.at())
    }

    /// The last checkpoint not after `at`; later ones are removed.
    pub(super) fn back_to(&mut self, at: Instant) -> Option<&Kept> {
        let kept = self.all.partition_point(|kept| kept.run.at() <= at);
        // Without such a checkpoint nothing changes.
        if kept > 0 {
            self.all.truncate(kept);
            return self.all.last();
        }
        None
    }
}
