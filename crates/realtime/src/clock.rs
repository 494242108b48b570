//! Clocks of a runner: the wall clock, and a clock that jumps.
//!
//! All code below a runner gets time as an argument. Only this module reads a clock of the
//! operating system, and only this module waits. Code on top of a [`Clock`] can therefore be run
//! and tested without waiting.

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub(crate) mod counter;
#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
mod counter {
    /// Reads a clock.
    pub(super) fn shown<T>(read: impl FnOnce() -> T) -> T {
        read()
    }
}

use core::cell::Cell;
use core::time::Duration;
use std::thread;
use std::time;

use protocols::Instant;

/// Measures the time since the run began, and waits.
///
/// Time never runs backwards. `sleep_until` returns at once if the deadline has passed; it may
/// return late, never early.
pub trait Clock {
    /// Current time.
    fn now(&self) -> Instant;

    /// Stops time for the last `by`, as if it had not passed. Returns whether this clock can do
    /// that.
    fn slip(&self, by: Duration) -> bool {
        let _ = by;
        false
    }

    /// The real time in which `time` passes on this clock.
    fn lasts(&self, time: Duration) -> Duration {
        time
    }

    /// Waits until `deadline`. Deadlines are absolute, so lateness does not add up.
    fn sleep_until(&self, deadline: Instant);
}

/// The operating system's monotonic clock, which is zero at its creation.
#[derive(Clone, Copy, Debug)]
pub struct WallClock {
    start: time::Instant,
    spin: Duration,
}

impl WallClock {
    /// A clock that begins now and sleeps to a deadline: some 80 us late on Linux, without load.
    pub fn start() -> Self {
        Self::spinning(Duration::ZERO)
    }

    /// A clock that spins during the last `spin` before a deadline: mostly exact to a microsecond,
    /// but it keeps a core busy. 150 us cover the usual lateness of a sleep.
    #[expect(
        clippy::disallowed_methods,
        reason = "the one reader of an operating-system clock"
    )]
    pub fn spinning(spin: Duration) -> Self {
        Self {
            start: counter::shown(time::Instant::now),
            spin,
        }
    }
}

impl Clock for WallClock {
    fn now(&self) -> Instant {
        Instant::ZERO + counter::shown(|| self.start.elapsed())
    }

    #[expect(clippy::disallowed_methods, reason = "the one place that waits")]
    fn sleep_until(&self, deadline: Instant) {
        loop {
            let left = deadline - self.now();
            if left.is_zero() {
                return;
            }
            match left.checked_sub(self.spin) {
                Some(sleep) if !sleep.is_zero() => thread::sleep(sleep),
                _ => core::hint::spin_loop(),
            }
        }
    }
}

/// Wakes this thread at the requested time instead of up to 50 us later, where the system supports
/// this.
#[cfg(target_os = "linux")]
pub(super) fn be_prompt() {
    let _ = rustix::thread::set_current_timer_slack(core::num::NonZeroU64::new(1));
}

#[cfg(not(target_os = "linux"))]
pub(super) const fn be_prompt() {}

/// Restores the usual timer slack of this thread. Threads and processes that it starts inherit it.
#[cfg(target_os = "linux")]
pub(super) fn be_usual() {
    let _ = rustix::thread::set_current_timer_slack(None);
}

#[cfg(not(target_os = "linux"))]
pub(super) const fn be_usual() {}

/// Current calendar time: nanoseconds since 1970, UTC. Zero if the system's calendar is wrong.
#[expect(
    clippy::disallowed_methods,
    reason = "the one reader of the system's calendar"
)]
pub fn utc() -> Instant {
    let now = counter::shown(time::SystemTime::now);
    let since_1970 = now.duration_since(time::UNIX_EPOCH);
    Instant::ZERO + since_1970.unwrap_or_default()
}

/// A clock that stands until its owner sleeps, then jumps to the end of the sleep.
#[derive(Clone, Debug, Default)]
pub struct SimClock {
    now: Cell<Instant>,
}

impl SimClock {
    /// Advances time, like a busy processor.
    pub fn advance(&self, by: Duration) {
        self.now.set(self.now.get() + by);
    }
}

impl Clock for SimClock {
    fn now(&self) -> Instant {
        self.now.get()
    }

    fn sleep_until(&self, deadline: Instant) {
        self.now.set(self.now.get().max(deadline));
    }
}

/// Processor time of the calling thread so far; `None` if the system does not provide it. For
/// information beside a result, never for a verdict.
pub fn thread_cpu_time() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanos = text.split_ascii_whitespace().next()?.parse().ok()?;
    Some(Duration::from_nanos(nanos))
}

/// Processor time that a process has used so far; `None` if there is no such process.
/// Each charge that is made of it is recorded, so that a run can be repeated.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub(crate) fn processor_time(process: i32) -> Option<Duration> {
    let clock = nix::time::clock_getcpuclockid(nix::unistd::Pid::from_raw(process)).ok()?;
    nix::time::clock_gettime(clock).ok().map(Duration::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wakes_at_or_after<C: Clock>(clock: &C, deadline: Instant) -> bool {
        clock.sleep_until(deadline);
        clock.now() >= deadline
    }

    #[test]
    fn a_sleep_never_ends_early() {
        let deadline = Instant::from_millis(3);
        assert!(wakes_at_or_after(&WallClock::start(), deadline));
        assert!(wakes_at_or_after(
            &WallClock::spinning(Duration::from_micros(150)),
            deadline
        ));
        assert!(wakes_at_or_after(&SimClock::default(), deadline));
    }

    #[test]
    fn a_deadline_that_has_passed_does_not_turn_time_back() {
        let clock = SimClock::default();
        clock.advance(Duration::from_secs(5));
        clock.sleep_until(Instant::from_secs(2));
        assert_eq!(clock.now(), Instant::from_secs(5));
    }
}
