//! Runs one thread at a time, up to its next stop. After the stop was handled, the thread continues
//! or waits.

use core::time::Duration;

use nix::libc;
use nix::sys::ptrace;
use nix::sys::signal::Signal;
use nix::unistd::Pid;
use rustix::process::WaitOptions;

use super::{Flow, Next, Outcome, SLICE, State, Supervisor, Thread, is_death, wait};
use crate::clock::counter::Hidden;
use crate::guest::call::Call;
use crate::guest::launch;
use crate::guest::news::is_stop;

impl Supervisor {
    pub(super) fn run_thread(&mut self, tid: i32) {
        let Some(thread) = self.threads.get_mut(&tid) else {
            return;
        };
        let State::Ready(next) = core::mem::replace(&mut thread.state, State::Running) else {
            return;
        };
        thread.slice = 0;
        self.run_on(tid, next);
    }

    /// Runs the thread whose turn it is, up to the end of that turn.
    pub(super) fn run_on(&mut self, tid: i32, next: Next) {
        let Some(thread) = self.threads.get(&tid) else {
            return;
        };
        self.watchdog.watch(tid, thread.process);
        let mut current = tid;
        let may_have_signal = match next {
            Next::Attempt | Next::Charged => true,
            Next::Call => self.schedule.is_some(),
            _ => false,
        };
        let mut flow = match next {
            Next::Go(None) if thread.loop_length.is_some() => self.go_on_in_loop(tid),
            Next::Go(signal) => Flow::Goes(signal),
            Next::Attempt => self.attempt(tid),
            Next::Begin => self.begin_call(tid),
            Next::Call => self.make_call(tid),
            Next::Charged => self.begin_late(tid),
            Next::Lose => self.lose_processor(tid),
            Next::Stopped(status) => self.handle(tid, status),
        };
        // A signal that arrived since the thread became ready has interrupted no wait; the next
        // turn checks again.
        self.is_signalled |= may_have_signal && matches!(flow, Flow::Stays);
        let hides_counter = self.hides_counter && matches!(flow, Flow::Goes(_));
        let _hidden = hides_counter.then(Hidden::begin);
        while let Flow::Goes(signal) = flow {
            if !core::mem::take(&mut self.keeps_loan) {
                self.make_detour(current);
                self.lend_time(current);
            }
            let computed = self.processor_time_of(current);
            if self.resume(current, signal).is_err() {
                // The thread was killed meanwhile, and this event is reported now.
                self.watchdog.count();
            }
            let Some((pid, status)) = self.wait_for(current) else {
                self.forget(current);
                break;
            };
            current = pid;
            self.watchdog.count();
            self.has_computed(current, computed);
            // An exec has replaced the memory; its clocks were read at the call itself.
            self.keeps_loan = self.stands_in_clocks(current, status);
            if status >> 16 != libc::PTRACE_EVENT_EXEC && !self.keeps_loan {
                self.take_time(current);
            }
            flow = self.handle(current, status);
            if let Flow::Goes(signal) = flow
                && self.lease.take_has_waited()
            {
                // The thread waited without a stop. With a stop, its turn would have ended here.
                self.held_over = Some((current, Next::Go(signal)));
                break;
            }
        }
        self.watchdog.rest();
    }

    /// The next event of `tid`; events of other threads are recorded. `None` if there is no such
    /// thread.
    pub(super) fn wait_for(&mut self, tid: i32) -> Option<(i32, i32)> {
        loop {
            let (pid, status) = wait(None, WaitOptions::empty())?;
            let is_exec = status >> 16 == libc::PTRACE_EVENT_EXEC;
            if pid == tid || is_exec && self.same_process(pid, tid) {
                return Some((pid, status));
            }
            self.note_other(pid, status);
            // The end of another thread may have ended this whole process.
            self.threads.get(&tid)?;
        }
    }

    pub(super) fn same_process(&self, one: i32, other: i32) -> bool {
        let process = |tid: i32| self.threads.get(&tid).map(|thread| thread.process);
        process(one).is_some() && process(one) == process(other)
    }

