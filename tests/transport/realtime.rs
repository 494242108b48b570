//! A rig in real time on real terminals: a client's bytes, whatever the machine does meanwhile.

use core::time::Duration;
use std::io::Write;

use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use emulators::{Device, Event};
use hilrig::realtime::Realtime;
use hilrig::realtime::clock::{Clock, SimClock, WallClock};
use hilrig::realtime::transport::{PortDir, Pty, Serial, Transport};
use hilrig::rig::line::End;
use hilrig::rig::{PortRate, Rig};
use hilrig::robots::OpenEnd;
use hilrig::run::Run;
use hilrig::scenario::Scenario;
use protocols::{Instant, LineConfig, Port};
use serialport::TTYPort;

use crate::support::*;

/// Bytes that the counter sends: less than a client may leave unread, so that none is lost even if
/// the client does not read for a while.
const SENT: usize = 3000;

/// Sends 0, 1, 2, .. from the first byte that it receives on, and echoes nothing.
#[derive(Clone, Default)]
struct Counter {
    sent: usize,
    started: bool,
    heard: Vec<u8>,
}

impl Device for Counter {
    fn receive(&mut self, _: Port, _: Instant, bytes: &[u8]) {
        self.started = true;
        self.heard.extend_from_slice(bytes);
    }
    fn poll(&mut self, _: Instant, _: &mut World) {}
    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        if !self.started {
            return 0;
        }
        let len = buf.len().min(SENT - self.sent);
        buf[..len].copy_from_slice(&counting(SENT)[self.sent..][..len]);
        self.sent += len;
        len
    }
    fn poll_at(&self) -> Option<Instant> {
        None
    }
    fn line_config(&self, _: Port) -> LineConfig {
        LINE
    }
    fn take_events(&mut self) -> Vec<Event> {
        Vec::new()
    }
}

fn counting(len: usize) -> Vec<u8> {
    (0..=255).cycle().take(len).collect()
}

/// A counter that is served on `DIR/counter`.
struct Station {
    rig: Rig,
    realtime: Realtime<WallClock>,
    end: OpenEnd,
}

impl Station {
    fn new() -> Self {
        let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("nothing is in it");
        let start = Pose::new(0.0, 0.0, 0.0);
        let world = World::new(scene, BodyConfig::default(), start, 1).expect("nothing is near");
        let mut rig = Rig::new(world);
        let node = rig.add_device("counter", Counter::default());
        let device = End {
            node,
            port: Port(0),
        };
        let node = rig.add_outside("counter", LINE);
        let outside = End {
            node,
            port: Port(0),
        };
        rig.connect("counter", device, outside, 16);
        let end = OpenEnd {
            name: "counter".to_owned(),
            link: "counter".to_owned(),
            node,
            line: LINE,
            rate: PortRate::OfLine,
            connect: "a test",
            is_optional: false,
            robot: 0,
        };
        Self {
            rig,
            realtime: Realtime::new(WallClock::start()),
            end,
        }
    }

    fn served_in(dir: &PortDir) -> (Self, std::path::PathBuf) {
        let mut this = Self::new();
        let port = Pty::open(dir, "counter", LINE).expect("a free name");
        let path = port.path().to_owned();
        this.realtime.serve(this.end.clone(), Box::new(port));
        (this, path)
    }

    /// Runs until `done`.
    fn run_until(&mut self, mut done: impl FnMut(&Self) -> bool) {
        wait_until(|| {
            self.realtime.turn(&mut self.rig).expect("the port stays");
            done(self)
        });
    }

    /// Runs until all that was sent has long passed the line.
    fn settle(&mut self) {
        let end = self.rig.now() + Duration::from_millis(50);
        self.run_until(|this| this.rig.now() >= end);
    }

    /// Runs until the counter's bytes were received and it has sent everything: 3000 bytes take 260
    /// ms.
    fn send_all(&mut self) {
        self.run_until(|this| this.counter().sent == SENT);
        self.settle();
    }

    fn counter(&self) -> &Counter {
        self.rig.device::<Counter>("counter").expect("there")
    }

    fn log(&self) -> String {
        let lines = self.rig.events().iter().map(ToString::to_string);
        lines.collect::<Vec<_>>().join("\n")
    }
}

fn client_at(path: &std::path::Path, baud: u32) -> TTYPort {
    let builder = serialport::new(path.to_string_lossy(), baud).timeout(Duration::from_millis(30));
    TTYPort::open(&builder).expect("the port is free")
}

/// Real time is the same run, cut into other pieces: turns of the wall clock, a delay in between.
#[test]
fn a_run_at_the_pace_of_a_clock_gives_the_same_bytes_as_in_virtual_time() {
    let text = include_str!("short.toml").to_owned();
    let (scenario, source) = Scenario::parse("short.toml".as_ref(), text).expect("sound");
    let start = || Run::new(scenario.clone(), &source, None).expect("can be wired");

    let mut paced = start();
    let mut realtime = Realtime::new(SimClock::default());
    while !paced.is_over() {
        realtime.turn(&mut paced).expect("no port to lose");
        if realtime.clock().now() < Instant::from_secs(1) {
            realtime.clock().advance(Duration::from_micros(1234));
        }
    }
    let (paced, virtual_time) = (paced.judge(), start().finish());
    assert_eq!(paced.trace_hash, virtual_time.trace_hash);
    assert_eq!(paced.checks, virtual_time.checks);
    assert_eq!(paced.ran, virtual_time.ran);
}

