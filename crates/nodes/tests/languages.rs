//! The same device in Python, C and Rust: the examples give the same answers to the same requests,
//! and keep the contract.

use core::time::Duration;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use nodes::conform::{Finding, Mark, findings};
use nodes::message::{Answer, Hello, Reply, Request};
use nodes::program::serve_on;
use nodes::{Input, Item, NodePort, NodeSpec, Output, binary};
use protocols::{Instant, LineConfig, LineEvent};
use serde_json::json;

#[allow(dead_code, reason = "its main function is the program's")]
#[path = "../examples/scale.rs"]
mod scale;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The C program, compiled for the test `user`. Tests run at the same time, and a program that a
/// compiler writes cannot be started.
fn compiled(name: &str, user: &str) -> PathBuf {
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{user}"));
    let source = root().join(format!("nodes/examples/{name}.c"));
    let mut cc = Command::new("cc");
    cc.args([
        "-std=c99",
        "-D_POSIX_C_SOURCE=200809L",
        "-O1",
        "-Wall",
        "-Wextra",
        "-Werror",
    ]);
    let status = cc.arg(source).arg("-o").arg(&out).status();
    assert!(status.expect("a C compiler").success());
    out
}

fn python(name: &str) -> Command {
    let mut python = Command::new("python3");
    python
        .arg(root().join(format!("nodes/examples/{name}.py")))
        .env("PYTHONPATH", root().join("python/src"));
    python
}

/// Uses all functions: weighing, zeroing, a request during zeroing, and weighing in a draught.
fn requests() -> Vec<Request> {
    let mut requests = vec![Request::Hello(Hello {
        hilrig_node: 1,
        name: "scale".to_owned(),
        role: "device".to_owned(),
        seed: 1,
        ports: Vec::new(),
        quantities: Vec::new(),
        settings: [("load_g".to_owned(), json!(100.25))].into_iter().collect(),
        messages: json!(null),
    })];
    let mut ask = |millis: u64, what: Option<Input>| {
        let now = Instant::from_millis(millis);
        let items = what.into_iter().map(|what| Item {
            port: 0,
            at: now,
            what,
        });
        let items = items.collect();
        requests.push(Request::Exchange { now, items });
    };
    let text = |text: &str| Some(Input::Bytes(text.into()));
    let draught = |begins| {
        Some(Input::Fault {
            name: "draught".to_owned(),
            begins,
            figure: None,
        })
    };
    ask(0, None);
    ask(100, Some(Input::Line(LineEvent::Opened)));
    ask(600, text("SI"));
    ask(601, text("\r\nSI\r"));
    ask(602, text("\n"));
    ask(2_000, text("ZI\r\n"));
    ask(2_400, text("SI\r\n"));
    ask(3_000, None);
    ask(3_100, draught(true));
    ask(4_700, text("SI\r\n"));
    ask(4_800, draught(false));
    ask(9_900, text("SI\r\nWHO\r\n"));
    // Longer than any line: the device accepts the line behind it.
    ask(9_950, text(&"x".repeat(200)));
    ask(9_960, text("\r\nSI\r\n"));
    requests.push(Request::End);
    requests
}

/// The replies in the answers to all requests.
fn replies(mut answers: &[u8]) -> Vec<Reply> {
    let mut replies = Vec::new();
    while let Some(binary::Framed { kind, body, len }) = binary::split(answers).expect("sound") {
        match binary::read_answer(kind, body).expect("sound") {
            Answer::Exchange(reply) => replies.push(reply),
            other => assert!(matches!(other, Answer::Hello(_)), "{other:?}"),
        }
        answers = &answers[len..];
    }
    replies
}

fn stream() -> Vec<u8> {
    let mut stream = binary::MAGIC.to_vec();
    for request in requests() {
        binary::write_request(&mut stream, &request).expect("short items");
    }
    stream
}

fn answers_of(mut command: Command) -> Vec<Reply> {
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it starts");
    let mut stdin = child.stdin.take().expect("a pipe");
    stdin.write_all(&stream()).expect("it reads");
    drop(stdin);
    let output = child.wait_with_output().expect("it ends");
    assert!(output.status.success());
    replies(&output.stdout)
}

/// The bytes on the wire, and the log entries.
fn told(replies: &[Reply]) -> Vec<String> {
    let items = replies.iter().flat_map(|reply| &reply.items);
    let words = items.map(|item| {
        let at = item.at.as_millis();
        match &item.what {
            Output::Bytes(bytes) => format!("{at} {}", String::from_utf8_lossy(bytes).trim_end()),
            Output::Note(note) => format!("{at} {}: {}", note.rule, note.detail),
            Output::Quantity(value) => format!("{at} net_g {value:.2}"),
            other => format!("{at} {other:?}"),
        }
    });
    words.collect()
}