    /// Records an event of a thread for which the supervisor does not wait now.
    pub(super) fn note_other(&mut self, pid: i32, status: i32) {
        let Some(thread) = self.threads.get(&pid) else {
            if !is_death(status) {
                self.early.insert(pid);
            }
            return;
        };
        if is_death(status) {
            self.died(pid, status);
        } else if matches!(thread.state, State::Outside) {
            // Our own stop has cut its call short, and the kernel makes the call again.
            let is_same = |one: &Call| Call::of(Pid::from_raw(pid)).is_ok_and(|it| it.is_like(one));
            if status >> 16 == libc::PTRACE_EVENT_SECCOMP
                && thread.outside.is_some_and(|it| is_same(&it))
            {
                let _ = ptrace::cont(Pid::from_raw(pid), None);
                return;
            }
            self.ready(pid, Next::Stopped(status));
        }
    }

    /// Records threads that return to virtual time, without waiting.
    pub(super) fn hear_outside(&mut self) {
        let is_out =
            |thread: &Thread| matches!(thread.state, State::Outside | State::Ended | State::Halted);
        if !self.threads.values().any(is_out) {
            return;
        }
        self.stage.stir();
        while let Some((pid, status)) = wait(None, WaitOptions::NOHANG) {
            self.note_other(pid, status);
        }
    }

    pub(super) fn handle(&mut self, tid: i32, status: i32) -> Flow {
        if status >> 16 != libc::PTRACE_EVENT_SECCOMP {
            self.stage.stir();
        }
        if is_death(status) {
            self.died(tid, status);
            return Flow::Stays;
        }
        if let Some(flow) = self.stops_for_left(tid) {
            return flow;
        }
        let signal = (status >> 8) & 0xFF;
        match status >> 16 {
            libc::PTRACE_EVENT_SECCOMP => self.called(tid),
            event @ (libc::PTRACE_EVENT_FORK
            | libc::PTRACE_EVENT_VFORK
            | libc::PTRACE_EVENT_CLONE) => self.cloned(tid, event),
            libc::PTRACE_EVENT_EXEC => self.execed(tid),
            0 if signal == libc::SIGSTOP => self.kicked(tid),
            0 if is_stop(signal) => self.stopped(tid, signal),
            0 if signal == libc::SIGSEGV && self.reads_counter(tid) => self.read_counter(tid),
            0 if is_fault(signal) && self.gives_up(tid) => Flow::Goes(None),
            0 if signal & 0x80 == 0 => {
                if signal == libc::SIGTRAP
                    && let Some(flow) = self.trapped(tid).or_else(|| self.stepped_by_schedule(tid))
                {
                    return flow;
                }
                self.note_fault(tid, signal);
                let is_plain = Signal::try_from(signal).is_ok();
                let held = is_plain.then(|| self.signalled_for_debugger(tid, signal));
                if let Some(flow) = held.flatten() {
                    return flow;
                }
                match Signal::try_from(signal) {
                    Ok(signal) => Flow::Goes(Some(signal)),
                    Err(_) => self.high_signal(tid, signal),
                }
            }
            _ => Flow::Goes(None),
        }
    }

    pub(super) fn called(&mut self, tid: i32) -> Flow {
        if !self.is_launched(tid) {
            return Flow::Goes(None);
        }
        let Ok(mut call) = Call::of(Pid::from_raw(tid)) else {
            return Flow::Goes(None);
        };
        if self.debugging.is_some() || self.schedule.is_some() {
            call.hide_step(Pid::from_raw(tid));
        }
        if !self.is_known_site(tid, &call) {
            if ptrace::getevent(Pid::from_raw(tid)) == Ok(launch::OTHER_ARCHITECTURE.into()) {
                self.stage.stir();
                self.note("makes calls as a 32-bit program does (int 0x80)".to_owned());
                self.lets_all_go();
                return Flow::Goes(None);
            }
            self.learn_site(tid, &call);
        }
        if !leaves_ports_alone(&call) {
            self.stage.stir();
        }
        if self.is_for_free(tid, &call) {
            return Flow::Goes(None);
        }
        if let Err(error) = self.stage.carry_touched() {
            self.trouble = Some(error.into());
        }
        if let Err(error) = self.stage.pass(self.settings.supervision.call_cost) {
            self.trouble = Some(error.into());
        }
        self.tell_arrivals();
        self.calls.count += 1;
        self.end_meeting(tid);
        let now = self.stage.now();
        let Some(thread) = self.threads.get_mut(&tid) else {
            return Flow::Goes(None);
        };
        thread.call = Some(call);
        thread.outside = None;
        thread.is_at_end = false;
        thread.computed = Duration::ZERO;
        thread.loop_length = None;
        self.progress += 1;
        thread.entered = now;
        thread.progress = 0;
        thread.lines_before = None;
        thread.opens = None;
        thread.is_woken = false;
        thread.watched.clear();
        thread.waits_for_ports = false;
        thread.asks_port = false;
        thread.slice += 1;
        *self.spent.entry(call.number).or_default() += 1;
        match self.calls_for_debugger(tid) {
            Some(flow) => flow,
            None => self.begin_call(tid),
        }
    }

