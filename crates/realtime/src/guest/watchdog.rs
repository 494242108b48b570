//! A watch in wall time over the one thread that runs: if it waits in the kernel for something of
//! which virtual time knows nothing, or computes on and on, it is stopped so that it can be named.
//! Computing is measured in processor time, since on a busy machine a thread may wait for its turn.
//! For the same reason a thread that computes without a call is no sign that virtual time stands.
//!
//! Nothing here counts for a verdict, and a thread that makes calls is never stopped.

use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, AtomicU64, Ordering};
use core::time::Duration;
use std::fs;
use std::sync::Arc;
use std::thread;

use protocols::Instant;
use rustix::process::{Pid, Signal, kill_process};

use crate::clock::{Clock, WallClock};
use crate::exec::Supervision;

/// Between two looks.
const EVERY: Duration = Duration::from_millis(50);
/// Looks without a call after which a thread that sleeps is taken to wait for the world outside.
const SLEEPS: u32 = 2;
/// The same for one that waits for a disk.
const FETCHES: u32 = 200;
/// Processor time after which one that computes is stopped, to hear of others; with `--schedule`,
/// where loops that wait for others are common.
const COMPUTES: Duration = Duration::from_secs(1);
const COMPUTES_BY_SCHEDULE: Duration = Duration::from_millis(100);
/// So many times as long as a thread may compute virtual time may stand.
const STANDS: u32 = 3;
const STANDS_MIN: Duration = Duration::from_secs(30);

/// Why a thread was stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kick {
    /// It waits in the kernel.
    Sleeps,
    /// It has computed for this long without a call, since it was let go on.
    Computes(Duration),
}

#[derive(Debug, Default)]
struct Shared {
    /// The thread that runs, and its process; 0: none.
    tid: AtomicI32,
    process: AtomicI32,
    /// Counts what it does.
    steps: AtomicU64,
    /// Milliseconds since its last step when it was stopped, and one more; 0: it was not.
    kicked: AtomicU32,
    sleeps: AtomicBool,
    /// Counts single instructions for a debugger: time stands meanwhile, and that is no fault.
    stepped: AtomicU64,
    /// Virtual time, nanoseconds; how often that was told, and whether the supervisor is at work.
    now: AtomicU64,
    turns: AtomicU64,
    is_at_work: AtomicBool,
    /// Seconds for which that stood; 0: it goes on.
    stood: AtomicU32,
    is_over: AtomicBool,
    /// Counts its looks: the only clock that the supervisor reads in its turns.
    beats: AtomicU32,
}

/// The watch, on a thread of its own; it ends when this is dropped.
#[derive(Debug)]
pub(super) struct Watchdog {
    shared: Arc<Shared>,
    clock: WallClock,
}

impl Watchdog {
    /// Over a program whose first process is `root`.
    pub(super) fn start(root: i32, supervision: Supervision) -> Self {
        let shared = Arc::<Shared>::default();
        let watching = Arc::clone(&shared);
        // Without this thread only the name of a hanging thread is lost.
        let _ = thread::Builder::new()
            .name("watchdog".to_owned())
            .spawn(move || watch(&watching, root, supervision));
        let clock = WallClock::start();
        Self { shared, clock }
    }

    /// From now on this thread runs.
    pub(super) fn watch(&self, tid: i32, process: i32) {
        self.shared.process.store(process, Ordering::Relaxed);
        self.shared.tid.store(tid, Ordering::Relaxed);
        self.count();
    }

    /// It did something.
    pub(super) fn count(&self) {
        self.shared.steps.fetch_add(1, Ordering::Relaxed);
    }

    /// A debugger lets it go by single instructions.
    pub(super) fn count_step(&self) {
        self.shared.stepped.fetch_add(1, Ordering::Relaxed);
    }

    /// The supervisor begins to work, and virtual time is this.
    pub(super) fn begin_turn(&self, now: Instant) {
        self.shared.turns.fetch_add(1, Ordering::Relaxed);
        self.shared.is_at_work.store(true, Ordering::Relaxed);
        let nanos = (now - Instant::ZERO).as_nanos();
        let nanos = u64::try_from(nanos).unwrap_or(u64::MAX);
        self.shared.now.store(nanos, Ordering::Relaxed);
    }

    /// It does something else now.
    pub(super) fn end_turn(&self) {
        self.shared.is_at_work.store(false, Ordering::Relaxed);
    }

    /// For how long virtual time stood, if that was too long.
    pub(super) fn stood(&self) -> Option<Duration> {
        let seconds = self.shared.stood.load(Ordering::Relaxed);
        (seconds > 0).then(|| Duration::from_secs(seconds.into()))
    }

    /// Number of looks so far.
    pub(super) fn beats(&self) -> u32 {
        self.shared.beats.load(Ordering::Relaxed)
    }

    /// No thread runs.
    pub(super) fn rest(&self) {
        self.shared.tid.store(0, Ordering::Relaxed);
    }

    /// Why the thread was stopped, if it was.
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
    // What it was seen to do in all of them.
    let mut seen = None;
    let (mut since, mut time, mut turns, mut moved_at) = (Duration::ZERO, 0, 0, clock.now());
    // Whose processor time it saw last, and how much that was.
    let mut last = (0, Duration::ZERO);
    while !shared.is_over.load(Ordering::Relaxed) {
        clock.sleep_until(clock.now() + EVERY);
        shared.beats.fetch_add(1, Ordering::Relaxed);
        let wall = clock.now();
        if core::mem::replace(&mut time, shared.now.load(Ordering::Relaxed)) != time {
            moved_at = wall;
        }
        // Nothing resumes the thread between two turns.
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
        // How long it may compute without a call, another limit says. Calls at no cost are counted.
        if has_computed(&mut last, tid, counted) && state == Some('R') && now == steps {
            moved_at = wall;
        }
        if wall - moved_at >= patience {
            let seconds = u32::try_from((wall - moved_at).as_secs()).unwrap_or(u32::MAX);
            shared.stood.store(seconds, Ordering::Relaxed);
            // Whatever is waited for, it comes to its end.
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
            // For a disk, which on a busy machine takes its time.
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

/// Whether a thread has used processor time since the last look at it.
const fn has_computed(last: &mut (i32, Duration), tid: i32, used: Option<Duration>) -> bool {
    let Some(used) = used else {
        return false;
    };
    let (before, was) = core::mem::replace(last, (tid, used));
    before == tid && used.as_nanos() > was.as_nanos()
}

/// Processor time that a thread has used; `None` where the system does not tell.
fn used(process: i32, tid: i32) -> Option<Duration> {
    let text = fs::read_to_string(format!("/proc/{process}/task/{tid}/schedstat")).ok()?;
    let nanos = text.split_ascii_whitespace().next()?.parse().ok()?;
    match nanos {
        // Some kernels keep no such count, and print zeros.
        0 => ticks(&fs::read_to_string(format!("/proc/{process}/task/{tid}/stat")).ok()?),
        nanos => Some(Duration::from_nanos(nanos)),
    }
}

/// Processor time by a line of `stat`: fields 14 and 15, in hundredths of a second (proc(5)).
fn ticks(stat: &str) -> Option<Duration> {
    let (_, fields) = stat.rsplit_once(") ")?;
    // The third field is the first one here.
    let mut fields = fields.split_ascii_whitespace().skip(11);
    let mut next = || fields.next()?.parse::<u64>().ok();
    let ticks = next()?.saturating_add(next()?);
    Some(Duration::from_millis(ticks.saturating_mul(10)))
}

/// What a thread does, as the system's letter.
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
}
