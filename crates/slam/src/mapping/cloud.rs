//! The walls in one scan: thinned end points of its beams, with the normals of the walls.

use emulators::world::Pose;

/// A point of a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Position, metres.
    pub at: [f32; 2],
    /// Unit normal of the wall, towards the lidar; zero if unknown.
    pub normal: [f32; 2],
    /// Whether the wall continues from the previous spot.
    pub is_joined: bool,
}

/// The spots of a scan in the robot's frame, in order of bearing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    spots: Vec<Spot>,
}

/// Minimum distance between two spots of a scan, metres: near walls must not outweigh distant ones.
const APART_M: f32 = 0.04;
/// Maximum distance between the ends of two beams on one wall, relative to their length: a wall
/// seen at 10 degrees by beams one degree apart.
const GAP_PART: f32 = 0.1;

const GAP_LEAST_M: f32 = 0.1;
const GAP_MOST_M: f32 = 1.0;
/// The part of a wall that determines its direction, metres to each side, and the minimum number of
/// points.
const REACH_M: f32 = 0.25;
const POINTS_LEAST: usize = 3;
/// Maximum ratio of the variances across and along a flat wall.
const FLAT: f32 = 0.12;

/// Maximum number of beams to each side.
const BEAMS: usize = 12;

impl Cloud {
    /// The cloud of beam ends, metres in the robot's frame, in order of bearing. NaN and infinity
    /// are left out.
    pub fn new(ends: &[[f32; 2]]) -> Self {
        if ends.as_flattened().iter().any(|metres| !metres.is_finite()) {
            let sound = ends.iter().filter(|[x, y]| x.is_finite() && y.is_finite());
            return Self::new(&sound.copied().collect::<Vec<_>>());
        }
        let joined: Vec<bool> = (0..ends.len())
            .map(|index| index > 0 && are_joined(ends[index - 1], ends[index]))
            .collect();
        let mut spots: Vec<Spot> = Vec::with_capacity(ends.len());
        let mut is_joined = false;
        for (index, at) in ends.iter().enumerate() {
            is_joined = joined[index] && (is_joined || index > 0);
            let is_near = spots.last().is_some_and(|last| gap(last.at, *at) < APART_M);
            if is_near && joined[index] {
                continue;
            }
            spots.push(Spot {
                at: *at,
                normal: normal(ends, &joined, index),
                is_joined,
            });
        }
        Self { spots }
    }

    /// The spots.
    pub fn spots(&self) -> &[Spot] {
        &self.spots
    }

    pub(crate) fn from_spots(spots: Vec<Spot>) -> Self {
        Self { spots }
    }
}

/// A pose that transforms many points, in single precision.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) at: [f32; 2],
    sin: f32,
    cos: f32,
}

impl Frame {
    #[expect(clippy::cast_possible_truncation, reason = "metres of a building")]
    pub(crate) fn new(pose: Pose) -> Self {
        Self {
            at: [pose.x as f32, pose.y as f32],
            sin: libm::sin(pose.theta) as f32,
            cos: libm::cos(pose.theta) as f32,
        }
    }

    #[inline]
    pub(crate) fn turned(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        [self.cos * x - self.sin * y, self.sin * x + self.cos * y]
    }

    #[inline]
    pub(crate) fn place(&self, point: [f32; 2]) -> [f32; 2] {
        let [x, y] = self.turned(point);
        [self.at[0] + x, self.at[1] + y]
    }
}

#[inline]
pub(crate) fn gap(a: [f32; 2], b: [f32; 2]) -> f32 {
    let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
    (dx * dx + dy * dy).sqrt()
}

fn are_joined(a: [f32; 2], b: [f32; 2]) -> bool {
    let nearest = gap(a, [0.0; 2]).min(gap(b, [0.0; 2]));
    gap(a, b) <= (GAP_PART * nearest).clamp(GAP_LEAST_M, GAP_MOST_M)
}

