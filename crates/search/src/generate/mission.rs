use super::Profile;
use super::dice::Draw;
use super::fault_targets::FaultTargets;
use engine::robots::{self, Robot};
use engine::scenario::{Action, Mission, Scenario, Span, Step};

/// Whether the waypoints must stay: steps lead the robot by modes or by hand, or the robot takes no
/// orders. With other waypoints the mission would be impossible.
pub(super) fn is_fixed(scenario: &Scenario) -> bool {
    let leads = |step: &Step| matches!(step.action, Action::Mode(_) | Action::Drive(_));
    !takes_orders(scenario) || scenario.mission.step.iter().any(leads)
}

/// Whether a PC can disconnect, or repeat an order.
pub(super) fn takes_orders(scenario: &Scenario) -> bool {
    robots::find(&scenario.robot).is_none_or(Robot::takes_orders)
}

/// Some of `places`, in random order.
pub(super) fn waypoints(mut places: Vec<[f64; 2]>, dice: &mut Draw) -> Vec<[f64; 2]> {
    let count = dice.between(1, 3).min(places.len() as u64);
    (0..count)
        .map(|_| places.remove(dice.index(places.len())))
        .collect()
}

/// Further actions of the PC before `until_ms`: it repeats the mission, or disconnects for a while.
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

/// The last steps of a mission: an operator tries again after the last fault. The operator opens
/// the port again, and sends waypoints again that the robot did not confirm. Some time later the
/// mission is ordered once more if it is not finished, because the robot mistook its pose or
/// returned with a low battery.
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

/// Orders that keep a manually driven robot moving: its first motion order repeatedly, every second
/// time backwards. The first set-point is the speed, unless the robot `turns_on_the_spot`: then
/// each wheel has a set-point.
pub(super) fn keep_steering(
    profile: &Profile,
    turns_on_the_spot: bool,
    mission: &mut Mission,
    end: Span,
) {
    let is_mode = |step: &Step| matches!(step.action, Action::Mode(_));
    if mission.step.iter().any(is_mode) {
        return;
    }
    let mut drives = mission.step.iter().filter_map(|step| match &step.action {
        Action::Drive(drive) if drive.iter().any(|speed| speed.0 != 0.0) => Some(drive.clone()),
        _ => None,
    });
    let (Some(first), Some(every)) = (drives.next(), profile.mission.repeat) else {
        return;
    };
    let mut drive = first;
    let speeds = if turns_on_the_spot { drive.len() } else { 1 };
    let mut at = every.0;
    while at < end.0 {
        for speed in drive.iter_mut().take(speeds) {
            speed.0 = -speed.0;
        }
        mission
            .step
            .push(Step::at(Span(at), Action::Drive(drive.clone())));
        at += every.0;
    }
    sort(&mut mission.step);
}

/// Sorts by time. A step with a condition stays behind its predecessor.
pub(super) fn sort(steps: &mut Vec<Step>) {
    let mut last = None;
    let keyed = steps.drain(..).map(|step| {
        last = step.at.or(last);
        (last, step)
    });
    let mut keyed: Vec<(Option<Span>, Step)> = keyed.collect();
    keyed.sort_by_key(|(at, _)| *at);
    steps.extend(keyed.into_iter().map(|(_, step)| step));
}

/// Earliest turn by hand, milliseconds: the robot has its first scans then.
const BY_HAND_FROM_MS: u64 = 6_000;
/// Duration for which the operator turns the robot by hand.
const BY_HAND_MS: [u64; 2] = [3_000, 9_000];

/// In half of these turns the station disconnects this time after the order to turn, and connects
/// again this time before the next order. The robot must end its turn.
const GONE_MS: u64 = 400;
const BACK_MS: u64 = 100;

/// Orders that keep the robot moving in the whole run: its waypoints repeatedly, and turns by hand.
/// A turn on the spot hits no wall.
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
        let at = dice.between(BY_HAND_FROM_MS, end_ms.max(BY_HAND_FROM_MS + most) - most);
        let side = [turn.to_vec(), turn.iter().rev().copied().collect()];
        let side = side[dice.index(2)].clone();
        mission.step.push(step(at, Action::Drive(side)));
        let waypoints = again(&mission.waypoints_m);
        let then = at + dice.between(least, most);
        if at.is_multiple_of(2) {
            let gone = step(at + GONE_MS, Action::Disconnect);
            mission
                .step
                .extend([gone, step(then - BACK_MS, Action::Connect)]);
        }
        mission.step.push(step(then, waypoints));
    }
    sort(&mut mission.step);
}

pub(super) fn step(at: u64, action: Action) -> Step {
    Step::at(Span::from_millis(at), action)
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::scenario::{Condition, SetPoint};

    /// The step with a condition waits for the step at 3 s, not for the start of the run.
    #[test]
    fn a_step_with_a_condition_stays_behind_its_predecessor() {
        let mut waits = step(0, Action::Connect);
        (waits.at, waits.when) = (None, Some(Condition::Visited(1)));
        let mut steps = vec![
            step(1, Action::Disconnect),
            step(3, Action::Disconnect),
            waits,
            step(9, Action::Disconnect),
            step(2, Action::Disconnect),
        ];
        sort(&mut steps);
        let times: Vec<_> = steps.iter().map(|step| step.at).collect();
        let ms = |at| Some(Span::from_millis(at));
        assert_eq!(times, [ms(1), ms(2), ms(3), None, ms(9)]);
    }

    /// A car drives back with the same steering, a robot with two wheels reverses both. An order to
    /// stop is not repeated, and a robot that a mode leads is not driven by hand.
    #[test]
    fn by_hand_drives_go_on_back_and_forth() {
        let harsh = Profile::find("harsh").expect("it is built in");
        let driven = |turns, actions: &[Action]| {
            let mut mission = Mission::default();
            let steps = actions.iter().cloned();
            let steps = steps.map(|action| Step::at(Span::from_millis(1_000), action));
            mission.step = steps.collect();
            keep_steering(&harsh, turns, &mut mission, Span::from_millis(30_000));
            let added = mission.step.split_off(actions.len()).into_iter();
            added.map(|step| step.action).collect::<Vec<_>>()
        };
        let drive = |speeds: [f64; 2]| Action::Drive(speeds.map(SetPoint).to_vec());
        let orders = [drive([0.0, 0.0]), drive([10.0, 4.0])];
        let back_and_forth = |back| vec![drive(back), drive([10.0, 4.0])];
        assert_eq!(driven(false, &orders), back_and_forth([-10.0, 4.0]));
        assert_eq!(driven(true, &orders), back_and_forth([-10.0, -4.0]));
        assert_eq!(driven(true, &orders[..1]), []);
        let led = [orders[1].clone(), Action::Mode("explore".to_owned())];
        assert_eq!(driven(true, &led), []);
    }
}
