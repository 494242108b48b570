//! An operator who uses everything that the station offers: drives by hand, gives many orders at
//! once, sends the robot to other poses, and leaves without a word.

use super::Profile;
use super::dice::Draw;
use super::fault_targets::Orders;
use super::faults::{end_of_trouble, millis};
use super::mission::{is_fixed, sort, step};
use super::odd::is_drawn;
use engine::robots::DriveKeys;
use engine::scenario::{
    Action, DirectionSpec, FaultKind, FaultSpec, Scenario, SetPoint, Span, Step,
};

/// First act: the robot has its first scans then; and the time between two acts, milliseconds.
const FROM_MS: [u64; 2] = [6_000, 12_000];
const BETWEEN_MS: [u64; 2] = [3_000, 9_000];
/// Time until the next order, milliseconds.
const LASTS_MS: [u64; 2] = [2_000, 6_000];
/// Time from an order by hand until the station disconnects, and of its absence, milliseconds. A
/// robot must have stopped before the station is back.
const LEAVES_MS: [u64; 2] = [300, 1_500];
const GONE_MS: [u64; 2] = [3_500, 6_000];
/// Time before the end of the run in which no act begins, milliseconds.
const LONGEST_MS: u64 = 20_000;
/// Number of orders that an operator gives at once, and the time between two of them, milliseconds.
const MANY: [u64; 2] = [5, 12];
const EACH_MS: [u64; 2] = [50, 150];
/// Number of drives by hand one after the other, and the time between two of them, milliseconds.
const DRIVES: [u64; 2] = [1, 8];
const DRIVE_MS: [u64; 2] = [700, 1_800];
/// Probabilities of a flipped bit per byte in the noise during such drives.
const RATES: [f64; 3] = [0.003, 0.01, 0.03];
/// Largest distance of an ordered pose from the start along each axis, millimetres.
const NEAR_MM: u64 = 600;

fn within([least, most]: [u64; 2], dice: &mut Draw) -> u64 {
    dice.between(least, most)
}

