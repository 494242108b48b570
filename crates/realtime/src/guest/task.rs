//! The supervisor's data about threads and processes of a foreign program.

use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet};
use std::os::fd::OwnedFd;
use std::sync::Arc;

use emulators::rng::Rng;
use nix::sys::signal::Signal;
use nix::unistd::Pid;
use protocols::Instant;

use super::call::Call;
use super::clock_page::ClockPage;
use super::open_file::File;

/// How a thread continues.
#[derive(Clone, Copy, Debug)]
pub(super) enum Next {
    /// It runs, with this signal if there is one.
    Go(Option<Signal>),
    /// It tries its current call again.
    Attempt,
    /// It has begun a call, and no decision was made about it.
    Begin,
    /// It makes the call that it has begun.
    Call,
    /// Its computing before that call has passed, and no other decision was made about it.
    Charged,
    /// It has computed up to the point where it lets others run first, or is delayed.
    Lose,
    /// It has stopped with this status, which was not handled yet.
    Stopped(i32),
}

/// The event that a thread waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum On {
    /// A call of another thread, or no event.
    Others,
    /// A change of a word in memory: its position, and a mask of bits.
    Futex(FutexKey, u32),
    /// Bytes to read, or room to write.
    Files,
    /// The end of sending at a port.
    Line,
    /// A queue or semaphore of System V, which has no file.
    Queue,
    /// The end of a child.
    Child,
}

/// The position of a word in memory: of one process, of a file, or of memory that processes share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FutexKey {
    /// Process and address.
    Own(i32, u64),
    /// Device and number of the file, and the offset.
    Shared(u64, u64, u64),
}

/// A wait. At the deadline the call is tried again and detects its timeout.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wait {
    pub(super) on: On,
    pub(super) deadline: Option<Instant>,
}

impl Wait {
    /// A wait until a signal comes.
    pub(super) const fn for_ever() -> Self {
        Self {
            on: On::Others,
            deadline: None,
        }
    }
}

/// State of a thread.
#[derive(Clone, Copy, Debug)]
pub(super) enum State {
    /// It is in the queue of threads that can run.
    Ready(Next),
    Running,
    Blocked(Wait),
    /// It is in the kernel, where virtual time does not count.
    Outside,
    /// It was stopped by a signal, until another signal continues it.
    Halted,
    /// It is the first thread of a process and has ended; other threads of the process have not.
    Ended,
}

/// One thread.
#[derive(Clone, Debug)]
pub(super) struct Thread {
    pub(super) tid: Pid,
    /// Number of threads that were created before it.
    pub(super) index: u32,
    /// The number of its process.
    pub(super) process: i32,
    pub(super) state: State,
    /// Its current or last call.
    pub(super) call: Option<Call>,
    /// The call in which it waits outside of virtual time.
    pub(super) outside: Option<Call>,
    /// Time at which it made this call.
    pub(super) entered: Instant,
    /// Processor time that it has used since this call.
    pub(super) computed: Duration,
    /// The thread is in a loop without a call that only another thread can end: the value of
    /// `progress` at that time.
    pub(super) in_loop_at: Option<u64>,
    pub(super) loop_state: Option<u64>,
    /// Number of instructions in that loop, if the thread has made no call since.
    pub(super) loop_length: Option<u32>,
    /// Number of its current wait among all waits.
    pub(super) blocked_at: u64,
    pub(super) is_woken: bool,
    /// Whether it has stopped at the end of a call that it will make again.
    pub(super) is_at_end: bool,
    /// Number of bytes that its call has already processed.
    pub(super) progress: usize,
    /// The side of a named pipe that it waits to open.
    pub(super) opens: Option<FifoSide>,
    /// Numbers of changes of a port's lines when it began to wait for them.
    pub(super) lines_before: Option<[u32; 4]>,
    pub(super) slice: u32,
    /// The files of its `poll` or `select`, in the format of the program's memory.
    pub(super) watched: Vec<u8>,
    /// The timeout of its `select`, in the format of the program's memory.
    pub(super) timeout: [u8; 16],
    /// Whether it waits only for bytes of ports that the supervisor holds.
    pub(super) waits_for_ports: bool,
    /// Whether its call is about a port whose bytes the supervisor holds.
    pub(super) asks_port: bool,
    /// Pipes and counters of its last calls of `select` and `poll`.
    pub(super) quiet: Vec<i32>,
    /// Its busy waiting, if it was detected.
    pub(super) idle: Option<Idle>,
    /// The processors that it has requested, as bits.
    pub(super) processors: u64,
    /// The thread that waits in the kernel until this one has executed another program.
    pub(super) vfork_parent: Option<i32>,
}

