//! The other commands that run a user's program.

use core::time::Duration;
use std::process::{Command, Stdio};

use hilrig::realtime::clock::{Clock as _, WallClock};

use crate::support::*;

const READER: &str = "fd = port()\nwhile True:\n    os.read(fd, 100)\n";

/// `hilrig` in the bench's folder: its exit code and its output.
fn hilrig(bench: &Bench, args: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_hilrig"))
        .current_dir(&bench.folder)
        .args(args)
        .output()
        .expect("the binary is built");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    (
        output.status.code(),
        said + &String::from_utf8_lossy(&output.stderr),
    )
}

/// The bytes that a program received in a run are sent to it again, then to a program that fails
/// with them.
#[test]
fn a_capture_is_replayed_to_a_program_which_must_live() {
    let bench = Bench::new("replay", "2s", READER);
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    let replay = |exec: &str| {
        let args = ["replay", "out/capture.pcapng", "--speed", "10"];
        let exec = ["--exec", exec, "--exec-needs", "sonar"];
        let wait = ["--exec-wait", "60s", "--out", "replayed"];
        hilrig(&bench, &[&args[..], &exec, &wait].concat())
    };
    let (code, said) = replay("python3 program.py");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("program-alive"), "{said}");

    let (code, said) = replay("echo gone >&2; exit 3");
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("ended with exit code 3"), "{said}");
    assert!(said.contains("| gone"), "{said}");
    assert!(!bench.folder.join("replayed/ports").exists());
}

/// A capture of a user's program as a case: the expected behaviour today comes from that program.
#[test]
fn a_case_is_made_with_the_program_that_it_is_of() {
    let bench = Bench::new("case-from", "1s", READER);
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    let program = "import os\nfd = os.open(os.environ['HILRIG_PORT_LIDAR'], os.O_RDWR)\n\
                   while True:\n    os.read(fd, 100)\n";
    std::fs::write(bench.folder.join("lidar.py"), program).expect("a fresh file");
    let from = ["case", "from", "out/capture.pcapng", "-o", "made.toml"];
    let exec = ["--exec", "python3 lidar.py", "--exec-wait", "60s"];
    let needs = ["--exec-needs", "lidar"];
    let (code, said) = hilrig(&bench, &[&from[..], &exec, &needs].concat());
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("program-alive"), "{said}");
    let again = "run it with: hilrig run made.toml --exec 'python3 lidar.py'";
    assert!(said.contains(again), "{said}");
}

#[test]
fn a_campaign_runs_each_seed_with_the_program_and_groups_what_fails() {
    let python = "\
fd = port()
if os.environ['HILRIG_SEED'] == '1':
    sys.exit(3)
while True:
    os.read(fd, 100)
";
    let bench = Bench::new("campaign", "1s", python);
    let args = ["campaign", "sonar.toml", "--seeds", "0..2", "--out", "all"];
    let exec = ["--exec", "python3 program.py", "--exec-needs", "sonar"];
    let wait = ["--exec-wait", "60s"];
    let (code, said) = hilrig(&bench, &[&args[..], &exec, &wait].concat());
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("2 runs"), "{said}");
    assert!(said.contains("1  program-alive"), "{said}");
    assert!(said.contains("--exec 'python3 program.py'"), "{said}");
    // Without the program here, no case was minimised.
    assert!(said.contains("Not minimised: 0 faults in"), "{said}");
    let small = "make it small: hilrig shrink all/groups/01.toml --exec 'python3 program.py'";
    assert!(said.contains(small), "{said}");
    assert!(bench.folder.join("all/logs/sonar-1.log").exists());
    assert!(!bench.folder.join("all/logs/sonar-0.log").exists());
}

#[test]
fn a_scenario_is_made_smaller_while_the_program_fails_alike() {
    let bench = Bench::new("shrink", "60s", "");
    let args = ["shrink", "sonar.toml", "--out", "small"];
    let (code, said) = hilrig(&bench, &[&args[..], &["--exec", "exit 3"]].concat());
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("program-connected"), "{said}");
    let small = std::fs::read_to_string(bench.folder.join("small/case.toml")).expect("written");
    assert!(!small.contains("duration = \"60s\""), "{small}");
}

/// The bytes of a case are sent to the program; checks that need devices are not judged, and the
/// output says this.
#[test]
fn a_case_of_bytes_is_judged_by_what_the_program_says_to_it() {
    let bench = Bench::new("case", "1s", READER);
    let case = "\
case = 1
name = \"pong\"
end_ns = 500000000
[expect]
same_outputs = true
never = [\"base unknown-register\"]
[[link]]
name = \"sonar\"
baud = 9600
to_program = \"100000000 41 0A\"
from_program = \"200000000 42 0A\"
[scenario]
schema = 1
name = \"none\"
robot = \"rescue\"
duration = \"1s\"
[scenario.world]
start = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }
";
    std::fs::write(bench.folder.join("case.toml"), case).expect("a fresh file");
    let answers = "fd = port()\nos.write(fd, b'B\\n' if b'A' in os.read(fd, 9) else b'?')\n";
    std::fs::write(
        bench.folder.join("answers.py"),
        format!("import os\ndef port():\n    return os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)\n{answers}import time\ntime.sleep(600)\n"),
    )
    .expect("a fresh file");
    let run = |exec: &str| {
        let args = ["run", "case.toml", "--out", "played", "--exec", exec];
        hilrig(&bench, &[&args[..], &["--exec-wait", "60s"]].concat())
    };
    let (code, said) = run("python3 answers.py");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("the same 2 bytes"), "{said}");
    assert!(said.contains("not judged"), "{said}");

    let (code, said) = run("sed -i s/B/C/ answers.py; exec python3 answers.py");
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("FAIL same-outputs"), "{said}");
}

/// A client that leaves while it waits does not hold virtual time.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_client_that_leaves_while_it_waits_lets_the_run_end() {
    use std::io::Write as _;
    use std::os::unix::net::UnixStream;

    let bench = Bench::new("left", "2s", READER);
    let mut command = bench.command(&["--virtual", "--control"]);
    let mut child = command.stdout(Stdio::null()).spawn().expect("a child");
    let socket = bench.folder.join("out/ports/control");
    let clock = WallClock::start();
    let mut client = loop {
        match UnixStream::connect(&socket) {
            Ok(client) => break client,
            Err(_) => clock.sleep_until(clock.now() + Duration::from_millis(20)),
        }
        assert!(child.try_wait().expect("a child").is_none(), "it runs");
    };
    let request =
        r#"{"do":"wait","for":{"event":{"source":"sonar","rule":"break"}},"timeout":"1h"}"#;
    writeln!(client, "{request}").expect("it listens");
    drop(client);
    let ended = child.wait().expect("it ends");
    assert_eq!(ended.code(), Some(0));
}
