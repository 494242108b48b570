//! Driving from point to point, each the goal of one manoeuvre of the robot.

use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::time::Duration;

use protocols::Instant;
use protocols::telemetry::message::{ANY_HEADING, Pose as WirePose, State, Telecommand};

use super::Failure;
use super::config::Following;
use super::link::{Kind, Link};
use crate::pose::{Point, Pose, normalised};

/// Interval of the checks of the robot, as in the fielded program.
const POLL: Duration = Duration::from_millis(500);
/// Tolerance per axis of a robot that rests at its goal, mm, as in the fielded program.
const ARRIVED_MM: f32 = 50.0;
/// Tolerance of the heading, if one was requested: twice the robot's own.
const ARRIVED_RAD: f32 = 0.06;
/// Number of checks of a robot that rests elsewhere before the goal is sent again.
const POLLS_RESTING: u32 = 3;
/// Checks of a robot that drives without progress: 10 s.
const POLLS_STUCK: u32 = 20;
/// Minimum motion, as in the fielded program.
const MOVED_MM: f32 = 10.0;
const MOVED_RAD: f32 = 0.05;
/// Maximum number of times that a goal is sent again.
const RESENDS_MAX: u32 = 5;
/// Distance, mm, after which the robot must head for its goal, unless the goal is nearer than the
/// second figure. The robot steers by the goal's bearing: an error of a third of a radian means
/// another goal.
const ON_ITS_WAY_MM: f32 = 50.0;
const BESIDE_MM: f32 = 250.0;
const ASTRAY_RAD: f32 = 0.33;

/// Position of the goal, and the heading there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    pub(super) place: Point,
    pub(super) heading: Option<f32>,
}

impl Goal {
    /// A goal to pass at `place`, with any heading.
    pub(super) const fn passed(place: Point) -> Self {
        Self {
            place,
            heading: None,
        }
    }

    /// Whether `pose` is within these limits, including its heading if one was requested.
    pub(super) fn is_near(self, pose: Pose, most_mm: f32, most_rad: f32) -> bool {
        let is_near = |one: f32, other: f32| (one - other).abs() < most_mm;
        let looks = |heading: f32| normalised(pose.heading - heading).abs() < most_rad;
        is_near(pose.x_mm, self.place.x_mm)
            && is_near(pose.y_mm, self.place.y_mm)
            && self.heading.is_none_or(looks)
    }
}

/// Distance between two looks around, mm. On a floor on which a wheel errs by 2 mm a metre the
/// robot's middle is then 7 mm beside the path, and seldom 20.
const STRETCH_MM: f32 = 800.0;
/// Maximum rest of a path that is added to the last stretch.
const REST_MM: f32 = 250.0;

/// The part of a path up to the next look.
#[derive(Clone, Debug)]
pub(super) struct Stretch {
    pub(super) drive: Drive,
    /// Whether the stretch ends where the path ends.
    pub(super) is_last: bool,
}

impl Stretch {
    /// A stretch of all of `way`.
    pub(super) fn whole(
        following: Following,
        way: &mut VecDeque<Point>,
        heading: Option<f32>,
    ) -> Self {
        let mut goals: Vec<Goal> = way.drain(..).map(Goal::passed).collect();
        if let Some(last) = goals.last_mut() {
            last.heading = heading;
        }
        Self {
            drive: Drive::new(following, goals),
            is_last: true,
        }
    }

    /// Takes the first stretch of `way`, which begins at `from`; the rest stays in `way`.
    pub(super) fn cut(
        following: Following,
        from: Point,
        way: &mut VecDeque<Point>,
        heading: Option<f32>,
    ) -> Self {
        let (mut at, mut left_mm) = (from, STRETCH_MM);
        let mut first = VecDeque::new();
        while let Some(place) = way.pop_front() {
            let leg_mm = at.distance_mm(place);
            let rest_mm = leg_mm - left_mm;
            if rest_mm > REST_MM || rest_mm > 0.0 && !way.is_empty() {
                let part = left_mm / leg_mm;
                let between = |from: f32, to: f32| from + part * (to - from);
                first.push_back(Point::new(
                    between(at.x_mm, place.x_mm),
                    between(at.y_mm, place.y_mm),
                ));
                way.push_front(place);
                break;
            }
            first.push_back(place);
            (at, left_mm) = (place, left_mm - leg_mm);
        }
        let is_last = way.is_empty();
        let whole = Self::whole(following, &mut first, heading.filter(|_| is_last));
        Self { is_last, ..whole }
    }
}

