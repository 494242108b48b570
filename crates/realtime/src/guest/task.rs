//! Threads and processes of a foreign program, as the supervisor knows them.

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

/// How a thread goes on.
#[derive(Clone, Copy, Debug)]
pub(super) enum Next {
    /// With this signal, if any.
    Go(Option<Signal>),
    /// It tries the call at which it stands once more.
    Attempt,
    /// It has begun a call, and nothing was decided about it.
    Begin,
    /// It makes the call that it has begun.
    Call,
    /// Its computing before that call has passed, and nothing else was decided about it.
    Charged,
    /// It has computed up to where it lets others go first, or is late.
    Lose,
    /// It has stopped with this status, which the supervisor has not handled yet.
    Stopped(i32),
}

/// What a thread waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum On {
    /// Another thread's call, or nothing.
    Others,
    /// A word in memory: where it is, and which of its bits.
    Futex(FutexKey, u32),
    /// Something to read or room to write.
    Files,
    /// Bytes that leave a port.
    Line,
    /// A queue or a semaphore of System V, which has no file.
    Queue,
    /// A child that ends.
    Child,
}

/// A word in memory: that of a process, or of a file or of memory that processes share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FutexKey {
    /// Process and address.
    Own(i32, u64),
    /// Device and number of the file, offset.
    Shared(u64, u64, u64),
}

/// A wait: at the deadline the call is tried again and sees that its time is up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wait {
    pub(super) on: On,
    pub(super) deadline: Option<Instant>,
}

impl Wait {
    /// Until a signal comes.
    pub(super) const fn for_ever() -> Self {
        Self {
            on: On::Others,
            deadline: None,
        }
    }
}

/// What a thread does.
#[derive(Clone, Copy, Debug)]
pub(super) enum State {
    /// It is in the queue of threads that can run.
    Ready(Next),
    Running,
    Blocked(Wait),
    /// It is in the kernel, and virtual time does not count there.
    Outside,
    /// It was stopped by a signal, until one comes that lets it go on.
    Halted,
    /// The first thread of a process has ended, others have not.
    Ended,
}

/// One thread.
#[derive(Clone, Debug)]
pub(super) struct Thread {
    pub(super) tid: Pid,
    /// How many there were before it.
    pub(super) index: u32,
    /// The number of its process.
    pub(super) process: i32,
    pub(super) state: State,
    /// The call at which it stands, or made last.
    pub(super) call: Option<Call>,
    /// The call in which it waits outside of virtual time.
    pub(super) outside: Option<Call>,
    /// When it made that call.
    pub(super) entered: Instant,
    /// Processor time for which it has computed since then.
    pub(super) computed: Duration,
    /// It was found in a loop without a call that only another thread can end: the number of signs
    /// of progress at that time, and the fingerprint of the loop.
    pub(super) in_loop_at: Option<u64>,
    pub(super) loop_state: Option<u64>,
    /// Instructions of that loop, if the thread has made no call since.
    pub(super) loop_length: Option<u32>,
    /// Counts all beginnings of waits.
    pub(super) blocked_at: u64,
    pub(super) is_woken: bool,
    /// It stands at the end of a call that it will make again.
    pub(super) is_at_end: bool,
    /// Bytes of the call that are done.
    pub(super) progress: usize,
    /// The side of a named pipe that it waits to open.
    pub(super) opens: Option<FifoSide>,
    /// How often the lines of a port had changed when it began to wait for them.
    pub(super) lines_before: Option<[u32; 4]>,
    pub(super) slice: u32,
    /// The files of its `poll` or `select`, as it names them in memory.
    pub(super) watched: Vec<u8>,
    /// The longest wait of its `select`, as it names it in memory.
    pub(super) timeout: [u8; 16],
    /// It waits for bytes of ports that the supervisor holds, and for nothing else.
    pub(super) waits_for_ports: bool,
    /// Its call is about a port whose bytes the supervisor holds.
    pub(super) asks_port: bool,
    /// Pipes and counters of its last calls of `select` and `poll`.
    pub(super) quiet: Vec<i32>,
    /// What it asks for over and over.
    pub(super) idle: Option<Idle>,
    /// The processors on which it wants to run, as bits.
    pub(super) processors: u64,
    /// The thread that waits in the kernel until this one has become another program.
    pub(super) vfork_parent: Option<i32>,
}

/// Calls that a thread makes again and again, each time with the same answer that is of no use, and
/// nothing else but looks at clocks.
#[derive(Clone, Debug)]
pub(super) struct Idle {
    pub(super) seen: Vec<Fruitless>,
    /// How many there were in a row.
    pub(super) count: u32,
    /// When the first one was made.
    pub(super) since: Instant,
}

/// A call of no use.
#[derive(Clone, Debug)]
pub(super) struct Fruitless {
    /// Its number and arguments.
    pub(super) call: (i64, [u64; 3]),
    /// The files of a `poll` or `select`, as its thread names them in memory.
    pub(super) watched: Vec<u8>,
    pub(super) answer: i64,
}

/// One side of a named pipe: device and number of the file, and which side.
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
    /// The kernel's own, which is made readable when its time has come.
    pub(super) file: OwnedFd,
    pub(super) clock: i64,
    pub(super) timer: Timer,
    /// Expirations that no thread has read yet.
    pub(super) expired: u64,
}

/// When it expires next, and each how many nanoseconds after that; 0: never again.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Timer {
    pub(super) at: Option<Instant>,
    pub(super) interval: u64,
}

/// Timers that expire more often are looked at so often: the kernel joins expirations as well.
const OFTEN: Duration = Duration::from_micros(50);

impl Timer {
    /// When to look at it next.
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
    /// The thread for which the signal is.
    pub(super) thread: Option<i32>,
    pub(super) timer: Timer,
    /// It has expired, and no thread has taken its signal yet.
    pub(super) is_due: bool,
    /// The kernel has its signal for some thread.
    pub(super) is_sent: bool,
    pub(super) overrun: i64,
}

/// One process.
#[derive(Debug)]
pub(super) struct Process {
    /// By which its files can be had.
    pub(super) handle: Option<OwnedFd>,
    /// Copies of its open files.
    pub(super) files: BTreeMap<i32, Arc<File>>,
    /// Instructions at which it was seen to make 64-bit calls.
    pub(super) sites: BTreeSet<u64>,
    /// Its clocks that are no calls.
    pub(super) clocks: Option<ClockPage>,
    /// Instructions at which it makes calls that its page may answer; whether the page is asked.
    pub(super) detours: BTreeMap<u64, bool>,
    /// Another process may run in its memory for as long as it wants.
    pub(super) shares_memory: bool,
    pub(super) random: Rng,
    /// Signals, as bits, whose handlers ask for interrupted calls to be made again.
    pub(super) restarts: u64,
    pub(super) alarm: Timer,
    pub(super) timers: BTreeMap<i32, TimerFile>,
    pub(super) posix_timers: BTreeMap<i32, PosixTimer>,
    /// All its threads are about to end.
    pub(super) is_dying: bool,
    /// The signal beyond 31 by which it ends.
    pub(super) fatal: Option<i32>,
}

impl Process {
    /// When the next of its timers expires.
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
