//! Behaviour of pseudo-terminals for clients.

use core::time::Duration;
use std::io::{Read, Write};
use std::os::fd::BorrowedFd;

use hilrig::realtime::clock::{Clock, WallClock};
use hilrig::realtime::transport::PortEvent::{BaudChanged, Closed, Opened};
use hilrig::realtime::transport::{Counters, Pty, Transport, wait};
use protocols::Instant;
use serialport::TTYPort;

use crate::support::*;

/// Binary protocols use every value; a terminal in its usual mode would echo, translate CR and
/// LF, and swallow 0x03, 0x04, 0x11, 0x13, 0x1A.
#[test]
fn every_byte_value_passes_both_ways_unchanged() {
    let dir = fresh_dir("every_byte_value");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let mut client = client(&port, LINE.baud);
    let all: Vec<u8> = (0..=255).collect();

    assert_eq!(port.write(&all), 256);
    assert_eq!(client_gets(&mut client, 256), all);

    client.write_all(&all).expect("room for 256 bytes");
    assert_eq!(read_exactly(&mut port, 256), all);
    assert_eq!(port.counters(), Counters::default());
}

/// A client that changes no settings (a shell's `cat`) works.
#[test]
fn a_fresh_port_is_raw_and_at_the_rate_of_its_line() {
    let dir = fresh_dir("a_fresh_port");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let mut client = std::fs::File::options()
        .read(true)
        .write(true)
        .open(port.path())
        .expect("the name is there");

    client.write_all(b"\x03\r\n\x11").expect("room");
    assert_eq!(read_exactly(&mut port, 4), b"\x03\r\n\x11");
    assert_eq!(drain_events(&mut port), [Opened]);

    // No line end: a terminal in its usual mode would hold these back, and echo them.
    assert_eq!(port.write(b"\r\x13abc"), 5);
    let mut read = [0; 5];
    client.read_exact(&mut read).expect("arrives");
    assert_eq!(&read, b"\r\x13abc");
    assert_eq!(port.read(&mut [0; 16]).expect("stays"), 0, "an echo");
}

/// The kernel would keep 16 kB for a later client; a real lidar does not.
#[test]
fn a_client_that_opens_late_gets_no_stale_byte() {
    let dir = fresh_dir("opens_late");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    assert_eq!(port.write(b"before a client came"), 0);

    let mut client = client(&port, LINE.baud);
    assert_eq!(client_reads(&mut client), b"");
    assert_eq!(port.write(b"now"), 3);
    assert_eq!(client_gets(&mut client, 3), b"now");
    assert_eq!(
        port.counters(),
        Counters {
            unheard: 20,
            overrun: 0
        }
    );
}

/// The kernel alone would give bytes left unread by one client to the next one.
#[test]
fn what_a_client_left_unread_is_gone_for_the_next() {
    let dir = fresh_dir("left_unread");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let mut first = client(&port, LINE.baud);
    assert_eq!(port.write(&[0xAA; 4096]), 4096);
    // The number of bytes that a terminal holds.
    wait_until(|| waiting(&first) >= 4095);
    first.read_exact(&mut [0; 1]).expect("is there");
    drop(first);
    assert_eq!(next_events(&mut port, 2), [Opened, Closed]);
    assert_eq!(port.write(b"no client there"), 0);

    let mut second = client(&port, LINE.baud);
    assert_eq!(client_reads(&mut second), b"");
    assert_eq!(port.write(b"fresh"), 5);
    assert_eq!(client_gets(&mut second, 5), b"fresh");
}

/// The port is closed and reopened between two polls: the hang-up is over before the next poll.
#[test]
fn a_quick_restart_of_the_client_is_noticed() {
    let dir = fresh_dir("quick_restart");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let mut first = client(&port, LINE.baud);
    assert_eq!(next_events(&mut port, 1), [Opened]);
    assert_eq!(port.write(b"unread"), 6);
    wait_until(|| waiting(&first) == 6);
    first.read_exact(&mut [0; 1]).expect("is there");

    drop(first);
    let mut second = client(&port, LINE.baud);
    assert_eq!(next_events(&mut port, 2), [Closed, Opened]);
    assert_eq!(client_reads(&mut second), b"");
    drop(second);
    assert_eq!(next_events(&mut port, 1), [Closed]);
}

