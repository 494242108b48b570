//! A watchdog in wall time for the running thread. It stops a thread that waits in the kernel for
//! an event outside of virtual time, or that computes without end, so that the thread can be named.
//! Computing is measured in processor time, because a thread may wait for its turn on a busy
//! machine. For the same reason, a thread that computes without a call does not mean that virtual
//! time stands.
//!
//! The watchdog has no influence on a verdict, and never stops a thread that makes calls.

use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, AtomicU64, Ordering};
use core::time::Duration;
use std::fs;
use std::sync::Arc;
use std::thread;

use protocols::Instant;
use rustix::process::{Pid, Signal, kill_process};

use crate::clock::{Clock, WallClock};
use crate::exec::Supervision;

/// Interval between two checks.
const EVERY: Duration = Duration::from_millis(50);
/// Number of checks without a call after which a sleeping thread counts as waiting for the outside
/// world.
const SLEEPS: u32 = 2;
/// `SLEEPS` for a thread that waits for a disk.
const FETCHES: u32 = 200;
/// Processor time without a call after which a thread is stopped so that others can run; the second
/// value is for `--schedule`, where loops that wait for others are common.
const COMPUTES: Duration = Duration::from_secs(1);
const COMPUTES_BY_SCHEDULE: Duration = Duration::from_millis(100);
/// Virtual time may stand for this many times the limit of computing.
const STANDS: u32 = 3;
const STANDS_MIN: Duration = Duration::from_secs(30);

/// The reason why a thread was stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kick {
    /// It waits in the kernel.
    Sleeps,
    /// It has computed without a call for this long since it continued.
    Computes(Duration),
}

#[derive(Debug, Default)]
struct Shared {
    /// The running thread and its process; 0: none.
    tid: AtomicI32,
    process: AtomicI32,
    /// Number of its actions.
    steps: AtomicU64,
    /// Milliseconds from its last action to its stop, plus one; 0: it was not stopped.
    kicked: AtomicU32,
    sleeps: AtomicBool,
    /// Number of single steps for a debugger: virtual time stands meanwhile, which is no fault.
    stepped: AtomicU64,
    /// Virtual time in nanoseconds, the number of its updates, and whether the supervisor is
    /// active.
    now: AtomicU64,
    turns: AtomicU64,
    is_at_work: AtomicBool,
    /// Seconds for which virtual time has stood; 0: it advances.
    stood: AtomicU32,
    is_over: AtomicBool,
    /// Number of checks: the only clock that the supervisor reads in its turns.
    beats: AtomicU32,
}

/// The watchdog, on a separate thread, which ends when this value is dropped.
#[derive(Debug)]
pub(super) struct Watchdog {
    shared: Arc<Shared>,
    clock: WallClock,
}

impl Watchdog {
    /// Starts a watchdog for a program whose first process is `root`.
    pub(super) fn start(root: i32, supervision: Supervision) -> Self {
        let shared = Arc::<Shared>::default();
        let watching = Arc::clone(&shared);
        // Without this thread, only the name of a hanging thread is lost.
        let _ = thread::Builder::new()
            .name("watchdog".to_owned())
            .spawn(move || watch(&watching, root, supervision));
        let clock = WallClock::start();
        Self { shared, clock }
    }

    /// Records that this thread runs from now on.
    pub(super) fn watch(&self, tid: i32, process: i32) {
        self.shared.process.store(process, Ordering::Relaxed);
        self.shared.tid.store(tid, Ordering::Relaxed);
        self.count();
    }

    /// Records an action of the running thread.
    pub(super) fn count(&self) {
        self.shared.steps.fetch_add(1, Ordering::Relaxed);
    }

    /// Records a single step for a debugger.
    pub(super) fn count_step(&self) {
        self.shared.stepped.fetch_add(1, Ordering::Relaxed);
    }

