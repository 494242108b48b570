//! Camera pose on an incomplete map: each scan is fitted to the lines seen before.
//!
//! The floor is squares of 20 cm. Each square stores the mean and the spread of its points. It is a
//! piece of a line if they lie along one, as in the normal distributions transform (Biber and
//! Strasser, 2003). The Gauss-Newton method moves a scan until its points lie on those lines, with
//! the odometry as prior: along a corridor no other source measures the distance. A well-known
//! piece stays fixed: later points, for example after a loop, are fitted to it and do not move it.

use alloc::vec::Vec;

use super::sightings::{Sighting, sightings};
use crate::ackermann::{CarPose, Motion, wrapped};

/// Edge of a square, metres.
const SQUARE_M: f64 = 0.20;
/// Squares along each side.
const SIDE: usize = 160;
/// Standard deviation of the best point, metres.
const SIGMA_M: f64 = 0.004;
/// Minimum number and weight of a line's points; a weight of 1 is that of an ideal point.
const POINTS_MIN: f64 = 8.0;
const WEIGHT_MIN: f64 = 0.2;
/// Standard deviations of a line's points, metres: maximum across it, minimum along it.
const ACROSS_MAX_M: f64 = 0.02;
const ALONG_MIN_M: f64 = 0.025;
/// Weight at which a piece stays fixed. Points of one scan share the error of the camera's pose, so
/// some dozen scans, from near and far, should contribute.
const WEIGHT_MAX: f64 = 400.0;
/// Number of scans, one minute, after which an old piece takes precedence over newer ones.
const OLD_AFTER: u32 = 300;
/// Maximum number of points of a scan that are fitted to lines.
const LAID_MAX: usize = 160;
/// Maximum distance of points that are fitted or drawn, metres: it is near the camera's own limit.
const REACH_M: f64 = 9.0;
/// Rounds of one search, and the maximum distance of a point from its line in the first half of
/// them and in the rest, metres.
const ROUNDS: u8 = 8;
const OFF_MAX_M: [f64; 2] = [0.25, 0.12];
/// Distance from the line above which a point counts less, metres.
const HUBER_M: f64 = 0.03;
/// Weight of one point: neighbouring points share their error.
const POINT: f64 = 0.15;
/// Maximum width of a line's points relative to their length.
const ASKEW_MAX: f64 = 0.35;
/// Standard deviation of the odometry: share of the motion, and a constant for each step, metres
/// and radians.
const WAY: [f64; 2] = [0.05, 0.002];
const SIDEWAYS: [f64; 2] = [0.01, 0.001];
const TURN: [f64; 2] = [0.01, 0.002];
/// Share of a heading correction that is attributed to the gyroscope's bias, and its maximum,
/// radians from one scan to the next.
const BIASED: f64 = 0.03;
const BIAS_MAX_RAD: f64 = 0.005;
/// Minimum motion of the camera before a scan is drawn, metres and radians.
const MOVED: [f64; 2] = [0.02, 0.01];
/// Number of first scans that are always drawn: a line needs [`POINTS_MIN`].
const AT_REST: u32 = 8;
/// Minimum share of the points with a line nearby that must lie on it for a valid scan.
const FIT_MIN: f64 = 0.4;

/// A piece of line.
#[derive(Clone, Copy, Debug)]
struct Line {
    middle: [f64; 2],
    normal: [f64; 2],
}

/// Points seen in a square.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// Scan in which the piece was started.
    began: u32,
    points: f64,
    weight: f64,
    sum: [f64; 2],
    /// Sums of x x, x y and y y.
    squares: [f64; 3],
    line: Option<Line>,
}

impl Piece {
    const fn new(began: u32) -> Self {
        Self {
            began,
            points: 0.0,
            weight: 0.0,
            sum: [0.0; 2],
            squares: [0.0; 3],
            line: None,
        }
    }

    fn add(&mut self, [x, y]: [f64; 2], weight: f64) {
        self.points += 1.0;
        self.weight += weight;
        self.sum[0] += weight * x;
        self.sum[1] += weight * y;
        let squares = [x * x, x * y, y * y];
        for (sum, square) in self.squares.iter_mut().zip(squares) {
            *sum += weight * square;
        }
        self.line = self.fitted();
    }

