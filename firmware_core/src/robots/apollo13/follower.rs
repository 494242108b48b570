//! Drives along a plan: pure pursuit of a point ahead on it, forwards or backwards.
//!
//! The fielded follower steers by three times the heading error towards the next pose; this is a
//! turn rate, but it is used as a steering angle. This follower steers along the arc through its
//! point ahead, which a car can drive.

use alloc::vec::Vec;

use crate::ackermann::{CarGeometry, CarPose, wrapped};

/// Settings of the follower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Dimensions of the car, as the program knows them.
    pub car: CarGeometry,
    /// Speed in either direction, m/s.
    pub speed_m_s: f64,
    /// Distance along the plan of the point that is steered for, metres.
    pub ahead_m: f64,
    /// Largest steering angle to the left and to the right, radians.
    pub steering_max_rad: [f64; 2],
    /// Tolerance at the goal, metres and radians.
    pub tolerance: [f64; 2],
    /// Distance beside the plan at which the car has lost it, metres.
    pub off_max_m: f64,
}

impl Default for Settings {
    /// The fielded tolerances; the published code's wheelbase, which is 3 % less than the car's.
    fn default() -> Self {
        Self {
            car: CarGeometry {
                wheelbase_m: 0.25,
                track_m: 0.155,
            },
            speed_m_s: 0.22,
            ahead_m: 0.30,
            steering_max_rad: [0.436, 0.314],
            tolerance: [0.30, 0.30],
            off_max_m: 0.40,
        }
    }
}

/// Next action of the car.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Drive with this speed, m/s, and angle, radians to the left.
    Drive {
        /// Backwards below 0.
        speed_m_s: f64,
        /// Angle of the front wheels.
        steering_rad: f64,
    },
    /// The car is at the end of the plan, and near enough.
    Arrived,
    /// The car is too far beside the plan, or at its end and too far from the goal: a new plan is
    /// needed.
    Lost,
}

/// Follows one plan.
#[derive(Clone, Debug)]
pub struct Follower {
    settings: Settings,
    path: Vec<CarPose>,
    /// Index of the nearest pose of the path.
    at: usize,
    /// End of the current part with one driving direction.
    end: usize,
}

impl Follower {
    /// Follows `path`, poses of the rear axle's middle.
    pub fn new(path: Vec<CarPose>, settings: Settings) -> Self {
        let mut follower = Self {
            settings,
            path,
            at: 0,
            end: 0,
        };
        follower.end = follower.part_end(0);
        follower
    }

    /// The path.
    pub fn path(&self) -> &[CarPose] {
        &self.path
    }

    /// Next action for a car at `pose`.
    pub fn step(&mut self, pose: CarPose) -> Step {
        let Some(goal) = self.path.last().copied() else {
            return Step::Arrived;
        };
        loop {
            let off = self.find_nearest(pose);
            if off > self.settings.off_max_m {
                return Step::Lost;
            }
            let way = self.direction(self.end.saturating_sub(1));
            let left_m = way * pose.motion_to(self.path[self.end]).ahead_m;
            // The motor's lag moves the car on for some centimetres. On a path that reverses, a
            // part's end may therefore be behind the car before it counts as near.
            let is_last = self.end + 1 >= self.path.len();
            if left_m > 0.05 || self.at + 2 < self.end {
                return self.pursue(pose, way);
            }
            if is_last {
                return self.judge(pose, goal);
            }
            self.at = self.end;
            self.end = self.part_end(self.at);
        }
    }

    fn judge(&self, pose: CarPose, goal: CarPose) -> Step {
        let [near_m, near_rad] = self.settings.tolerance;
        let turned = wrapped(goal.heading_rad - pose.heading_rad).abs();
        match pose.distance_m(goal) <= near_m && turned <= near_rad {
            true => Step::Arrived,
            false => Step::Lost,
        }
    }

    /// Steers along the arc through the point ahead.
    fn pursue(&self, pose: CarPose, way: f64) -> Step {
        let mut left_m = self.settings.ahead_m;
        let mut index = self.at;
        while index < self.end && left_m > 0.0 {
            left_m -= self.path[index].distance_m(self.path[index + 1]);
            index += 1;
        }
        // Beyond its end the path continues straight.
        let target = self.path[index].shifted(way * left_m.max(0.0));
        let to = pose.motion_to(target);
        let square = to.ahead_m * to.ahead_m + to.left_m * to.left_m;
        let curvature = 2.0 * to.left_m / square.max(1e-6);
        let [left, right] = self.settings.steering_max_rad;
        let steering = libm::atan(self.settings.car.wheelbase_m * curvature);
        Step::Drive {
            speed_m_s: way * self.settings.speed_m_s,
            steering_rad: steering.clamp(-right, left),
        }
    }

    /// Advances to the nearest pose of the current part; returns its distance.
    fn find_nearest(&mut self, pose: CarPose) -> f64 {
        let mut nearest = pose.distance_m(self.path[self.at]);
        for index in self.at..=self.end {
            let distance = pose.distance_m(self.path[index]);
            if distance < nearest {
                nearest = distance;
                self.at = index;
            }
        }
        nearest
    }

    /// Direction of the path after this pose: 1 forwards, -1 backwards.
    fn direction(&self, index: usize) -> f64 {
        match (self.path.get(index), self.path.get(index + 1)) {
            (Some(from), Some(to)) if from.motion_to(*to).ahead_m < 0.0 => -1.0,
            _ => 1.0,
        }
    }

    /// The last pose from `from` on with the same driving direction.
    fn part_end(&self, from: usize) -> usize {
        let way = self.direction(from);
        let last = self.path.len().saturating_sub(1);
        (from..last)
            .find(|index| self.direction(*index) != way)
            .unwrap_or(last)
    }
}

#[cfg(test)]
mod tests;
