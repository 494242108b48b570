//! Node programs from the command line: exit codes, messages, and no remaining process.

use std::path::Path;
use std::process::Command;

use super::{Session, text, wait_until};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The shell command of an example in Python.
fn python(name: &str) -> String {
    let root = root().display();
    format!("PYTHONPATH={root}/python/src exec python3 {root}/nodes/examples/{name}.py")
}

fn scenario(command: &str) -> String {
    format!(
        "schema = 1\nname = \"scale\"\nrobot = \"none\"\nduration = \"5s\"\n\
         [device.scale.program]\nexec = '''{command}'''\nrate = 9600\n\
         settings = {{ load_g = 100.25 }}\n"
    )
}

/// Whether a process exists whose command line contains `mark`.
fn is_running(mark: &str) -> bool {
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let mut commands = entries.map(|entry| std::fs::read(entry.path().join("cmdline")));
    commands.any(|command| {
        let command = command.unwrap_or_default();
        String::from_utf8_lossy(&command).contains(mark)
    })
}

/// Both ends of the wire are programs: nine weighings from 0.5 s to 4.5 s, the same in both forms.
#[test]
fn a_driver_is_a_node_program_in_the_place_of_the_robots() {
    let session = Session::new("nodes-driver");
    session.write("scale.toml", &scenario(&python("scale")));
    let mut traces = Vec::new();
    for form in [&[][..], &["--json-nodes"]] {
        let driver = python("driver");
        let arguments = ["run", "scale.toml", "--node", &driver, "--out", "o"];
        let output = session.hilrig(&[&arguments[..], form].concat());
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let events = session.read("o/events.txt");
        assert_eq!(events.matches("weighed").count(), 9, "{events}");
        let said = text(&output.stdout);
        traces.extend(
            said.lines()
                .find(|line| line.contains("trace "))
                .map(str::to_owned),
        );
    }
    assert_eq!(traces.len(), 2);
    assert_eq!(traces[0], traces[1]);
}

/// A driver that asks each 100 ms, asks 100 ms after each reply, asks some times and then hangs,
/// asks once and listens, only prints what it hears, or does nothing.
const DRIVER: &str = r#"
import sys
from hilrig.device import Device, main

KIND = sys.argv[1]
ASK = b"watts\r\n" if KIND == "asks-wrongly" else b"volts\r\n"
ASKS = {"asks": 1000, "asks-wrongly": 1000, "waits": 1000, "hangs": 25, "listens": 1}.get(KIND, 0)

class Driver(Device):
    ends = b"\r\n"
    asked = 0

    def start(self):
        self.after(0.1, self.ask)

    def ask(self):
        self.asked += 1
        if KIND != "waits":
            self.after(0.1, self.ask)
        return ASK if self.asked <= ASKS else None

    def hear(self, line, now):
        if KIND == "waits":
            self.after(0.1, self.ask)
        if KIND == "prints":
            print(line.decode(), file=sys.stderr, flush=True)

main(Driver)
"#;

/// A node program that was not seen to work fails. Expected are the passed verdict and words of it,
/// with a device that only answers and with one that sends each half second.
#[test]
fn a_driver_that_does_not_work_fails() {
    let session = Session::new("nodes-idle");
    session.write("driver.py", DRIVER);
    for (name, periodic) in [
        ("asked", ""),
        (
            "streams",
            "periodic = { line = \"mm=7\", period = \"500ms\" }\n",
        ),
    ] {
        session.write(
            &format!("{name}.toml"),
            &format!(
                "schema = 1\nname = \"{name}\"\nrobot = \"none\"\nduration = \"5s\"\n\
                 [device.it.text]\nbaud = 9600\n{periodic}\
                 command = [{{ request = \"volts\", reply = \"230.1 V\" }}]\n"
            ),
        );
    }
    let idle = "--node-may-idle";
    for (scenario, kind, option, expected) in [
        (
            "asked",
            "asks-wrongly",
            None,
            Err("times a device did not understand it"),
        ),
        ("asked", "asks", None, Ok("sent 344 B")),
        (
            "asked",
            "hangs",
            None,
            Err("its last sign of life was at 2.5"),
        ),
        (
            "asked",
            "hangs",
            Some(idle),
            Ok("its last sign of life was at 2.5"),
        ),
        ("asked", "listens", None, Err("4.9 s before the end")),
        (
            "asked",
            "mute",
            None,
            Err("no byte passed in either direction"),
        ),
        (
            "asked",
            "mute",
            Some(idle),
            Err("no byte passed in either direction"),
        ),
        (
            "streams",
            "hangs",
            None,
            Err("its last sign of life was at 2.5"),
        ),
        (
            "streams",
            "listens",
            None,
            Ok("its last sign of life was at 0.1"),
        ),
        (
            "streams",
            "mute",
            None,
            Err("sent, showed and printed nothing"),
        ),
        ("streams", "mute", Some(idle), Ok("sent 0 B")),
        ("streams", "prints", None, Ok("it printed")),
    ] {
        let src = root().join("python/src");
        let command = format!("PYTHONPATH={} exec python3 driver.py {kind}", src.display());
        let scenario = format!("{scenario}.toml");
        let arguments = ["run", &scenario, "--node", &command, "--out", "o"];
        let output = session.hilrig(&[&arguments[..], option.as_slice()].concat());
        let said = text(&output.stdout);
        let line = said.lines().find(|line| line.contains(" program-goes-on "));
        let (mark, words) = match expected {
            Ok(words) => ("ok  ", words),
            Err(words) => ("FAIL", words),
        };
        if kind == "asks-wrongly" {
            assert!(
                said.contains("probable cause: it does not understand"),
                "{said}"
            );
        }
        let is_right = line.is_some_and(|line| line.contains(mark) && line.contains(words));
        assert!(is_right, "{scenario} {kind} {option:?}: {words}\n{said}");
        assert_eq!(
            output.status.code(),
            Some(i32::from(expected.is_err())),
            "{kind}"
        );
    }
}

