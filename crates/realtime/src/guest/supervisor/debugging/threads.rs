//! Threads of the debugged process: their registers, their signals, their activity.

use std::path::PathBuf;

use nix::libc;
use nix::sys::ptrace;
use nix::sys::ptrace::regset::NT_PRFPREG;
use nix::sys::signal::Signal;
use nix::unistd::Pid;

use crate::guest::call::{self, INSTRUCTION};
use crate::guest::supervisor::stops::thread_name;
use crate::guest::supervisor::{Next, State, Supervisor};

impl Supervisor {
    /// The threads of the debugged process in the order of birth, with their numbers.
    pub(in crate::guest) fn debugged_threads(&self) -> impl Iterator<Item = (u32, i32)> {
        let process = self.debugging.as_ref().and_then(|it| it.process);
        let own = self.threads.values().filter(move |thread| {
            Some(thread.process) == process && !matches!(thread.state, State::Ended)
        });
        own.map(|thread| (thread.index, thread.tid.as_raw()))
    }

    /// Number of threads that were born before this one.
    pub(in crate::guest) fn index_of(&self, tid: i32) -> Option<u32> {
        self.threads.get(&tid).map(|thread| thread.index)
    }

    /// The registers of a thread, with those for floating point if it has stopped. A thread in the
    /// kernel has the registers of its call.
    pub(in crate::guest) fn registers_of(
        &self,
        tid: i32,
    ) -> Option<(libc::user_regs_struct, Option<libc::user_fpregs_struct>)> {
        let pid = Pid::from_raw(tid);
        if let Ok(mut own) = ptrace::getregs(pid) {
            let held = self.debugging.as_ref().and_then(|it| it.held);
            if matches!(held, Some((held, Next::Begin)) if held == tid) {
                // For the user, the thread stands before the call that it has begun.
                own.rip -= INSTRUCTION;
                own.rax = own.orig_rax;
            }
            return Some((own, ptrace::getregset::<NT_PRFPREG>(pid).ok()));
        }
        let thread = self.threads.get(&tid)?;
        let call = thread.outside.or(thread.call)?;
        Some((call.registers(), None))
    }

    /// Sets the registers; returns `false` for a thread in a call whose end is not known yet.
    pub(in crate::guest) fn set_registers_of(
        &self,
        tid: i32,
        own: libc::user_regs_struct,
        float: Option<libc::user_fpregs_struct>,
    ) -> bool {
        let pid = Pid::from_raw(tid);
        let held = self.debugging.as_ref().and_then(|it| it.held);
        let state = self.threads.get(&tid).map(|thread| thread.state);
        let is_free = match (held, state) {
            (Some((held, next)), _) if held == tid => matches!(next, Next::Go(_)),
            (_, Some(State::Ready(next))) => matches!(next, Next::Go(_)),
            _ => false,
        };
        let float = float.map(|float| ptrace::setregset::<NT_PRFPREG>(pid, float).is_ok());
        is_free && float != Some(false) && ptrace::setregs(pid, own).is_ok()
    }

    /// Activity of a thread, as text for the user.
    pub(in crate::guest) fn doing_of(&self, tid: i32) -> String {
        let name = thread_name(tid);
        let held = self.debugging.as_ref().and_then(|it| it.held);
        let Some(thread) = self.threads.get(&tid) else {
            return name;
        };
        let call = thread.outside.or(thread.call);
        let call = call.map_or_else(|| "a call".to_owned(), |it| call::name(it.number));
        let doing = match (held, thread.state) {
            (Some((held, Next::Begin)), _) if held == tid => format!("begins {call}"),
            (Some((held, _)), _) if held == tid => "runs".to_owned(),
            (_, State::Blocked(wait)) => match wait.deadline {
                Some(at) => format!("waits in {call} until {at} s"),
                None => format!("waits in {call}"),
            },
            (_, State::Outside) => format!("outside of virtual time in {call}"),
            (_, State::Halted) => "stopped by a signal".to_owned(),
            _ => "can run".to_owned(),
        };
        format!("{name}: {doing}")
    }

    /// Sends a signal to a thread of the debugged process.
    pub(in crate::guest) fn send_signal(&mut self, tid: i32, signal: Option<Signal>) {
        let process = self.threads.get(&tid).map(|thread| thread.process);
        let (Some(process), Some(signal)) = (process, signal) else {
            return;
        };
        let _ = nix::sys::signal::kill(Pid::from_raw(process), signal);
        self.is_signalled = true;
    }

    /// The file of the debugged program.
    pub(in crate::guest) fn debugged_file(&self) -> Option<PathBuf> {
        let process = self.debugging.as_ref()?.process?;
        std::fs::read_link(format!("/proc/{process}/exe")).ok()
    }

    /// The auxiliary vector that the kernel passed to the program at its start.
    pub(in crate::guest) fn auxiliary_vector(&self) -> Option<Vec<u8>> {
        let process = self.debugging.as_ref()?.process?;
        std::fs::read(format!("/proc/{process}/auxv")).ok()
    }
}
