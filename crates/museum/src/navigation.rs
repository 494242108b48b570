//! The robot's navigation.

use core::time::Duration;

use firmware_core::grid::Grid;
use firmware_core::navigation::{Goal, HALT, Navigator, Settings, Steering, Step, Surroundings};
use firmware_core::pose::{Point, Pose, sin_cos};
use protocols::pcui::message::Mode;

use super::frames::{chain, order};
use super::pc::waypoints;
use super::robot::{MS, Robot, config, range};
use super::{Bug, Observation, Variant};

const NAVIGATION: &str = "robot's program, navigation";

pub(super) const ROWS: [Bug; 5] = [
    Bug::mutant(
        "NV-01",
        NAVIGATION,
        "heading -170, target 170: 340 degrees to the right instead of 20 to the left",
        nv_01,
    ),
    Bug::mutant(
        "NV-02",
        NAVIGATION,
        "after two turns the robot turns back by both before it continues",
        nv_02,
    ),
    Bug::mutant(
        "NV-03",
        NAVIGATION,
        "removing the first waypoint loses the list, but its count still includes the lost ones",
        nv_03,
    ),
    Bug::mutant(
        "NV-04",
        NAVIGATION,
        "after the order to stop, the robot keeps rolling until the base's time-out",
        nv_04,
    ),
    Bug::mutant(
        "NV-05",
        NAVIGATION,
        "the 101st waypoint is dropped silently",
        nv_05,
    ),
];

/// Surroundings without obstacles within three metres.
fn open_floor() -> Surroundings {
    Surroundings::of((0..360_u16).map(|degree| {
        let (sin, cos) = sin_cos(f32::from(degree).to_radians());
        Point::new(3000.0 * cos, 3000.0 * sin)
    }))
}

/// Converts psi, which counts clockwise from the negative x axis.
fn heading(psi_deg: f32) -> f32 {
    (180.0 - psi_deg).to_radians()
}

/// Final set-points of the program with the seed report's steering. Its navigator passes through
/// the headings `psis`, 100 mm forward with each. Its waypoint is a metre away, in the direction in
/// which psi would be `target`.
fn steer(variant: Variant, id: &str, psis: impl Iterator<Item = f32>, target: f32) -> [i8; 2] {
    let mut navigator = Navigator::new(Settings {
        steering: Steering::DOCUMENT,
        ..config(variant, id).navigation
    });
    let (map, around) = (Box::new(Grid::new(10.0)), open_floor());
    let (sin, cos) = sin_cos(heading(target));
    let mut wheels = HALT;
    let mut x_mm = 0.0;
    for psi in psis {
        x_mm += 100.0;
        let pose = Pose::new(x_mm, 0.0, heading(psi));
        let goal = Goal {
            position: Point::new(x_mm + 1000.0 * cos, 1000.0 * sin),
            is_last: false,
        };
        if let Step::Drive(speeds) = navigator.approach(&map, pose, goal, &around) {
            wheels = speeds;
        }
    }
    wheels
}

/// The psi values of a robot that turns from 90 to `end`, 30 degrees at a time.
fn turning_to(end: i16) -> impl Iterator<Item = f32> {
    let steps = (end - 90) / 30;
    (0..=steps.abs()).map(move |step| f32::from(90 + 30 * step * steps.signum()))
}

fn note_wheels(seen: &mut Observation, name: &'static str, [left, right]: [i8; 2]) {
    let way = match left.cmp(&right) {
        core::cmp::Ordering::Less => "left",
        core::cmp::Ordering::Equal => "straight ahead",
        core::cmp::Ordering::Greater => "right",
    };
    seen.figure(name, format!("{left}, {right}: {way}"));
}

fn nv_01(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let wheels = steer(variant, "NV-01", [-170.0].into_iter(), 170.0);
    note_wheels(&mut seen, "wheels at psi -170 towards 170", wheels);
    seen.judged(wheels == [20, -20])
}

fn nv_02(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let wheels = steer(variant, "NV-02", turning_to(810), 90.0);
    note_wheels(&mut seen, "wheels at psi 810 towards 90", wheels);
    let back = steer(variant, "NV-02", turning_to(-270), 90.0);
    note_wheels(&mut seen, "wheels at psi -270 towards 90", back);
    seen.judged(wheels == [-20, 20] && back == [20, -20])
}

fn nv_03(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let mut list = waypoints(variant, "NV-03");
    list.replace(chain(3).into_iter());
    let removed = list.remove(0).is_ok();
    seen.figure("waypoints counted", list.count());
    seen.figure("waypoints reached", list.all().len());
    seen.judged(removed && list.all().is_empty() && list.count() == 2)
}

fn nv_04(variant: Variant) -> Observation {
    let mut robot = Robot::exploring(variant, "NV-04");
    robot.scene = Some(range(2000));
    robot.run(Duration::from_secs(2));
    robot.send(&order(Mode::Stop, [0, 0]));
    robot.run(500 * MS);
    let set_points = robot.note_set_points("set-points half a second after the order to stop");
    robot.judged(set_points != [0, 0])
}

fn nv_05(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let mut list = waypoints(variant, "NV-05");
    for x in 0..100 {
        assert!(list.push([x, 0], 0).is_ok(), "a hundred slots");
    }
    let answer = list.push([100, 0], 0);
    let told = answer.map_or_else(|error| error.to_string(), |id| format!("taken as {id}"));
    seen.figure("the 101st", told);
    seen.figure("waypoints", list.all().len());
    seen.judged(answer.is_ok() && list.all().len() == 100)
}