    fn fitted(&self) -> Option<Line> {
        if self.points < POINTS_MIN || self.weight < WEIGHT_MIN {
            return None;
        }
        let middle = self.sum.map(|sum| sum / self.weight);
        let [xx, xy, yy] = self.squares.map(|sum| sum / self.weight);
        let (a, b) = (xx - middle[0] * middle[0], xy - middle[0] * middle[1]);
        let c = yy - middle[1] * middle[1];
        let half = (a + c) / 2.0;
        let root = libm::hypot((a - c) / 2.0, b);
        let [across, along] = [half - root, half + root].map(|square| libm::sqrt(square.max(0.0)));
        // The greater spread lies at half the angle of (a - c, 2 b).
        let (sin, cos) = libm::sincos(libm::atan2(2.0 * b, a - c) / 2.0);
        let is_line = across <= ACROSS_MAX_M && along >= ALONG_MIN_M && across * 3.0 < along;
        is_line.then_some(Line {
            middle,
            normal: [-sin, cos],
        })
    }
}

/// Lines, and the camera's pose among them.
#[derive(Clone, Debug)]
pub(super) struct Tracker {
    /// The corner of the squares, metres.
    corner_m: [f64; 2],
    /// Index in `pieces` of each square's piece, plus 1; 0 is none.
    squares: Vec<u32>,
    pieces: Vec<Piece>,
    pose: CarPose,
    /// Pose of the camera at the last drawn scan.
    drawn: Option<CarPose>,
    scans: u32,
    is_fitting: bool,
    /// Turn by which the odometry drifts from one scan to the next.
    bias_rad: f64,
}

impl Tracker {
    /// A tracker without lines; the camera is at `pose`.
    pub(super) fn new(pose: CarPose) -> Self {
        let half = SIDE as f64 / 2.0 * SQUARE_M;
        Self {
            corner_m: [pose.x_m - half, pose.y_m - half],
            squares: alloc::vec![0; SIDE * SIDE],
            pieces: Vec::new(),
            pose,
            drawn: None,
            scans: 0,
            is_fitting: true,
            bias_rad: 0.0,
        }
    }

    /// Measures the odometry's drift on a standing car.
    pub(super) fn rest(&mut self, motion: Motion) -> CarPose {
        self.learn(motion.turn_rad - self.bias_rad);
        self.pose
    }

    fn learn(&mut self, off_rad: f64) {
        let bias_rad = self.bias_rad + BIASED * off_rad;
        self.bias_rad = bias_rad.clamp(-BIAS_MAX_RAD, BIAS_MAX_RAD);
    }

    /// Whether the last scan fitted the lines, as far as there were any.
    pub(super) const fn is_fitting(&self) -> bool {
        self.is_fitting
    }

    /// Takes the camera's motion by odometry, and its view: bearing and range, radians and metres.
    /// Returns the camera's pose.
    pub(super) fn track(
        &mut self,
        motion: Motion,
        seen: impl Iterator<Item = [f64; 2]>,
    ) -> CarPose {
        self.scans = self.scans.saturating_add(1);
        let sightings = sightings(seen, REACH_M);
        let motion = Motion {
            turn_rad: motion.turn_rad - self.bias_rad,
            ..motion
        };
        let told = self.pose.then(motion);
        self.pose = self.laid(told, motion, &sightings);
        self.learn(wrapped(told.heading_rad - self.pose.heading_rad));
        if self.is_fitting && self.has_moved() {
            self.drawn = Some(self.pose);
            self.draw(&sightings);
        }
        self.pose
    }

    fn has_moved(&self) -> bool {
        // The first scans are drawn at rest, or there would be no lines to start with.
        self.scans <= AT_REST
            || self.drawn.is_none_or(|drawn| {
                let turned = wrapped(self.pose.heading_rad - drawn.heading_rad).abs();
                drawn.distance_m(self.pose) >= MOVED[0] || turned >= MOVED[1]
            })
    }

    /// The pose near `told` at which the sightings lie on lines.
    fn laid(&mut self, told: CarPose, motion: Motion, sightings: &[Sighting]) -> CarPose {
        let step = sightings.len().div_ceil(LAID_MAX).max(1);
        let mut pose = told;
        for round in 0..ROUNDS {
            let off_max_m = OFF_MAX_M[usize::from(round >= ROUNDS / 2)];
            let mut sum = Sum::held(told, motion, pose);
            let (mut near, mut on) = (0.0, 0.0);
            for sighting in sightings.iter().step_by(step) {
                let (sin, cos) = libm::sincos(pose.heading_rad);
                let [ahead, left] = sighting.at;
                let [dx, dy] = [ahead * cos - left * sin, ahead * sin + left * cos];
                let at = [pose.x_m + dx, pose.y_m + dy];
                let Some((line, off_m, line_sigma)) = self.line_near(at) else {
                    continue;
                };
                near += 1.0;
                if off_m.abs() > off_max_m {
                    continue;
                }
                let [nx, ny] = line.normal;
                if let Some([x, y]) = sighting.along
                    && (nx * (x * cos - y * sin) + ny * (x * sin + y * cos)).abs() > ASKEW_MAX
                {
                    continue;
                }
                on += 1.0;
                let square = sighting.sigma * sighting.sigma + line_sigma * line_sigma;
                let huber = (HUBER_M / off_m.abs()).min(1.0);
                sum.add([nx, ny, ny * dx - nx * dy], off_m, POINT * huber / square);
            }
            self.is_fitting = on >= FIT_MIN * near;
            let [x, y, turn] = sum.solved();
            pose.x_m += x;
            pose.y_m += y;
            pose.heading_rad = wrapped(pose.heading_rad + turn);
            if x.abs() + y.abs() + turn.abs() < 1e-5 {
                break;
            }
        }
        if self.is_fitting { pose } else { told }
    }

