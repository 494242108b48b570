//! Driving to a pose in three steps: turn towards it, drive there, turn to its heading.
//!
//! ```text
//! TURN --faces goal--> DRIVE --at goal--> ALIGN --at heading--> SETTLE --at rest--> done
//! ```
//!
//! Gains and tolerance: public code of the robot. Its step 2 could not return to step 1; here the
//! robot turns again if the goal is suddenly aside, for example after a corrected pose. Its step 3
//! ended as soon as the heading was right, even while the robot turned past it; here the robot has
//! to stand.

use super::motion::Velocity;
use crate::pose::{Point, Pose, normalised};

/// Tolerance at the goal: distance, in metres, and angle.
const TOLERANCE: f32 = 0.02;
/// Maximum heading error of the standing robot: braking adds a little.
const SETTLED_RAD: f32 = 0.015;
/// Turning speed per angle.
const TURN_GAIN: f32 = 10.0;
const STEER_GAIN: f32 = 8.0;
const TURN_MAX_RAD_S: f32 = 4.0;
/// Minimum turning speed until the heading is right.
const TURN_MIN_RAD_S: f32 = 0.5;
/// Speed per distance, and the maximum speed.
const SPEED_GAIN: f32 = 2.0;
const SPEED_MAX_M_S: f32 = 0.5;
/// Maximum bearing of a goal that the robot drives to.
const ASIDE_RAD: f32 = 0.5;

/// Enabled defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The last turn may take the longer direction.
    pub turns_the_long_way: bool,
    /// A new goal during a manoeuvre starts in the step of the old one.
    pub keeps_the_step: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        turns_the_long_way: false,
        keeps_the_step: false,
    };
}

/// The goal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Goal {
    pub(super) position: Point,
    /// `None`: any heading.
    pub(super) heading: Option<f32>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Turn,
    Drive,
    Align,
    Settle,
}

/// A manoeuvre.
#[derive(Clone, Debug)]
pub(super) struct Autoposition {
    defects: Defects,
    goal: Goal,
    step: Step,
}

impl Autoposition {
    pub(super) const fn new(defects: Defects) -> Self {
        Self {
            defects,
            goal: Goal {
                position: Point::new(0.0, 0.0),
                heading: None,
            },
            step: Step::Turn,
        }
    }

    /// Sets a goal, possibly during the drive to another one.
    pub(super) const fn set_goal(&mut self, goal: Goal) {
        self.goal = goal;
        if !self.defects.keeps_the_step {
            self.step = Step::Turn;
        }
    }

    /// Starts the manoeuvre.
    pub(super) const fn begin(&mut self) {
        self.step = Step::Turn;
    }

    /// The bearing of the goal from `pose`, radians to the left.
    pub(super) fn bearing(&self, pose: Pose) -> f32 {
        Aim::new(pose, self.goal.position).bearing
    }

    /// Velocity at `pose`, which does not change while the robot `is_at_rest`; `None`: the robot
    /// has arrived.
    pub(super) fn step(&mut self, pose: Pose, is_at_rest: bool) -> Option<Velocity> {
        let aim = Aim::new(pose, self.goal.position);
        // Steps may end at once, so check them in this order.
        if self.step == Step::Turn {
            if aim.distance_m < TOLERANCE {
                self.step = Step::Align;
            } else if aim.bearing.abs() < TOLERANCE {
                self.step = Step::Drive;
            } else {
                return Some(turn(TURN_GAIN * aim.bearing));
            }
        }
        if self.step == Step::Drive {
            if aim.distance_m > TOLERANCE {
                return Some(self.drive(&aim));
            }
            self.step = Step::Align;
        }
        self.align(pose.heading, is_at_rest)
    }

    fn drive(&mut self, aim: &Aim) -> Velocity {
        if aim.bearing.abs() > ASIDE_RAD && !self.defects.keeps_the_step {
            self.step = Step::Turn;
            return turn(TURN_GAIN * aim.bearing);
        }
        Velocity {
            linear_m_s: (SPEED_GAIN * aim.distance_m).min(SPEED_MAX_M_S),
            ..turn(STEER_GAIN * aim.bearing)
        }
    }

    fn align(&mut self, heading: f32, is_at_rest: bool) -> Option<Velocity> {
        let difference = self.goal.heading? - heading;
        let error = match self.defects.turns_the_long_way {
            true => difference,
            false => normalised(difference),
        };
        if self.step == Step::Settle && is_at_rest {
            if error.abs() < SETTLED_RAD {
                return None;
            }
            self.step = Step::Align;
        }
        if error.abs() < TOLERANCE / 2.0 {
            self.step = Step::Settle;
        }
        if self.step == Step::Settle {
            return Some(Velocity::ZERO);
        }
        let speed = (TURN_GAIN * error.abs()).max(TURN_MIN_RAD_S);
        Some(turn(speed.copysign(error)))
    }
}

/// Position relative to the robot.
struct Aim {
    distance_m: f32,
    /// To the left.
    bearing: f32,
}

impl Aim {
    fn new(pose: Pose, position: Point) -> Self {
        let (dx, dy) = (position.x_mm - pose.x_mm, position.y_mm - pose.y_mm);
        Self {
            distance_m: libm::hypotf(dx, dy) / 1_000.0,
            bearing: normalised(libm::atan2f(dy, dx) - pose.heading),
        }
    }
}

