//! The state of a debugger, and the stops of the program for it.
//!
//! A stop for the debugger holds the thread in the middle of its turn. Nothing else happens until
//! the thread continues, so the run is the same as without a debugger.

mod asked;
mod left;
mod memory;
mod threads;
mod watch;

use core::ops::Range;
use std::collections::{BTreeMap, BTreeSet};

use nix::libc;
use nix::sys::ptrace;
use nix::sys::signal::Signal;
use nix::unistd::Pid;
use protocols::Instant;
use rustix::process::WaitOptions;

use super::{Flow, Next, Supervisor, is_death, wait};
use crate::guest::call::hide_trap_flag;
use crate::guest::place::{Moment, Place};
use engine::run::Watch;
pub(super) use left::Left;
use memory::TRAP;
pub(in crate::guest) use memory::poke;
pub(in crate::guest) use watch::Watchpoint;
use watch::{hit_watch, write_watches};

/// The signal code of a trap by the `int3` instruction (`SI_KERNEL`).
const BY_INSTRUCTION: i32 = 0x80;
/// Programs that start others; the debugger waits for the started ones.
const STARTERS: [&str; 10] = [
    "sh", "dash", "bash", "busybox", "env", "nice", "timeout", "stdbuf", "setsid", "xargs",
];

/// Number of consecutive single steps after which a turn ends.
const IN_A_ROW: u32 = 2000;
/// Maximum number of names of started programs that are kept for a message.
const STARTED_MAX: usize = 12;
/// Maximum number of writes that are kept for the search of a failure.
const WRITES_MAX: usize = 4_000_000;

/// The reason why the program stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::guest) enum Stop {
    /// The program was just loaded.
    Loaded(i32),
    /// At a breakpoint of the debugger.
    Break(i32),
    /// Behind an instruction that touched watched memory at this address.
    Watch(i32, u64),
    /// Behind a single step.
    Step(i32),
    /// At a signal, which the thread has not received yet.
    Signal(i32, i32),
    /// The requested time or place was reached; with the thread, if it was about to make a call.
    Reached(Option<i32>),
    /// The process has ended with this status.
    Ended(i32),
}

/// Single steps of a thread until it leaves a range of code.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::guest) struct Step {
    pub(in crate::guest) tid: i32,
    /// The range; if empty, one instruction.
    pub(in crate::guest) within: Range<u64>,
}

/// The goal of the program's run.
#[derive(Clone, Debug)]
pub(in crate::guest) enum Goal {
    /// A rig time.
    Time(Instant),
    /// The start of a call, or the moment after a time step.
    Moment(Moment),
    /// A condition on the run.
    Condition(Box<Watch>),
}

/// Bytes that the program has written to a port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::guest) struct PortWrite {
    /// Time of arrival of the first byte, if no fault delays it.
    pub(in crate::guest) arrives: Instant,
    /// The node of the rig that receives the bytes.
    pub(in crate::guest) to: Option<usize>,
    /// Moment at the start of the call.
    pub(in crate::guest) moment: Moment,
}

/// The choice of the program to debug.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(in crate::guest) enum Wanted {
    /// No choice yet: it is searched for.
    #[default]
    Nothing,
    /// The first one whose file has this name.
    Name(String),
    /// The first one that is no shell.
    NoShell,
    /// The program with this number in the order of starts.
    Load(u32),
}

/// A debugger's view of the program.
#[derive(Debug, Default)]
pub(in crate::guest) struct Debugging {
    wanted: Wanted,
    /// Number of started programs, and the number of each process among them.
    loads: u32,
    load_of: BTreeMap<i32, u32>,
    /// Their file names, each once, the first ones only.
    started: Vec<String>,
    /// The number of the first program that used a port, in the order of starts.
    port_user: Option<u32>,
    /// The debugged process.
    pub(super) process: Option<i32>,
    /// Breakpoints with the bytes under them.
    breaks: BTreeMap<u64, u8>,
    /// Breakpoints in code that is not loaded yet.
    pending: BTreeSet<u64>,
    /// The bytes under all breakpoints that were ever set in this program.
    under: BTreeMap<u64, u8>,
    watches: Vec<Watchpoint>,
    /// Number of changes of the watchpoints, and the number up to which each thread has them.
    watch_changes: u32,
    watched_by: BTreeMap<i32, u32>,
    pub(super) step: Option<Step>,
    goal: Option<Goal>,
    pub(super) held: Option<(i32, Next)>,
    stop: Option<Stop>,
    /// The current place of the program, which any run finds again.
    pub(super) place: Place,
    /// Thread and end of the last single step.
    last_step: Option<(u32, Place)>,
    /// Number of single steps after which a thread stops at any place.
    steps_left: u64,
    /// Number of single steps since the session last checked for input of its debugger.
    in_a_row: u32,
    /// For each thread, the moment at which its current call began.
    begun: BTreeMap<i32, Moment>,
    /// Writes to ports, oldest first.
    writes: Vec<PortWrite>,
    /// Moment at which the last call of the debugged process began.
    last_call: Moment,
}