    /// The most likely line of a point, the point's distance from it, and the accuracy of that
    /// distance.
    fn line_near(&self, [x, y]: [f64; 2]) -> Option<(Line, f64, f64)> {
        let mut best: Option<(bool, f64, Line, f64, f64)> = None;
        let [column, row] = self.square([x, y])?;
        for row in row.saturating_sub(1)..=(row + 1).min(SIDE - 1) {
            for column in column.saturating_sub(1)..=(column + 1).min(SIDE - 1) {
                let Some(piece) = self.piece(row * SIDE + column) else {
                    continue;
                };
                let Some(line) = piece.line else {
                    continue;
                };
                let off = [x - line.middle[0], y - line.middle[1]];
                let off_m = off[0] * line.normal[0] + off[1] * line.normal[1];
                let along_m = off[1] * line.normal[0] - off[0] * line.normal[1];
                if along_m.abs() > 1.25 * SQUARE_M {
                    continue;
                }
                let is_new = self.scans.saturating_sub(piece.began) < OLD_AFTER;
                let far = off_m.abs() + 0.2 * along_m.abs();
                let is_better = best.as_ref().is_none_or(|(new, least, ..)| {
                    (is_new, far) < (*new, *least) || !is_new && *new
                });
                if is_better {
                    let sigma = SIGMA_M * libm::sqrt(1.0 + 20.0 / piece.weight);
                    best = Some((is_new, far, line, off_m, sigma));
                }
            }
        }
        best.map(|(_, _, line, off_m, sigma)| (line, off_m, sigma))
    }

    fn draw(&mut self, sightings: &[Sighting]) {
        let (sin, cos) = libm::sincos(self.pose.heading_rad);
        for sighting in sightings {
            let [ahead, left] = sighting.at;
            let at = [
                self.pose.x_m + ahead * cos - left * sin,
                self.pose.y_m + ahead * sin + left * cos,
            ];
            let Some([column, row]) = self.square(at) else {
                continue;
            };
            let slot = &mut self.squares[row * SIDE + column];
            if *slot == 0 {
                self.pieces.push(Piece::new(self.scans));
                *slot = u32::try_from(self.pieces.len()).unwrap_or(0);
            }
            let place = (*slot as usize).wrapping_sub(1);
            let relative = SIGMA_M / sighting.sigma;
            let piece = self.pieces.get_mut(place);
            if let Some(piece) = piece.filter(|piece| piece.weight < WEIGHT_MAX) {
                piece.add(at, relative * relative);
            }
        }
    }

    fn piece(&self, square: usize) -> Option<&Piece> {
        let place = self.squares.get(square)?.checked_sub(1)?;
        self.pieces.get(place as usize)
    }

    fn square(&self, at: [f64; 2]) -> Option<[usize; 2]> {
        let along = [0, 1].map(|axis| (at[axis] - self.corner_m[axis]) / SQUARE_M);
        let is_inside = |along: &f64| *along >= 0.0 && *along < SIDE as f64;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "within the squares"
        )]
        along
            .iter()
            .all(is_inside)
            .then(|| along.map(|along| along as usize))
    }
}

/// The normal equations of one round: of x, y and heading.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    /// Upper triangle of the matrix: 00, 01, 02, 11, 12, 22.
    matrix: [f64; 6],
    right: [f64; 3],
}

