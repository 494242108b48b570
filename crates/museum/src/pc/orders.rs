//! The robot's handling of waypoints and orders.

use core::time::Duration;

use protocols::pcui::message::{self, NO_WAYPOINT, Waypoint};

use super::waypoints;
use crate::frames::{chain, list, list_frame, order};
use crate::robot::{MS, Robot, note_end, range};
use crate::{Observation, Variant};
use engine::codec::PCUI;

/// List that the PC program sends after the first of two waypoints was removed and one was added.
pub(super) fn pu_07(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-07");
    let waypoint = |place, id, previous| Waypoint {
        position_mm: [place; 2],
        layer: 0,
        id,
        previous,
    };
    robot.send(&list_frame(&[
        waypoint(2, 1, NO_WAYPOINT),
        waypoint(5, 0, 1),
    ]));
    let ended = note_end(&mut robot);
    robot.judged(ended)
}

pub(super) fn pu_09(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let sent = list(&[[0, NO_WAYPOINT], [1, 0], [2, 0]]);
    seen.bytes("PC", &PCUI, &list_frame(&sent));
    let mut list = waypoints(variant, "PU-09");
    list.replace(sent.into_iter());
    seen.figure("waypoints that the list reaches", list.all().len());
    seen.figure(
        "writes through links to deleted waypoints",
        list.stray_writes().count,
    );
    seen.judged(list.stray_writes().count == 1)
}

pub(super) fn pu_10(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let mut list = waypoints(variant, "PU-10");
    list.replace(chain(3).into_iter());
    list.advance();
    list.advance();
    let mut shorter = chain(1);
    shorter[0].position_mm = [500, 0];
    seen.bytes("PC", &PCUI, &list_frame(&shorter));
    list.replace(shorter.into_iter());
    let target = list.target().map(|target| target.position_mm);
    seen.figure("target, mm", format!("{:?}", target.unwrap_or_default()));
    seen.judged(target == Some([-1, -1]))
}

pub(super) fn pu_11(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-11");
    robot.send(&list_frame(&chain(2)));
    robot.run(50 * MS);
    robot.send(&list_frame(&[]));
    let mode = robot.program.ordered_mode();
    robot
        .seen
        .figure("mode after an empty list of waypoints", format!("{mode:?}"));
    robot.judged(mode == message::Mode::Exploration)
}

pub(super) fn pu_20(variant: Variant) -> Observation {
    let mut robot = Robot::exploring(variant, "PU-20");
    robot.scene = Some(range(2000));
    robot.run(Duration::from_secs(2));
    robot.send(&order(message::Mode::Manual, [5, -5]));
    robot.run(600 * MS);
    let set_points = robot.note_set_points("set-points 600 ms after the order 5, -5");
    robot.judged(set_points != [5, -5])
}

pub(super) fn pu_21(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-21");
    robot.run(100 * MS);
    robot.send(&order(message::Mode::Manual, [5, -5]));
    robot.run(Duration::from_secs(3));
    let set_points = robot.note_set_points("set-points 3 s after the last order 5, -5");
    robot.judged(set_points == [5, -5])
}
