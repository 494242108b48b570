//! Drives as fast as the distance ahead allows.
//!
//! Frames: AB, register, count (bit 7: with data), data, byte sum low byte first. Defect: the
//! checksum of received frames is not checked, so a damaged distance becomes a speed.
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::sync::mpsc::{channel, Receiver};
use std::thread;
use std::time::Duration;

fn frame(head: &[u8]) -> Vec<u8> {
    let sum: u16 = head.iter().map(|byte| u16::from(*byte)).sum();
    [head, &sum.to_le_bytes()].concat()
}

fn answer(bytes: &Receiver<u8>, len: usize) -> Option<Vec<u8>> {
    let timeout = Duration::from_millis(100);
    (0..len).map(|_| bytes.recv_timeout(timeout).ok()).collect()
}

fn main() {
    let broken = std::env::args().any(|word| word == "broken");
    let path = std::env::var("HILRIG_PORT_BASE").expect("started by the rig");
    let mut port = OpenOptions::new().read(true).write(true).open(path).expect("a port");
    let mut reader: File = port.try_clone().expect("a file");
    let (sender, bytes) = channel();
    thread::spawn(move || {
        let mut buf = [0; 64];
        while let Ok(len @ 1..) = reader.read(&mut buf) {
            buf[..len].iter().for_each(|byte| sender.send(*byte).expect("a receiver"));
        }
    });
    loop {
        port.write_all(&frame(&[0xAB, 0, 2])).expect("a port");
        if let Some(got) = answer(&bytes, 7) {
            let ahead = u16::from_le_bytes([got[3], got[4]]);
            if broken || got == frame(&got[..5]) {
                let [low, high] = (ahead / 10).to_le_bytes();
                println!("ahead {ahead} mm");
                port.write_all(&frame(&[0xAB, 4, 0x82, low, high])).expect("a port");
                answer(&bytes, 5);
            }
        }
        thread::sleep(Duration::from_millis(50));
    }
}
