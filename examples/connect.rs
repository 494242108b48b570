//! Drives until the wall ahead is 75 cm away, and stops: in virtual time, judged.
use hilrig::prelude::*;
use std::io::{Read, Result, Write};

fn drive(wheels: &mut (impl Read + Write), speed: u8) -> Result<()> {
    let mut frame = vec![0xAB, 1, 0x80 | 2, speed, speed];
    let sum: u16 = frame.iter().map(|&byte| u16::from(byte)).sum();
    frame.extend(sum.to_le_bytes());
    wheels.write_all(&frame)?;
    wheels.read_exact(&mut [0; 5]) // the slave's answer
}

fn ahead_mm(lidar: &mut impl Read) -> Result<u16> {
    let mut p = [0; 22]; // index 90 looks ahead: packet 22, third reading
    loop {
        p.rotate_left(1);
        lidar.read_exact(&mut p[21..])?;
        let word = |at: usize| u32::from(p[at]) | u32::from(p[at + 1]) << 8;
        let sum = (0..10).fold(0, |sum, place| (sum << 1) + word(2 * place));
        let is_sound = ((sum & 0x7FFF) + (sum >> 15)) & 0x7FFF == word(20);
        if p[..2] == [0xFA, 0xB6] && is_sound && p[13] & 0x80 == 0 {
            return Ok(u16::from_le_bytes([p[12], p[13] & 0x3F]));
        }
    }
}

fn robot(mut lidar: impl Read, mut wheels: impl Read + Write) -> Result<()> {
    loop {
        let is_far = ahead_mm(&mut lidar)? > 750;
        drive(&mut wheels, if is_far { 25 } else { 0 })?;
    }
}

fn main() -> core::result::Result<(), Box<dyn core::error::Error>> {
    let (scenario, source) = Scenario::read("docs/connect/robot.toml".as_ref())?;
    let bench = Bench::new(scenario, &source)?;
    robot(bench.port("lidar")?, bench.port("wheels")?).expect_err("drives to the end of its time");
    bench.judge().assert_passed();
    Ok(())
}
