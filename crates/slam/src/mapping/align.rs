//! Alignment of a scan with walls: Gauss-Newton steps on the distances of its spots from the walls'
//! lines (Censi 2008). The odometry determines the directions that the walls leave open.

use emulators::world::{Pose, wrap_angle};

use crate::mapping::cloud::{Frame, Spot};
use crate::mapping::matrix::{Matrix, applied, diagonal, inverse, sum, weighed};
use crate::mapping::surfels::{Near, Surfels, is_unknown};

/// The pose of a scan predicted by odometry, with its uncertainty.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    pub(crate) pose: Pose,
    /// Standard deviations: metres, radians.
    pub(crate) deviation: [f64; 2],
}

impl Prior {
    pub(crate) fn information(&self) -> Matrix {
        let [metres, radians] = self.deviation.map(|sigma| 1.0 / (sigma * sigma));
        diagonal([metres, metres, radians])
    }

    /// The distance of `pose` from the prediction in squared standard deviations.
    pub(crate) fn off(&self, pose: Pose) -> f64 {
        weighed(&self.information(), difference(pose, self.pose))
    }
}

fn difference(a: Pose, b: Pose) -> [f64; 3] {
    [a.x - b.x, a.y - b.y, wrap_angle(a.theta - b.theta)]
}

/// The result.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fit {
    pub(crate) pose: Pose,
    /// Information of the walls about x, y and heading: the inverse of the variance, in the axes of
    /// the world.
    pub(crate) information: Matrix,
    /// Share of the spots that lie on a wall, 0 to 1.
    pub(crate) explained: f64,
    /// A smooth variant of the share: 1 for a spot at the centre of a wall.
    pub(crate) score: f64,
}

const STEPS_MAX: u32 = 15;
/// Distance from a wall at which a spot has little weight, metres: in the first and in the last
/// steps.
const WIDE_M: f64 = 0.12;
const NARROW_M: f64 = 0.08;

/// Standard deviation of a spot, metres. It is larger than the lidar's, because errors of
/// neighbours are correlated.
const SPOT_M: f64 = 0.10;

/// Weight of a spot at an object without a known normal.
const UNSURE: f64 = 0.3;
/// Maximum distance of a spot that lies on a wall, metres.
pub(crate) const ON_WALL_M: f64 = 0.08;

/// Aligns `spots` with the walls, starting from `start`.
pub(crate) fn align(walls: &Surfels, spots: &[Spot], start: Pose, prior: &Prior) -> Fit {
    let held = prior.information();
    let mut pose = start;
    for step in 0..STEPS_MAX {
        let wide = if step < 3 { WIDE_M } else { NARROW_M };
        let (seen, slope) = pull(walls, spots, pose, wide);
        let back = applied(&held, difference(pose, prior.pose));
        let Some(inverse) = inverse(&sum(&seen, &held)) else {
            break;
        };
        let by = applied(
            &inverse,
            [slope[0] + back[0], slope[1] + back[1], slope[2] + back[2]],
        );
        pose = Pose::new(
            pose.x - by[0].clamp(-0.2, 0.2),
            pose.y - by[1].clamp(-0.2, 0.2),
            wrap_angle(pose.theta - by[2].clamp(-0.1, 0.1)),
        );
        let is_still = by[0].abs() < 2e-4 && by[1].abs() < 2e-4 && by[2].abs() < 3e-5;
        if is_still && step >= 3 {
            break;
        }
    }
    judged(walls, spots, pose)
}

/// Information and gradient of the walls at `pose`.
fn pull(walls: &Surfels, spots: &[Spot], pose: Pose, wide: f64) -> (Matrix, [f64; 3]) {
    let frame = Frame::new(pose);
    let mut sums = Sums::default();
    for spot in spots {
        let at = frame.place(spot.at);
        if let Some(near) = walls.nearest(at, frame.turned(spot.normal)) {
            sums.hear(&frame, at, &near, wide);
        }
    }
    sums.whole()
}

/// `a` relative to `b`.
#[inline]
fn apart(a: [f32; 2], b: [f32; 2]) -> [f64; 2] {
    [f64::from(a[0] - b[0]), f64::from(a[1] - b[1])]
}

/// Sums of the normal equations: one half of the matrix, and the gradient.
#[derive(Default)]
struct Sums {
    xx: f64,
    xy: f64,
    xt: f64,
    yy: f64,
    yt: f64,
    tt: f64,
    slope: [f64; 3],
}

impl Sums {
    /// Adds a wall's constraint on a spot at `at`.
    #[inline]
    fn hear(&mut self, frame: &Frame, at: [f32; 2], near: &Near, wide: f64) {
        let lever = apart(at, frame.at);
        let off = apart(at, near.at);
        let heard = |off: f64| {
            let soft = 1.0 + (off / wide) * (off / wide);
            1.0 / (SPOT_M * SPOT_M * soft * soft)
        };
        if is_unknown(near.normal) {
            let weight = UNSURE * heard((off[0] * off[0] + off[1] * off[1]).sqrt());
            self.add([1.0, 0.0, -lever[1]], off[0], weight);
            self.add([0.0, 1.0, lever[0]], off[1], weight);
        } else {
            let (nx, ny) = (f64::from(near.normal[0]), f64::from(near.normal[1]));
            let across = nx * off[0] + ny * off[1];
            let turn = ny * lever[0] - nx * lever[1];
            self.add([nx, ny, turn], across, heard(across));
        }
    }

