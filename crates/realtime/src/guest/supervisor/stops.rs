//! Stops that are not calls: by the watchdog in wall time, or by a signal of the program.

use nix::libc;
use nix::sys::ptrace;
use nix::sys::signal::Signal;
use nix::unistd::Pid;

use super::{Flow, Next, State, Supervisor};
use crate::guest::GuestError;
use crate::guest::call::{self, Call};
use crate::guest::pending::Pending;
use crate::guest::watchdog::Kick;

impl Supervisor {
    /// Handles a SIGSTOP of the watchdog, or of the program.
    pub(super) fn kicked(&mut self, tid: i32) -> Flow {
        let pid = Pid::from_raw(tid);
        let Some(kick) = self.watchdog.take_kick() else {
            return self.stopped(tid, libc::SIGSTOP);
        };
        let call = Call::of(pid).ok().filter(|call| call.number >= 0);
        match (kick, call) {
            // The thread was found asleep, and has continued before the stop reached it.
            (Kick::Sleeps, None) => {
                self.stop_for_schedule(tid);
                Flow::Goes(None)
            }
            (Kick::Sleeps, Some(call)) => {
                self.note(format!(
                    "waits in the kernel in {}",
                    call::name(call.number)
                ));
                call.again_if_cut_short(pid);
                if let Some(thread) = self.threads.get_mut(&tid) {
                    thread.outside = Some(call);
                }
                self.keep_time(tid);
                let _ = ptrace::cont(pid, None);
                self.set_state(tid, State::Outside);
                Flow::Stays
            }
            (Kick::Computes(time), _) => {
                let limit = self.settings.supervision.spin_max;
                let thread = self.threads.get_mut(&tid);
                let computed = thread.map(|thread| {
                    thread.computed += time;
                    thread.computed
                });
                if let Some(computed) = computed.filter(|&computed| computed >= limit) {
                    self.trouble = Some(GuestError::Spins(thread_name(tid), computed));
                    self.ready(tid, Next::Go(None));
                    return Flow::Stays;
                }
                self.spins(tid)
            }
        }
    }

    /// Handles a thread that has stopped at a stop signal, or was stopped by one.
    pub(super) fn stopped(&mut self, tid: i32, signal: i32) -> Flow {
        // The kernel has no signal data for a process that is already stopped.
        if ptrace::getsiginfo(Pid::from_raw(tid)).is_ok() {
            return Flow::Goes(Signal::try_from(signal).ok());
        }
        self.set_state(tid, State::Halted);
        self.wake_parents();
        Flow::Stays
    }

    /// Lets stopped processes continue for which a continuing signal is pending.
    pub(super) fn look_for_continuation(&mut self) {
        let halted = self.threads.values();
        let halted = halted.filter(|thread| matches!(thread.state, State::Halted));
        let mut halted: Vec<(u32, i32, i32)> = halted
            .map(|thread| (thread.index, thread.process, thread.tid.as_raw()))
            .collect();
        halted.sort_unstable();
        for (_, process, tid) in halted {
            if Pending::of(process, tid).continues() {
                self.ready(tid, Next::Go(None));
                self.wake_parents();
            }
        }
    }

    /// Adds notes about the processes that a signal has stopped for good.
    pub(in crate::guest) fn note_halted(&mut self) {
        let halted = self.threads.values();
        let halted = halted.filter(|thread| matches!(thread.state, State::Halted));
        let names: Vec<String> = halted.map(|it| thread_name(it.process)).collect();
        for name in names {
            self.note(format!(
                "{name} was stopped by a signal (SIGSTOP or its like) and got no SIGCONT"
            ));
        }
    }
}

/// The name of a thread, as the system lists it.
pub(super) fn thread_name(tid: i32) -> String {
    let name = std::fs::read_to_string(format!("/proc/{tid}/comm")).unwrap_or_default();
    format!("{} ({tid})", name.trim())
}
