//! Causes in the robot's motion: the robot turns or drives in the wrong direction, turns too far,
//! or never stops.

use core::f64::consts::{PI, TAU};
use core::time::Duration;

use emulators::world::{Point, Pose};
use protocols::Instant;

use super::trigger::around;
use super::{Cause, Evidence, weight};
use engine::run::Outcome;
use engine::run::check::Status;

/// Time within which a missing command affects the motion.
const NEXT: Duration = Duration::from_secs(1);
/// Time after the start in which a fault prevents the first motion.
const FIRST: Duration = Duration::from_secs(5);

/// Minimum turn that counts, and minimum bearing of a goal to the side, radians.
const TURN: f64 = 0.35;
/// Minimum distance that counts, metres.
const WAY: f64 = 0.05;

/// An error of the motion, and the time in which it arose.
struct Error {
    text: String,
    time: [Instant; 2],
}

impl Error {
    fn at(at: Instant, text: String) -> Self {
        let time = [at, at + NEXT];
        Self { text, time }
    }
}

pub(super) fn causes(evidence: &Evidence<'_>) -> Vec<Cause> {
    let outcome = evidence.outcome;
    let is_about = |name: &str| {
        let names = [
            "waypoints-visited",
            "returned",
            "settled",
            "no-collision-at-speed",
        ];
        names.contains(&name)
    };
    let mut failed = outcome.checks.iter();
    if !failed.any(|check| check.status == Status::Fail && is_about(&check.name)) {
        return Vec::new();
    }
    // An event after a collision does not explain it.
    let is_first = |error: &Error| outcome.collided_at.is_none_or(|at| error.time[0] < at);
    let mut causes = Vec::new();
    let cause = |weight| {
        move |Error { text, time }: Error| Cause::new(weight, text + &around(evidence, time))
    };
    if let Some(goal) = next_goal(outcome) {
        let error = towards(&goal, encoders(outcome).as_deref());
        causes.extend(error.filter(is_first).map(cause(weight::MOTION)));
    } else {
        let error = goes_on(outcome);
        causes.extend(error.filter(is_first).map(cause(weight::MOTION)));
    }
    let collision = outcome.collided_at.map(|at| Error {
        text: format!("the robot drove into something at {at} s and was not stopped before that"),
        time: [at, at],
    });
    causes.extend(collision.map(cause(weight::COLLISION)));
    causes
}

/// The waypoint that was not reached, and the path since the previous one.
struct Goal {
    number: usize,
    place: Point,
    way: Vec<(Instant, Pose)>,
}

fn next_goal(outcome: &Outcome) -> Option<Goal> {
    let [visited, _] = outcome.waypoints;
    let mission = &outcome.case.mission;
    if mission.any_order {
        return None;
    }
    let place = |&[x, y]: &[f64; 2]| Point::new(x, y);
    let goal = mission.waypoints_m.get(visited).map(place)?;
    let within = outcome.case.expect.visit_within_mm.unwrap_or(200.0) / 1000.0;
    let mut way = &outcome.truth[..];
    for before in mission.waypoints_m.iter().take(visited).map(place) {
        let is_near = |(_, pose): &(Instant, Pose)| pose.point().distance(before) <= within;
        way = &way[way.iter().position(is_near).unwrap_or(0)..];
    }
    Some(Goal {
        number: visited + 1,
        place: goal,
        way: way.to_vec(),
    })
}

/// `angle` wrapped to the range -pi to pi.
fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

/// Bearing of `place` from `pose`, radians counter-clockwise from ahead.
fn bearing(pose: Pose, place: Point) -> f64 {
    let to = libm::atan2(place.y - pose.y, place.x - pose.x);
    wrapped(to - pose.theta)
}

