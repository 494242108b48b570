//! A session whose debugged process stands, and which no debugger has connected to.

mod replays;

use core::cell::RefCell;
use core::num::NonZeroUsize;

use gdbstub::target::ext::auxv::Auxv as _;
use gdbstub::target::ext::base::multithread::{
    MultiThreadBase as _, MultiThreadRangeStepping as _, MultiThreadResume as _,
    MultiThreadSingleStep as _,
};
use gdbstub::target::ext::base::reverse_exec::{ReverseCont as _, ReverseStep as _};
use gdbstub::target::ext::breakpoints::{HwWatchpoint as _, SwBreakpoint as _};
use gdbstub::target::ext::exec_file::ExecFile as _;
use gdbstub::target::ext::thread_extra_info::ThreadExtraInfo as _;
use gdbstub_arch::x86::reg::X86_64CoreRegs;

use super::again::{Seen, Walk};
use super::*;
use crate::guest::place::{Leg, Moment, Place};
use crate::guest::supervisor::tests::{Bench, debugs, holds, step_of};
use crate::guest::supervisor::{Goal, Watchpoint};
use crate::guest::tests::Stopped;
use crate::guest::trial::tests::trial_of;

/// Runs `test` in a session whose process `stopped` is debugged, and has the number 2.
fn session(test: impl FnOnce(&mut Session<'_>, &Stopped)) {
    let mut bench = Bench::new();
    let stopped = Stopped::new();
    debugs(&mut bench, stopped.pid.as_raw());
    let _port = bench.opens("sonar");
    let (trial, _folder) = trial_of(bench);
    let said = RefCell::new(Vec::new());
    let mut session = Session {
        trial: Some(trial),
        start: &mut || None,
        settings: DebugSettings::default(),
        goes_on: &|| true,
        say: &|text| said.borrow_mut().push(text.to_owned()),
        current: None,
        actions: Vec::new(),
        kinds: BTreeMap::new(),
        wires: Wires::default(),
        is_over: false,
        back: None,
        back_to: None,
        last_watched: None,
        first: None,
        wanted: None,
        is_signal_told: false,
        has_missed: false,
        ear: None,
        is_broken_off: false,
        computing: None,
        missed: None,
        steps_back: 0,
    };
    test(&mut session, &stopped);
}

fn tid(number: usize) -> Tid {
    NonZeroUsize::new(number).expect("from 1 on")
}

/// Threads are numbered by their birth, from 1; the current one is listed first.
#[test]
fn threads_have_numbers_of_their_birth() {
    session(|it, stopped| {
        let pid = stopped.pid.as_raw();
        let listed = |it: &mut Session<'_>| {
            let mut all = Vec::new();
            it.list_active_threads(&mut |number| all.push(number.get()))
                .expect("it stands");
            all
        };
        assert_eq!(listed(it), [2, 3]);
        it.current = Some(crate::guest::supervisor::tests::OTHER);
        assert_eq!(listed(it), [3, 2]);
        assert_eq!((it.number_of(pid), it.number_of(-7)), (tid(2), tid(3)));
        let reason = it.reason(GdbSignal::SIGTRAP);
        let expected = MultiThreadStopReason::SignalWithThread {
            tid: tid(3),
            signal: GdbSignal::SIGTRAP,
        };
        assert_eq!(reason, expected);
        it.current = None;
        assert_eq!(it.number_of(-7), tid(2), "the first one");
        let mut buf = [0; 64];
        let len = it.thread_extra_info(tid(2), &mut buf).expect("it stands");
        let text = String::from_utf8_lossy(&buf[..len]).into_owned();
        assert!(text.ends_with(&format!("({pid}): can run")), "{text}");
        assert_eq!(it.thread_extra_info(tid(9), &mut buf).expect("none"), 0);
    });
}

