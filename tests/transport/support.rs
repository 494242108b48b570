//! Helpers for all tests of this binary: a directory per test, a client, waits.

use core::time::Duration;
use std::path::PathBuf;

use hilrig::realtime::clock::{Clock, WallClock};
use hilrig::realtime::transport::{PortDir, PortEvent, Transport};
use protocols::{Instant, LineConfig};
use serialport::{ErrorKind, TTYPort};

/// The lidar's line, as any line would do.
pub(crate) const LINE: LineConfig = LineConfig::new_8n1(115_200);

/// Maximum wait for an expected event, also on a busy machine. Only a failing test waits that long.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);
/// Time without an event that a test expects not to happen.
const QUIET: Duration = Duration::from_millis(30);

/// A path that no other test and no other test run uses; nothing is there yet.
pub(crate) fn fresh_path(name: &str) -> PathBuf {
    let path =
        PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&path);
    path
}

pub(crate) fn fresh_dir(name: &str) -> PortDir {
    PortDir::open(&fresh_path(name)).expect("a fresh directory is free")
}

/// A client as most programs are: it sets raw mode, exclusive use and the baud rate.
pub(crate) fn client(port: &impl Transport, baud: u32) -> TTYPort {
    let builder = serialport::new(port.path().to_string_lossy(), baud).timeout(QUIET);
    TTYPort::open(&builder).expect("the port is free")
}

/// All that the client can read until its line is quiet.
pub(crate) fn client_reads(client: &mut TTYPort) -> Vec<u8> {
    let mut all = Vec::new();
    let mut buf = [0; 1024];
    loop {
        match std::io::Read::read(client, &mut buf) {
            Ok(len) => all.extend_from_slice(&buf[..len]),
            Err(error) if error.kind() == std::io::ErrorKind::TimedOut => return all,
            Err(error) => panic!("client: {error}"),
        }
    }
}

/// Bytes that the client reads until it has `count` and its line is quiet. A kernel thread moves
/// bytes between the two sides, and has no priority.
pub(crate) fn client_gets(client: &mut TTYPort, count: usize) -> Vec<u8> {
    let mut all = Vec::new();
    wait_until(|| {
        all.extend(client_reads(client));
        all.len() >= count
    });
    all
}

/// Unread bytes of the client.
pub(crate) fn client_has(client: &mut TTYPort) -> Vec<u8> {
    let mut buf = [0; 4096];
    match waiting(client) {
        0 => Vec::new(),
        _ => {
            let len = std::io::Read::read(client, &mut buf).expect("there is something");
            buf[..len].to_vec()
        }
    }
}

/// Number of unread bytes of the client.
pub(crate) fn waiting(client: &TTYPort) -> u32 {
    serialport::SerialPort::bytes_to_read(client).expect("the port stays")
}

/// Reads until `count` bytes are there.
pub(crate) fn read_exactly(port: &mut impl Transport, count: usize) -> Vec<u8> {
    let mut all = Vec::new();
    let mut buf = [0; 1024];
    wait_until(|| {
        let len = port.read(&mut buf).expect("the port stays");
        all.extend_from_slice(&buf[..len]);
        all.len() >= count
    });
    assert_eq!(all.len(), count, "more bytes than were sent");
    all
}

/// The next `count` events, in order.
pub(crate) fn next_events(port: &mut impl Transport, count: usize) -> Vec<PortEvent> {
    let mut events = Vec::new();
    wait_until(|| {
        let len = port.read(&mut [0; 1]).expect("the port stays");
        assert_eq!(len, 0, "no bytes were sent");
        events.extend(drain_events(port));
        events.len() >= count
    });
    assert_eq!(
        events.len(),
        count,
        "more happened than was done: {events:?}"
    );
    events
}

pub(crate) fn drain_events(port: &mut impl Transport) -> Vec<PortEvent> {
    core::iter::from_fn(|| port.next_event()).collect()
}

/// Tries again until `done`, for as long as patience lasts.
pub(crate) fn wait_until(mut done: impl FnMut() -> bool) {
    let clock = WallClock::start();
    while !done() {
        assert!(clock.now() < Instant::ZERO + PATIENCE, "waited in vain");
        clock.sleep_until(clock.now() + Duration::from_millis(1));
    }
}

/// Whether the port's library reports that another process has the port.
pub(crate) fn is_busy(opened: &serialport::Result<TTYPort>) -> bool {
    matches!(opened, Err(error) if error.kind() == ErrorKind::NoDevice)
}
