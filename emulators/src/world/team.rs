//! Several robots in one world. Each robot has a [`World`] of its own, in which the others are
//! moving surfaces: its sensors see them, and its body collides with them.
//!
//! The worlds advance together, step by step. At the start of each step each world learns the
//! motion of the others ([`World::see`]); in this world they continue that motion until the next
//! step. So the order in which the worlds advance changes nothing. If a robot brakes, the other
//! worlds show it one step, 1 ms, later.

use super::World;
use super::body::{Footprint, Motion, STEP_NANOS};
use super::contact::Bumper;
use super::geometry::Pose;
use super::scene::{Shape, Track};

impl World {
    /// Adds other robots to a world that has not begun: the footprint and the start of each.
    pub fn add_robots(&mut self, robots: &[(Footprint, Pose)]) {
        self.scene = self.scene.with_robots(robots);
        self.bumper = Bumper::new(&self.scene, self.chassis.footprint().clone());
    }

    /// Number of other robots.
    pub fn robots(&self) -> usize {
        self.scene.robots().count()
    }

    /// Outlines of the other robots where they are now.
    pub fn robot_outlines(&self) -> Vec<Shape> {
        self.scene.robot_outlines(self.now)
    }

    /// Whether an obstacle or another robot may move.
    pub fn has_moving(&self) -> bool {
        self.scene.has_moving()
    }

    /// Learns the current motion of the other robot `index`, whose own world is `other`. Both
    /// worlds are at the beginning of the same step.
    pub fn see(&mut self, index: usize, other: &Self) {
        let motion = Motion {
            start: other.pose(),
            ..*other.current()
        };
        let step = other.now.as_nanos() / STEP_NANOS;
        let track = self.scene.robots().nth(index);
        if track.is_some_and(|track: &Track| !track.enter(step, motion)) {
            self.bumper.look_again();
        }
    }

    /// A copy whose other robots move independently of those of this world.
    #[must_use]
    pub fn separated(&self) -> Self {
        let mut copy = self.clone();
        if self.robots() > 0 {
            copy.scene = self.scene.separated();
        }
        copy
    }
}

#[cfg(test)]
mod tests;