/// The error of a path that did not lead to its goal.
fn towards(goal: &Goal, encoders: Option<&str>) -> Option<Error> {
    let (number, place) = (goal.number, goal.place);
    let (first, last) = (goal.way.first()?, goal.way.last()?);
    let pairs = goal.way.windows(2);
    let length: f64 = pairs
        .map(|pair| pair[0].1.point().distance(pair[1].1.point()))
        .sum();
    let turned = turns(&goal.way);
    let all: f64 = turned.last().copied().unwrap_or_default();
    if length < WAY && all.abs() < TURN {
        let text = format!(
            "the robot never moved from ({:.2}, {:.2}) m: no command that drives a motor reached \
             its devices",
            first.1.x, first.1.y
        );
        let time = [first.0, first.0 + FIRST];
        return Some(Error { text, time });
    }
    if let Some(turn) = first_turn(&goal.way, &turned)
        && let Some(text) = wrong_turn(goal, &turn, encoders)
    {
        let time = [turn.at, turn.until];
        return Some(Error { text, time });
    }
    if let Some(at) = drives_back(&goal.way, place) {
        let text = format!(
            "the robot drove backwards, away from waypoint {number}, from {at} s on: the sign of \
             its speed is wrong"
        );
        return Some(Error::at(at, text));
    }
    let distance = |(_, pose): &(Instant, Pose)| pose.point().distance(place);
    let nearest = goal
        .way
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    let (near, end) = (distance(nearest), distance(last));
    if near < distance(first) / 2.0 && end > near + 2.0 * WAY {
        let text = format!(
            "the robot was {:.0} mm from waypoint {number} at {} s and kept driving: it stops \
             too late, or never",
            near * 1000.0,
            nearest.0
        );
        return Some(Error::at(nearest.0, text));
    }
    let still = goal
        .way
        .iter()
        .rev()
        .take_while(|(_, pose)| pose.point().distance(last.1.point()) < 0.01);
    let since = still.last()?.0;
    let text = format!(
        "the robot stands {:.0} mm from waypoint {number} since {since} s: the program does not \
         drive it any further",
        end * 1000.0
    );
    Some(Error::at(since, text))
}

/// The error of a turn that does not lead to its goal.
fn wrong_turn(goal: &Goal, turn: &Turn, encoders: Option<&str>) -> Option<String> {
    let number = goal.number;
    let degrees = |angle: f64| angle.to_degrees().round();
    let side = |angle: f64| if angle > 0.0 { "left" } else { "right" };
    let needed = bearing(turn.from, goal.place);
    let (at, done) = (turn.at, turn.angle);
    if needed.abs() > TURN && needed.abs() < PI - TURN && needed * done < 0.0 {
        return Some(format!(
            "the robot turned {} by {:.0} degrees from {at} s on, and waypoint {number} lay {:.0} \
             degrees to its {}: left and right wheel are swapped, or the turn has the wrong sign",
            side(done),
            degrees(done.abs()),
            degrees(needed.abs()),
            side(needed)
        ));
    }
    let beyond = done.abs() - needed.abs();
    if beyond.abs() > TURN && (needed.abs() > TURN || done.abs() > PI) {
        let much = if beyond > 0.0 {
            "too far"
        } else {
            "too little"
        };
        let read = encoders.map_or_else(String::new, |names| {
            format!(
                ", or it reads its encoders ({names}) in another width, sign, byte order or \
                 unit than they have"
            )
        });
        return Some(format!(
            "the robot turned {much}: {:.0} degrees to the {} from {at} s on, where {:.0} lead \
             to waypoint {number}: it does not see how far it has turned{read}",
            degrees(done.abs()),
            side(done),
            degrees(needed.abs())
        ));
    }
    None
}

/// Turned angle since the start of a path, at each of its points.
fn turns(way: &[(Instant, Pose)]) -> Vec<f64> {
    let mut sum = 0.0;
    let steps = way
        .windows(2)
        .map(|pair| wrapped(pair[1].1.theta - pair[0].1.theta));
    let sums = steps.map(|step| {
        sum += step;
        sum
    });
    core::iter::once(0.0).chain(sums).collect()
}

