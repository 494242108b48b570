//! The robot's transmissions to the PC.

use core::time::Duration;

use firmware_core::Master;
use protocols::pcui::{self, FRAME_MAX, HEADER_LEN, message};
use protocols::{Decode, Instant};

use crate::robot::{MS, Robot, config};
use crate::{Observation, Variant};
use engine::codec::PCUI;

/// Number of rows that the PC decodes from all bytes of the robot, and number of bytes outside of
/// frames.
fn rows(robot: &mut Robot) -> (usize, u64) {
    let mut decoder = pcui::Decoder::default();
    let frames: Vec<_> = decoder.push(&robot.radio).flatten().collect();
    let rows = frames.iter().filter(|frame| frame.id().starts_with(b"MA"));
    let (rows, strays) = (rows.count(), decoder.discarded());
    robot
        .seen
        .figure("map rows sent", robot.counter("map rows sent"));
    robot.seen.figure("map rows that arrive whole", rows);
    robot.seen.figure("bytes that are no frame", strays);
    (rows, strays)
}

/// A robot after some time, with the number of sent rows and of rows that arrive complete. The
/// defective variant is that of PU-06.
pub(crate) fn rows_arriving(variant: Variant, time: Duration) -> (Robot, [usize; 2]) {
    let mut robot = Robot::new(variant, "PU-06");
    robot.run(time);
    let (whole, _) = rows(&mut robot);
    let sent = usize::try_from(robot.counter("map rows sent")).expect("a count of rows");
    (robot, [sent, whole])
}

pub(super) fn pu_06(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-06");
    robot.run(Duration::from_secs(5));
    let torn = robot
        .radio
        .windows(14)
        .position(|w| w.starts_with(b"PCUI_MSG") && w[9..].contains(&b'P'));
    if let Some(at) = torn {
        let bytes = robot.radio[at..]
            .iter()
            .take(40)
            .copied()
            .collect::<Vec<_>>();
        robot.seen.bytes("robot", &PCUI, &bytes);
    }
    let (_, strays) = rows(&mut robot);
    robot.judged(strays > 0)
}

/// The receiver accepts no bytes until the queue has refused a frame.
pub(super) fn pu_17(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-17");
    while robot.counter("radio queue overflows") == 0 && robot.now < Instant::from_secs(60) {
        robot.now += MS;
        robot.program.poll(robot.now);
    }
    robot.run(200 * MS);
    let bytes = robot.radio.clone();
    robot.seen.bytes("robot", &PCUI, &bytes[..40]);
    let frames = pcui::Decoder::default().push(&bytes).flatten().count();
    robot.seen.figure("frames in the next 200 ms", frames);
    robot.judged(frames == 0)
}

pub(super) fn pu_18(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-18");
    robot.run(Duration::from_secs(2));
    let text = robot
        .radio
        .windows(9)
        .position(|window| window == b"Watermark");
    if let Some(at) = text {
        let bytes = robot.radio[at.saturating_sub(13)..]
            .iter()
            .take(40)
            .copied();
        robot.seen.bytes("robot", &PCUI, &bytes.collect::<Vec<_>>());
    }
    let (_, strays) = rows(&mut robot);
    robot.judged(text.is_some() && strays > 0)
}

/// A row of 299 unknown cells and a wall.
pub(super) fn pu_19(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let mut pixels = [127; 300];
    pixels[299] = 255;
    let mut bytes = [0; FRAME_MAX];
    let dialect = config(variant, "PU-19").pc_link.dialect;
    let len = message::encode_row(0, 0, &pixels, dialect, &mut bytes).unwrap_or(0);
    seen.bytes("robot", &PCUI, &bytes[..len]);
    let mut row = [127; 300];
    let decoded = protocols::rle::decode(&bytes[HEADER_LEN + 3..len], &mut row);
    seen.figure("pixels sent of 300", decoded.unwrap_or(0));
    seen.figure("pixel 299, a wall of 255", row[299]);
    seen.judged(row[299] == 127)
}
