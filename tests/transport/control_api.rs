//! The control interface as programs in other languages see it: over the socket of a real rig, and
//! each condition in virtual time.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::Command;

use hilrig::realtime::control::{CLIENTS_MAX, LINE_MAX, NAME, obey};
use hilrig::run::Run;
use hilrig::run::check::Status;
use hilrig::scenario::Scenario;
use protocols::Instant;
use rustix::process::Signal;
use serde_json::Value;

use crate::processes::Running;
use crate::support::*;

struct Client(BufReader<UnixStream>);

impl Client {
    fn of(dir: &Path) -> Self {
        let stream = UnixStream::connect(dir.join(NAME)).expect("the rig listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("not zero");
        Self(BufReader::new(stream))
    }

    fn send(&mut self, request: &str) {
        writeln!(self.0.get_mut(), "{request}").expect("the rig reads");
    }

    fn answer(&mut self) -> Value {
        let mut answer = String::new();
        self.0.read_line(&mut answer).expect("the rig answers");
        serde_json::from_str(&answer).unwrap_or_else(|error| panic!("{answer:?}: {error}"))
    }

    fn ask(&mut self, request: &str) -> Value {
        self.send(request);
        self.answer()
    }
}

/// The contract, used from Python with its standard library alone.
const PYTHON: &str = r#"
import json, socket, sys
sock = socket.socket(socket.AF_UNIX); sock.connect(sys.argv[1]); sock.settimeout(120)
file = sock.makefile("rw")
def ask(**request):
    file.write(json.dumps(request) + "\n"); file.flush()
    return json.loads(file.readline())
hello = ask(do="hello")
assert hello["ok"] and hello["protocol"] == 1 and hello["tool"] == "hilrig", hello
lidar = [link for link in hello["links"] if link["name"] == "lidar"][0]
assert lidar["port"].endswith("/lidar") and lidar["baud"] == 115200, lidar
state = ask(do="state")
assert state["ok"] and not state["paused"] and state["speed"] == 1.0, state
assert set(state["pose"]) == {"x_m", "y_m", "heading_deg"}, state
assert ask(do="mission", action={"mode": "stop"})["ok"]
refused = ask(do="mission", action="fly")
assert not refused["ok"] and refused["key"] == "action", refused
at = ask(do="wait", timeout="10s", **{"for": {"bytes": {
    "link": "lidar", "direction": "to-master", "count": 100}}})
assert at["ok"] and at["held"] and at["at_ns"] > state["time_ns"], at
late = ask(do="wait", timeout="20ms", **{"for": {"event": {"rule": "never"}}})
assert late["ok"] and not late["held"], late
fault = ask(link="base", direction="to-device", kind="cut")
assert fault["ok"] and fault["id"] == 0, fault
assert ask(do="list")["faults"][0]["state"] in ("active", "planned")
assert ask(do="end", id=0)["ok"]
refused = ask(do="press", button="start")
assert not refused["ok"] and "buttons" in refused["message"], refused
assert not ask(do="step", by="1s")["ok"], "it does not stand"
paused = ask(do="pause")
assert paused["ok"] and ask(do="state")["paused"]
step = ask(do="step", by="50ms")
assert step["ok"] and step["at_ns"] >= paused["at_ns"] + 50_000_000, step
assert ask(do="state")["time_ns"] == step["at_ns"]
assert ask(do="speed", x=0.5)["ok"] and not ask(do="speed", x=1000)["ok"]
assert ask(do="resume")["ok"]
verdict = ask(do="verdict")
assert verdict["ok"] and len(verdict["checks"]) > 3, verdict
assert ask(do="quit")["ok"]
print("all asked")
"#;

#[test]
fn a_python_client_does_all_that_the_contract_says() {
    let dir = fresh_path("python_control");
    let case = fresh_path("python_control_case.toml");
    let up = Running::up(&dir, &["--case", case.to_str().expect("plain")]);
    let mut python = Command::new("python3");
    let socket = dir.join(NAME);
    let output = match python.arg("-c").arg(PYTHON).arg(&socket).output() {
        Ok(output) => output,
        Err(error) if std::env::var_os("CI").is_none() => return eprintln!("SKIPPED: {error}"),
        Err(error) => panic!("python3: {error}"),
    };
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let (status, said) = up.end();
    assert!(status.success(), "{said}");
    let (case, _) = Scenario::read(&case).expect("what was asked for is in the case");
    assert_eq!((case.mission.step.len(), case.fault.len()), (1, 1));
}

/// Silent clients, a client that sends half a line, and a client that never reads: the seventeenth
/// client is served. When all connections are used, the client with the longest silence gets a
/// message and is closed.
#[test]
fn silent_clients_keep_nobody_out() {
    let dir = fresh_path("silent");
    let up = Running::up(&dir, &[]);
    let mut silent: Vec<Client> = (0..CLIENTS_MAX).map(|_| Client::of(&dir)).collect();
    // By the second answer the rig has accepted all clients.
    for _ in 0..2 {
        assert_eq!(silent[1].ask("{\"do\":\"hello\"}")["ok"], true);
    }
    write!(silent[2].0.get_mut(), "{{\"do\":").expect("the rig reads");
    for number in 0..3 {
        let mut late = Client::of(&dir);
        assert_eq!(late.ask("{\"do\":\"state\"}")["ok"], true, "{number}");
    }
    // A silent client has lost its connection; a client that spoke has not.
    assert_eq!(silent[1].ask("{\"do\":\"list\"}")["ok"], true);
    let mut last = String::new();
    silent[0].0.read_to_string(&mut last).expect("hung up");
    assert!(last.contains("\"key\":\"clients\""), "{last}");

    up.signal(Signal::INT);
    let (status, said) = up.end();
    assert!(status.success(), "{said}");
}

/// No input is fatal, and the rig does not serve a client without end that does not read.
#[test]
fn malformed_huge_and_unread_lines_are_bounded() {
    let dir = fresh_path("floods");
    let up = Running::up(&dir, &[]);
    let mut bad = Client::of(&dir);
    for line in [
        "",
        "[]",
        "{\"do\":{}}",
        "{\"do\":\"wait\"}",
        "\u{0}",
        "{{{{",
    ] {
        assert_eq!(bad.ask(line)["ok"], false, "{line}");
    }
    let deep = "[".repeat(LINE_MAX / 2);
    assert_eq!(bad.ask(&deep)["ok"], false);
    let huge = "x".repeat(5 * LINE_MAX);
    assert_eq!(bad.ask(&huge)["key"], "request");

    let mut deaf = Client::of(&dir);
    let stream = deaf.0.get_mut();
    stream.set_nonblocking(true).expect("a socket");
    let flood = "{\"do\":\"state\"}\n".repeat(1000);
    for _ in 0..50 {
        if stream.write(flood.as_bytes()).is_err() {
            break;
        }
    }
    let state = bad.ask("{\"do\":\"state\"}");
    assert!(state["control"]["refused"].as_u64() >= Some(8), "{state}");
    drop(deaf);
    up.signal(Signal::INT);
    assert!(up.end().0.success());
}

#[test]
fn a_client_that_waits_keeps_nobody_waiting_and_is_told_of_the_end() {
    let dir = fresh_path("waits");
    let up = Running::up(&dir, &[]);
    let (mut one, mut other) = (Client::of(&dir), Client::of(&dir));
    one.send("{\"do\":\"wait\",\"for\":{\"event\":{\"rule\":\"never\"}},\"timeout\":\"1h\"}");
    for _ in 0..3 {
        assert_eq!(other.ask("{\"do\":\"state\"}")["ok"], true);
    }
    assert_eq!(other.ask("{\"do\":\"quit\"}")["ok"], true);
    assert_eq!(one.answer()["key"], "run");
    assert!(up.end().0.success());
}

fn run_of(more: &str) -> Run {
    let text = format!(
        "schema = 1\nname = \"test\"\nrobot = \"rescue\"\nduration = \"60s\"\n{more}\n\
         [world]\nstart = {{ x_m = 1.5, y_m = 1.2, heading_deg = 90 }}\n[[world.wall]]\n\
         path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n"
    );
    let (scenario, source) = Scenario::parse(Path::new("<test>"), text).expect("sound");
    Run::new(scenario, &source, None).expect("can be wired")
}

fn asked(run: &mut Run, request: &str) -> Value {
    let line = obey(run, request.as_bytes(), Instant::ZERO).line();
    serde_json::from_str(&line).expect("an object")
}

fn waited(run: &mut Run, condition: &str, timeout: &str) -> Value {
    let request = format!("{{\"do\":\"wait\",\"for\":{condition},\"timeout\":\"{timeout}\"}}");
    asked(run, &request)
}

/// In virtual time a wait advances the run: each condition becomes true in a mission.
#[test]
fn each_condition_comes_true_in_virtual_time() {
    let mut run = run_of("[mission]\nwaypoints_m = [[1.5, 1.9]]");
    let comes = [
        "{\"bytes\":{\"link\":\"lidar\",\"direction\":\"to-master\",\"count\":500}}",
        "{\"bytes\":{\"link\":\"lidar\",\"direction\":\"to-master\",\"hex\":\"fa a0\"}}",
        "{\"frame\":{\"link\":\"lidar\",\"direction\":\"to-master\"}}",
        "{\"frame\":{\"link\":\"base\",\"direction\":\"to-device\"}}",
        "{\"event\":{\"rule\":\"motors-on\",\"source\":\"base\"}}",
        "{\"map\":{\"known_min\":0.001}}",
        "{\"visited\":1}",
        "{\"pose\":{\"near_m\":[1.5,1.9],\"within_m\":0.4}}",
    ];
    for condition in comes {
        let said = waited(&mut run, condition, "40s");
        assert_eq!(said["held"], true, "{condition}: {said}");
        assert_eq!(said["at_ns"], run.rig.now().as_nanos());
    }
    let axes = asked(&mut run, "{\"do\":\"state\"}")["axes"].clone();
    let name = axes[0]["name"].as_str().expect("a name").to_owned();
    let axis = format!("{{\"axis\":{{\"name\":\"{name}\",\"op\":\"<=\",\"value\":1000}}}}");
    assert_eq!(waited(&mut run, &axis, "1s")["held"], true);
    let register = "{\"register\":{\"device\":\"base\",\"address\":0,\"op\":\">=\",\"value\":0}}";
    assert_eq!(waited(&mut run, register, "1s")["held"], true);
    assert_eq!(
        asked(&mut run, "{\"do\":\"step\",\"by\":\"250ms\"}")["ok"],
        true
    );
}

#[test]
fn what_does_not_come_is_told_at_its_time_and_what_there_is_not_at_once() {
    let mut run = run_of("[mission]\nwaypoints_m = [[1.5, 1.9]]");
    let never = waited(&mut run, "{\"event\":{\"rule\":\"never\"}}", "123ms");
    assert_eq!(
        (&never["held"], &never["at"]),
        (&false.into(), &"123ms".into())
    );
    let refused = [
        (
            "{\"bytes\":{\"link\":\"bus\",\"direction\":\"to-master\",\"count\":1}}",
            "link",
        ),
        (
            "{\"register\":{\"device\":\"arm\",\"address\":1,\"value\":1}}",
            "device",
        ),
        ("{\"axis\":{\"name\":\"arm\",\"value\":1}}", "name"),
        ("{\"visited\":2}", "visited"),
    ];
    for (condition, key) in refused {
        let said = waited(&mut run, condition, "1s");
        assert_eq!(
            (&said["ok"], &said["key"]),
            (&false.into(), &key.into()),
            "{said}"
        );
    }
    assert_eq!(run.rig.now(), Instant::from_millis(123));
}

/// Steps with a condition are done in order when their conditions come true. The saved case waits
/// for the same conditions and gives the same bytes.
#[test]
fn steps_of_a_mission_wait_for_conditions() {
    let mut run = run_of(
        "[[mission.step]]\nwhen = { event = { rule = \"connected\" } }\ntimeout = \"1ms\"\n\
         do = { mode = \"stop\" }\n[[mission.step]]\nat = \"1s\"\ndo = \"connect\"",
    );
    run.go_on_until(Instant::from_secs(1));
    let checks = run.checks();
    let failed = checks.iter().find(|check| check.name == "mission-step-1");
    assert_eq!(
        failed.map(|check| check.status),
        Some(Status::Fail),
        "{checks:?}"
    );

    let mut run = run_of(
        "[[mission.step]]\nat = \"1s\"\ndo = { drive = [10, 10] }\n\
         [[mission.step]]\nwhen = { axis = { name = \"left wheel\", op = \">\", value = 0 } }\n\
         timeout = \"5s\"\ndo = { mode = \"stop\" }\n\
         [[mission.step]]\nwhen = { bytes = { link = \"lidar\", direction = \"to-master\", \
         count = 2000 } }\ndo = { waypoints-m = [[1.5, 1.5]] }",
    );
    run.go_on_until(Instant::from_secs(10));
    let checks = run.checks();
    let passed = checks
        .iter()
        .filter(|check| check.name.starts_with("mission-step-") && check.status == Status::Pass);
    assert_eq!(passed.count(), 2, "{checks:?}");
    let case = run.case_so_far();
    let waits = case.mission.step.iter().map(|step| step.when.is_some());
    assert_eq!(waits.collect::<Vec<_>>(), [false, true, true]);
    let (case, source) = Scenario::parse(Path::new("<case>"), case.to_toml()).expect("a case");
    let again = Run::new(case, &source, None)
        .expect("can be wired")
        .finish();
    assert_eq!(again.trace_hash, run.rig.trace_hash());
}