/// Calls that a thread repeats, each time with the same useless answer, and with only looks at
/// clocks between them.
#[derive(Clone, Debug)]
pub(super) struct Idle {
    pub(super) seen: Vec<Fruitless>,
    /// Number of these calls in a row.
    pub(super) count: u32,
    /// Time of the first one.
    pub(super) since: Instant,
}

/// A call without success.
#[derive(Clone, Debug)]
pub(super) struct Fruitless {
    /// Its number and arguments.
    pub(super) call: (i64, [u64; 3]),
    /// The files of a `poll` or `select`, in the format of the program's memory.
    pub(super) watched: Vec<u8>,
    pub(super) answer: i64,
}

/// One side of a named pipe: device and number of the file, and the side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FifoSide {
    pub(super) file: (u64, u64),
    pub(super) writes: bool,
}

impl Thread {
    pub(super) const fn is_blocked(&self) -> bool {
        matches!(self.state, State::Blocked(_))
    }

    const fn wait(&self) -> Option<Wait> {
        match self.state {
            State::Blocked(wait) => Some(wait),
            _ => None,
        }
    }

    pub(super) fn deadline(&self) -> Option<Instant> {
        self.wait()?.deadline
    }

    pub(super) fn waits_for_files(&self) -> bool {
        let on = self.wait().map(|wait| wait.on);
        matches!(on, Some(On::Files | On::Line))
    }

    pub(super) fn waits_for_queue(&self) -> bool {
        self.wait().is_some_and(|wait| wait.on == On::Queue)
    }

    /// Whether it waits for bytes to leave.
    pub(super) fn watches_lines(&self) -> bool {
        self.wait().is_some_and(|wait| wait.on == On::Line)
    }
}

/// A timer behind a file descriptor.
#[derive(Debug)]
pub(super) struct TimerFile {
    /// The kernel's own timer; the supervisor makes it readable when its time has come.
    pub(super) file: OwnedFd,
    pub(super) clock: i64,
    pub(super) timer: Timer,
    /// Expirations that no thread has read yet.
    pub(super) expired: u64,
}

/// Time of the next expiration, and the interval in nanoseconds after it; 0: no further ones.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Timer {
    pub(super) at: Option<Instant>,
    pub(super) interval: u64,
}

/// Minimum interval of checks for timers that expire more often: the kernel also combines
/// expirations.
const OFTEN: Duration = Duration::from_micros(50);

impl Timer {
    /// Time of the next check.
    fn deadline(&self) -> Option<Instant> {
        let interval = Duration::from_nanos(self.interval);
        let later = match interval.is_zero() {
            true => Duration::ZERO,
            false => OFTEN.saturating_sub(interval),
        };
        self.at.map(|at| at + later)
    }
}

/// A timer of timer_create.
#[derive(Clone, Copy, Debug)]
pub(super) struct PosixTimer {
    pub(super) clock: i64,
    /// The signal that it sends; 0: none.
    pub(super) signal: i32,
    /// Value for the thread that takes the signal.
    pub(super) value: u64,
    /// The thread that gets the signal, if it is for one thread.
    pub(super) thread: Option<i32>,
    pub(super) timer: Timer,
    /// Whether it has expired and no thread has taken its signal yet.
    pub(super) is_due: bool,
    /// Whether the kernel has its signal for a thread.
    pub(super) is_sent: bool,
    pub(super) overrun: i64,
}

