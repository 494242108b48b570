//! The motion of another robot, as far as it is known.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use protocols::Instant;

use crate::world::TRAIL_STEPS;
use crate::world::body::{Motion, STEP_NANOS, STEP_S};
use crate::world::geometry::{Pose, wrap_angle};

/// Motion of a robot, one entry for each step of the physics. Clones of a track, which are in the
/// slices of a scene, share its entries.
#[derive(Clone, Debug)]
pub(in crate::world) struct Track(Arc<Mutex<Steps>>);

#[derive(Clone, Debug)]
struct Steps {
    /// Motion from the beginning of step `n` on, at index `n % TRAIL_STEPS`.
    motions: Vec<Motion>,
    /// The last known step.
    newest: u64,
}

impl Track {
    /// The track of a robot that rests at `start`.
    pub(super) fn at(start: Pose) -> Self {
        Self(Arc::new(Mutex::new(Steps {
            motions: vec![Motion::rest(start); TRAIL_STEPS],
            newest: 0,
        })))
    }

    fn steps(&self) -> MutexGuard<'_, Steps> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A track with the same entries that shares none of them.
    pub(super) fn separated(&self) -> Self {
        Self(Arc::new(Mutex::new(self.steps().clone())))
    }

    /// Enters the `motion` at the beginning of `step`. Returns whether the robot is where the entry
    /// before leads to: it has not been put elsewhere.
    pub(in crate::world) fn enter(&self, step: u64, motion: Motion) -> bool {
        let mut steps = self.steps();
        let expected = steps.pose(Instant::from_nanos(step * STEP_NANOS));
        let since = step.saturating_sub(steps.newest);
        for missed in (step + 1).saturating_sub(since.min(TRAIL_STEPS as u64))..step {
            steps.motions[index(missed)] = Motion::rest(expected);
        }
        steps.motions[index(step)] = motion;
        steps.newest = step;
        expected.point().distance(motion.start.point()) < NEAR_M
    }

    /// Pose of the robot at `at`. Within the newest step, and a step after it, the robot continues
    /// its last known motion.
    pub(super) fn pose(&self, at: Instant) -> Pose {
        self.steps().pose(at)
    }
}

/// Maximum deviation of a robot from its last known motion after one step, metres.
const NEAR_M: f64 = 5e-3;

impl Steps {
    fn pose(&self, at: Instant) -> Pose {
        let oldest = (self.newest + 1).saturating_sub(TRAIL_STEPS as u64);
        let step = (at.as_nanos() / STEP_NANOS).clamp(oldest, self.newest);
        let after = at.as_nanos().saturating_sub(step * STEP_NANOS);
        let after = Instant::from_nanos(after).as_secs_f64().min(STEP_S);
        let pose = self.motions[index(step)].pose(after);
        Pose {
            theta: wrap_angle(pose.theta),
            ..pose
        }
    }
}

fn index(step: u64) -> usize {
    usize::try_from(step % TRAIL_STEPS as u64).expect("below TRAIL_STEPS")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(x: f64, speed: f64) -> Motion {
        Motion {
            speed,
            ..Motion::rest(Pose::new(x, 0.0, 0.0))
        }
    }

    fn x_at(track: &Track, micros: u64) -> f64 {
        track.pose(Instant::from_nanos(micros * 1_000)).x
    }

    /// The robot moves at 1 m/s from x = 2 m on, then at 3 m/s from 2.001 m on: by a millimetre in
    /// 1 ms, by 2.5 mm in 1.5 ms. Unknown time begins 2 ms after the start; the robot stays there.
    #[test]
    fn a_robot_is_where_its_last_motion_leads_to() {
        let track = Track::at(Pose::new(2.0, 0.0, 0.0));
        assert!(track.enter(0, motion(2.0, 1.0)));
        assert!((x_at(&track, 500) - 2.0005).abs() < 1e-12);
        assert!(track.enter(1, motion(2.001, 3.0)));
        let apart = track.separated();
        for (micros, x) in [(0, 2.0), (999, 2.000_999), (1_500, 2.0025), (9_000, 2.004)] {
            assert!((x_at(&track, micros) - x).abs() < 1e-12, "{micros}");
        }
        // A robot that is put elsewhere; a copy of the track does not know it.
        assert!(!track.enter(2, motion(5.0, 0.0)));
        assert_eq!([x_at(&track, 9_000), x_at(&apart, 9_000)], [5.0, 2.004]);
        // Clones share their entries.
        track.clone().enter(3, motion(6.0, 0.0));
        assert_eq!(x_at(&track, 3_000), 6.0);
        assert!((x_at(&track, 1_500) - 2.0025).abs() < 1e-12);
    }

    /// The latest 256 steps are known; before them the robot is where the oldest one began. In
    /// steps without an entry the robot rests.
    #[test]
    fn old_steps_are_forgotten() {
        let track = Track::at(Pose::default());
        for step in 0..300_u32 {
            track.enter(step.into(), motion(f64::from(step), 0.0));
        }
        assert_eq!([x_at(&track, 0), x_at(&track, 43_000)], [44.0, 44.0]);
        assert_eq!([x_at(&track, 45_000), x_at(&track, 299_000)], [45.0, 299.0]);
        track.enter(900, motion(7.0, 0.0));
        assert_eq!([x_at(&track, 899_000), x_at(&track, 900_000)], [299.0, 7.0]);
    }
}