/// Reads and writes of registers and memory, and errors as numbers: ESRCH 3, EFAULT 14, EBUSY 16.
#[test]
fn registers_and_memory_are_read_and_written() {
    session(|it, stopped| {
        let number = |error| match error {
            gdbstub::target::TargetError::Errno(number) => number,
            _ => 0,
        };
        stopped.change(|registers| registers.rbx = 0xABCD);
        let mut regs = X86_64CoreRegs::default();
        it.read_registers(&mut regs, tid(2))
            .ok()
            .expect("it stands");
        assert_eq!((regs.regs[1], regs.rip), (0xABCD, stopped.registers().rip));
        assert_eq!(it.read_registers(&mut regs, tid(9)).map_err(number), Err(3));
        regs.regs[1] = 7;
        assert_eq!(
            it.write_registers(&regs, tid(2)).map_err(number),
            Err(16),
            "it runs"
        );
        crate::guest::supervisor::tests::is_ready(it.supervisor(), stopped.pid.as_raw());
        assert_eq!(it.write_registers(&regs, tid(2)).map_err(number), Ok(()));
        assert_eq!(stopped.registers().rbx, 7);
        assert_eq!(it.write_registers(&regs, tid(9)).map_err(number), Err(3));
        let place = stopped.registers().rsp - 64;
        assert_eq!(
            it.write_addrs(place, &[1, 2, 3], tid(2)).map_err(number),
            Ok(())
        );
        let mut bytes = [0; 3];
        assert_eq!(
            it.read_addrs(place, &mut bytes, tid(2)).map_err(number),
            Ok(3)
        );
        assert_eq!(bytes, [1, 2, 3]);
        assert_eq!(
            it.read_addrs(8, &mut bytes, tid(2)).map_err(number),
            Err(14)
        );
        assert_eq!(it.read_addrs(8, &mut [], tid(2)).map_err(number), Ok(0));
        assert_eq!(it.write_addrs(8, &[1], tid(2)).map_err(number), Err(14));
        let mut buf = [0; 4_096];
        let len = it
            .get_auxv(0, 4_096, &mut buf)
            .map_err(number)
            .expect("it stands");
        let rest = it
            .get_auxv(16, 4_096, &mut buf)
            .map_err(number)
            .expect("it stands");
        assert!(len > 64 && rest == len - 16);
        let exe = std::fs::read_link(format!("/proc/{}/exe", stopped.pid)).expect("it runs");
        let len = it
            .get_exec_file(None, 0, 4_096, &mut buf)
            .map_err(number)
            .expect("it stands");
        assert_eq!(&buf[..len], exe.as_os_str().as_encoded_bytes());
        assert!(it.add_sw_breakpoint(place, 1).is_ok_and(|done| done));
        assert!(it.remove_sw_breakpoint(place, 1).is_ok_and(|done| done));
        assert!(it.remove_sw_breakpoint(place, 1).is_ok_and(|done| !done));
    });
}

/// Watched memory takes as many of the four registers as it has words.
#[test]
fn watched_memory_takes_registers() {
    session(|it, _| {
        let count = |it: &mut Session<'_>| {
            it.supervisor()
                .debugging()
                .map_or(0, |it| it.watches().len())
        };
        let write = WatchKind::Write;
        let add = |it: &mut Session<'_>, at, len| {
            it.add_hw_watchpoint(at, len, write).is_ok_and(|done| done)
        };
        let remove = |it: &mut Session<'_>, at, len| {
            it.remove_hw_watchpoint(at, len, write)
                .is_ok_and(|done| done)
        };
        assert!(add(it, 7, 4));
        assert_eq!((count(it), it.kinds.get(&7)), (3, Some(&(4, write))));
        assert!(!add(it, 20, 8), "two words, and one register");
        assert_eq!((count(it), it.kinds.len()), (3, 1), "none of them stays");
        assert!(add(it, 16, 8));
        assert_eq!(it.watched_at(18), (16, write));
        assert_eq!(
            (it.watched_at(9), it.watched_at(3)),
            ((7, write), (3, write))
        );
        assert!(!remove(it, 32, 8));
        assert!(remove(it, 7, 4) && !remove(it, 7, 4));
        assert_eq!((count(it), it.kinds.len()), (1, 1));
        it.forget_debugger();
        assert_eq!((count(it), it.kinds.len()), (0, 0));
    });
}

