//! A debugger's view of a process that stands: its code, its registers, what it does.

use nix::sys::ptrace::Options;

use super::*;
use crate::guest::call::Call;
use crate::guest::supervisor::tests::Bench;
use crate::guest::supervisor::{On, State, Wait};
use crate::guest::tests::Stopped;

/// A supervisor whose debugged process stands at code of four bytes: `nop; nop; nop; nop`.
struct Debugged {
    bench: Bench,
    stopped: Stopped,
    pid: i32,
    /// Where that code is.
    at: u64,
}

impl Debugged {
    fn new() -> Self {
        let mut bench = Bench::new();
        let stopped = Stopped::new();
        ptrace::setoptions(stopped.pid, Options::PTRACE_O_TRACESYSGOOD).expect("it stands");
        let at = stopped.runs(&[0x90; 16]);
        let pid = stopped.pid.as_raw();
        bench.add(pid, pid, State::Running);
        bench.supervisor.begin_debugging(Wanted::Nothing);
        let mut new = Self {
            bench,
            stopped,
            pid,
            at,
        };
        new.debugging().process = Some(pid);
        new
    }

    fn debugging(&mut self) -> &mut Debugging {
        self.bench.supervisor.debugging().expect("begun")
    }

    fn supervisor(&mut self) -> &mut Supervisor {
        &mut self.bench.supervisor
    }

    /// The bytes that are really there.
    fn code(&self, len: usize) -> Vec<u8> {
        let mut code = vec![0; len];
        let memory = crate::guest::memory::Memory(self.stopped.pid);
        memory.read(self.at, &mut code).expect("its code");
        code
    }

    fn state(&mut self, state: State) {
        let pid = self.pid;
        self.supervisor().set_state(pid, state);
    }
}

/// A breakpoint is the instruction `int3`, CC; the debugger sees the program's own byte.
#[test]
fn breakpoints_are_in_the_code_and_not_to_be_seen() {
    let mut it = Debugged::new();
    let at = it.at;
    assert!(it.supervisor().add_break(at + 1) && it.supervisor().add_break(at + 3));
    assert!(it.supervisor().add_break(at + 1), "it is there");
    assert!(!it.supervisor().add_break(8), "no memory");
    assert!(it.supervisor().has_break(at + 1) && !it.supervisor().has_break(at + 2));
    assert_eq!(it.code(4), [0x90, 0xCC, 0x90, 0xCC]);
    let mut seen = [0; 4];
    assert_eq!(it.supervisor().read_debugged(at, &mut seen), 4);
    assert_eq!(seen, [0x90; 4]);
    let mut seen = [0; 2];
    assert_eq!(it.supervisor().read_debugged(at + 2, &mut seen), 2);
    assert_eq!(seen, [0x90; 2]);
    assert_eq!(it.supervisor().read_debugged(8, &mut seen), 0);
    // What is written there is under the breakpoint.
    assert!(it.supervisor().write_debugged(at, &[1, 2, 3]));
    assert_eq!(it.code(4), [1, 0xCC, 3, 0xCC]);
    let mut seen = [0; 4];
    assert_eq!(it.supervisor().read_debugged(at, &mut seen), 4);
    assert_eq!(seen, [1, 2, 3, 0x90]);
    assert!(!it.supervisor().write_debugged(8, &[1]));
    assert!(it.supervisor().remove_break(at + 1) && !it.supervisor().remove_break(at + 1));
    assert_eq!(it.code(4), [1, 2, 3, 0xCC]);
    assert_eq!(it.debugging().break_addresses(), [at + 3]);
    it.supervisor().clear_breaks();
    assert_eq!(it.code(4), [1, 2, 3, 0x90]);
    // Where there is no code yet it is set later.
    it.supervisor().add_break_when_possible(8);
    it.supervisor().add_break_when_possible(at);
    assert_eq!(it.debugging().break_addresses(), [at, 8]);
    it.supervisor().add_pending_breaks();
    assert_eq!(it.debugging().pending, BTreeSet::from([8]));
    it.debugging().pending.insert(at + 2);
    it.supervisor().add_pending_breaks();
    assert_eq!(it.debugging().pending, BTreeSet::from([8]));
    assert!(it.supervisor().has_break(at + 2));
    assert!(it.supervisor().remove_break(8) && !it.supervisor().remove_break(8));
    // A breakpoint that could not be taken away is no byte of the program's.
    it.debugging().breaks.clear();
    assert!(it.supervisor().add_break(at));
    assert_eq!(it.debugging().breaks[&at], 1);
    it.debugging().process = None;
    assert!(!it.supervisor().add_break(at + 9) && !it.supervisor().write_debugged(at, &[1]));
    assert_eq!(it.supervisor().read_debugged(at, &mut seen), 0);
    it.supervisor().debugging = None;
    assert!(!it.supervisor().add_break(at) && !it.supervisor().remove_break(at));
    assert!(!it.supervisor().has_break(at));
}

