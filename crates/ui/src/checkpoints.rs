//! Moments of a run from which it can continue in another way. Bounded: the longer the run, the
//! fewer of its time.

use core::time::Duration;

use protocols::Instant;

use super::wire::Counted;
use engine::run::{Checkpoint, Run};

/// Maximum number of checkpoints; when they are reached, every second one is dropped.
const MOST: usize = 24;
/// Virtual time between two of them, as long as there are few.
const PERIOD: Duration = Duration::from_secs(4);

/// A moment, with what the page had counted by then.
#[derive(Debug)]
pub(super) struct Kept {
    pub(super) run: Checkpoint,
    pub(super) counted: Counted,
}

/// All that are kept, in the order of time.
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
    /// Keeps `run` as it is now, if it is time and if it can be copied.
    pub(super) fn offer(&mut self, run: &Run, counted: impl FnOnce() -> Counted) {
        let last = self.all.last().map(|kept| kept.run.at());
        if last.is_some_and(|last| run.rig.now() - last < self.period) {
            return;
        }
        let Some(checkpoint) = run.checkpoint() else {
            return;
        };
        if self.all.len() >= MOST {
            // The first one stays: before it there is none.
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

    /// When the first one was taken.
    pub(super) fn first(&self) -> Option<Instant> {
        Some(self.all.first()?.run.at())
    }

    /// The last one that is not after `at`; those after it are forgotten.
    pub(super) fn back_to(&mut self, at: Instant) -> Option<&Kept> {
        let kept = self.all.partition_point(|kept| kept.run.at() <= at);
        // Without any, nothing changes.
        if kept > 0 {
            self.all.truncate(kept);
            return self.all.last();
        }
        None
    }
}
