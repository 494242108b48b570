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

/// A debugger at the other end of the connection.
struct Client(std::io::BufReader<std::net::TcpStream>);

impl Client {
    fn connect(port: u16) -> Self {
        let stream = std::net::TcpStream::connect(("127.0.0.1", port)).expect("it listens");
        Self(std::io::BufReader::new(stream))
    }

    /// The answer to a packet of the remote protocol, behind its text for the user.
    fn asks(&mut self, text: &str) -> String {
        use std::io::Write as _;

        let sum = text.bytes().fold(0_u8, u8::wrapping_add);
        write!(self.0.get_mut(), "${text}#{sum:02x}").expect("it is there");
        let mut shown = String::new();
        loop {
            let answer = self.packet();
            match answer.strip_prefix('O') {
                Some(more) if more != "K" => shown += &in_text(more),
                _ => return shown + &answer,
            }
        }
    }

    fn packet(&mut self) -> String {
        use std::io::{BufRead as _, Read as _, Write as _};

        let (mut before, mut text, mut sum) = (Vec::new(), Vec::new(), [0; 2]);
        self.0.read_until(b'$', &mut before).expect("it is there");
        self.0.read_until(b'#', &mut text).expect("it is there");
        self.0.read_exact(&mut sum).expect("it is there");
        self.0.get_mut().write_all(b"+").expect("it is there");
        text.pop();
        // Run lengths: `*` and a character for the number of further copies, from 29 on.
        let mut plain = String::new();
        let mut bytes = text.into_iter();
        while let Some(byte) = bytes.next() {
            match (byte, plain.chars().last()) {
                (b'*', Some(last)) => {
                    let count = bytes.next().expect("a count") - 29;
                    plain.extend(core::iter::repeat_n(last, count.into()));
                }
                _ => plain.push(byte.into()),
            }
        }
        plain
    }
}

