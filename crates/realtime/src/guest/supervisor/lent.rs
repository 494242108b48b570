//! Time that is lent to the thread that runs: it looks at clocks without a stop.

use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;

use super::{SLICE, Supervisor};
use crate::guest::clock_page::{ClockPage, Loan};
use crate::guest::trace::Record;

impl Supervisor {
    fn clocks_of(&self, tid: i32) -> Option<ClockPage> {
        let process = self.threads.get(&tid)?.process;
        self.processes.get(&process)?.clocks
    }

    /// The thread goes on: up to the next event its clocks are its own.
    pub(super) fn lend_time(&self, tid: i32) {
        let Some(clocks) = self.clocks_of(tid) else {
            return;
        };
        let slice = self.threads.get(&tid).map_or(0, |thread| thread.slice);
        let nanos =
            |at: protocols::Instant| u64::try_from((at - protocols::Instant::ZERO).as_nanos());
        let now = nanos(self.stage.now()).unwrap_or(u64::MAX);
        let limit = self
            .stage
            .quiet_until()
            .map_or(i64::MAX.unsigned_abs(), |at| {
                nanos(at).unwrap_or(0).saturating_sub(1)
            });
        let cost = self.settings.supervision.call_cost.as_nanos();
        clocks.lend(
            Pid::from_raw(tid),
            Loan {
                now,
                limit,
                cost: u64::try_from(cost).unwrap_or(0),
                looks: u64::from((SLICE - 1).saturating_sub(slice)),
            },
        );
    }

    /// Whether a thread has stopped in the middle of a look at its clocks, with incomplete counts.
    pub(super) fn stands_in_clocks(&self, tid: i32, status: i32) -> bool {
        let is_trap = status >> 8 == libc::SIGTRAP;
        if !is_trap || self.debugging.is_none() && self.schedule.is_none() {
            return false;
        }
        let registers = ptrace::getregs(Pid::from_raw(tid));
        let clocks = self.clocks_of(tid);
        clocks.is_some_and(|it| registers.is_ok_and(|at| it.has_code_at(at.rip)))
    }

    /// The thread goes on where virtual time does not count: each look is a call.
    pub(super) fn keep_time(&self, tid: i32) {
        if let Some(clocks) = self.clocks_of(tid) {
            let nothing = Loan {
                now: 0,
                limit: 0,
                cost: 1,
                looks: 0,
            };
            clocks.lend(Pid::from_raw(tid), nothing);
        }
    }

    /// The thread has stopped: what it has counted has passed.
    pub(super) fn take_time(&mut self, tid: i32) {
        let Some(clocks) = self.clocks_of(tid) else {
            return;
        };
        let Some(taken) = clocks.take(Pid::from_raw(tid)).filter(|it| it.looks > 0) else {
            return;
        };
        let looks = u32::try_from(taken.looks).unwrap_or(u32::MAX);
        let Some(thread) = self.threads.get_mut(&tid) else {
            return;
        };
        thread.slice = thread.slice.saturating_add(looks);
        thread.computed = core::time::Duration::ZERO;
        let index = thread.index;
        self.calls.count += taken.looks;
        self.looks += taken.looks;
        self.stage
            .has_counted(protocols::Instant::from_nanos(taken.now));
        self.calls.add(Record {
            at: self.stage.now(),
            thread: index,
            number: libc::SYS_clock_gettime,
            looks,
            result: Some(0),
        });
    }
}
