//! `hilrig up` and `hilrig dut` as separate processes, tested only through their ports, their
//! output and signals.

use core::time::Duration;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;

use hilrig::capture::{Capture, Record};
use hilrig::realtime::clock::{Clock, WallClock};
use hilrig::realtime::transport::{Pty, Transport};
use protocols::xv11;
use protocols::{Decode, Instant, LineConfig};
use rustix::process::{Pid, Signal, kill_process};
use serialport::TTYPort;

use crate::support::*;

const SHORT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/transport/short.toml");
const LIDAR: LineConfig = LineConfig::new_8n1(xv11::BAUD);

/// A process whose output is followed line by line. Killed when dropped.
pub(crate) struct Running {
    child: Child,
    lines: Receiver<String>,
    seen: Vec<String>,
}

impl Running {
    pub(crate) fn start(args: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_hilrig"))
            .args(args)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the binary is built");
        let (sender, lines) = channel();
        let stdout: Box<dyn Read + Send> = Box::new(child.stdout.take().expect("piped"));
        let stderr: Box<dyn Read + Send> = Box::new(child.stderr.take().expect("piped"));
        for output in [stdout, stderr] {
            let sender = sender.clone();
            thread::spawn(move || {
                for line in BufReader::new(output).lines().map_while(Result::ok) {
                    if sender.send(line).is_err() {
                        return;
                    }
                }
            });
        }
        Self {
            child,
            lines,
            seen: Vec::new(),
        }
    }

    pub(crate) fn up(dir: &Path, more: &[&str]) -> Self {
        let dir = dir.to_str().expect("plain");
        let mut up = Self::start(&[&["up", SHORT, "--dir", dir], more].concat());
        up.wait_for("running until");
        up
    }

    fn dut(dir: &Path) -> Self {
        let dir = dir.to_str().expect("plain");
        let mut dut = Self::start(&["dut", "--dir", dir]);
        dut.wait_for("opened");
        dut
    }

    /// Waits for a line that contains `text`.
    pub(crate) fn wait_for(&mut self, text: &str) -> String {
        let clock = WallClock::start();
        loop {
            let left = Instant::ZERO + PATIENCE - clock.now();
            match self.lines.recv_timeout(left) {
                Ok(line) => {
                    self.seen.push(line.clone());
                    if line.contains(text) {
                        return line;
                    }
                }
                Err(_) => panic!("no {text:?} in:\n{}", self.seen.join("\n")),
            }
        }
    }

    /// Waits for lines that contain `texts`, in any order.
    fn wait_for_all(&mut self, texts: &[&str]) {
        let mut missing = texts.to_vec();
        while !missing.is_empty() {
            // Any line.
            let line = self.wait_for("");
            missing.retain(|text| !line.contains(*text));
        }
    }

    pub(crate) fn signal(&self, signal: Signal) {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        kill_process(pid.expect("a pid"), signal).expect("still there");
    }