/// A turn to one side.
struct Turn {
    at: Instant,
    until: Instant,
    from: Pose,
    angle: f64,
}

/// Angle between two observations, some 50 ms apart, below which the robot does not turn.
const STILL: f64 = 0.004;

/// The first turn that counts; pauses within it are part of it.
fn first_turn(way: &[(Instant, Pose)], turned: &[f64]) -> Option<Turn> {
    let is_turning = |index: usize| (turned[index + 1] - turned[index]).abs() > STILL;
    let first = (0..way.len().saturating_sub(1)).find(|&index| is_turning(index))?;
    let (mut begin, mut farthest) = (first, first);
    for index in first..turned.len() {
        let (done, most) = (
            turned[index] - turned[begin],
            turned[farthest] - turned[begin],
        );
        if done.abs() > most.abs() && (done * most >= 0.0 || most.abs() < TURN) {
            farthest = index;
        } else if (done - most).abs() > TURN {
            break;
        } else if most.abs() < TURN && done.abs() < STILL {
            // The robot only swayed; the turn that counts begins later.
            (begin, farthest) = (index, index);
        } else if most.abs() >= TURN && moved_on(way, farthest, index) {
            break;
        }
    }
    let angle = turned[farthest] - turned[begin];
    (angle.abs() >= TURN).then(|| Turn {
        at: way[begin].0,
        until: way[farthest].0,
        from: way[begin].1,
        angle,
    })
}

/// Whether the robot has moved since the point `from` of its path.
fn moved_on(way: &[(Instant, Pose)], from: usize, now: usize) -> bool {
    way[from].1.point().distance(way[now].1.point()) > 2.0 * WAY
}

/// Time since which the robot drives backwards although its goal is ahead.
fn drives_back(way: &[(Instant, Pose)], place: Point) -> Option<Instant> {
    let (at, start) = *way.first()?;
    let moved = way
        .iter()
        .find(|(_, pose)| pose.point().distance(start.point()) > WAY)?;
    let ahead = bearing(start, moved.1.point());
    (ahead.abs() > PI * 0.75 && bearing(start, place).abs() < PI / 2.0).then_some(at)
}

/// The error after all waypoints were visited.
fn goes_on(outcome: &Outcome) -> Option<Error> {
    let last = outcome.truth.last()?;
    let goal = outcome.case.mission.waypoints_m.last()?;
    let goal = Point::new(goal[0], goal[1]);
    let is_told = outcome.axes.iter().any(|axis| axis.set_point != 0.0);
    let far = last.1.point().distance(goal) * 1000.0;
    is_told.then(|| Error {
        text: format!(
            "the robot never stops: after its last waypoint its motors still run at the end, \
             {far:.0} mm from this waypoint"
        ),
        time: [last.0; 2],
    })
}

/// Names of values of the scenario's own slaves that come from encoders.
fn encoders(outcome: &Outcome) -> Option<String> {
    use engine::scenario::{RegistersSpec, SourceSpec, TextSpec};
    let is_encoder = |source: &SourceSpec| {
        matches!(
            source,
            SourceSpec::Encoder(_) | SourceSpec::EncoderLeft | SourceSpec::EncoderRight
        )
    };
    let mut names = Vec::new();
    for spec in outcome.case.device.values() {
        let registers = spec.settings::<RegistersSpec>().into_iter();
        let registers = registers.flat_map(|spec| &spec.register);
        for register in registers.map(toml::Spanned::get_ref) {
            if is_encoder(&register.source) {
                let width = format!("{:?}", register.width).to_lowercase();
                names.push(format!("{}: {width}, low byte first", register.name));
            }
        }
        let variables = spec.settings::<TextSpec>().into_iter();
        let variables = variables.flat_map(|spec| &spec.variable);
        let variables = variables.map(toml::Spanned::get_ref);
        let those = variables.filter(|variable| is_encoder(&variable.source));
        names.extend(those.map(|variable| variable.name.clone()));
    }
    (!names.is_empty()).then(|| names.join(", "))
}