/// Memory is read up to where it ends: a page has 4,096 bytes.
#[test]
fn memory_is_read_up_to_its_end() {
    let it = Debugged::new();
    let maps = std::fs::read_to_string(format!("/proc/{}/maps", it.pid)).expect("it stands");
    let line = maps
        .lines()
        .find(|line| line.ends_with("[stack]"))
        .expect("each has one");
    let range = line.split(' ').next().expect("a range");
    let (_, end) = range.split_once('-').expect("two addresses");
    let end = u64::from_str_radix(end, 16).expect("an address");
    let mut buf = vec![1; 5_000];
    let supervisor = &it.bench.supervisor;
    assert_eq!(supervisor.read_debugged(end - 100, &mut buf), 100);
    assert_eq!(supervisor.read_debugged(end - 4_500, &mut buf), 4_500);
    assert_eq!(supervisor.read_debugged(end, &mut buf), 0);
    assert_eq!(supervisor.read_debugged(end - 8, &mut buf[..4]), 4);
}

#[test]
fn a_thread_of_the_debugged_process_is_known_by_its_birth() {
    let mut it = Debugged::new();
    let (pid, own) = (it.pid, it.bench.tid);
    let threads = |it: &mut Debugged| it.supervisor().debugged_threads().collect::<Vec<_>>();
    assert_eq!(threads(&mut it), [(1, pid)]);
    it.bench.add(1_999_999, pid, State::Running);
    assert_eq!(threads(&mut it), [(1, pid), (2, 1_999_999)]);
    assert_eq!(
        (it.supervisor().index_of(own), it.supervisor().index_of(pid)),
        (Some(0), Some(1))
    );
    assert_eq!(it.supervisor().index_of(-7), None);
    it.state(State::Ended);
    assert_eq!(threads(&mut it), [(2, 1_999_999)]);
    it.debugging().process = None;
    assert!(threads(&mut it).is_empty());
    assert!(it.supervisor().debugged_file().is_none());
    assert!(it.supervisor().auxiliary_vector().is_none());
    it.debugging().process = Some(pid);
    let exe = std::fs::read_link(format!("/proc/{pid}/exe")).ok();
    assert_eq!(it.supervisor().debugged_file(), exe);
    let vector = it.supervisor().auxiliary_vector().expect("it stands");
    assert!(vector.len().is_multiple_of(16) && vector.ends_with(&[0; 8]));
}

