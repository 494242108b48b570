//! The whole program, where its parts meet.

extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use super::*;
use crate::Inspect;

fn at(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

fn robot() -> Box<Yellow> {
    Box::new(Yellow::new(Config::DEFAULT))
}

/// Damaged bytes on the lines are counted.
#[test]
fn damage_on_the_lines_is_counted() {
    let mut robot = robot();
    for event in [
        LineEvent::Break,
        LineEvent::FramingError,
        LineEvent::ParityError,
        LineEvent::Overrun,
        LineEvent::Opened,
        LineEvent::Closed,
    ] {
        robot.line_event(Yellow::LIDAR, at(1), event);
        robot.line_event(Yellow::TELEMETRY, at(1), event);
    }
    let mut told = Vec::new();
    robot.counters(&mut |name, count| told.push((name, count)));
    let damaged: Vec<_> = told.iter().filter(|(_, count)| *count > 0).collect();
    assert_eq!(damaged, [&("line errors", 8)]);
}
