//! Node programs in whole runs: same bytes each time, checkpoints, failures that end the run.

use core::time::Duration;
use std::io::{Read as _, Write as _};
use std::path::Path;

use hilrig::ports::{Bench, VirtualPort};
use hilrig::run::check::Status;
use hilrig::run::{Outcome, Run};
use hilrig::scenario::{Scenario, Source};
use protocols::Instant;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A scenario whose only device is the program `command`.
fn scenario(command: &str, more: &str) -> (Scenario, Source) {
    let text = format!(
        "schema = 1\nname = \"scale\"\nrobot = \"none\"\nduration = \"20s\"\n\
         [device.scale.program]\nexec = '''{command}'''\nrate = 9600\n\
         settings = {{ load_g = 100.25 }}\n{more}"
    );
    Scenario::from_text(&text).expect("sound")
}

fn python(name: &str) -> String {
    let root = root().display();
    format!("PYTHONPATH={root}/python/src exec python3 {root}/nodes/examples/{name}.py")
}

/// The next line from `port`; the bytes so far if no line arrives in time.
fn line(port: &mut VirtualPort) -> String {
    let mut line = Vec::new();
    let mut byte = [0];
    while !line.ends_with(b"\n") && port.read(&mut byte).is_ok_and(|len| len == 1) {
        line.push(byte[0]);
    }
    String::from_utf8_lossy(&line).into_owned()
}

/// Weighs, zeroes, weighs; returns the scale's text and the outcome of the run.
fn weighed(more: &str) -> (String, Outcome) {
    let (scenario, source) = scenario(&python("scale"), more);
    let bench = Bench::new(scenario, &source).expect("wired");
    let mut port = bench.port("scale").expect("its port");
    port.set_timeout(Duration::from_secs(2));
    let mut said = String::new();
    for request in ["SI\r\n", "ZI\r\n", "SI\r\n"] {
        port.write_all(request.as_bytes()).expect("it is open");
        said += &line(&mut port);
        bench.sleep(Duration::from_millis(600));
    }
    (said, bench.judge())
}

/// The load is 100.25 g and grows by 0.01 g each half second. It grows by 0.03 g until the zeroing,
/// a second after the request at 0.66 s, and by 0.04 g until the second weighing at 2.27 s.
#[test]
fn a_device_in_python_gives_the_same_bytes_on_each_run() {
    let (said, first) = weighed("");
    first.assert_passed();
    assert_eq!(said, "S S     100.25 g\r\nZI S\r\nS S       0.01 g\r\n");
    let (again, second) = weighed("");
    assert_eq!((again, second.trace_hash), (said, first.trace_hash));
}

#[test]
fn faults_of_a_program_are_faults_of_the_scenario() {
    let fault = "[[fault]]\nkind = \"device\"\ndevice = \"scale\"\nfault = \"draught\"\n\
                 from = \"0s\"\nuntil = \"1s\"\n";
    let (said, _) = weighed(fault);
    assert!(said.starts_with("S D "), "{said}");
    let (scenario, source) = scenario(&python("scale"), &fault.replace("draught", "storm"));
    let error = Run::new(scenario, &source, None)
        .map(|_| ())
        .expect_err("it knows no storm");
    let error = error.to_string();
    assert!(
        error.contains("is \"storm\", expected one of draught (faults of scale)"),
        "{error}"
    );
}

/// Names of outputs are known after the program has shown them. Then a rule or a fault on an output
/// is judged, and an unknown name fails.
#[test]
fn a_rule_on_an_output_is_judged_when_the_program_shows_it() {
    for (name, status, says) in [
        ("net_g", Status::Pass, "held at all"),
        ("net_kg", Status::Fail, "did you mean \"net_g\"?"),
    ] {
        let rule = format!(
            "[[expect.rule]]\nname = \"net\"\nnever = {{ register = {{ device = \"scale\", \
             name = \"{name}\", op = \">\", value = 500 }} }}\n"
        );
        let fault = format!(
            "[[fault]]\nkind = \"cut\"\nlink = \"scale\"\ndirection = \"to-master\"\n\
             begins_when = {{ register = {{ device = \"scale\", name = \"{name}\", op = \">\", \
             value = 500 }} }}\n"
        );
        let (_, outcome) = weighed(&(rule + &fault));
        let mut checks = outcome.checks.iter();
        let fault = checks.find(|check| check.name == "fault-0-begins-when");
        let is_wrong = fault.is_some_and(|check| check.detail.contains(says));
        assert_eq!(is_wrong, status == Status::Fail, "{name}: {fault:?}");
        let mut checks = outcome.checks.iter();
        let check = checks
            .find(|check| check.name == "rule-net")
            .expect("judged");
        assert_eq!(check.status, status, "{check}");
        assert!(check.detail.contains(says), "{check}");
    }
}

