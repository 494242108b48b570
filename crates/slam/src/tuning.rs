//! Corrections of a log by the user: excluded readings, and the position of the laser.

use super::{Log, Shot};
use crate::motion::moved;

/// Changes to a log before it is mapped.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tuning {
    /// Maximum distance of readings from the robot, metres.
    pub farthest_m: Option<f64>,
    /// Distance by which the laser is farther ahead than in the log, metres.
    pub laser_offset_m: f64,
    /// Use every n-th scan only; 0 and 1 use every scan.
    pub every: usize,
}

impl Tuning {
    /// Applies the changes to the log.
    pub fn apply(&self, log: &mut Log) {
        #[expect(clippy::cast_possible_truncation, reason = "millimetres of a robot")]
        let ahead_mm = (self.laser_offset_m * 1000.0) as f32;
        #[expect(clippy::cast_possible_truncation, reason = "millimetres of a building")]
        let most_mm = self.farthest_m.map_or(f32::MAX, |m| (m * 1000.0) as f32);
        for shot in &mut log.shots {
            shot.points
                .retain(|point| point.distance_mm(Default::default()) < most_mm);
            shot.points
                .iter_mut()
                .for_each(|point| point.x_mm += ahead_mm);
        }
        if self.every > 1 {
            log.shots = thinned(core::mem::take(&mut log.shots), self.every);
        }
    }
}

/// Every n-th scan, with the motion of the skipped scans.
fn thinned(shots: Vec<Shot>, every: usize) -> Vec<Shot> {
    let mut kept: Vec<Shot> = Vec::with_capacity(shots.len() / every + 1);
    let mut way = emulators::world::Pose::default();
    let mut is_measured = true;
    for (number, shot) in shots.into_iter().enumerate() {
        way = moved(way, shot.moved);
        is_measured &= shot.is_measured;
        if number % every == 0 {
            kept.push(Shot {
                moved: core::mem::take(&mut way),
                is_measured: core::mem::replace(&mut is_measured, true),
                ..shot
            });
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use emulators::world::Pose;
    use firmware_core::pose::Point;

    fn shot(x: f64) -> Shot {
        Shot {
            at_s: x,
            moved: Pose::new(x, 0.0, 0.0),
            is_measured: true,
            points: vec![Point::new(1000.0, 0.0), Point::new(9000.0, 0.0)],
        }
    }

    /// Every second one of the scans 1 to 5, with the motion between them: 1, 2 + 3, 4 + 5 metres.
    #[test]
    fn scans_that_are_left_out_leave_their_motion() {
        let mut log = Log {
            shots: [1.0, 2.0, 3.0, 4.0, 5.0].map(shot).to_vec(),
            ..Log::default()
        };
        let tuning = Tuning {
            every: 2,
            ..Tuning::default()
        };
        tuning.apply(&mut log);
        let ways: Vec<f64> = log.shots.iter().map(|shot| shot.moved.x).collect();
        assert_eq!(ways, [1.0, 5.0, 9.0]);
    }

    #[test]
    fn far_readings_are_left_out_before_the_laser_is_moved() {
        let mut log = Log {
            shots: vec![shot(1.0)],
            ..Log::default()
        };
        let tuning = Tuning {
            farthest_m: Some(5.0),
            laser_offset_m: 0.25,
            every: 1,
        };
        tuning.apply(&mut log);
        assert_eq!(log.shots[0].points, [Point::new(1250.0, 0.0)]);
    }
}
