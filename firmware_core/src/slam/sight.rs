//! Limits of what a scan can measure. Between two parallel walls a scan gives no position along
//! them. Still, the map is drawn stronger behind the robot than ahead of it, so the best score
//! always lies a little behind. In that direction the odometry is used instead.

use crate::pose::Pose;

/// Distance in points between the two of a pair: nearer pairs measure more of the lidar's noise
/// than of the wall.
const APART: usize = 4;
/// Maximum distance of two such points of one wall, divided by their distance from the robot: 24
/// degrees, or fewer on a wall that recedes from it.
const GAP_MAX: f32 = 0.4;
/// Shares of the walls that must stand across a direction before the scan counts for it. Below the
/// first share the scan has no weight, from the second on it has full weight.
const DEAF: f32 = 0.01;
const HEARS: f32 = 0.03;

/// Combines `found` in the directions that the scan's `points`, in the robot's own frame, can
/// measure, with the odometry's `predicted` in the rest.
pub(super) fn as_far_as_seen(points: &[[i16; 2]], predicted: Pose, found: Pose) -> Pose {
    let Some((axis, share)) = least_seen(points) else {
        return found;
    };
    let heard = ((share - DEAF) / (HEARS - DEAF)).clamp(0.0, 1.0);
    let (sin, cos) = (libm::sinf(found.heading), libm::cosf(found.heading));
    let along = [axis[0] * cos - axis[1] * sin, axis[0] * sin + axis[1] * cos];
    let moved = [found.x_mm - predicted.x_mm, found.y_mm - predicted.y_mm];
    let unheard = (moved[0] * along[0] + moved[1] * along[1]) * (1.0 - heard);
    Pose::new(
        found.x_mm - unheard * along[0],
        found.y_mm - unheard * along[1],
        found.heading,
    )
}

