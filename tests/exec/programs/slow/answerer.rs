//! Answers each line, after it has looked it up in a table that it computes anew.

use std::fs::OpenOptions;
use std::hint::black_box;
use std::io::{Read, Write};

fn table() -> u64 {
    let mut sum = 0_u64;
    for step in 0..2_000_000_u64 {
        sum = black_box(sum.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(step));
    }
    sum
}

fn main() {
    let path = std::env::var("HILRIG_PORT_SONAR").expect("a port");
    let mut port = OpenOptions::new().read(true).write(true).open(path).expect("opens");
    let mut bytes = [0; 64];
    loop {
        let len = port.read(&mut bytes).expect("reads");
        if bytes[..len].contains(&b'm') {
            black_box(table());
            port.write_all(b"ping\r\n").expect("writes");
        }
    }
}
