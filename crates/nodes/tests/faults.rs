//! Each way to break the contract causes its own error message, and leaves no process behind.
//!
//! The programs in these tests are shells with prepared answers: the output does not depend on the
//! requests.

use core::sync::atomic::{AtomicUsize, Ordering};
use core::time::Duration;
use std::thread;

use emulators::device::Device as _;
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use nodes::host::{BYTES_MAX, Host};
use nodes::message::{Answer, Note, Reply};
use nodes::{Item, NodeDevice, NodeError, NodePort, NodeSpec, Output, binary};
use protocols::{Instant, LineConfig, LineEvent, Port};
use serde_json::json;

const fn at(nanos: u64) -> Instant {
    Instant::from_nanos(nanos)
}

fn answer(answer: &Answer) -> Vec<u8> {
    let mut bytes = Vec::new();
    binary::write_answer(&mut bytes, answer).expect("short items");
    bytes
}

fn hello() -> Vec<u8> {
    answer(&Answer::Hello(json!({ "hilrig_node": 1, "save": true })))
}

fn reply(next: u64, items: Vec<Item<Output>>) -> Vec<u8> {
    answer(&Answer::Exchange(Reply {
        next: Some(at(next)),
        items,
    }))
}

fn sends(nanos: u64, port: u8, len: usize) -> Item<Output> {
    Item {
        port,
        at: at(nanos),
        what: Output::Bytes(vec![b'x'; len]),
    }
}

/// A shell command that outputs all parts, then runs `rest`.
fn says(parts: &[&[u8]], rest: &str) -> String {
    static FILES: AtomicUsize = AtomicUsize::new(0);
    let number = FILES.fetch_add(1, Ordering::Relaxed);
    let name = format!("hilrig-nodes-{}-{number}", std::process::id());
    let path = std::env::temp_dir().join(name);
    std::fs::write(&path, parts.concat()).expect("a folder for temporary files");
    let path = path.display();
    // The output starts only after the rig's first bytes: an earlier answer would have no receiver.
    format!("head -c 4 >/dev/null; cat {path}; rm -f {path}; {rest}")
}

/// Programs that hang have a timeout of 2 s; all others have enough time for a busy machine.
fn spec(command: &str) -> NodeSpec {
    let hangs = command.contains("sleep 60");
    NodeSpec {
        ports: vec![NodePort::uart("uart", LineConfig::new_8n1(9_600))],
        patience: Duration::from_secs(if hangs { 2 } else { 60 }),
        ..NodeSpec::new("scale", command)
    }
}

/// The result of one exchange at 5 us with the program.
fn outcome(command: &str) -> Result<Reply, NodeError> {
    let mut host = Host::start(&spec(command)).map_err(|(error, _)| error)?;
    host.exchange(at(5_000), &[])
}

fn sentence(command: &str) -> String {
    outcome(command)
        .expect_err("it breaks the contract")
        .to_string()
}

const HEARS: &str = "exec cat >/dev/null";

/// The tests of wrong programs prove something only if correct programs pass.
#[test]
fn a_program_that_keeps_the_contract_goes_on() {
    let sound = says(&[&hello(), &reply(5_000, vec![sends(5_000, 0, 3)])], HEARS);
    let reply = outcome(&sound).expect("it keeps the contract");
    assert_eq!(reply.items, [sends(5_000, 0, 3)]);
    let mut host = Host::start(&spec(&says(&[&hello()], HEARS))).expect("a greeting");
    assert_eq!(host.end(), Ok(()));
}

