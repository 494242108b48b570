//! The robot's navigation.

use core::time::Duration;

use firmware_core::navigation::Steering;
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
        "after two turns the robot spins them back before it drives on",
        nv_02,
    ),
    Bug::mutant(
        "NV-03",
        NAVIGATION,
        "removing the first waypoint loses the list, and its count keeps orphans",
        nv_03,
    ),
    Bug::mutant(
        "NV-04",
        NAVIGATION,
        "told to stop, the robot rolls on until the base's time-out",
        nv_04,
    ),
    Bug::mutant(
        "NV-05",
        NAVIGATION,
        "the 101st waypoint is dropped silently",
        nv_05,
    ),
];

/// What the program steers at heading `psi`, with a waypoint in the direction `target`.
fn steer(variant: Variant, id: &str, [psi, target]: [f32; 2]) -> [i8; 2] {
    let defects = config(variant, id).navigation.defects;
    if defects.wraps_one_side || defects.counts_turns {
        Steering::DOCUMENT.towards_psi(psi, target)
    } else {
        Steering::DOCUMENT.towards((psi - target).to_radians())
    }
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
    let wheels = steer(variant, "NV-01", [-170.0, 170.0]);
    note_wheels(&mut seen, "wheels at psi -170 towards 170", wheels);
    seen.judged(wheels == [20, -20])
}

fn nv_02(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let wheels = steer(variant, "NV-02", [810.0, 90.0]);
    note_wheels(&mut seen, "wheels at psi 810 towards 90", wheels);
    let back = steer(variant, "NV-02", [-270.0, 90.0]);
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
