//! Faults changed by hand while `hilrig up` runs.

use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Command, Output};

use hilrig::realtime::control::{LINE_MAX, NAME};
use hilrig::run::Run;
use hilrig::scenario::Scenario;
use rustix::process::Signal;

use crate::processes::Running;
use crate::support::*;

/// A client of the socket.
struct Client(BufReader<UnixStream>);

impl Client {
    fn of(dir: &Path) -> Self {
        let stream = UnixStream::connect(dir.join(NAME)).expect("the rig listens");
        Self(BufReader::new(stream))
    }

    fn ask(&mut self, request: &[u8]) -> String {
        self.0.get_mut().write_all(request).expect("the rig reads");
        let mut answer = String::new();
        self.0.read_line(&mut answer).expect("the rig answers");
        answer
    }
}

fn fault(dir: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    command.arg("fault").arg("--dir").arg(dir).args(args);
    command.output().expect("the binary is built")
}

fn text(bytes: &[u8]) -> &str {
    core::str::from_utf8(bytes).expect("the command speaks UTF-8")
}

/// Actions by hand are not lost: the case that `up` leaves has the same faults when it runs in
/// virtual time, windows and strikes alike.
#[test]
fn faults_added_by_hand_are_in_the_case_and_in_its_replay() {
    let dir = fresh_path("by_hand");
    let case = fresh_path("by_hand_case.toml");
    let mut up = Running::up(&dir, &["--case", case.to_str().expect("plain")]);
    up.wait_for("locked");

    let flips = "link=lidar direction=to-master kind=flip rate=0.01";
    let flips: Vec<&str> = ["add"].into_iter().chain(flips.split(' ')).collect();
    assert_eq!(text(&fault(&dir, &flips).stdout), "0\n");
    let cut = "{\"do\":\"add\",\"fault\":{\"link\":\"base\",\"direction\":\"to-device\",\"kind\":\"cut\"}}\n";
    let mut client = Client::of(&dir);
    assert!(
        client
            .ask(cut.as_bytes())
            .starts_with("{\"ok\":true,\"id\":1,")
    );
    for id in 2..12 {
        let latency = "{\"do\":\"add\",\"fault\":{\"link\":\"pc\",\"direction\":\"to-device\",\"kind\":\"cut\"}}\n";
        let answer = client.ask(latency.as_bytes());
        assert!(
            answer.starts_with(&format!("{{\"ok\":true,\"id\":{id},")),
            "{answer}"
        );
    }
    assert!(fault(&dir, &["end", "1"]).status.success());
    let listed = fault(&dir, &["list"]);
    assert_eq!(text(&listed.stdout).lines().count(), 12);
    assert!(
        text(&listed.stdout)
            .lines()
            .nth(1)
            .is_some_and(|line| line.contains("\"over\""))
    );
    up.wait_for("fault-ended");
    up.signal(Signal::INT);
    let (status, said) = up.end();
    assert!(status.success(), "{said}");
    // Printed for the reader: the time of a change depends on the machine and is not judged.
    println!(
        "{}",
        said.lines()
            .find(|line| line.contains("by hand"))
            .expect("told")
    );
    assert!(!dir.exists(), "the socket is removed");

    let (scenario, source) = Scenario::read(&case).expect("what up writes can be read");
    let _ = std::fs::remove_file(&case);
    assert!(scenario.fault.len() > 12, "no flip in some thousand bytes");
    assert!(scenario.fault.iter().all(|fault| fault.rate.is_none()));
    let again = Run::new(scenario.clone(), &source, None)
        .expect("sound")
        .finish();
    assert_eq!(again.case.fault, scenario.fault);
}

#[test]
fn requests_that_make_no_sense_disturb_nobody() {
    let dir = fresh_path("nonsense");
    let mut up = Running::up(&dir, &[]);
    let (mut good, mut bad) = (Client::of(&dir), Client::of(&dir));
    let list = b"{\"do\":\"list\"}\n";
    assert!(
        bad.ask(&[0xFF, 0x00, b'\n'])
            .starts_with("{\"ok\":false,\"key\":\"request\"")
    );
    let mut endless = vec![b'{'; 3 * LINE_MAX];
    endless.push(b'\n');
    assert!(
        bad.ask(&endless)
            .contains("is too long, expected at most 16384 bytes a line")
    );
    assert!(bad.ask(list).starts_with("{\"ok\":true"), "it may go on");
    drop(bad);
    assert!(good.ask(list).starts_with("{\"ok\":true"));

    let refused = fault(
        &dir,
        &["add", "link=bus", "direction=to-master", "kind=cut"],
    );
    assert_eq!(refused.status.code(), Some(2));
    assert_eq!(
        text(&refused.stderr),
        "error: link: is \"bus\", expected one of lidar, motor, base, radio, pc\n"
    );
    up.signal(Signal::INT);
    up.wait_for("ran ");
}

#[test]
fn a_socket_that_a_killed_rig_left_is_replaced() {
    let dir = fresh_path("left_socket");
    let first = Running::up(&dir, &[]);
    first.signal(Signal::KILL);
    drop(first);
    assert!(dir.join(NAME).exists(), "left behind");
    let refused = fault(&dir, &["list"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        text(&refused.stderr).contains("no rig answers here"),
        "{refused:?}"
    );

    let second = Running::up(&dir, &[]);
    assert!(fault(&dir, &["list"]).status.success());
    second.signal(Signal::INT);
    assert!(second.end().0.success());
    assert!(!dir.join(NAME).exists());
    let _ = std::fs::remove_dir(&dir);
}
