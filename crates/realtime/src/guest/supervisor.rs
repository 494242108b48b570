//! The main loop: runs one thread until it blocks, then the next one. When all threads are blocked,
//! time advances.

mod clocks;
mod crash;
mod death;
mod debugging;
mod dispatch;
mod fifos;
mod files;
mod futex;
mod high;
mod idle;
mod late;
mod lent;
mod locks;
mod loops;
mod notices;
mod own_terminals;
mod pi_futex;
mod pipes;
mod polls;
mod ports;
mod posix_timers;
mod price;
mod processors;
mod queues;
mod rewind;
mod schedule;
mod signal_files;
mod signals;
mod spent;
mod steps;
mod stops;
mod streams;
mod terminals;
mod timers;
mod told;
mod waits;

use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use nix::errno::Errno;
use nix::sys::ptrace::{self, Options};
use nix::sys::signal::Signal;
use nix::unistd::Pid;
use protocols::Instant;
use rustix::event::PollFlags;
use rustix::process::WaitOptions;

use super::GuestError;
use super::call::{self, Call};
use super::computing::Computing;
use super::memory::Memory;
use super::news::{is_death, wait};
use super::stage::Stage;
use super::task::{Next, On, Process, State, Thread, Wait};
use super::trace::Calls;
use super::watchdog::Watchdog;
use crate::exec::Supervision;
use debugging::Left;
pub(super) use debugging::{Debugging, Goal, PortWrite, Step, Stop, Wanted, Watchpoint, poke};
use fifos::Meeting;
use lent::Lease;
use notices::Notice;
pub(super) use rewind::Moment;
use schedule::Schedule;

/// Number of calls that a thread makes in a row while other threads could run.
const SLICE: u32 = 1_000;
/// Wall time for each step of virtual time while a thread waits outside of virtual time.
const OUTSIDE: Duration = Duration::from_millis(1);

/// Decision about a call.
pub(super) enum Outcome {
    /// The program gets this result; the kernel does not execute the call.
    Answer(i64),
    /// The kernel executes the call.
    Kernel,
    /// The thread waits.
    Block(Wait),
    /// The kernel executes the call for an unknown time; the thread stays in this state until it
    /// ends.
    Leave(State),
    /// The program gets this result, after other threads that can run.
    Yield(i64),
}

impl From<Errno> for Outcome {
    fn from(errno: Errno) -> Self {
        Self::Answer(-i64::from(errno as i32))
    }
}

/// Whether the running thread continues.
enum Flow {
    /// It continues, with this signal if there is one.
    Goes(Option<Signal>),
    Stays,
}

/// Settings for a whole run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settings {
    /// Seed of all random bytes that the program requests from the system.
    pub(super) seed: u64,
    pub(super) supervision: Supervision,
}