/// The direction, a unit vector in the robot's frame, with the fewest walls across it, and their
/// number divided by that of the walls across the other direction.
fn least_seen(points: &[[i16; 2]]) -> Option<([f32; 2], f32)> {
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (a, b) in points.iter().zip(points.get(APART..)?) {
        let [dx, dy] = [0, 1].map(|axis| f32::from(b[axis]) - f32::from(a[axis]));
        let square = dx * dx + dy * dy;
        let [x, y] = b.map(f32::from);
        if square > 0.0 && square < GAP_MAX * GAP_MAX * (x * x + y * y) {
            // Of the wall's normal: its tangent turned by a quarter.
            xx += dy * dy / square;
            xy -= dx * dy / square;
            yy += dx * dx / square;
        }
    }
    let (half, middle) = ((xx - yy) / 2.0, (xx + yy) / 2.0);
    let apart = libm::sqrtf(half * half + xy * xy);
    if middle <= 0.0 || apart <= 0.0 {
        return None;
    }
    // The eigenvector of the lesser eigenvalue, from whichever row is longer.
    let [x, y] = if half > 0.0 {
        [-xy, half + apart]
    } else {
        [apart - half, -xy]
    };
    let length = libm::sqrtf(x * x + y * y);
    let axis = [x / length, y / length];
    Some((axis, ((middle - apart) / (middle + apart)).max(0.0)))
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;

    /// Walls at y = +-25 cells, seen from -75 to 75 cells.
    fn corridor() -> Vec<[i16; 2]> {
        let wall = |y: i16| (-60..=60).map(move |x: i16| [x * 20, y]);
        wall(400).chain(wall(-400)).collect()
    }

    #[test]
    fn along_a_corridor_the_odometry_stands_and_across_it_the_scan() {
        let predicted = Pose::new(1000.0, 500.0, 0.0);
        let found = Pose::new(990.0, 504.0, 0.01);
        let pose = as_far_as_seen(&corridor(), predicted, found);
        assert!((pose.x_mm - 1000.0).abs() < 0.2, "{pose:?}");
        assert!((pose.y_mm - 504.0).abs() < 0.2, "{pose:?}");
        assert!((pose.heading - 0.01).abs() < f32::EPSILON);
    }

    #[test]
    fn a_corridor_with_an_end_tells_everything() {
        let mut points = corridor();
        points.extend((-19..=19).map(|y: i16| [1200, y * 20]));
        let found = Pose::new(990.0, 504.0, 0.01);
        let pose = as_far_as_seen(&points, Pose::new(1000.0, 500.0, 0.0), found);
        assert_eq!(pose, found);
    }

    #[test]
    fn a_scan_of_nothing_leaves_the_pose() {
        let found = Pose::new(1.0, 2.0, 0.5);
        for points in [&[][..], &[[5, 5]; 3], &[[5, 5]; 30]] {
            assert_eq!(as_far_as_seen(points, Pose::default(), found), found);
        }
    }

    /// A wall of `count` points from `from` on, 5 cells apart, along `(along, across)` / 5.
    fn wall(count: i16, from: [i16; 2], [along, across]: [i16; 2]) -> Vec<[i16; 2]> {
        let point = |n: i16| [from[0] + n * along, from[1] + n * across];
        (0..count).map(point).collect()
    }

    /// 34 points of a wall are 30 pairs, 14 points of the wall across it are 10 pairs. So the walls
    /// across the direction of the first wall are a third of those along it. No pair spans the
    /// corner of the two walls.
    #[test]
    fn the_direction_with_the_fewest_walls_across_is_the_least_seen() {
        let laid = [
            ([-60, 400], [4, 3], [300, -400], [-3, 4]),
            ([60, 400], [-4, 3], [-300, -400], [3, 4]),
            ([400, -60], [3, 4], [-400, 300], [4, -3]),
            ([-60, 400], [5, 0], [400, -300], [0, 5]),
            ([400, -60], [0, 5], [-300, 400], [5, 0]),
        ];
        for (from, along, other, across) in laid {
            let points = [wall(34, from, along), wall(14, other, across)].concat();
            let (axis, share) = least_seen(&points).expect("there are walls");
            let [x, y] = along.map(|part| f32::from(part) / 5.0);
            let askew = axis[0] * y - axis[1] * x;
            assert!(askew.abs() < 1e-3, "{axis:?} {along:?}");
            assert!((libm::hypotf(axis[0], axis[1]) - 1.0).abs() < 1e-5);
            assert!((share - 1.0 / 3.0).abs() < 1e-4, "{share} {along:?}");
        }
    }

    /// If 2 in 100 pairs of points lie across, the middle of the interval from 1 to 3, half of the
    /// scan's correction counts along the wall: 5 of 10 mm. Across it, all of 4 mm counts.
    #[test]
    fn between_deaf_and_hearing_the_scan_counts_for_its_part() {
        let points = [
            wall(54, [-130, 400], [5, 0]),
            wall(54, [130, -400], [-5, 0]),
            wall(6, [400, -10], [0, 5]),
        ];
        let found = Pose::new(990.0, 504.0, 0.0);
        let pose = as_far_as_seen(&points.concat(), Pose::new(1000.0, 500.0, 0.0), found);
        assert!((pose.x_mm - 995.0).abs() < 0.1, "{pose:?}");
        assert!((pose.y_mm - 504.0).abs() < 0.1, "{pose:?}");
    }

    /// Turned by a quarter, along is y and across is x: the odometry's 500 mm along and the scan's
    /// 1004 mm across.
    #[test]
    fn along_a_corridor_that_lies_askew_the_odometry_stands() {
        let turned = core::f32::consts::FRAC_PI_2;
        let predicted = Pose::new(1000.0, 500.0, turned);
        let pose = as_far_as_seen(&corridor(), predicted, Pose::new(1004.0, 490.0, turned));
        assert!((pose.x_mm - 1004.0).abs() < 0.2, "{pose:?}");
        assert!((pose.y_mm - 500.0).abs() < 0.2, "{pose:?}");
        let askew = core::f32::consts::FRAC_PI_4;
        let predicted = Pose::new(1000.0, 500.0, askew);
        let pose = as_far_as_seen(&corridor(), predicted, Pose::new(1010.0, 504.0, askew));
        // A motion by (10, 4) is 7 along (1, 1) and 3 along (1, -1), of which the scan keeps the
        // latter.
        assert!((pose.x_mm - 1003.0).abs() < 0.2, "{pose:?}");
        assert!((pose.y_mm - 497.0).abs() < 0.2, "{pose:?}");
    }
}