/// The text of its hexadecimal bytes.
fn in_text(hex: &str) -> String {
    let bytes = hex.as_bytes().chunks_exact(2);
    let byte = |pair| u8::from_str_radix(core::str::from_utf8(pair).expect("ASCII"), 16);
    let bytes: Vec<u8> = bytes.map(|pair| byte(pair).expect("hex")).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Debugs a program; a client acts as `script` says. What becomes of it.
fn debugs_by(code: &[u8], script: impl FnOnce(&mut Client) + Send + 'static) -> Debugged {
    use core::sync::atomic::{AtomicBool, Ordering};
    use std::sync::Arc;

    let folders = RefCell::new(Vec::new());
    let mut start = || {
        let mut bench = Bench::new();
        let process = starts(&mut bench, &[], code);
        let (trial, folder) = trial_of_program(bench, process.pid.as_raw());
        core::mem::forget(process);
        folders.borrow_mut().push(folder);
        Some(trial)
    };
    let has_failed = Arc::new(AtomicBool::new(false));
    let (script, client) = (RefCell::new(Some(script)), RefCell::new(None));
    let say = |text: &str| {
        let port = text.rsplit_once("target remote :").map(|(_, port)| port);
        let port = port.and_then(|port| port.trim_end_matches('\'').parse().ok());
        let (Some(port), Some(script)) = (port, script.borrow_mut().take()) else {
            return;
        };
        let has_failed = Arc::clone(&has_failed);
        *client.borrow_mut() = Some(std::thread::spawn(move || {
            let run = core::panic::AssertUnwindSafe(|| script(&mut Client::connect(port)));
            let done = std::panic::catch_unwind(run);
            has_failed.store(done.is_err(), Ordering::Relaxed);
        }));
    };
    let debugged = debug(
        DebugSettings {
            program: Some("program".to_owned()),
            ..DebugSettings::default()
        },
        Surroundings {
            start: &mut start,
            goes_on: &|| !has_failed.load(Ordering::Relaxed),
            say: &say,
        },
    );
    let client = client.borrow_mut().take().expect("it was invited");
    client.join().expect("its panic is caught");
    assert!(!has_failed.load(Ordering::Relaxed), "its message is above");
    debugged.expect("it is supervised")
}

/// GDB's manual, "Remote Protocol": what a stub supports, and the answers to packets. Thread 1 is
/// the first one, SIGTRAP 5.
#[test]
fn a_debugger_steps_forward_and_back() {
    let debugged = debugs_by(&three_times(), |gdb| {
        let asked = "qSupported:swbreak+;hwbreak+;fork-events+;vfork-events+";
        let features = gdb.asks(asked);
        for name in ["ReverseContinue+", "ReverseStep+", "swbreak+", "hwbreak+"] {
            assert!(features.contains(name), "{features}");
        }
        for name in [
            "qXfer:auxv:read+",
            "qXfer:exec-file:read+",
            "vContSupported+",
        ] {
            assert!(features.contains(name), "{features}");
        }
        assert!(!features.contains("fork-events"), "{features}");
        assert!(gdb.asks("?").starts_with("T05"));
        assert_eq!(gdb.asks("vCont?"), "vCont;c;C;s;S;r");
        let file = gdb.asks("qXfer:exec-file:read::0,fff");
        assert!(file.ends_with("/program"), "{file}");
        assert!(gdb.asks("qXfer:auxv:read::0,10").starts_with('m'));
        let at = ENTRY + 5;
        assert_eq!(gdb.asks(&format!("m{at:x},5")), "90ffc975fb");
        assert_eq!(gdb.asks(&format!("Z0,{at:x},1")), "OK");
        let stop = gdb.asks("vCont;c");
        assert!(
            stop.starts_with("T05") && stop.contains("swbreak:"),
            "{stop}"
        );
        assert_eq!(gdb.asks(&format!("z0,{at:x},1")), "OK");
        // `nop; dec ecx`, and back.
        // All registers; the instruction pointer is behind 16 of them.
        let place = |gdb: &mut Client| gdb.asks("g")[256..272].to_owned();
        let here = place(gdb);
        for _ in 0..2 {
            let stop = gdb.asks("vCont;s:1");
            assert!(stop.starts_with("T05"), "{stop}");
        }
        assert_ne!(place(gdb), here);
        for _ in 0..2 {
            assert!(gdb.asks("bs").starts_with("T05"));
        }
        assert_eq!(place(gdb), here);
        // A range of instructions: up to the first one outside of it.
        let range = format!("vCont;r{:x},{:x}:1", at, at + 3);
        assert!(gdb.asks(&range).starts_with("T05"));
        let stop = gdb.asks("bc");
        assert!(stop.contains("replaylog:begin"), "{stop}");
        let time = gdb.asks("qRcmd,74696d65");
        assert!(time.starts_with("rig 0.000000 s, program "), "{time}");
        assert!(in_text(&gdb.asks("qThreadExtraInfo,1")).starts_with("program ("));
        assert_eq!(gdb.asks(&format!("Z2,{ZEROS:x},4")), "OK");
        assert_eq!(gdb.asks(&format!("z2,{ZEROS:x},4")), "OK");
        assert_eq!(gdb.asks("D"), "OK");
    });
    assert!(matches!(debugged, Debugged::Judged(_)));
}

/// A run is over at the end of its program: the debugger gets its code, 3, or its signal.
#[test]
fn a_debugger_sees_the_end_of_a_program() {
    let debugged = debugs_by(&exit(3), |gdb| {
        assert!(gdb.asks("?").starts_with("T05"));
        assert_eq!(gdb.asks("vCont;c"), "W03");
    });
    assert!(matches!(debugged, Debugged::Judged(_)));
    // `ud2`: SIGILL is 4. It is told at the instruction, and ends the program behind it.
    let debugged = debugs_by(&[0x90, 0x0F, 0x0B], |gdb| {
        assert!(gdb.asks("?").starts_with("T05"));
        let stop = gdb.asks("vCont;c");
        assert!(stop.starts_with("T04"), "{stop}");
        assert_eq!(gdb.asks("vCont;C04:1"), "X04");
    });
    assert!(matches!(debugged, Debugged::Judged(_)));
    let debugged = debugs_by(&nops(), |gdb| {
        assert!(gdb.asks("?").starts_with("T05"));
        assert_eq!(gdb.asks("vKill;1"), "OK");
    });
    assert!(matches!(debugged, Debugged::Killed(_)));
}

/// A place that the program does not reach has no predecessor, and the debugger is told.
#[test]
fn a_place_that_is_not_reached_is_missed() {
    plays(&[], &nops(), |it, _| {
        let mut far = place(&[hits(ENTRY, 1)]);
        far.moment.calls = 100;
        let before = it.predecessor(&far, 0).expect("it is supervised");
        assert!(before.is_none() && core::mem::take(&mut it.has_missed));
        it.goes_on = &|| false;
        let before = it.predecessor(&far, 0).expect("it is supervised");
        assert!(before.is_none() && !it.has_missed);
    });
}

/// `mov [ZEROS], ecx` twice: there is no instruction before the first change.
#[test]
fn the_first_instruction_may_change_memory() {
    let mut write = vec![0x89, 0x0C, 0x25];
    write.extend(ZEROS.to_le_bytes());
    let code = [write.clone(), write, exit(0)].concat();
    plays(&[], &code, |it, _| {
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
        let second = place(&[Leg::Hits {
            breaks: Vec::new(),
            watches,
            count: 2,
        }]);
        assert!(walks(it, &second, &marks, None).0);
        let reason = MultiThreadStopReason::Watch {
            tid: tid(1),
            kind,
            addr: address,
        };
        assert_eq!(back(it, Back::Continue), Some(reason));
        assert_eq!(back(it, Back::Continue), at_start());
    });
}