/// The program declares a, b and c, shows a at 1 s and b at 2 s. Until then b is unknown, and c
/// remains so.
#[test]
fn an_output_that_is_declared_may_be_shown_later() {
    let program = "from hilrig.device import Device, main\n\
        class Late(Device):\n \
        outputs = (\"a\", \"b\", \"c\")\n \
        def start(self): self.after(1.0, self.first); self.after(2.0, self.second)\n \
        def first(self): self.show(\"a\", 1)\n \
        def second(self): self.show(\"b\", 1)\n\
        main(Late)";
    let command = format!(
        "PYTHONPATH={}/python/src exec python3 -c '{program}' ",
        root().display()
    );
    let rule = |(demand, name)| {
        format!(
            "[[expect.rule]]\nname = \"{demand}-{name}\"\n{demand} = {{ register = {{ device = \
             \"scale\", name = \"{name}\", op = \"==\", value = 1 }} }}\n"
        )
    };
    let rules = [
        ("always", "b"),
        ("eventually", "b"),
        ("always", "c"),
        ("eventually", "c"),
    ];
    let (scenario, source) = scenario(&command, &rules.map(rule).concat());
    let outcome = Run::new(scenario, &source, None).expect("wired").finish();
    for (name, status, says) in [
        ("rule-always-b", Status::Pass, "held at all"),
        ("rule-eventually-b", Status::Pass, "at 2.0"),
        ("rule-always-c", Status::NotObserved, "scale never showed c"),
        ("rule-eventually-c", Status::Fail, "scale never showed c"),
    ] {
        let mut checks = outcome.checks.iter();
        let check = checks.find(|check| check.name == name).expect("judged");
        assert_eq!(check.status, status, "{check}");
        assert!(check.detail.contains(says), "{check}");
    }
}

/// Only the first exchange takes place: a program without requests is not called.
#[test]
fn an_idle_program_costs_nothing() {
    let (scenario, source) = scenario(&python("scale"), "");
    let mut run = Run::new(scenario, &source, None).expect("wired");
    run.go_on_until(Instant::from_secs(19));
    let (_, node) = run.rig.node_programs().next().expect("there is one");
    assert_eq!(node.exchanges(), 1);
}

/// The copy has its own process, which starts with the state that the first process saved.
#[test]
fn a_program_that_can_save_takes_part_in_checkpoints() {
    let fault = "[[fault]]\nkind = \"device\"\ndevice = \"scale\"\nfault = \"draught\"\n\
                 from = \"2s\"\nuntil = \"3s\"\n";
    let (scenario, source) = scenario(&python("scale"), fault);
    let mut run = Run::new(scenario, &source, None).expect("wired");
    run.go_on_until(Instant::from_secs(1));
    let point = run.checkpoint().expect("it can save");
    let [one, other] = [run, point.resume()].map(Run::finish);
    assert_eq!(one.trace_hash, other.trace_hash);
    for outcome in [one, other] {
        let check = outcome
            .checks
            .iter()
            .find(|check| check.name == "node-programs");
        let check = check.map(|check| (check.status, &*check.detail));
        assert_eq!(check, Some((Status::Pass, "scale: 3 exchanges")));
    }
}

#[test]
fn a_program_that_cannot_save_has_no_checkpoints() {
    let (scenario, source) = scenario(&python("echo"), "");
    let mut run = Run::new(scenario, &source, None).expect("wired");
    run.go_on_until(Instant::from_secs(1));
    assert!(run.checkpoint().is_none());
}

/// The run ends at its first update, 10 ms. The check contains the sentence and the program's last
/// words, and the words are kept.
#[test]
fn a_program_that_fails_ends_the_run() {
    let (scenario, source) = scenario("echo 'no such meter' >&2; exit 3", "");
    let outcome = Run::new(scenario, &source, None).expect("wired").finish();
    assert!(!outcome.passed());
    assert_eq!(outcome.ran, Duration::from_millis(10));
    let check = outcome
        .checks
        .iter()
        .find(|check| check.name == "node-programs");
    let check = check.expect("it is judged");
    assert_eq!(check.status, Status::Fail);
    assert_eq!(
        check.detail,
        "scale exited (exit code 3) before it answered hello, expected an answer to each request; \
         its last words: no such meter"
    );
    assert_eq!(
        outcome.node_words,
        [("scale".to_owned(), "no such meter\n".to_owned())]
    );
    let noted = outcome
        .events
        .iter()
        .any(|logged| logged.event.rule == "node-failed");
    assert!(noted, "the log says so as well");
}

/// A fault that only the program knows must not hide a missing program.
#[test]
fn a_program_that_cannot_be_greeted_fails_as_a_check_also_with_faults() {
    let fault = "[[fault]]\nkind = \"device\"\ndevice = \"scale\"\nfault = \"draught\"\n\
                 from = \"1s\"\n";
    let (scenario, source) = scenario("exit 3", fault);
    let outcome = Run::new(scenario, &source, None).expect("wired").finish();
    let failed = outcome
        .checks
        .iter()
        .find(|check| check.status == Status::Fail);
    assert_eq!(failed.map(|check| &*check.name), Some("node-programs"));
}

/// The frames are those of the description `mt-sics`; an invalid line is the driver's mistake.
#[test]
fn a_program_gets_messages_in_the_place_of_bytes() {
    let (mut scenario, source) = scenario(&python("typed_scale"), "");
    let device = scenario.device.get_mut("scale").expect("it is there");
    type Spec = hilrig::scenario::device::program::NodeProgramSpec;
    let spec: &mut Spec = device.settings_mut().expect("a program");
    (spec.rate, spec.description) = (None, Some("mt-sics".to_owned()));
    let bench = Bench::new(scenario, &source).expect("wired");
    let mut port = bench.port("scale").expect("its port");
    port.set_timeout(Duration::from_millis(200));
    let mut said = String::new();
    for request in ["SI\r\n", "ZI\r\n", "SI\r\n", "S?\r\n"] {
        port.write_all(request.as_bytes()).expect("it is open");
        said += &line(&mut port);
    }
    assert_eq!(said, "S S     100.25 g\r\nZI S\r\nS S       0.00 g\r\n");
    let outcome = bench.judge();
    let mut rules = outcome.events.iter().map(|logged| logged.event.rule);
    assert!(rules.any(|rule| rule == "unknown-message"));
}
