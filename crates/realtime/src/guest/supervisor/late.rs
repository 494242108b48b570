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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::Bench;

    /// By hand: delays of 30, 10 and 20 ms; at 20 ms two of them are over, in order of time.
    #[test]
    fn threads_run_when_their_delay_is_over() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        assert_eq!(bench.supervisor.next_late(), None);
        for (thread, millis) in [(1_000_001, 30), (1_000_002, 10), (1_000_003, 20)] {
            bench.add(thread, tid, State::Running);
            let by = Duration::from_millis(millis);
            bench.supervisor.delay(thread, by, Next::Charged);
            let state = bench.supervisor.threads[&thread].state;
            assert!(matches!(state, State::Ready(Next::Charged)));
        }
        assert_eq!(bench.supervisor.next_late(), Some(Instant::from_millis(10)));
        bench.passes(9);
        bench.supervisor.end_delays();
        assert!(bench.supervisor.queue.is_empty());
        bench.passes(11);
        bench.supervisor.end_delays();
        assert_eq!(bench.supervisor.queue, [1_000_002, 1_000_003]);
        assert_eq!(bench.supervisor.next_late(), Some(Instant::from_millis(30)));
        bench.add(1_000_004, tid, State::Running);
        bench
            .supervisor
            .delay(1_000_004, Duration::from_secs(9), Next::Call);
        bench.supervisor.threads.remove(&1_000_001);
        bench.supervisor.end_all_delays();
        assert_eq!(bench.supervisor.queue, [1_000_002, 1_000_003, 1_000_004]);
        assert_eq!(bench.supervisor.next_late(), None);
    }
}
