//! The loop: lets one thread run until it blocks, then the next; when all are blocked, time moves.

mod clocks;
mod crash;
mod death;
mod dispatch;
mod fifos;
mod files;
mod futex;
mod locks;
mod pipes;
mod polls;
mod ports;
mod posix_timers;
mod signal_files;
mod signals;
mod streams;
mod terminals;
mod timers;
mod waits;

use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;

use nix::errno::Errno;
use nix::libc;
use nix::sys::ptrace::{self, Options};
use nix::sys::signal::Signal;
use nix::unistd::Pid;
use protocols::Instant;
use rustix::event::PollFlags;
use rustix::process::WaitOptions;

use super::GuestError;
use super::call::Call;
use super::memory::Memory;
use super::news::{is_death, wait};
use super::stage::Stage;
use super::task::{Next, On, Process, State, Thread, Wait};
use super::trace::Calls;
use super::watchdog::Watchdog;
use crate::exec::Supervision;
use fifos::Meeting;

/// Calls that a thread makes in a row while others could run.
const SLICE: u32 = 1_000;
/// Wall time that a thread which waits outside of virtual time is given for each step of it.
const OUTSIDE: Duration = Duration::from_millis(1);

/// What becomes of a call.
pub(super) enum Outcome {
    /// The program gets this in place of what the kernel would say.
    Answer(i64),
    /// The kernel does it.
    Kernel,
    /// The thread waits.
    Block(Wait),
    /// The kernel does it, and nobody knows how long that takes; so long this is the state.
    Leave(State),
    /// As an answer, but whoever else can run is first.
    Yield(i64),
}

impl From<Errno> for Outcome {
    fn from(errno: Errno) -> Self {
        Self::Answer(-i64::from(errno as i32))
    }
}

/// Whether the running thread goes on.
enum Flow {
    /// With this signal, if any.
    Goes(Option<Signal>),
    Stays,
}

/// What is the same for a whole run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settings {
    /// Of all chance that the program asks the system for.
    pub(super) seed: u64,
    pub(super) supervision: Supervision,
}

/// All threads of a foreign program, and the stage on which they play.
pub(super) struct Supervisor {
    pub(super) stage: Stage,
    settings: Settings,
    root: Pid,
    threads: BTreeMap<i32, Thread>,
    processes: BTreeMap<i32, Process>,
    queue: VecDeque<i32>,
    /// First stops of threads of which nobody has told yet.
    early: BTreeSet<i32>,
    /// How many threads and processes there were.
    born: [u32; 2],
    blocks: u64,
    is_launched: bool,
    /// Something happened that files may have to do with.
    is_changed: bool,
    /// A signal may be on its way to a thread that waits.
    is_signalled: bool,
    /// The program has made files from which it reads signals.
    has_signal_files: bool,
    /// Named pipes that are being opened from both sides.
    meetings: Vec<Meeting>,
    watchdog: Watchdog,
    pub(super) calls: Calls,
    notes: Vec<String>,
    /// How the first process ended: the system's status.
    pub(super) root_status: Option<i32>,
    /// Where the last fault was.
    fault: Option<String>,
    pub(super) trouble: Option<GuestError>,
}

impl Supervisor {
    /// Supervises the launcher `root`, which has just been started.
    pub(super) fn new(
        root: i32,
        stage: Stage,
        settings: Settings,
        trace: Option<&Path>,
    ) -> Result<Self, GuestError> {
        let root = Pid::from_raw(root);
        let status = wait(Some(root), WaitOptions::empty()).map(|(_, status)| status);
        if status.is_none_or(is_death) {
            return Err(GuestError::NotTraced);
        }
        let options = Options::PTRACE_O_TRACESECCOMP
            | Options::PTRACE_O_TRACECLONE
            | Options::PTRACE_O_TRACEFORK
            | Options::PTRACE_O_TRACEVFORK
            | Options::PTRACE_O_TRACEVFORKDONE
            | Options::PTRACE_O_TRACEEXEC
            | Options::PTRACE_O_TRACESYSGOOD
            | Options::PTRACE_O_EXITKILL;
        ptrace::setoptions(root, options).map_err(|_| GuestError::NotTraced)?;
        let mut new = Self {
            calls: Calls::new(trace)?,
            stage,
            settings,
            root,
            threads: BTreeMap::new(),
            processes: BTreeMap::new(),
            queue: VecDeque::new(),
            early: BTreeSet::new(),
            born: [0; 2],
            blocks: 0,
            is_launched: false,
            is_changed: false,
            is_signalled: false,
            has_signal_files: false,
            meetings: Vec::new(),
            watchdog: Watchdog::start(),
            notes: Vec::new(),
            root_status: None,
            fault: None,
            trouble: None,
        };
        new.add_thread(root, root, None);
        Ok(new)
    }