impl Supervisor {
    /// Prepares for a debugger of this program.
    pub(in crate::guest) fn begin_debugging(&mut self, wanted: Wanted) {
        self.debugging = Some(Box::new(Debugging {
            wanted,
            steps_left: u64::MAX,
            ..Debugging::default()
        }));
    }

    /// Removes all breakpoints and watchpoints, because the debugger has left.
    pub(in crate::guest) fn end_debugging(&mut self) {
        self.clear_breaks();
        let Some(mut debugging) = self.debugging.take() else {
            return;
        };
        debugging.watches.clear();
        debugging.watch_changes += 1;
        debugging.step = None;
        debugging.goal = None;
        debugging.stop = None;
        let held = debugging.held.take();
        self.debugging = Some(debugging);
        let threads: Vec<i32> = self.threads.keys().copied().collect();
        for tid in threads {
            self.put_watches(tid);
        }
        let debugging = self.debugging.take();
        if let Some(debugging) = &debugging {
            self.note_left(debugging);
        }
        if let Some((tid, next)) = held {
            // This thread continues before all others, as it would have without a stop.
            self.held_over = Some((tid, next));
        }
    }

    pub(in crate::guest) fn debugging(&mut self) -> Option<&mut Debugging> {
        self.debugging.as_deref_mut()
    }

    /// The reason why the program stands, if it does; reported once.
    pub(in crate::guest) fn take_stop(&mut self) -> Option<Stop> {
        self.debugging.as_mut()?.stop.take()
    }

    /// Whether a thread is held in the middle of its turn.
    pub(in crate::guest) fn is_held(&self) -> bool {
        self.debugging.as_ref().is_some_and(|it| it.held.is_some())
    }

    /// The held thread, which continues first.
    pub(super) fn take_held(&mut self) -> Option<(i32, Next)> {
        let held = self.held_over.take();
        held.or_else(|| self.debugging.as_mut()?.held.take())
    }

    pub(super) fn hold(&mut self, tid: i32, next: Next, stop: Stop) -> Flow {
        if let Some(debugging) = &mut self.debugging {
            debugging.held = Some((tid, next));
            debugging.stop = Some(stop);
        }
        Flow::Stays
    }

    /// Sets the signal with which the held thread continues; returns whether a signal is possible
    /// at this stop.
    pub(in crate::guest) fn set_held_signal(&mut self, tid: i32, signal: Option<Signal>) -> bool {
        let held = self.debugging.as_mut().and_then(|it| it.held.as_mut());
        match held {
            Some((held, Next::Go(next))) if *held == tid => {
                *next = signal;
                true
            }
            _ => signal.is_none(),
        }
    }

    /// Lets `tid` run to its next stop, as a single step if required.
    pub(super) fn resume(&mut self, tid: i32, signal: Option<Signal>) -> nix::Result<()> {
        let pid = Pid::from_raw(tid);
        let is_step = self.steps_by_schedule(tid);
        if self.debugging.is_none() {
            return match is_step {
                true => ptrace::step(pid, signal),
                false => ptrace::cont(pid, signal),
            };
        }
        self.put_watches(tid);
        let is_it = |it: &Step| it.tid == tid;
        let step = self.debugging.as_ref().and_then(|it| it.step.as_ref());
        match is_step || step.is_some_and(is_it) {
            true => ptrace::step(pid, signal),
            false => ptrace::cont(pid, signal),
        }
    }

    /// Handles a thread that has read the processor's counter, which replaced one instruction.
    pub(super) fn read_counter(&mut self, tid: i32) -> Flow {
        let index = self.index_of(tid).unwrap_or(0);
        let at = ptrace::getregs(Pid::from_raw(tid)).map_or(0, |it| it.rip);
        let flow = self.stepped(tid, index, at, Next::Go(None));
        flow.unwrap_or(Flow::Goes(None))
    }