/// A lost reply stops a driver that waits for it. A campaign finds this, its case repeats it and is
/// shrunk to the one fault; the other driver passes. A campaign is not continued with a changed
/// program.
#[test]
fn campaigns_and_shrink_run_a_node_program() {
    let session = Session::new("nodes-campaign");
    session.write("driver.py", DRIVER);
    let fault = |kind: &str, more: &str| {
        format!("[[fault]]\nlink = \"it\"\ndirection = \"to-master\"\nkind = \"{kind}\"\n{more}\n")
    };
    let drop = fault("drop", "rate = 1.0\nfrom = \"2s\"\nuntil = \"2.3s\"");
    let late = fault("latency", "by = \"1ms\"\nfrom = \"1s\"\nuntil = \"1.5s\"");
    session.write(
        "asked.toml",
        &format!(
            "schema = 1\nname = \"asked\"\nrobot = \"none\"\nduration = \"5s\"\n\
             [device.it.text]\nbaud = 9600\n\
             command = [{{ request = \"volts\", reply = \"230.1 V\" }}]\n{drop}{late}"
        ),
    );
    let src = root().join("python/src");
    let program =
        |kind: &str| format!("PYTHONPATH={} exec python3 driver.py {kind}", src.display());
    let told = |arguments: &[&str], code: i32| {
        let output = session.hilrig(arguments);
        assert_eq!(
            output.status.code(),
            Some(code),
            "{arguments:?}: {output:?}"
        );
        format!("{}{}", text(&output.stdout), text(&output.stderr))
    };
    let campaign = ["campaign", "asked.toml", "--seeds", "0..2", "--node"];
    told(
        &[&campaign[..], &[&program("asks"), "--out", "sound"]].concat(),
        0,
    );
    let waits = program("waits");
    let found = told(&[&campaign[..], &[&waits, "--out", "night"]].concat(), 1);
    assert!(
        found.contains("2 failed") && found.contains("program-goes-on"),
        "{found}"
    );
    let case = found
        .lines()
        .find_map(|line| line.trim().strip_prefix("repeat with: hilrig run "));
    let case = case
        .and_then(|rest| rest.split(' ').next())
        .expect("a case");
    let again = told(&["run", case, "--node", &waits, "--out", "again"], 1);
    assert!(again.contains("its last sign of life was at 2."), "{again}");
    let small = told(&["shrink", case, "--node", &waits, "--out", "small"], 0);
    assert!(
        small.contains("drop") && !small.contains("latency"),
        "{small}"
    );
    let both = told(
        &[
            "shrink", case, "--node", &waits, "--exec", "true", "--out", "both",
        ],
        2,
    );
    assert!(both.contains("expected one program under test"), "{both}");
    session.write("driver.py", &format!("{DRIVER}# changed\n"));
    let more = [
        "campaign",
        "asked.toml",
        "--seeds",
        "0..3",
        "--node",
        &waits,
        "--out",
        "night",
    ];
    told(&more, 2);
}