impl Sum {
    /// The odometry's pull on the pose.
    fn held(told: CarPose, motion: Motion, pose: CarPose) -> Self {
        let way_m = libm::hypot(motion.ahead_m, motion.left_m);
        let turn_rad = motion.turn_rad.abs();
        let sigma = |[part, least]: [f64; 2], of: f64| part * of + least;
        let (sin, cos) = libm::sincos(told.heading_rad);
        let off = [pose.x_m - told.x_m, pose.y_m - told.y_m];
        let mut sum = Self::default();
        let along = off[0] * cos + off[1] * sin;
        let aside = off[1] * cos - off[0] * sin;
        let turned = wrapped(pose.heading_rad - told.heading_rad);
        let held = [
            ([cos, sin, 0.0], along, sigma(WAY, way_m)),
            ([-sin, cos, 0.0], aside, sigma(SIDEWAYS, way_m)),
            ([0.0, 0.0, 1.0], turned, sigma(TURN, turn_rad)),
        ];
        for (slope, off, sigma) in held {
            sum.add(slope, off, 1.0 / (sigma * sigma));
        }
        sum
    }

    /// Adds an error of this size, which falls along `slope`.
    fn add(&mut self, [a, b, c]: [f64; 3], off: f64, weight: f64) {
        let products = [a * a, a * b, a * c, b * b, b * c, c * c];
        for (sum, product) in self.matrix.iter_mut().zip(products) {
            *sum += weight * product;
        }
        for (sum, slope) in self.right.iter_mut().zip([a, b, c]) {
            *sum -= weight * slope * off;
        }
    }

