//! A program for a debugger: a thread that reads, a channel, a counter that threads share.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::sync::atomic::{AtomicI32, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

static BEATS: AtomicI32 = AtomicI32::new(0);

struct Rover {
    total: i32,
    scale: i32,
    steered: i32,
    faulty_at: i32,
}

#[inline(never)]
fn understand(rover: &mut Rover, line: &str) {
    let value: i32 = line[3..].parse().unwrap_or(0);
    rover.total += value * rover.scale;
}

#[inline(never)]
fn steer(rover: &mut Rover, port: &mut File) {
    rover.steered += 1;
    assert!(rover.steered != rover.faulty_at, "no way");
    write!(port, "{}\r\n", rover.total).expect("writes");
}

#[inline(never)]
fn beat(number: i32) {
    BEATS.store(number, Ordering::SeqCst);
}

fn main() {
    let faulty_at = std::env::args().nth(1).and_then(|it| it.parse().ok());
    let mut rover = Rover { total: 0, scale: 1, steered: 0, faulty_at: faulty_at.unwrap_or(-1) };
    let path = std::env::var("HILRIG_PORT_SONAR").expect("a port");
    let mut port = OpenOptions::new().read(true).write(true).open(path).expect("opens");
    let ears = BufReader::new(port.try_clone().expect("a copy"));
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        for line in ears.lines() {
            sender.send(line.expect("text")).expect("heard");
        }
    });
    thread::spawn(|| {
        for number in 1.. {
            thread::sleep(Duration::from_millis(70));
            beat(number);
        }
    });
    for (number, line) in receiver.iter().enumerate() {
        if line.starts_with("mm=") {
            understand(&mut rover, &line);
        }
        if number % 2 == 0 {
            steer(&mut rover, &mut port);
        }
    }
}
