//! Driving to a pose in three steps: turn towards it, drive there, turn to its heading.
//!
//! ```text
//! TURN --looks there--> DRIVE --is there--> ALIGN --looks as told--> SETTLE --still does--> done
//! ```
//!
//! Gains and tolerance: public code of the robot. Its step 2 could not go back; here a goal that is
//! suddenly aside, as after a corrected pose, is turned to again. It ended in the moment in which
//! it looked as told, also when it swept past; here it has to stand.

use super::motion::Velocity;
use crate::pose::{Point, Pose, normalised};

/// Distance, in metres, and angle at which the robot is there.
const TOLERANCE: f32 = 0.02;
/// How far the heading may be off when the robot stands: braking takes it a little farther.
const SETTLED_RAD: f32 = 0.015;
/// Turning speed per angle.
const TURN_GAIN: f32 = 10.0;
const STEER_GAIN: f32 = 8.0;
const TURN_MAX_RAD_S: f32 = 4.0;
/// Slower the robot does not turn before it looks as told.
const TURN_MIN_RAD_S: f32 = 0.5;
/// Speed per distance, and the highest.
const SPEED_GAIN: f32 = 2.0;
const SPEED_MAX_M_S: f32 = 0.5;
/// A goal farther aside than this is not driven to.
const ASIDE_RAD: f32 = 0.5;

/// What the fielded program did wrong; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The last turn may go the long way round.
    pub turns_the_long_way: bool,
    /// A new goal on the way is begun in the step of the old one.
    pub keeps_the_step: bool,
}

impl Defects {
    /// None.
    pub const NONE: Self = Self {
        turns_the_long_way: false,
        keeps_the_step: false,
    };
}

/// Where to go.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Goal {
    pub(super) position: Point,
    /// `None`: any.
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

    /// A goal, perhaps on the way to another one.
    pub(super) const fn set_goal(&mut self, goal: Goal) {
        self.goal = goal;
        if !self.defects.keeps_the_step {
            self.step = Step::Turn;
        }
    }

    /// The manoeuvre begins.
    pub(super) const fn begin(&mut self) {
        self.step = Step::Turn;
    }

    /// How to move from `pose`, which does not change where `is_at_rest`; `None`: the robot is
    /// there.
    pub(super) fn step(&mut self, pose: Pose, is_at_rest: bool) -> Option<Velocity> {
        let aim = Aim::new(pose, self.goal.position);
        // Each step may be done at once, in this order.
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

/// Where a position is, as the robot sees it.
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
