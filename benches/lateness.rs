//! How late is the rig in real time? `hilrig up` as users start it, without a client at its ports,
//! with a program that reads the lidar, and with a whole robot. The figures are those that `up`
//! itself reports when it ends, beside the goals for a quiet machine: 0.05, 0.2 and 2 ms.
//!
//! First comes the host alone, a thread that sleeps for one millisecond at a time: no rig on this
//! machine can be better. Nothing is judged, because other work on the machine affects the figures.
//! `cargo bench --bench lateness`, `-- --seconds 60` for another duration.

use core::time::Duration;
use std::fs::File;
use std::io::{Read, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use hilrig::realtime::Lateness;
use hilrig::realtime::clock::{Clock, WallClock};
use protocols::Instant;

/// A scenario whose lidar turns without a robot, so that it sends.
const SCENARIO: &str = "schema = 1\nname = \"lateness\"\nrobot = \"rescue\"\nduration = \"600s\"\n\
    [device.lidar.xv11]\nsupply = { regulated-rpm = 300 }\n\
    [mission]\nwaypoints_m = [[1.0, 2.2], [2.1, 2.1], [2.1, 0.9], [1.0, 1.0]]\n\
    [world]\nstart = { x_m = 1.0, y_m = 1.0, heading_deg = 90 }\n[[world.wall]]\n\
    path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n";

/// The clients at the ports.
#[derive(Clone, Copy)]
enum Clients {
    None,
    LidarReader,
    Robot,
}

/// A process that ends when its owner is dropped.
struct Process(Child);

impl Process {
    fn start(arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
        command.args(arguments);
        command.stdout(Stdio::piped()).stderr(Stdio::null());
        Self(command.spawn().expect("the command starts"))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A thread that only wakes up every millisecond.
fn host(seconds: u64) -> Lateness {
    let clock = WallClock::start();
    let mut lateness = Lateness::default();
    for millis in 1..=seconds * 1000 {
        let due = Instant::from_millis(millis);
        if clock.now() < due {
            clock.sleep_until(due);
            lateness.record(clock.now() - due);
        }
    }
    lateness
}

/// The report of `hilrig up` after `seconds` with such clients.
fn rig(folder: &Path, seconds: u64, clients: Clients) -> String {
    let (scenario, ports) = (folder.join("lateness.toml"), folder.join("ports"));
    std::fs::write(&scenario, SCENARIO).expect("can be written");
    let [scenario, dir] = [&scenario, &ports].map(|path| path.to_str().expect("plain"));
    let duration = format!("{seconds}s");
    let mut up = Process::start(&["up", scenario, "--dir", dir, "--duration", &duration]);
    let _robot = match clients {
        Clients::None => None,
        Clients::LidarReader => {
            let lidar = ports.join("lidar");
            std::thread::spawn(move || read_to_the_end(&lidar));
            None
        }
        Clients::Robot => {
            wait_for(&ports.join("radio"));
            Some(Process::start(&["dut", "--dir", dir]))
        }
    };
    let mut said = String::new();
    let stdout = up.0.stdout.as_mut().expect("piped");
    stdout.read_to_string(&mut said).expect("text");
    let late = said.lines().find_map(|line| line.split_once(", late by "));
    late.expect("up tells how late it was").1.to_owned()
}

fn wait_for(port: &Path) {
    let clock = WallClock::start();
    while !port.exists() && clock.now() < Instant::from_secs(10) {
        clock.sleep_until(clock.now() + Duration::from_millis(10));
    }
}

/// Reads the port as `cat` does.
fn read_to_the_end(port: &Path) {
    wait_for(port);
    let mut file = File::open(port).expect("offered");
    let mut buf = [0; 512];
    while let Ok(1..) = file.read(&mut buf) {}
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let is_bench = arguments.iter().any(|argument| argument == "--bench");
    let given = arguments
        .iter()
        .skip_while(|argument| *argument != "--seconds");
    let given = given.skip(1).find_map(|seconds| seconds.parse().ok());
    let seconds = given.unwrap_or(if is_bench { 10 } else { 1 });
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("lateness");
    std::fs::create_dir_all(&folder).expect("room");
    let mut out = std::io::stdout();
    let mut tell = |who: &str, what: &str| {
        writeln!(out, "{who:<24} {what}").expect("stdout is open");
    };
    tell(
        "goal, quiet machine",
        "0.05 ms (p50), 0.20 ms (p99), 2.00 ms (max)",
    );
    let host = host(seconds).to_string();
    tell("host alone", host.trim_start_matches("late by "));
    for (who, clients) in [
        ("rig, no client", Clients::None),
        ("rig, lidar read", Clients::LidarReader),
        ("rig and robot", Clients::Robot),
    ] {
        tell(who, &rig(&folder, seconds, clients));
    }
}