/// Progress of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    Driving,
    /// The robot rests at the last goal.
    Arrived,
    /// The robot drove, and rests elsewhere: its odometry failed.
    Interrupted,
}

/// A path being driven.
#[derive(Clone, Debug)]
pub(super) struct Drive {
    following: Following,
    goals: VecDeque<Goal>,
    /// Tolerance at the goal, mm and radians.
    within: (f32, f32),
    sent: Option<Sent>,
}

/// The goal that was sent to the robot.
#[derive(Clone, Copy, Debug)]
struct Sent {
    next_poll: Instant,
    /// The last message that was checked.
    number: u64,
    /// The robot's pose when the goal was sent.
    told_at: Pose,
    /// Pose at which the robot was last known to move.
    from: Pose,
    /// Whether the robot was seen to obey.
    drove: bool,
    resting: u32,
    stuck: u32,
    resends: u32,
}

impl Drive {
    pub(super) fn new(following: Following, goals: impl IntoIterator<Item = Goal>) -> Self {
        Self {
            following,
            goals: goals.into_iter().collect(),
            within: (ARRIVED_MM, ARRIVED_RAD),
            sent: None,
        }
    }

    /// Reduces the tolerance: a robot that is nearly there must move first.
    pub(super) const fn nearer(&mut self, within_mm: f32, within_rad: f32) {
        self.within = (within_mm, within_rad);
    }

    /// Whether the robot has arrived at the last goal.
    pub(super) fn step(&mut self, now: Instant, link: &mut Link) -> Result<Progress, Failure> {
        let Some(goal) = self.goals.front().copied() else {
            return Ok(Progress::Arrived);
        };
        let Some((number, state, pose)) = link
            .heard()
            .and_then(|heard| Some((heard.number, heard.state()?, heard.pose()?)))
        else {
            return Ok(Progress::Driving);
        };
        let Some(sent) = &mut self.sent else {
            self.sent = Some(Sent::new(now, number, pose));
            tell(now, link, goal);
            return Ok(Progress::Driving);
        };
        // All messages that the robot sends while it drives may be lost.
        let obeys = state == State::AutoPosition || sent.has_moved(pose);
        sent.drove |= number > sent.number && obeys;
        // A sum does not detect two exchanged bytes, so an order may arrive changed.
        let is_watched = self.following == Following::Rested && state == State::AutoPosition;
        if is_watched && sent.is_astray(pose, goal) {
            sent.told_at = pose;
            link.counts.resends += 1;
            tell(now, link, goal);
        }
        if now < sent.next_poll || number == sent.number {
            return Ok(Progress::Driving);
        }
        sent.next_poll = now + POLL;
        sent.number = number;
        if state == State::Off && goal.is_near(pose, self.within.0, self.within.1) {
            self.goals.pop_front();
            self.sent = None;
            return self.step(now, link);
        }
        let again = match self.following {
            Following::Rested => sent.is_off(state, pose),
            Following::Moved => sent.is_unmoved(pose),
        };
        if again {
            if self.following == Following::Rested && sent.resends == RESENDS_MAX {
                return Err(Failure::NoAnswer);
            }
            // The state is Off, or on the way to it, which takes half a second.
            let has_ended = sent.drove && state != State::AutoPosition;
            if self.following == Following::Rested && has_ended {
                return Ok(Progress::Interrupted);
            }
            sent.resends += 1;
            link.counts.resends += 1;
            tell(now, link, goal);
        }
        Ok(Progress::Driving)
    }
}

impl Sent {
    fn new(now: Instant, number: u64, from: Pose) -> Self {
        Self {
            next_poll: now + POLL,
            number,
            told_at: from,
            from,
            drove: false,
            resting: 0,
            stuck: 0,
            resends: 0,
        }
    }

