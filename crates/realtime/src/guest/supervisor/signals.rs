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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::{Bench, Told};
    use crate::guest::tests::{Room, Stopped};

    /// signal(7): which calls are made again after a handler with SA_RESTART; a futex without a
    /// time limit.
    #[test]
    fn calls_without_a_time_limit_are_made_again() {
        let is = |number, args: &[u64]| is_restarted(&Call::made(number, args));
        for number in [
            libc::SYS_read,
            libc::SYS_readv,
            libc::SYS_write,
            libc::SYS_writev,
            libc::SYS_wait4,
            libc::SYS_waitid,
            libc::SYS_recvfrom,
            libc::SYS_recvmsg,
            libc::SYS_accept,
            libc::SYS_accept4,
            libc::SYS_ioctl,
        ] {
            assert!(is(number, &[]), "{number}");
        }
        for number in [
            libc::SYS_poll,
            libc::SYS_nanosleep,
            libc::SYS_pause,
            libc::SYS_select,
        ] {
            assert!(!is(number, &[]), "{number}");
        }
        assert!(is(libc::SYS_futex, &[1, 2, 3, 0]) && !is(libc::SYS_futex, &[1, 2, 3, 4]));
    }

    /// The arguments that hold masks: sigsuspend(2), poll(2), epoll_wait(2), select(2), where it is
    /// in memory with its length.
    #[test]
    fn a_call_holds_signals_back_by_its_mask() {
        let tid = std::process::id().cast_signed();
        let mask = Room::of_words(&[0xABCD]);
        let at = mask.at(0);
        let pointer = Room::of_words(&[at, 8]);
        let of = |number, args: &[u64]| mask_of(tid, &Call::made(number, args));
        assert_eq!(of(libc::SYS_rt_sigsuspend, &[at]), Some(0xABCD));
        assert_eq!(of(libc::SYS_ppoll, &[9, 9, 9, at]), Some(0xABCD));
        assert_eq!(of(libc::SYS_ppoll, &[9, 9, 9, 0]), None);
        assert_eq!(of(libc::SYS_epoll_pwait, &[9, 9, 9, 9, at]), Some(0xABCD));
        assert_eq!(of(libc::SYS_epoll_pwait2, &[9, 9, 9, 9, at]), Some(0xABCD));
        let six = [9, 9, 9, 9, 9, pointer.at(0)];
        assert_eq!(of(libc::SYS_pselect6, &six), Some(0xABCD));
        assert_eq!(of(libc::SYS_pselect6, &[9, 9, 9, 9, 9, 0]), None);
        assert_eq!(of(libc::SYS_pselect6, &[9, 9, 9, 9, 9, 8]), None);
        assert_eq!(of(libc::SYS_select, &six), None);
        assert_eq!(of(libc::SYS_ppoll, &[9, 9, 9, 8]), None);
        let wants = |number| wanted(tid, &Call::made(number, &[at]));
        assert_eq!(wants(libc::SYS_rt_sigtimedwait), 0xABCD);
        assert_eq!(wants(libc::SYS_rt_sigsuspend), 0);
    }

    /// nanosleep(2) writes to its second argument, clock_nanosleep(2) to its fourth, unless its
    /// time is one of a clock.
    #[test]
    fn a_sleep_that_was_cut_short_says_the_rest() {
        let memory = Memory(crate::guest::tests::own());
        let room = Room::of_words(&[9, 9]);
        let left = Duration::new(3, 7);
        let tells = |number, args: &[u64]| {
            room.put(0, &[9_u64, 9].map(u64::to_ne_bytes).concat());
            tell_rest_of_sleep(memory, &Call::made(number, args), left);
            room.words() == [3, 7]
        };
        let at = room.at(0);
        assert!(tells(libc::SYS_nanosleep, &[0, at]));
        assert!(!tells(libc::SYS_nanosleep, &[at, 0]));
        assert!(tells(libc::SYS_clock_nanosleep, &[1, 0, 0, at]));
        assert!(tells(libc::SYS_clock_nanosleep, &[1, 2, 0, at]));
        assert!(!tells(libc::SYS_clock_nanosleep, &[1, 1, 0, at]));
        assert!(!tells(libc::SYS_clock_nanosleep, &[1, 0, 0, 0]));
        assert!(!tells(libc::SYS_pause, &[at, at, at, at]));
    }

    /// SA_RESTART is 0x10000000, in the second word of what the kernel gets (sigaction(2)).
    #[test]
    fn a_handler_may_want_calls_to_be_made_again() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let action = |flags: u64| Room::of_words(&[0x1000, flags, 0, 0]);
        let mut sets = |signal: u64, action: u64| {
            let call = Call::made(libc::SYS_rt_sigaction, &[signal, action, 0, 8]);
            bench.supervisor.sets_handler(tid, &call);
            bench.process().restarts
        };
        let (with, without) = (action(0x1000_0004), action(0x0400_0004));
        assert_eq!(sets(10, without.at(0)), 0);
        assert_eq!(sets(10, with.at(0)), 1 << 9);
        assert_eq!(sets(64, with.at(0)), 1 << 63 | 1 << 9);
        assert_eq!(sets(1, with.at(0)), 1 << 63 | 1 << 9 | 1);
        assert_eq!(sets(10, without.at(0)), 1 << 63 | 1);
        for signal in [0, 65, u64::MAX] {
            assert_eq!(sets(signal, with.at(0)), 1 << 63 | 1);
        }
        assert_eq!(sets(1, 0), 1 << 63 | 1, "it only asks");
        assert_eq!(sets(1, 8), 1 << 63 | 1);
    }

    /// The first thread of a process stays until all others have ended.
    #[test]
    fn the_first_thread_ends_last() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        assert_eq!(bench.calls(libc::SYS_exit, &[0]), Told::Kernel);
        bench.add(1_000_001, tid, State::Running);
        assert_eq!(bench.calls(libc::SYS_exit, &[0]), Told::Leaves);
        assert_eq!(Told::from(bench.supervisor.exits(1_000_001)), Told::Kernel);
        assert_eq!(Told::from(bench.supervisor.exits(-7)), Told::Kernel);
        let mut bench = Bench::new();
        bench.add(1_000_001, 1_000_001, State::Running);
        assert_eq!(
            bench.calls(libc::SYS_exit, &[0]),
            Told::Kernel,
            "of another process"
        );
    }

    /// kill(2), tgkill(2), pidfd_send_signal(2): the kernel does all but SIGKILL for others.
    #[test]
    fn most_signals_are_sent_by_the_kernel() {
        let mut bench = Bench::new();
        let own = u64::from(bench.tid.unsigned_abs());
        let term = 15;
        let kill = 9;
        for (number, args) in [
            (libc::SYS_kill, [1_000_001, term, 0, 0]),
            (libc::SYS_kill, [own, kill, 0, 0]),
            (libc::SYS_kill, [1_000_001, kill, 0, 0]),
            (libc::SYS_tgkill, [1_000_001, kill, 0, 0]),
            (libc::SYS_tkill, [1_000_001, kill, 0, 0]),
            (libc::SYS_pidfd_send_signal, [9_999, kill, 0, 0]),
            (libc::SYS_pidfd_send_signal, [9_999, kill, 0, 1]),
        ] {
            bench.supervisor.is_signalled = false;
            assert_eq!(
                bench.calls(number, &args),
                Told::Kernel,
                "{number} {args:?}"
            );
            assert!(bench.supervisor.is_signalled);
        }
    }

    /// A real process of the program, which is killed by its number or by its group.
    #[test]
    fn a_killed_process_is_gone_before_its_killer_goes_on() {
        let minus = |pid: i32| u64::from((-pid).cast_unsigned());
        for (number, by_group) in [(libc::SYS_kill, false), (libc::SYS_kill, true)] {
            let mut bench = Bench::new();
            let stopped = Stopped::in_group_of_its_own();
            let pid = stopped.pid.as_raw();
            bench.add(pid, pid, State::Blocked(Wait::for_ever()));
            let target = if by_group {
                minus(pid)
            } else {
                pid.unsigned_abs().into()
            };
            assert_eq!(bench.calls(number, &[target, 9]), Told::Answer(0));
            assert!(!bench.supervisor.processes.contains_key(&pid));
            assert!(!bench.supervisor.threads.contains_key(&pid));
        }
        let mut bench = Bench::new();
        let stopped = Stopped::in_group_of_its_own();
        let pid = stopped.pid.as_raw();
        bench.add(pid, pid, State::Blocked(Wait::for_ever()));
        let none = bench.calls(libc::SYS_kill, &[minus(pid + 1), 9]);
        assert_eq!(none, Told::Kernel, "another group");
        assert!(bench.supervisor.processes.contains_key(&pid));
    }

    /// The kernel lists a signal that waits; a thread that waits in a call is interrupted by it,
    /// and its call is made again where its handler wants that.
    #[test]
    fn a_signal_interrupts_a_wait() {
        let mut bench = Bench::new();
        let stopped = Stopped::new();
        let pid = stopped.pid.as_raw();
        let restarts = |it: &mut Bench, mask| {
            let process = it.supervisor.processes.get_mut(&pid);
            process.expect("added").restarts = mask;
        };
        let usr1 = 1 << 9;
        for (number, mask, answer, steps_back) in [
            (libc::SYS_read, 0, -4, 0),
            (libc::SYS_read, usr1, libc::SYS_read, 2),
            (libc::SYS_nanosleep, usr1, -4, 0),
        ] {
            bench.supervisor.threads.remove(&pid);
            bench.add(pid, pid, State::Blocked(Wait::for_ever()));
            restarts(&mut bench, mask);
            stopped.change(|registers| {
                registers.orig_rax = number.cast_unsigned();
                registers.rip = 0x1000;
                registers.rsi = 0;
            });
            let thread = bench.supervisor.threads.get_mut(&pid).expect("added");
            thread.call = Call::of(stopped.pid).ok();
            bench.supervisor.look_for_signals();
            assert!(bench.supervisor.queue.is_empty(), "there is none yet");
            bench.supervisor.interrupt(pid, usr1);
            let it = stopped.registers();
            assert_eq!(
                (it.rax.cast_signed(), it.rip),
                (answer, 0x1000 - steps_back)
            );
            assert_eq!(core::mem::take(&mut bench.supervisor.queue), [pid]);
        }
        let signal = nix::sys::signal::Signal::SIGUSR1;
        nix::sys::signal::kill(stopped.pid, signal).expect("it is ours");
        let thread = bench.supervisor.threads.get_mut(&pid).expect("added");
        thread.state = State::Blocked(Wait::for_ever());
        thread.progress = 5;
        bench.supervisor.look_for_signals();
        assert_eq!(bench.supervisor.queue, [pid]);
        assert_eq!(stopped.registers().rax, 5, "a part is written");
        // Pending for all of the process: sigsuspend without it goes on at once.
        let none = Room::of_words(&[0]);
        let call = Call::made(libc::SYS_rt_sigsuspend, &[none.at(0)]);
        assert!(!bench.supervisor.is_interrupted_at_once(bench.tid, &call));
        let [of_thread, of_process] = bench.supervisor.deliverable(pid, pid);
        assert_eq!([of_thread, of_process], [0, usr1]);
        let held = bench.supervisor.deliverable_beside(Some(usr1), pid, pid);
        assert_eq!(held, [0, 0]);
    }
}
