//! The accuracy of a finished map, as far as the mapper can know it.

use emulators::world::{Pose, wrap_angle};

use super::Mapper;
use crate::mapping::graph::{Errors, Held};
use crate::mapping::matrix::{Matrix, ZERO};
use crate::mapping::motion::{aligned_m, distance, laid_over};

/// The stated accuracy of a map.
#[derive(Clone, Debug)]
pub struct Accuracy {
    /// 95 % bound of the mean distance between path and truth, laid over each other, metres.
    pub bound_m: f64,
    /// Mean distance between the path and that of the odometry alone, laid over each other, metres;
    /// `None` if the odometry measured nothing.
    pub from_wheels_m: Option<f64>,
    /// Covariance of each scan's pose, laid over the truth: square metres and radians.
    pub covariances: Vec<Matrix>,
}

impl Accuracy {
    /// Whether the odometry alone may be more than a tenth better than the map. A map that lies
    /// `d` from the odometry and at most `e` from the truth leaves at least `d - e` to the
    /// odometry: `e > 1.1 (d - e)`.
    pub fn may_be_worse_than_wheels(&self) -> bool {
        let worse = 1.0 + 1.0 / WORSE;
        self.from_wheels_m
            .is_some_and(|far_m| far_m < worse * self.bound_m)
    }
}

/// Factor by which a map is worse than the odometry.
const WORSE: f64 = 1.1;

/// Number of variants of the map that are compared.
const VARIANTS: usize = 64;
/// Errors of the edges, fitted to the true errors of generated buildings. A bend that no loop has
/// taught is added.
const ERRORS: Errors = Errors {
    way: 0.45,
    unseen_way: 4.0,
    wheels: 1.0,
    loops: 1.4,
    bend: [0.00025, 0.01],
    drift: 0.0001,
    length: 0.02,
    odometry: 0.0,
};
/// Error that no variant contains, metres: systematic errors of real ranges, which generated
/// buildings lack. The Intel and ACES logs lie 0.06 m to 0.10 m from their corrected poses.
const RANGES_M: f64 = 0.07;

impl Mapper {
    /// The accuracy of the map; `None` if the mapper does not close loops, or the map has several
    /// parts, or a join of two parts is not confirmed.
    pub fn accuracy(&self) -> Option<Accuracy> {
        if self.parts()? > 1 || self.unsure_joins() > 0 {
            return None;
        }
        let poses = &self.graph.poses;
        let mut off: Vec<f64> = Vec::new();
        let mut covariances = vec![ZERO; poses.len()];
        let held = self.keyframes.iter().map(|key| Held {
            unseen: 1.0 - key.quality,
            by_odometry: key.by_odometry,
        });
        let held: Vec<Held> = held.collect();
        let errors = Errors {
            odometry: self.bend.unsure(),
            ..ERRORS
        };
        for variant in self.graph.samples(VARIANTS, &errors, &held)? {
            let laid = laid_over(poses, &variant);
            let far = poses.iter().zip(&laid).map(|(a, b)| distance(*a, *b));
            off.push(far.sum::<f64>() / poses.len() as f64);
            for ((pose, laid), sum) in poses.iter().zip(&laid).zip(&mut covariances) {
                let turn = wrap_angle(laid.theta - pose.theta);
                let by = [laid.x - pose.x, laid.y - pose.y, turn];
                for (row, a) in sum.iter_mut().zip(by) {
                    for (value, b) in row.iter_mut().zip(by) {
                        *value += a * b / VARIANTS as f64;
                    }
                }
            }
        }
        off.sort_by(f64::total_cmp);
        let covariances = self
            .scans
            .iter()
            .map(|(key, _)| covariances[*key])
            .collect();
        Some(Accuracy {
            bound_m: libm::hypot(off[VARIANTS * 95 / 100], RANGES_M),
            from_wheels_m: self.off_wheels_m(),
            covariances,
        })
    }

    /// Mean distance between the path and that of the odometry alone.
    fn off_wheels_m(&self) -> Option<f64> {
        let has_measured = self.by_wheels.way_m > 0.0;
        has_measured.then(|| aligned_m(&self.way(), &self.by_wheels.way))
    }

    /// The path by odometry alone.
    pub fn way_by_wheels(&self) -> &[Pose] {
        &self.by_wheels.way
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The map has an error of at most 1 m. The odometry 10 m away from it is worse. At 1.9 m its
    /// error may be only 0.9 m, so the map may be worse. At 1.92 m the odometry's error is at least
    /// 0.92 m, more than 1 m / 1.1.
    #[test]
    fn a_map_near_the_odometry_may_be_worse() {
        for (from_wheels_m, may_be) in [
            (None, false),
            (Some(10.0), false),
            (Some(1.92), false),
            (Some(1.90), true),
            (Some(0.1), true),
        ] {
            let accuracy = Accuracy {
                bound_m: 1.0,
                from_wheels_m,
                covariances: Vec::new(),
            };
            assert_eq!(
                accuracy.may_be_worse_than_wheels(),
                may_be,
                "{from_wheels_m:?}"
            );
        }
    }
}