    /// What left virtual time, each told once.
    pub(super) fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Whether the launcher has become the program.
    pub(super) const fn is_launched(&self) -> bool {
        self.is_launched
    }

    /// Kills all that is there.
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

    /// The processes that are there, the first one left out.
    pub(super) fn others(&self) -> impl Iterator<Item = i32> {
        let root = self.root.as_raw();
        self.processes
            .keys()
            .copied()
            .filter(move |&pid| pid != root)
    }

    /// Whether anybody is there.
    pub(super) fn is_anybody_there(&self) -> bool {
        !self.processes.is_empty()
    }

    /// Lets threads run until one has blocked or ended, or lets time pass until something happens.
    ///
    /// # Errors
    /// If a real port went away, or the program cannot be supervised any more.
    pub(super) fn turn(&mut self) -> Result<(), GuestError> {
        self.stage.carry()?;
        self.is_changed |= self.stage.take_delivered();
        if core::mem::take(&mut self.is_signalled) {
            self.is_changed |= self.has_signal_files;
            self.look_for_signals();
        }
        if self.queue.is_empty() && core::mem::take(&mut self.is_changed) {
            self.retry_files();
        }
        self.hear_outside();
        let Some(tid) = self.queue.pop_front() else {
            return self.let_time_pass();
        };
        self.is_changed = true;
        self.run_thread(tid);
        self.trouble.take().map_or(Ok(()), Err)
    }

    fn let_time_pass(&mut self) -> Result<(), GuestError> {
        // Whoever waits for the child that has its memory does so in virtual time.
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
        Ok(())
    }

    fn next_deadline(&self) -> Option<Instant> {
        let waits = self.threads.values().filter_map(Thread::deadline);
        let timers = self.processes.values().filter_map(Process::next_timer);
        waits.chain(timers).min()
    }