#[test]
fn a_client_reads_what_the_device_sent_in_order_and_whole() {
    let dir = fresh_dir("in_order");
    let (mut station, path) = Station::served_in(&dir);
    let mut client = client_at(&path, LINE.baud);
    client.write_all(b"go").expect("room");
    station.send_all();

    assert_eq!(client_gets(&mut client, SENT), counting(SENT));
    assert_eq!(station.counter().heard, b"go");
    assert!(!station.log().contains("wrong-baud"));
}

/// At half the rate each bit is sampled as if it were two: no stretch of the data comes through.
#[test]
fn a_client_at_the_wrong_rate_is_told_and_reads_garbage() {
    let dir = fresh_dir("wrong_rate");
    let (mut station, path) = Station::served_in(&dir);
    let mut client = client_at(&path, 57_600);
    client.write_all(b"go").expect("room");
    station.send_all();

    // Garbage is not silence.
    let read = client_gets(&mut client, 1);
    let real = counting(SENT + 256);
    let is_data = |piece: &[u8]| real.windows(4).any(|data| data == piece);
    assert!(!read.windows(4).any(is_data), "data at the wrong rate");
    assert_ne!(
        station.counter().heard,
        b"go",
        "the device reads garbage too"
    );
    let expected = "counter wrong-baud: client at 57600 baud, expected 115200: it reads garbage";
    assert!(station.log().contains(expected), "{}", station.log());
}

/// A client that opens the port while the device is sending gets the rest, and no earlier byte.
#[test]
fn a_client_that_comes_late_reads_only_what_is_sent_from_then_on() {
    let dir = fresh_dir("comes_late");
    let (mut station, path) = Station::served_in(&dir);
    std::fs::write(&path, b"go").expect("room");
    station.run_until(|this| this.counter().sent >= SENT / 2);
    let rest = SENT - station.counter().sent;
    let mut client = client_at(&path, LINE.baud);
    station.send_all();

    let read = client_gets(&mut client, rest);
    assert!(read.len() <= SENT / 2 + 16, "{}", read.len());
    assert_eq!(read, counting(SENT)[SENT - read.len()..], "the rest, whole");
}

/// Two rigs in two directories, each with a link of the same name.
#[test]
fn two_rigs_side_by_side_do_not_meet() {
    let (dir_a, dir_b) = (fresh_dir("side_a"), fresh_dir("side_b"));
    let (mut a, path_a) = Station::served_in(&dir_a);
    let (mut b, path_b) = Station::served_in(&dir_b);
    let (mut client_a, mut client_b) =
        (client_at(&path_a, LINE.baud), client_at(&path_b, LINE.baud));
    client_a.write_all(b"only a").expect("room");
    a.send_all();
    b.settle();
    assert_eq!(client_gets(&mut client_a, SENT), counting(SENT));
    assert_eq!(client_reads(&mut client_b), b"");
    let heard = |station: &Station| station.counter().heard.clone();
    assert_eq!((heard(&a), heard(&b)), (b"only a".to_vec(), Vec::new()));
}

/// The device's own port in place of the emulated one: the rig passes its bytes on.
#[test]
fn a_real_device_takes_the_place_of_the_emulated_one() {
    let dir = fresh_dir("real_device");
    let mut device = Pty::open(&dir, "real", LINE).expect("a free name");
    let (mut station, path) = Station::served_in(&dir);
    let node = station.rig.replace_device("counter").expect("a device");
    let serial = Serial::open(device.path(), LINE).expect("the port is free");
    let end = OpenEnd {
        node,
        ..station.end.clone()
    };
    station.realtime.serve(end, Box::new(serial));
    let mut client = client_at(&path, LINE.baud);
    client.write_all(b"hello device").expect("room");
    let mut read = Vec::new();
    station.run_until(|_| {
        let mut buf = [0; 64];
        let len = device.read(&mut buf).expect("the port stays");
        read.extend_from_slice(&buf[..len]);
        read.len() >= 12
    });
    assert_eq!(read, b"hello device");

    assert_eq!(device.write(&counting(SENT)), SENT);
    let mut read = Vec::new();
    station.run_until(|_| {
        read.extend(client_has(&mut client));
        read.len() >= SENT
    });
    station.settle();
    read.extend(client_reads(&mut client));
    assert_eq!(read, counting(SENT));
    assert!(station.rig.device::<Counter>("counter").is_none());
}

#[test]
fn a_real_device_that_is_pulled_is_an_error_and_not_the_end_of_the_others() {
    let dir = fresh_dir("pulled");
    let device = Pty::open(&dir, "real", LINE).expect("a free name");
    let mut station = Station::new();
    let serial = Serial::open(device.path(), LINE).expect("the port is free");
    station
        .realtime
        .serve(station.end.clone(), Box::new(serial));
    station
        .realtime
        .turn(&mut station.rig)
        .expect("it is there");
    drop(device);

    let mut error = None;
    wait_until(|| {
        error = station.realtime.turn(&mut station.rig).err();
        error.is_some()
    });
    let text = error.expect("just seen").to_string();
    assert!(text.contains("real: the port went away"), "{text}");
    assert!(station.log().contains("counter port-closed"));
}