    /// Handles a single step of a thread, if the thread runs in single steps.
    fn stepped(&mut self, tid: i32, index: u32, instruction: u64, next: Next) -> Option<Flow> {
        let debugging = self.debugging.as_mut()?;
        let step = debugging.step.as_ref().filter(|step| step.tid == tid)?;
        let is_within = step.within.contains(&instruction);
        self.watchdog.count_step();
        debugging.place.stepped(index);
        debugging.last_step = Some((index, debugging.place.clone()));
        debugging.steps_left = debugging.steps_left.saturating_sub(1);
        if debugging.steps_left == 0 || !is_within {
            return Some(self.hold(tid, next, Stop::Step(tid)));
        }
        debugging.in_a_row += 1;
        if debugging.in_a_row < IN_A_ROW {
            return Some(match next {
                Next::Lose => self.lose_processor(tid),
                _ => Flow::Goes(None),
            });
        }
        // The turn ends without a stop, so that the session can receive an interrupt.
        debugging.in_a_row = 0;
        debugging.held = Some((tid, next));
        Some(Flow::Stays)
    }

    /// Handles a process that has executed another program, which may be the one to debug.
    pub(super) fn execed_for_debugger(&mut self, tid: i32, flow: Flow) -> Flow {
        let Some(debugging) = &mut self.debugging else {
            return flow;
        };
        if debugging.process == Some(tid) {
            debugging.breaks.clear();
            debugging.pending.clear();
            debugging.under.clear();
            debugging.watches.clear();
            debugging.watched_by.clear();
            self.notes
                .push("the debugged process has become another program".to_owned());
            return flow;
        }
        let exe = std::fs::read_link(format!("/proc/{tid}/exe")).unwrap_or_default();
        let name = exe.file_name().unwrap_or_default().to_string_lossy();
        debugging.loads += 1;
        debugging.load_of.insert(tid, debugging.loads);
        if debugging.started.len() < STARTED_MAX && !debugging.started.iter().any(|it| *it == name)
        {
            debugging.started.push(name.clone().into_owned());
        }
        let is_it = match &debugging.wanted {
            Wanted::Nothing => false,
            Wanted::Name(wanted) => *wanted == name,
            Wanted::NoShell => !STARTERS.contains(&&*name),
            Wanted::Load(number) => *number == debugging.loads,
        };
        if debugging.process.is_some() || !is_it {
            return flow;
        }
        debugging.process = Some(tid);
        match flow {
            Flow::Goes(signal) => self.hold(tid, Next::Go(signal), Stop::Loaded(tid)),
            Flow::Stays => Flow::Stays,
        }
    }

    /// Records that a process uses a port for the first time.
    pub(super) fn uses_port_for_debugger(&mut self, process: i32) {
        if let Some(debugging) = &mut self.debugging {
            let load = debugging.load_of.get(&process).copied();
            debugging.port_user = debugging.port_user.or(load);
        }
    }

    /// Removes breakpoints from the memory of a child that a process has created by fork.
    pub(super) fn forked_for_debugger(&mut self, parent: i32, child: Pid) {
        let parent = self.threads.get(&parent).map(|thread| thread.process);
        let Some(debugging) = &mut self.debugging else {
            return;
        };
        let load = parent.and_then(|parent| debugging.load_of.get(&parent).copied());
        debugging
            .load_of
            .extend(load.map(|load| (child.as_raw(), load)));
        // Another process has memory of its own, without breakpoints.
        if debugging.process.is_none() || debugging.process != parent {
            return;
        }
        for (address, byte) in debugging.breaks.clone() {
            let _ = poke(child, address, &[byte]);
        }
    }

    pub(super) fn buried_for_debugger(&mut self, tid: i32, status: i32) {
        let Some(debugging) = &mut self.debugging else {
            return;
        };
        debugging.watched_by.remove(&tid);
        debugging.step.take_if(|step| step.tid == tid);
        debugging.held.take_if(|(held, _)| *held == tid);
        if debugging.process == Some(tid) {
            debugging.stop = Some(Stop::Ended(status));
            debugging.process = None;
            debugging.breaks.clear();
            debugging.pending.clear();
        }
    }