/// The weight of 100.25 g drifts by 0.01 g each half second; it is zeroed at 3 s, at 100.31 g.
#[test]
fn the_same_scale_in_three_languages_gives_the_same_answers() {
    let mut out = Vec::new();
    serve_on(&stream()[..], &mut out, scale::scale).expect("it ends well");
    let rust = replies(&out);
    let expected = [
        "601 net_g 100.26",
        "631 S S     100.26 g",
        "602 net_g 100.26",
        "632 S S     100.26 g",
        "2400 too-fast: SI came while the scale is busy",
        "3000 ZI S",
        "4700 net_g 0.03",
        "4730 S D       0.03 g",
        "9900 net_g 0.13",
        "9930 S S       0.13 g",
        "9930 ES",
        "9990 ES",
        "9960 net_g 0.13",
        "9990 S S       0.13 g",
    ];
    assert_eq!(told(&rust), expected);
    assert_eq!(answers_of(python("scale")), rust);
    assert_eq!(answers_of(Command::new(compiled("scale", "answers"))), rust);
}

fn tested(command: &str, library: bool) -> Vec<Finding> {
    let library = library.then(|| root().join("python/src").display().to_string());
    let spec = NodeSpec {
        ports: vec![NodePort::uart("uart", LineConfig::new_8n1(9_600))],
        env: library
            .map(|path| ("PYTHONPATH".to_owned(), path))
            .into_iter()
            .collect(),
        settings: [("load_g".to_owned(), json!(100.25))].into_iter().collect(),
        patience: Duration::from_secs(60),
        ..NodeSpec::new("scale", command)
    };
    findings(&spec, &[b"SI\r\n".to_vec()])
}

fn failed(command: &str, library: bool) -> Vec<String> {
    let found = tested(command, library);
    assert!(found.len() > 8, "{found:?}");
    let failed = found
        .into_iter()
        .filter(|finding| finding.mark == Mark::Fail);
    failed
        .map(|finding| format!("{}: {}", finding.name, finding.detail))
        .collect()
}

#[test]
fn the_examples_keep_the_contract() {
    let scale = root().join("nodes/examples/scale.py");
    let none = Vec::<String>::new();
    assert_eq!(failed(&format!("python3 {}", scale.display()), true), none);
    let compiled = compiled("scale", "contract");
    assert_eq!(failed(&compiled.display().to_string(), false), none);
}

/// A crash is neither a rejected version nor a regular end, also behind a shell that reports it.
#[test]
fn a_program_that_a_signal_ends_is_found_out() {
    let crash = r"
import os, signal
from hilrig.device import Device, main
try:
    main(Device)
finally:
    os.kill(os.getpid(), signal.SIGSEGV)
";
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("crash.py");
    std::fs::write(&path, crash).expect("a folder for tests");
    for shell in ["", "; exit $?"] {
        let found = failed(&format!("python3 {}{shell}", path.display()), true);
        let names = found.iter().filter_map(|one| one.split(':').next());
        let names: Vec<_> = names.collect();
        assert_eq!(
            names,
            ["wrong-version", "end", "end-of-input"],
            "{found:#?}"
        );
        assert!(
            found.iter().all(|one| one.contains("signal 11")),
            "{found:#?}"
        );
    }
}

/// Behaviour without any output is not observed.
#[test]
fn a_program_that_says_nothing_proves_little() {
    let silent = r"
from hilrig.device import Device, main
class Silent(Device):
    saves = True
    def save(self):
        return b''
    def load(self, state):
        pass
main(Silent)
";
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("silent.py");
    std::fs::write(&path, silent).expect("a folder for tests");
    let found = tested(&format!("python3 {}", path.display()), true);
    let silent = found
        .iter()
        .filter(|one| one.detail.contains("give it something with --send"));
    let names: Vec<_> = silent.map(|one| (one.name, one.mark)).collect();
    let expected = [
        "exchanges",
        "chunked-input",
        "same-every-run",
        "save-and-load",
        "json",
    ];
    assert_eq!(
        names,
        expected.map(|name| (name, Mark::NotOffered)),
        "{found:#?}"
    );
}

/// A program that reads the clock, cannot save although it offers to, and outlives its rig: the
/// test detects each of these errors.
#[test]
fn a_program_that_breaks_the_contract_is_found_out() {
    let liar = r#"
import random
from hilrig.device import Device, main
class Liar(Device):
    saves = True
    def hear(self, data, now):
        self.send(b"%d" % random.randrange(10 ** 9), after=0.001)
    def save(self):
        return b""
    def load(self, state):
        pass
main(Liar)
import time
time.sleep(60)
"#;
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("liar.py");
    std::fs::write(&path, liar).expect("a folder for tests");
    let found = failed(&format!("python3 {}", path.display()), true);
    let names: Vec<_> = found
        .iter()
        .filter_map(|one| one.split(':').next())
        .collect();
    let expected = [
        "chunked-input",
        "same-every-run",
        "save-and-load",
        "end",
        "end-of-input",
        "json",
    ];
    assert_eq!(names, expected, "{found:#?}");
}
