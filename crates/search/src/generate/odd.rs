//! Unusual orders of the operator, and valid frames with arbitrary contents.

use super::Profile;
use super::dice::Draw;
use super::fault_targets::Orders;
use super::mission::{sort, step};
use engine::codec::Codec;
use engine::codec::wire::Choices;
use engine::scenario::{Action, DirectionSpec, InjectSpec, Scenario};

/// Earliest time of an unusual order, milliseconds: the robot then drives.
const FROM_MS: u64 = 3_000;
/// Maximum number of unusual orders, and of frames.
const ORDERS_MAX: u64 = 4;
const FRAMES_MAX: u64 = 12;
/// Maximum length of an injected frame, bytes.
const FRAME_MAX: usize = 256;
/// Pause behind the head of a frame, milliseconds: a receiver discards it.
const PAUSE_MS: usize = 400;
/// Number of bytes of such a head.
const HEAD: usize = 17;
/// Time from a stop to the next order, milliseconds.
const STOPS_MS: [u64; 2] = [2_000, 6_000];

/// Time between two orders of a long run, milliseconds: the robot has rested between some of them.
const AGAIN_MS: u64 = 45_000;
/// Maximum distance from the last waypoint at which the robot rests, in addition to that of a
/// visit, millimetres.
const BESIDE_MM: f64 = 100.0;

pub(super) fn is_drawn(percent: u64, dice: &mut Draw) -> bool {
    percent > 0 && dice.below(100) < percent
}

/// Adds unusual orders and frames to a mission with faults.
pub(super) fn orders(profile: &Profile, orders: &Orders, made: &mut Scenario, dice: &mut Draw) {
    let end = u64::try_from(made.duration.0.as_millis()).unwrap_or(u64::MAX);
    let latest = end.max(2 * FROM_MS) - FROM_MS;
    if is_drawn(profile.mission.odd_orders_percent, dice) {
        for _ in 0..dice.between(1, ORDERS_MAX) {
            let at = dice.between(FROM_MS, latest);
            order(at, orders, made, dice);
        }
    }
    if let Some((link, codec)) = orders.link
        && is_drawn(profile.mission.forged_percent, dice)
    {
        for _ in 0..dice.between(1, FRAMES_MAX) {
            let at = dice.between(FROM_MS, latest);
            let bytes = forged(codec, dice);
            for (at, bytes) in (at..).step_by(PAUSE_MS).zip(bytes) {
                made.mission.step.push(step(at, inject(link, &bytes)));
            }
        }
        // An order to drive by hand may lead into a wall.
        if let Some(safety) = &mut made.expect.safety {
            safety.by_hand = true;
        }
    }
    sort(&mut made.mission.step);
}

/// Adds one unusual order.
fn order(at: u64, orders: &Orders, made: &mut Scenario, dice: &mut Draw) {
    let places = made.mission.waypoints_m.clone();
    let mission = &mut made.mission.step;
    let list = |places: Vec<[f64; 2]>| Action::WaypointsM(places);
    match dice.below(5) {
        0 if !places.is_empty() => mission.push(step(at, list(Vec::new()))),
        1 if !places.is_empty() => mission.push(step(at, list(long(&places, orders, dice)))),
        2 if !places.is_empty() => {
            let last = dice.index(places.len());
            mission.push(step(at, list(places[..=last].to_vec())));
        }
        3 if orders.modes.contains(&"stop") => {
            mission.push(step(at, Action::Mode("stop".to_owned())));
            if !places.is_empty() {
                let [least, most] = STOPS_MS;
                mission.push(step(at + dice.between(least, most), list(places)));
            }
        }
        _ if !orders.modes.is_empty() => {
            let mode = orders.modes[dice.index(orders.modes.len())];
            mission.push(step(at, Action::Mode(mode.to_owned())));
        }
        _ => {}
    }
}

/// A list of the greatest length, or of a smaller one.
fn long(places: &[[f64; 2]], orders: &Orders, dice: &mut Draw) -> Vec<[f64; 2]> {
    let most = orders.list_max.unwrap_or(places.len() + 1);
    let lens = [most, most / 2, most / 3, places.len() + 1];
    let len = lens[dice.index(lens.len())].clamp(1, most);
    places.iter().copied().cycle().take(len).collect()
}

