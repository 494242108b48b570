//! A trial of programs that were never started: the supervisor's guest is this process.

use super::*;
use crate::exec::{Companion, Supervision};
use crate::guest::supervisor::tests::{Bench, Folder};

/// A trial with the port of a bench, and the folder of that.
pub(in crate::guest) fn trial_of(bench: Bench) -> (Trial, Folder) {
    let Bench {
        supervisor,
        dir,
        folder,
        ..
    } = bench;
    let companion = Companion {
        name: "other".to_owned(),
        command: String::new(),
        robot: 0,
        may_end: true,
    };
    let foreign = Foreign {
        command: String::new(),
        name: "one".to_owned(),
        robot: 0,
        others: vec![companion],
        wait: Duration::from_secs(60),
        may_end: false,
        may_idle: false,
        needs: Vec::new(),
        prints: true,
        has_lines: false,
        supervision: Some(Supervision::default()),
    };
    let trial = Trial {
        supervisor,
        programs: Vec::new(),
        dir,
        foreign,
        words: Words::new(None),
        listener: thread::spawn(|| {}),
        gone_at: None,
        spins: None,
        processors: None,
    };
    (trial, folder)
}

/// A trial of the program whose launcher is `root`, at the beginning of its rig's time.
pub(in crate::guest) fn trial_of_program(bench: Bench, root: i32) -> (Trial, Folder) {
    let (mut trial, folder) = trial_of(bench);
    trial.programs = vec![started("one", root, None)];
    trial.begin();
    (trial, folder)
}

fn started(name: &str, root: i32, ended: Option<(Ended, u64)>) -> Started {
    Started {
        name: name.to_owned(),
        root,
        ended: ended.map(|(ended, millis)| (ended, Instant::from_millis(millis))),
    }
}

fn passes(trial: &mut Trial, millis: u64) {
    let length = Duration::from_millis(millis);
    trial.supervisor.stage.pass(length).expect("the port stays");
}

/// After the last program has left its ports two seconds are given to the devices.
#[test]
fn a_trial_is_over_after_its_program() {
    let mut bench = Bench::new();
    let port = bench.opens("sonar");
    let (mut trial, _folder) = trial_of(bench);
    assert!(!trial.is_over() && trial.has_begun());
    trial.gone_at = Some(Instant::ZERO);
    passes(&mut trial, 1_999);
    assert!(!trial.is_over());
    passes(&mut trial, 1);
    assert!(trial.is_over());
    trial.gone_at = None;
    assert!(!trial.is_over());
    trial.spins = Some("it computes".to_owned());
    assert!(trial.is_over() && trial.spins() == Some("it computes"));
    trial.spins = None;
    assert_eq!(
        (trial.waited(), trial.said()),
        (Duration::from_secs(2), String::new())
    );
    drop(port);
    // Before the rig has begun there is nothing to wait for.
    let (mut trial, _folder) = trial_of(Bench::new());
    assert!(!trial.is_over() && !trial.has_begun());
    trial.gone_at = Some(Instant::ZERO);
    assert!(trial.is_over());
    trial.begin();
    assert!(trial.has_begun() && !trial.is_over());
    // One that has opened nothing for a minute is given up.
    let (mut trial, _folder) = trial_of(Bench::new());
    passes(&mut trial, 60_000);
    assert!(trial.is_over());
}

/// A program that may end has to end well; all may be gone once their ports are closed.
#[test]
fn programs_are_gone_when_one_has_failed_or_all_have_ended() {
    let (mut trial, _folder) = trial_of(Bench::new());
    let code = |code| Some((Ended::Code(code), 5));
    let mut is_gone = |one, other| {
        trial.programs = vec![started("one", 1, one), started("other", 2, other)];
        trial.is_gone()
    };
    assert!(!is_gone(None, None));
    assert!(is_gone(code(0), None), "it has to stay");
    assert!(!is_gone(None, code(0)), "it may end");
    assert!(is_gone(None, code(3)), "but not like that");
    assert!(is_gone(None, Some((Ended::Signal(9), 5))));
    trial.programs = vec![started("other", 2, code(0))];
    assert!(trial.is_gone(), "no port is open");
    let mut bench = Bench::new();
    let _port = bench.opens("sonar");
    let (mut trial, _folder) = trial_of(bench);
    trial.programs = vec![started("other", 2, code(0))];
    assert!(!trial.is_gone(), "a client has a port");
}