/// A thread that has begun a call stands before it, for people; its registers cannot be set then.
#[test]
fn registers_are_those_before_a_call() {
    let mut it = Debugged::new();
    let pid = it.pid;
    it.stopped.change(|registers| {
        registers.rip = 0x1002;
        registers.orig_rax = 7;
        registers.rax = 9;
    });
    let shown = |it: &mut Debugged| {
        let (own, float) = it.supervisor().registers_of(pid).expect("it stands");
        (own.rip, own.rax, float.is_some())
    };
    assert_eq!(shown(&mut it), (0x1002, 9, true));
    it.debugging().held = Some((pid, Next::Begin));
    assert_eq!(shown(&mut it), (0x1000, 7, true));
    it.debugging().held = Some((pid + 1, Next::Begin));
    assert_eq!(shown(&mut it), (0x1002, 9, true));
    // A thread that is in the kernel has the registers of its call.
    let other = it.bench.add(1_999_999, pid, State::Outside);
    other.call = Some(Call::made(1, &[]));
    let (_, float) = it.supervisor().registers_of(1_999_999).expect("its call");
    assert!(float.is_none() && it.supervisor().registers_of(1_999_998).is_none());
    let set = |it: &mut Debugged, held: Option<(i32, Next)>, state: State| {
        it.debugging().held = held;
        it.state(state);
        let mut own = it.stopped.registers();
        own.rbx += 1;
        let is_set = it.supervisor().set_registers_of(pid, own, None);
        assert_eq!(it.stopped.registers().rbx == own.rbx, is_set);
        is_set
    };
    let go = Next::Go(None);
    assert!(set(&mut it, Some((pid, go)), State::Running));
    assert!(!set(&mut it, Some((pid, Next::Begin)), State::Ready(go)));
    assert!(!set(&mut it, Some((pid + 1, go)), State::Running));
    assert!(set(&mut it, Some((pid + 1, go)), State::Ready(go)));
    assert!(set(&mut it, None, State::Ready(go)));
    assert!(!set(&mut it, None, State::Ready(Next::Attempt)));
    let wait = Wait {
        on: On::Files,
        deadline: None,
    };
    assert!(!set(&mut it, None, State::Blocked(wait)));
    // Those for floating point as well.
    it.state(State::Ready(go));
    let (own, float) = it.supervisor().registers_of(pid).expect("it stands");
    let mut float = float.expect("it stands");
    float.xmm_space[0] ^= 0xABCD;
    let word = float.xmm_space[0];
    assert!(it.supervisor().set_registers_of(pid, own, Some(float)));
    let (_, float) = it.supervisor().registers_of(pid).expect("it stands");
    assert_eq!(float.expect("it stands").xmm_space[0], word);
}

#[test]
fn people_are_told_what_a_thread_does() {
    let mut it = Debugged::new();
    let pid = it.pid;
    let name = format!("sleep ({pid}): ");
    let doing = |it: &mut Debugged, held: Option<(i32, Next)>, state: State| {
        it.debugging().held = held;
        it.state(state);
        let text = it.supervisor().doing_of(pid);
        text.strip_prefix(&*name)
            .unwrap_or_else(|| panic!("{text}"))
            .to_owned()
    };
    let wait = |deadline| {
        State::Blocked(Wait {
            on: On::Files,
            deadline,
        })
    };
    assert_eq!(doing(&mut it, None, State::Running), "can run");
    assert_eq!(doing(&mut it, None, wait(None)), "waits in a call");
    let thread = it.bench.supervisor.threads.get_mut(&pid).expect("added");
    thread.call = Some(Call::made(libc::SYS_read, &[]));
    assert_eq!(doing(&mut it, None, wait(None)), "waits in read");
    let until = Some(Instant::from_millis(1_500));
    assert_eq!(
        doing(&mut it, None, wait(until)),
        "waits in read until 1.500000 s"
    );
    assert_eq!(doing(&mut it, None, State::Halted), "stopped by a signal");
    let outside = "outside of virtual time in read";
    assert_eq!(doing(&mut it, None, State::Outside), outside);
    assert_eq!(
        doing(&mut it, Some((pid, Next::Begin)), State::Running),
        "begins read"
    );
    assert_eq!(
        doing(&mut it, Some((pid, Next::Go(None))), wait(None)),
        "runs"
    );
    assert_eq!(
        doing(&mut it, Some((1, Next::Begin)), State::Running),
        "can run"
    );
    let gone = it.supervisor().doing_of(-7);
    assert_eq!(gone, " (-7)");
}

#[test]
fn a_debugger_sends_signals_and_changes_the_held_one() {
    let mut it = Debugged::new();
    let pid = it.pid;
    let term = Some(Signal::SIGTERM);
    assert!(it.supervisor().set_held_signal(pid, None));
    assert!(
        !it.supervisor().set_held_signal(pid, term),
        "nothing is held"
    );
    it.debugging().held = Some((pid, Next::Go(None)));
    assert!(it.supervisor().set_held_signal(pid, term));
    assert!(matches!(
        it.debugging().held,
        Some((_, Next::Go(Some(Signal::SIGTERM))))
    ));
    assert!(!it.supervisor().set_held_signal(pid + 1, term));
    it.debugging().held = Some((pid, Next::Begin));
    assert!(
        !it.supervisor().set_held_signal(pid, term) && it.supervisor().set_held_signal(pid, None)
    );
    let pending = || crate::guest::pending::Pending::of(pid, pid).common;
    it.supervisor().send_signal(pid, None);
    it.supervisor().send_signal(-7, Some(Signal::SIGWINCH));
    assert!(!it.supervisor().is_signalled && pending() == 0);
    it.supervisor().send_signal(pid, Some(Signal::SIGWINCH));
    assert!(it.supervisor().is_signalled && pending() == 1 << 27);
}

