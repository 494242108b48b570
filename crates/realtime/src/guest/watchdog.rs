//! A watch in wall time over the one thread that runs: if it waits in the kernel for something of
//! which virtual time knows nothing, or computes on and on, it is stopped so that it can be named.
//!
//! Nothing here counts for a verdict, and a thread that makes calls is never stopped.

use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, AtomicU64, Ordering};
use core::time::Duration;
use std::fs;
use std::sync::Arc;
use std::thread;

use rustix::process::{Pid, Signal, kill_process};

use crate::clock::{Clock, WallClock};

/// Between two looks.
const EVERY: Duration = Duration::from_millis(50);
/// Looks without a call after which a thread that sleeps is taken to wait for the world outside.
const SLEEPS: u32 = 2;
/// The same for one that waits for a disk.
const FETCHES: u32 = 200;
/// The same for one that computes.
const COMPUTES: u32 = 20;

/// Why a thread was stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kick {
    /// It waits in the kernel.
    Sleeps,
    /// It has computed for this long without a call.
    Computes(Duration),
}

#[derive(Debug, Default)]
struct Shared {
    /// The thread that runs, and its process; 0: none.
    tid: AtomicI32,
    process: AtomicI32,
    /// Counts what it does.
    steps: AtomicU64,
    /// Looks since its last step when it was stopped; 0: it was not.
    kicked: AtomicU32,
    sleeps: AtomicBool,
    is_over: AtomicBool,
}

/// The watch, on a thread of its own; it ends when this is dropped.
#[derive(Debug)]
pub(super) struct Watchdog {
    shared: Arc<Shared>,
    clock: WallClock,
}

impl Watchdog {
    pub(super) fn start() -> Self {
        let shared = Arc::<Shared>::default();
        let watching = Arc::clone(&shared);
        // Without it nothing is lost but the name of who hangs.
        let _ = thread::Builder::new()
            .name("watchdog".to_owned())
            .spawn(move || watch(&watching));
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

    /// Nobody runs.
    pub(super) fn rest(&self) {
        self.shared.tid.store(0, Ordering::Relaxed);
    }

    /// Why the thread was stopped, if it was.
    pub(super) fn take_kick(&self) -> Option<Kick> {
        let looks = self.shared.kicked.swap(0, Ordering::Relaxed);
        let sleeps = self.shared.sleeps.load(Ordering::Relaxed);
        (looks > 0).then_some(match sleeps {
            true => Kick::Sleeps,
            false => Kick::Computes(EVERY * looks),
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

fn watch(shared: &Shared) {
    let clock = WallClock::start();
    let (mut steps, mut looks) = (0, 0);
    // What it was seen to do in all of them.
    let mut seen = None;
    // Those of a thread that computes: that it was stopped in between does not count.
    let mut computed = 0;
    while !shared.is_over.load(Ordering::Relaxed) {
        clock.sleep_until(clock.now() + EVERY);
        let tid = shared.tid.load(Ordering::Relaxed);
        let now = shared.steps.load(Ordering::Relaxed);
        // A stop by ourselves and going on after it are two steps.
        if tid == 0 || now > steps + 2 {
            computed = 0;
        }
        if tid == 0 || now != steps {
            (steps, looks) = (now, 0);
            continue;
        }
        let process = shared.process.load(Ordering::Relaxed);
        let state = state(process, tid);
        if core::mem::replace(&mut seen, state) != state {
            looks = 0;
        }
        looks += 1;
        let (sleeps, limit) = match state {
            Some('S') => (true, SLEEPS),
            // For a disk, which on a busy machine takes its time.
            Some('D') => (true, FETCHES),
            Some('R') => (false, COMPUTES),
            _ => continue,
        };
        if looks >= limit {
            computed = if sleeps { 0 } else { computed + looks };
            shared.sleeps.store(sleeps, Ordering::Relaxed);
            shared.kicked.store(computed.max(1), Ordering::Relaxed);
            looks = 0;
            if let Some(pid) = Pid::from_raw(process) {
                let _ = kill_process(pid, Signal::STOP);
            }
        }
    }
}

/// What a thread does, as the system's letter.
fn state(process: i32, tid: i32) -> Option<char> {
    let stat = fs::read_to_string(format!("/proc/{process}/task/{tid}/stat")).ok()?;
    let (_, fields) = stat.rsplit_once(") ")?;
    fields.chars().next()
}
