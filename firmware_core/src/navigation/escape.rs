use core::f32::consts::PI;

use crate::pose::{Point, Pose, normalised};

use super::{STEP, Settings, Surroundings};

/// Scans without moving after which the robot is stuck: eight seconds.
const STUCK_SCANS: u8 = 40;
/// Moving less than this is not moving.
const MOVED_MM: f32 = 60.0;
/// Scans for which the way out is taken.
const ESCAPE_SCANS: u8 = 15;
/// More free way than this is not better.
const FREE_MAX_MM: f32 = 1000.0;

/// Gets the robot out of a place where it only turns to and fro: towards where most is free.
#[derive(Clone, Debug)]
pub(super) struct Escape {
    at: Option<Point>,
    still: u8,
    /// Heading of the way out, and for how many scans it is still taken.
    heading: f32,
    left: u8,
}

impl Escape {
    pub(super) const fn new() -> Self {
        Self {
            at: None,
            still: 0,
            heading: 0.0,
            left: 0,
        }
    }

    /// Scans since the robot moved.
    pub(super) const fn still_scans(&self) -> u8 {
        self.still
    }

    /// The bearing of the way out, if the robot is stuck. Called once per scan while the robot is
    /// to move.
    pub(super) fn step(
        &mut self,
        settings: &Settings,
        pose: Pose,
        around: &Surroundings,
    ) -> Option<f32> {
        let here = pose.position();
        match self.at {
            Some(at) if at.distance_mm(here) < MOVED_MM => {
                self.still = self.still.saturating_add(1)
            }
            _ => (self.at, self.still) = (Some(here), 0),
        }
        if self.still >= STUCK_SCANS {
            self.still = 0;
            self.left = ESCAPE_SCANS;
            self.heading = pose.heading + freest(settings, around);
        }
        self.left = self.left.checked_sub(1)?;
        Some(normalised(self.heading - pose.heading))
    }
}

/// Bearing along which most is free.
fn freest(settings: &Settings, around: &Surroundings) -> f32 {
    let mut best = (0.0, -1.0);
    for step in -36..36_i8 {
        let bearing = f32::from(step) * STEP;
        let free = around.free_mm(&settings.body, bearing).min(FREE_MAX_MM);
        // Of equally free ones, the one that needs the least turn.
        let worth = free - bearing.abs() / PI;
        if worth > best.1 {
            best = (bearing, worth);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigation::Body;

    const SETTINGS: Settings = Settings::new(Body {
        radius_mm: 160.0,
        clearance_mm: 45.0,
        tick_mm_s: 11.345,
        axle_mm: 260.0,
    });

    /// A wall ahead and on both sides: the only way out is behind.
    fn niche() -> Surroundings {
        let side = |y: f32| (-20..=40_i8).map(move |n| Point::new(f32::from(n) * 10.0, y));
        let front = (-30..=30_i8).map(|n| Point::new(400.0, f32::from(n) * 10.0));
        Surroundings::of(side(300.0).chain(side(-300.0)).chain(front))
    }

    #[test]
    fn a_robot_that_does_not_move_for_eight_seconds_leaves_by_the_free_side() {
        let (mut escape, around) = (Escape::new(), niche());
        let mut step = || escape.step(&SETTINGS, Pose::default(), &around);
        assert!((0..40).all(|_| step().is_none()));
        let way = step().expect("a way out");
        assert!(way.abs() > 2.0, "{way}");
        assert_eq!((0..30).take_while(|_| step().is_some()).count(), 14);
    }

    #[test]
    fn a_robot_that_moves_is_left_alone() {
        let (mut escape, around) = (Escape::new(), niche());
        let is_quiet = (0..100_u8).all(|scan| {
            let pose = Pose::new(f32::from(scan) * 3.0, 0.0, 0.0);
            escape.step(&SETTINGS, pose, &around).is_none()
        });
        assert!(is_quiet);
    }
}
