//! Exploration of a floor without a plan; the drawn map becomes the plan.

use core::time::Duration;

use protocols::Instant;

use super::place::localiser;
use super::{Apollo13, CAMERA_AHEAD_M, INFLATION};
use crate::ackermann::CarPose;
use crate::robots::apollo13::arbiter::Mode;
use crate::robots::apollo13::floor::{Floor, FloorPlan};
use crate::robots::apollo13::pilot::GoalState;
use crate::robots::apollo13::survey::{Choice, Survey};

/// Period at which the drawn map becomes the floor to drive by.
const FLOOR_EVERY: Duration = Duration::from_secs(1);

/// Distance to a goal at which the next one is chosen, metres, and the minimum time between two
/// choices.
const NEAR_M: f64 = 1.2;
const CHOOSES_EVERY: Duration = Duration::from_secs(2);
/// Minimum progress, metres, within this time. A car below it is stuck before an obstacle that only
/// shows from its own position: it gives the goal up.
const GOT_ON_M: f64 = 0.3;
const GETS_ON_WITHIN: Duration = Duration::from_secs(15);

impl Apollo13 {
    /// Starts a map when mapping is ordered: the configured plan is dropped. At another order, the
    /// drawn map becomes the plan.
    pub(super) fn begin_or_end_mapping(&mut self, pose: CarPose) {
        let is_mapping = self.arbiter.mode() == Mode::Mapping;
        match (is_mapping, self.survey.take()) {
            (true, None) => {
                self.localiser = None;
                self.floor = Floor::new(FloorPlan::default(), INFLATION);
                self.seen = None;
                self.pilot.set_goal(None);
                self.survey = Some(Survey::new(pose.shifted(CAMERA_AHEAD_M)));
            }
            // Kill switch, or two orders at once: these are temporary.
            (false, Some(survey)) if !self.is_ordered() => self.survey = Some(survey),
            (false, Some(survey)) => {
                self.config.floor = survey.plan();
                self.floor = Floor::new(self.config.floor.clone(), INFLATION);
                if self.floor.is_known() {
                    self.localiser = Some(localiser(&self.config, pose));
                }
                self.pilot.set_goal(None);
            }
            (_, survey) => self.survey = survey,
        }
    }

    /// Whether exactly one driver is ordered.
    fn is_ordered(&self) -> bool {
        !matches!(self.arbiter.mode(), Mode::Killed | Mode::Contradiction)
    }

    /// Enters the camera's scan into the map, which gives the car's pose.
    pub(super) fn survey_sight(&mut self) {
        let now = self.now;
        let Some(survey) = self.survey.as_mut().filter(|survey| survey.is_due(now)) else {
            return;
        };
        let camera = self.odometry.pose().shifted(CAMERA_AHEAD_M);
        // A missing depth may mean too near as well as too far.
        let found = survey.draw(now, camera, &self.sight.beams(false));
        if self.seen.is_none_or(|seen| now - seen >= FLOOR_EVERY) {
            self.seen = Some(now);
            self.floor.renew(survey.plan(), INFLATION);
        }
        self.move_origin(found.shifted(-CAMERA_AHEAD_M));
    }

    /// Whether the car has made enough progress within the last period; if not, the period
    /// restarts.
    fn gets_on(&mut self, pose: CarPose) -> bool {
        let (since, at) = *self.got_on.get_or_insert((self.now, pose));
        let has_moved = at.distance_m(pose) > GOT_ON_M;
        let is_late = self.now - since > GETS_ON_WITHIN;
        if has_moved || is_late {
            self.got_on = Some((self.now, pose));
        }
        has_moved || !is_late
    }

    /// Chooses the next view when the car is near the last one; the car need not stop there.
    pub(super) fn explore(&mut self, pose: CarPose) {
        let is_under_way = matches!(self.pilot.state(), GoalState::Driving | GoalState::Planning);
        let is_far = |goal: CarPose| goal.distance_m(pose) > NEAR_M;
        let is_old = |chosen: Instant| self.now - chosen >= CHOOSES_EVERY;
        let is_due = self.chosen.is_none_or(is_old);
        let is_under_way = is_under_way && self.gets_on(pose);
        if is_under_way && (!is_due || self.pilot.goal().is_some_and(is_far)) {
            return;
        }
        let Some(survey) = &mut self.survey else {
            return;
        };
        let Some(costs) = self.floor.costs(self.now) else {
            return;
        };
        let is_free = |at| self.pilot.is_free(costs, at);
        let choice = survey.next(costs, pose, is_under_way, is_free);
        self.chosen = Some(self.now);
        match choice {
            Choice::Stay => {}
            Choice::Look(goal) => self.pilot.set_goal(Some(goal)),
            Choice::Go(goal) => self.pilot.set_place(Some(goal)),
            Choice::Done => self.pilot.set_goal(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Config;
    use super::*;

    /// Within 15 s the car has to move farther than 0.3 m; in both cases the time restarts.
    #[test]
    fn a_car_gets_on_by_more_than_30_cm_in_15_seconds() {
        let mut car = Apollo13::new(Config::default());
        let mut gets_on = |millis, x_m| {
            car.now = Instant::from_millis(millis);
            car.gets_on(CarPose {
                x_m,
                ..CarPose::default()
            })
        };
        assert!(gets_on(1_000, 0.0) && gets_on(16_000, 0.0));
        assert!(!gets_on(16_001, 0.3));
        assert!(gets_on(31_001, 0.3) && !gets_on(31_002, 0.6));
        assert!(gets_on(40_000, 0.91) && gets_on(55_000, 1.2));
        assert!(gets_on(56_000, 1.22) && gets_on(71_000, 1.3) && !gets_on(71_001, 1.3));
    }
}