/// A step is that of the first thread for which one is wanted; an order forward takes the place of
/// one back.
#[test]
fn a_thread_goes_on_as_the_debugger_wants() {
    session(|it, stopped| {
        let pid = stopped.pid.as_raw();
        let step = |it: &mut Session<'_>| step_of(it.supervisor());
        it.reverse_step(tid(2)).expect("kept");
        assert_eq!(it.back, Some(Back::Step(tid(2))));
        it.reverse_cont().expect("kept");
        assert_eq!(it.back, Some(Back::Continue));
        it.set_resume_action_continue(tid(2), None).expect("kept");
        it.set_resume_action_range_step(tid(2), 5, 9).expect("kept");
        it.set_resume_action_step(tid(3), None).expect("kept");
        it.resume().expect("it stands");
        assert_eq!((it.back, step(it)), (None, Some((pid, 5..9))));
        it.set_resume_action_step(tid(9), None).expect("kept");
        it.set_resume_action_step(tid(2), None).expect("kept");
        it.resume().expect("it stands");
        assert_eq!(step(it), Some((pid, 0..0)));
        it.set_resume_action_step(tid(2), None).expect("kept");
        it.clear_resume_actions().expect("kept");
        it.resume().expect("it stands");
        assert_eq!(step(it), None);
        // A signal for a thread that is not held is sent to its process.
        let urgent = to_gdb(nix::libc::SIGURG);
        it.set_resume_action_continue(tid(2), Some(urgent))
            .expect("kept");
        it.resume().expect("it stands");
        let pending = crate::guest::pending::Pending::of(pid, pid);
        assert!(pending.common & 1 << 22 != 0);
    });
}

#[test]
fn the_rig_answers_while_the_program_stands() {
    session(|it, _| {
        let begins = |it: &mut Session<'_>, command: &str, with: &str| {
            let answer = it.monitor(command);
            assert!(answer.starts_with(with), "{command}: {answer}");
        };
        begins(it, "", "monitor time ");
        begins(it, "help me", "monitor time ");
        assert_eq!(
            it.monitor("time"),
            "rig 0.000000 s, program 0.000000 s, call 0.0"
        );
        begins(
            it,
            "time now",
            "error: time now: unknown; expected time, until,",
        );
        begins(it, "until", "error: until: expected a time such as 12.3s");
        begins(
            it,
            "until soon",
            "error: until soon: expected a time such as 12.3s",
        );
        begins(
            it,
            "until 0s",
            "error: until 0s: the rig is at 0.000000 s already",
        );
        assert_eq!(
            it.monitor("until 1.5s"),
            "the next continue stops at 1.500000 s"
        );
        begins(it, "until visited x", "error: until visited = x: ");
        assert_eq!(
            it.monitor("back 200ms"),
            "the next reverse-continue goes back to 0.000000 s"
        );
        assert_eq!(it.back_to, Some(Instant::ZERO));
        begins(it, "back", "error: back: unknown");
        begins(
            it,
            "back soon",
            "error: back soon: expected a time such as 200ms",
        );
        begins(it, "wires", "error: wires: expected a link of sonar");
        begins(
            it,
            "wires moon",
            "error: wires moon: expected a link of sonar",
        );
        begins(
            it,
            "wires sonar x",
            "error: wires sonar x: expected a number of pieces",
        );
        assert_eq!(
            it.monitor("wires sonar 3"),
            "no byte has arrived on sonar yet"
        );
        begins(it, "state", "0.000000 s\npose ");
        begins(
            it,
            "fault add x",
            "error: fault add: \"x\": expected KEY=VALUE",
        );
        begins(it, "fault", "error: fault: unknown");
        let verdict = it.monitor("verdict");
        assert!(
            verdict.lines().any(|line| line.contains("program-alive: ")),
            "{verdict}"
        );
        begins(
            it,
            "fault add kind=\"silence\" link=\"sonar\" at=\"1s\"",
            "",
        );
    });
}

/// Code of a loop: four `nop` and `jmp -6`.
const LOOP: [u8; 6] = [0x90, 0x90, 0x90, 0x90, 0xEB, 0xFA];

