//! Where the camera is on a map under way: what it sees, laid onto the lines that it saw before.
//!
//! The floor is squares of 20 cm. Each keeps the mean and the spread of the points that were seen
//! in it, and is a piece of a line if they lie along one, as in the normal distributions transform
//! (Biber and Strasser, 2003). A scan is moved until its points lie on those lines, by Gauss's and
//! Newton's method, and held by what the odometry says: along a corridor nothing else tells how far
//! the car went. A piece that is well known stays as it is: what is seen of it later, round a ring
//! and back, is laid onto it and does not move it.

use alloc::vec::Vec;

use super::sightings::{Sighting, sightings};
use crate::ackermann::{CarPose, Motion, wrapped};

/// Edge of a square, metres.
const SQUARE_M: f64 = 0.20;
/// Squares along each side.
const SIDE: usize = 160;
/// Standard deviation of the best point, metres.
const SIGMA_M: f64 = 0.004;
/// Points that a line needs, by number and by weight; at a weight of 1 a point is as good as can
/// be.
const POINTS_MIN: f64 = 8.0;
const WEIGHT_MIN: f64 = 0.2;
/// Standard deviations of a line's points, metres: across it at most, along it at least.
const ACROSS_MAX_M: f64 = 0.02;
const ALONG_MIN_M: f64 = 0.025;
/// At this weight a piece stays as it is. Points of one scan are wrong together, as the camera's
/// pose is: some dozen scans, from near and far, are to have a say.
const WEIGHT_MAX: f64 = 400.0;
/// So many scans later, one minute, what was drawn is believed before all that is newer.
const OLD_AFTER: u32 = 300;
/// Points of a scan that are laid onto lines at most.
const LAID_MAX: usize = 160;
/// Farther points are neither laid nor drawn, metres: the camera's own end is near.
const REACH_M: f64 = 9.0;
/// Rounds of one search, and how far a point may lie from its line in the first half of them and in
/// the rest, metres.
const ROUNDS: u8 = 8;
const OFF_MAX_M: [f64; 2] = [0.25, 0.12];
/// From here on a point that is off counts less, metres.
const HUBER_M: f64 = 0.03;
/// Points beside each other are wrong together: what one counts for.
const POINT: f64 = 0.15;
/// Part of the direction in which points lie that may lie across a line.
const ASKEW_MAX: f64 = 0.35;
/// Standard deviation of the odometry: of a way and of what is added at each step, metres and
/// radians.
const WAY: [f64; 2] = [0.05, 0.002];
const SIDEWAYS: [f64; 2] = [0.01, 0.001];
const TURN: [f64; 2] = [0.01, 0.002];
/// What of a correction of the heading is taken for the gyroscope's bias, and that at most, radians
/// from one scan to the next.
const BIASED: f64 = 0.03;
const BIAS_MAX_RAD: f64 = 0.005;
/// The scan is drawn when the camera has moved so far, metres and radians.
const MOVED: [f64; 2] = [0.02, 0.01];
/// So many scans are drawn first, wherever the camera is: a line needs [`POINTS_MIN`].
const AT_REST: u32 = 8;
/// Of the points that had a line near, so many must lie on it for a scan to be believed.
const FIT_MIN: f64 = 0.4;

/// A piece of line.
#[derive(Clone, Copy, Debug)]
struct Line {
    middle: [f64; 2],
    normal: [f64; 2],
}

/// What was seen in a square.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// Scan in which it was begun.
    began: u32,
    points: f64,
    weight: f64,
    sum: [f64; 2],
    /// Of x x, x y and y y.
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

/// Lines, and where the camera is among them.
#[derive(Clone, Debug)]
pub(super) struct Tracker {
    /// The corner of the squares, metres.
    corner_m: [f64; 2],
    /// Place in `pieces` of what is in a square, plus 1; 0 is nothing.
    squares: Vec<u32>,
    pieces: Vec<Piece>,
    pose: CarPose,
    /// Where the camera was when a scan was drawn last.
    drawn: Option<CarPose>,
    scans: u32,
    is_fitting: bool,
    /// By how much the odometry turns by itself from one scan to the next.
    bias_rad: f64,
}

impl Tracker {
    /// Nothing was seen; the camera is at `pose`.
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

    /// A car that stands: what the odometry turns is its own.
    pub(super) fn rest(&mut self, motion: Motion) -> CarPose {
        self.learn(motion.turn_rad - self.bias_rad);
        self.pose
    }

    fn learn(&mut self, off_rad: f64) {
        let bias_rad = self.bias_rad + BIASED * off_rad;
        self.bias_rad = bias_rad.clamp(-BIAS_MAX_RAD, BIAS_MAX_RAD);
    }

    /// Whether the last scan lay where the lines are, as far as there were any.
    pub(super) const fn is_fitting(&self) -> bool {
        self.is_fitting
    }

    /// The camera moved so by the odometry, and sees these places: bearing and range, radians and
    /// metres. Where it is now.
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
        // The first scans are drawn at rest, or there would be no lines to begin with.
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

    /// The line that a point most likely lies on, how far it is off, and how exactly that is known.
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
    /// What holds the pose where the odometry says.
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

    /// Something is off by so much, and would be less so along `slope`.
    fn add(&mut self, [a, b, c]: [f64; 3], off: f64, weight: f64) {
        let products = [a * a, a * b, a * c, b * b, b * c, c * c];
        for (sum, product) in self.matrix.iter_mut().zip(products) {
            *sum += weight * product;
        }
        for (sum, slope) in self.right.iter_mut().zip([a, b, c]) {
            *sum -= weight * slope * off;
        }
    }

    /// By Cramer's rule; no change if there is no one answer.
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

    /// 2 x + y = 4, x + 3 y + z = 10, y + z = 5: x = 1, y = 2, z = 3.
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

    /// Points along a line at 30 degrees, a centimetre to either side of it; a heap is none.
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
}