    /// The solution by Cramer's rule; no change if the solution is not unique.
    fn solved(&self) -> [f64; 3] {
        let [a, b, c, d, e, f] = self.matrix;
        let [x, y, z] = self.right;
        // Cofactors of the symmetric matrix.
        let (ca, cb, cc) = (d * f - e * e, c * e - b * f, b * e - c * d);
        let (cd, ce, cf) = (a * f - c * c, b * c - a * e, a * d - b * b);
        let determinant = a * ca + b * cb + c * cc;
        if determinant.abs() < 1e-12 || !determinant.is_finite() {
            return [0.0; 3];
        }
        [
            (ca * x + cb * y + cc * z) / determinant,
            (cb * x + cd * y + ce * z) / determinant,
            (cc * x + ce * y + cf * z) / determinant,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The equations 2 x + y = 4, x + 3 y + z = 10 and y + z = 5 have the solution x = 1, y = 2, z
    /// = 3.
    #[test]
    fn normal_equations_are_solved() {
        let sum = Sum {
            matrix: [2.0, 1.0, 0.0, 3.0, 1.0, 1.0],
            right: [4.0, 10.0, 5.0],
        };
        let solved = sum.solved();
        for (found, expected) in solved.into_iter().zip([1.0, 2.0, 3.0]) {
            assert!((found - expected).abs() < 1e-9, "{solved:?}");
        }
        assert_eq!(Sum::default().solved(), [0.0; 3]);
    }

    /// Points along a line at 30 degrees, a centimetre to either side of it; a cluster is no line.
    #[test]
    fn points_along_a_line_are_a_piece_of_it() {
        let (sin, cos) = libm::sincos(30_f64.to_radians());
        let mut piece = Piece::new(0);
        for index in 0..20 {
            let along = f64::from(index) * 0.01 - 0.095;
            let off = if index % 2 == 0 { 0.01 } else { -0.01 };
            piece.add([along * cos - off * sin, along * sin + off * cos], 1.0);
        }
        let line = piece.line.unwrap();
        assert!((line.normal[0].abs() - sin).abs() < 0.1 && line.middle[0].abs() < 0.01);
        let mut heap = Piece::new(0);
        (0..20).for_each(|index| {
            heap.add(
                [f64::from(index % 5) * 0.03, f64::from(index / 5) * 0.03],
                1.0,
            )
        });
        assert!(heap.line.is_none());
    }

    /// With the solution 1, 2, 3 the right sides of the three equations are 4 + 2 + 6, 1 + 10 + 9
    /// and 2 + 6 + 18. Two equal rows have no solution.
    #[test]
    fn normal_equations_with_all_entries_are_solved() {
        let sum = Sum {
            matrix: [4.0, 1.0, 2.0, 5.0, 3.0, 6.0],
            right: [12.0, 20.0, 26.0],
        };
        let solved = sum.solved();
        for (found, expected) in solved.into_iter().zip([1.0, 2.0, 3.0]) {
            assert!((found - expected).abs() < 1e-9, "{solved:?}");
        }
        let twice = Sum {
            matrix: [1.0, 1.0, 0.0, 1.0, 0.0, 1.0],
            right: [1.0; 3],
        };
        assert_eq!(twice.solved(), [0.0; 3]);
    }

    #[test]
    fn what_is_off_adds_to_the_normal_equations() {
        let mut sum = Sum::default();
        sum.add([1.0, 2.0, 3.0], 2.0, 0.5);
        assert_eq!(sum.matrix, [0.5, 1.0, 1.5, 2.0, 3.0, 4.5]);
        assert_eq!(sum.right, [-1.0, -2.0, -3.0]);
        sum.add([0.0, 0.0, 1.0], -1.0, 1.0);
        assert_eq!((sum.matrix[5], sum.right[2]), (5.5, -2.0));
    }

    /// Standard deviations of the odometry after 5 m and a turn by half a radian: 0.252 m along,
    /// 0.051 m aside, 0.007 rad. At any heading, a pose without other constraints returns to the
    /// odometry's pose.
    #[test]
    fn the_odometry_holds_along_aside_and_in_turn() {
        let motion = Motion {
            ahead_m: 3.0,
            left_m: -4.0,
            turn_rad: -0.5,
        };
        let pose = CarPose {
            x_m: 1.1,
            y_m: 2.3,
            heading_rad: 0.02,
        };
        let told = |heading_rad: f64| CarPose {
            x_m: 1.0,
            y_m: 2.0,
            heading_rad,
        };
        let parts = [0.252, 0.051, 0.007].map(|sigma: f64| 1.0 / (sigma * sigma));
        let sum = Sum::held(told(0.0), motion, pose);
        let is =
            |found: f64, expected: f64| (found - expected).abs() < 1e-6 * expected.abs() + 1e-9;
        for (found, part) in [sum.matrix[0], sum.matrix[3], sum.matrix[5]]
            .into_iter()
            .zip(parts)
        {
            assert!(is(found, part), "{found} {part}");
        }
        let offs = [0.1, 0.3, 0.02];
        for ((found, part), off) in sum.right.into_iter().zip(parts).zip(offs) {
            assert!(is(found, -part * off), "{found} {part}");
        }
        // A quarter turn: along is y, aside is -x.
        let turned = Sum::held(told(core::f64::consts::FRAC_PI_2), motion, pose);
        assert!(is(turned.matrix[0], parts[1]) && is(turned.matrix[3], parts[0]));
        for heading_rad in [0.0, 0.7, -2.0] {
            let pose = CarPose {
                heading_rad: heading_rad + 0.02,
                ..pose
            };
            let solved = Sum::held(told(heading_rad), motion, pose).solved();
            for (found, off) in solved.into_iter().zip(offs) {
                assert!((found + off).abs() < 1e-9, "{solved:?}");
            }
        }
    }

    /// Eight points on the corners of a rectangle around (3, -2), turned by atan(3/4): the standard
    /// deviations are half its sides.
    fn rectangle(along: f64, across: f64, weight: f64) -> Piece {
        let mut piece = Piece::new(0);
        for (sign, side) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].repeat(2) {
            let (u, v): (f64, f64) = (along * sign, across * side);
            piece.add([3.0 + 0.8 * u - 0.6 * v, -2.0 + 0.6 * u + 0.8 * v], weight);
        }
        piece
    }

    #[test]
    fn a_piece_is_a_line_if_it_is_long_and_thin_enough() {
        let line = rectangle(0.06, 0.01, 1.0).line.expect("long and thin");
        assert!((line.middle[0] - 3.0).abs() < 1e-9 && (line.middle[1] + 2.0).abs() < 1e-9);
        let [x, y] = line.normal;
        assert!((0.8 * x + 0.6 * y).abs() < 1e-6 && (libm::hypot(x, y) - 1.0).abs() < 1e-9);
        let is_line = |along, across| rectangle(along, across, 1.0).line.is_some();
        assert!(is_line(0.09, 0.0199) && !is_line(0.09, 0.0201));
        assert!(is_line(0.0251, 0.0) && !is_line(0.0249, 0.0));
        assert!(is_line(0.03, 0.0099) && !is_line(0.03, 0.0101));
        let weighs = |weight| rectangle(0.06, 0.01, weight).line.is_some();
        assert!(weighs(0.026) && !weighs(0.024));
        let mut few = Piece::new(0);
        let mut add = |along: f64| {
            few.add([along, 0.0], 1.0);
            few.line.is_some()
        };
        let found = [0.0, 0.03, 0.06, 0.09, 0.12, 0.15, 0.18, 0.2].map(&mut add);
        assert_eq!(found.map(u8::from), [0, 0, 0, 0, 0, 0, 0, 1]);
    }

    /// 3 % of a turn at rest is attributed to the odometry's bias, at most 5 mrad a scan.
    #[test]
    fn a_bias_is_learned_slowly_and_bounded() {
        for sign in [1.0, -1.0] {
            let mut tracker = Tracker::new(CarPose::default());
            let motion = Motion {
                turn_rad: 0.1 * sign,
                ..Motion::default()
            };
            assert_eq!(tracker.rest(motion), CarPose::default());
            assert!((tracker.bias_rad - 0.003 * sign).abs() < 1e-9);
            tracker.bias_rad = 0.002 * sign;
            tracker.rest(motion);
            assert!((tracker.bias_rad - 0.004_94 * sign).abs() < 1e-9);
            tracker.rest(motion);
            assert!((tracker.bias_rad - 0.005 * sign).abs() < 1e-12);
        }
    }

    /// A wall 2.1 m ahead, an ideal point each 2 cm: ten in each square.
    fn before_a_wall() -> Tracker {
        let mut tracker = Tracker::new(CarPose::default());
        let wall: Vec<Sighting> = (-50..50)
            .map(|n| Sighting {
                at: [2.1, f64::from(n) * 0.02 + 0.01],
                sigma: SIGMA_M,
                along: None,
            })
            .collect();
        tracker.draw(&wall);
        tracker
    }

    /// Squares of 0.2 m from 16 m behind and to the right of the camera on.
    #[test]
    fn squares_lie_around_the_camera() {
        let tracker = Tracker::new(CarPose::default());
        assert_eq!(tracker.square([-16.0, -16.0]), Some([0, 0]));
        assert_eq!(tracker.square([0.01, -0.01]), Some([80, 79]));
        assert_eq!(tracker.square([15.99, 0.5]), Some([159, 82]));
        assert_eq!(
            [[16.0, 0.0], [0.0, -16.01]].map(|at| tracker.square(at)),
            [None; 2]
        );
    }

    /// A point 5 cm behind the wall lies on its line, with that distance. The line's deviation is
    /// sqrt(1 + 20 / 10) times 4 mm. In the next row of squares the wall is still near, two rows
    /// away it is not. Beyond its end the wall continues for a quarter of a metre from the middle
    /// of its last piece.
    #[test]
    fn a_point_lies_on_the_line_beside_it() {
        let tracker = before_a_wall();
        let (line, off_m, sigma) = tracker.line_near([2.15, 0.13]).expect("a wall");
        assert!((line.middle[0] - 2.1).abs() < 1e-9 && (line.middle[1] - 0.1).abs() < 1e-9);
        assert!((off_m * line.normal[0] - 0.05).abs() < 1e-9, "{off_m}");
        assert!((sigma - 0.006_928).abs() < 1e-6, "{sigma}");
        let is_near = |x, y| tracker.line_near([x, y]).is_some();
        assert!(is_near(2.35, 0.1) && is_near(1.85, 0.1));
        assert!(!is_near(2.45, 0.1) && !is_near(1.75, 0.1));
        assert!(is_near(2.1, 1.14) && !is_near(2.1, 1.16));
        assert!(is_near(2.1, -1.14) && !is_near(2.1, -1.16));
    }

    /// A line drawn 300 scans ago takes precedence over newer ones, even if those are nearer.
    #[test]
    fn an_old_line_is_believed_before_a_new_one() {
        let mut tracker = before_a_wall();
        tracker.scans = 250;
        let drift: Vec<Sighting> = (-50..50)
            .map(|n| Sighting {
                at: [2.25, f64::from(n) * 0.02 + 0.01],
                sigma: SIGMA_M,
                along: None,
            })
            .collect();
        tracker.draw(&drift);
        let x_m = |tracker: &Tracker| tracker.line_near([2.24, 0.1]).map(|it| it.0.middle[0]);
        assert!(x_m(&tracker).is_some_and(|x_m| (x_m - 2.25).abs() < 1e-9));
        tracker.scans = 299;
        assert!(x_m(&tracker).is_some_and(|x_m| (x_m - 2.25).abs() < 1e-9));
        tracker.scans = 300;
        assert!(x_m(&tracker).is_some_and(|x_m| (x_m - 2.1).abs() < 1e-9));
    }

    /// The first eight scans are always drawn; then one is drawn after each 2 cm and each hundredth
    /// of a radian.
    #[test]
    fn a_scan_is_drawn_where_the_camera_has_moved() {
        let mut tracker = Tracker::new(CarPose::default());
        (tracker.scans, tracker.drawn) = (8, Some(CarPose::default()));
        assert!(tracker.has_moved());
        tracker.scans = 9;
        let mut moved = |x_m: f64, heading_rad: f64| {
            tracker.pose = CarPose {
                x_m,
                y_m: 0.0,
                heading_rad,
            };
            tracker.has_moved()
        };
        assert!(!moved(0.019, 0.009) && moved(0.02, 0.0) && moved(0.0, -0.01));
        assert!(!moved(-0.019, -0.009) && moved(-0.02, 0.0) && moved(0.0, 0.01));
    }

    /// The odometry says 3 cm ahead, 1 cm left of the truth and turned: the wall gives the distance
    /// to it and the heading, the odometry the position along it. Each of 80 points weighs 0.15
    /// divided by the sum of the squares of 4 mm and 6.928 mm: 2344. Their squared distances along
    /// the wall add up to 17.06 square metres, so they hold the heading with a weight of 39,990.
    /// The odometry's turn, with a deviation of 0.012 rad, weighs 6,944: of its error of 0.02 rad
    /// there remain 0.00296.
    #[test]
    fn a_scan_is_laid_onto_the_wall() {
        let mut tracker = before_a_wall();
        let told = CarPose {
            x_m: 0.03,
            y_m: 0.01,
            heading_rad: 0.02,
        };
        let seen: Vec<Sighting> = (-40..40)
            .map(|n| Sighting {
                at: [2.1, f64::from(n) * 0.02 + 0.01],
                sigma: SIGMA_M,
                along: Some([0.0, 1.0]),
            })
            .collect();
        let motion = Motion {
            ahead_m: 0.5,
            left_m: 0.0,
            turn_rad: 1.0,
        };
        let pose = tracker.laid(told, motion, &seen);
        assert!(tracker.is_fitting());
        assert!(pose.x_m.abs() < 0.001, "{pose:?}");
        assert!((pose.heading_rad - 0.002_96).abs() < 1e-4, "{pose:?}");
        assert!((pose.y_m - 0.01).abs() < 0.003, "{pose:?}");
        // Points with a direction across the wall do not belong to it.
        let across = seen.iter().map(|it| Sighting {
            along: Some([1.0, 0.0]),
            ..*it
        });
        let across: Vec<Sighting> = across.collect();
        assert_eq!(tracker.laid(told, motion, &across), told);
        assert!(!tracker.is_fitting());
    }

    /// The same wall seen from (1, 2) by a camera that looks along y: 2.1 m ahead is y = 4.1, and
    /// half a metre to its left x = 0.5.
    #[test]
    fn a_wall_is_drawn_from_where_the_camera_is() {
        let mut tracker = Tracker::new(CarPose::default());
        tracker.pose = CarPose {
            x_m: 1.0,
            y_m: 2.0,
            heading_rad: core::f64::consts::FRAC_PI_2,
        };
        let wall: Vec<Sighting> = (0..50)
            .map(|n| Sighting {
                at: [2.1, f64::from(n) * 0.02 + 0.01],
                sigma: 2.0 * SIGMA_M,
                along: None,
            })
            .collect();
        tracker.draw(&wall);
        let (line, off_m, sigma) = tracker.line_near([0.5, 4.16]).expect("a wall");
        assert!((line.middle[0] - 0.5).abs() < 1e-9 && (line.middle[1] - 4.1).abs() < 1e-9);
        assert!((off_m * line.normal[1] - 0.06).abs() < 1e-9);
        // Ten points, each of a quarter of the weight: the deviation is 4 mm times the root of 1 +
        // 20 / 2.5.
        assert!((sigma - 0.012).abs() < 1e-9, "{sigma}");
        assert!(tracker.line_near([1.6, 4.1]).is_none() && tracker.line_near([0.5, 3.6]).is_none());
        // From the middle of its last piece, 0.1, the line continues for a quarter of a metre.
        assert!(
            tracker.line_near([-0.14, 4.1]).is_some() && tracker.line_near([-0.16, 4.1]).is_none()
        );
    }

    /// Of two equally new lines the nearer one is taken; a distance along the line counts a fifth.
    #[test]
    fn of_two_lines_the_nearer_is_taken() {
        let mut tracker = before_a_wall();
        let other: Vec<Sighting> = (-50..50)
            .map(|n| Sighting {
                at: [2.25, f64::from(n) * 0.02 + 0.01],
                sigma: SIGMA_M,
                along: None,
            })
            .collect();
        tracker.draw(&other);
        let x_m = |x| tracker.line_near([x, 0.1]).map(|it| it.0.middle[0]);
        assert!(x_m(2.17).is_some_and(|x| (x - 2.1).abs() < 1e-9));
        assert!(x_m(2.18).is_some_and(|x| (x - 2.25).abs() < 1e-9));
        let y_m = |y| tracker.line_near([2.1, y]).map(|it| it.0.middle[1]);
        assert!(y_m(0.19).is_some_and(|y| (y - 0.1).abs() < 1e-9));
        assert!(y_m(0.21).is_some_and(|y| (y - 0.3).abs() < 1e-9));
    }

    /// With the solution 1, 2, 3 the right sides of the three equations are 4 + 2 + 9, 1 + 10 + 6
    /// and 3 + 4 + 18.
    #[test]
    fn normal_equations_with_unlike_entries_are_solved() {
        let sum = Sum {
            matrix: [4.0, 1.0, 3.0, 5.0, 2.0, 6.0],
            right: [15.0, 17.0, 25.0],
        };
        for (found, expected) in sum.solved().into_iter().zip([1.0, 2.0, 3.0]) {
            assert!((found - expected).abs() < 1e-9);
        }
    }

    /// Points on the wall before the camera, each 2 cm, at a distance behind it.
    fn behind_the_wall(of: &[(core::ops::Range<i32>, f64)]) -> Vec<Sighting> {
        let one = |n: i32, behind_m: f64| Sighting {
            at: [2.1 + behind_m, f64::from(n) * 0.02 + 0.01],
            sigma: SIGMA_M,
            along: Some([0.0, 1.0]),
        };
        let all = of.iter();
        all.flat_map(|(part, behind_m)| part.clone().map(move |n| one(n, *behind_m)))
            .collect()
    }

    const HALF_A_METRE: Motion = Motion {
        ahead_m: 0.5,
        left_m: 0.0,
        turn_rad: 0.0,
    };

    /// In the first rounds a point may be 25 cm from its line, in the rest 12 cm: an odometry error
    /// of 20 cm is corrected, one of 26 cm is not.
    #[test]
    fn a_line_is_sought_far_first_and_near_then() {
        let seen = behind_the_wall(&[(-40..40, 0.0)]);
        let laid = |off_m: f64| {
            let mut tracker = before_a_wall();
            let told = CarPose {
                x_m: off_m,
                ..CarPose::default()
            };
            let pose = tracker.laid(told, HALF_A_METRE, &seen);
            (pose.x_m, tracker.is_fitting())
        };
        let (x_m, is_fitting) = laid(0.20);
        assert!(is_fitting && x_m.abs() < 0.005, "{x_m}");
        assert_eq!(laid(0.26), (0.26, false));
    }

    /// Sixty points on the wall and twenty 10 cm behind it, which count as if at 3 cm. Sixty times
    /// x is twenty times 3 cm, so the camera moves by 1 cm.
    #[test]
    fn what_is_far_off_its_line_draws_no_more() {
        let seen = behind_the_wall(&[(-40..-10, 0.0), (-10..10, 0.1), (10..40, 0.0)]);
        let mut tracker = before_a_wall();
        let pose = tracker.laid(CarPose::default(), HALF_A_METRE, &seen);
        assert!((pose.x_m + 0.01).abs() < 0.002, "{pose:?}");
    }

    /// Two walls of a room, 2.1 m along x and 1.5 m along y, seen from random positions and
    /// directions: from an error of 3 cm, 2 cm and 0.015 rad the camera's true pose is found.
    #[test]
    fn a_scan_of_a_corner_is_laid_where_it_was_seen_from() {
        let walls = || {
            let along = |n: i32| f64::from(n) * 0.02 + 0.01;
            let ahead = (-50..70).map(move |n| ([2.1, along(n)], [0.0, 1.0]));
            let aside = (-50..100).map(move |n| ([along(n), 1.5], [1.0, 0.0]));
            ahead.chain(aside)
        };
        let seen_from = |pose: CarPose| -> Vec<Sighting> {
            let (sin, cos) = libm::sincos(pose.heading_rad);
            let turned = |[x, y]: [f64; 2]| [x * cos + y * sin, y * cos - x * sin];
            let sighting = |([x, y], along): ([f64; 2], [f64; 2])| Sighting {
                at: turned([x - pose.x_m, y - pose.y_m]),
                sigma: SIGMA_M,
                along: Some(turned(along)),
            };
            walls().map(sighting).collect()
        };
        let mut tracker = Tracker::new(CarPose::default());
        tracker.draw(&seen_from(CarPose::default()));
        let motion = Motion {
            ahead_m: 3.0,
            left_m: 0.0,
            turn_rad: 1.0,
        };
        for [x_m, y_m, heading_rad] in [[0.3, -0.2, 0.7], [-0.4, 0.5, 2.5], [0.7, 0.1, -1.2]] {
            let truth = CarPose {
                x_m,
                y_m,
                heading_rad,
            };
            let told = CarPose {
                x_m: x_m + 0.03,
                y_m: y_m - 0.02,
                heading_rad: heading_rad + 0.015,
            };
            let pose = tracker.laid(told, motion, &seen_from(truth));
            assert!(tracker.is_fitting());
            let off_rad = (pose.heading_rad - heading_rad).abs();
            assert!(
                pose.distance_m(truth) < 0.002 && off_rad < 0.001,
                "{pose:?}"
            );
        }
    }
}