/// The processor has four registers for watched memory: whole words of 1, 2, 4 or 8 bytes.
#[test]
fn memory_is_watched_by_four_registers() {
    let mut it = Debugged::new();
    let watch = |address, len| Watchpoint {
        address,
        len,
        reads: false,
    };
    for wrong in [
        watch(16, 3),
        watch(16, 16),
        watch(16, 0x100),
        watch(18, 4),
        watch(17, 2),
    ] {
        assert!(!it.debugging().add_watch(wrong), "{wrong:?}");
    }
    assert_eq!(it.debugging().watch_changes, 0);
    let all = [watch(16, 8), watch(20, 4), watch(22, 2), watch(23, 1)];
    assert!(all.into_iter().all(|one| it.debugging().add_watch(one)));
    assert!(!it.debugging().add_watch(watch(32, 8)), "there are no more");
    assert_eq!(it.debugging().watches(), all);
    assert_eq!(it.debugging().watch_changes, 4);
    assert!(it.debugging().remove_watch(all[1]) && !it.debugging().remove_watch(all[1]));
    assert_eq!(
        (it.debugging().watches().len(), it.debugging().watch_changes),
        (3, 5)
    );
    it.debugging().set_watches(vec![all[0], all[2], all[3]]);
    assert_eq!(it.debugging().watch_changes, 5, "they are the same");
    it.debugging().set_watches(vec![all[0]]);
    assert_eq!(
        (it.debugging().watches().len(), it.debugging().watch_changes),
        (1, 6)
    );
}

/// By hand: `mov %al, (%rbx)` is 88 03, and touches watched memory; the trap comes behind it.
#[test]
fn touched_memory_is_a_stop() {
    let mut it = Debugged::new();
    let (pid, at) = (it.pid, it.at);
    let place = it.stopped.registers().rsp & !7;
    poke(it.stopped.pid, at, &[0x88, 0x03, 0x88, 0x01, 0x90]).expect("its code");
    it.stopped.change(|registers| {
        registers.rbx = place + 9;
        registers.rcx = place;
        registers.rax = 1;
    });
    let watch = |address| Watchpoint {
        address,
        len: 8,
        reads: false,
    };
    assert!(it.debugging().add_watch(watch(place)));
    assert!(it.debugging().add_watch(watch(place + 8)));
    it.supervisor().put_watches(pid);
    assert_eq!(it.debugging().watched_by[&pid], 2);
    let stop = |it: &mut Debugged| {
        assert_eq!(Stopped::signal_of(it.stopped.goes_on()), libc::SIGTRAP);
        assert!(matches!(it.supervisor().trapped(pid), Some(Flow::Stays)));
        it.supervisor().take_stop()
    };
    assert_eq!(stop(&mut it), Some(Stop::Watch(pid, place + 8)));
    assert_eq!(it.stopped.registers().rip, at + 2);
    assert!(it.debugging().place.is_at_watch());
    assert_eq!(stop(&mut it), Some(Stop::Watch(pid, place)));
    assert_eq!(it.stopped.registers().rip, at + 4);
    assert_eq!(it.supervisor().take_stop(), None, "it is told once");
    assert_eq!(hit_watch(it.stopped.pid, 4), None, "the status is taken");
    assert_eq!(hit_watch(it.stopped.pid, 0), None);
}