    #[inline]
    fn add(&mut self, [x, y, t]: [f64; 3], off: f64, weight: f64) {
        let (wx, wy, wt) = (weight * x, weight * y, weight * t);
        self.xx += wx * x;
        self.xy += wx * y;
        self.xt += wx * t;
        self.yy += wy * y;
        self.yt += wy * t;
        self.tt += wt * t;
        self.slope[0] += wx * off;
        self.slope[1] += wy * off;
        self.slope[2] += wt * off;
    }

    const fn whole(&self) -> (Matrix, [f64; 3]) {
        let seen = [
            [self.xx, self.xy, self.xt],
            [self.xy, self.yy, self.yt],
            [self.xt, self.yt, self.tt],
        ];
        (seen, self.slope)
    }
}

fn off_wall(at: [f32; 2], near: &Near) -> f64 {
    let [dx, dy] = apart(at, near.at);
    if is_unknown(near.normal) {
        return (dx * dx + dy * dy).sqrt();
    }
    let (nx, ny) = (f64::from(near.normal[0]), f64::from(near.normal[1]));
    (nx * dx + ny * dy).abs()
}

/// Evaluates the fit of `pose` without moving it.
pub(crate) fn judged(walls: &Surfels, spots: &[Spot], pose: Pose) -> Fit {
    let frame = Frame::new(pose);
    let (mut explained, mut score, mut sums) = (0.0, 0.0, Sums::default());
    for spot in spots {
        let at = frame.place(spot.at);
        let Some(near) = walls.nearest(at, frame.turned(spot.normal)) else {
            continue;
        };
        sums.hear(&frame, at, &near, NARROW_M);
        let off = off_wall(at, &near);
        explained += if off <= ON_WALL_M { 1.0 } else { 0.0 };
        let soft = 1.0 + (off / NARROW_M) * (off / NARROW_M);
        score += 1.0 / (soft * soft);
    }
    let count = spots.len().max(1) as f64;
    let (information, _) = sums.whole();
    Fit {
        pose,
        information,
        explained: explained / count,
        score: score / count,
    }
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "metres of a small room")]
mod tests {
    use super::*;
    use crate::mapping::cloud::Cloud;

    /// A scan from the pose `from`: walls at y = -2 m and y = 2 m, and one at x = 4 m if the
    /// corridor has an end; beams one degree apart.
    fn seen(from: Pose, has_end: bool) -> Cloud {
        let mut ends = Vec::new();
        for degree in -120..=120 {
            let bearing = f64::from(degree).to_radians();
            let (sin, cos) = libm::sincos(from.theta + bearing);
            let side = if sin > 0.0 { 2.0 } else { -2.0 };
            let to_side = (side - from.y) / sin;
            let to_end = if has_end && cos > 0.0 {
                (4.0 - from.x) / cos
            } else {
                f64::MAX
            };
            let range = to_side.min(to_end);
            if range.is_finite() && range < 8.0 {
                let (sin, cos) = libm::sincos(bearing);
                ends.push([(range * cos) as f32, (range * sin) as f32]);
            }
        }
        Cloud::new(&ends)
    }

    fn laid(has_end: bool, off: Pose) -> Fit {
        let mut walls = Surfels::around([0.0; 2], 15.0);
        walls.draw(Pose::default(), &seen(Pose::default(), has_end));
        let truth = Pose::new(0.3, 0.1, 0.05);
        let prior = Prior {
            pose: Pose::new(truth.x + off.x, truth.y + off.y, truth.theta + off.theta),
            deviation: [0.2, 0.1],
        };
        align(&walls, seen(truth, has_end).spots(), prior.pose, &prior)
    }

    /// Starts 7 cm and 1.7 degrees off; the alignment is accurate to a centimetre and a fifth of a
    /// degree.
    #[test]
    fn a_scan_finds_its_place_between_walls() {
        let fit = laid(true, Pose::new(0.05, -0.05, 0.03));
        assert!(
            (fit.pose.x - 0.3).abs() < 0.01 && (fit.pose.y - 0.1).abs() < 0.01,
            "{fit:?}"
        );
        assert!(
            (fit.pose.theta - 0.05).abs() < 0.004 && fit.explained > 0.9,
            "{fit:?}"
        );
    }

    /// Along a corridor the walls give no information: the odometry determines the position, and
    /// the information matrix shows this.
    #[test]
    fn along_a_corridor_the_wheels_stand() {
        let fit = laid(false, Pose::new(0.05, -0.05, 0.0));
        assert!(
            (fit.pose.x - 0.35).abs() < 0.01 && (fit.pose.y - 0.1).abs() < 0.01,
            "{fit:?}"
        );
        let [along, across] = [0, 1].map(|axis: usize| fit.information[axis][axis]);
        assert!(along < 0.02 * across, "{along} {across}");
    }
}
