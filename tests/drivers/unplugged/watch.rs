//! Prints the readings of a sonar, and reopens its port after the adapter was unplugged.
//!
//! Defect: the end of input is treated as "no data yet".
use std::fs::OpenOptions;
use std::io::Read;
use std::thread;
use std::time::Duration;

fn main() {
    let broken = std::env::args().any(|word| word == "broken");
    let path = std::env::var("HILRIG_PORT_SONAR").expect("started by the rig");
    loop {
        let Ok(mut port) = OpenOptions::new().read(true).write(true).open(&path) else {
            thread::sleep(Duration::from_millis(100));
            continue;
        };
        let mut buf = [0; 64];
        loop {
            match port.read(&mut buf) {
                Ok(0) | Err(_) if broken => {}
                Ok(len @ 1..) => print!("{}", String::from_utf8_lossy(&buf[..len])),
                Ok(0) | Err(_) => break,
            }
        }
        println!("gone, opening it again");
        thread::sleep(Duration::from_millis(100));
    }
}