/// Adds the acts of such an operator to a mission with faults, or `always`.
pub(super) fn acts(
    profile: &Profile,
    orders: &Orders,
    always: bool,
    made: &mut Scenario,
    dice: &mut Draw,
) {
    let end = millis(made.duration);
    let healed = end_of_trouble(profile, made.duration);
    let kinds = kinds(orders);
    if kinds.is_empty() || !(always || is_drawn(profile.mission.operator_percent, dice)) {
        return;
    }
    let again = again(made);
    let is_fixed = is_fixed(made);
    let start = made.world.start_pose();
    let mut at = within(FROM_MS, dice);
    let (mut steps, mut noises) = (Vec::new(), Vec::new());
    let may_flip = !profile
        .faults
        .never
        .iter()
        .any(|never| never == FaultKind::Flip.name());
    let link = orders.link.filter(|_| may_flip && orders.can_flip);
    let link = link.map(|(link, _)| link);
    while at + LONGEST_MS < end {
        let kind = kinds[dice.index(kinds.len())];
        let added = match (kind, &orders.keys) {
            (Kind::Hands, Some(keys)) => by_hand(at, keys, dice),
            (Kind::Leaves, Some(keys)) => leaves(at, keys, dice),
            (Kind::Many, Some(keys)) => many(at, keys, dice),
            _ => goals(at, &orders.goals, [start.x, start.y], dice),
        };
        let from = at;
        let last = added.iter().filter_map(|step| step.at).max();
        at = last.map_or(at, millis) + within(LASTS_MS, dice);
        steps.extend(added);
        let has_room = ((made.fault.len() + noises.len()) as u64) < profile.faults.count_max;
        let may_be_noisy = kind == Kind::Hands && !always && has_room && from < healed;
        let is_noisy = may_be_noisy && dice.below(2) == 0;
        if let Some(link) = link.filter(|_| is_noisy) {
            let until = at.min(healed);
            noises.push(noise(link, [from, until], RATES[dice.index(RATES.len())]));
        }
        if let Some(again) = &again {
            steps.push(step(at, again.clone()));
        }
        at += within(BETWEEN_MS, dice);
    }
    made.fault.extend(noises);
    // A robot that is sent to a pose while it explores may not know where that is.
    let is_sent = steps
        .iter()
        .any(|step| matches!(&step.action, Action::Mode(mode) if mode.contains(' ')));
    if is_sent
        && is_fixed
        && let Some(safety) = &mut made.expect.safety
    {
        safety.pose_within_mm = None;
    }
    made.mission.step.extend(steps);
    sort(&mut made.mission.step);
    // A drive by hand may lead into a wall.
    let by_hand = |step: &Step| matches!(step.action, Action::Drive(_));
    if made.mission.step.iter().any(by_hand)
        && let Some(safety) = &mut made.expect.safety
    {
        safety.by_hand = true;
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Hands,
    Leaves,
    Many,
    Goals,
}

/// The acts that the station offers.
fn kinds(orders: &Orders) -> Vec<Kind> {
    let by_hand = [Kind::Hands, Kind::Leaves, Kind::Many];
    let by_hand = by_hand.into_iter().filter(|_| orders.keys.is_some());
    let goals = (!orders.goals.is_empty()).then_some(Kind::Goals);
    by_hand.chain(goals).collect()
}

/// The order that continues the mission.
fn again(made: &Scenario) -> Option<Action> {
    let mut steps = made.mission.step.iter().map(|step| &step.action);
    let mode = steps.find(|action| matches!(action, Action::Mode(_)));
    let places = &made.mission.waypoints_m;
    let list = (!places.is_empty()).then(|| Action::WaypointsM(places.clone()));
    mode.cloned().or(list)
}

/// A motion by the keys: ahead or back, left or right, or both.
fn drive(keys: &DriveKeys, dice: &mut Draw) -> Action {
    let signs = [
        [1.0, 0.0],
        [-1.0, 0.0],
        [0.0, 1.0],
        [0.0, -1.0],
        [1.0, 1.0],
        [-1.0, 1.0],
    ];
    let [ahead, left] = signs[dice.index(signs.len())];
    let axes = keys.ahead.iter().zip(&keys.left).zip(&keys.limit);
    let axes = axes.map(|((one, other), limit)| {
        SetPoint((ahead * one.0 + left * other.0).clamp(-limit.0, limit.0))
    });
    Action::Drive(axes.collect())
}

fn by_hand(at: u64, keys: &DriveKeys, dice: &mut Draw) -> Vec<Step> {
    let mut at = at;
    let orders = 0..within(DRIVES, dice);
    let orders = orders.map(|_| {
        let order = step(at, drive(keys, dice));
        at += within(DRIVE_MS, dice);
        order
    });
    orders.collect()
}

/// Flipped bits on the link of the orders from `at` to `until`.
fn noise(link: &str, [at, until]: [u64; 2], rate: f64) -> FaultSpec {
    FaultSpec {
        rate: Some(rate),
        from: Some(Span::from_millis(at)),
        until: Some(Span::from_millis(until)),
        ..FaultSpec::on(link, DirectionSpec::ToMaster, FaultKind::Flip)
    }
}

/// A drive by hand, during which the station disconnects.
fn leaves(at: u64, keys: &DriveKeys, dice: &mut Draw) -> Vec<Step> {
    let gone = at + within(LEAVES_MS, dice);
    let back = gone + within(GONE_MS, dice);
    let order = drive(keys, dice);
    let steps = [
        (at, order),
        (gone, Action::Disconnect),
        (back, Action::Connect),
    ];
    steps.map(|(at, action)| step(at, action)).to_vec()
}

/// Many drives within a second, and a stop.
fn many(at: u64, keys: &DriveKeys, dice: &mut Draw) -> Vec<Step> {
    let mut at = at;
    let mut steps = Vec::new();
    for _ in 0..within(MANY, dice) {
        steps.push(step(at, drive(keys, dice)));
        at += within(EACH_MS, dice);
    }
    steps.push(step(at, Action::Mode("stop".to_owned())));
    steps
}

/// A pose near the start, and often one on the other side of it before the first is reached.
fn goals(at: u64, modes: &[&'static str], start: [f64; 2], dice: &mut Draw) -> Vec<Step> {
    let mode = modes[dice.index(modes.len())];
    let mut offset = || dice.narrow::<u32>(0, 2 * NEAR_MM);
    let near = f64::from(u32::try_from(NEAR_MM).unwrap_or_default());
    let [x, y] = [offset(), offset()].map(|mm| (f64::from(mm) - near) / 1000.0);
    let pose = |side: f64, degrees: u64| {
        let [x, y] = [start[0] + side * x, start[1] + side * y];
        Action::Mode(format!("{mode} {x:.2} {y:.2} {degrees}"))
    };
    let mut steps = vec![step(at, pose(1.0, dice.below(360)))];
    if dice.below(2) == 0 {
        let then = at + within(LASTS_MS, dice) / 2;
        steps.push(step(then, pose(-1.0, dice.below(360))));
    }
    steps
}