#[test]
fn the_first_end_is_the_earliest() {
    let (mut trial, _folder) = trial_of(Bench::new());
    assert_eq!(trial.ended(), None);
    trial.programs = vec![
        started("one", 1, None),
        started("other", 2, Some((Ended::Code(3), 9))),
        started("third", 3, Some((Ended::Signal(11), 5))),
    ];
    assert_eq!(trial.ended(), Some(Ended::Signal(11)));
    let (_, at) = trial.first_end().expect("two");
    assert_eq!(at, Instant::from_millis(5));
    let own = std::process::id();
    assert_eq!(trial.processes(), [1, 2, 3, own]);
    let others: Vec<u32> = trial.others().iter().map(|left| left.pid).collect();
    assert_eq!(others, [own]);
    assert!(trial.moment().is_none(), "three programs");
}

/// A turn lets time pass, as no thread can run; it takes note of ends.
#[test]
fn a_turn_takes_note_of_ends() {
    use crate::guest::supervisor::tests::ends_with;

    let mut bench = Bench::new();
    bench.waits();
    let (mut trial, _folder) = trial_of(bench);
    trial.programs = vec![started("one", 1, None), started("other", 2, None)];
    trial.turn().expect("the port stays");
    assert_eq!(
        (trial.waited(), trial.gone_at),
        (Duration::from_millis(10), None)
    );
    ends_with(trial.supervisor(), 2, 0);
    trial.turn().expect("the port stays");
    assert_eq!(
        trial.programs[1].ended.map(|(ended, _)| ended),
        Some(Ended::Code(0))
    );
    assert_eq!(trial.gone_at, None, "it may end");
    ends_with(trial.supervisor(), 1, 0x300);
    trial.turn().expect("the port stays");
    assert_eq!(
        trial.programs[0].ended.map(|(ended, _)| ended),
        Some(Ended::Code(3))
    );
    let gone_at = trial.gone_at.expect("it has to stay");
    trial.turn().expect("the port stays");
    assert_eq!(trial.gone_at, Some(gone_at));
    // A launcher that could not become its program ends with 126.
    let mut bench = Bench::new();
    bench.waits();
    let (mut trial, _folder) = trial_of(bench);
    trial.programs = vec![started("one", 1, None)];
    ends_with(trial.supervisor(), 1, 126 << 8);
    trial.turn().expect("it was the program's own code");
    trial.programs[0].ended = None;
    trial.supervisor().launches(1);
    assert!(matches!(trial.turn(), Err(GuestError::NotLaunched(_))));
}

/// The verdicts of a program that still runs; its children are a matter of its end.
#[test]
fn checks_are_told_while_a_program_runs() {
    let (mut trial, _folder) = trial_of(Bench::new());
    trial.programs = vec![started("one", 1, None)];
    let names = |trial: &mut Trial| -> Vec<String> {
        trial
            .checks_now()
            .into_iter()
            .map(|check| check.name)
            .collect()
    };
    let before = names(&mut trial);
    assert!(
        before.iter().any(|name| name == "program-alive"),
        "{before:?}"
    );
    assert!(
        before
            .iter()
            .all(|name| name != "no-children-left" && name != "program-yields")
    );
    let mut sorted = before.clone();
    sorted.sort();
    sorted.dedup();
    assert_eq!(sorted.len(), before.len(), "each once");
    trial.spins = Some("it computes".to_owned());
    let checks = trial.checks_now();
    let spins = checks
        .iter()
        .find(|check| check.name == "program-yields")
        .expect("told");
    assert_eq!(
        (&*spins.detail, spins.status),
        ("it computes", engine::run::check::Status::Fail)
    );
}

/// The program goes on for so long, or until it is enough.
#[test]
fn a_program_goes_on_for_a_while() {
    let mut bench = Bench::new();
    bench.waits();
    let (mut trial, _folder) = trial_of(bench);
    trial.go_on(Duration::from_millis(35), |_| false);
    assert_eq!(
        trial.waited(),
        Duration::from_millis(40),
        "in steps of 10 ms"
    );
    trial.go_on(Duration::from_millis(35), |_| true);
    assert_eq!(trial.waited(), Duration::from_millis(40));
    trial.go_on(Duration::from_millis(35), |it| {
        it.stage.now() >= Instant::from_millis(55)
    });
    assert_eq!(trial.waited(), Duration::from_millis(60));
    trial.make_endless();
    assert!(trial.supervisor.stage.is_endless);
    trial.is_silent();
}

