//! A session whose debugged process stands, and which no debugger has connected to.

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

use super::*;
use crate::guest::supervisor::tests::{Bench, debugs};
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
        let step = |it: &mut Session<'_>| crate::guest::supervisor::tests::step_of(it.supervisor());
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