/// Bytes with a valid frame: the frame alone, behind a stray first byte, or directly behind another
/// frame; or the head of a frame with a wrong length, a pause, and the frame.
fn forged(codec: &Codec, dice: &mut Draw) -> Vec<Vec<u8>> {
    let Some(mut bytes) = frame(codec, dice) else {
        return Vec::new();
    };
    match dice.below(5) {
        0 => bytes.insert(0, bytes[0]),
        1 => bytes.extend(frame(codec, dice).unwrap_or_default()),
        2 => {
            let mut head: Vec<u8> = bytes.iter().copied().take(HEAD).collect();
            let at = dice.index(head.len());
            head[at..].fill(0xFF);
            return vec![head, bytes];
        }
        _ => {}
    }
    vec![bytes]
}

fn inject(link: &str, bytes: &[u8]) -> Action {
    Action::Inject(InjectSpec {
        link: link.to_owned(),
        direction: DirectionSpec::ToMaster,
        hex: bytes.iter().map(|byte| format!("{byte:02X}")).collect(),
    })
}

/// A valid frame with arbitrary contents; half of them with small numbers only.
fn frame(codec: &Codec, dice: &mut Draw) -> Option<Vec<u8>> {
    let below = [256, 4][dice.index(2)];
    let first = dice.below(256);
    let choices = (0..128).map(|at| if at == 0 { first } else { dice.below(below) });
    let choices: Vec<u8> = choices
        .map(|byte| u8::try_from(byte).unwrap_or(0))
        .collect();
    let mut frame = Vec::new();
    codec.build(&mut Choices::new(&choices), &mut frame);
    if dice.below(3) == 0 && !frame.is_empty() {
        let at = dice.index(frame.len());
        frame[at] = dice.narrow(0, 255);
        codec.repair(&mut frame);
    }
    (1..=FRAME_MAX).contains(&frame.len()).then_some(frame)
}

/// A long run: the operator orders lists for a long time before the mission, so that counters and
/// clocks of the program overflow. The robot must still end the mission at the right place.
pub(super) fn last_long(profile: &Profile, made: &mut Scenario, dice: &mut Draw) {
    let places = made.mission.waypoints_m.clone();
    let Some(long) = profile.mission.long.filter(|_| !places.is_empty()) else {
        return;
    };
    if !is_drawn(profile.mission.long_percent, dice) {
        return;
    }
    let start = made.world.start_pose();
    let mut others = places.clone();
    others.push([start.x, start.y]);
    let end = u64::try_from(long.0.as_millis()).unwrap_or(u64::MAX);
    let mission = &mut made.mission;
    let times = (1..).map(|count| count * AGAIN_MS);
    for at in times.take_while(|at| *at < end) {
        others.rotate_left(1);
        mission
            .step
            .push(step(at, Action::WaypointsM(others.clone())));
    }
    mission.step.push(step(end, Action::WaypointsM(places)));
    sort(&mut mission.step);
    mission.to_the_end = true;
    made.duration.0 += long.0;
    let expect = &mut made.expect;
    expect.return_within_mm = expect.visit_within_mm.map(|within| within + BESIDE_MM);
    if let Some(safety) = &mut expect.safety {
        let own = profile.judge.safety.as_ref();
        safety.alive_for = own.and_then(|own| own.alive_for);
    }
}

/// The operator orders another list at first: longer than that of the mission, and it begins where
/// the robot starts.
pub(super) fn change(profile: &Profile, orders: &Orders, made: &mut Scenario, dice: &mut Draw) {
    let places = made.mission.waypoints_m.clone();
    if places.is_empty() || !is_drawn(profile.mission.changes_percent, dice) {
        return;
    }
    let start = made.world.start_pose();
    let mut others = long(&places, orders, dice);
    others.splice(..others.len().min(2), [[start.x, start.y]; 2]);
    let at = dice.between(2_000, 5_000);
    let mission = &mut made.mission.step;
    mission.push(step(at, Action::WaypointsM(others)));
    let then = at + dice.between(2_000, 8_000);
    mission.push(step(then, Action::WaypointsM(places)));
    sort(mission);
}