/// One process.
#[derive(Debug)]
pub(super) struct Process {
    /// A handle of the process, for copies of its files.
    pub(super) handle: Option<OwnedFd>,
    /// Copies of its open files.
    pub(super) files: BTreeMap<i32, Arc<File>>,
    /// Instructions at which it has made 64-bit calls.
    pub(super) sites: BTreeSet<u64>,
    /// Its page with clocks that cause no calls.
    pub(super) clocks: Option<ClockPage>,
    /// Instructions with calls that its page may answer, and whether the page is asked.
    pub(super) detours: BTreeMap<u64, bool>,
    /// Whether another process may run in its memory for an unlimited time.
    pub(super) shares_memory: bool,
    pub(super) random: Rng,
    /// Signals whose handlers request a restart of interrupted calls, as bits.
    pub(super) restarts: u64,
    pub(super) alarm: Timer,
    pub(super) timers: BTreeMap<i32, TimerFile>,
    pub(super) posix_timers: BTreeMap<i32, PosixTimer>,
    /// Whether all its threads are about to end.
    pub(super) is_dying: bool,
    /// The signal above 31 that ends it.
    pub(super) fatal: Option<i32>,
}

impl Process {
    /// Time at which its next timer expires.
    pub(super) fn next_timer(&self) -> Option<Instant> {
        let files = self
            .timers
            .values()
            .filter_map(|file| file.timer.deadline());
        let posix = self.posix_timers.values();
        let posix = posix.filter_map(|timer| timer.timer.deadline());
        files.chain(posix).chain(self.alarm.deadline()).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::guest::supervisor::tests::Bench;

    #[test]
    fn a_thread_waits_for_one_thing() {
        let mut bench = Bench::new();
        let key = FutexKey::Own(1, 8);
        let at = Some(Instant::from_millis(5));
        for (on, files, queue, lines) in [
            (On::Others, false, false, false),
            (On::Futex(key, 1), false, false, false),
            (On::Files, true, false, false),
            (On::Line, true, false, true),
            (On::Queue, false, true, false),
            (On::Child, false, false, false),
        ] {
            let thread = bench.thread();
            thread.state = State::Blocked(Wait { on, deadline: at });
            assert!(thread.is_blocked() && thread.deadline() == at);
            assert_eq!(thread.waits_for_files(), files, "{on:?}");
            assert_eq!(thread.waits_for_queue(), queue, "{on:?}");
            assert_eq!(thread.watches_lines(), lines, "{on:?}");
        }
        let thread = bench.thread();
        thread.state = State::Running;
        assert!(!thread.is_blocked() && thread.deadline().is_none());
        assert!(!thread.waits_for_files() && !thread.waits_for_queue() && !thread.watches_lines());
        let wait = Wait::for_ever();
        assert_eq!((wait.on, wait.deadline), (On::Others, None));
    }

    /// By hand: a timer each 20 us is looked at 30 us after its time, so not more than each 50 us.
    #[test]
    fn fast_timers_are_looked_at_less_often() {
        let deadline = |at: Option<u64>, interval| {
            let at = at.map(Instant::from_micros);
            Timer { at, interval }.deadline().map(Instant::as_nanos)
        };
        assert_eq!(deadline(None, 20_000), None);
        assert_eq!(deadline(Some(100), 0), Some(100_000));
        assert_eq!(deadline(Some(100), 20_000), Some(130_000));
        assert_eq!(deadline(Some(100), 50_000), Some(100_000));
        assert_eq!(deadline(Some(100), 90_000), Some(100_000));
    }

    #[test]
    fn the_next_timer_is_the_earliest_of_all_kinds() {
        let mut bench = Bench::new();
        let at = |ms| Timer {
            at: Some(Instant::from_millis(ms)),
            interval: 0,
        };
        assert_eq!(bench.process().next_timer(), None);
        bench.process().alarm = at(30);
        assert_eq!(bench.process().next_timer(), Some(Instant::from_millis(30)));
        let null = std::fs::File::open("/dev/null").expect("it is there");
        let file = TimerFile {
            file: null.into(),
            clock: 1,
            timer: at(20),
            expired: 0,
        };
        bench.process().timers.insert(3, file);
        assert_eq!(bench.process().next_timer(), Some(Instant::from_millis(20)));
        let posix = PosixTimer {
            clock: 1,
            signal: 0,
            value: 0,
            thread: None,
            timer: at(10),
            is_due: false,
            is_sent: false,
            overrun: 0,
        };
        bench.process().posix_timers.insert(0, posix);
        assert_eq!(bench.process().next_timer(), Some(Instant::from_millis(10)));
    }
}
