//! Drives to a goal: plans, follows the path, and plans again when an obstacle blocks it.

use alloc::vec::Vec;
use core::time::Duration;

use protocols::Instant;

use super::follower::{Follower, Settings as FollowerSettings, Step};
use crate::ackermann::{CarPose, wrapped};
use crate::costmap::Costmap;
use crate::lattice::{Goal, Lattice, Limits, NoPlan, Outline, PrimitiveSet};

/// Interval of the checks of the path ahead.
const LOOKS_EVERY: Duration = Duration::from_millis(200);
/// Failed plans in a row before the goal is given up.
const PLANS_MAX: u8 = 8;
/// Progress that resets the count of failed plans, metres.
const GOT_ON_M: f64 = 0.3;
/// Time between two plans that failed.
const RETRY: Duration = Duration::from_secs(1);

/// Result of a goal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GoalState {
    /// No goal.
    #[default]
    None,
    /// The car drives to the goal.
    Driving,
    /// The car stands and plans a path.
    Planning,
    /// The car is at the goal.
    Reached,
    /// There is no path, or none that the car could drive.
    GivenUp,
}

/// A plan and its goal.
#[derive(Clone, Debug)]
pub struct Pilot {
    lattice: Lattice,
    settings: FollowerSettings,
    goal: Option<CarPose>,
    /// Whether the heading there matters.
    with_heading: bool,
    /// Tolerance at the goal, metres and radians.
    tolerance: [f64; 2],
    follower: Option<Follower>,
    /// Indices of the path's poses that [`Self::is_free`] rejected at planning, ascending: between
    /// two headings of the lattice the test is stricter than the search.
    tight: Vec<usize>,
    state: GoalState,
    plans: u64,
    failed: u8,
    failed_at: Option<CarPose>,
    looked: Option<Instant>,
}

impl Pilot {
    /// A pilot of a car with these primitives and this outline; plans keep a margin around it.
    pub fn new(set: PrimitiveSet, outline: &Outline, settings: FollowerSettings) -> Self {
        Self {
            lattice: Lattice::new(set, outline),
            settings,
            goal: None,
            with_heading: true,
            tolerance: settings.tolerance,
            follower: None,
            tight: Vec::new(),
            state: GoalState::None,
            plans: 0,
            failed: 0,
            failed_at: None,
            looked: None,
        }
    }

    /// Sets another goal, or none.
    pub fn set_goal(&mut self, goal: Option<CarPose>) {
        self.goal = goal;
        self.with_heading = true;
        self.tolerance = self.settings.tolerance;
        self.follower = None;
        self.failed = 0;
        self.failed_at = None;
        self.looked = None;
        self.state = match goal {
            Some(_) => GoalState::Planning,
            None => GoalState::None,
        };
    }

    /// Sets another goal with any heading, or none.
    pub fn set_place(&mut self, goal: Option<CarPose>) {
        self.set_goal(goal);
        self.with_heading = false;
    }

    /// Sets another goal with the given `tolerance`, metres and radians, or none.
    pub fn set_exact_goal(&mut self, goal: Option<CarPose>, tolerance: [f64; 2]) {
        self.set_goal(goal);
        self.tolerance = tolerance;
    }

    /// Sets another goal with a known path, which is followed unchanged.
    pub fn follow(&mut self, path: Vec<CarPose>) {
        self.set_goal(path.last().copied());
        if !path.is_empty() {
            self.tight.clear();
            self.follower = Some(Follower::new(path, self.settings));
            self.state = GoalState::Driving;
        }
    }

    /// The goal.
    pub const fn goal(&self) -> Option<CarPose> {
        self.goal
    }

    /// Whether the pilot plans for or drives to `goal`.
    pub fn is_after(&self, goal: CarPose) -> bool {
        let is_at_it = matches!(self.state, GoalState::Planning | GoalState::Driving);
        is_at_it && self.goal == Some(goal)
    }

    /// Result of the goal so far.
    pub const fn state(&self) -> GoalState {
        self.state
    }

    /// Plans that were made.
    pub const fn plans(&self) -> u64 {
        self.plans
    }

    /// The current path.
    pub fn path(&self) -> &[CarPose] {
        self.follower.as_ref().map_or(&[], Follower::path)
    }

