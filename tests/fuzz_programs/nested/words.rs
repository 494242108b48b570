//! Magic words and a checksum in Rust: `$NAME,FIELD,..*XX`, where XX is the exclusive or of the
//! bytes between `$` and `*`. Used for judging.

use std::fs::OpenOptions;
use std::io::{Read, Write};

fn sum(text: &[u8]) -> u8 {
    text.iter().fold(0, |sum, byte| sum ^ byte)
}

fn take(line: &[u8]) -> Option<()> {
    let body = line.strip_prefix(b"$")?;
    let star = body.iter().position(|&byte| byte == b'*')?;
    let text = std::str::from_utf8(body.get(star + 1..star + 3)?).ok()?;
    if u8::from_str_radix(text, 16).ok()? != sum(&body[..star]) {
        return None;
    }
    let mut fields = body[..star].split(|&byte| byte == b',');
    if fields.next()? == b"CFG" && fields.next()? == b"BAUD" {
        let rate: u32 = std::str::from_utf8(fields.next()?).ok()?.parse().ok()?;
        assert!(rate != 250_000, "rate not possible");
    }
    Some(())
}

fn main() {
    let path = std::env::var("HILRIG_DIR").expect("a rig") + "/sonar";
    let mut options = OpenOptions::new();
    let mut port = options.read(true).write(true).open(path).expect("a port");
    let (mut held, mut got) = (Vec::new(), [0; 256]);
    while let Ok(len @ 1..) = port.read(&mut got) {
        held.extend(&got[..len]);
        while let Some(end) = held.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = held.drain(..=end).collect();
            take(line.trim_ascii_end());
            if held.len() > 4096 {
                port.flush().expect("a port");
            }
        }
    }
}
