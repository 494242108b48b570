//! Other orders of threads: where threads could run in any order, chance decides, the same for one
//! seed each time.
//!
//! A thread that begins a call may let others go first, or be late, as on a busy machine. A thread
//! that computes may lose the processor after some instructions. So a program with a race shows it
//! for some seeds, and each of them repeats it.

use core::time::Duration;

use emulators::rng::Rng;
use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;

use super::{Flow, Next, Supervisor};

/// One call of so many lets others go first, or comes later.
const YIELDS: u64 = 6;
const DELAYS: u64 = 24;
/// The same for a thread that goes on: it loses the processor while it computes.
const PREEMPTS: u64 = 12;
/// Shortest delay, and how often it doubles at most.
const DELAY_MIN: Duration = Duration::from_micros(10);
const DOUBLINGS: u64 = 9;
/// Most instructions before a thread loses the processor: 2 to the power of one less than this.
const INSTRUCTIONS: u64 = 11;

/// The chance, and what it has decided.
#[derive(Debug)]
pub(super) struct Schedule {
    chance: Rng,
    /// The thread that loses the processor after so many instructions.
    fuel: Option<(i32, u64)>,
    /// The thread for which chance has decided already: its stop is none without a debugger.
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

    /// A thread begins a call: whether it goes on with it now.
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

    /// Whether a thread that continues goes by single instructions.
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

    /// A thread has stopped at SIGTRAP: whether that is the end of an instruction before it loses
    /// the processor.
    pub(super) fn stepped_by_schedule(&mut self, tid: i32) -> Option<Flow> {
        /// What the kernel tells of an `int3` of the program's own.
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

    /// A thread has done an instruction, also by order of a debugger: how it goes on.
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

    /// A thread goes on after a stop that no other run has: chance does not decide again.
    pub(super) fn stop_for_schedule(&mut self, tid: i32) {
        if let Some(schedule) = &mut self.schedule {
            schedule.drawn = Some(tid);
        }
    }

    /// A thread that computes lets others go first, or is late.
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
