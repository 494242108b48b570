//! Poses and motions in double precision: metres and radians.

use emulators::world::{Pose, wrap_angle};

/// `to` relative to `from`.
pub fn between(from: Pose, to: Pose) -> Pose {
    let (sin, cos) = (libm::sin(from.theta), libm::cos(from.theta));
    let (dx, dy) = (to.x - from.x, to.y - from.y);
    Pose::new(
        cos * dx + sin * dy,
        cos * dy - sin * dx,
        wrap_angle(to.theta - from.theta),
    )
}

/// The pose after the motion `by` from `from`.
pub fn moved(from: Pose, by: Pose) -> Pose {
    let (sin, cos) = (libm::sin(from.theta), libm::cos(from.theta));
    Pose::new(
        from.x + cos * by.x - sin * by.y,
        from.y + sin * by.x + cos * by.y,
        wrap_angle(from.theta + by.theta),
    )
}

/// Distance between two poses, metres.
pub fn distance(a: Pose, b: Pose) -> f64 {
    libm::hypot(a.x - b.x, a.y - b.y)
}

/// Mean distance of the poses of two paths, metres, with `way` laid over `truth` by the rigid
/// motion that brings their positions nearest (Umeyama 1991, without scale).
pub fn aligned_m(truth: &[Pose], way: &[Pose]) -> f64 {
    let off = laid_over(truth, way);
    let all = truth.iter().zip(&off).map(|(a, b)| distance(*a, *b));
    all.sum::<f64>() / truth.len().min(way.len()).max(1) as f64
}

/// `way` after the rigid motion that brings its positions nearest to those of `truth`.
pub fn laid_over(truth: &[Pose], way: &[Pose]) -> Vec<Pose> {
    let count = truth.len().min(way.len()).max(1) as f64;
    let mean = |poses: &[Pose], others: &[Pose]| {
        let both = poses.iter().zip(others);
        let sum = both.fold([0.0; 2], |[x, y], (pose, _)| [x + pose.x, y + pose.y]);
        sum.map(|sum| sum / count)
    };
    let (middle, here) = (mean(truth, way), mean(way, truth));
    let (mut along, mut across) = (0.0, 0.0);
    for (truth, pose) in truth.iter().zip(way) {
        let [u, v] = [pose.x - here[0], pose.y - here[1]];
        let [a, b] = [truth.x - middle[0], truth.y - middle[1]];
        along += u * a + v * b;
        across += u * b - v * a;
    }
    let there = Pose::new(middle[0], middle[1], libm::atan2(across, along));
    let from = |pose: &Pose| Pose::new(pose.x - here[0], pose.y - here[1], pose.theta);
    way.iter().map(|pose| moved(there, from(pose))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;

    /// From (1, 2), facing +y, a position 3 ahead and 1 to the left is (0, 5).
    #[test]
    fn a_motion_leads_where_it_was_seen() {
        let from = Pose::new(1.0, 2.0, FRAC_PI_2);
        let to = moved(from, Pose::new(3.0, 1.0, 0.5));
        assert!((to.x - 0.0).abs() < 1e-12 && (to.y - 5.0).abs() < 1e-12);
        let back = between(from, to);
        assert!((back.x - 3.0).abs() < 1e-12 && (back.theta - 0.5).abs() < 1e-12);
        assert!((distance(from, to) - 10_f64.sqrt()).abs() < 1e-12);
    }

    /// A square and the same square elsewhere, turned by a quarter: no distance. One corner that is
    /// 0.4 m off is laid over the others: less than 0.1 m in the mean.
    #[test]
    fn paths_are_compared_wherever_they_lie() {
        let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        let truth = corners.map(|[x, y]| Pose::new(x, y, 0.0));
        let there = Pose::new(7.0, -3.0, FRAC_PI_2);
        let mut way = truth.map(|pose| moved(there, pose));
        assert!(aligned_m(&truth, &way) < 1e-12);
        assert!((laid_over(&truth, &way)[2].theta).abs() < 1e-12);
        way[2].x += 0.4;
        let off = aligned_m(&truth, &way);
        assert!(off > 0.05 && off < 0.2, "{off}");
    }
}