fn turn(rad_s: f32) -> Velocity {
    Velocity::new(0.0, rad_s.clamp(-TURN_MAX_RAD_S, TURN_MAX_RAD_S))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn goal(heading: Option<f32>) -> Goal {
        Goal {
            position: Point::new(1_000.0, 0.0),
            heading,
        }
    }

    fn moving(heading: Option<f32>, defects: Defects) -> Autoposition {
        let mut moves = Autoposition::new(defects);
        moves.set_goal(goal(heading));
        moves
    }

    fn is(found: Option<Velocity>, linear: f32, angular: f32) -> bool {
        found.is_some_and(|found| {
            (found.linear_m_s - linear).abs() < 1e-4 && (found.angular_rad_s - angular).abs() < 1e-4
        })
    }

    /// The robot turns at ten times the angle, at most 4 rad/s. From 0.02 rad on it drives at twice
    /// the distance, at most half a metre a second, and steers eight times the angle. At a bearing
    /// of half a radian it turns again.
    #[test]
    fn it_turns_towards_the_goal_and_drives_there() {
        let mut moves = moving(None, Defects::NONE);
        assert!(is(moves.step(Pose::new(0.0, 0.0, 0.3), true), 0.0, -3.0));
        assert!(is(moves.step(Pose::new(0.0, 0.0, -0.5), true), 0.0, 4.0));
        assert!(is(moves.step(Pose::new(0.0, 0.0, 0.021), true), 0.0, -0.21));
        assert!(is(
            moves.step(Pose::new(0.0, 0.0, 0.019), true),
            0.5,
            -0.152
        ));
        assert!(is(moves.step(Pose::new(900.0, 0.0, -0.1), true), 0.2, 0.8));
        assert!(is(
            moves.step(Pose::new(900.0, 0.0, 0.49), false),
            0.2,
            -3.92
        ));
        assert!(is(
            moves.step(Pose::new(900.0, 0.0, 0.51), false),
            0.0,
            -4.0
        ));
        assert!(is(
            moves.step(Pose::new(900.0, 0.0, 0.03), false),
            0.0,
            -0.3
        ));
        assert_eq!(moves.step(Pose::new(981.0, 0.0, 0.0), true), None);
    }

    /// At the goal the robot turns to its heading, at half a radian a second or more, until a
    /// hundredth is left. Then it stands. It has arrived once it is at rest within 0.015 rad.
    #[test]
    fn it_settles_as_it_was_told_to_look() {
        let mut moves = moving(Some(1.0), Defects::NONE);
        let here = |heading| Pose::new(1_010.0, 0.0, heading);
        assert!(is(moves.step(here(0.7), false), 0.0, 3.0));
        assert!(is(moves.step(here(0.98), false), 0.0, 0.5));
        assert!(is(moves.step(here(1.011), false), 0.0, -0.5));
        assert!(is(moves.step(here(0.991), false), 0.0, 0.0));
        assert!(is(moves.step(here(1.2), false), 0.0, 0.0));
        assert!(is(moves.step(here(1.016), true), 0.0, -0.5));
        assert!(is(moves.step(here(1.009), false), 0.0, 0.0));
        assert_eq!(moves.step(here(1.014), true), None);
    }

    /// The turn from -3 to 3 rad is 0.283 rad in the shorter direction, and 6 rad in the other.
    #[test]
    fn the_last_turn_may_go_the_long_way() {
        let turned = |turns_the_long_way| {
            let defects = Defects {
                turns_the_long_way,
                ..Defects::NONE
            };
            moving(Some(3.0), defects).step(Pose::new(1_000.0, 0.0, -3.0), false)
        };
        assert!(is(turned(false), 0.0, -2.831_85) && is(turned(true), 0.0, 4.0));
    }

    /// The robot first turns to a new goal, unless the step is kept: then it steers for the goal.
    #[test]
    fn another_goal_begins_with_a_turn() {
        let next = |keeps_the_step, begins: bool| {
            let defects = Defects {
                keeps_the_step,
                ..Defects::NONE
            };
            let mut moves = moving(None, defects);
            moves.step(Pose::new(0.0, 0.0, 0.0), true);
            moves.set_goal(Goal {
                position: Point::new(0.0, 1_000.0),
                heading: None,
            });
            if begins {
                moves.begin();
            }
            moves.step(Pose::new(0.0, 0.0, 1.2), true)
        };
        assert!(is(next(false, false), 0.0, 3.707_96) && is(next(true, true), 0.0, 3.707_96));
        assert!(is(next(true, false), 0.5, 2.966_37));
    }

    /// At the limits: with a hundredth left it still turns, with 0.015 rad left it has not arrived
    /// yet.
    #[test]
    fn the_limits_themselves_are_still_too_far() {
        let mut moves = moving(Some(0.01), Defects::NONE);
        let here = |heading| Pose::new(1_000.0, 0.0, heading);
        assert!(is(moves.step(here(0.0), false), 0.0, 0.5));
        assert!(is(moves.step(here(0.001), false), 0.0, 0.0));
        moves.goal.heading = Some(0.015);
        assert!(is(moves.step(here(0.0), true), 0.0, 0.5));
        assert!(is(moves.step(here(0.01), false), 0.0, 0.0));
        assert_eq!(moves.step(here(0.000_1), true), None);
    }
}
