use super::dice::Draw;
use super::{ADVERSITY_UNTIL_MS, RECOVERY_MS};
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

/// What the PC does besides sending the mission: it sends it once more, or hangs up for a while.
pub(super) fn steps(waypoints: &[[f64; 2]], dice: &mut Draw) -> Vec<Step> {
    let mut steps = Vec::new();
    for _ in 0..dice.below(4) {
        let at = dice.between(2_000, ADVERSITY_UNTIL_MS - 2_000);
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
pub(super) fn once_more(mission: &Mission) -> [Step; 3] {
    let mode = mission.step.iter().map(|step| &step.action);
    let mut mode = mode.filter(|action| matches!(action, Action::Mode(_)));
    let again = match mode.next() {
        Some(mode) if mission.waypoints_m.is_empty() => mode.clone(),
        _ => Action::WaypointsM(mission.waypoints_m.clone()),
    };
    [
        step(ADVERSITY_UNTIL_MS + 200, Action::Disconnect),
        step(ADVERSITY_UNTIL_MS + 500, Action::Connect),
        step(ADVERSITY_UNTIL_MS + RECOVERY_MS / 3, again),
    ]
}

fn step(at: u64, action: Action) -> Step {
    Step::at(Span::from_millis(at), action)
}