/// A thread that comes to `int3` of a breakpoint stands at its place.
#[test]
fn a_breakpoint_is_a_stop() {
    let mut it = Debugged::new();
    let (pid, at) = (it.pid, it.at);
    assert!(it.supervisor().add_break(at + 2));
    let status = it.stopped.goes_on();
    assert_eq!(Stopped::signal_of(status), libc::SIGTRAP);
    assert!(matches!(it.supervisor().trapped(pid), Some(Flow::Stays)));
    assert_eq!(it.stopped.registers().rip, at + 2);
    assert_eq!(it.supervisor().take_stop(), Some(Stop::Break(pid)));
    assert!(it.supervisor().is_held());
    assert_eq!(it.debugging().held_thread(), Some(pid));
    assert_eq!(it.debugging().place.to_string(), "call 0.0, hit 1");
    let held = it.supervisor().take_held();
    assert!(matches!(held, Some((of, Next::Go(None))) if of == pid));
    assert!(!it.supervisor().is_held() && it.debugging().held_thread().is_none());
    // One that was taken away since goes on as if there was none.
    assert!(it.supervisor().remove_break(at + 2));
    poke(it.stopped.pid, at + 4, &[0xCC]).expect("its code");
    it.debugging().under.insert(at + 4, 0x90);
    it.stopped.goes_on();
    assert!(matches!(
        it.supervisor().trapped(pid),
        Some(Flow::Goes(None))
    ));
    assert_eq!((it.stopped.registers().rip, it.code(5)[4]), (at + 4, 0x90));
    // A trap of the program's own is its own.
    poke(it.stopped.pid, at + 6, &[0xCC]).expect("its code");
    it.stopped.goes_on();
    assert!(it.supervisor().trapped(pid).is_none());
    // Another process at a breakpoint of this one passes it.
    it.stopped.change(|registers| registers.rip = at + 8);
    assert!(it.supervisor().add_break(at + 9));
    it.debugging().process = Some(1);
    it.stopped.goes_on();
    assert!(matches!(
        it.supervisor().trapped(pid),
        Some(Flow::Goes(None))
    ));
    assert_eq!(
        (it.stopped.registers().rip, it.code(10)[9]),
        (at + 10, 0xCC)
    );
    assert!(it.supervisor().take_stop().is_none());
}

/// Steps up to the end of a range, or for a number of instructions.
#[test]
fn a_thread_goes_by_single_instructions() {
    let mut it = Debugged::new();
    let (pid, at) = (it.pid, it.at);
    let step = |within: Range<u64>| Step { tid: pid, within };
    let one = |it: &mut Debugged| {
        ptrace::step(it.stopped.pid, None).expect("it stands");
        wait(Some(it.stopped.pid), WaitOptions::empty()).expect("it stops");
        let flow = it.supervisor().trapped(pid);
        let stays = matches!(flow, Some(Flow::Stays));
        assert!(stays || matches!(flow, Some(Flow::Goes(None)) | None));
        (flow.is_some(), stays, it.supervisor().take_stop())
    };
    assert_eq!(
        one(&mut it),
        (false, false, None),
        "no debugger has asked for it"
    );
    it.debugging().set_step(Some(step(0..0)));
    assert_eq!(one(&mut it), (true, true, Some(Stop::Step(pid))));
    it.debugging().set_step(Some(step(at..at + 4)));
    assert_eq!(one(&mut it), (true, false, None));
    assert_eq!(
        one(&mut it),
        (true, true, Some(Stop::Step(pid))),
        "behind it"
    );
    it.debugging().set_step(Some(step(0..u64::MAX)));
    it.debugging().limit_steps(2);
    assert_eq!(one(&mut it), (true, false, None));
    assert_eq!(one(&mut it), (true, true, Some(Stop::Step(pid))));
    let last = it
        .debugging()
        .last_step_of(1)
        .expect("of this thread")
        .to_string();
    assert_eq!(last, "call 0.0, instruction 5");
    assert!(it.debugging().last_step_of(0).is_none());
    it.debugging().limit_steps(u64::MAX);
    it.debugging().in_a_row = IN_A_ROW - 2;
    assert_eq!(one(&mut it), (true, false, None));
    assert_eq!(
        one(&mut it),
        (true, true, None),
        "the turn ends without a stop"
    );
    assert!(it.supervisor().is_held() && it.debugging().in_a_row == 0);
    it.debugging().set_step(Some(Step {
        tid: pid + 1,
        within: 0..0,
    }));
    assert_eq!(one(&mut it), (false, false, None), "another thread's");
}

