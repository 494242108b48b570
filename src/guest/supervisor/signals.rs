//! Signals to threads that wait: the kernel holds them back until the thread goes on, so the
//! supervisor looks for them.

use nix::libc;
use nix::unistd::Pid;

use super::clocks::low_i32;
use super::{Memory, Next, Outcome, State, Supervisor};
use crate::guest::call::Call;

/// Bit of a handler that wants interrupted calls to be made again.
const SA_RESTART: u64 = 0x1000_0000;
/// Signals that do nothing unless somebody handles them: SIGCHLD, SIGCONT, SIGURG, SIGWINCH.
const MILD: u64 = 1 << 16 | 1 << 17 | 1 << 22 | 1 << 27;

impl Supervisor {
    /// Somebody sent a signal from outside.
    pub(in crate::guest) const fn expect_signals(&mut self) {
        self.is_signalled = true;
    }

    /// Interrupts the waits of threads that have a signal.
    pub(super) fn look_for_signals(&mut self) {
        let blocked = self
            .threads
            .values()
            .filter(|thread| matches!(thread.state, State::Blocked(_)));
        let blocked: Vec<(i32, i32)> = blocked
            .map(|thread| (thread.process, thread.tid.as_raw()))
            .collect();
        // One thread of a process takes a signal that is for all of it.
        let mut served = None;
        for (process, tid) in blocked {
            let [own, common] = pending(process, tid);
            let is_taken = served == Some(process);
            let signals = if is_taken { own } else { own | common };
            if signals != 0 {
                served = Some(process);
                self.interrupt(tid, signals);
            }
        }
    }

    fn interrupt(&mut self, tid: i32, signals: u64) {
        let Some(thread) = self.threads.get(&tid) else {
            return;
        };
        let Some(call) = thread.call else { return };
        let restarts = self
            .processes
            .get(&thread.process)
            .map_or(0, |it| it.restarts);
        let is_again = signals & !restarts == 0 && is_restarted(&call);
        let pid = Pid::from_raw(tid);
        let is_at_end = thread.is_at_end;
        self.set_at_end(tid, false);
        let _ = match (is_at_end, is_again) {
            (true, true) => Ok(()),
            (true, false) => Call::of(pid).and_then(|end| end.interrupted_at_end(pid)),
            (false, true) => call.again(pid),
            (false, false) => call.answer(pid, -i64::from(libc::EINTR)),
        };
        self.ready(tid, Next::Go(None));
    }

    /// Takes note of whether a handler wants calls to be made again.
    pub(super) fn sets_handler(&mut self, tid: i32, call: &Call) {
        let [signal, action, ..] = call.args;
        let Some(bit) = u32::try_from(low_i32(signal))
            .ok()
            .filter(|bit| (1..=64).contains(bit))
        else {
            return;
        };
        let flags = Memory(Pid::from_raw(tid)).u64(action.wrapping_add(8));
        let process = self.threads.get(&tid).map(|thread| thread.process);
        let process = process.and_then(|pid| self.processes.get_mut(&pid));
        if let (Some(process), Ok(flags), true) = (process, flags, action != 0) {
            let bit = 1 << (bit - 1);
            match flags & SA_RESTART {
                0 => process.restarts &= !bit,
                _ => process.restarts |= bit,
            }
        }
    }

    /// The thread itself ends; the first one of a process stays until all others have.
    pub(super) fn exits(&self, tid: i32) -> Outcome {
        let Some(thread) = self.threads.get(&tid) else {
            return Outcome::Kernel;
        };
        let process = thread.process;
        let others = self
            .threads
            .values()
            .filter(|other| other.process == process)
            .count();
        if tid != process || others <= 1 {
            return Outcome::Kernel;
        }
        Outcome::Leave(State::Ended)
    }
}

/// Whether an interrupted call of this kind is made again where the handler wants that: those that
/// are limited in time are not, see signal(7).
const fn is_restarted(call: &Call) -> bool {
    match call.number {
        libc::SYS_read
        | libc::SYS_readv
        | libc::SYS_write
        | libc::SYS_writev
        | libc::SYS_wait4
        | libc::SYS_waitid
        | libc::SYS_recvfrom
        | libc::SYS_recvmsg
        | libc::SYS_accept
        | libc::SYS_accept4
        | libc::SYS_ioctl => true,
        libc::SYS_futex => call.args[3] == 0,
        _ => false,
    }
}

/// The signals that wait for a thread and would do something: its own, and those for its process.
fn pending(process: i32, tid: i32) -> [u64; 2] {
    let path = format!("/proc/{process}/task/{tid}/status");
    let status = std::fs::read_to_string(path).unwrap_or_default();
    let mask = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        line.and_then(|text| u64::from_str_radix(text.trim(), 16).ok())
            .unwrap_or(0)
    };
    let quiet = mask("SigBlk:") | mask("SigIgn:") | (MILD & !mask("SigCgt:"));
    [mask("SigPnd:") & !quiet, mask("ShdPnd:") & !quiet]
}
