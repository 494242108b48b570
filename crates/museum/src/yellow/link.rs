//! The robot's end of the telemetry link.

use protocols::telemetry::message::{Pose, State, Telecommand, Velocities};

use super::bench::{Robot, SECOND, flipped, framed};
use super::head::Head;
use crate::{Bug, Observation, Variant};

const LINK: &str = "robot's program, telemetry link";

pub(super) const ROWS: [Bug; 5] = [
    Bug::mutant(
        "YF-01",
        LINK,
        "a checksum mismatch is recorded and then overwritten: a flipped bit is a speed of 1 m/s",
        yf_01,
    ),
    Bug::mutant(
        "YF-02",
        LINK,
        "a start byte inside a frame is data: one lost byte costs two telecommands",
        yf_02,
    ),
    Bug::mutant(
        "YF-03",
        LINK,
        "bytes that arrive before the program has read a frame are discarded",
        yf_03,
    ),
    Bug::mutant(
        "YF-04",
        LINK,
        "a scan with a value per degree does not fit: the previous message is sent again",
        yf_04,
    ),
    Bug::mutant(
        "YF-05",
        LINK,
        "the robot takes its own scan, echoed by the radio, for a telecommand: its pose becomes 0, 0",
        yf_05,
    ),
];

/// A telecommand for a drive at 0.25 m/s.
fn quarter() -> Telecommand {
    Telecommand {
        timestamp_ms: 1,
        state: Some(State::Manual),
        velocities: Some(Velocities {
            linear_m_s: 0.25,
            angular_rad_s: 0.0,
        }),
        ..Telecommand::default()
    }
}

fn yf_01(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YF-01");
    robot.hear(&flipped(framed(&quarter())));
    robot.run(SECOND);
    let speed = robot.program.target().linear_m_s;
    robot
        .seen
        .figure("speed after 0.25 with a flipped bit, m/s", speed);
    robot.judged(speed > 0.9)
}

fn yf_02(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YF-02");
    let whole = framed(&quarter());
    let mut bytes = whole.clone();
    bytes.remove(8);
    bytes.extend(&whole);
    robot.hear(&bytes);
    let taken = robot.counter("telecommands");
    let name = "of a frame without one byte and a whole one, taken";
    robot.seen.figure(name, taken);
    robot.judged(taken == 0)
}

fn yf_03(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YF-03");
    let whole = framed(&quarter());
    robot.hear(&[&whole[..], &whole[..]].concat());
    let taken = robot.counter("telecommands");
    robot
        .seen
        .figure("of two frames back to back, taken", taken);
    robot.judged(taken == 1)
}

/// 360 points need 3525 bytes; the buffer has 3200.
fn yf_04(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YF-04");
    robot.lidar = Head::new(|_, _| 1_000);
    robot.run(SECOND * 2 + SECOND / 20);
    let before = robot.heard.last().map(|told| told.timestamp_ms);
    robot.order(&Telecommand {
        lidar_step_deg: Some(1),
        ..Telecommand::default()
    });
    robot.run(SECOND / 5);
    let told = robot.heard.last().expect("telemetry each 200 ms");
    let is_old = Some(told.timestamp_ms) == before;
    let points = told.lidar.as_ref().map_or(0, |scan| scan.points.len());
    let since = told.timestamp_ms - before.unwrap_or_default();
    let name = "the answer is younger than the message before by, ms";
    robot.seen.figure(name, since);
    robot.seen.figure("points of the scan", points);
    robot.judged(is_old)
}

/// Field 4 of the robot's telemetry is the scan; field 4 of a telecommand is the pose.
fn yf_05(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YF-05");
    robot.lidar = Head::new(|_, _| 1_000);
    robot.run(SECOND * 2 + SECOND / 20);
    robot.order(&Telecommand {
        lidar_step_deg: Some(90),
        corrected_pose: Some(Pose {
            x: 1.5,
            y: 0.5,
            alpha: 0.0,
        }),
        ..Telecommand::default()
    });
    robot.run(SECOND / 5);
    let told = robot.sent.last().cloned().expect("telemetry each 200 ms");
    robot.hear(&told);
    robot.run(SECOND / 5);
    let pose = robot.heard.last().and_then(|told| told.odometry.as_ref());
    let x = pose.map_or(f32::NAN, |odometry| odometry.pose.x);
    robot.seen.figure("where it is after that, m", x);
    robot.judged(x < 0.1)
}