    /// Records that the supervisor becomes active at the virtual time `now`.
    pub(super) fn begin_turn(&self, now: Instant) {
        self.shared.turns.fetch_add(1, Ordering::Relaxed);
        self.shared.is_at_work.store(true, Ordering::Relaxed);
        let nanos = (now - Instant::ZERO).as_nanos();
        let nanos = u64::try_from(nanos).unwrap_or(u64::MAX);
        self.shared.now.store(nanos, Ordering::Relaxed);
    }

    /// Records that the supervisor is no longer active.
    pub(super) fn end_turn(&self) {
        self.shared.is_at_work.store(false, Ordering::Relaxed);
    }

    /// Time for which virtual time has stood, if that was too long.
    pub(super) fn stood(&self) -> Option<Duration> {
        let seconds = self.shared.stood.load(Ordering::Relaxed);
        (seconds > 0).then(|| Duration::from_secs(seconds.into()))
    }

    /// Number of checks so far.
    pub(super) fn beats(&self) -> u32 {
        self.shared.beats.load(Ordering::Relaxed)
    }

    /// Records that no thread runs.
    pub(super) fn rest(&self) {
        self.shared.tid.store(0, Ordering::Relaxed);
    }

    /// The reason why the thread was stopped, if it was.
    pub(super) fn take_kick(&self) -> Option<Kick> {
        let millis = self.shared.kicked.swap(0, Ordering::Relaxed);
        let sleeps = self.shared.sleeps.load(Ordering::Relaxed);
        let millis = millis.checked_sub(1)?;
        Some(match sleeps {
            true => Kick::Sleeps,
            false => Kick::Computes(Duration::from_millis(millis.into())),
        })
    }

    /// Waits in wall time.
    pub(super) fn pause(&self, length: Duration) {
        self.clock.sleep_until(self.clock.now() + length);
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
    }
}

fn watch(shared: &Shared, root: i32, supervision: Supervision) {
    let clock = WallClock::start();
    let spin_max = supervision.spin_max;
    let computes = match supervision.schedule {
        Some(_) => COMPUTES_BY_SCHEDULE,
        None => COMPUTES,
    };
    let patience = (spin_max * STANDS).max(STANDS_MIN);
    let (mut steps, mut stepped, mut looks) = (0, 0, 0);
    // State of the thread in all checks since its last action.
    let mut seen = None;
    let (mut since, mut time, mut turns, mut moved_at) = (Duration::ZERO, 0, 0, clock.now());
    // Thread and value of the last measured processor time.
    let mut last = (0, Duration::ZERO);
    while !shared.is_over.load(Ordering::Relaxed) {
        clock.sleep_until(clock.now() + EVERY);
        shared.beats.fetch_add(1, Ordering::Relaxed);
        let wall = clock.now();
        if core::mem::replace(&mut time, shared.now.load(Ordering::Relaxed)) != time {
            moved_at = wall;
        }
        // No thread continues between two turns.
        let has_turned =
            core::mem::replace(&mut turns, shared.turns.load(Ordering::Relaxed)) != turns;
        if !has_turned && !shared.is_at_work.load(Ordering::Relaxed) {
            moved_at = wall;
        }
        let by_debugger = shared.stepped.load(Ordering::Relaxed);
        if core::mem::replace(&mut stepped, by_debugger) != by_debugger {
            moved_at = wall;
        }
        let tid = shared.tid.load(Ordering::Relaxed);
        let process = shared.process.load(Ordering::Relaxed);
        let counted = used(process, tid).filter(|_| tid != 0);
        let state = state(process, tid).filter(|_| tid != 0);
        let now = shared.steps.load(Ordering::Relaxed);
        // Another limit applies to computing without a call. Calls that take no virtual time are
        // counted.
        if has_computed(&mut last, tid, counted) && state == Some('R') && now == steps {
            moved_at = wall;
        }
        if wall - moved_at >= patience {
            let seconds = u32::try_from((wall - moved_at).as_secs()).unwrap_or(u32::MAX);
            shared.stood.store(seconds, Ordering::Relaxed);
            // Killing the processes ends any wait.
            for pid in [process, root].into_iter().filter_map(Pid::from_raw) {
                let _ = kill_process(pid, Signal::KILL);
            }
            return;
        }
        let used = counted.unwrap_or(wall - Instant::ZERO);
        if tid == 0 || now != steps {
            (steps, looks, since) = (now, 0, used);
            continue;
        }
        if core::mem::replace(&mut seen, state) != state {
            (looks, since) = (0, used);
        }
        looks += 1;
        let computed = used.saturating_sub(since);
        let (sleeps, is_enough) = match state {
            Some('S') => (true, looks >= SLEEPS),
            // The thread waits for a disk, which may take long on a busy machine.
            Some('D') => (true, looks >= FETCHES),
            Some('R') => (false, computed >= spin_max.min(computes)),
            _ => continue,
        };
        if is_enough {
            let millis = u32::try_from(computed.as_millis()).unwrap_or(u32::MAX);
            shared.sleeps.store(sleeps, Ordering::Relaxed);
            shared
                .kicked
                .store(millis.saturating_add(1), Ordering::Relaxed);
            (looks, since) = (0, used);
            if let Some(pid) = Pid::from_raw(process) {
                let _ = kill_process(pid, Signal::STOP);
            }
        }
    }
}

