//! The PC's end of the radio as a port: there is no UART, so it has no baud rate.

use core::time::Duration;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;

use hilrig::realtime::Realtime;
use hilrig::realtime::clock::{Clock, SimClock};
use hilrig::realtime::transport::{Pty, Transport};
use hilrig::robots::rescue::pc_program::fielded::Client;
use hilrig::robots::{self, Dut, PcEnd};
use hilrig::run::Run;
use hilrig::scenario::Scenario;
use protocols::pcui::Message;
use protocols::{Decode, FrameError, Instant, pcui};
use rustix::fs::{OFlags, fcntl_setfl};
use serialport::TTYPort;

use crate::support::*;

/// Rows of the robot's map: 6 m in cells of 20 mm.
const ROWS: usize = 300;
/// Both waypoints are on a straight path of 1.4 m.
const MISSION_MAX: Instant = Instant::from_secs(40);

/// Frames that a client at the port receives and sends.
#[derive(Default)]
struct Heard {
    frames: u32,
    bad_frames: u32,
    /// Rows of the map, by their y.
    rows: BTreeSet<u16>,
    /// Lists of waypoints that the robot sent after the click.
    echoes: u32,
    /// Waypoints that the client shows in the end.
    waypoints: usize,
    /// Number of visited waypoints of the scenario, which are the clicked ones.
    visited: usize,
    log: String,
}

/// A client that keeps still must receive nothing: the read fails instead.
fn read(port: &mut impl Read, buf: &mut [u8]) -> usize {
    match port.read(buf) {
        Ok(len) => len,
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => 0,
        Err(error) => panic!("client: {error}"),
    }
}

/// A mission whose PC is the fielded program at a port that `open` opens, until both waypoints are
/// visited and the map is whole. It clicks twice once it has the map; a sound robot returns both
/// waypoints with their numbers.
fn fielded_client<P: Read + Write>(name: &str, open: impl FnOnce(&Path) -> P) -> Heard {
    let text = include_str!("short.toml").to_owned();
    let (scenario, source) = Scenario::parse("short.toml".as_ref(), text).expect("sound");
    let wired = robots::wire(&scenario, &source, Dut::Internal, PcEnd::External);
    let mut wired = wired.expect("can be wired");
    let dir = fresh_dir(name);
    let end = wired.open_ends.remove(0);
    let transport = Pty::open(&dir, &end.name, end.line).expect("a free name");
    let mut port = open(transport.path());
    let mut run = Run::with_rig(scenario, wired.rig, wired.instruments);
    let mut realtime = Realtime::new(SimClock::default());
    realtime.serve(end, Box::new(transport));

    let (mut client, mut decoder) = (Client::default(), pcui::Decoder::default());
    let (mut heard, mut has_clicked) = (Heard::default(), false);
    let (mut buf, mut taken) = ([0; 4096], 0);
    while !heard.is_whole() && realtime.clock().now() < MISSION_MAX {
        realtime.turn(&mut run).expect("the port stays");
        realtime.clock().advance(Duration::from_millis(5));
        // Time stands until the client has all bytes sent to it: a kernel thread moves the bytes,
        // and a port that becomes full meanwhile loses bytes.
        let reports = realtime.reports();
        let given: u64 = reports.map(|report| report.traffic.to_client).sum();
        wait_until(|| {
            let len = read(&mut port, &mut buf);
            client.receive(&buf[..len]);
            for frame in decoder.push(&buf[..len]) {
                heard.take(frame, has_clicked);
            }
            taken += len as u64;
            taken >= given
        });
        if !has_clicked && heard.frames > 50 {
            client.click([1200, 1200]);
            let list = client.click([2200, 1200]);
            port.write_all(&list).expect("room");
            has_clicked = true;
        }
        heard.visited = run.progress().visits().len();
    }
    heard.waypoints = client.waypoints().len();
    let log = run.rig.events().iter().map(ToString::to_string);
    heard.log = log.collect::<Vec<_>>().join("\n");
    heard
}

impl Heard {
    fn take(&mut self, frame: Result<pcui::Frame, FrameError>, has_clicked: bool) {
        let Ok(frame) = frame else {
            self.bad_frames += 1;
            return;
        };
        self.frames += 1;
        match frame.message() {
            Ok(Message::Row(row) | Message::CodedRow(row)) => {
                self.rows.insert(row.y);
            }
            Ok(Message::Waypoints(_)) => self.echoes += u32::from(has_clicked),
            _ => {}
        }
    }

    fn is_whole(&self) -> bool {
        self.rows.len() == ROWS && self.visited == 2
    }

    /// Checks that everything arrived, and that the rate is not reported as the client's fault.
    fn assert_whole(&self) {
        assert_eq!(self.bad_frames, 0);
        assert_eq!(self.rows.len(), ROWS, "of {} frames", self.frames);
        assert!(self.echoes > 0, "the robot never told its waypoints");
        assert_eq!(self.waypoints, 2, "the robot repeats what it was sent");
        assert_eq!(self.visited, 2, "{}", self.log);
        for blame in ["wrong-baud", "garbage", "did not read"] {
            assert!(!self.log.contains(blame), "{blame}: {}", self.log);
        }
    }
}

fn at_baud(path: &Path, baud: u32) -> TTYPort {
    let builder = serialport::new(path.to_string_lossy(), baud).timeout(Duration::from_micros(1));
    TTYPort::open(&builder).expect("the port is free")
}

/// The fielded program has this rate in its source.
#[test]
fn a_pc_program_at_460800_reads_every_frame() {
    fielded_client("pc_460800", |path| at_baud(path, 460_800)).assert_whole();
}

/// Any other rate works as well: no hardware behind the port has a rate.
#[test]
fn a_pc_program_at_115200_reads_every_frame() {
    fielded_client("pc_115200", |path| at_baud(path, 115_200)).assert_whole();
}

/// `cat` and similar programs set no baud rate.
#[test]
fn a_pc_program_that_sets_no_rate_reads_every_frame() {
    fielded_client("pc_untouched", open_untouched).assert_whole();
}

fn open_untouched(path: &Path) -> File {
    let open = || -> io::Result<File> {
        let file = File::options().read(true).write(true).open(path)?;
        fcntl_setfl(&file, OFlags::NONBLOCK)?;
        Ok(file)
    };
    open().expect("the port is free")
}
