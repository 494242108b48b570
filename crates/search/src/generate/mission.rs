use super::Profile;
use super::dice::Draw;
use super::fault_targets::FaultTargets;
use engine::robots::{self, Robot};
use engine::scenario::{Action, Mission, Scenario, Span, Step};

/// Whether the waypoints must stay: the steps lead the robot, by modes or by hand, or the robot
/// takes no orders. Other waypoints would be a mission that the robot cannot do.
pub(super) fn is_fixed(scenario: &Scenario) -> bool {
    let leads = |step: &Step| matches!(step.action, Action::Mode(_) | Action::Drive(_));
    !takes_orders(scenario) || scenario.mission.step.iter().any(leads)
}

/// Whether there is a PC that could hang up, or say something once more.
pub(super) fn takes_orders(scenario: &Scenario) -> bool {
    robots::find(&scenario.robot).is_none_or(Robot::takes_orders)
}

/// Some of `places`, in any order.
pub(super) fn waypoints(mut places: Vec<[f64; 2]>, dice: &mut Draw) -> Vec<[f64; 2]> {
    let count = dice.between(1, 3).min(places.len() as u64);
    (0..count)
        .map(|_| places.remove(dice.index(places.len())))
        .collect()
}

/// What the PC does besides sending the mission, before `until_ms`: it sends it once more, or hangs
/// up for a while.
pub(super) fn steps(waypoints: &[[f64; 2]], until_ms: u64, dice: &mut Draw) -> Vec<Step> {
    let mut steps = Vec::new();
    for _ in 0..dice.below(4) {
        let at = dice.between(2_000, until_ms.max(4_001) - 2_000);
        if dice.below(2) == 0 {
            steps.push(step(at, Action::WaypointsM(waypoints.to_vec())));
        } else {
            steps.push(step(at, Action::Disconnect));
            steps.push(step(at + dice.between(100, 1_500), Action::Connect));
        }
    }
    steps.sort_by_key(|step| step.at);
    steps
}

/// The last steps of a mission: an operator who sees the robot stand tries again. After the last
/// fault the port is opened again, and waypoints that the robot did not confirm are sent again. If
/// the mission is not done a while later, because the robot took another place for a waypoint, or
/// went home with a low battery, it is given once more.
pub(super) fn once_more(mission: &Mission, until_ms: u64, recovery_ms: u64) -> [Step; 3] {
    let mode = mission.step.iter().map(|step| &step.action);
    let mut mode = mode.filter(|action| matches!(action, Action::Mode(_)));
    let again = match mode.next() {
        Some(mode) if mission.waypoints_m.is_empty() => mode.clone(),
        _ => Action::WaypointsM(mission.waypoints_m.clone()),
    };
    [
        step(until_ms + 200, Action::Disconnect),
        step(until_ms + 500, Action::Connect),
        step(until_ms + recovery_ms / 3, again),
    ]
}

/// Orders that keep a robot driving that is steered by hand: its first order again and again, every
/// other time backwards.
pub(super) fn keep_steering(profile: &Profile, mission: &mut Mission, end: Span) {
    let mut drives = mission.step.iter().filter_map(|step| match &step.action {
        Action::Drive(drive) => Some(drive.clone()),
        _ => None,
    });
    let (Some(first), Some(every)) = (drives.next(), profile.mission.repeat) else {
        return;
    };
    let mut drive = first;
    let mut at = every.0;
    while at < end.0 {
        if let Some(speed) = drive.first_mut() {
            speed.0 = -speed.0;
        }
        mission
            .step
            .push(Step::at(Span(at), Action::Drive(drive.clone())));
        at += every.0;
    }
}

/// Time for which the operator turns the robot by hand.
const BY_HAND_MS: [u64; 2] = [3_000, 9_000];

/// Orders that keep the robot driving in the whole run: its waypoints again and again, and turns by
/// hand. A turn on the spot leads into no wall.
pub(super) fn keep_busy(
    profile: &Profile,
    targets: &FaultTargets,
    mission: &mut Mission,
    end: Span,
    dice: &mut Draw,
) {
    let end_ms = u64::try_from(end.0.as_millis()).unwrap_or(u64::MAX);
    let again = |waypoints: &[[f64; 2]]| Action::WaypointsM(waypoints.to_vec());
    if let Some(every) = profile.mission.repeat
        && !mission.waypoints_m.is_empty()
    {
        let every_ms = u64::try_from(every.0.as_millis())
            .unwrap_or(u64::MAX)
            .max(1);
        let mut waypoints = mission.waypoints_m.clone();
        let times = (1..).map(|count| count * every_ms);
        for at in times.take_while(|at| *at < end_ms) {
            waypoints.rotate_left(1);
            mission.step.push(step(at, again(&waypoints)));
        }
    }
    let percent = profile.mission.by_hand_percent;
    if percent > 0
        && dice.below(100) < percent
        && let Some(turn) = targets.turn()
    {
        let [least, most] = BY_HAND_MS;
        let at = dice.between(2_000, end_ms.max(2_000 + most) - most);
        let side = [turn.to_vec(), turn.iter().rev().copied().collect()];
        let side = side[dice.index(2)].clone();
        mission.step.push(step(at, Action::Drive(side)));
        let waypoints = again(&mission.waypoints_m);
        mission
            .step
            .push(step(at + dice.between(least, most), waypoints));
    }
    mission.step.sort_by_key(|step| step.at);
}

fn step(at: u64, action: Action) -> Step {
    Step::at(Span::from_millis(at), action)
}
