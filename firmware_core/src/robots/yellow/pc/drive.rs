//! Driving from place to place, each the goal of one drive of the robot's own.

use alloc::collections::VecDeque;
use core::time::Duration;

use protocols::Instant;
use protocols::telemetry::message::{ANY_HEADING, Pose as WirePose, State, Telecommand};

use super::Failure;
use super::config::Following;
use super::link::{Kind, Link};
use crate::pose::{Point, Pose, normalised};

/// How often the robot is looked at: the fielded program.
const POLL: Duration = Duration::from_millis(500);
/// The robot is there if it rests and is nowhere farther off, mm: the fielded program.
const ARRIVED_MM: f32 = 50.0;
/// And looks so, if that was asked for: twice what the robot allows itself.
const ARRIVED_RAD: f32 = 0.06;
/// Looks at a robot that rests elsewhere before it is told again.
const POLLS_RESTING: u32 = 3;
/// Looks at a robot that drives but does not get on: 10 s.
const POLLS_STUCK: u32 = 20;
/// Less than this is no motion: the fielded program.
const MOVED_MM: f32 = 10.0;
const MOVED_RAD: f32 = 0.05;
/// Most times that it is told again.
const RESENDS_MAX: u32 = 5;

/// Where to go, and where to look there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    pub(super) place: Point,
    pub(super) heading: Option<f32>,
}

/// A way that is driven.
#[derive(Clone, Debug)]
pub(super) struct Drive {
    following: Following,
    goals: VecDeque<Goal>,
    sent: Option<Sent>,
}

/// The goal that the robot was told.
#[derive(Clone, Copy, Debug)]
struct Sent {
    next_poll: Instant,
    /// The last message that was looked at.
    number: u64,
    /// Where the robot was last known to move.
    from: Pose,
    resting: u32,
    stuck: u32,
    resends: u32,
}

impl Drive {
    pub(super) fn new(following: Following, goals: impl IntoIterator<Item = Goal>) -> Self {
        Self {
            following,
            goals: goals.into_iter().collect(),
            sent: None,
        }
    }

    /// Whether the robot has arrived at the last goal.
    pub(super) fn step(&mut self, now: Instant, link: &mut Link) -> Result<bool, Failure> {
        let Some(goal) = self.goals.front().copied() else {
            return Ok(true);
        };
        let Some((number, state, pose)) = link
            .heard()
            .and_then(|heard| Some((heard.number, heard.state()?, heard.pose()?)))
        else {
            return Ok(false);
        };
        let Some(sent) = &mut self.sent else {
            self.sent = Some(Sent::new(now, number, pose));
            tell(now, link, goal);
            return Ok(false);
        };
        if now < sent.next_poll || number == sent.number {
            return Ok(false);
        }
        sent.next_poll = now + POLL;
        sent.number = number;
        if state == State::Off && is_at(pose, goal) {
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
            sent.resends += 1;
            link.counts.resends += 1;
            tell(now, link, goal);
        }
        Ok(false)
    }
}

impl Sent {
    fn new(now: Instant, number: u64, from: Pose) -> Self {
        Self {
            next_poll: now + POLL,
            number,
            from,
            resting: 0,
            stuck: 0,
            resends: 0,
        }
    }

    /// Whether the robot rests, or drives without getting on.
    fn is_off(&mut self, state: State, pose: Pose) -> bool {
        let turned = normalised(pose.heading - self.from.heading).abs();
        if pose.position().distance_mm(self.from.position()) > MOVED_MM || turned > MOVED_RAD {
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

fn is_at(pose: Pose, goal: Goal) -> bool {
    let is_near = |one: f32, other: f32| (one - other).abs() < ARRIVED_MM;
    let place = goal.place;
    let looks = |heading: f32| normalised(pose.heading - heading).abs() < ARRIVED_RAD;
    is_near(pose.x_mm, place.x_mm)
        && is_near(pose.y_mm, place.y_mm)
        && goal.heading.is_none_or(looks)
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