#[test]
fn each_fault_of_a_program_has_its_sentence() {
    let hello = hello();
    let never = reply(u64::MAX - 1, vec![]);
    let version = answer(&Answer::Hello(json!({ "hilrig_node": 2 })));
    let flood = vec![sends(5_000, 0, 60_000), sends(5_000, 0, 60_000)];
    let notes = |count| {
        let note = Note {
            rule: "busy".to_owned(),
            ..Note::default()
        };
        let note = Item {
            port: 0,
            at: at(5_000),
            what: Output::Note(note),
        };
        vec![note; count]
    };
    let many = vec!["x"; 257];
    let many = answer(&Answer::Hello(json!({ "hilrig_node": 1, "outputs": many })));
    let long = 60_000_u32.to_le_bytes();
    let rows: [(String, &str); 18] = [
        (
            "exit 3".to_owned(),
            "exited (exit code 3) before it answered hello, expected an answer to each request",
        ),
        (
            says(&[&hello], "exit 4"),
            "exited (exit code 4) before it answered an exchange, expected an answer to each \
             request",
        ),
        (
            "no-such-program-here 2>/dev/null".to_owned(),
            "exited (exit code 127: the shell did not find the command) before it answered hello, \
             expected an answer to each request",
        ),
        (
            says(&[&hello], "kill -SEGV $$"),
            "exited (signal 11) before it answered an exchange, expected an answer to each request",
        ),
        (
            says(&[&hello], "exec >/dev/null; sleep 60"),
            "closed its standard output before it answered an exchange, expected it to stay open",
        ),
        (
            "sleep 60".to_owned(),
            "gave no answer to hello within 2 s of wall time: it hangs",
        ),
        (
            says(&[&hello], "sleep 60"),
            "gave no answer to an exchange within 2 s of wall time: it hangs",
        ),
        (
            says(&[&hello, &never[..7]], "trap '' TERM; sleep 60"),
            "gave no answer to an exchange within 2 s of wall time: it hangs",
        ),
        (
            // The timeout applies to the whole answer, even if its bytes arrive one by one.
            says(
                &[&hello, &long],
                "while printf x; do sleep 0.05; done; : sleep 60",
            ),
            "gave no answer to an exchange within 2 s of wall time: it hangs",
        ),
        (
            says(&[&many], HEARS),
            "sent an answer to hello that cannot be read: it names 257 outputs, expected at most \
             256",
        ),
        (
            says(&[&version], HEARS),
            "speaks version 2 of the node protocol, expected version 1",
        ),
        (
            says(&[b"Scale ready\n"], HEARS),
            "sent an answer to hello that cannot be read: its length is 1818321747 (it begins with \
             \"Scale ready\\n\"), expected 1 to 16777216",
        ),
        (
            says(&[&hello, &hello], HEARS),
            "sent an answer to an exchange that cannot be read: it is a greeting, expected one \
             answer to each request, in order",
        ),
        (
            says(&[&hello, &reply(4_999, vec![])], HEARS),
            "moved time backwards: the next moment is at 0.000004 s, expected 0.000005 s or later",
        ),
        (
            says(&[&hello, &reply(9_000, vec![sends(4_999, 0, 1)])], HEARS),
            "moved time backwards: an item is at 0.000004 s, expected 0.000005 s or later",
        ),
        (
            says(&[&hello, &reply(9_000, flood)], HEARS),
            "flooded the rig: 120000 bytes for port 0 in one exchange, at most 65536",
        ),
        (
            says(&[&hello, &reply(9_000, notes(1_001))], HEARS),
            "flooded the rig: 1001 notes in one exchange, at most 1000",
        ),
        (
            says(&[&hello, &reply(9_000, vec![sends(5_000, 1, 1)])], HEARS),
            "sent an answer to an exchange that cannot be read: item 0 is of port 1, and there are \
             1, counted from 0",
        ),
    ];
    thread::scope(|scope| {
        let found =
            rows.map(|(command, expected)| (scope.spawn(move || sentence(&command)), expected));
        for (found, expected) in found {
            assert_eq!(found.join().expect("a sentence"), expected);
        }
    });
    assert_eq!(BYTES_MAX, 65_536, "the figure in a sentence above");
}

/// A program that never advances the time would stop the rig forever.
#[test]
fn a_program_that_lets_no_time_pass_is_stopped() {
    let stay = reply(5_000, vec![]);
    let answers = says(&[&hello(), &stay.repeat(10_100)], "true");
    // The program reads its input meanwhile; otherwise both sides would wait for each other.
    let answers = answers.replace("head -c 4 >/dev/null; ", "");
    let command = format!("exec 3<&0; {{ {answers}; }} & {HEARS} <&3");
    let mut host = Host::start(&spec(&command)).expect("a greeting");
    let error = (0..10_100).find_map(|_| host.exchange(at(5_000), &[]).err());
    let error = error.expect("it stays where it is").to_string();
    assert_eq!(
        error,
        "asked 10001 times in a row to be called again at once, the last time at 0.000005 s: \
         expected a later moment"
    );
}