/// A place is numbered by calls; the time, a call or a condition for which a debugger waits.
#[test]
fn a_program_runs_up_to_its_goal() {
    let mut it = Debugged::new();
    let pid = it.pid;
    assert!(it.supervisor().calls_for_debugger(pid).is_none());
    assert_eq!(it.debugging().last_call.calls, 1);
    it.debugging()
        .set_goal(Some(Goal::Moment(Moment { calls: 3, leaps: 0 })));
    assert!(it.supervisor().calls_for_debugger(pid).is_none());
    assert!(matches!(
        it.supervisor().calls_for_debugger(pid),
        Some(Flow::Stays)
    ));
    assert_eq!(it.supervisor().take_stop(), Some(Stop::Reached(Some(pid))));
    assert!(matches!(
        it.supervisor().take_held(),
        Some((_, Next::Begin))
    ));
    assert!(
        it.supervisor().calls_for_debugger(pid).is_none(),
        "a goal is reached once"
    );
    it.debugging()
        .set_goal(Some(Goal::Time(Instant::from_millis(5))));
    it.supervisor().leapt_for_debugger();
    assert_eq!(it.supervisor().take_stop(), None);
    it.bench.supervisor.stage.begin();
    it.bench.passes(6);
    it.bench
        .supervisor
        .stage
        .leap(None, false)
        .expect("the port stays");
    it.supervisor().leapt_for_debugger();
    assert_eq!(it.supervisor().take_stop(), Some(Stop::Reached(None)));
    assert_eq!(it.debugging().place().to_string(), "call 4.2");
    // Another process has calls as well, but they are not those of the debugged one.
    let own = it.bench.tid;
    assert!(it.supervisor().calls_for_debugger(own).is_none());
    assert_eq!(
        (
            it.debugging().last_call.calls,
            it.debugging().place.moment.calls
        ),
        (4, 5)
    );
    let _port = it.bench.opens("sonar");
    it.supervisor().writes_for_debugger(own, 0);
    it.supervisor().writes_for_debugger(-7, 0);
    let (writes, last) = it.debugging().take_log();
    let moments: Vec<u64> = writes.iter().map(|write| write.moment.calls).collect();
    assert_eq!((moments, last.calls), (vec![5], 4));
    assert!(writes[0].to.is_some() && it.debugging().take_log().0.is_empty());
    // A signal is told before the program gets it.
    assert!(it.supervisor().signalled_for_debugger(own, 15).is_none());
    let flow = it.supervisor().signalled_for_debugger(pid, 15);
    assert!(matches!(flow, Some(Flow::Stays)));
    assert_eq!(it.supervisor().take_stop(), Some(Stop::Signal(pid, 15)));
    assert!(matches!(
        it.debugging().held,
        Some((_, Next::Go(Some(Signal::SIGTERM))))
    ));
    assert_eq!(it.debugging().place().to_string(), "call 5.2, signal 1");
}

/// Which of the started programs is to be debugged.
#[test]
fn the_wanted_program_is_held_when_it_is_loaded() {
    let loads = |wanted: Wanted| {
        let mut it = Debugged::new();
        let pid = it.pid;
        it.supervisor().begin_debugging(wanted);
        let flow = it.supervisor().execed_for_debugger(pid, Flow::Goes(None));
        let stop = it.supervisor().take_stop();
        assert_eq!(stop.is_some(), matches!(flow, Flow::Stays));
        assert_eq!(stop.is_some(), it.debugging().process == Some(pid));
        assert_eq!(it.debugging().started(), ["sleep"]);
        stop == Some(Stop::Loaded(pid))
    };
    let file =
        |it: &Debugged| std::fs::read_link(format!("/proc/{}/exe", it.pid)).expect("it runs");
    let it = Debugged::new();
    if file(&it).file_name().is_none_or(|name| name != "sleep") {
        eprintln!("SKIPPED: sleep is a part of another program");
        return;
    }
    assert!(!loads(Wanted::Nothing));
    assert!(loads(Wanted::Name("sleep".to_owned())) && !loads(Wanted::Name("slee".to_owned())));
    assert!(loads(Wanted::NoShell));
    assert!(loads(Wanted::Load(1)) && !loads(Wanted::Load(2)));
    // The debugged one that becomes another program has none of the marks of before.
    let mut it = Debugged::new();
    let (pid, at) = (it.pid, it.at);
    it.supervisor().add_break(at);
    it.debugging().add_watch(Watchpoint {
        address: 8,
        len: 8,
        reads: false,
    });
    it.supervisor().add_break_when_possible(8);
    assert!(matches!(
        it.supervisor().execed_for_debugger(pid, Flow::Goes(None)),
        Flow::Goes(None)
    ));
    let debugging = it.debugging();
    assert!(debugging.breaks.is_empty() && debugging.pending.is_empty());
    assert!(debugging.under.is_empty() && debugging.watches.is_empty());
    assert_eq!(
        it.supervisor().notes(),
        ["the debugged process has become another program"]
    );
    // The first program that uses a port, and children of it by fork.
    let mut it = Debugged::new();
    let pid = it.pid;
    it.supervisor().uses_port_for_debugger(pid);
    assert_eq!(it.debugging().port_user(), None);
    it.debugging().load_of.insert(pid, 3);
    let child = Stopped::new();
    let at = it.at;
    it.supervisor().add_break(at);
    it.supervisor().forked_for_debugger(pid, child.pid);
    it.supervisor().uses_port_for_debugger(child.pid.as_raw());
    assert_eq!(it.debugging().port_user(), Some(3));
    it.debugging().load_of.insert(9, 4);
    it.supervisor().uses_port_for_debugger(9);
    assert_eq!(it.debugging().port_user(), Some(3), "the first one");
}

