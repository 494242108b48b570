//! The robot's receiver.

use core::time::Duration;

use firmware_core::Master;
use firmware_core::robots::rescue::Rescue;
use protocols::Instant;
use protocols::pcui::{self, HEADER_LEN};

use crate::frames::{chain, frame, list_frame};
use crate::robot::{MS, Robot, note_end};
use crate::{Observation, Variant};
use engine::codec::PCUI;

/// The golden request of the fielded PC program: STA, mode 1.
fn request() -> Vec<u8> {
    frame(b"STA", &[1, 1, 2])
}

fn note_received(robot: &mut Robot, name: &'static str) -> u64 {
    let received = robot.counter("radio frames");
    robot.seen.figure(name, received);
    received
}

pub(super) fn pu_01(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-01");
    robot.send(&[b"P", &*request()].concat());
    let received = note_received(&mut robot, "frames received");
    robot.judged(received == 0)
}

/// Checksum 8080: 129 times FF, and 01.
pub(super) fn pu_02(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-02");
    let payload = [&[1, 0, 0][..], &[0xFF; 129]].concat();
    robot.send(&frame(b"STA", &payload));
    robot
        .seen
        .figure("sum", format!("{:04X}", pcui::checksum(&payload)));
    let received = note_received(&mut robot, "frames received");
    robot.judged(received == 0)
}

pub(super) fn pu_03(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-03");
    robot.send(b"PCUI_MSG\x00\x80\x00\x00\x00\x00STA");
    for _ in 0..200 {
        robot.program.receive(Rescue::RADIO, robot.now, &request());
        robot.run(5 * MS);
    }
    robot.seen.bytes("PC", &PCUI, &request());
    let received = note_received(&mut robot, "of 200 good frames received");
    robot.judged(received == 0)
}

pub(super) fn pu_04(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-04");
    robot.send(&frame(b"STA", &[]));
    robot.send(&list_frame(&chain(2)));
    let waypoints = robot.program.waypoints().all().len();
    robot
        .seen
        .figure("waypoints of the frame behind", waypoints);
    robot.judged(waypoints == 0)
}

pub(super) fn pu_05(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-05");
    let mut payload = vec![50, 0];
    payload.extend(&list_frame(&chain(1))[HEADER_LEN + 2..]);
    robot.send(&frame(b"LWP", &payload));
    let all = robot.program.waypoints().all();
    let phantoms = all
        .iter()
        .filter(|waypoint| waypoint.position_mm == [0, 0])
        .count();
    robot.seen.figure("waypoints at (0, 0)", phantoms);
    robot.judged(phantoms == 49)
}

/// 19 bytes plus 9 per waypoint: 208 bytes in one burst.
pub(super) fn pu_12(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-12");
    robot.run(100 * MS);
    robot.send(&list_frame(&chain(21)));
    robot.run(Duration::from_secs(4));
    let waypoints = robot.program.waypoints().all().len();
    robot.seen.figure("of 21 waypoints taken", waypoints);
    robot.judged(waypoints == 0)
}

pub(super) fn pu_14(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-14");
    robot.run(100 * MS);
    robot.send(&list_frame(&chain(20)));
    let begun = robot.now;
    while robot.program.waypoints().is_empty() && robot.now - begun < Duration::from_secs(10) {
        robot.run(MS);
    }
    let late = robot.now - begun;
    robot
        .seen
        .figure("199 bytes are taken after, ms", late.as_millis());
    robot.judged(late >= 100 * MS)
}

pub(super) fn pu_16(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-16");
    robot.seen.bytes("PC", &PCUI, b"P");
    robot
        .program
        .receive(Rescue::RADIO, Instant::from_micros(500), b"P");
    let ended = note_end(&mut robot);
    robot.judged(ended)
}