/// Runs `test` in a session whose held thread, number 1 by birth, stands at `code`.
fn session_at(code: &[u8], test: impl FnOnce(&mut Session<'_>, &Stopped, u64)) {
    session(|it, stopped| {
        let at = stopped.runs(code);
        holds(it.supervisor(), stopped.pid.as_raw());
        test(it, stopped, at);
    });
}

const fn steps(count: u64) -> Leg {
    Leg::Steps { thread: 1, count }
}

fn hits(address: u64, count: u64) -> Leg {
    Leg::Hits {
        breaks: vec![address],
        watches: Vec::new(),
        count,
    }
}

fn place(legs: &[Leg]) -> Place {
    Place {
        moment: Moment::default(),
        legs: legs.to_vec(),
    }
}

fn breaks(addresses: &[u64]) -> Marks {
    Marks {
        breaks: addresses.to_vec(),
        watches: Vec::new(),
    }
}

/// Walks to a place; whether it was reached, and the observations on the path.
fn walks(
    it: &mut Session<'_>,
    to: &Place,
    marks: &Marks,
    steps: Option<u32>,
) -> (bool, Vec<(Place, Seen)>) {
    let mut all = Vec::new();
    let walk = Walk { to, marks, steps };
    let found = it.walk(&walk, &mut |place, seen| all.push((place.clone(), seen)));
    (found.expect("it is supervised"), all)
}

fn byte_at(stopped: &Stopped, address: u64) -> u8 {
    let mut byte = [0];
    let memory = crate::guest::memory::Memory(stopped.pid);
    memory.read(address, &mut byte).expect("its code");
    byte[0]
}

/// A breakpoint under the instruction is taken away for the step, and is there again (CC).
#[test]
fn a_thread_executes_one_instruction() {
    session_at(&LOOP, |it, stopped, at| {
        let pid = stopped.pid.as_raw();
        let mut seen = 0;
        let mut step = |it: &mut Session<'_>, thread| {
            let done = it.single_step(thread, &mut |_, _| seen += 1);
            (
                done.expect("it is supervised"),
                stopped.registers().rip - at,
            )
        };
        assert_eq!(step(it, 1), (true, 1));
        assert_eq!((it.current, step_of(it.supervisor())), (Some(pid), None));
        assert_eq!(it.place(), place(&[steps(1)]));
        it.supervisor().add_break_when_possible(at + 1);
        assert_eq!(step(it, 1), (true, 2));
        assert!(it.supervisor().has_break(at + 1));
        assert_eq!(byte_at(stopped, at + 1), 0xCC);
        assert_eq!(it.place(), place(&[steps(2)]));
        assert_eq!(step(it, 9), (false, 2), "no such thread");
        it.current = None;
        it.step_held(pid).expect("it is supervised");
        assert_eq!(stopped.registers().rip, at + 3);
        assert_eq!((it.current, step_of(it.supervisor())), (Some(pid), None));
        assert_eq!(seen, 0);
    });
}

/// `mov edi, 3; mov eax, 231; syscall`: exit_group(3).
#[test]
fn a_thread_that_ends_executes_no_instruction() {
    let code = [0xBF, 3, 0, 0, 0, 0xB8, 0xE7, 0, 0, 0, 0x0F, 0x05];
    session_at(&code, |it, _, _| {
        for expected in [true, true, false] {
            let done = it.single_step(1, &mut |_, _| {});
            assert_eq!(done.expect("it is supervised"), expected);
        }
    });
}

/// A held thread at a breakpoint executes the instruction under it; elsewhere it stays.
#[test]
fn a_thread_leaves_its_breakpoint() {
    session_at(&LOOP, |it, stopped, at| {
        it.supervisor().add_break_when_possible(at + 1);
        it.leave_break(None).expect("it is supervised");
        assert_eq!(stopped.registers().rip, at);
        it.supervisor().add_break_when_possible(at);
        it.leave_break(None).expect("it is supervised");
        assert_eq!(
            (stopped.registers().rip, byte_at(stopped, at)),
            (at + 1, 0xCC)
        );
        assert_eq!(step_of(it.supervisor()), None);
        it.leave_break(Some(1)).expect("it is supervised");
        assert_eq!(stopped.registers().rip, at + 2);
        let pid = stopped.pid.as_raw();
        assert_eq!(step_of(it.supervisor()), Some((pid, 0..u64::MAX)));
        it.supervisor().add_break_when_possible(at + 2);
        crate::guest::supervisor::tests::lets_go(it.supervisor());
        it.leave_break(None).expect("it is supervised");
        assert_eq!(stopped.registers().rip, at + 2, "no thread is held");
    });
}