#[test]
fn what_a_debugger_has_set_ends_with_a_thread_and_with_it() {
    let mut it = Debugged::new();
    let (pid, at) = (it.pid, it.at);
    it.debugging().watched_by.insert(9, 1);
    it.debugging().set_step(Some(Step {
        tid: 9,
        within: 0..0,
    }));
    it.debugging().held = Some((9, Next::Attempt));
    it.supervisor().add_break(at);
    it.supervisor().buried_for_debugger(8, 0);
    assert!(it.debugging().step.is_some() && it.supervisor().is_held());
    it.supervisor().buried_for_debugger(9, 0);
    assert!(it.debugging().step.is_none() && !it.supervisor().is_held());
    assert!(it.debugging().watched_by.is_empty() && it.debugging().stop.is_none());
    it.supervisor().buried_for_debugger(pid, 0x300);
    assert_eq!(it.supervisor().take_stop(), Some(Stop::Ended(0x300)));
    assert!(it.debugging().process.is_none() && it.debugging().breaks.is_empty());
    let mut it = Debugged::new();
    let (pid, at) = (it.pid, it.at);
    it.supervisor().add_break(at);
    it.debugging().held = Some((pid, Next::Begin));
    it.state(State::Outside);
    it.supervisor().end_debugging();
    assert_eq!(it.code(1), [0x90]);
    assert!(it.supervisor().debugging().is_none());
    assert!(matches!(it.supervisor().held_over, Some((held, Next::Begin)) if held == pid));
    // Its thread was outside: a stop at that breakpoint may still come, once.
    assert!(it.supervisor().left.is_some());
    poke(it.stopped.pid, at, &[0xCC]).expect("its code");
    it.stopped.goes_on();
    assert!(matches!(
        it.supervisor().stops_for_left(pid),
        Some(Flow::Goes(None))
    ));
    assert_eq!(it.stopped.registers().rip, at);
    assert!(it.supervisor().stops_for_left(pid).is_none());
}

/// By hand: `mov %al, (%rbx)` is 88 03. When the debugger has left, it causes no trap.
#[test]
fn memory_is_not_watched_for_a_debugger_that_has_left() {
    let mut it = Debugged::new();
    let at = it.stopped.runs(&[0x88, 0x03, 0x88, 0x03, 0x90, 0xCC]);
    let place = (it.stopped.registers().rsp - 64) & !7;
    it.stopped.change(|registers| registers.rbx = place);
    for address in [place, place + 8] {
        let watch = Watchpoint {
            address,
            len: 8,
            reads: false,
        };
        assert!(it.debugging().add_watch(watch));
    }
    let pid = it.pid;
    it.supervisor().put_watches(pid);
    assert_eq!(Stopped::signal_of(it.stopped.goes_on()), libc::SIGTRAP);
    assert_eq!(it.stopped.registers().rip, at + 2);
    it.supervisor().end_debugging();
    assert_eq!(Stopped::signal_of(it.stopped.goes_on()), libc::SIGTRAP);
    assert_eq!(it.stopped.registers().rip, at + 6, "its own trap");
}