/// A trial of a program with these data and this code, and what it leaves when it is over.
fn plays(data: &[u8], code: &[&[u8]]) -> Played {
    use crate::guest::tests::program::starts;

    let mut bench = Bench::new();
    let process = starts(&mut bench, data, &code.concat());
    let (mut trial, _folder) = trial_of_program(bench, process.pid.as_raw());
    // The trial ends it.
    core::mem::forget(process);
    trial.go_on(Duration::from_millis(20), |_| false);
    trial.turn().expect("it is supervised");
    trial.end()
}

fn detail_of<'a>(played: &'a Played, name: &str) -> (engine::run::check::Status, &'a str) {
    let mut checks = played.outcome.checks.iter();
    let check = checks.find(|check| check.name == name).expect("told");
    (check.status, &check.detail)
}

/// SIGTERM is 15, its bit 0x4000; SIG_BLOCK is 0.
#[test]
fn a_program_is_asked_to_end_and_then_killed() {
    use crate::guest::tests::program::{DATA, call, exit, if_zero, rests};
    use engine::run::check::Status;
    use nix::libc;

    let sleeps = call(libc::SYS_nanosleep, &[DATA + 8, 0]);
    let blocks = call(libc::SYS_rt_sigprocmask, &[0, DATA, 0, 8]);
    let child = [call(libc::SYS_fork, &[]), if_zero(&rests())].concat();
    let data: Vec<u8> = [0x4000_u64, 0, 5_000_000]
        .iter()
        .flat_map(|word| word.to_le_bytes())
        .collect();
    // It does as asked, or is killed after a while; it leaves a child, which does or does not.
    let alive = |code: &[&[u8]]| {
        let played = plays(&data, code);
        let (status, detail) = detail_of(&played, "program-alive");
        let children = detail_of(&played, "no-children-left");
        (status, detail.to_owned(), children.0, children.1.to_owned())
    };
    let (status, detail, children, _) = alive(&[&rests()]);
    assert_eq!((status, children), (Status::Pass, Status::Pass), "{detail}");
    let (_, killed, children, _) = alive(&[&blocks, &rests(), &rests(), &rests()]);
    assert_eq!(children, Status::Pass);
    assert_ne!(killed, detail);
    let (status, _, children, left) = alive(&[&child, &sleeps, &exit(3)]);
    assert_eq!((status, children), (Status::Fail, Status::Pass));
    assert!(
        left.starts_with("left running, ended by SIGTERM: "),
        "{left}"
    );
    let (.., children, stubborn) = alive(&[&blocks, &child, &sleeps, &exit(3)]);
    assert_eq!(children, Status::Fail);
    let expected = "left running, had to be killed: ";
    assert!(stubborn.starts_with(expected), "{stubborn}");
}

/// A program that waits for its port has a moment to which it is put back; one that has ended has
/// none. A fault has its place.
#[test]
fn a_program_at_its_port_is_put_back() {
    use crate::guest::tests::program::{DATA, ZEROS, call, starts};
    use nix::libc;

    let mut bench = Bench::new();
    let path = bench.path("sonar");
    // openat(AT_FDCWD, .., O_RDWR | O_NOCTTY); `mov edi, eax`; read; `mov [0], eax`.
    let mut code = call(libc::SYS_openat, &[u32::MAX - 99, DATA, 0o402, 0]);
    code.extend([0x89, 0xC7, 0xBE]);
    code.extend(ZEROS.to_le_bytes());
    code.extend([0xBA, 8, 0, 0, 0]);
    code.extend(call(libc::SYS_read, &[]));
    code.extend([0x89, 0x04, 0x25, 0, 0, 0, 0]);
    let data = [path.as_os_str().as_encoded_bytes(), &[0]].concat();
    let process = starts(&mut bench, &data, &code);
    let (mut trial, _folder) = trial_of_program(bench, process.pid.as_raw());
    core::mem::forget(process);
    let moment = (0..100).find_map(|_| {
        trial.turn().expect("it is supervised");
        trial.moment()
    });
    let moment = moment.expect("it waits");
    assert!(trial.put_back(&moment));
    assert_eq!(trial.fault(), None);
    for _ in 0..10_000 {
        if trial.ended().is_some() {
            break;
        }
        trial.turns().expect("it is supervised");
    }
    assert_eq!(trial.ended(), Some(Ended::Signal(libc::SIGSEGV)));
    let fault = trial.fault().expect("it has one");
    assert!(fault.starts_with("program+0x"), "{fault}");
    assert!(trial.moment().is_none() && !trial.put_back(&moment));
}
