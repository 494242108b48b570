//! Holds a heater at 40 per mille.
//!
//! Frames: AB, register, count (bit 7: with data), data, byte sum low byte first.
//! Defect: the set-point is sent high byte first.
use std::fs::OpenOptions;
use std::io::{Read, Write};
use std::thread;
use std::time::Duration;

fn main() {
    let broken = std::env::args().any(|word| word == "broken");
    let path = std::env::var("HILRIG_PORT_HEATER").expect("started by the rig");
    let mut port = OpenOptions::new().read(true).write(true).open(path).expect("a port");
    loop {
        let [a, b] = if broken { 40_u16.to_be_bytes() } else { 40_u16.to_le_bytes() };
        let head = [0xAB, 2, 0x82, a, b];
        let sum: u16 = head.iter().map(|byte| u16::from(*byte)).sum();
        port.write_all(&head).and_then(|()| port.write_all(&sum.to_le_bytes())).expect("a port");
        let mut answer = [0; 5];
        port.read_exact(&mut answer).expect("an answer");
        println!("set, {answer:02x?}");
        thread::sleep(Duration::from_millis(100));
    }
}