/// The normal of the wall at a point: the direction in which its neighbours differ least.
fn normal(ends: &[[f32; 2]], joined: &[bool], index: usize) -> [f32; 2] {
    let at = ends[index];
    let range = gap(at, [0.0; 2]);
    let reach = REACH_M.max(2.2 * GAP_PART * range);
    let before = (1..=BEAMS.min(index))
        .take_while(|back| joined[index - back + 1] && gap(ends[index - back], at) <= reach)
        .count();
    let behind = (1..=BEAMS.min(ends.len() - 1 - index))
        .take_while(|on| joined[index + on] && gap(ends[index + on], at) <= reach)
        .count();
    let near = &ends[index - before..=index + behind];
    if near.len() < POINTS_LEAST {
        return [0.0; 2];
    }
    let count = near.len() as f32;
    let (mut sum_x, mut sum_y) = (0.0, 0.0);
    for point in near {
        sum_x += point[0] - at[0];
        sum_y += point[1] - at[1];
    }
    let (mean_x, mean_y) = (sum_x / count, sum_y / count);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for point in near {
        let x = point[0] - at[0] - mean_x;
        let y = point[1] - at[1] - mean_y;
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    let (half, middle) = ((xx - yy) / 2.0, (xx + yy) / 2.0);
    let apart = (half * half + xy * xy).sqrt();
    let (most, least) = (middle + apart, (middle - apart).max(0.0));
    if most <= 0.0 || least > FLAT * most {
        return [0.0; 2];
    }
    // The eigenvector of the smaller eigenvalue, from the longer row.
    let [x, y] = if half > 0.0 {
        [-xy, half + apart]
    } else {
        [apart - half, -xy]
    };
    let length = (x * x + y * y).sqrt();
    if length <= 0.0 {
        return [0.0; 2];
    }
    let sign = if x * at[0] + y * at[1] > 0.0 {
        -1.0
    } else {
        1.0
    };
    [sign * x / length, sign * y / length]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall 2 m ahead, seen by beams one degree apart: its normal points back at the robot.
    #[test]
    fn the_normal_of_a_wall_points_at_the_lidar() {
        let ends: Vec<[f32; 2]> = (-20..=20).map(|y| [2.0, y as f32 * 0.035]).collect();
        let cloud = Cloud::new(&ends);
        let middle = cloud.spots()[cloud.spots().len() / 2];
        assert!((middle.normal[0] + 1.0).abs() < 1e-4 && middle.normal[1].abs() < 1e-3);
        assert!(middle.is_joined);
    }

    /// The frame of a door 1 m before the wall behind it: two walls with nothing between them.
    #[test]
    fn walls_one_behind_the_other_are_not_joined() {
        let near = (0..10).map(|y| [2.0, y as f32 * 0.05]);
        let far = (10..20).map(|y| [3.0, y as f32 * 0.05]);
        let cloud = Cloud::new(&near.chain(far).collect::<Vec<_>>());
        let joined: Vec<bool> = cloud.spots().iter().map(|spot| spot.is_joined).collect();
        let breaks = joined.iter().skip(1).filter(|joined| !**joined).count();
        assert_eq!((breaks, joined[10]), (1, false));
    }

    /// Four centimetres of wall give one spot: 41 points one centimetre apart give 11 spots.
    #[test]
    fn what_is_near_is_thinned() {
        let ends: Vec<[f32; 2]> = (0..=40).map(|y| [1.0, y as f32 * 0.010_001]).collect();
        assert_eq!(Cloud::new(&ends).spots().len(), 11);
    }

    #[test]
    fn what_is_no_number_is_left_out() {
        let cloud = Cloud::new(&[[1.0, f32::NAN], [2.0, 0.0], [f32::INFINITY, 0.0]]);
        assert_eq!(cloud.spots().len(), 1);
    }

    #[test]
    fn a_lone_point_has_no_normal() {
        let cloud = Cloud::new(&[[1.0, 0.0], [5.0, 5.0]]);
        assert!(cloud.spots().iter().all(|spot| spot.normal == [0.0; 2]));
    }
}
