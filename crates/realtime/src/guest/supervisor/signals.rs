//! Signals to threads that wait. The kernel does not deliver them until the thread continues, so
//! the supervisor searches for them.

use core::time::Duration;

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;
use rustix::process::WaitOptions;

use super::clocks::{low_i32, timespec};
use super::files::told_of;
use super::futex::is_pi;
use super::{Memory, Next, On, Outcome, State, Supervisor, Wait, is_death, wait};
use crate::guest::call::Call;
use crate::guest::pending::Pending;

/// Flag of a handler that requests a restart of interrupted calls.
const SA_RESTART: u64 = 0x1000_0000;

impl Supervisor {
    /// Records that a process outside the supervision has sent a signal.
    pub(in crate::guest) const fn expect_signals(&mut self) {
        self.is_signalled = true;
    }

    /// Interrupts the waits of threads that have a signal.
    pub(super) fn look_for_signals(&mut self) {
        self.look_for_continuation();
        let blocked = self
            .threads
            .values()
            .filter(|thread| matches!(thread.state, State::Blocked(_)));
        // Sort by age, because thread numbers start again after the highest one.
        let mut blocked: Vec<(u32, i32, i32)> = blocked
            .map(|thread| (thread.index, thread.process, thread.tid.as_raw()))
            .collect();
        blocked.sort_unstable();
        // One thread of a process takes a signal for the whole process.
        let mut served = None;
        for (_, process, tid) in blocked {
            let pending = Pending::of(process, tid);
            if pending.is_killed {
                self.await_death(process);
                continue;
            }
            let call = self.threads.get(&tid).and_then(|thread| thread.call);
            let held = call.and_then(|call| mask_of(tid, &call));
            let [own, common] = self.deliverable_of(&pending, held, tid);
            let is_taken = served == Some(process);
            let signals = if is_taken { own } else { own | common };
            if signals != 0 {
                served = Some(process);
                self.interrupt(tid, signals);
            }
        }
    }

    /// The signals that end the wait of a thread: its own, and those for its process.
    fn deliverable(&self, process: i32, tid: i32) -> [u64; 2] {
        let call = self.threads.get(&tid).and_then(|thread| thread.call);
        let held = call.and_then(|call| mask_of(tid, &call));
        self.deliverable_beside(held, process, tid)
    }

    /// As [`deliverable`](Self::deliverable), while the signals in `held` are blocked; without
    /// `held`, those that the thread blocks.
    fn deliverable_beside(&self, held: Option<u64>, process: i32, tid: i32) -> [u64; 2] {
        self.deliverable_of(&Pending::of(process, tid), held, tid)
    }

    fn deliverable_of(&self, pending: &Pending, held: Option<u64>, tid: i32) -> [u64; 2] {
        let call = self.threads.get(&tid).and_then(|thread| thread.call);
        let quiet = pending.quiet(held.unwrap_or(pending.blocked));
        let wanted = call.map_or(0, |call| wanted(tid, &call));
        [pending.own, pending.common].map(|signals| signals & (!quiet | wanted))
    }

    /// Handles rt_sigsuspend and rt_sigtimedwait.
    pub(super) fn wait_for_signal(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let signals = wanted(tid, call);
        if let Some(outcome) = self.take_timer_signal(tid, call, signals)? {
            return Ok(outcome);
        }
        let process = self.threads.get(&tid).ok_or(Errno::ESRCH)?.process;
        let [own, common] = self.deliverable(process, tid);
        if own | common != 0 {
            if call.number == libc::SYS_rt_sigtimedwait {
                self.take_sent_signal(tid, call, (own | common) & signals);
            }
            return Ok(Outcome::Kernel);
        }
        let deadline = match (call.number, call.args[2]) {
            (libc::SYS_rt_sigtimedwait, timeout) => self.timespec_from(tid, timeout, 1)?,
            _ => None,
        };
        if deadline.is_some_and(|at| self.stage.now() >= at) {
            return Err(Errno::EAGAIN);
        }
        Ok(Outcome::Block(Wait {
            on: On::Others,
            deadline,
        }))
    }

    /// Whether a call with its own signal mask is interrupted at once by a pending signal.
    pub(super) fn is_interrupted_at_once(&self, tid: i32, call: &Call) -> bool {
        let process = self.threads.get(&tid).map(|thread| thread.process);
        let held = mask_of(tid, call);
        held.is_some()
            && process.is_some_and(|process| self.deliverable_beside(held, process, tid) != [0, 0])
    }