/// `stty -F` and similar tools open a port that a client has open.
#[test]
fn a_second_visitor_neither_opens_nor_closes() {
    let dir = fresh_dir("second_visitor");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let open = || std::fs::File::open(port.path()).expect("not exclusive");
    let (client, visitor) = (open(), open());
    assert_eq!(next_events(&mut port, 1), [Opened]);
    drop(visitor);
    assert_eq!(next_events(&mut port, 0), []);
    drop(client);
    assert_eq!(next_events(&mut port, 1), [Closed]);
}

/// `echo command > DIR/pc`: the client has closed the port before the rig polls for the first time.
#[test]
fn a_client_that_sends_and_leaves_is_heard_before_it_is_gone() {
    let dir = fresh_dir("sends_and_leaves");
    let mut port = Pty::open(&dir, "pc", LINE).expect("a free name");
    std::fs::write(port.path(), b"hello").expect("room");

    assert_eq!(read_exactly(&mut port, 5), b"hello");
    assert_eq!(drain_events(&mut port), [Opened]);
    assert_eq!(next_events(&mut port, 1), [Closed]);
}

/// The rate must be known before the bytes that were sent at it.
#[test]
fn the_clients_baud_rate_is_told_before_its_bytes() {
    let dir = fresh_dir("baud_rate");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let mut client = client(&port, 9600);
    client.write_all(b"x").expect("room");

    assert_eq!(read_exactly(&mut port, 1), b"x");
    assert_eq!(drain_events(&mut port), [Opened, BaudChanged(9600)]);

    serialport::SerialPort::set_baud_rate(&mut client, 250_000).expect("any rate will do");
    assert_eq!(next_events(&mut port, 1), [BaudChanged(250_000)]);
}

/// As in a UART driver: the oldest bytes are kept, bytes without room are lost and counted, and the
/// line continues as soon as the client reads.
#[test]
fn a_client_that_does_not_read_loses_the_newest_bytes() {
    let dir = fresh_dir("does_not_read");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let mut client = client(&port, LINE.baud);
    let sent: Vec<u8> = (0..=249).cycle().take(6000).collect();

    assert_eq!(port.write(&sent), Pty::UNREAD_MAX);
    assert_eq!(port.write(b"lost too"), 0);
    assert_eq!(port.counters().overrun, 6000 - 4096 + 8);

    let read = client_gets(&mut client, Pty::UNREAD_MAX);
    assert_eq!(read, sent[..Pty::UNREAD_MAX]);
    assert_eq!(port.write(b"again"), 5);
    assert_eq!(client_gets(&mut client, 5), b"again");
}

/// A hung-up terminal is "ready" without end: 183,000 times in 50 ms. The rig must not wait for it.
#[test]
fn waiting_for_a_port_that_nobody_has_open_is_no_busy_loop() {
    let dir = fresh_dir("no_busy_loop");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let client = client(&port, LINE.baud);
    assert_eq!(next_events(&mut port, 1), [Opened]);
    drop(client);
    assert_eq!(next_events(&mut port, 1), [Closed]);
    next_events(&mut port, 0);

    let clock = WallClock::start();
    let mut fds = Vec::new();
    port.readiness(&mut fds);
    wait(&fds, Duration::from_millis(50)).expect("poll works");
    assert!(clock.now() >= Instant::from_millis(50));
}

