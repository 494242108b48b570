//! Messages that the PC program sends after clicks of the operator.

use protocols::pcui::message::{Message, Waypoint};
use protocols::{Decode, pcui};

use super::{Operator, robots_list};
use crate::robot::{Robot, note_end};
use crate::{Observation, Variant};

/// The last list of waypoints in `bytes`.
fn sent_list(bytes: &[u8]) -> Vec<Waypoint> {
    let mut decoder = pcui::Decoder::default();
    let frames: Vec<_> = decoder.push(bytes).flatten().collect();
    let list = frames.iter().rev().find_map(|frame| match frame.message() {
        Ok(Message::Waypoints(list)) => Some(list.iter().collect()),
        _ => None,
    });
    list.unwrap_or_default()
}

fn numbers(list: &[Waypoint]) -> String {
    let numbers: Vec<_> = list.iter().map(|one| one.id.to_string()).collect();
    numbers.join(", ")
}

/// The robot has two waypoints; the operator adds a third and deletes it again.
pub(super) fn ui_05(variant: Variant) -> Observation {
    let mut desk = Operator::with_map(variant);
    desk.receive(&robots_list(&[[9, 9], [2, 2]]));
    let added = desk.click([5, 5]);
    desk.note_sent(&added);
    let ids = numbers(&sent_list(&added.unwrap_or_default()));
    desk.seen.figure("numbers in the list", &ids);
    let deleted = desk.delete(2);
    desk.note_sent(&deleted);
    let left = desk.places();
    let told = format!("{left:?}");
    desk.seen.figure("left after the third is deleted", told);
    desk.judged(ids == "0, 1, 0" && left == [[2, 2], [5, 5]])
}

/// Records the list that was sent; returns its first position.
fn note_click(desk: &mut Operator, at: [i16; 2]) -> Option<[i16; 2]> {
    let sent = desk.click(at);
    desk.note_sent(&sent);
    let first = sent_list(&sent.unwrap_or_default())
        .first()
        .map(|one| one.position_mm);
    let told = first.map_or("nothing".to_owned(), |[x, y]| format!("({x}, {y})"));
    desk.seen.figure("waypoint sent", told);
    first
}

/// The map's left edge is x = 0.
pub(super) fn ui_06(variant: Variant) -> Observation {
    let mut desk = Operator::with_map(variant);
    let sent = note_click(&mut desk, [-150, 500]);
    desk.judged(sent == Some([-150, 500]))
}

pub(super) fn ui_07(variant: Variant) -> Observation {
    let mut desk = Operator::new(variant);
    let sent = note_click(&mut desk, [700, 500]);
    desk.judged(sent == Some([0, 0]))
}

/// The first of three waypoints is deleted. The robot is the fielded one in both variants.
pub(crate) fn pu_08(variant: Variant) -> Observation {
    let mut desk = Operator::with_map(variant);
    for x in [500, 600, 700] {
        desk.click([x, x]).expect("on the map");
    }
    let sent = desk.delete(0).expect("it is there");
    let mut robot = Robot::new(Variant::Defective, "PU-07");
    robot.send(&sent);
    let ids = numbers(&sent_list(&sent));
    robot.seen.figure("numbers in the list", ids);
    let ended = note_end(&mut robot);
    robot.judged(ended)
}

/// 2 bytes plus 9 for each of 57 waypoints make 515. Receivers with the fielded defects, here
/// PU-01, accept 511.
pub(crate) fn pu_13(variant: Variant) -> Observation {
    let mut desk = Operator::with_map(variant);
    let mut sent = Ok(Vec::new());
    for x in 0..56 {
        sent = desk.click([x, 0]);
    }
    let mut robot = Robot::new(variant, "PU-01");
    robot.send(&sent.expect("56 are allowed"));
    let last = desk.click([56, 0]);
    desk.note_sent(&last);
    let is_sent = last.is_ok();
    robot.send(&last.unwrap_or_default());
    let [shown, held] = [desk.places().len(), robot.program.waypoints().all().len()];
    desk.seen.figure("waypoints on the screen", shown);
    desk.seen.figure("waypoints of the robot", held);
    desk.judged(is_sent && shown == 57 && held == 56)
}