    /// Handles kill and similar calls. A killed process has ended before its killer continues.
    pub(super) fn kill(&mut self, tid: i32, call: &Call) -> Outcome {
        self.is_signalled = true;
        let [target, signal, ..] = call.args;
        let own = self.threads.get(&tid).map(|thread| thread.process);
        if low_i32(signal) != libc::SIGKILL || own.is_none() {
            return Outcome::Kernel;
        }
        let target = match (call.number, own) {
            (libc::SYS_kill, _) => low_i32(target),
            (libc::SYS_pidfd_send_signal, Some(own)) if low_i32(call.args[3]) == 0 => {
                let target = told_of(own, low_i32(target), "Pid");
                let target = target.and_then(|pid| pid.parse().ok());
                let Some(target) = target.filter(|&pid: &i32| pid > 0) else {
                    return Outcome::Kernel;
                };
                target
            }
            _ => return Outcome::Kernel,
        };
        let group = |pid: Option<i32>| {
            let pid = pid.and_then(rustix::process::Pid::from_raw);
            rustix::process::getpgid(pid).ok()
        };
        let aimed = match target {
            0 => group(own),
            target if target < -1 => {
                let group = target.checked_neg();
                group.and_then(rustix::process::Pid::from_raw)
            }
            _ => None,
        };
        let is_meant = |&pid: &i32| pid == target || aimed.is_some() && group(Some(pid)) == aimed;
        let meant: Vec<i32> = self.processes.keys().copied().filter(is_meant).collect();
        for &victim in meant.iter().filter(|&&pid| Some(pid) != own) {
            self.put_to_death(victim);
        }
        match meant.iter().all(|&pid| Some(pid) != own) && !meant.is_empty() {
            true => Outcome::Answer(0),
            false => Outcome::Kernel,
        }
    }

    fn put_to_death(&mut self, victim: i32) {
        let Some(pid) = rustix::process::Pid::from_raw(victim) else {
            return;
        };
        if rustix::process::kill_process(pid, rustix::process::Signal::KILL).is_ok() {
            self.await_death(victim);
        }
    }

    /// Waits until a process with SIGKILL has ended, before anything else happens.
    fn await_death(&mut self, victim: i32) {
        while self.processes.contains_key(&victim) {
            let Some((pid, status)) = wait(None, WaitOptions::empty()) else {
                return;
            };
            let is_victim = self.threads.get(&pid).map(|thread| thread.process) == Some(victim);
            match is_death(status) && is_victim {
                true => self.buried(pid, status),
                // The last action of the victim does not count any more.
                false if is_victim => {}
                false => self.note_other(pid, status),
            }
        }
        self.wake_after_death();
    }

    fn interrupt(&mut self, tid: i32, signals: u64) {
        let now = self.stage.now();
        let Some(thread) = self.threads.get(&tid) else {
            return;
        };
        let Some(call) = thread.call else { return };
        if mask_of(tid, &call).is_some() || wanted(tid, &call) & signals != 0 {
            // The kernel executes the call after all: it takes the signal, or lets it through.
            let next = match call.number {
                libc::SYS_rt_sigtimedwait => Next::Attempt,
                _ => Next::Go(None),
            };
            self.ready(tid, next);
            return;
        }
        let restarts = self
            .processes
            .get(&thread.process)
            .map_or(0, |it| it.restarts);
        let is_again = is_pi(&call) || signals & !restarts == 0 && is_restarted(&call);
        let pid = Pid::from_raw(tid);
        let left = thread.deadline().map_or(Duration::ZERO, |at| at - now);
        tell_rest_of_sleep(Memory(pid), &call, left);
        let is_at_end = thread.is_at_end;
        if thread.progress > 0 {
            // A part of the bytes was written.
            let done = i64::try_from(thread.progress).unwrap_or(i64::MAX);
            let _ = call.answer(pid, done);
            return self.ready(tid, Next::Go(None));
        }
        self.set_at_end(tid, false);
        let _ = match (is_at_end, is_again) {
            (true, true) => Ok(()),
            (true, false) => Call::of(pid).and_then(|end| end.interrupted_at_end(pid)),
            (false, true) => call.again(pid),
            (false, false) => call.answer(pid, -i64::from(libc::EINTR)),
        };
        self.ready(tid, Next::Go(None));
    }

    /// Stores whether a handler requests a restart of interrupted calls.
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

    /// Ends the thread; the first thread of a process stays until all others have ended.
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

/// Writes the remaining time of an interrupted sleep to memory, if the caller requests it.
fn tell_rest_of_sleep(memory: Memory, call: &Call, left: Duration) {
    let place = match call.number {
        libc::SYS_nanosleep => call.args[1],
        libc::SYS_clock_nanosleep if call.args[1] & 1 == 0 => call.args[3],
        _ => 0,
    };
    if place != 0 {
        let left = i64::try_from(left.as_nanos()).unwrap_or(i64::MAX);
        let _ = memory.write_pair(place, timespec(left));
    }
}

/// Whether an interrupted call of this kind is restarted if the handler requests it. Calls with a
/// timeout are not, see signal(7).
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

/// The signals that a call blocks while it waits, if it has its own mask.
fn mask_of(tid: i32, call: &Call) -> Option<u64> {
    let memory = Memory(Pid::from_raw(tid));
    let place = match call.number {
        libc::SYS_rt_sigsuspend => call.args[0],
        libc::SYS_ppoll => call.args[3],
        libc::SYS_epoll_pwait | libc::SYS_epoll_pwait2 => call.args[4],
        libc::SYS_pselect6 if call.args[5] != 0 => memory.u64(call.args[5]).ok()?,
        _ => 0,
    };
    (place != 0).then(|| memory.u64(place).ok()).flatten()
}

/// The signals that a call waits for.
fn wanted(tid: i32, call: &Call) -> u64 {
    match call.number {
        libc::SYS_rt_sigtimedwait => Memory(Pid::from_raw(tid)).u64(call.args[0]).unwrap_or(0),
        _ => 0,
    }
}