    /// Handles a thread that has stopped at SIGTRAP; `None` if this stop does not belong to the
    /// debugger.
    pub(super) fn trapped(&mut self, tid: i32) -> Option<Flow> {
        let pid = Pid::from_raw(tid);
        let (process, index) = self.threads.get(&tid).map(|it| (it.process, it.index))?;
        let mut registers = ptrace::getregs(pid).ok()?;
        let debugging = self.debugging.as_mut()?;
        let by_instruction =
            ptrace::getsiginfo(pid).is_ok_and(|info| info.si_code == BY_INSTRUCTION);
        let at = registers.rip.wrapping_sub(1);
        if by_instruction && let Some(&byte) = debugging.under.get(&at) {
            let is_set = debugging.breaks.contains_key(&at);
            registers.rip = at;
            ptrace::setregs(pid, registers).ok()?;
            if debugging.process != Some(process) || !is_set {
                return Some(self.pass_break(pid, at, byte, is_set));
            }
            debugging.place.hit(at);
            self.stop_for_schedule(tid);
            return Some(self.hold(tid, Next::Go(None), Stop::Break(tid)));
        }
        if debugging.process != Some(process) {
            return None;
        }
        let watches = debugging.watches.clone();
        if let Some(index) = hit_watch(pid, watches.len()) {
            let address = watches[index].address;
            debugging.place.touched(&watches);
            let next = self.step_for_schedule(tid);
            return Some(self.hold(tid, next, Stop::Watch(tid, address)));
        }
        let is_step = debugging.step.as_ref().is_some_and(|it| it.tid == tid);
        if by_instruction || !is_step {
            return None;
        }
        // A call without a stop leaves the address behind it in `rcx`.
        let has_called = registers.rcx == registers.rip;
        if has_called && hide_trap_flag(&mut registers) {
            ptrace::setregs(pid, registers).ok()?;
        }
        let next = self.step_for_schedule(tid);
        self.stepped(tid, index, registers.rip, next)
    }

    /// Lets a thread that is not debugged continue at a breakpoint as if there were none.
    fn pass_break(&mut self, pid: Pid, at: u64, byte: u8, is_set: bool) -> Flow {
        self.stop_for_schedule(pid.as_raw());
        if poke(pid, at, &[byte]).is_err() || !is_set {
            return Flow::Goes(None);
        }
        let stepped = ptrace::step(pid, None).ok();
        let status = stepped.and_then(|()| wait(Some(pid), WaitOptions::empty()));
        let _ = poke(pid, at, &[TRAP]);
        match status {
            Some((_, status)) if is_death(status) || status >> 8 != libc::SIGTRAP => {
                self.handle(pid.as_raw(), status)
            }
            _ => match self.step_for_schedule(pid.as_raw()) {
                Next::Lose => self.lose_processor(pid.as_raw()),
                _ => Flow::Goes(None),
            },
        }
    }

    /// Whether the debugger must be told first of a signal at which a debugged thread has stopped.
    pub(super) fn signalled_for_debugger(&mut self, tid: i32, signal: i32) -> Option<Flow> {
        let process = self.threads.get(&tid)?.process;
        let debugging = self.debugging.as_mut()?;
        if debugging.process != Some(process) {
            return None;
        }
        debugging.place.signalled();
        let next = Next::Go(Signal::try_from(signal).ok());
        Some(self.hold(tid, next, Stop::Signal(tid, signal)))
    }

    /// Whether the debugger's goal is reached by a thread that is about to make a call.
    pub(super) fn calls_for_debugger(&mut self, tid: i32) -> Option<Flow> {
        let process = self.threads.get(&tid).map(|thread| thread.process);
        self.add_pending_breaks();
        let debugging = self.debugging.as_mut()?;
        debugging.place.called();
        debugging.begun.insert(tid, debugging.place.moment);
        if debugging.process.is_some() && debugging.process == process {
            debugging.last_call = debugging.place.moment;
        }
        let has_come = debugging.has_come(&self.stage.run);
        has_come.then(|| self.hold(tid, Next::Begin, Stop::Reached(Some(tid))))
    }

    /// Checks in the same way after a time step.
    pub(super) fn leapt_for_debugger(&mut self) {
        let Some(debugging) = &mut self.debugging else {
            return;
        };
        debugging.place.leapt();
        if debugging.has_come(&self.stage.run) {
            debugging.stop = Some(Stop::Reached(None));
        }
    }

    /// Records that a thread is about to write bytes to a port.
    pub(super) fn writes_for_debugger(&mut self, tid: i32, port: usize) {
        if let Some(debugging) = &mut self.debugging
            && let Some(&moment) = debugging.begun.get(&tid)
            && debugging.writes.len() < WRITES_MAX
        {
            let (arrives, to) = self.stage.arrival_of_next(port);
            debugging.writes.push(PortWrite {
                arrives,
                to,
                moment,
            });
        }
    }

    /// Sets the watchpoints of a thread, if they have changed.
    fn put_watches(&mut self, tid: i32) {
        let process = self.threads.get(&tid).map(|thread| thread.process);
        let Some(debugging) = &mut self.debugging else {
            return;
        };
        let has = debugging.watched_by.get(&tid).copied().unwrap_or(0);
        if debugging.process != process || has == debugging.watch_changes {
            return;
        }
        debugging.watched_by.insert(tid, debugging.watch_changes);
        let _ = write_watches(Pid::from_raw(tid), &debugging.watches);
    }
}

#[cfg(test)]
mod tests;