/// All threads of a foreign program, and the stage with its rig.
pub(super) struct Supervisor {
    pub(super) stage: Stage,
    settings: Settings,
    /// The first process of each program, with the system's status of those that have ended.
    roots: BTreeMap<i32, Option<i32>>,
    /// Launchers that have not become their program yet.
    launchers: BTreeSet<i32>,
    threads: BTreeMap<i32, Thread>,
    processes: BTreeMap<i32, Process>,
    queue: VecDeque<i32>,
    /// First stops of threads whose creation has not been reported yet.
    early: BTreeSet<i32>,
    /// Numbers of threads and processes created so far.
    born: [u32; 2],
    blocks: u64,
    /// Whether an event may have changed the readiness of files.
    is_changed: bool,
    /// The only thread that has run since all threads that wait for files tried again.
    ran: Option<i32>,
    /// Whether a signal may be pending for a thread that waits.
    is_signalled: bool,
    /// Whether the program has opened files from which it reads signals.
    has_signal_files: bool,
    /// Whether the program has created terminals, which may send signals.
    has_terminals: bool,
    /// The program's own terminals to which it has just written.
    typed: Vec<PathBuf>,
    /// Whether a queue or semaphore of System V may have changed.
    has_queues_changed: bool,
    /// Whether the program has opened a file that the supervisor answers.
    has_told_files: bool,
    /// Whether signals report events of files to the program, and these files, by process and
    /// number.
    hears_by_signal: bool,
    notices: BTreeMap<(i32, i32), Notice>,
    /// Sent signals above 31 about files: process, signal, and number of the file.
    sent_notices: Vec<(i32, i32, i32)>,
    /// Processes that were killed in place of a signal above 31, with that signal.
    fatal: BTreeMap<i32, i32>,
    /// Whether the program has chosen a network port for a socket.
    has_bound: bool,
    /// Named pipes that are being opened from both sides.
    meetings: Vec<Meeting>,
    /// Number of looks at clocks and of calls about ports without a stop, and stopped calls by
    /// their numbers.
    pub(super) looks: u64,
    pub(super) served: u64,
    pub(super) spent: BTreeMap<i64, u64>,
    /// Virtual time that has passed while a thread repeated the same request.
    pub(super) idled: Duration,
    watchdog: Watchdog,
    /// Whether the processor's counter is hidden from the supervisor. It is not if a part of the
    /// rig reads the wall clock: node programs have timeouts.
    pub(super) hides_counter: bool,
    pub(super) calls: Calls,
    notes: Vec<String>,
    /// The system's statuses of processes that have ended since the programs were asked to end.
    pub(super) last_ends: Vec<i32>,
    /// Place of the last fault.
    fault: Option<String>,
    pub(super) trouble: Option<GuestError>,
    /// The state of a debugger, if there is one.
    debugging: Option<Box<Debugging>>,
    /// Stops that may still come for a debugger that has left.
    left: Option<Left>,
    /// The thread that a debugger held when it left.
    held_over: Option<(i32, Next)>,
    /// An order of threads that differs from the order of their calls.
    schedule: Option<Schedule>,
    /// The time and bytes that are lent to the running thread.
    lease: Lease,
    /// The price of computing, if computing takes virtual time.
    computing: Option<Computing>,
    /// Counts calls and other signs that a thread does not wait in a loop.
    progress: u64,
    /// Threads that can run, but not before this time.
    late: Vec<(Instant, i32)>,
    /// Whether a thread has stopped in the code of its clocks, with counts that must stay there.
    keeps_loan: bool,
}

/// Begins to trace the launcher `root`, which stops by itself.
fn take_over(root: i32) -> Result<(), GuestError> {
    let root = Pid::from_raw(root);
    let status = wait(Some(root), WaitOptions::empty()).map(|(_, status)| status);
    if status.is_none_or(is_death) {
        return Err(GuestError::NotTraced);
    }
    ptrace::setoptions(root, options()).map_err(|_| GuestError::NotTraced)
}

/// The events of a program that stop it, in addition to its signals.
pub(super) const fn options() -> Options {
    Options::PTRACE_O_TRACESECCOMP
        .union(Options::PTRACE_O_TRACECLONE)
        .union(Options::PTRACE_O_TRACEFORK)
        .union(Options::PTRACE_O_TRACEVFORK)
        .union(Options::PTRACE_O_TRACEVFORKDONE)
        .union(Options::PTRACE_O_TRACEEXEC)
        .union(Options::PTRACE_O_TRACESYSGOOD)
        .union(Options::PTRACE_O_EXITKILL)
}