/// Whether a thread has used processor time since the last check.
const fn has_computed(last: &mut (i32, Duration), tid: i32, used: Option<Duration>) -> bool {
    let Some(used) = used else {
        return false;
    };
    let (before, was) = core::mem::replace(last, (tid, used));
    before == tid && used.as_nanos() > was.as_nanos()
}

/// Processor time that a thread has used; `None` if the system does not report it.
fn used(process: i32, tid: i32) -> Option<Duration> {
    let text = fs::read_to_string(format!("/proc/{process}/task/{tid}/schedstat")).ok()?;
    let nanos = text.split_ascii_whitespace().next()?.parse().ok()?;
    match nanos {
        // Some kernels do not count it, and print zeros.
        0 => ticks(&fs::read_to_string(format!("/proc/{process}/task/{tid}/stat")).ok()?),
        nanos => Some(Duration::from_nanos(nanos)),
    }
}

/// Processor time by a line of `stat`: fields 14 and 15, in hundredths of a second (proc(5)).
fn ticks(stat: &str) -> Option<Duration> {
    let (_, fields) = stat.rsplit_once(") ")?;
    // The third field of the line is the first one here.
    let mut fields = fields.split_ascii_whitespace().skip(11);
    let mut next = || fields.next()?.parse::<u64>().ok();
    let ticks = next()?.saturating_add(next()?);
    Some(Duration::from_millis(ticks.saturating_mul(10)))
}