/// The end message is the last one; the program's exit is judged.
#[test]
fn a_program_has_to_exit_well_when_it_is_told_to() {
    let rows = [
        (
            "cat >/dev/null; exit 3",
            "ended with exit code 3 after the end message, expected exit code 0",
        ),
        (
            "sleep 60",
            "did not exit within 2 s of the end message, and was killed",
        ),
    ];
    for (rest, expected) in rows {
        let mut host = Host::start(&spec(&says(&[&hello()], rest))).expect("a greeting");
        let error = host.end().expect_err("it does not").to_string();
        assert_eq!(error, expected);
    }
}

/// Whether a process with `mark` in its command line exists.
fn is_running(mark: &str) -> bool {
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let mut commands = entries.map(|entry| std::fs::read(entry.path().join("cmdline")));
    commands.any(|command| {
        let command = command.unwrap_or_default();
        String::from_utf8_lossy(&command).contains(mark)
    })
}

/// The program has started a child; both ignore the request to end and do not read their input.
#[test]
fn nothing_is_left_behind() {
    let mark = format!("hilrig-nodes-left-{}", std::process::id());
    let stubborn =
        format!("trap '' TERM HUP; sh -c 'trap \"\" TERM HUP; sleep 60; : {mark}' & wait");
    // The command removes its prepared answers, so each command starts one program.
    let command = || says(&[&hello()], &stubborn);
    let host = Host::start(&spec(&command())).expect("a greeting");
    assert!(is_running(&mark), "it is there while the host is");
    drop(host);
    assert!(!is_running(&mark));
    let error = outcome(&command()).expect_err("it is silent").to_string();
    assert!(
        error.starts_with("gave no answer to an exchange"),
        "{error}"
    );
    assert!(!is_running(&mark));
}

/// The pipe stays open while the child lives: this must not be mistaken for a slow answer.
#[test]
fn a_program_that_exits_is_noticed_although_its_child_holds_the_pipe() {
    let command = says(&[&hello()], "(sleep 50) & exit 4");
    let error = outcome(&command).expect_err("it exits").to_string();
    assert!(error.starts_with("exited (exit code 4)"), "{error}");
}

/// A copy begins with the saved state of its program, in its own process.
#[test]
fn a_copy_goes_on_from_the_saved_state_and_counts_on() {
    let saved = answer(&Answer::Saved(b"state".to_vec()));
    let loaded = answer(&Answer::Loaded);
    let command = format!(
        "if mkdir {0}; then {1}; else rmdir {0}; {2}; fi",
        std::env::temp_dir()
            .join(format!("hilrig-nodes-first-{}", std::process::id()))
            .display(),
        says(&[&hello(), &reply(u64::MAX - 1, vec![]), &saved], HEARS),
        says(&[&hello(), &loaded, &reply(u64::MAX - 1, vec![])], HEARS),
    );
    let mut world = World::new(
        Scene::new([] as [Shape; 0], Vec::new()).expect("nothing"),
        BodyConfig::default(),
        Pose::default(),
        0,
    )
    .expect("an empty place");
    let mut device = NodeDevice::new(spec(&command));
    device.poll(at(0), &mut world);
    assert_eq!((device.exchanges(), device.error()), (1, None));
    assert!(device.can_save());
    let mut copy = device.clone();
    assert_eq!((copy.exchanges(), copy.error()), (1, None));
    copy.line_event(Port(0), at(9), LineEvent::Opened);
    copy.poll(at(9), &mut world);
    assert_eq!((copy.exchanges(), copy.error()), (2, None));
}

/// The standard error output of a program is kept and reported, even if the program never answered.
#[test]
fn the_last_words_of_a_program_are_kept() {
    let failed = Host::start(&spec("echo 'no module named meter' >&2; exit 1"));
    let (error, said) = failed.expect_err("it exits");
    assert!(
        error.to_string().starts_with("exited (exit code 1)"),
        "{error}"
    );
    assert_eq!(said, "no module named meter\n");
}