/// A master polls the program, which sends, but never a reply.
#[test]
fn a_slave_that_never_replies_fails() {
    let session = Session::new("nodes-slave");
    session.write("driver.py", DRIVER);
    let src = root().join("python/src");
    let command = format!("PYTHONPATH={} exec python3 driver.py asks", src.display());
    let master = "schema = 1\nname = \"polled\"\nrobot = \"none\"\nduration = \"5s\"\n\
                  [device.plc.master]\ndescription = \"modbus-meter\"\n\
                  requests = [\"read voltage\"]\nperiod = \"500ms\"\n";
    let fault =
        "[[fault]]\nlink = \"plc\"\ndirection = \"to-device\"\nkind = \"drop\"\nrate = 0.01\n";
    for (more, expected) in [("", "FAIL"), (fault, "not observed")] {
        session.write("polled.toml", &format!("{master}{more}"));
        let output = session.hilrig(&["run", "polled.toml", "--node", &command, "--out", "o"]);
        let said = text(&output.stdout);
        let line = said.lines().find(|line| line.contains("requests-answered"));
        let line = line.unwrap_or_else(|| panic!("no check\n{said}"));
        assert!(line.contains("plc: none of 8 requests"), "{line}");
        assert!(line.contains(expected), "{line}");
    }
}

/// The program has started another program, and both ignore a request to end.
#[test]
fn a_program_that_exits_fails_the_run_and_leaves_nobody_behind() {
    let session = Session::new("nodes-exit");
    let mark = format!("hilrig-cli-left-{}", std::process::id());
    // The child reports that it runs, under the name that the test looks for.
    let child = format!(
        "sh -c \"trap : TERM HUP; grep -c {mark} /proc/\\$\\$/cmdline > up; sleep 600; : {mark}\""
    );
    let command = format!(
        "trap : TERM HUP; {child} & while ! test -s up; do sleep 0.01; done; echo no meter >&2; \
         exit 3"
    );
    session.write("scale.toml", &scenario(&command));
    let output = session.hilrig(&["run", "scale.toml", "--out", "o"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let said = text(&output.stdout);
    assert!(said.contains("FAIL node-programs"), "{said}");
    assert!(
        said.contains("scale exited (exit code 3) before it answered hello"),
        "{said}"
    );
    assert!(said.contains("| no meter"), "{said}");
    assert_eq!(session.read("o/node-scale.log"), "no meter\n");
    assert_eq!(session.read("up"), "1\n");
    // A killed process disappears when the machine has time for it.
    wait_until("its end", || !is_running(&mark));
}

/// A program that asks to be called again at once, over and over, would stop virtual time.
#[test]
fn a_program_that_always_asks_for_now_fails_the_run() {
    let session = Session::new("nodes-now");
    session.write(
        "now.py",
        "import sys, json\nfor line in sys.stdin:\n    m = json.loads(line)\n    \
         if 'hello' in m: print(json.dumps({'hello': {'hilrig_node': 1}}), flush=True)\n    \
         elif 'exchange' in m:\n        now = m['exchange']['now']\n        \
         print(json.dumps({'exchange': {'next': now, 'items': []}}), flush=True)\n    \
         elif 'end' in m: break\n",
    );
    let folder = session.folder.display();
    session.write(
        "now.toml",
        &scenario(&format!("exec python3 {folder}/now.py")),
    );
    let output = session.hilrig(&["run", "now.toml", "--json-nodes", "--out", "o"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let said = text(&output.stdout);
    assert!(
        said.contains("times in a row to be called again at once"),
        "{said}"
    );
}

/// After an interrupt the rig no longer waits for a silent program.
#[test]
fn an_interrupt_ends_the_wait_for_a_silent_program() {
    let session = Session::new("nodes-interrupt");
    session.write("scale.toml", &scenario("echo up > up; exec sleep 60"));
    let mut command = session.command(&["run", "scale.toml", "--out", "o"]);
    let child = command.spawn().expect("hilrig starts");
    wait_until("its start", || session.path("up").exists());
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status();
    assert!(sent.expect("kill starts").success());
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(130), "{output:?}");
    let said = text(&output.stdout);
    assert!(
        said.contains("scale had not answered hello when the run was stopped"),
        "{said}"
    );
    assert!(said.contains("ended by SIGINT"), "{said}");
    assert!(!said.contains("FAIL node-programs"), "{said}");
}

/// One program keeps the contract with the command of its scenario; one does not.
#[test]
fn a_program_is_tested_against_the_contract() {
    let session = Session::new("nodes-check");
    session.write("scale.toml", &scenario(&python("scale")));
    let output = session.hilrig(&["node", "check", "scale.toml", "--send", r"SI\r\n"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = text(&output.stdout);
    assert_eq!(said.matches("ok  ").count(), 10, "{said}");
    let output = session.hilrig(&["node", "check", "exit 3", "--json"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let said = text(&output.stdout);
    assert!(said.contains("\"verdict\": \"fail\""), "{said}");
    assert!(
        said.contains("it exited (exit code 3) before it answered hello"),
        "{said}"
    );
    let output = session.hilrig(&["node", "check", "true", "--port", "uart"]);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(
        text(&output.stderr).contains("--port: is \"uart\""),
        "{output:?}"
    );
}