    /// Handles a thread that has begun a call: it continues with the call, unless other threads run
    /// first.
    fn begin_call(&mut self, tid: i32) -> Flow {
        let flow = self.charge_computing(tid);
        match flow.or_else(|| self.call_by_schedule(tid)) {
            Some(flow) => flow,
            None => self.make_call(tid),
        }
    }

    /// Continues this after the thread's computing before the call has passed.
    fn begin_late(&mut self, tid: i32) -> Flow {
        let now = self.stage.now();
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.entered = now;
        }
        match self.call_by_schedule(tid) {
            Some(flow) => flow,
            None => self.make_call(tid),
        }
    }

    /// Executes the rest of a call that a thread has begun.
    fn make_call(&mut self, tid: i32) -> Flow {
        let Some(thread) = self.threads.get(&tid) else {
            return Flow::Stays;
        };
        let Some(call) = thread.call else {
            return Flow::Goes(None);
        };
        let is_tired = thread.slice >= SLICE;
        if let Some(flow) = self.idle_away(tid, &call) {
            return flow;
        }
        let flow = self.attempt(tid);
        if !is_tired || matches!(flow, Flow::Stays) {
            return flow;
        }
        self.breathe(tid)
    }

    /// Whether `tid` has already made a 64-bit call at this instruction.
    fn is_known_site(&self, tid: i32, call: &Call) -> bool {
        let process = self.threads.get(&tid).map(|thread| thread.process);
        let process = process.and_then(|pid| self.processes.get(&pid));
        process.is_some_and(|it| it.sites.contains(&call.instruction()))
    }

    fn learn_site(&mut self, tid: i32, call: &Call) {
        let process = self.threads.get(&tid).map(|thread| thread.process);
        if let Some(process) = process.and_then(|pid| self.processes.get_mut(&pid)) {
            process.sites.insert(call.instruction());
        }
    }

    /// Lets other threads run from time to time if a thread makes many calls in a row.
    pub(super) fn breathe(&mut self, tid: i32) -> Flow {
        if let Err(error) = self.stage.carry() {
            self.trouble = Some(error.into());
        }
        // The kernel executes the call after this.
        self.stage.stir();
        self.expire();
        self.retry_files(None);
        self.ready(tid, Next::Go(None));
        Flow::Stays
    }

    /// Tries to execute the current call of `tid`.
    pub(super) fn attempt(&mut self, tid: i32) -> Flow {
        let Some(call) = self.threads.get(&tid).and_then(|thread| thread.call) else {
            return Flow::Goes(None);
        };
        let outcome = self.outcome(tid, &call);
        let pid = Pid::from_raw(tid);
        self.record(tid, &call, &outcome);
        self.note_idle(tid, &call, &outcome);
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
                self.keep_time(tid);
                let _ = ptrace::cont(pid, None);
                self.set_state(tid, state);
                Flow::Stays
            }
            Outcome::Block(wait) => {
                self.stage.end_fruitless();
                self.blocks += 1;
                if let Some(thread) = self.threads.get_mut(&tid) {
                    thread.blocked_at = self.blocks;
                    thread.state = State::Blocked(wait);
                }
                Flow::Stays
            }
        }
    }
}

/// Whether a signal reports an access to invalid memory.
const fn is_fault(signal: i32) -> bool {
    matches!(signal, libc::SIGSEGV | libc::SIGBUS)
}

