//! Late threads: they can run, but not before a certain time.

use core::time::Duration;

use protocols::Instant;

use super::{Next, State, Supervisor};

impl Supervisor {
    /// Lets a thread continue after the delay `by`; others may run meanwhile.
    pub(super) fn delay(&mut self, tid: i32, by: Duration, next: Next) {
        self.late.push((self.stage.now() + by, tid));
        self.set_state(tid, State::Ready(next));
    }

    /// Time at which the first late thread may run.
    pub(super) fn next_late(&self) -> Option<Instant> {
        self.late.iter().map(|(at, _)| *at).min()
    }

    /// Lets threads run whose delay is over.
    pub(super) fn end_delays(&mut self) {
        self.end_delays_until(self.stage.now());
    }

    /// Ends all delays, because the run is over and each thread must be able to end.
    pub(in crate::guest) fn end_all_delays(&mut self) {
        self.end_delays_until(Instant::from_nanos(u64::MAX));
    }

    fn end_delays_until(&mut self, now: Instant) {
        let mut due: Vec<(Instant, i32)> = Vec::new();
        self.late.retain(|&(at, tid)| {
            let is_due = at <= now;
            if is_due {
                due.push((at, tid));
            }
            !is_due
        });
        due.sort_unstable();
        for (_, tid) in due {
            if self.threads.contains_key(&tid) {
                self.queue.push_back(tid);
            }
        }
    }
}