    /// Whose time has come may run.
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
        self.fire_timers(now);
    }

    /// Those who wait for files try once more, in the order in which they began to wait.
    fn retry_files(&mut self) {
        let waiting = self
            .threads
            .values()
            .filter(|thread| thread.waits_for_files());
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

    fn run_thread(&mut self, tid: i32) {
        let Some(thread) = self.threads.get_mut(&tid) else {
            return;
        };
        let State::Ready(next) = core::mem::replace(&mut thread.state, State::Running) else {
            return;
        };
        thread.slice = 0;
        let group = thread.process;
        self.watchdog.watch(tid, group);
        let mut current = tid;
        let mut flow = match next {
            Next::Go(signal) => Flow::Goes(signal),
            Next::Attempt => self.attempt(tid),
            Next::Stopped(status) => self.handle(tid, status),
        };
        while let Flow::Goes(signal) = flow {
            if ptrace::cont(Pid::from_raw(current), signal).is_err() {
                // It was killed meanwhile: the news of it come now.
                self.watchdog.count();
            }
            let Some((pid, status)) = self.wait_for(current) else {
                self.forget(current);
                break;
            };
            current = pid;
            self.watchdog.count();
            flow = self.handle(current, status);
        }
        self.watchdog.rest();
    }

    /// The next news of `tid`; of others it is noted. `None` if there is no such thread.
    fn wait_for(&mut self, tid: i32) -> Option<(i32, i32)> {
        loop {
            let (pid, status) = wait(None, WaitOptions::empty())?;
            let is_exec = status >> 16 == libc::PTRACE_EVENT_EXEC;
            if pid == tid || is_exec && self.same_process(pid, tid) {
                return Some((pid, status));
            }
            self.note_other(pid, status);
            // The end of another thread of its process may have been its own.
            self.threads.get(&tid)?;
        }
    }

    fn same_process(&self, one: i32, other: i32) -> bool {
        let process = |tid: i32| self.threads.get(&tid).map(|thread| thread.process);
        process(one).is_some() && process(one) == process(other)
    }

    /// News of a thread that nobody waits for just now.
    fn note_other(&mut self, pid: i32, status: i32) {
        let Some(thread) = self.threads.get(&pid) else {
            if !is_death(status) {
                self.early.insert(pid);
            }
            return;
        };
        if is_death(status) {
            self.died(pid, status);
        } else if matches!(thread.state, State::Outside) {
            self.ready(pid, Next::Stopped(status));
        }
    }

    /// Takes note of threads that come back into virtual time, without waiting.
    fn hear_outside(&mut self) {
        let is_out = |thread: &Thread| matches!(thread.state, State::Outside | State::Ended);
        if !self.threads.values().any(is_out) {
            return;
        }
        while let Some((pid, status)) = wait(None, WaitOptions::NOHANG) {
            self.note_other(pid, status);
        }
    }

    fn handle(&mut self, tid: i32, status: i32) -> Flow {
        if is_death(status) {
            self.died(tid, status);
            return Flow::Stays;
        }
        let signal = (status >> 8) & 0xFF;
        match status >> 16 {
            libc::PTRACE_EVENT_SECCOMP => self.called(tid),
            event @ (libc::PTRACE_EVENT_FORK
            | libc::PTRACE_EVENT_VFORK
            | libc::PTRACE_EVENT_CLONE) => self.cloned(tid, event),
            libc::PTRACE_EVENT_EXEC => self.execed(tid),
            0 if signal == libc::SIGSTOP => self.kicked(tid),
            0 if signal == libc::SIGSEGV && self.reads_counter(tid) => Flow::Goes(None),
            0 if signal & 0x80 == 0 => {
                if Signal::try_from(signal).is_err() {
                    self.note(format!("signal {signal} is not passed on"));
                }
                self.note_fault(tid, signal);
                Flow::Goes(Signal::try_from(signal).ok())
            }
            _ => Flow::Goes(None),
        }
    }

    fn called(&mut self, tid: i32) -> Flow {
        if !self.is_launched {
            return Flow::Goes(None);
        }
        let Ok(call) = Call::of(Pid::from_raw(tid)) else {
            return Flow::Goes(None);
        };
        if let Err(error) = self.stage.carry_touched() {
            self.trouble = Some(error.into());
        }
        if let Err(error) = self.stage.pass(self.settings.supervision.call_cost) {
            self.trouble = Some(error.into());
        }
        self.calls.count += 1;
        self.end_meeting(tid);
        let now = self.stage.now();
        let Some(thread) = self.threads.get_mut(&tid) else {
            return Flow::Goes(None);
        };
        thread.call = Some(call);
        thread.entered = now;
        thread.progress = 0;
        thread.lines_before = None;
        thread.opens = None;
        thread.is_woken = false;
        thread.slice += 1;
        let is_tired = thread.slice >= SLICE;
        let flow = self.attempt(tid);
        if !is_tired || matches!(flow, Flow::Stays) {
            return flow;
        }
        self.breathe(tid)
    }

    /// A thread that calls and calls lets others run now and then.
    fn breathe(&mut self, tid: i32) -> Flow {
        if let Err(error) = self.stage.carry() {
            self.trouble = Some(error.into());
        }
        self.expire();
        self.retry_files();
        self.ready(tid, Next::Go(None));
        Flow::Stays
    }

    /// Tries to do the call at which `tid` stands.
    fn attempt(&mut self, tid: i32) -> Flow {
        let Some(call) = self.threads.get(&tid).and_then(|thread| thread.call) else {
            return Flow::Goes(None);
        };
        let outcome = self.outcome(tid, &call);
        let pid = Pid::from_raw(tid);
        self.record(tid, &call, &outcome);
        match outcome {
            Outcome::Answer(result) => {
                let _ = call.answer(pid, result);
                Flow::Goes(None)
            }
            Outcome::Kernel => Flow::Goes(None),
            Outcome::Yield(result) => {
                let _ = call.answer(pid, result);
                self.ready(tid, Next::Go(None));
                Flow::Stays
            }
            Outcome::Leave(state) => {
                let _ = ptrace::cont(pid, None);
                self.set_state(tid, state);
                Flow::Stays
            }
            Outcome::Block(wait) => {
                self.blocks += 1;
                if let Some(thread) = self.threads.get_mut(&tid) {
                    thread.blocked_at = self.blocks;
                    thread.state = State::Blocked(wait);
                }
                Flow::Stays
            }
        }
    }

    fn set_state(&mut self, tid: i32, state: State) {
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.state = state;
        }
    }

    /// Says once that something leaves virtual time.
    fn note(&mut self, what: String) {
        if !self.notes.contains(&what) {
            self.notes.push(what);
        }
    }
}