    /// Whether the robot has left the pose at which it was last known to move.
    fn has_moved(&self, pose: Pose) -> bool {
        let turned = normalised(pose.heading - self.from.heading).abs();
        pose.position().distance_mm(self.from.position()) > MOVED_MM || turned > MOVED_RAD
    }

    /// Whether the robot drives in a wrong direction.
    fn is_astray(&self, pose: Pose, goal: Goal) -> bool {
        let at = pose.position();
        let (dx, dy) = (goal.place.x_mm - at.x_mm, goal.place.y_mm - at.y_mm);
        at.distance_mm(self.told_at.position()) > ON_ITS_WAY_MM
            && at.distance_mm(goal.place) > BESIDE_MM
            && normalised(libm::atan2f(dy, dx) - pose.heading).abs() > ASTRAY_RAD
    }

    /// Whether the robot rests, or drives without progress.
    fn is_off(&mut self, state: State, pose: Pose) -> bool {
        if self.has_moved(pose) {
            self.from = pose;
            self.stuck = 0;
        }
        self.stuck += 1;
        match state {
            State::AutoPosition => self.resting = 0,
            _ => self.resting += 1,
        }
        let again = self.resting >= POLLS_RESTING || self.stuck >= POLLS_STUCK;
        if again {
            (self.resting, self.stuck) = (0, 0);
        }
        again
    }

    /// The fielded rule.
    fn is_unmoved(&mut self, pose: Pose) -> bool {
        self.resting += 1;
        let moved = pose.position().distance_mm(self.from.position());
        let again = self.resting >= POLLS_RESTING && moved < MOVED_MM;
        if again {
            self.resting = 0;
        }
        again
    }
}

