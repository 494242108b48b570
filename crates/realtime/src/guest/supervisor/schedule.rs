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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::Bench;

    fn bench(seed: u64) -> Bench {
        let mut bench = Bench::new();
        bench.supervisor.schedule = Some(Schedule::new(seed));
        bench
    }

    /// Between 10 us and twice 2.56 ms, most of them short; the same for one seed.
    #[test]
    fn delays_are_between_their_limits() {
        let mut schedule = Schedule::new(7);
        let delays: Vec<Duration> = (0..2_000).map(|_| schedule.delay()).collect();
        let (least, most) = (delays.iter().min(), delays.iter().max());
        assert!(least >= Some(&DELAY_MIN) && least < Some(&Duration::from_micros(11)));
        let limits = Duration::from_micros(4_900)..Duration::from_micros(5_120);
        assert!(limits.contains(most.expect("some")), "{most:?}");
        let short = delays
            .iter()
            .filter(|&&it| it < Duration::from_micros(320))
            .count();
        assert!(
            (1_000..1_250).contains(&short),
            "{short}: five of nine doublings"
        );
        let mut again = Schedule::new(7);
        assert!(delays.iter().all(|&it| it == again.delay()));
        let mut other = Schedule::new(8);
        assert!(delays.iter().any(|&it| it != other.delay()));
        assert_eq!((schedule.below(1), schedule.below(0)), (0, 0));
    }

    #[test]
    fn chance_decides_which_thread_is_next() {
        let firsts = |schedule: bool| -> std::collections::BTreeSet<Option<i32>> {
            (0..64)
                .map(|seed| {
                    let mut bench = bench(seed);
                    if !schedule {
                        bench.supervisor.schedule = None;
                    }
                    bench.supervisor.queue.extend([1, 2, 3]);
                    let first = bench.supervisor.next_in_queue();
                    assert_eq!(bench.supervisor.queue.len(), 2);
                    first
                })
                .collect()
        };
        assert_eq!(firsts(true), [Some(1), Some(2), Some(3)].into());
        assert_eq!(firsts(false), [Some(1)].into());
        let mut bench = bench(1);
        assert_eq!(bench.supervisor.next_in_queue(), None);
        bench.supervisor.queue.push_back(9);
        assert_eq!(bench.supervisor.next_in_queue(), Some(9));
    }

    /// A thread that begins a call is late once in 24 calls, and lets others go first once in 6.
    #[test]
    fn a_call_lets_others_go_first_or_is_late() {
        let mut counts = [0; 3];
        let mut bench = bench(3);
        let tid = bench.tid;
        for _ in 0..2_400 {
            bench.supervisor.queue.push_back(1);
            bench.supervisor.schedule.as_mut().expect("set").fuel = Some((tid, 3));
            let flow = bench.supervisor.call_by_schedule(tid);
            let is_late = !core::mem::take(&mut bench.supervisor.late).is_empty();
            let queue = core::mem::take(&mut bench.supervisor.queue);
            let index = match (flow, is_late, queue.len()) {
                (None, false, 1) => 0,
                (Some(Flow::Stays), false, 2) => 1,
                (Some(Flow::Stays), true, 1) => 2,
                _ => panic!("late or behind others"),
            };
            counts[index] += 1;
            assert!(
                bench
                    .supervisor
                    .schedule
                    .as_ref()
                    .expect("set")
                    .fuel
                    .is_none()
            );
        }
        let [goes, yields, late] = counts;
        assert!((70..130).contains(&late), "{late} of about 100");
        assert!((320..450).contains(&yields), "{yields} of about 383");
        assert_eq!(goes + yields + late, 2_400);
        // Without others none can go first.
        for _ in 0..200 {
            bench.supervisor.call_by_schedule(tid);
            assert!(bench.supervisor.queue.is_empty());
            bench.supervisor.late.clear();
        }
        bench.supervisor.schedule = None;
        assert!(bench.supervisor.call_by_schedule(tid).is_none());
    }

    /// Once in 12 times a thread goes on by single instructions, up to 1,024 of them.
    #[test]
    fn a_thread_loses_the_processor_after_some_instructions() {
        let mut bench = bench(5);
        let tid = bench.tid;
        let mut fuels = Vec::new();
        for _ in 0..2_400 {
            let steps = bench.supervisor.steps_by_schedule(tid);
            let schedule = bench.supervisor.schedule.as_mut().expect("set");
            assert_eq!(schedule.fuel.is_some(), steps);
            fuels.extend(schedule.fuel.take());
        }
        assert!(
            (150..260).contains(&fuels.len()),
            "{} of about 200",
            fuels.len()
        );
        assert!(
            fuels
                .iter()
                .all(|&(of, count)| of == tid && (1..=1_024).contains(&count))
        );
        assert!(fuels.iter().any(|&(_, count)| count == 1));
        assert!(fuels.iter().any(|&(_, count)| count > 512));
        let schedule = |bench: &mut Bench, fuel, drawn| {
            let schedule = bench.supervisor.schedule.as_mut().expect("set");
            (schedule.fuel, schedule.drawn) = (fuel, drawn);
        };
        for _ in 0..50 {
            schedule(&mut bench, Some((tid, 5)), None);
            assert!(bench.supervisor.steps_by_schedule(tid), "it has some left");
            schedule(&mut bench, None, Some(tid));
            assert!(
                !bench.supervisor.steps_by_schedule(tid),
                "chance has decided"
            );
            // Another thread's instructions are forgotten.
            schedule(&mut bench, Some((tid + 1, 5)), None);
            let steps = bench.supervisor.steps_by_schedule(tid);
            let fuel = bench.supervisor.schedule.as_ref().expect("set").fuel;
            assert_eq!(fuel.map(|(of, _)| of), steps.then_some(tid));
        }
        let mut step = |fuel, keeps| {
            schedule(&mut bench, fuel, None);
            bench.supervisor.keeps_loan = keeps;
            let next = bench.supervisor.step_for_schedule(tid);
            let schedule = bench.supervisor.schedule.as_ref().expect("set");
            (matches!(next, Next::Lose), schedule.fuel, schedule.drawn)
        };
        assert_eq!(
            step(Some((tid, 5)), false),
            (false, Some((tid, 4)), Some(tid))
        );
        assert_eq!(
            step(Some((tid, 2)), false),
            (false, Some((tid, 1)), Some(tid))
        );
        assert_eq!(step(Some((tid, 1)), false), (true, None, None));
        assert_eq!(
            step(Some((tid, 1)), true),
            (false, Some((tid, 1)), Some(tid))
        );
        assert_eq!(step(None, false), (false, None, Some(tid)));
        assert_eq!(
            step(Some((tid + 1, 1)), false),
            (false, Some((tid + 1, 1)), Some(tid))
        );
        schedule(&mut bench, None, None);
        bench.supervisor.stop_for_schedule(tid);
        assert_eq!(
            bench.supervisor.schedule.as_ref().expect("set").drawn,
            Some(tid)
        );
        bench.supervisor.schedule = None;
        assert!(!bench.supervisor.steps_by_schedule(tid));
        assert!(matches!(
            bench.supervisor.step_for_schedule(tid),
            Next::Go(None)
        ));
    }

    /// Half of the time others go first, if there are some.
    #[test]
    fn a_thread_that_loses_the_processor_is_behind_others_or_late() {
        let mut bench = bench(5);
        let tid = bench.tid;
        let mut behind = 0;
        for _ in 0..200 {
            bench.supervisor.queue.push_back(1);
            assert!(matches!(bench.supervisor.lose_processor(tid), Flow::Stays));
            let is_behind = bench.supervisor.queue == [1, tid];
            let is_late = !core::mem::take(&mut bench.supervisor.late).is_empty();
            assert!(is_behind != is_late);
            behind += u32::from(is_behind);
            bench.supervisor.queue.clear();
        }
        assert!((70..130).contains(&behind), "{behind}");
        for _ in 0..20 {
            bench.supervisor.lose_processor(tid);
            assert!(bench.supervisor.queue.is_empty());
        }
        assert_eq!(bench.supervisor.late.len(), 20);
    }

    /// A stop by a single step uses up an instruction; one by `int3` (CC) is the program's own.
    #[test]
    fn a_single_step_uses_up_an_instruction() {
        use crate::guest::supervisor::State;
        use crate::guest::tests::Stopped;
        use rustix::process::WaitOptions;

        let stopped = Stopped::new();
        stopped.runs(&[0x90, 0x90, 0x90, 0xCC]);
        let tid = stopped.pid.as_raw();
        let mut bench = bench(5);
        bench.add(tid, tid, State::Running);
        let mut stops = |of: i32, left: u64| {
            ptrace::step(stopped.pid, None).expect("it stands");
            super::super::wait(Some(stopped.pid), WaitOptions::empty()).expect("it stops");
            let schedule = bench.supervisor.schedule.as_mut().expect("set");
            (schedule.fuel, schedule.drawn) = (Some((of, left)), None);
            let flow = bench.supervisor.stepped_by_schedule(tid);
            let schedule = bench.supervisor.schedule.as_ref().expect("set");
            let goes = flow.map(|flow| matches!(flow, Flow::Goes(None)));
            (goes, schedule.fuel.map(|(_, left)| left))
        };
        assert_eq!(stops(tid, 5), (Some(true), Some(4)));
        assert_eq!(
            stops(tid + 1, 5),
            (None, Some(5)),
            "those of another thread"
        );
        assert_eq!(stops(tid, 1), (Some(false), None), "it loses the processor");
        assert_eq!(stops(tid, 5), (None, Some(5)), "its own trap");
        bench.supervisor.schedule = None;
        assert!(bench.supervisor.stepped_by_schedule(tid).is_none());
    }
}
