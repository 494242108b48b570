use protocols::Instant;

use super::explore::Sight;
use super::screen::Notice;
use super::{Progress, Rescue, Victim};
use crate::navigation::{Goal, HALT, Step, Surroundings};
use crate::pose::{Point, Pose};

/// Decisions of the autonomous modes.
impl Rescue {
    /// Runs one step of the search that ends at home.
    pub(super) fn search(&mut self, now: Instant, pose: Pose, around: &Surroundings) -> [i8; 2] {
        let before = self.explore.progress();
        let sight = Sight {
            map: self.mapper.grid(),
            pose,
            around,
            is_felt: self.victims.are_explained(pose),
        };
        let set_point = self.explore.step(&mut self.navigator, sight);
        let points = self.explore.take_points();
        self.work.points = self.work.points.saturating_add(points);
        if before == Progress::Seeks && self.explore.progress() == Progress::GoesHome {
            self.screen.notices.push(now, Notice::Explored);
        }
        set_point
    }

    /// Searches victims in the new readings of the thermometers.
    pub(super) fn feel(&mut self, now: Instant) {
        let Some(readings) = self.drive.take_heat() else {
            return;
        };
        if self.matched.is_none() || self.is_lost() || !self.drive.odometry.remembers(now) {
            return;
        }
        let since = self.motion_until(now);
        let pose = self.mapper.pose().then(since);
        let around = Surroundings::seen(&self.scan, since);
        if self.victims.take(readings, pose, &around) {
            self.drive.drop_kit();
            self.screen.notices.push(now, Notice::VictimFound);
        }
    }

    /// Searches obstacles that the lidar does not see in the new readings of the infrared sensors.
    pub(super) fn look_near(&mut self, now: Instant) {
        let Some(readings) = self.drive.take_infrared() else {
            return;
        };
        if self.matched.is_none() || self.is_lost() || !self.drive.odometry.remembers(now) {
            return;
        }
        let since = self.motion_until(now);
        let pose = self.mapper.pose().then(since);
        let around = Surroundings::seen(&self.scan, since);
        let speed = self.drive.speed();
        self.blind.take(readings, pose, &around, speed);
    }

    /// The victims found so far.
    pub fn victims(&self) -> &[Victim] {
        self.victims.all()
    }

    /// Progress of the search; `None` if no search was ordered yet.
    pub const fn search_progress(&self) -> Option<Progress> {
        if self.explore.has_begun() {
            Some(self.explore.progress())
        } else {
            None
        }
    }

    /// Runs one step to the next unreached waypoint.
    pub(super) fn approach(&mut self, pose: Pose, around: &Surroundings) -> [i8; 2] {
        while let Some(target) = self.waypoints.target() {
            let [x, y] = target.position_mm.map(f32::from);
            let goal = Goal {
                position: Point::new(x, y),
                is_last: self.waypoints.is_last(),
            };
            match self
                .navigator
                .approach(self.mapper.grid(), pose, goal, around)
            {
                Step::Drive(set_point) => return set_point,
                Step::Arrived => {
                    self.waypoints.advance();
                    self.counters.arrivals = self.counters.arrivals.saturating_add(1);
                }
            }
        }
        HALT
    }
}
