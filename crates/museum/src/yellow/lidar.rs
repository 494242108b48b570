//! The driver of the RPLIDAR, and its set of turns.

use firmware_core::Inspect;
use firmware_core::pose::Point;

use super::bench::{Robot, SECOND};
use super::head::Head;
use crate::{Bug, Observation, Variant};
use engine::codec::RPLIDAR;

const LIDAR: &str = "robot's program, lidar";
const WITH_YL_01: &str = "the program with the defect YL-01";

pub(super) const ROWS: [Bug; 7] = [
    Bug::mutant(
        "YL-01",
        LIDAR,
        "nodes are groups of five bytes by count: after one lost byte no node is valid",
        yl_01,
    ),
    Bug::new(
        "YL-01b",
        LIDAR,
        "the descriptor is skipped by count: a stray byte before it misaligns the whole session",
        WITH_YL_01,
        yl_01b,
    ),
    Bug::new(
        "YL-01c",
        LIDAR,
        "the stream is not drained before a start: its rest is skipped instead of the descriptor",
        WITH_YL_01,
        yl_01c,
    ),
    Bug::mutant(
        "YL-02",
        LIDAR,
        "the count of the descriptor is never reset: after a second start nodes are off by two",
        yl_02,
    ),
    Bug::mutant(
        "YL-03",
        LIDAR,
        "angles are 360 minus whole degrees: straight ahead is written outside an array of 360",
        yl_03,
    ),
    Bug::mutant(
        "YL-04",
        LIDAR,
        "the robot does not notice a Protection Stop: the old ranges stay",
        yl_04,
    ),
    Bug::mutant(
        "YL-05",
        LIDAR,
        "a set of five turns is five copies of one: nothing is averaged",
        yl_05,
    ),
];

/// A robot in a round room of 1 m.
fn robot(variant: Variant, id: &str) -> Robot {
    let mut robot = Robot::new(variant, id);
    robot.lidar = Head::new(|_, _| 1_000);
    robot
}

/// Records the lidar's last bytes, and the number of invalid node groups in the next second.
fn misaligned(mut robot: Robot) -> Observation {
    robot.seen.bytes("lidar", &RPLIDAR, &robot.lidar.sent);
    let (bad, nodes) = (
        robot.counter("lidar groups bad"),
        robot.counter("lidar nodes"),
    );
    robot.run(SECOND);
    let bad = robot.counter("lidar groups bad") - bad;
    let nodes = robot.counter("lidar nodes") - nodes;
    robot.seen.figure("taken for nodes in a second", nodes);
    robot.seen.figure("of them without a node's bits", bad);
    // By chance, up to half of the groups that begin at a wrong offset look like a node.
    robot.judged(bad > nodes / 4)
}

fn yl_01(variant: Variant) -> Observation {
    let mut robot = robot(variant, "YL-01");
    robot.run(SECOND * 2);
    robot.lidar.loses_byte = true;
    robot.step();
    misaligned(robot)
}

fn yl_01b(variant: Variant) -> Observation {
    let mut robot = robot(variant, "YL-01");
    robot.lidar.stray = vec![0];
    robot.run(SECOND + SECOND / 100);
    misaligned(robot)
}

fn yl_01c(variant: Variant) -> Observation {
    let mut robot = robot(variant, "YL-01");
    robot.lidar.streams = true;
    robot.run(SECOND + SECOND / 100);
    misaligned(robot)
}

/// The second start ends a Protection Stop.
fn yl_02(variant: Variant) -> Observation {
    let mut robot = robot(variant, "YL-02");
    robot.run(SECOND * 2);
    robot.lidar.is_stopped = true;
    robot.run(SECOND * 3);
    misaligned(robot)
}

fn yl_03(variant: Variant) -> Observation {
    let mut robot = robot(variant, "YL-03");
    robot.run(SECOND * 3);
    robot.seen.bytes("lidar", &RPLIDAR, &robot.lidar.sent);
    let (stray, turns) = (
        robot.counter("lidar readings astray"),
        robot.counter("lidar turns"),
    );
    robot.seen.figure("turns", turns);
    robot
        .seen
        .figure("readings written beside the array", stray);
    robot.judged(stray > 0)
}

fn yl_04(variant: Variant) -> Observation {
    let mut robot = robot(variant, "YL-04");
    robot.run(SECOND * 3);
    robot.lidar.is_stopped = true;
    robot.lidar.asked.clear();
    robot.run(SECOND + SECOND / 2);
    let points = Inspect::scan(&*robot.program).len();
    let name = "points of the scan 1.5 s into a Protection Stop";
    robot.seen.figure(name, points);
    let asked: Vec<_> = robot
        .lidar
        .asked
        .iter()
        .map(|it| format!("{it:?}"))
        .collect();
    let asked = if asked.is_empty() {
        "nothing".to_owned()
    } else {
        asked.join(", ")
    };
    robot.seen.figure("asked of the lidar meanwhile", asked);
    let is_unnoticed = robot.lidar.asked.is_empty();
    robot.judged(points > 0 && is_unnoticed)
}

/// Turns that see a wall at 970, 1030, 1000, 970 and 1030 mm, repeatedly.
fn yl_05(variant: Variant) -> Observation {
    const TURNS_MM: [u16; 5] = [970, 1_030, 1_000, 970, 1_030];
    let mut robot = Robot::new(variant, "YL-05");
    robot.lidar = Head::new(|turn, _| TURNS_MM[turn as usize % TURNS_MM.len()]);
    // Results at the ends of turns 7 and 8.
    let mut told = Vec::new();
    for turns in [7, 8] {
        robot.run_until(SECOND * 6, |robot| robot.counter("lidar sets") == turns);
        let points = Inspect::scan(&*robot.program);
        let ahead = points.iter().find(|point| is_ahead(point));
        told.push(ahead.map_or(0.0, |point| point.x_mm.round()));
    }
    let spread = (told[0] - told[1]).abs();
    let name = "distance ahead in two sets, mm";
    let told = format!("{} and {}", told[0], told[1]);
    robot.seen.figure(name, told);
    robot.judged(spread > 20.0)
}

fn is_ahead(point: &Point) -> bool {
    point.y_mm.abs() < 1.0 && point.x_mm > 0.0
}