fn tell(now: Instant, link: &mut Link, goal: Goal) {
    let desired = WirePose {
        x: goal.place.x_mm / 1_000.0,
        y: goal.place.y_mm / 1_000.0,
        alpha: goal.heading.unwrap_or(ANY_HEADING),
    };
    let command = Telecommand {
        state: Some(State::AutoPosition),
        desired_pose: Some(desired),
        ..Telecommand::default()
    };
    link.send(now, Kind::Drive, command);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(from: Point, way: &mut VecDeque<Point>) -> (Vec<Point>, bool) {
        let stretch = Stretch::cut(Following::Rested, from, way, Some(1.0));
        let goals = &stretch.drive.goals;
        let headings: Vec<_> = goals.iter().filter_map(|goal| goal.heading).collect();
        assert_eq!(headings, [1.0][..usize::from(stretch.is_last)]);
        (
            goals.iter().map(|goal| goal.place).collect(),
            stretch.is_last,
        )
    }

    /// By hand: 500 mm along x, and up; the first stretch ends 300 mm up, the second 800 mm
    /// farther, and the rest, 200 mm, is no stretch of its own.
    #[test]
    fn a_way_is_cut_after_800_mm() {
        let corner = Point::new(500.0, 0.0);
        let end = Point::new(500.0, 1_300.0);
        let mut way = VecDeque::from([corner, end]);
        let (first, is_last) = cut(Point::default(), &mut way);
        let look = Point::new(500.0, 300.0);
        assert_eq!((first, is_last), (alloc::vec![corner, look], false));
        assert_eq!(way, [end]);
        assert_eq!(cut(look, &mut way), (alloc::vec![end], true));
        assert_eq!(way, []);
        // 1051 mm are too much for one stretch.
        let far = Point::new(1_051.0, 0.0);
        let (first, is_last) = cut(Point::default(), &mut VecDeque::from([far]));
        assert_eq!(
            (first, is_last),
            (alloc::vec![Point::new(800.0, 0.0)], false)
        );
    }

    #[test]
    fn a_goal_is_near_in_both_axes_and_in_its_heading() {
        let mut goal = Goal::passed(Point::new(1_000.0, 0.0));
        let is_near = |goal: Goal, x, y| goal.is_near(Pose::new(x, y, 0.0), 50.0, 0.1);
        assert!(is_near(goal, 1_049.0, -49.0));
        assert!(!is_near(goal, 1_051.0, 0.0) && !is_near(goal, 1_000.0, -51.0));
        goal.heading = Some(-0.11);
        assert!(!is_near(goal, 1_000.0, 0.0));
    }

    fn sent() -> Sent {
        Sent::new(Instant::ZERO, 0, Pose::new(1_000.0, 0.0, 0.0))
    }

    fn at(x_mm: f32, heading: f32) -> Pose {
        Pose::new(x_mm, 0.0, heading)
    }

    /// A resting robot gets the goal again at the third check, then at the sixth. A robot that
    /// drives without progress of more than 10 mm or 0.05 rad gets it again at the twentieth check.
    #[test]
    fn a_robot_that_rests_or_does_not_get_on_is_told_again() {
        let mut resting = sent();
        let again = [0; 6].map(|_| resting.is_off(State::Off, at(1_000.0, 0.0)));
        assert_eq!(again, [false, false, true, false, false, true]);
        let told_at = |step_mm: f32, step_rad: f32| {
            let mut driving = sent();
            let looks = (0_u8..40).map(f32::from);
            let mut poses = looks.map(|look| at(1_000.0 + look * step_mm, look * step_rad));
            poses.position(|pose| driving.is_off(State::AutoPosition, pose))
        };
        assert_eq!(told_at(0.0, 0.0), Some(19));
        assert_eq!([told_at(10.1, 0.0), told_at(0.0, -0.051)], [None; 2]);
        // A robot that moves by 1 mm or 5 mrad a check makes progress at every 11th check.
        assert_eq!([told_at(1.0, 0.0), told_at(0.0, 0.005)], [None; 2]);
        assert_eq!(told_at(0.4, 0.0), Some(19));
        // A check of the driving robot restarts the count of a resting one.
        let mut both = sent();
        let states = [
            State::Off,
            State::Off,
            State::AutoPosition,
            State::Off,
            State::Off,
            State::Off,
        ];
        let again = states.map(|state| both.is_off(state, at(1_000.0, 0.0)));
        assert_eq!(again, [false, false, false, false, false, true]);
    }

    /// At 1 m the robot gets a goal 1 m to the left and starts 19.5 degrees, 0.34 rad, beside that
    /// direction. 51 mm later it gets the goal again, but not earlier and not near its goal.
    #[test]
    fn a_robot_that_drives_elsewhere_is_astray() {
        let goal = Goal::passed(Point::new(1_000.0, 1_000.0));
        let is_astray = |y_mm: f32, off_rad: f32| {
            let heading = core::f32::consts::FRAC_PI_2 + off_rad;
            sent().is_astray(Pose::new(1_000.0, y_mm, heading), goal)
        };
        assert!(is_astray(51.0, 0.34) && is_astray(51.0, -0.34) && is_astray(749.0, 0.34));
        assert!(!is_astray(49.0, 0.34) && !is_astray(51.0, 0.32) && !is_astray(751.0, 0.34));
        // Beyond the goal the robot heads away from it.
        assert!(is_astray(1_251.0, 0.0) && !is_astray(1_249.0, 0.0));
    }

    /// The robot got its goal while it rested at 1 m: more than 10 mm or 0.05 rad is a motion.
    #[test]
    fn a_robot_that_is_elsewhere_has_moved() {
        let has_moved = |x_mm: f32, turn_rad: f32| sent().has_moved(at(x_mm, turn_rad));
        assert!(!has_moved(1_000.0, 0.0) && !has_moved(1_009.0, 0.049));
        assert!(has_moved(1_011.0, 0.0) && has_moved(989.0, 0.0));
        assert!(has_moved(1_000.0, 0.051) && has_moved(1_000.0, -0.051));
    }

    /// The fielded rule counts checks, in any state of the robot, and requires 10 mm from the
    /// start.
    #[test]
    fn the_fielded_rule_tells_again_what_has_not_moved() {
        let told = |x_mm: f32| {
            let mut sent = sent();
            [0; 6].map(|_| sent.is_unmoved(at(x_mm, 0.0)))
        };
        let each_third = [false, false, true, false, false, true];
        assert_eq!([told(1_000.0), told(1_009.9)], [each_third; 2]);
        assert_eq!(told(1_010.0), [false; 6]);
        let mut sent = sent();
        (0..5).for_each(|_| assert!(!sent.is_unmoved(at(1_500.0, 0.0))));
        assert!(sent.is_unmoved(at(1_005.0, 0.0)));
    }
}
