//! Sessions with a program that can be started again: each run executes the same instructions.

use super::super::failure::First;
use super::*;
use crate::guest::tests::program::{DATA, ENTRY, ZEROS, call, exit, starts};
use crate::guest::trial::tests::trial_of_program;
use nix::libc;

/// Runs `test` in a session of the program with these data and this code, and its messages.
fn plays(data: &[u8], code: &[u8], test: impl FnOnce(&mut Session<'_>, &RefCell<Vec<String>>)) {
    let folders = RefCell::new(Vec::new());
    let mut start = || {
        let mut bench = Bench::new();
        let process = starts(&mut bench, data, code);
        let (trial, folder) = trial_of_program(bench, process.pid.as_raw());
        // The trial ends it.
        core::mem::forget(process);
        folders.borrow_mut().push(folder);
        Some(trial)
    };
    let said = RefCell::new(Vec::new());
    let mut session = Session {
        trial: None,
        start: &mut start,
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
        wanted: Some(Wanted::NoShell),
        is_signal_told: false,
        has_missed: false,
        ear: None,
        is_broken_off: false,
        computing: None,
        missed: None,
        steps_back: 0,
    };
    test(&mut session, &said);
    if let Some(trial) = session.trial.take() {
        trial.abandon();
    }
}

/// Address of the next instruction, and the counter of loops.
fn stands(it: &Session<'_>) -> (u64, u64) {
    let current = it.current.expect("it has stopped");
    let (own, _) = it
        .supervisor_ref()
        .registers_of(current)
        .expect("it stands");
    (own.rip - ENTRY, own.rcx)
}

fn back(it: &mut Session<'_>, back: Back) -> Option<MultiThreadStopReason<u64>> {
    it.go_back(back).expect("it is supervised")
}

fn trap() -> Option<MultiThreadStopReason<u64>> {
    Some(MultiThreadStopReason::SignalWithThread {
        tid: tid(1),
        signal: GdbSignal::SIGTRAP,
    })
}

fn at_start() -> Option<MultiThreadStopReason<u64>> {
    Some(MultiThreadStopReason::ReplayLog {
        tid: Some(tid(1)),
        pos: gdbstub::target::ext::base::reverse_exec::ReplayLogPosition::Begin,
    })
}

fn steps_of_first(count: u64) -> Leg {
    Leg::Steps { thread: 0, count }
}

/// Eight `nop`, and the end.
fn nops() -> Vec<u8> {
    [vec![0x90; 8], exit(0)].concat()
}

#[test]
fn a_program_is_loaded_at_its_entry() {
    plays(&[], &nops(), |it, _| {
        for (wanted, expected) in [
            (Wanted::NoShell, true),
            (Wanted::Name("program".to_owned()), true),
            (Wanted::Load(1), true),
            (Wanted::Name("other".to_owned()), false),
            (Wanted::Load(2), false),
            (Wanted::Nothing, false),
        ] {
            it.wanted = Some(wanted.clone());
            let is_loaded = it.load_again().expect("it is supervised");
            assert_eq!(is_loaded, expected, "{wanted:?}");
            if is_loaded {
                assert_eq!(stands(it).0, 0);
                assert_eq!(it.place(), place(&[]));
            }
        }
        it.goes_on = &|| false;
        it.wanted = Some(Wanted::NoShell);
        assert!(!it.load_again().expect("it is supervised"));
    });
}

/// Three steps forward, and back one by one up to the start.
#[test]
fn a_thread_goes_back_by_single_steps() {
    plays(&[], &nops(), |it, _| {
        assert!(it.load_again().expect("it is supervised"));
        for _ in 0..3 {
            let done = it.single_step(0, &mut |_, _| {});
            assert!(done.expect("it is supervised"));
        }
        for expected in [2, 1, 0] {
            assert_eq!(back(it, Back::Step(tid(1))), trap());
            assert_eq!(stands(it).0, expected);
        }
        assert_eq!(back(it, Back::Step(tid(1))), at_start());
        assert_eq!(stands(it).0, 0);
        assert!(!it.has_missed);
        // A place that a run reaches again.
        let there = place(&[steps_of_first(5)]);
        assert!(it.go_to(&there).expect("it is supervised"));
        assert_eq!((stands(it).0, it.place()), (5, there));
        assert!(
            it.arrive(&place(&[steps_of_first(2)]))
                .expect("it is supervised")
        );
        // Past its end there is none.
        let never = place(&[steps_of_first(50)]);
        assert!(!it.arrive(&never).expect("it is supervised"));
        assert!(it.has_missed);
    });
}

/// `mov ecx, 3`; then `nop; dec ecx; jnz -5`: the `nop` is at 5.
fn three_times() -> Vec<u8> {
    let code = [0xB9, 3, 0, 0, 0, 0x90, 0xFF, 0xC9, 0x75, 0xFB];
    [&code[..], &exit(0)].concat()
}

/// By hand: the breakpoint is hit with 3, 2 and 1 rounds left. Back from the third hit come the
/// second, the first and the start.
#[test]
fn a_program_goes_back_to_its_last_breakpoint() {
    plays(&[], &three_times(), |it, _| {
        assert!(it.load_again().expect("it is supervised"));
        let at = ENTRY + 5;
        let to = place(&[hits(at, 3)]);
        assert_eq!(walks(it, &to, &breaks(&[at]), None).1.len(), 2);
        assert_eq!(stands(it), (5, 1));
        for rest in [2, 3] {
            let reason = back(it, Back::Continue);
            assert_eq!(reason, Some(MultiThreadStopReason::SwBreak(tid(1))));
            assert_eq!(stands(it), (5, rest));
            assert!(it.supervisor().has_break(at), "it is the debugger's");
        }
        assert_eq!(back(it, Back::Continue), at_start());
        assert_eq!(stands(it).0, 0);
        // Steps back over a breakpoint come by the instructions before it.
        let to = place(&[hits(at, 2)]);
        assert!(walks(it, &to, &breaks(&[at]), None).0);
        for (expected, rest) in [(8, 2), (6, 3), (5, 3)] {
            assert_eq!(back(it, Back::Step(tid(1))), trap());
            assert_eq!(stands(it), (expected, rest));
        }
        // Without a breakpoint it is the start.
        it.set_marks(&Marks::default());
        assert_eq!(back(it, Back::Continue), at_start());
        assert!(!it.has_missed);
    });
}

/// `mov ecx, 3`; then `mov [ZEROS], ecx; dec ecx; jnz -11`: the write is at 5.
fn writes_three_times() -> Vec<u8> {
    let mut code = vec![0xB9, 3, 0, 0, 0, 0x89, 0x0C, 0x25];
    code.extend(ZEROS.to_le_bytes());
    code.extend([0xFF, 0xC9, 0x75, 0xF5]);
    [code, exit(0)].concat()
}

/// By hand: back from the last write (1) come the second (2) and the first (3), each before it was
/// executed.
#[test]
fn a_program_goes_back_to_the_last_change_of_memory() {
    plays(&[], &writes_three_times(), |it, _| {
        assert!(it.load_again().expect("it is supervised"));
        let (address, kind) = (u64::from(ZEROS), WatchKind::Write);
        let is_set = it.add_hw_watchpoint(address, 4, kind);
        assert!(is_set.is_ok_and(|done| done));
        let watches = it
            .supervisor()
            .debugging()
            .expect("begun")
            .watches()
            .to_vec();
        let marks = Marks {
            breaks: Vec::new(),
            watches: watches.clone(),
        };
        let touched = |count| Leg::Hits {
            breaks: Vec::new(),
            watches: watches.clone(),
            count,
        };
        let (found, seen) = walks(it, &place(&[touched(3)]), &marks, None);
        assert_eq!((found, seen.len()), (true, 2));
        assert_eq!(stands(it), (12, 1));
        for rest in [2, 3] {
            let reason = MultiThreadStopReason::Watch {
                tid: tid(1),
                kind,
                addr: address,
            };
            assert_eq!(back(it, Back::Continue), Some(reason));
            assert_eq!(stands(it), (5, rest));
        }
        assert_eq!(back(it, Back::Continue), at_start());
    });
}

/// Calls are counted; `clock_getres` is one at which a program stops. Between the calls is `nop`.
fn calls() -> Vec<u8> {
    let mut code = Vec::new();
    for _ in 0..4 {
        code.extend(call(libc::SYS_clock_getres, &[1, 0]));
        code.extend([0x90, 0x90]);
    }
    [code, exit(0)].concat()
}

/// By hand: three moves of 5 bytes, the call of 2 and two `nop` are 19 bytes. Behind the fourth
/// call, at 74, one step back leads to the last move before it, at 72, then to the ones before.
#[test]
fn a_thread_goes_back_over_a_call() {
    plays(&[], &calls(), |it, _| {
        assert!(it.load_again().expect("it is supervised"));
        let at = ENTRY + 75;
        let mut to = place(&[hits(at, 1)]);
        to.moment.calls = 4;
        assert!(walks(it, &to, &breaks(&[at]), None).0);
        assert_eq!((stands(it).0, it.place()), (75, to));
        it.set_marks(&Marks::default());
        for expected in [74, 72, 67, 62, 57, 56, 55, 53] {
            assert_eq!(back(it, Back::Step(tid(1))), trap());
            assert_eq!(stands(it).0, expected);
        }
        assert!(!it.has_missed);
        // The first moment at or after the third call: the thread stands before it.
        let moment = Moment { calls: 3, leaps: 0 };
        assert!(it.go_to_moment(moment).expect("it is supervised"));
        assert_eq!(it.place().moment, moment);
        assert_eq!(stands(it).0, 53);
    });
}

/// Five times 10 ms of sleep.
fn sleeps() -> (Vec<u8>, Vec<u8>) {
    let time = [0_u64, 10_000_000].map(u64::to_le_bytes);
    let sleep = call(libc::SYS_nanosleep, &[DATA, 0]);
    let code = [sleep.repeat(5), exit(5)].concat();
    (time.as_flattened().to_vec(), code)
}

#[test]
fn a_program_goes_back_to_a_time() {
    let (data, code) = sleeps();
    plays(&data, &code, |it, _| {
        let at = Instant::from_millis;
        assert!(it.go_to_time(at(45)).expect("it is supervised"));
        let late = it.trial().now();
        assert!(late >= at(45), "{late}");
        it.back_to = Some(at(25));
        assert_eq!(back(it, Back::Continue), trap());
        let early = it.trial().now();
        assert!(early >= at(25) && early < at(36), "{early}");
        assert_eq!(it.back_to, None);
        // The program ends after 50 ms.
        it.back_to = Some(at(900_000));
        assert_eq!(back(it, Back::Continue), at_start());
        assert!(!it.go_to_time(at(900_000)).expect("it is supervised"));
    });
}

/// A session begins where its options say; messages name the reason if the place is not reached.
#[test]
fn a_session_begins_at_its_place() {
    let (data, code) = sleeps();
    let begins = |settings: DebugSettings| {
        let mut found = (false, 0, None);
        plays(&data, &code, |it, _| {
            it.settings = settings.clone();
            let is_there = it.run_to_start().expect("it is supervised");
            let now = it.trial.as_ref().map_or(0, |trial| trial.now().as_nanos());
            found = (is_there, now, it.missed.clone());
        });
        found
    };
    let at = |millis: u64| DebugSettings {
        at: Some(Duration::from_millis(millis)),
        program: Some("program".to_owned()),
        ..DebugSettings::default()
    };
    let named = |name: &str| DebugSettings {
        program: Some(name.to_owned()),
        ..DebugSettings::default()
    };
    let (is_there, now, missed) = begins(named("program"));
    assert_eq!((is_there, now, missed), (true, 0, None));
    let (is_there, _, missed) = begins(DebugSettings::default());
    assert_eq!((is_there, missed), (true, None), "it is no shell");
    let (is_there, now, missed) = begins(at(25));
    assert_eq!((is_there, missed), (true, None));
    assert!((25_000_000..36_000_000).contains(&now), "{now}");
    let (is_there, _, missed) = begins(at(900_000));
    let text = missed.expect("it ended before");
    assert!(
        !is_there && text.starts_with("--at: the run was over at 0.0"),
        "{text}"
    );
    let (is_there, _, missed) = begins(named("robot"));
    let text = missed.expect("there is none");
    let expected = "--program robot: no program of that name that can be debugged was started; the \
                    command started program: expected";
    assert!(!is_there && text.starts_with(expected), "{text}");
}

/// A program that ends with a code of its own fails; its last call is `exit_group`, the sixth.
#[test]
fn a_session_begins_before_a_failure() {
    let (data, code) = sleeps();
    plays(&data, &code, |it, said| {
        it.settings.on_fail = true;
        it.settings.program = Some("program".to_owned());
        assert!(it.run_to_start().expect("it is supervised"));
        let text = said.borrow().join("\n");
        assert!(text.starts_with("program-alive fails at "), "{text}");
        assert_eq!(it.place().moment.calls, 6);
        assert!(it.first.is_some());
    });
}

/// `ud2` (0F 0B) is SIGILL. SIGWINCH (28) before it is the first signal.
#[test]
fn a_session_begins_at_the_signal_that_ends_the_program() {
    let pid = [call(libc::SYS_getpid, &[]), vec![0x89, 0xC7]].concat();
    // `mov edi, eax; mov esi, 28; mov eax, 62; syscall`.
    let kill = [0xBE, 28, 0, 0, 0, 0xB8, 62, 0, 0, 0, 0x0F, 0x05];
    let code = [&pid[..], &kill, &[0x90, 0x0F, 0x0B]].concat();
    plays(&[], &code, |it, said| {
        it.settings.on_fail = true;
        it.settings.program = Some("program".to_owned());
        assert!(it.run_to_start().expect("it is supervised"));
        let text = said.borrow().join("\n");
        assert!(text.starts_with("program-alive fails at "), "{text}");
        let end = u64::try_from(code.len()).expect("short") - 2;
        assert_eq!(stands(it).0, end, "at the instruction");
        // The first of the two is another place.
        assert!(it.load_again().expect("it is supervised"));
        assert!(it.reach_signal(1).expect("it is supervised"));
        assert_eq!(stands(it).0, end - 1);
        assert!(it.load_again().expect("it is supervised"));
        assert!(!it.reach_signal(3).expect("it is supervised"));
    });
}

/// A run that passes has no place to stop.
#[test]
fn a_program_that_stays_up_to_the_end_does_not_fail() {
    let sleep = call(libc::SYS_nanosleep, &[DATA, 0]);
    let time = [9_u64, 0].map(u64::to_le_bytes);
    let code = [sleep, exit(0)].concat();
    plays(time.as_flattened(), &code, |it, _| {
        assert!(it.load_again().expect("it is supervised"));
        // The bench needs no port, so that it only has to stay alive.
        let first = it.find_failure().expect("it is supervised");
        let played = it.first.as_ref().expect("it was judged");
        let failed: Vec<&str> = played
            .outcome
            .checks
            .iter()
            .filter(|check| check.status == engine::run::check::Status::Fail)
            .map(|check| check.name.as_str())
            .collect();
        let has_passed = matches!(first, First::Passed);
        assert_eq!(has_passed, failed.is_empty(), "{failed:?}");
        assert!(!failed.contains(&"program-alive"), "{failed:?}");
    });
}

/// What becomes of the run when a debugger leaves.
#[test]
fn a_run_is_judged_or_cut_when_the_debugger_leaves() {
    let (data, code) = sleeps();
    let ends = |leave: Leave, goes_on: &dyn Fn() -> bool, is_missed: bool| {
        let mut ended = String::new();
        let folders = RefCell::new(Vec::new());
        let mut start = || {
            let mut bench = Bench::new();
            let process = starts(&mut bench, &data, &code);
            let (trial, folder) = trial_of_program(bench, process.pid.as_raw());
            core::mem::forget(process);
            folders.borrow_mut().push(folder);
            Some(trial)
        };
        let trial = start();
        let session = Session {
            trial,
            start: &mut start,
            settings: DebugSettings::default(),
            goes_on,
            say: &|_| {},
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
            missed: is_missed.then(|| "not there".to_owned()),
            steps_back: 0,
        };
        let debugged = session.conclude(Ok(leave)).expect("it is supervised");
        let ran = |played: &Played| (played.outcome.ran.as_millis() >= 50).to_string();
        match debugged {
            Debugged::Judged(played) => ended.push_str(&format!("judged {}", ran(&played))),
            Debugged::Killed(played) => ended.push_str(&format!("killed {}", ran(&played))),
            Debugged::Cut(played) => ended.push_str(&format!("cut {}", ran(&played))),
            Debugged::NotReached(why) => ended.push_str(&why),
            Debugged::NotStarted => ended.push_str("not started"),
        }
        ended
    };
    let always: &dyn Fn() -> bool = &|| true;
    assert_eq!(ends(Leave::Detached, always, false), "judged true");
    assert_eq!(ends(Leave::Ended, always, false), "judged true");
    assert_eq!(ends(Leave::Killed, always, false), "killed false");
    assert_eq!(ends(Leave::Cut, always, false), "cut false");
    assert_eq!(ends(Leave::Detached, &|| false, false), "cut false");
    assert_eq!(ends(Leave::Detached, always, true), "not there");
}