/// By hand: breakpoints at the second and third instruction of a loop. The second hit of the third
/// is the place; before it the second instruction was hit twice.
#[test]
fn a_walk_reports_what_it_comes_by() {
    session_at(&LOOP, |it, stopped, at| {
        let to = place(&[hits(at + 2, 2)]);
        let (found, seen) = walks(it, &to, &breaks(&[at + 1]), None);
        assert!(found);
        let second = |count| place(&[hits(at + 1, count)]);
        let kinds: Vec<Seen> = seen.iter().map(|(_, seen)| *seen).collect();
        assert_eq!(kinds, [Seen::Break, Seen::Break]);
        assert_eq!(seen[0].0, second(1));
        assert_eq!(stopped.registers().rip, at + 2);
        assert_eq!(it.current, Some(stopped.pid.as_raw()));
        assert!(it.supervisor().has_break(at + 1) && !it.supervisor().has_break(at + 2));
    });
    // A breakpoint of the debugger at the end of a part of the path is reported, except for the
    // last part, which is the place itself.
    session_at(&LOOP, |it, stopped, at| {
        let to = place(&[hits(at + 2, 1), steps(3)]);
        let (found, seen) = walks(it, &to, &breaks(&[at + 2]), None);
        assert_eq!((found, seen.len()), (true, 1));
        assert_eq!(seen[0], (place(&[hits(at + 2, 1)]), Seen::Break));
        assert_eq!(stopped.registers().rip, at, "two nop and the jump");
        assert_eq!(it.place(), place(&[hits(at + 2, 1), steps(3)]));
        let to = place(&[hits(at + 2, 1)]);
        let (found, seen) = walks(it, &to, &breaks(&[at + 2]), None);
        assert_eq!((found, seen), (true, Vec::new()));
    });
}

/// Instructions are counted on the path, and the last one is kept.
#[test]
fn a_walk_may_be_one_of_single_steps() {
    session_at(&LOOP, |it, stopped, at| {
        let to = place(&[hits(at + 2, 1)]);
        assert_eq!(walks(it, &to, &breaks(&[]), Some(1)), (true, Vec::new()));
        assert_eq!(stopped.registers().rip, at + 2);
        let debugging = it.supervisor().debugging().expect("begun");
        assert_eq!(debugging.last_step_of(1), Some(&place(&[steps(2)])));
        // There are not that many.
        debugging.limit_steps(3);
        let to = place(&[hits(at + 9, 1)]);
        assert_eq!(walks(it, &to, &breaks(&[]), Some(1)), (false, Vec::new()));
    });
}

/// SIGURG and SIGWINCH do nothing to a program.
#[test]
fn a_walk_counts_signals() {
    use nix::sys::signal::{Signal, kill};

    session_at(&LOOP, |it, stopped, at| {
        for signal in [Signal::SIGURG, Signal::SIGWINCH] {
            kill(stopped.pid, signal).expect("ours");
        }
        let to = place(&[Leg::Signals(2)]);
        assert_eq!(walks(it, &to, &breaks(&[]), None), (true, Vec::new()));
        assert_eq!(it.place(), to);
        let rip = stopped.registers().rip;
        assert!((at..at + 6).contains(&rip));
    });
}

/// `mov [rsp], al` is 88 04 24. The trap of watched memory comes behind the instruction.
#[test]
fn a_walk_reports_changes_of_memory() {
    let code = [0x90, 0x88, 0x04, 0x24, 0x90, 0x90, 0xEB, 0xF8];
    session_at(&code, |it, stopped, at| {
        let watch = Watchpoint {
            address: stopped.registers().rsp & !7,
            len: 8,
            reads: false,
        };
        let marks = Marks {
            breaks: Vec::new(),
            watches: vec![watch],
        };
        let to = place(&[hits(at + 5, 2)]);
        let (found, seen) = walks(it, &to, &marks, None);
        let kinds: Vec<Seen> = seen.iter().map(|(_, seen)| *seen).collect();
        assert!(found);
        assert_eq!(kinds, [Seen::Watch(watch.address); 2]);
        assert!(seen[0].0.is_at_watch());
        // A path may be one of accesses.
        let touched = Leg::Hits {
            breaks: Vec::new(),
            watches: vec![watch],
            count: 3,
        };
        let to = place(&[touched]);
        assert_eq!(walks(it, &to, &breaks(&[]), None), (true, Vec::new()));
        assert_eq!(stopped.registers().rip, at + 4);
        let debugging = it.supervisor().debugging().expect("begun");
        assert!(debugging.watches().is_empty());
        let single = |it: &mut Session<'_>| {
            let mut all = Vec::new();
            let done = it.single_step(1, &mut |_, seen| all.push(seen));
            (done.expect("it is supervised"), all)
        };
        it.set_marks(&marks);
        for expected in [at + 5, at + 6, at, at + 1] {
            assert_eq!(single(it), (true, Vec::new()));
            assert_eq!(stopped.registers().rip, expected);
        }
        assert_eq!(single(it), (true, vec![Seen::Watch(watch.address)]));
    });
}

