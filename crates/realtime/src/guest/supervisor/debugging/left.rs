//! Stops that may still come for a debugger that has left: of threads that were outside of virtual
//! time then, or whose stop was not handled yet.

use std::collections::{BTreeMap, BTreeSet};

use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;

use super::watch::write_watches;
use super::{BY_INSTRUCTION, Debugging};
use crate::guest::supervisor::{Flow, Next, State, Supervisor};

/// Signal codes of a single step and of a hit of a debug register (`TRAP_TRACE`, `TRAP_HWBKPT`).
const BY_STEP: i32 = 2;
const BY_WATCH: i32 = 4;

/// Former breakpoints, and the threads that have not stopped since.
#[derive(Debug)]
pub(in crate::guest::supervisor) struct Left {
    under: BTreeMap<u64, u8>,
    threads: BTreeSet<i32>,
}

impl Supervisor {
    /// Stores the threads that have not stopped since the debugger left.
    pub(super) fn note_left(&mut self, debugging: &Debugging) {
        let is_out =
            |state: State| matches!(state, State::Outside | State::Ready(Next::Stopped(_)));
        let own = self.threads.values();
        let own = own.filter(|it| Some(it.process) == debugging.process && is_out(it.state));
        let threads: BTreeSet<i32> = own.map(|it| it.tid.as_raw()).collect();
        self.left = (!threads.is_empty()).then(|| Left {
            under: debugging.under.clone(),
            threads,
        });
    }

    /// Whether the first stop of a thread since the debugger left belongs to the debugger: then the
    /// program does not get it.
    pub(in crate::guest::supervisor) fn stops_for_left(&mut self, tid: i32) -> Option<Flow> {
        let left = self.left.as_mut()?;
        if !left.threads.remove(&tid) {
            return None;
        }
        let pid = Pid::from_raw(tid);
        let _ = write_watches(pid, &[]);
        let info = ptrace::getsiginfo(pid).ok();
        let info = info.filter(|it| it.si_signo == libc::SIGTRAP)?;
        let mut registers = ptrace::getregs(pid).ok()?;
        let at = registers.rip.wrapping_sub(1);
        match info.si_code {
            BY_INSTRUCTION if left.under.contains_key(&at) => {
                registers.rip = at;
                ptrace::setregs(pid, registers).ok()?;
                Some(Flow::Goes(None))
            }
            BY_STEP | BY_WATCH => Some(Flow::Goes(None)),
            _ => None,
        }
    }
}
