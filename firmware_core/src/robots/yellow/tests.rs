//! Tests of the whole program, where its parts work together.

extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use protocols::telemetry::message::Velocities;

use super::*;
use crate::Inspect;

fn at(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

fn robot() -> Box<Yellow> {
    Box::new(Yellow::new(Config::DEFAULT))
}

const PORTS: [Port; 4] = [
    Yellow::LIDAR,
    Yellow::LIDAR_MOTOR,
    Yellow::BOARD,
    Yellow::TELEMETRY,
];

/// The motor's duty, 0.6 of 255, is sent once, and a request for a scan a second later. The board
/// gets about six bytes for each sample.
#[test]
fn each_port_has_its_own_output() {
    let mut robot = robot();
    let sends = |robot: &Yellow| PORTS.map(|port| robot.may_send(port));
    assert_eq!(sends(&robot), [false, false, false, true]);
    assert!(!robot.may_send(Port(4)));
    robot.poll(at(0));
    assert_eq!(sends(&robot), [false, true, false, true]);
    let mut buf = [0; 64];
    assert_eq!(robot.transmit(Yellow::LIDAR_MOTOR, &mut []), 0);
    assert_eq!(
        (robot.transmit(Yellow::LIDAR_MOTOR, &mut buf), buf[0]),
        (1, 153)
    );
    assert_eq!(robot.transmit(Yellow::LIDAR_MOTOR, &mut buf), 0);
    robot.poll(at(1_000));
    assert_eq!(sends(&robot), [true, false, false, true]);
    assert!(robot.transmit(Yellow::LIDAR, &mut buf) > 0 && !robot.may_send(Yellow::LIDAR));
    robot.receive(Yellow::BOARD, at(1_001), &Sample::default().encode());
    assert!(robot.may_send(Yellow::BOARD));
    let outputs = Outputs::default().encode().len();
    assert_eq!(robot.transmit(Yellow::BOARD, &mut buf), outputs);
    assert!(!robot.may_send(Yellow::BOARD));
    assert_eq!(robot.transmit(Port(4), &mut buf), 0);
    let bauds = PORTS.map(|port| robot.line_config(port).baud);
    assert_eq!(bauds, [115_200, BOARD_BAUD, BOARD_BAUD, 38_400]);
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

/// The program sleeps until the next step of its state machine, a millisecond, or until an earlier
/// event.
#[test]
fn a_step_is_taken_each_millisecond() {
    let mut robot = robot();
    assert_eq!(robot.poll_at(), Some(Instant::ZERO));
    robot.poll(at(0));
    assert_eq!(robot.poll_at(), Some(at(1)));
    robot.poll(at(1));
    assert_eq!((robot.poll_at(), robot.step_at), (Some(at(2)), at(2)));
    // Steps that were missed are not made up for.
    robot.poll(at(50));
    assert_eq!((robot.poll_at(), robot.step_at), (Some(at(51)), at(51)));
}

fn place(x: f32, y: f32, alpha: f32) -> message::Pose {
    message::Pose { x, y, alpha }
}

/// Metres become millimetres; not-a-number is refused, and so is a drive without a goal.
#[test]
fn what_is_no_number_is_refused() {
    let obeyed = |command: Telecommand| {
        let mut robot = robot();
        robot.obey(at(5), &command);
        let pose = robot.pose();
        (
            [pose.x_mm, pose.y_mm, pose.heading],
            robot.by_hand,
            robot.counters.refused,
        )
    };
    let start = robot().pose();
    let start = [start.x_mm, start.y_mm, start.heading];
    let nothing = Telecommand::default();
    let velocities = |linear_m_s, angular_rad_s| Telecommand {
        velocities: Some(Velocities {
            linear_m_s,
            angular_rad_s,
        }),
        ..Telecommand::default()
    };
    assert_eq!(obeyed(nothing), (start, Velocity::ZERO, 0));
    assert_eq!(
        obeyed(velocities(0.25, -0.5)),
        (start, Velocity::new(0.25, -0.5), 0)
    );
    assert_eq!(
        obeyed(velocities(f32::NAN, 0.0)),
        (start, Velocity::ZERO, 1)
    );
    assert_eq!(
        obeyed(velocities(0.0, f32::INFINITY)),
        (start, Velocity::ZERO, 1)
    );
    let corrected = |pose| Telecommand {
        corrected_pose: Some(pose),
        ..Telecommand::default()
    };
    let told = obeyed(corrected(place(0.5, -2.0, 1.5)));
    assert_eq!(told, ([500.0, -2_000.0, 1.5], Velocity::ZERO, 0));
    for bad in [
        place(f32::NAN, 0.0, 0.0),
        place(0.0, f32::INFINITY, 0.0),
        place(0.0, 0.0, f32::NAN),
    ] {
        assert_eq!(obeyed(corrected(bad)), (start, Velocity::ZERO, 1));
    }
}

/// AUTO_POSITION needs a goal in the same telecommand; the goal's heading may be any.
#[test]
fn a_goal_comes_with_its_order() {
    let ordered = |desired_pose| {
        let mut robot = robot();
        let command = Telecommand {
            state: Some(State::AutoPosition),
            desired_pose,
            ..Telecommand::default()
        };
        robot.obey(at(5), &command);
        (5..2_000).for_each(|millis| robot.poll(at(millis)));
        (
            robot.mode() == Mode::AutoPosition || robot.machine.arrivals > 0,
            robot.counters.refused,
        )
    };
    assert_eq!(ordered(None), (false, 1));
    assert_eq!(ordered(Some(place(f32::NAN, 1.0, 0.0))), (false, 1));
    assert_eq!(ordered(Some(place(1.0, 1.0, 0.0))), (true, 0));
    assert_eq!(ordered(Some(place(1.0, 1.0, ANY_HEADING))), (true, 0));
}

/// Each known defect number changes the robot, all of them give the fielded one, and an unknown
/// number gives none.
#[test]
fn the_fielded_robot_has_every_defect() {
    let (sound, fielded) = (Config::DEFAULT, Config::DEFAULT.fielded());
    let mut all = sound;
    for id in Config::defects() {
        let with = sound.with_defect(id).expect("it is known").defects;
        assert_ne!(with, sound.defects, "{id}");
        all = all.with_defect(id).expect("it is known");
    }
    assert_eq!(
        (all.defects, Config::defects().count()),
        (fielded.defects, 25)
    );
    assert!(sound.with_defect("YF-99").is_none());
}
