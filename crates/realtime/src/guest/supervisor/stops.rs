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

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use super::*;
    use crate::guest::supervisor::tests::Bench;
    use crate::guest::tests::Stopped;

    fn with(stopped: &Stopped) -> (Bench, i32) {
        let mut bench = Bench::new();
        let tid = stopped.pid.as_raw();
        bench.add(tid, tid, State::Running);
        (bench, tid)
    }

    /// A thread that computes (`inc eax; jmp -4`) for less than 10 s since its last call goes on;
    /// with 10 s the run ends.
    #[test]
    fn a_thread_computes_up_to_a_limit() {
        let stopped = Stopped::new();
        stopped.runs(&[0xFF, 0xC0, 0xEB, 0xFC]);
        let (mut bench, tid) = with(&stopped);
        let thread = bench.supervisor.threads.get_mut(&tid).expect("added");
        thread.computed = Duration::from_secs(8);
        let mut kicked = |millis| {
            let kick = Kick::Computes(Duration::from_millis(millis));
            bench.supervisor.watchdog.has_stopped(kick);
            assert!(matches!(bench.supervisor.kicked(tid), Flow::Stays));
            let computed = bench.supervisor.threads[&tid].computed;
            let is_held = bench.supervisor.held_over.take().is_some();
            (
                computed.as_millis(),
                is_held,
                bench.supervisor.trouble.take(),
            )
        };
        assert!(matches!(kicked(1_999), (9_999, true, None)));
        let Some(GuestError::Spins(name, time)) = kicked(1).2 else {
            panic!("it is the limit");
        };
        assert_eq!(name, format!("sleep ({tid})"));
        assert_eq!(time, Duration::from_secs(10));
        assert_eq!(bench.supervisor.queue, [tid]);
    }

    /// A thread that sleeps in the kernel is outside of virtual time; one that has left its call
    /// goes on.
    #[test]
    fn a_thread_that_sleeps_is_outside() {
        let stopped = Stopped::new();
        let (mut bench, tid) = with(&stopped);
        bench.supervisor.watchdog.has_stopped(Kick::Sleeps);
        assert!(matches!(bench.supervisor.kicked(tid), Flow::Stays));
        let thread = &bench.supervisor.threads[&tid];
        assert!(matches!(thread.state, State::Outside));
        let call = thread.outside.expect("its call").number;
        let name = call::name(call);
        let note = format!("waits in the kernel in {name}");
        assert!(["nanosleep", "clock_nanosleep"].contains(&&*name), "{name}");
        assert_eq!(bench.supervisor.notes(), [note]);
        let stopped = Stopped::new();
        stopped.runs(&[0x90; 8]);
        let (mut bench, tid) = with(&stopped);
        bench.supervisor.watchdog.has_stopped(Kick::Sleeps);
        assert!(matches!(bench.supervisor.kicked(tid), Flow::Goes(None)));
        assert!(bench.supervisor.notes().is_empty());
    }

    /// SIGCONT, 18, continues a process that a signal has stopped.
    #[test]
    fn a_halted_process_goes_on_by_its_signal() {
        let stopped = Stopped::new();
        let (mut bench, tid) = with(&stopped);
        bench.supervisor.set_state(tid, State::Halted);
        bench.supervisor.look_for_continuation();
        assert!(bench.supervisor.queue.is_empty());
        bench.supervisor.note_halted();
        let note = format!(
            "sleep ({tid}) was stopped by a signal (SIGSTOP or its like) and got no SIGCONT"
        );
        assert_eq!(bench.supervisor.notes(), [note]);
        nix::sys::signal::kill(stopped.pid, Signal::SIGCONT).expect("ours");
        bench.supervisor.set_state(tid, State::Running);
        bench.supervisor.look_for_continuation();
        assert!(bench.supervisor.queue.is_empty(), "it is not halted");
        bench.supervisor.set_state(tid, State::Halted);
        bench.supervisor.look_for_continuation();
        assert_eq!(bench.supervisor.queue, [tid]);
        let state = bench.supervisor.threads[&tid].state;
        assert!(matches!(state, State::Ready(Next::Go(None))));
    }
}