impl Supervisor {
    /// Supervises the launchers `roots`, which have just been started: one of each program.
    pub(super) fn new(
        roots: &[i32],
        stage: Stage,
        settings: Settings,
        computing: Option<Computing>,
        trace: Option<&Path>,
    ) -> Result<Self, GuestError> {
        roots.iter().try_for_each(|&root| take_over(root))?;
        let first = roots.first().copied().unwrap_or_default();
        let mut new = Self {
            hides_counter: stage.reads_no_clock(),
            calls: Calls::new(trace)?,
            stage,
            settings,
            roots: roots.iter().map(|&root| (root, None)).collect(),
            launchers: roots.iter().copied().collect(),
            threads: BTreeMap::new(),
            processes: BTreeMap::new(),
            queue: VecDeque::new(),
            early: BTreeSet::new(),
            born: [0; 2],
            blocks: 0,
            is_changed: false,
            ran: None,
            is_signalled: false,
            has_signal_files: false,
            has_terminals: false,
            typed: Vec::new(),
            has_queues_changed: false,
            has_told_files: false,
            hears_by_signal: false,
            notices: BTreeMap::new(),
            sent_notices: Vec::new(),
            fatal: BTreeMap::new(),
            has_bound: false,
            meetings: Vec::new(),
            looks: 0,
            served: 0,
            spent: BTreeMap::new(),
            idled: Duration::ZERO,
            watchdog: Watchdog::start(first, settings.supervision),
            notes: Vec::new(),
            last_ends: Vec::new(),
            fault: None,
            trouble: None,
            debugging: None,
            left: None,
            held_over: None,
            schedule: settings
                .supervision
                .schedule
                .map(|it| Schedule::new(it.seed(settings.seed))),
            lease: Lease::default(),
            computing,
            progress: 0,
            late: Vec::new(),
            keeps_loan: false,
        };
        for root in roots.iter().map(|&root| Pid::from_raw(root)) {
            new.add_thread(root, root, None);
        }
        Ok(new)
    }

    /// Notes about actions outside of virtual time, each once.
    pub(super) fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Whether the launcher `root` has become its program.
    pub(super) fn is_launched(&self, root: i32) -> bool {
        !self.launchers.contains(&root)
    }

    /// The system's status of a program's first process, if it has ended.
    pub(super) fn status(&self, root: i32) -> Option<i32> {
        self.roots.get(&root).copied().flatten()
    }

    /// Whether all programs have ended.
    pub(super) fn have_all_ended(&self) -> bool {
        self.roots.values().all(Option::is_some)
    }

    /// Kills all processes.
    pub(super) fn kill_all(&mut self) {
        for &pid in self.processes.keys() {
            if let Some(pid) = rustix::process::Pid::from_raw(pid) {
                let _ = rustix::process::kill_process(pid, rustix::process::Signal::KILL);
            }
        }
        while !self.processes.is_empty() {
            let Some((pid, status)) = wait(None, WaitOptions::empty()) else {
                break;
            };
            if is_death(status) {
                self.buried(pid, status);
            } else {
                let _ = ptrace::cont(Pid::from_raw(pid), None);
            }
        }
    }

    /// All living processes, without the first one of each program.
    pub(super) fn others(&self) -> impl Iterator<Item = i32> {
        let all = self.processes.keys().copied();
        all.filter(|pid| !self.roots.contains_key(pid))
    }

    /// A count that grows about every 50 ms of wall time.
    pub(super) fn beats(&self) -> u32 {
        self.watchdog.beats()
    }

    /// Whether any process is left.
    pub(super) fn is_anybody_there(&self) -> bool {
        !self.processes.is_empty()
    }

    /// Lets threads run until one has blocked or ended, or lets time pass until an event.
    ///
    /// # Errors
    /// If a real port went away, or the program cannot be supervised any more.
    pub(super) fn turn(&mut self) -> Result<(), GuestError> {
        self.watchdog.begin_turn(self.stage.now());
        let done = self.take_turn();
        self.watchdog.end_turn();
        done
    }

    fn take_turn(&mut self) -> Result<(), GuestError> {
        if let Some(stood) = self.watchdog.stood() {
            return Err(GuestError::Stands(self.last_calls(), stood));
        }
        if let Some((tid, next)) = self.take_held() {
            self.run_on(tid, next);
            return self.trouble.take().map_or(Ok(()), Err);
        }
        self.stage.carry()?;
        self.is_changed |= self.stage.take_delivered();
        self.tell_arrivals();
        self.settle_typed();
        if core::mem::take(&mut self.is_signalled) {
            self.is_changed |= self.has_signal_files;
            self.look_for_signals();
        }
        if self.queue.is_empty() {
            let ran = self.ran.take();
            if core::mem::take(&mut self.is_changed) {
                self.retry_files(None);
            } else if ran.is_some() {
                self.retry_files(ran);
            }
        }
        self.hear_outside();
        let Some(tid) = self.next_in_queue() else {
            return self.let_time_pass();
        };
        // A thread that runs may change what others wait for.
        self.is_changed |= self.ran.is_some_and(|other| other != tid);
        self.ran = Some(tid);
        self.run_thread(tid);
        self.trouble.take().map_or(Ok(()), Err)
    }