    /// Whether the car can be at this pose.
    pub fn is_free(&self, map: &Costmap, pose: CarPose) -> bool {
        let cell = map.cell([pose.x_m, pose.y_m]);
        let angle = self.lattice.set().angle(pose.heading_rad);
        cell.is_some_and(|cell| self.lattice.is_free(map, cell, angle))
    }

    /// Speed and steering angle at `now`, m/s and radians to the left; `None`: stop. `costs` is
    /// called only to make or check a plan; without a map there are no plans.
    pub fn drive<'a>(
        &mut self,
        now: Instant,
        pose: CarPose,
        costs: impl FnOnce() -> Option<&'a Costmap>,
    ) -> Option<[f64; 2]> {
        let goal = self.goal?;
        if matches!(self.state, GoalState::Reached | GoalState::GivenUp) {
            return None;
        }
        if self.follower.is_none() && self.is_there(pose, goal) {
            self.state = GoalState::Reached;
            return None;
        }
        let every = if self.follower.is_some() {
            LOOKS_EVERY
        } else {
            RETRY
        };
        if self.looked.is_none_or(|looked| now - looked >= every) {
            self.looked = Some(now);
            match costs() {
                Some(map) if self.follower.is_none() || self.is_blocked(map, pose) => {
                    self.plan(map, pose, goal);
                }
                None if self.follower.is_none() => self.state = GoalState::GivenUp,
                _ => {}
            }
        }
        match self.follower.as_mut()?.step(pose) {
            Step::Drive {
                speed_m_s,
                steering_rad,
            } => Some([speed_m_s, steering_rad]),
            Step::Arrived => {
                self.state = GoalState::Reached;
                None
            }
            Step::Lost => {
                self.fail(pose);
                None
            }
        }
    }

    /// Whether the goal is near enough, even before the end of the path.
    fn is_there(&self, pose: CarPose, goal: CarPose) -> bool {
        let [near_m, near_rad] = self.tolerance;
        let turned = wrapped(goal.heading_rad - pose.heading_rad).abs();
        pose.distance_m(goal) <= near_m && (turned <= near_rad || !self.with_heading)
    }

    /// Replaces a blocked path by another one, after a while.
    pub fn plan_anew(&mut self) {
        if self.state == GoalState::Driving {
            self.follower = None;
            self.state = GoalState::Planning;
        }
    }

    fn plan(&mut self, map: &Costmap, pose: CarPose, goal: CarPose) {
        let to = Goal {
            pose: goal,
            with_heading: self.with_heading,
        };
        self.plans += 1;
        match self.lattice.plan(map, pose, to, Limits::PROMPT) {
            Ok(plan) => {
                let settings = FollowerSettings {
                    tolerance: self.tolerance,
                    ..self.settings
                };
                let is_tight = |index: &usize| !self.is_free(map, plan.poses[*index]);
                self.tight = (0..plan.poses.len()).filter(is_tight).collect();
                self.follower = Some(Follower::new(plan.poses, settings));
                self.state = GoalState::Driving;
            }
            // Only this error is final; others may be caused by a temporary obstacle.
            Err(NoPlan::Resolution) => self.state = GoalState::GivenUp,
            Err(_) => self.fail(pose),
        }
    }

    /// Counts a failed plan; the count restarts if the car has made progress since the last one.
    fn fail(&mut self, pose: CarPose) {
        self.follower = None;
        if self
            .failed_at
            .is_none_or(|at| at.distance_m(pose) > GOT_ON_M)
        {
            self.failed_at = Some(pose);
            self.failed = 0;
        }
        self.failed += 1;
        self.state = match self.failed >= PLANS_MAX {
            true => GoalState::GivenUp,
            false => GoalState::Planning,
        };
    }

    /// Whether the next metre and a half of the path is blocked.
    fn is_blocked(&self, map: &Costmap, pose: CarPose) -> bool {
        let path = self.path();
        let far = |index: usize| pose.distance_m(path[index]);
        let nearest = (0..path.len()).min_by(|one, other| far(*one).total_cmp(&far(*other)));
        let ahead = nearest.unwrap_or(path.len())..path.len();
        let mut near = ahead.take_while(|index| far(*index) < 1.5).skip(1);
        near.any(|index| {
            let was_free = self.tight.binary_search(&index).is_err();
            was_free && !self.is_free(map, path[index])
        })
    }
}

#[cfg(test)]
mod tests;