    /// Waits for the end; returns status and output.
    pub(crate) fn end(mut self) -> (ExitStatus, String) {
        let mut status = None;
        wait_until(|| {
            status = self.child.try_wait().expect("our own child");
            status.is_some()
        });
        while let Ok(line) = self.lines.recv() {
            self.seen.push(line);
        }
        (status.expect("just seen"), self.seen.join("\n"))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub(crate) fn client_at(path: &Path, baud: u32) -> TTYPort {
    let builder = serialport::new(path.to_string_lossy(), baud).timeout(Duration::from_millis(100));
    TTYPort::open(&builder).expect("the port is free")
}

/// Reads whole lidar packets until there are `count`.
fn read_packets(client: &mut TTYPort, count: usize) {
    let mut decoder = xv11::Decoder::default();
    let (mut packets, mut buf) = (0, [0; 512]);
    wait_until(|| {
        let len = client.read(&mut buf).unwrap_or(0);
        packets += decoder.push(&buf[..len]).filter(Result::is_ok).count();
        packets >= count
    });
}

/// The rig outlives its robot: the robot is killed at work and started again, and continues its
/// mission.
#[test]
fn a_robot_that_is_killed_at_work_can_be_started_again() {
    let dir = fresh_path("started_again");
    let mut up = Running::up(&dir, &[]);

    let mut first = Running::dut(&dir);
    up.wait_for("base port-opened");
    first.wait_for("mode waypoint");
    up.wait_for("motors-on");
    first.signal(Signal::KILL);
    // The base has lost its master and stops, maybe before the rig sees the closing. A port whose
    // closing was seen can be opened again.
    let ports = ["lidar", "motor", "base", "radio"];
    let closed = ports.map(|port| format!("{port} port-closed"));
    let closed = closed.iter().map(String::as_str);
    up.wait_for_all(&closed.chain(["motors-stopped"]).collect::<Vec<_>>());
    drop(first);

    let mut second = Running::dut(&dir);
    up.wait_for("base port-opened");
    second.wait_for(", at (");
    second.signal(Signal::TERM);
    let (status, said) = second.end();
    assert!(status.success(), "{said}");

    up.signal(Signal::INT);
    let (status, said) = up.end();
    assert_eq!(status.code(), Some(0), "{said}");
    assert!(said.contains("late by"), "{said}");
    assert!(!dir.exists(), "the ports are removed");
}

#[test]
fn a_robot_in_a_process_of_its_own_reaches_its_waypoint() {
    let dir = fresh_path("waypoint");
    let mut up = Running::up(&dir, &[]);
    let mut dut = Running::dut(&dir);
    up.wait_for("waypoint 1 of 2 visited");
    dut.signal(Signal::INT);
    dut.wait_for("ran ");
    drop(dut);
    up.signal(Signal::TERM);
    let (status, said) = up.end();
    assert_eq!(status.code(), Some(0), "{said}");
}

/// Any program can be a client: here one that only reads the lidar.
#[test]
fn a_foreign_client_reads_whole_packets_from_the_lidars_port() {
    let dir = fresh_path("foreign");
    let mut up = Running::up(&dir, &["--duration", "30s"]);
    up.wait_for("locked");
    let mut client = client_at(&dir.join("lidar"), xv11::BAUD);
    read_packets(&mut client, 90);
    up.signal(Signal::INT);
    assert!(up.end().0.success());
}

/// H6: the rig is stopped for a second and a half, as by a debugger or a busy machine. Its clock
/// stops, so a client that reads loses no packet and is blamed for nothing.
#[test]
fn a_rig_that_was_stopped_loses_nothing_and_blames_nobody() {
    let dir = fresh_path("stopped");
    let mut up = Running::up(&dir, &["--duration", "60s"]);
    up.wait_for("locked");
    let mut client = client_at(&dir.join("lidar"), xv11::BAUD);
    read_packets(&mut client, 90);
    up.signal(Signal::STOP);
    WallClock::start().sleep_until(Instant::from_millis(1_500));
    up.signal(Signal::CONT);
    // The port holds at most 186 earlier packets.
    let mut decoder = xv11::Decoder::default();
    let (mut indices, mut buf) = (Vec::new(), [0; 512]);
    wait_until(|| {
        let len = client.read(&mut buf).unwrap_or(0);
        let frames = decoder.push(&buf[..len]).filter_map(Result::ok);
        indices.extend(frames.map(|frame| frame.index()));
        indices.len() >= 270
    });
    up.signal(Signal::INT);
    let (status, said) = up.end();
    assert!(status.success(), "{said}");
    let follows = |pair: &[u8]| pair[1] == if pair[0] == 89 { 0 } else { pair[0] + 1 };
    assert!(indices.windows(2).all(follows), "{indices:?}");
    // On a busy machine the note may be older: there is one a second.
    assert!(said.contains("rig time stood meanwhile"), "{said}");
    assert!(!said.contains("did not read"), "{said}");
    assert!(!said.contains("broke a rule"), "{said}");
}

#[test]
fn up_says_which_client_has_the_wrong_rate() {
    let dir = fresh_path("told");
    let mut up = Running::up(&dir, &["--duration", "30s"]);
    let _client = client_at(&dir.join("lidar"), 9600);
    let line = up.wait_for("wrong-baud");
    assert!(
        line.ends_with("client at 9600 baud, expected 115200: it reads garbage"),
        "{line}"
    );
}

/// A real device on a cable; here a terminal that the test holds.
#[test]
fn a_device_that_is_pulled_while_the_rig_runs_ends_it_with_an_error() {
    let dir = fresh_dir("pulled_device");
    let mut device = Pty::open(&dir, "device", LIDAR).expect("a free name");
    let place = format!("lidar={}", device.path().display());
    let ports: PathBuf = fresh_path("pulled_ports");
    let up = Running::up(&ports, &["--device-at", &place]);
    let mut client = client_at(&ports.join("lidar"), xv11::BAUD);
    let mut open = false;
    wait_until(|| {
        let _ = device.read(&mut [0; 16]);
        open |= device.next_event().is_some();
        open
    });
    assert_eq!(device.write(b"from the real device"), 20);
    let mut read = Vec::new();
    wait_until(|| {
        read.extend(client_has(&mut client));
        read.len() >= 20
    });
    assert_eq!(read, b"from the real device");

    drop(device);
    let (status, said) = up.end();
    assert_eq!(status.code(), Some(2), "{said}");
    assert!(said.contains("device: the port went away"), "{said}");
    assert!(!ports.exists(), "the ports are removed all the same");
}

/// A killed rig removes nothing. The next rig in the same directory must work nevertheless.
#[test]
fn a_rig_that_was_killed_is_followed_by_another_in_the_same_directory() {
    let dir = fresh_path("killed");
    let first = Running::up(&dir, &[]);
    first.signal(Signal::KILL);
    drop(first);
    assert!(dir.join("lidar").is_symlink(), "left behind");

    let mut second = Running::up(&dir, &[]);
    second.wait_for("locked");
    read_packets(&mut client_at(&dir.join("lidar"), xv11::BAUD), 1);
    second.signal(Signal::INT);
    let (status, said) = second.end();
    assert!(status.success(), "{said}");
    assert!(!dir.join("lidar").is_symlink());
    std::fs::remove_dir(&dir).expect("nothing is in it any more");
}

/// Message of a command that cannot open a port: one line that names the port.
#[test]
fn ports_that_cannot_be_had_are_named_and_the_exit_code_is_2() {
    let dir = fresh_path("cannot");
    let dir_text = dir.to_str().expect("plain");
    let said = |args: &[&str]| {
        let (status, said) = Running::start(args).end();
        assert_eq!(status.code(), Some(2), "{said}");
        said.replace(dir_text, "DIR")
    };
    assert_eq!(
        said(&[
            "up",
            SHORT,
            "--dir",
            dir_text,
            "--dut-at",
            "lidar=/dev/ttyNONE"
        ]),
        "error: /dev/ttyNONE: no such port: expected a serial port such as /dev/ttyUSB0 or a link \
         to one"
    );
    assert_eq!(
        said(&[
            "up",
            SHORT,
            "--dir",
            dir_text,
            "--dut-at",
            "sonar=/dev/ttyUSB0"
        ]),
        "error: --dut-at sonar=/dev/ttyUSB0: no such link; expected one of lidar, motor, base, \
         radio"
    );
    assert_eq!(
        said(&["dut", "--dir", dir_text]),
        "error: DIR: no rig runs here: expected a directory of `hilrig up`, or --scenario FILE"
    );
    assert!(!dir.exists(), "nothing is left behind");

    let _up = Running::up(&dir, &[]);
    assert_eq!(
        said(&["up", SHORT, "--dir", dir_text]),
        "error: DIR: another rig has its ports here: stop it or choose another directory"
    );
    let _first = Running::dut(&dir);
    assert_eq!(
        said(&["dut", "--dir", dir_text]),
        "error: DIR/lidar: another program has this port: expected to have it alone"
    );
}

/// The PC's end is the scenario's own unless an option names it, and has no rate.
#[test]
fn the_table_names_the_pcs_end_only_if_it_is_wanted() {
    let dir = fresh_path("table");
    let table = |more: &[&str]| {
        let up = Running::up(&dir, more);
        up.signal(Signal::INT);
        let (status, said) = up.end();
        assert!(status.success(), "{said}");
        let rows = said.lines().filter(|line| line.contains("/table-"));
        let first_and_third = |row: &str| {
            let mut words = row.split_ascii_whitespace();
            format!(
                "{} {}",
                words.next().unwrap_or(""),
                words.nth(1).unwrap_or("")
            )
        };
        rows.map(first_and_third).collect::<Vec<_>>()
    };
    let own = ["lidar 115200", "motor any", "base 1000000", "radio 460800"];
    assert_eq!(table(&[]), own);
    assert_eq!(table(&["--pc"]), [&own[..], &["pc any"]].concat());
}

/// A rig started again with the same command keeps its earlier capture.
#[test]
fn a_rig_that_is_started_again_overwrites_no_capture() {
    let dir = fresh_path("again-capture");
    let path = dir.with_extension("pcapng");
    let aside = dir.with_extension("1.pcapng");
    let file = path.to_str().expect("plain");
    let record = || {
        let up = Running::up(&dir, &["--capture", file]);
        up.signal(Signal::INT);
        let (status, said) = up.end();
        assert!(status.success(), "{said}");
    };
    record();
    let first = std::fs::read(&path).expect("written");
    record();
    assert_eq!(std::fs::read(&aside).expect("put aside"), first);
    assert!(Capture::read(&path).expect("readable").broken.is_none());
    for file in [path, aside] {
        std::fs::remove_file(file).expect("ours");
    }
}

/// The capture of a killed process: whole blocks, up to less than a second before its end, readable
/// by our reader and by Wireshark's. The stream in it is the lidar's: the clock of the run begins
/// at its boot text.
#[test]
fn a_capture_is_readable_after_the_process_was_killed() {
    let dir = fresh_path("killed-capture");
    let path = dir.with_extension("pcapng");
    let _ = std::fs::remove_file(&path);
    let file = path.to_str().expect("plain");
    let up = Running::up(&dir, &["--capture", file]);
    let len = || std::fs::metadata(&path).map_or(0, |data| data.len());
    // Bytes after the file's head were written, more than once.
    let head = len();
    wait_until(|| len() > head + 200);
    let first = len();
    wait_until(|| len() > first);
    up.signal(Signal::KILL);
    let (status, _) = up.end();
    assert_eq!(status.code(), None, "killed by a signal");

    let capture = Capture::read(&path).expect("readable");
    assert_eq!((capture.broken, capture.skipped), (None, 0));
    assert_eq!(capture.sections[0].fact("clock"), Some("utc"));
    let of_lidar = |record: &&Record| capture.links[record.link].name == "lidar";
    let bytes = capture.records.iter().filter(of_lidar);
    let bytes: Vec<u8> = bytes.flat_map(|record| record.bytes.clone()).collect();
    let banner = b"Piccolo Laser Distance Scanner";
    assert!(
        bytes.windows(banner.len()).any(|part| part == banner),
        "{} bytes of the lidar",
        bytes.len()
    );
    let start = capture.sections[0].fact("start_ns").expect("real time");
    let start: u64 = start.parse().expect("a number");
    let times = || capture.records.iter().map(|record| record.at.as_nanos());
    assert!(times().all(|at| at >= start) && times().is_sorted());

    let tshark = Command::new("tshark").arg("-nr").arg(&path).output();
    match tshark {
        Ok(output) => {
            let lines = String::from_utf8_lossy(&output.stdout).lines().count();
            assert_eq!(lines, capture.records.len());
        }
        Err(error) if std::env::var_os("CI").is_none() => eprintln!("SKIPPED: {error}"),
        Err(error) => panic!("tshark: {error}"),
    }
    let _ = std::fs::remove_file(&path);
}

/// H5: an FTDI adapter cuts the stream anywhere. At least half of a client's reads end inside a
/// packet, a port opened in mid-stream begins inside one, and the stream is whole.
#[test]
fn a_client_behind_an_adapter_reads_pieces_of_packets() {
    let dir = fresh_path("adapter");
    let text = std::fs::read_to_string(SHORT).expect("shipped");
    let scenario = fresh_path("adapter.toml");
    let text = format!("{text}\n[link.lidar]\nadapter = \"ftdi\"\n");
    std::fs::write(&scenario, text).expect("can be written");
    let [dir_text, scenario] = [&dir, &scenario].map(|path| path.to_str().expect("plain"));
    let mut up = Running::start(&["up", scenario, "--dir", dir_text, "--duration", "60s"]);
    up.wait_for("locked");
    let (mut reads, mut inside, mut begun, mut indices) = (0_u32, 0_u32, 0, Vec::new());
    // The position at which a client joins the stream is random; one of 22 positions is the first
    // byte of a packet.
    for _ in 0..6 {
        let mut client = client_at(&dir.join("lidar"), xv11::BAUD);
        let (mut decoder, mut buf, mut first) = (xv11::Decoder::default(), [0; 512], None);
        indices.clear();
        wait_until(|| {
            let len = client.read(&mut buf).unwrap_or(0);
            first = first.or(buf[..len].first().copied());
            let frames = decoder.push(&buf[..len]).filter_map(Result::ok);
            indices.extend(frames.map(|frame| frame.index()));
            reads += u32::from(len > 0);
            inside += u32::from(len > 0 && decoder.pending() > 0);
            indices.len() >= 90
        });
        begun += u32::from(first != Some(xv11::START) && decoder.discarded() > 0);
    }
    up.signal(Signal::INT);
    assert!(up.end().0.success());
    assert!(
        inside * 2 >= reads,
        "{inside} of {reads} reads end inside a packet"
    );
    assert!(begun > 0, "each began with a packet's first byte");
    let follows = |pair: &[u8]| pair[1] == if pair[0] == 89 { 0 } else { pair[0] + 1 };
    assert!(indices.windows(2).all(follows), "{indices:?}");
}