/// While no thread can run, each turn is one step of time, by 10 ms.
#[test]
fn a_session_runs_to_a_time() {
    session(|it, _| {
        let leaps = |it: &mut Session<'_>| it.place().moment.leaps;
        let at = Instant::from_millis;
        let goal = Goal::Time(at(25));
        assert!(it.reach_goal(goal).expect("it is supervised"));
        let (now, first) = (it.trial().now(), leaps(it));
        assert!(now >= at(25) && first > 0, "{now}");
        let moment = |leaps| Moment { calls: 0, leaps };
        let goal = Goal::Moment(moment(first + 2));
        assert!(it.reach_goal(goal).expect("it is supervised"));
        assert_eq!(leaps(it), first + 2);
        let mut to = place(&[]);
        to.moment = moment(first + 5);
        for _ in 0..2 {
            assert_eq!(walks(it, &to, &breaks(&[]), None), (true, Vec::new()));
            assert_eq!(leaps(it), first + 5);
        }
        it.goes_on = &|| false;
        let goal = Goal::Time(at(500));
        assert!(!it.reach_goal(goal).expect("it is supervised"));
        assert_eq!(leaps(it), first + 5);
        to.moment = moment(first + 9);
        assert_eq!(walks(it, &to, &breaks(&[]), None), (false, Vec::new()));
        it.goes_on = &|| true;
        // The run is over after 3 s.
        let goal = Goal::Time(at(5_000));
        assert!(!it.reach_goal(goal).expect("it is supervised"));
    });
}

#[test]
fn the_current_thread_is_that_of_the_last_stop() {
    session(|it, stopped| {
        for (stop, expected) in [
            (Stop::Loaded(5), Some(5)),
            (Stop::Break(6), Some(6)),
            (Stop::Watch(7, 1), Some(7)),
            (Stop::Step(8), Some(8)),
            (Stop::Signal(9, 1), Some(9)),
            (Stop::Ended(3), Some(9)),
            (Stop::Reached(None), Some(9)),
            (Stop::Reached(Some(4)), Some(4)),
        ] {
            it.note_current(stop);
            assert_eq!(it.current, expected, "{stop:?}");
        }
        let pid = stopped.pid.as_raw();
        it.set_step_of(1);
        assert_eq!(step_of(it.supervisor()), Some((pid, 0..u64::MAX)));
        it.set_step_of(9);
        assert_eq!(step_of(it.supervisor()), None);
        assert_eq!((it.tid_by_index(1), it.tid_by_index(9)), (Some(pid), None));
        assert_eq!(it.instruction_of(pid), stopped.registers().rip);
        assert_eq!(it.instruction_of(-7), 0);
    });
}

/// A place that another run did not reach is reported, unless the session is at its end.
#[test]
fn a_missed_place_is_reported() {
    session(|it, _| {
        let here = it.place();
        let mut elsewhere = here.clone();
        elsewhere.moment.calls += 1;
        let missed = |it: &mut Session<'_>, found, place: &Place| {
            let is_it = it.is_as_before(found, place);
            (is_it, core::mem::take(&mut it.has_missed))
        };
        assert_eq!(missed(it, true, &here), (true, false));
        assert_eq!(missed(it, false, &here), (false, true));
        assert_eq!(missed(it, true, &elsewhere), (false, true));
        it.is_broken_off = true;
        assert_eq!(missed(it, false, &here), (false, false));
        // A motion that is broken off does not start the program again.
        assert!(!it.load_again().expect("nothing is started"));
        assert!(!it.go_to(&here).expect("nothing is started"));
        let at = Instant::from_millis(1);
        assert!(!it.go_to_time(at).expect("nothing is started"));
        it.is_broken_off = false;
        it.goes_on = &|| false;
        assert_eq!(missed(it, false, &here), (false, false));
        // A step back over a step needs no run.
        let stepped = place(&[hits(8, 1), steps(3)]);
        let before = it.predecessor(&stepped, 1).expect("nothing is started");
        assert_eq!(before, Some(place(&[hits(8, 1), steps(2)])));
        it.is_broken_off = true;
        let before = it.predecessor(&stepped, 2).expect("nothing is started");
        assert_eq!((before, it.has_missed), (None, false));
    });
}
