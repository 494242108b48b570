//! Other orders of threads: where threads could run in any order, random numbers decide, and each
//! seed always gives the same decisions.
//!
//! A thread that begins a call may let others go first, or be late, as on a busy machine. A thread
//! that computes may lose the processor after some instructions. So a program with a race condition
//! shows it for some seeds, and each of these seeds repeats it.

use core::time::Duration;

use emulators::rng::Rng;
use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;

use super::{Flow, Next, Supervisor};

/// One in this number of calls lets other threads run first, or is delayed.
const YIELDS: u64 = 6;
const DELAYS: u64 = 24;
/// One in this number of threads that continue loses the processor while it computes.
const PREEMPTS: u64 = 12;
/// Minimum delay, and maximum number of its doublings.
const DELAY_MIN: Duration = Duration::from_micros(10);
const DOUBLINGS: u64 = 9;
/// A thread loses the processor after at most 2^(`INSTRUCTIONS` - 1) instructions.
const INSTRUCTIONS: u64 = 11;

/// The random numbers and their current decisions.
#[derive(Debug)]
pub(super) struct Schedule {
    chance: Rng,
    /// The thread that will lose the processor, and its remaining instructions.
    fuel: Option<(i32, u64)>,
    /// The thread whose decision was already made: only a debugger causes its stop.
    drawn: Option<i32>,
}

impl Schedule {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            chance: Rng::stream(seed, "schedule"),
            fuel: None,
            drawn: None,
        }
    }

    fn below(&mut self, count: u64) -> u64 {
        self.chance.below(count.max(1))
    }

    fn delay(&mut self) -> Duration {
        let doublings = self.below(DOUBLINGS);
        let unit = DELAY_MIN * (1 << doublings);
        let part = self.below(1 << 10);
        unit + unit * u32::try_from(part).unwrap_or(0) / (1 << 10)
    }
}

impl Supervisor {
    /// The thread whose turn it is.
    pub(super) fn next_in_queue(&mut self) -> Option<i32> {
        let count = self.queue.len();
        if count > 1
            && let Some(schedule) = &mut self.schedule
        {
            let index = schedule.below(count as u64);
            return self.queue.remove(usize::try_from(index).unwrap_or(0));
        }
        self.queue.pop_front()
    }

    /// Whether a thread that begins a call must wait for others; `None` if it continues with the
    /// call now.
    pub(super) fn call_by_schedule(&mut self, tid: i32) -> Option<Flow> {
        let has_others = !self.queue.is_empty();
        let schedule = self.schedule.as_mut()?;
        schedule.fuel = None;
        if schedule.below(DELAYS) == 0 {
            self.be_late(tid, Next::Call);
            return Some(Flow::Stays);
        }
        if schedule.below(YIELDS) == 0 && has_others {
            self.ready(tid, Next::Call);
            return Some(Flow::Stays);
        }
        None
    }

    fn be_late(&mut self, tid: i32, next: Next) {
        if let Some(schedule) = &mut self.schedule {
            let delay = schedule.delay();
            self.delay(tid, delay, next);
        }
    }

    /// Whether a thread that continues must run in single steps.
    pub(super) fn steps_by_schedule(&mut self, tid: i32) -> bool {
        let Some(schedule) = &mut self.schedule else {
            return false;
        };
        let is_drawn = schedule.drawn.take() == Some(tid);
        match schedule.fuel {
            Some((other, _)) if other == tid => return true,
            _ if is_drawn => return false,
            _ => schedule.fuel = None,
        }
        if schedule.below(PREEMPTS) != 0 {
            return false;
        }
        let power = schedule.below(INSTRUCTIONS);
        let count = 1 + schedule.below(1 << power);
        schedule.fuel = Some((tid, count));
        true
    }

    /// Handles a thread that has stopped at SIGTRAP; `None` if this is not a single step before it
    /// loses the processor.
    pub(super) fn stepped_by_schedule(&mut self, tid: i32) -> Option<Flow> {
        /// Signal code of an `int3` of the program itself.
        const BY_INSTRUCTION: i32 = 0x80;
        let info = ptrace::getsiginfo(Pid::from_raw(tid)).ok()?;
        let schedule = self.schedule.as_ref()?;
        schedule.fuel.filter(|(other, _)| *other == tid)?;
        if info.si_code == BY_INSTRUCTION || info.si_signo != libc::SIGTRAP {
            return None;
        }
        Some(match self.step_for_schedule(tid) {
            Next::Lose => self.lose_processor(tid),
            _ => Flow::Goes(None),
        })
    }

    /// Handles an executed instruction of a thread, also one that a debugger ordered; returns how
    /// the thread continues.
    pub(super) fn step_for_schedule(&mut self, tid: i32) -> Next {
        let keeps_loan = self.keeps_loan;
        let Some(schedule) = &mut self.schedule else {
            return Next::Go(None);
        };
        if let Some((_, left)) = schedule.fuel.filter(|(other, _)| *other == tid) {
            if left <= 1 && !keeps_loan {
                schedule.fuel = None;
                return Next::Lose;
            }
            schedule.fuel = Some((tid, left.saturating_sub(1).max(1)));
        }
        schedule.drawn = Some(tid);
        Next::Go(None)
    }

    /// Lets a thread continue without a new decision, because no other run has this stop.
    pub(super) fn stop_for_schedule(&mut self, tid: i32) {
        if let Some(schedule) = &mut self.schedule {
            schedule.drawn = Some(tid);
        }
    }

    /// Lets other threads run before a thread that computes, or delays this thread.
    pub(super) fn lose_processor(&mut self, tid: i32) -> Flow {
        let has_others = !self.queue.is_empty();
        let yields = self
            .schedule
            .as_mut()
            .is_some_and(|it| has_others && it.below(2) == 0);
        match yields {
            true => self.ready(tid, Next::Go(None)),
            false => self.be_late(tid, Next::Go(None)),
        }
        Flow::Stays
    }
}
