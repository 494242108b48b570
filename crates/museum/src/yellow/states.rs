//! The state machine, and manoeuvres to a pose.

use core::time::Duration;

use protocols::telemetry::message::{ANY_HEADING, Pose, State, Telecommand, Velocities};

use super::bench::{COUNT_M, Robot, SECOND};
use crate::{Bug, Observation, Variant};

const STATES: &str = "robot's program, state machine";
const POSITION: &str = "robot's program, manoeuvres";

pub(super) const ROWS: [Bug; 5] = [
    Bug::mutant(
        "YS-01",
        STATES,
        "the PC disconnects: the speed by hand stays, because its watchdog is never checked",
        ys_01,
    ),
    Bug::mutant(
        "YS-02",
        STATES,
        "a goal that arrives at the end of a manoeuvre is erased: the robot switches off",
        ys_02,
    ),
    Bug::mutant(
        "YS-03",
        STATES,
        "the state machine runs every 10 ms; the report says every 1 ms",
        ys_03,
    ),
    Bug::mutant(
        "YA-01",
        POSITION,
        "the robot turns in the long direction if the heading wraps around",
        ya_01,
    ),
    Bug::mutant(
        "YA-02",
        POSITION,
        "a new goal is behind the moving robot: it continues ahead in the step of the old goal",
        ya_02,
    ),
];

/// A telecommand to a pose in metres and radians.
fn go(x: f32, y: f32, alpha: f32) -> Telecommand {
    Telecommand {
        state: Some(State::AutoPosition),
        desired_pose: Some(Pose { x, y, alpha }),
        ..Telecommand::default()
    }
}

fn ys_01(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YS-01");
    robot.order(&Telecommand {
        state: Some(State::Manual),
        velocities: Some(Velocities {
            linear_m_s: 0.3,
            angular_rad_s: 0.0,
        }),
        ..Telecommand::default()
    });
    robot.run(SECOND * 10);
    let (mode, target) = (robot.mode(), robot.program.target());
    robot.seen.figure("mode after 10 s of silence", mode);
    let speed = target.linear_m_s;
    robot.seen.figure("speed then, m/s", speed);
    robot.judged(mode == "manual" && speed > 0.29)
}

fn ys_02(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YS-02");
    robot.order(&go(0.3, 0.0, ANY_HEADING));
    robot.run_until(SECOND * 10, |robot| robot.counter("arrivals") == 1);
    robot.order(&go(0.6, 0.0, ANY_HEADING));
    robot.run(SECOND / 10);
    let mode = robot.mode();
    let name = "mode 100 ms after a goal at the end of another";
    robot.seen.figure(name, mode);
    robot.judged(mode != "position")
}

fn ys_03(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YS-03");
    robot.order_state(State::Manual);
    robot.run_until(SECOND, |robot| robot.mode() == "on");
    let on = robot.run_until(SECOND, |robot| robot.mode() != "on");
    let name = "time from drivers on to driving by hand, ms";
    robot.seen.figure(name, on.as_millis());
    robot.judged(on == Duration::from_millis(10))
}

/// From 3.0 to -3.0 rad, the short direction takes 0.28 rad, the other one 6.0 rad.
fn ya_01(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YA-01");
    robot.order(&Telecommand {
        corrected_pose: Some(Pose {
            alpha: 3.0,
            ..Pose::default()
        }),
        ..go(0.0, 0.0, -3.0)
    });
    robot.run_until(SECOND, |robot| robot.mode() == "position");
    let took = robot.run_until(SECOND * 10, |robot| robot.counter("arrivals") == 1);
    let turned = (robot.counts[1] - robot.counts[0]) * COUNT_M / 0.18;
    let name = "turned from heading 3.0 to -3.0, rad";
    robot.seen.figure(name, format!("{turned:.1}"));
    robot.seen.figure("in, ms", took.as_millis());
    robot.judged(turned < -5.0)
}

fn ya_02(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YA-02");
    robot.order(&go(2.0, 0.0, ANY_HEADING));
    robot.run(SECOND * 2);
    robot.order(&go(-1.0, 0.0, ANY_HEADING));
    robot.run(SECOND / 100);
    let speed = robot.program.target().linear_m_s;
    let name = "speed ahead with the new goal behind, m/s";
    robot.seen.figure(name, speed);
    robot.judged(speed > 0.4)
}
