//! Serial ports of the machine, with a pseudo-terminal in place of the hardware.

use std::io::Write;

use hilrig::realtime::transport::PortEvent::{BaudChanged, Closed, Opened};
use hilrig::realtime::transport::{Pty, Serial, Transport, TransportError};
use protocols::LineConfig;

use crate::support::*;

#[test]
fn every_byte_value_passes_a_serial_port_both_ways() {
    let dir = fresh_dir("serial_every_byte");
    let mut device = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let mut port = Serial::open(device.path(), LINE).expect("the port is free");
    let all: Vec<u8> = (0..=255).cycle().take(3000).collect();

    assert_eq!(port.write(&all), 3000);
    assert_eq!(read_exactly(&mut device, 3000), all);
    assert_eq!(device.write(&all), 3000);
    assert_eq!(read_exactly(&mut port, 3000), all);
    assert_eq!(drain_events(&mut port), [Opened]);
}

#[test]
fn a_serial_port_runs_at_the_rate_that_was_asked_for() {
    let dir = fresh_dir("serial_rate");
    let mut device = Pty::open(&dir, "base", LINE).expect("a free name");
    let _port = Serial::open(device.path(), LineConfig::new_8n1(1_000_000)).expect("free");
    assert_eq!(
        next_events(&mut device, 2),
        [Opened, BaudChanged(1_000_000)]
    );
}

/// Bytes that arrived before belong to an earlier run.
#[test]
fn opening_a_serial_port_forgets_what_had_arrived() {
    let dir = fresh_dir("serial_forgets");
    let mut device = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let visitor = std::fs::File::open(device.path()).expect("free");
    assert_eq!(next_events(&mut device, 1), [Opened]);
    assert_eq!(device.write(b"old"), 3);

    let mut port = Serial::open(device.path(), LINE).expect("no process has it exclusively");
    drop(visitor);
    assert_eq!(device.write(b"new"), 3);
    assert_eq!(read_exactly(&mut port, 3), b"new");
}

#[test]
fn a_port_that_is_pulled_is_an_error_that_names_it() {
    let dir = fresh_dir("serial_pulled");
    let device = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let path = device.path().to_owned();
    let mut port = Serial::open(&path, LINE).expect("free");
    drop(device);

    let mut lost = None;
    wait_until(|| {
        lost = port.read(&mut [0; 16]).err();
        lost.is_some()
    });
    let text = lost.expect("just seen").to_string();
    assert!(
        text.starts_with(&format!(
            "{}: the port went away: expected it to stay until the end",
            path.display()
        )),
        "{text}"
    );
    assert_eq!(drain_events(&mut port), [Opened, Closed]);
    assert_eq!(port.write(b"any one?"), 0);
    assert_eq!(port.counters().unheard, 8);
    assert!(matches!(
        port.read(&mut [0; 16]),
        Err(TransportError::Lost { .. })
    ));
}

/// A cable whose other end is asleep: neither the rig nor its end may hang.
#[test]
fn a_far_end_that_does_not_read_stops_nobody() {
    let dir = fresh_dir("serial_asleep");
    let device = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let mut port = Serial::open(device.path(), LINE).expect("free");
    let mut accepted = 0;
    wait_until(|| {
        accepted += port.write(&[0x55; 4096]);
        port.counters().overrun > 0
    });
    assert!(accepted >= 4096);
    drop(port);
}

#[test]
fn a_busy_port_is_told_from_a_missing_one_and_from_a_file() {
    let dir = fresh_dir("serial_errors");
    let device = Pty::open(&dir, "lidar", LINE).expect("a free name");
    let _first = Serial::open(device.path(), LINE).expect("free");
    let at = |name: &str| dir.path().join(name);
    std::fs::File::create(at("notes"))
        .and_then(|mut file| file.write_all(b"no port"))
        .expect("writable");
    let error = |name: &str| {
        let error = Serial::open(&at(name), LINE).expect_err("cannot be opened");
        error
            .to_string()
            .replace(&at(name).display().to_string(), "PORT")
    };

    assert_eq!(
        error("lidar"),
        "PORT: another program has this port: expected to have it alone"
    );
    assert_eq!(
        error("radio"),
        "PORT: no such port: expected a serial port such as /dev/ttyUSB0 or a link to one"
    );
    assert_eq!(
        error("notes"),
        "PORT: not a serial port: expected a device such as /dev/ttyUSB0 or a link to one"
    );
    std::fs::remove_file(at("notes")).expect("there");
}
