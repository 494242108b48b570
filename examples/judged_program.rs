//! The shortest judged test of a program of your own: a driver written for any serial port asks a
//! sonar how far the wall is, in virtual time. The wall is at 2.7 m, the robot at 1 m.
//!
//! `cargo run --example judged_program`

use core::error::Error;
use std::io::{BufRead, BufReader, Read, Write};

use hilrig::prelude::*;

const SONAR: &str = r#"
schema = 1
name = "sonar"
robot = "custom"
duration = "10s"
expect = { violations_max = 0 }
device.sonar.text.baud = 9600
device.sonar.text.variable = [{ name = "mm", source = { range = { angle_deg = 0, max_mm = 4000 } } }]
device.sonar.text.command = [{ request = "ping", reply = "mm={mm}" }]
world.start = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }
world.wall = [{ path_m = [[2.7, 0.0], [2.7, 2.0]] }]
"#;

/// The program under test.
fn wall_mm(mut port: impl Read + Write) -> Result<u32, Box<dyn Error>> {
    port.write_all(b"ping\r\n")?;
    let mut line = String::new();
    BufReader::new(port).read_line(&mut line)?;
    Ok(line.trim().trim_start_matches("mm=").parse()?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let (scenario, source) = Scenario::from_text(SONAR)?;
    let bench = Bench::new(scenario, &source)?;
    assert_eq!(wall_mm(bench.port("sonar")?)?, 1700);
    bench.judge().assert_passed();
    Ok(())
}