/// State of a thread, as the system's letter.
fn state(process: i32, tid: i32) -> Option<char> {
    let stat = fs::read_to_string(format!("/proc/{process}/task/{tid}/stat")).ok()?;
    let (_, fields) = stat.rsplit_once(") ")?;
    fields.chars().next()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thread that waits for its turn, or one that was not watched before, proves nothing.
    #[test]
    fn only_growing_processor_time_of_one_thread_is_computing() {
        let mut last = (0, Duration::ZERO);
        let mut look =
            |tid, millis| has_computed(&mut last, tid, Some(Duration::from_millis(millis)));
        let looks = [(7, 5), (7, 9), (7, 9), (8, 20), (8, 21)];
        let looks = looks.map(|(tid, millis)| look(tid, millis));
        assert_eq!(looks, [false, true, false, false, true]);
        assert!(!has_computed(&mut last, 8, None));
    }

    /// proc(5): utime and stime are fields 14 and 15; a name may hold brackets and spaces.
    #[test]
    fn processor_time_is_read_from_a_line_of_stat() {
        let stat = "7 (a ) b) R 1 7 7 0 -1 4194304 90 0 0 0 123 45 6 7 20 0 1 0 99 100 1";
        assert_eq!(ticks(stat), Some(Duration::from_millis(1_680)));
        assert_eq!(ticks("7 (a) R 1"), None);
    }

    /// A watch that no thread looks at.
    fn still() -> Watchdog {
        Watchdog {
            shared: Arc::default(),
            clock: WallClock::start(),
        }
    }

    #[test]
    fn the_watch_hears_what_the_supervisor_does() {
        let dog = still();
        let relaxed = Ordering::Relaxed;
        dog.watch(7, 5);
        let shared = &dog.shared;
        assert_eq!(
            (shared.tid.load(relaxed), shared.process.load(relaxed)),
            (7, 5)
        );
        assert_eq!(shared.steps.load(relaxed), 1);
        dog.count();
        assert_eq!(
            (shared.steps.load(relaxed), shared.stepped.load(relaxed)),
            (2, 0)
        );
        dog.count_step();
        assert_eq!(
            (shared.steps.load(relaxed), shared.stepped.load(relaxed)),
            (2, 1)
        );
        dog.rest();
        assert_eq!(
            (shared.tid.load(relaxed), shared.process.load(relaxed)),
            (0, 5)
        );
        dog.begin_turn(Instant::from_nanos(9));
        let turn = |dog: &Watchdog| {
            let shared = &dog.shared;
            (
                shared.turns.load(relaxed),
                shared.is_at_work.load(relaxed),
                shared.now.load(relaxed),
            )
        };
        assert_eq!(turn(&dog), (1, true, 9));
        dog.end_turn();
        assert_eq!(turn(&dog), (1, false, 9));
        shared.beats.store(3, relaxed);
        assert_eq!(dog.beats(), 3);
        assert_eq!(dog.stood(), None);
        shared.stood.store(31, relaxed);
        assert_eq!(dog.stood(), Some(Duration::from_secs(31)));
        let shared = Arc::clone(&dog.shared);
        drop(dog);
        assert!(shared.is_over.load(relaxed), "its thread ends");
    }

    /// The milliseconds are one more than they were, so that 0 is no kick; it is told once.
    #[test]
    fn a_kick_is_told_once() {
        let dog = still();
        assert_eq!(dog.take_kick(), None);
        let kick = |millis, sleeps| {
            dog.shared.kicked.store(millis, Ordering::Relaxed);
            dog.shared.sleeps.store(sleeps, Ordering::Relaxed);
            let kick = dog.take_kick();
            assert_eq!(dog.take_kick(), None);
            kick
        };
        assert_eq!(kick(1, true), Some(Kick::Sleeps));
        assert_eq!(kick(1, false), Some(Kick::Computes(Duration::ZERO)));
        assert_eq!(
            kick(1_001, false),
            Some(Kick::Computes(Duration::from_secs(1)))
        );
        assert_eq!(kick(0, true), None);
    }

    /// proc(5): the third field of `stat` is S for a sleep, R for a thread that runs, T for one
    /// that was stopped, t for one that a tracer stopped.
    #[test]
    fn the_state_of_a_thread_is_a_letter() {
        let stopped = crate::guest::tests::Stopped::new();
        let pid = stopped.pid.as_raw();
        assert_eq!(state(pid, pid), Some('t'));
        assert_eq!((state(-1, -1), used(-1, -1)), (None, None));
        let own = nix::unistd::gettid().as_raw();
        let process = std::process::id().cast_signed();
        assert_eq!(state(process, own), Some('R'));
        assert!(used(process, own).is_some());
        // Fields behind the name: the twelfth and the thirteenth of them.
        let stat = "7 (a) R 1 7 7 0 -1 4194304 90 0 0 0 1 0 6 7 20 0 1 0 99 100 1";
        assert_eq!(ticks(stat), Some(Duration::from_millis(10)));
        let most = format!("7 (a) R 1 7 7 0 -1 4194304 90 0 0 0 {} 1 6", u64::MAX);
        assert_eq!(ticks(&most), Some(Duration::from_millis(u64::MAX)));
    }
}