/// Whether a call changes no port, except that it may take received bytes.
const fn leaves_ports_alone(call: &Call) -> bool {
    matches!(
        call.number,
        libc::SYS_clock_gettime
            | libc::SYS_clock_getres
            | libc::SYS_gettimeofday
            | libc::SYS_time
            | libc::SYS_times
            | libc::SYS_nanosleep
            | libc::SYS_clock_nanosleep
            | libc::SYS_sched_yield
            | libc::SYS_futex
            | libc::SYS_getrandom
            | libc::SYS_read
            | libc::SYS_readv
            | libc::SYS_recvfrom
            | libc::SYS_recvmsg
            | libc::SYS_poll
            | libc::SYS_ppoll
            | libc::SYS_select
            | libc::SYS_pselect6
            | libc::SYS_epoll_wait
            | libc::SYS_epoll_pwait
            | libc::SYS_epoll_pwait2
    ) || matches!(call.number, libc::SYS_ioctl) && matches!(call.args[1], libc::FIONREAD)
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::guest::supervisor::Wanted;
    use crate::guest::supervisor::schedule::Schedule;
    use crate::guest::supervisor::tests::{Bench, is_ready};
    use crate::guest::tests::Stopped;

    /// SIGSEGV is 11, SIGBUS 7.
    #[test]
    fn a_fault_comes_of_memory() {
        for signal in 1..32 {
            assert_eq!(is_fault(signal), [7, 11].contains(&signal), "{signal}");
        }
    }

    #[test]
    fn calls_that_only_look_leave_ports_alone() {
        let leaves = |number, args: &[u64]| leaves_ports_alone(&Call::made(number, args));
        for number in [
            libc::SYS_clock_gettime,
            libc::SYS_nanosleep,
            libc::SYS_futex,
            libc::SYS_read,
            libc::SYS_recvmsg,
            libc::SYS_poll,
            libc::SYS_pselect6,
            libc::SYS_epoll_pwait2,
        ] {
            assert!(leaves(number, &[]), "{number}");
        }
        for number in [
            libc::SYS_write,
            libc::SYS_openat,
            libc::SYS_close,
            libc::SYS_ioctl,
        ] {
            assert!(!leaves(number, &[]), "{number}");
        }
        assert!(leaves(libc::SYS_ioctl, &[3, libc::FIONREAD]));
        assert!(!leaves(libc::SYS_read, &[]) || !leaves(libc::SYS_ioctl, &[3, libc::TCFLSH]));
        assert!(!leaves(libc::SYS_write, &[3, libc::FIONREAD]));
    }

    /// A call that is answered, one that waits, one that lets others go first.
    #[test]
    fn a_thread_goes_on_or_stays_by_what_becomes_of_its_call() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let attempt = |bench: &mut Bench, number, args: &[u64]| {
            bench.begins(number, args);
            bench.supervisor.attempt(tid)
        };
        assert!(matches!(
            attempt(&mut bench, libc::SYS_clock_getres, &[1, 0]),
            Flow::Goes(None)
        ));
        assert!(matches!(
            attempt(&mut bench, libc::SYS_getpid, &[]),
            Flow::Goes(None)
        ));
        assert!(bench.supervisor.queue.is_empty());
        assert!(matches!(
            attempt(&mut bench, libc::SYS_sched_yield, &[]),
            Flow::Stays
        ));
        assert_eq!(core::mem::take(&mut bench.supervisor.queue), [tid]);
        assert!(matches!(bench.thread().state, State::Ready(Next::Go(None))));
        for count in 1..3 {
            assert!(matches!(
                attempt(&mut bench, libc::SYS_pause, &[]),
                Flow::Stays
            ));
            assert!(bench.thread().is_blocked());
            assert_eq!(
                (bench.thread().blocked_at, bench.supervisor.blocks),
                (count, count)
            );
        }
        bench.add(1_000_001, tid, State::Running);
        assert!(matches!(
            attempt(&mut bench, libc::SYS_exit, &[0]),
            Flow::Stays
        ));
        assert!(matches!(bench.thread().state, State::Ended));
        bench.thread().call = None;
        assert!(matches!(bench.supervisor.attempt(tid), Flow::Goes(None)));
        assert!(matches!(bench.supervisor.attempt(-7), Flow::Goes(None)));
        assert!(matches!(bench.supervisor.make_call(-7), Flow::Stays));
        assert!(matches!(bench.supervisor.make_call(tid), Flow::Goes(None)));
    }

    /// After 1,000 calls in a row others have their turn.
    #[test]
    fn a_thread_that_calls_and_calls_lets_others_run() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        for (slice, expected) in [(999, false), (1_000, true), (1_001, true)] {
            bench.begins(libc::SYS_clock_getres, &[1, 0]);
            bench.thread().slice = slice;
            let stays = matches!(bench.supervisor.make_call(tid), Flow::Stays);
            assert_eq!(stays, expected, "{slice}");
            let queue = core::mem::take(&mut bench.supervisor.queue);
            assert_eq!(queue.contains(&tid), expected);
        }
        bench.begins(libc::SYS_pause, &[]);
        bench.thread().slice = 1_000;
        assert!(matches!(bench.supervisor.make_call(tid), Flow::Stays));
        assert!(bench.supervisor.queue.is_empty() && bench.thread().is_blocked());
        // What is late enters its call then.
        bench.passes(5);
        bench.begins(libc::SYS_clock_getres, &[1, 0]);
        bench.thread().slice = 0;
        bench.thread().entered = protocols::Instant::ZERO;
        assert!(matches!(bench.supervisor.begin_late(tid), Flow::Goes(None)));
        assert_eq!(bench.thread().entered, protocols::Instant::from_millis(5));
    }

    #[test]
    fn news_of_other_threads_are_noted() {
        let mut bench = Bench::new();
        let own = bench.tid;
        bench.supervisor.note_other(1_000_001, 0x137F);
        assert!(bench.supervisor.early.contains(&1_000_001));
        bench.supervisor.note_other(1_000_002, 9);
        assert_eq!(bench.supervisor.early.len(), 1, "it is dead");
        bench.add(1_000_003, own, State::Outside);
        bench.add(1_000_004, own, State::Running);
        bench.supervisor.note_other(1_000_003, 0x137F);
        bench.supervisor.note_other(1_000_004, 0x137F);
        assert_eq!(bench.supervisor.queue, [1_000_003]);
        let state = bench.supervisor.threads[&1_000_003].state;
        assert!(matches!(state, State::Ready(Next::Stopped(0x137F))));
        bench.supervisor.note_other(1_000_004, 9);
        assert!(!bench.supervisor.threads.contains_key(&1_000_004));
        assert!(bench.supervisor.same_process(own, 1_000_003));
        assert!(!bench.supervisor.same_process(-7, -7) && !bench.supervisor.same_process(own, -7));
        bench.add(1_000_005, 1_000_005, State::Running);
        assert!(!bench.supervisor.same_process(own, 1_000_005));
    }

    #[test]
    fn a_place_of_calls_is_known_once_it_was_seen() {
        let mut bench = Bench::new();
        let (tid, call) = (bench.tid, Call::made(0, &[]));
        assert!(!bench.supervisor.is_known_site(tid, &call));
        bench.supervisor.learn_site(tid, &call);
        assert!(bench.supervisor.is_known_site(tid, &call));
        assert!(!bench.supervisor.is_known_site(-7, &call));
        bench.supervisor.learn_site(-7, &call);
    }

    /// A bench with a thread that stands, known to the supervisor.
    fn with(stopped: &Stopped) -> (Bench, i32) {
        let mut bench = Bench::new();
        let tid = stopped.pid.as_raw();
        bench.add(tid, tid, State::Running);
        (bench, tid)
    }

    /// wait(2): a stop is 0x7F, its signal in the second byte, the event of ptrace(2) in the third.
    #[test]
    fn a_stop_is_handled_by_its_kind() {
        let stopped = Stopped::new();
        stopped.runs(&[0x90; 16]);
        let (mut bench, tid) = with(&stopped);
        let mut goes_with = |status: i32| match bench.supervisor.handle(tid, status) {
            Flow::Goes(signal) => signal.map_or(0, |it| it as i32),
            Flow::Stays => -1,
        };
        let signal = |number: i32| number << 8 | 0x7F;
        for number in [libc::SIGUSR1, libc::SIGCHLD, libc::SIGTRAP, libc::SIGSEGV] {
            assert_eq!(goes_with(signal(number)), number);
        }
        // Of a call, and of the end of a child's vfork.
        assert_eq!(goes_with(signal(libc::SIGTRAP | 0x80)), 0);
        assert_eq!(goes_with(libc::PTRACE_EVENT_VFORK_DONE << 16 | 0x57F), 0);
        // The end of a thread.
        assert!(matches!(bench.supervisor.handle(tid, 0x300), Flow::Stays));
        assert!(!bench.supervisor.threads.contains_key(&tid));
    }

    /// Intel's manual, volume 2: `rdtsc` is 0F 31, `rdtscp` 0F 01 F9. The counter begins with
    /// 1,000 s in nanoseconds, and a look takes 1 us.
    #[test]
    fn a_read_of_the_hidden_counter_is_answered() {
        for (code, len) in [(&[0x0F, 0x31][..], 2), (&[0x0F, 0x01, 0xF9][..], 3)] {
            let stopped = Stopped::new();
            let at = stopped.runs(code);
            let (mut bench, tid) = with(&stopped);
            let segv = libc::SIGSEGV << 8 | 0x7F;
            assert!(matches!(
                bench.supervisor.handle(tid, segv),
                Flow::Goes(None)
            ));
            let registers = stopped.registers();
            assert_eq!(registers.rip, at + len);
            assert_eq!(registers.rdx << 32 | registers.rax, 1_000_000_001_000);
            assert_eq!(bench.supervisor.fault(), None);
        }
    }

    /// A call begins: it is counted, takes 1 us, and all data of the last one are gone.
    #[test]
    fn a_call_begins_anew() {
        let stopped = Stopped::that_calls();
        stopped.filters(&[libc::SYS_clock_getres]);
        let (mut bench, tid) = with(&stopped);
        let at = stopped.begins(libc::SYS_clock_getres, &[1, 0]);
        let thread = bench.supervisor.threads.get_mut(&tid).expect("added");
        let stale = Call::made(libc::SYS_pause, &[]);
        thread.call = Some(stale);
        thread.outside = Some(stale);
        (thread.is_at_end, thread.is_woken) = (true, true);
        (thread.waits_for_ports, thread.asks_port) = (true, true);
        thread.computed = Duration::from_secs(1);
        (thread.loop_length, thread.progress) = (Some(3), 5);
        (thread.lines_before, thread.slice) = (Some([1; 4]), 6);
        thread.watched = vec![1];
        bench.supervisor.launches(tid);
        assert!(matches!(bench.supervisor.called(tid), Flow::Goes(None)));
        assert_eq!(bench.supervisor.calls.count, 0, "it is a launcher");
        bench.supervisor.launchers.clear();
        let seccomp = libc::PTRACE_EVENT_SECCOMP << 16 | 0x57F;
        assert!(matches!(
            bench.supervisor.handle(tid, seccomp),
            Flow::Goes(None)
        ));
        assert_eq!((bench.supervisor.calls.count, bench.now()), (1, 1_000));
        assert_eq!(bench.supervisor.progress, 1);
        let spent = bench.supervisor.spent.get(&libc::SYS_clock_getres);
        assert_eq!(spent, Some(&1));
        let thread = &bench.supervisor.threads[&tid];
        let call = thread.call.expect("it has begun");
        assert_eq!((call.number, call.args[0]), (libc::SYS_clock_getres, 1));
        assert!(thread.outside.is_none() && thread.lines_before.is_none());
        assert!(!thread.is_at_end && !thread.is_woken);
        assert!(!thread.waits_for_ports && !thread.asks_port && thread.watched.is_empty());
        assert_eq!(
            (thread.computed, thread.loop_length),
            (Duration::ZERO, None)
        );
        assert_eq!((thread.progress, thread.slice), (0, 7));
        assert_eq!(thread.entered, protocols::Instant::from_nanos(1_000));
        assert!(bench.supervisor.processes[&tid].sites.contains(&(at + 2)));
        // The supervisor has answered it: the kernel executes no call.
        assert_eq!(stopped.registers().rax, 0);
        assert_eq!(stopped.registers().orig_rax, u64::MAX);
        assert!(matches!(bench.supervisor.called(-7), Flow::Goes(None)));
        assert_eq!(bench.supervisor.calls.count, 1);
    }

    /// `mov edi, 3; mov eax, 231; syscall` is exit_group(3).
    const EXITS: [u8; 12] = [0xBF, 3, 0, 0, 0, 0xB8, 0xE7, 0, 0, 0, 0x0F, 0x05];

    /// A thread that is ready runs up to its end; one that is not does not.
    #[test]
    fn a_thread_runs_up_to_its_end() {
        let stopped = Stopped::new();
        let at = stopped.runs(&EXITS);
        let (mut bench, tid) = with(&stopped);
        bench.supervisor.roots.insert(tid, None);
        bench.supervisor.run_thread(tid);
        assert_eq!(stopped.registers().rip, at, "it is not ready");
        bench.supervisor.run_thread(-7);
        is_ready(&mut bench.supervisor, tid);
        bench.supervisor.threads.get_mut(&tid).expect("added").slice = 5;
        bench.supervisor.run_thread(tid);
        assert_eq!(bench.supervisor.status(tid), Some(0x300));
        assert!(!bench.supervisor.threads.contains_key(&tid));
        assert!(bench.supervisor.held_over.is_none());
    }

    /// How a thread goes on: what its state says, and whether a signal may have come since.
    #[test]
    fn a_thread_goes_on_as_it_is_to() {
        let sends = libc::SIGWINCH << 8 | 0x7F;
        for (next, computes, is_signalled) in [
            (Next::Go(None), false, false),
            (Next::Go(Some(Signal::SIGWINCH)), false, false),
            (Next::Stopped(sends), false, false),
            (Next::Attempt, false, true),
            (Next::Charged, false, true),
            (Next::Call, false, false),
            (Next::Begin, false, false),
            (Next::Lose, true, false),
        ] {
            let stopped = Stopped::new();
            stopped.runs(&EXITS);
            let (mut bench, tid) = with(&stopped);
            bench.supervisor.roots.insert(tid, None);
            let thread = bench.supervisor.threads.get_mut(&tid).expect("added");
            let waits = matches!(
                next,
                Next::Attempt | Next::Charged | Next::Call | Next::Begin
            );
            thread.call = waits.then(|| Call::made(libc::SYS_pause, &[]));
            bench.supervisor.run_on(tid, next);
            let has_ended = bench.supervisor.status(tid).is_some();
            assert_eq!(has_ended, !waits && !computes, "{next:?}");
            // The end of a process may have sent signals.
            assert!(has_ended || bench.supervisor.is_signalled == is_signalled);
            if waits {
                assert!(bench.supervisor.threads[&tid].is_blocked(), "{next:?}");
            }
        }
        // With another order of threads, a signal may have come while others ran.
        let stopped = Stopped::new();
        stopped.runs(&EXITS);
        let (mut bench, tid) = with(&stopped);
        bench.supervisor.schedule = Some(Schedule::new(1));
        let thread = bench.supervisor.threads.get_mut(&tid).expect("added");
        thread.call = Some(Call::made(libc::SYS_pause, &[]));
        bench.supervisor.run_on(tid, Next::Call);
        assert!(bench.supervisor.is_signalled);
        bench.supervisor.run_on(-7, Next::Go(None));
    }

    /// Intel's manual, volume 2: a call keeps the flags in r11; bit 8 is the one of single steps,
    /// which a program must not see.
    #[test]
    fn a_program_does_not_see_that_it_is_stepped() {
        let steps = |prepare: &dyn Fn(&mut Supervisor)| {
            let stopped = Stopped::that_calls();
            stopped.filters(&[libc::SYS_clock_getres]);
            let (mut bench, tid) = with(&stopped);
            stopped.begins(libc::SYS_clock_getres, &[1, 0]);
            stopped.change(|registers| registers.r11 |= 0x100);
            prepare(&mut bench.supervisor);
            bench.supervisor.called(tid);
            stopped.registers().r11 & 0x100 != 0
        };
        assert!(steps(&|_| {}), "it has set the flag itself");
        assert!(!steps(&|it| it.begin_debugging(Wanted::Nothing)));
        assert!(!steps(&|it| it.schedule = Some(Schedule::new(1))));
    }
}