#[test]
fn waiting_ends_when_a_client_opens_or_sends() {
    let dir = fresh_dir("waiting_ends");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    next_events(&mut port, 0);
    let mut client = client(&port, LINE.baud);
    assert!(is_ready(&port, PATIENCE));
    assert_eq!(next_events(&mut port, 1), [Opened]);
    assert!(!is_ready(&port, Duration::from_millis(100)));

    client.write_all(b"x").expect("room");
    assert!(is_ready(&port, PATIENCE));
}

/// Whether a wait ends before `timeout` does.
fn is_ready(port: &Pty, timeout: Duration) -> bool {
    let mut fds: Vec<BorrowedFd<'_>> = Vec::new();
    port.readiness(&mut fds);
    let clock = WallClock::start();
    wait(&fds, timeout).expect("poll works");
    clock.now() < Instant::ZERO + timeout
}

/// Two programs on one port would each get half of the bytes.
#[test]
fn a_port_that_a_client_took_for_itself_is_busy_for_the_next() {
    let dir = fresh_dir("busy_for_the_next");
    let port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let first = client(&port, LINE.baud);
    let builder = serialport::new(port.path().to_string_lossy(), LINE.baud);
    assert!(is_busy(&TTYPort::open(&builder)));
    drop(first);
    assert!(TTYPort::open(&builder).is_ok());
}

/// A client sleeps, then discards waiting bytes and reads on, as pyserial's `reset_input_buffer`
/// does. The port was full, and no read reports to the rig that it has room again.
#[test]
fn a_full_port_that_is_flushed_goes_on() {
    let dir = fresh_dir("flushed");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let mut client = client(&port, LINE.baud);
    assert_eq!(next_events(&mut port, 1), [Opened]);
    for _ in 0..3 {
        let (mut given, mut refused) = (0, 0);
        while refused < 200 {
            match port.write(&[7]) {
                0 => refused += 1,
                len => given += len,
            }
        }
        assert!((4000..20_000).contains(&given), "{given}");
        serialport::SerialPort::clear(&client, serialport::ClearBuffer::Input).expect("stays");
        let mut went_on = 0;
        wait_until(|| {
            went_on += port.write(b"on");
            went_on >= 2
        });
        let mut read = Vec::new();
        wait_until(|| {
            read.extend(client_reads(&mut client));
            read.ends_with(b"on")
        });
    }
}

/// Behaviour of a pulled USB adapter: its file hangs up, its name is gone, and it comes back as
/// another port.
#[test]
fn an_unplugged_port_hangs_up_and_comes_back_as_another() {
    let dir = fresh_dir("unplugged");
    let mut port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let path = port.path().to_owned();
    let mut first = client(&port, 9600);
    first.write_all(b"x").expect("room");
    assert_eq!(read_exactly(&mut port, 1), b"x");
    assert_eq!(drain_events(&mut port), [Opened, BaudChanged(9600)]);
    port.unplug();
    assert_eq!(drain_events(&mut port), [Closed]);
    assert!(!path.is_symlink());
    // The end of input, and no output: not a time-out.
    assert_eq!(
        std::fs::File::open(&path).err().map(|e| e.kind()),
        Some(std::io::ErrorKind::NotFound)
    );
    let failed = first.read(&mut [0; 4]).expect_err("hung up");
    assert_ne!(failed.kind(), std::io::ErrorKind::TimedOut);
    assert!(first.write(b"y").is_err());
    assert_eq!(port.write(b"unheard"), 0);
    assert_eq!(port.read(&mut [0; 4]).expect("it is only away"), 0);

    port.plug(Some("lidar-1")).expect("a free name");
    assert!(port.path().ends_with("lidar-1") && !path.is_symlink());
    assert_eq!(drain_events(&mut port), [BaudChanged(LINE.baud)]);
    let mut second = client(&port, LINE.baud);
    assert_eq!(next_events(&mut port, 1), [Opened]);
    assert_eq!(port.write(b"new"), 3);
    assert_eq!(client_gets(&mut second, 3), b"new");
    assert!(first.write(b"y").is_err(), "the old file stays dead");
    drop((port, dir));
}