    fn let_time_pass(&mut self) -> Result<(), GuestError> {
        // A parent that waits for its vfork child waits in virtual time.
        let lends = |tid: i32| {
            let mut others = self.threads.values();
            others.any(|other| other.vfork_parent == Some(tid))
        };
        let is_out =
            |thread: &Thread| matches!(thread.state, State::Outside) && !lends(thread.tid.as_raw());
        if self.threads.values().any(is_out) {
            self.watchdog.pause(OUTSIDE);
            self.hear_outside();
            if !self.queue.is_empty() {
                return Ok(());
            }
        }
        let deadline = self.next_deadline();
        let watches = self.threads.values().any(Thread::watches_lines);
        self.stage.leap(deadline, watches)?;
        self.is_changed |= self.stage.take_delivered() || watches;
        self.expire();
        self.leapt_for_debugger();
        Ok(())
    }

    fn next_deadline(&self) -> Option<Instant> {
        let waits = self.threads.values().filter_map(Thread::deadline);
        let timers = self.processes.values().filter_map(Process::next_timer);
        waits.chain(timers).chain(self.next_late()).min()
    }

    /// Lets threads run whose deadlines have passed.
    fn expire(&mut self) {
        let now = self.stage.now();
        let mut due: Vec<(Instant, u64, i32)> = Vec::new();
        for thread in self.threads.values() {
            if let Some(deadline) = thread.deadline().filter(|&at| at <= now) {
                due.push((deadline, thread.blocked_at, thread.tid.as_raw()));
            }
        }
        due.sort_unstable();
        for (.., tid) in due {
            self.ready(tid, Next::Attempt);
        }
        self.end_delays();
        self.fire_timers(now);
    }

    /// Lets threads that wait for files try again, in the order in which they began to wait. `ran`
    /// is the only thread that has run since the last attempt, if nothing else happened: this
    /// thread does not try again if it waits only for ports.
    fn retry_files(&mut self, ran: Option<i32>) {
        let has_queues_changed = core::mem::take(&mut self.has_queues_changed);
        let waiting = self.threads.values().filter(|thread| {
            let is_settled = thread.waits_for_ports && ran == Some(thread.tid.as_raw());
            thread.waits_for_files() && !is_settled
                || has_queues_changed && thread.waits_for_queue()
        });
        let mut order: Vec<(u64, i32)> = waiting
            .map(|thread| (thread.blocked_at, thread.tid.as_raw()))
            .collect();
        order.sort_unstable();
        for (_, tid) in order {
            let blocked_at = self.threads.get(&tid).map(|thread| thread.blocked_at);
            if let Flow::Goes(_) = self.attempt(tid) {
                self.ready(tid, Next::Go(None));
            } else if let (Some(at), Some(thread)) = (blocked_at, self.threads.get_mut(&tid)) {
                thread.blocked_at = at;
            }
        }
    }

    /// Lets `tid` run when it is its turn.
    fn ready(&mut self, tid: i32, next: Next) {
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.state = State::Ready(next);
            self.queue.push_back(tid);
        }
    }

    fn set_state(&mut self, tid: i32, state: State) {
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.state = state;
        }
    }

    /// For messages: the last calls of the threads that do not wait in virtual time.
    fn last_calls(&self) -> String {
        let busy = self.threads.values().filter(|thread| !thread.is_blocked());
        let names: Vec<String> = busy
            .map(|thread| {
                let call = thread.outside.or(thread.call);
                let call =
                    call.map_or_else(|| "no call yet".to_owned(), |it| call::name(it.number));
                format!("thread {} at {call}", thread.index)
            })
            .collect();
        match names.is_empty() {
            true => "all threads wait".to_owned(),
            false => names.join(", "),
        }
    }

    /// Adds a note that something leaves virtual time, once.
    fn note(&mut self, what: String) {
        if !self.notes.contains(&what) {
            self.notes.push(what);
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
