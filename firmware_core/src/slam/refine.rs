//! Refines the best cell to a pose between the cells: Newton steps on the interpolated score, less
//! the odometry's cost. Along a corridor's axis, which the scan cannot measure, the score is flat
//! and only the odometry's cost is curved, so the odometry decides.

use super::WIDE;
use super::effort::Effort;
use super::matching::{CELL_BITS, Placement};
use super::prior::Prior;
use super::row::POINTS_MAX;
use crate::grid::Grid;
use crate::pose::Pose;

/// Newton steps, each on a narrower stencil.
const STEPS: u32 = 3;
/// Scores needed for a step: the middle, both directions along three axes, three corners.
const SCORES_PER_STEP: u32 = 10;
/// Half-width of the first stencil, in cells.
const STENCIL_CELLS: f32 = 1.0;
/// Longest step, in stencils.
const STEP_MAX: f32 = 1.5;

/// Binary places of the interpolation.
const FRACTION_BITS: u32 = 6;
const ONE: u32 = 1 << FRACTION_BITS;

/// The best pose near `start`, and the curvature of the score there: per square stencil, along its
/// least and most certain direction.
pub(super) fn refine<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    points: &[[i16; 2]],
    start: Pose,
    prior: &Prior,
    effort: &mut Effort,
) -> Pose {
    let points = &points[..points.len().min(POINTS_MAX)];
    let score = |pose: Pose| smooth_mean(grid, points, pose) - prior.uncapped_cost(pose);
    let cell_mm = grid.resolution_mm();
    let lever_mm = mean_reach_cells(points).max(8.0) * cell_mm;
    let mut pose = start;
    let mut stencil_mm = STENCIL_CELLS * cell_mm;
    for _ in 0..STEPS {
        effort.smooth(SCORES_PER_STEP * super::count_u32(points.len()));
        let unit = [stencil_mm, stencil_mm, stencil_mm / lever_mm];
        let shifted = |[x, y, turn]: [f32; 3]| {
            Pose::new(
                pose.x_mm + x * unit[0],
                pose.y_mm + y * unit[1],
                pose.heading + turn * unit[2],
            )
        };
        let Some(step) = newton_step(|at| score(shifted(at))) else {
            break;
        };
        pose = shifted(step);
        stencil_mm *= 0.5;
    }
    pose
}

/// One Newton step towards the maximum of `f`, in units of the stencil; `None` where `f` has no
/// maximum by its curvature.
fn newton_step(f: impl Fn([f32; 3]) -> f32) -> Option<[f32; 3]> {
    let here = f([0.0; 3]);
    let axis = |index: usize, by: f32| {
        let mut at = [0.0; 3];
        at[index] = by;
        at
    };
    let plus = [0, 1, 2].map(|index| f(axis(index, 1.0)));
    let minus = [0, 1, 2].map(|index| f(axis(index, -1.0)));
    let corner = |a: usize, b: usize| {
        let mut at = axis(a, 1.0);
        at[b] = 1.0;
        f(at) - plus[a] - plus[b] + here
    };
    let slope = [0, 1, 2].map(|index| (plus[index] - minus[index]) / 2.0);
    let bend = [0, 1, 2].map(|index| 2.0 * here - plus[index] - minus[index]);
    // The cross terms from one corner each are noisy; half of them keeps the matrix well behaved.
    let cross = [-corner(0, 1), -corner(0, 2), -corner(1, 2)].map(|value| value * 0.5);
    let step = solve(bend, cross, slope)?;
    Some(step.map(|part| part.clamp(-STEP_MAX, STEP_MAX)))
}

/// Solves the symmetric system with this diagonal and these entries 01, 02, 12 by Cholesky's
/// decomposition; `None` if the matrix is not positive definite.
fn solve(diagonal: [f32; 3], cross: [f32; 3], right: [f32; 3]) -> Option<[f32; 3]> {
    const LEAST: f32 = 1e-6;
    let d0 = diagonal[0];
    if d0 < LEAST {
        return None;
    }
    let (l10, l20) = (cross[0] / d0, cross[1] / d0);
    let d1 = diagonal[1] - l10 * cross[0];
    if d1 < LEAST {
        return None;
    }
    let l21 = (cross[2] - l20 * cross[0]) / d1;
    let d2 = diagonal[2] - l20 * cross[1] - l21 * l21 * d1;
    if d2 < LEAST {
        return None;
    }
    let z0 = right[0];
    let z1 = right[1] - l10 * z0;
    let z2 = right[2] - l20 * z0 - l21 * z1;
    let x2 = z2 / d2;
    let x1 = z1 / d1 - l21 * x2;
    Some([z0 / d0 - l10 * x1 - l20 * x2, x1, x2])
}

/// Mean of the smoothed map at the points; points off the map count as 0.
fn smooth_mean<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    points: &[[i16; 2]],
    pose: Pose,
) -> f32 {
    let placement = Placement::new(pose, grid.resolution_mm());
    let sum = match WIDE {
        true => sum_in_blocks(grid, points, &placement),
        false => sum_of_each(grid, points, &placement),
    };
    sum as f32 / ((ONE * ONE) as f32 * points.len().max(1) as f32)
}

/// One point after the other.
#[inline]
fn sum_of_each<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    points: &[[i16; 2]],
    placement: &Placement,
) -> u32 {
    let values = points.iter();
    let values = values.map(|point| smooth_value(grid, placement.fixed(*point)));
    values.sum()
}

/// Number of points interpolated together.
const BLOCK: usize = 8;
/// A number for each point of a block.
type Block = [u16; BLOCK];

/// As [`sum_of_each`], in blocks of points. The compiler turns the arithmetic of a block into SSE2
/// code.
#[inline]
fn sum_in_blocks<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    points: &[[i16; 2]],
    placement: &Placement,
) -> u32 {
    let (blocks, rest) = points.as_chunks();
    let blocks = blocks.iter().map(|block| sum_of(grid, block, placement));
    blocks.sum::<u32>() + sum_of_each(grid, rest, placement)
}

#[inline]
fn sum_of<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    points: &[[i16; 2]; BLOCK],
    placement: &Placement,
) -> u32 {
    let (width, height) = (Grid::<W, H>::WIDTH, Grid::<W, H>::HEIGHT);
    let trig = |part: i32| i32::from(i16::try_from(part).expect("at most 1, of 14 places"));
    let (cos, sin) = (trig(placement.cos), trig(placement.sin));
    // A point off the map gets the first cells and no weight, in place of a branch.
    let (mut first, mut on_map) = ([0; BLOCK], [0; BLOCK]);
    let mut parts = [[0; BLOCK]; 2];
    for (index, [x, y]) in points.iter().enumerate() {
        let (x, y) = (i32::from(*x), i32::from(*y));
        let at = [
            cos * x - sin * y + placement.x,
            sin * x + cos * y + placement.y,
        ];
        let [column, row] = at.map(|at| (at >> CELL_BITS) - 1);
        let is_on_map = (column >= 0) & (column <= width - 3) & (row >= 0) & (row <= height - 3);
        on_map[index] = if is_on_map { u16::MAX } else { 0 };
        first[index] = if is_on_map { row * width + column } else { 0 };
        for (parts, at) in parts.iter_mut().zip(at) {
            parts[index] = part_of(at);
        }
    }
    let [across, up] = parts.map(weights_of);
    let mut cells: [[Block; 3]; 3] = [[[0; BLOCK]; 3]; 3];
    for (index, first) in first.iter().enumerate() {
        let first = first.cast_unsigned() as usize;
        // One check of the bounds for all nine cells.
        let near = grid.rows().as_flattened().get(first..first + 2 * W + 3);
        let Some(near) = near else {
            continue;
        };
        for (row, cells) in cells.iter_mut().enumerate() {
            for (column, cells) in cells.iter_mut().enumerate() {
                cells[index] = u16::from(near[row * W + column]);
            }
        }
    }
    let mut sums = [0; BLOCK];
    for (index, sum) in sums.iter_mut().enumerate() {
        for (row, up) in cells.iter().zip(&up) {
            let line = row.iter().zip(&across);
            let line = line.fold(0, |sum, (cells, across)| sum + cells[index] * across[index]);
            *sum += u32::from(line) * u32::from(up[index] & on_map[index]);
        }
    }
    sums.iter().sum()
}

/// Position within the cell, 0 to 63; the middle is at 31.5, taken as 32.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "six bits")]
const fn part_of(fixed: i32) -> u16 {
    (fixed >> (CELL_BITS - FRACTION_BITS) & (ONE.cast_signed() - 1)).cast_unsigned() as u16
}

/// The weights of [`spline`], for its parts of a cell.
#[inline]
fn weights_of(parts: Block) -> [Block; 3] {
    const ONE: u16 = 1 << FRACTION_BITS;
    let mut weights = [[0; BLOCK]; 3];
    for (index, part) in parts.into_iter().enumerate() {
        let rest = ONE - part;
        let (before, behind) = (rest * rest / (2 * ONE), part * part / (2 * ONE));
        weights[0][index] = before;
        weights[1][index] = ONE - before - behind;
        weights[2][index] = behind;
    }
    weights
}

/// Nine neighbouring cells under a quadratic B-spline; 64 times 64 times the value. Linear
/// interpolation of four cells would be flat between two equal ones: a wall on the border of two
/// cells could lie anywhere between their middles.
#[inline]
fn smooth_value<const W: usize, const H: usize>(grid: &Grid<W, H>, (x, y): (i32, i32)) -> u32 {
    let (column, row) = ((x >> CELL_BITS) - 1, (y >> CELL_BITS) - 1);
    let (width, height) = (Grid::<W, H>::WIDTH, Grid::<W, H>::HEIGHT);
    if !(0..=width - 3).contains(&column) || !(0..=height - 3).contains(&row) {
        return 0;
    }
    let (across, up) = (spline(x), spline(y));
    // One check of the bounds for all nine cells.
    let first = (row * width + column).cast_unsigned() as usize;
    let Some(cells) = grid.rows().as_flattened().get(first..first + 2 * W + 3) else {
        return 0;
    };
    let line = |from: usize| {
        let [a, b, c] = [cells[from], cells[from + 1], cells[from + 2]].map(u32::from);
        a * across[0] + b * across[1] + c * across[2]
    };
    up[0] * line(0) + up[1] * line(W) + up[2] * line(2 * W)
}

/// Weights of the cell before, this cell and the cell behind, of 64.
#[inline]
fn spline(fixed: i32) -> [u32; 3] {
    let part = u32::from(part_of(fixed));
    let rest = ONE - part;
    let (before, behind) = (rest * rest / (2 * ONE), part * part / (2 * ONE));
    [before, ONE - before - behind, behind]
}

/// Mean distance of the points from the robot, in cells.
fn mean_reach_cells(points: &[[i16; 2]]) -> f32 {
    let reach = |[x, y]: &[i16; 2]| libm::hypotf(f32::from(*x), f32::from(*y)) / 16.0;
    points.iter().map(reach).sum::<f32>() / points.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::pose::Point;
    use crate::slam::matching::EndPoints;
    use crate::slam::prior::Travel;
    use crate::slam::settings::MotionNoise;
    use crate::slam::trace::{Beam, Strokes, trace};

    const CELL_MM: f32 = 10.0;
    const HERE: Pose = Pose {
        x_mm: 503.0,
        y_mm: 496.0,
        heading: 0.2,
    };

    /// End of a beam from `HERE`: at walls y = 202 mm and y = 797 mm, and at x = 204 mm and x = 801
    /// mm. A corridor has only the first two, and walls beyond 480 mm are out of range.
    fn end(bearing: f32, in_corridor: bool) -> Option<Point> {
        let (sin, cos) = crate::pose::sin_cos(bearing + HERE.heading);
        let to_y = (if sin > 0.0 { 797.0 } else { 202.0 } - HERE.y_mm) / sin;
        let to_x = (if cos > 0.0 { 801.0 } else { 204.0 } - HERE.x_mm) / cos;
        let (sin, cos) = crate::pose::sin_cos(bearing);
        let distance = if in_corridor { to_y } else { to_x.min(to_y) };
        let point = Point::new(distance * cos, distance * sin);
        (!in_corridor || distance < 480.0).then_some(point)
    }

    /// A map drawn with sixteen beams to the degree, and a scan of 180 points without noise.
    fn seen(in_corridor: bool) -> (Grid<100, 100>, EndPoints) {
        let mut grid = Grid::new(CELL_MM);
        let strokes = Strokes::of(40, 20, 256);
        let bearing = |index: u16, step: f32| f32::from(index) * step.to_radians();
        for point in (0..5760).filter_map(|index| end(bearing(index, 1.0 / 16.0), in_corridor)) {
            let hit = HERE.to_world(point);
            let beam = Beam {
                from: (HERE.x_mm / CELL_MM, HERE.y_mm / CELL_MM),
                hit: (hit.x_mm / CELL_MM, hit.y_mm / CELL_MM),
                half_hole: 6.0,
            };
            trace(grid.rows_mut(), &beam, &strokes);
        }
        let mut points = EndPoints::EMPTY;
        let scan = (0..180).filter_map(|index| end(bearing(index, 2.0), in_corridor));
        // The scan ends nearer than the map's walls do, so it does not see any end of a wall.
        points.set(
            scan.filter(|point| point.distance_mm(Point::default()) < 380.0),
            CELL_MM,
        );
        (grid, points)
    }

    fn refined(in_corridor: bool, start: Pose) -> Pose {
        let (grid, points) = seen(in_corridor);
        let mut travel = Travel::default();
        travel.add(start.change_to(HERE));
        let noise = MotionNoise {
            rest_cells: 1.0,
            rest_rad: 0.05,
            ..MotionNoise::WHEELS
        };
        let prior = Prior::new(start, travel, &noise, CELL_MM);
        refine(&grid, points.all(), start, &prior, &mut Effort::default())
    }

    proptest! {
        /// A sum in blocks is the sum of each point, on the map, at its edges and far off.
        #[test]
        fn every_form_of_the_sum_is_the_naive_one(
            values in proptest::collection::vec(0_u8.., 60 * 50),
            points in proptest::collection::vec([-700_i16..700, -i16::MAX..i16::MAX], 0..40),
            near: bool, x in -20.0_f32..80.0, y in -20.0_f32..70.0, heading in -3.2_f32..3.2,
        ) {
            let mut points = points;
            points.iter_mut().for_each(|[_, y]| *y = if near { *y / 50 } else { *y });
            let mut grid = Grid::<60, 50>::new(CELL_MM);
            grid.rows_mut().as_flattened_mut().copy_from_slice(&values);
            let placement = Placement::new(Pose::new(10.0 * x, 10.0 * y, heading), CELL_MM);
            let naive = sum_of_each(&grid, &points, &placement);
            prop_assert_eq!(sum_in_blocks(&grid, &points, &placement), naive);
        }
    }

    /// A pose wrong by a cell in both directions and half a degree is found to a fraction of a
    /// cell.
    #[test]
    fn a_room_fixes_the_pose_between_the_cells() {
        let start = Pose::new(HERE.x_mm + 9.0, HERE.y_mm - 8.0, HERE.heading + 0.01);
        let off = HERE.change_to(refined(false, start));
        assert!(off.distance_mm() < 2.5 && off.turn.abs() < 0.004, "{off:?}");
    }

    /// Two parallel walls give no position along them: there the odometry counts.
    #[test]
    fn a_corridor_fixes_the_pose_across_it_only() {
        let start = Pose::new(HERE.x_mm + 9.0, HERE.y_mm - 8.0, HERE.heading);
        let end = refined(true, start);
        assert!((end.y_mm - HERE.y_mm).abs() < 2.5, "{end:?}");
        assert!((end.x_mm - start.x_mm).abs() < 1.0, "{end:?}");
    }

    /// The equations x + 2y = 5, 2x + 8y + z = 21 and y + 3z = 11 have the solution 1, 2, 3.
    #[test]
    fn the_equations_are_solved_and_saddles_refused() {
        let solution = solve([1.0, 8.0, 3.0], [2.0, 0.0, 1.0], [5.0, 21.0, 11.0]).unwrap();
        for (part, expected) in solution.iter().zip([1.0, 2.0, 3.0]) {
            assert!((part - expected).abs() < 1e-4, "{solution:?}");
        }
        assert_eq!(solve([1.0, 1.0, 1.0], [2.0, 0.0, 0.0], [1.0; 3]), None);
    }

    #[test]
    fn the_splines_weights_are_whole_and_symmetric() {
        for part in 0..64 {
            let weights = spline(part << (CELL_BITS - FRACTION_BITS));
            assert_eq!(weights.iter().sum::<u32>(), ONE);
        }
        assert_eq!(spline(32 << (CELL_BITS - FRACTION_BITS)), [8, 48, 8]);
    }

    /// Along each axis, a curvature of a millionth is a summit, and less is none.
    #[test]
    fn a_summit_is_curved_along_all_three_axes() {
        for axis in 0..3 {
            let mut diagonal = [1.0; 3];
            diagonal[axis] = 1e-6;
            assert_eq!(solve(diagonal, [0.0; 3], diagonal), Some([1.0; 3]));
            diagonal[axis] = 0.9e-6;
            assert_eq!(solve(diagonal, [0.0; 3], diagonal), None);
        }
    }

    fn is_near(found: Option<[f32; 3]>, expected: [f32; 3]) -> bool {
        found.is_some_and(|found| {
            let mut parts = found.iter().zip(expected);
            parts.all(|(part, expected)| (part - expected).abs() < 1e-4)
        })
    }

    /// The equations x + y + z = 6, x + 5y + 3z = 20 and x + 3y + 6z = 25 have the solution 1, 2,
    /// 3.
    #[test]
    fn equations_with_all_entries_are_solved() {
        let solution = solve([1.0, 5.0, 6.0], [1.0, 1.0, 3.0], [6.0, 20.0, 25.0]);
        assert!(is_near(solution, [1.0, 2.0, 3.0]), "{solution:?}");
    }

    /// The summit of 7 - (x - 0.5)^2 - 2 (y + 0.25)^2 - 4 (z - 0.1)^2 is at the calculated
    /// position; for one 9 away the step is limited to 1.5; a valley has no summit.
    #[test]
    fn a_newton_step_leads_to_the_summit() {
        let hill = |[x, y, z]: [f32; 3]| {
            let squares = [x - 0.5, y + 0.25, z - 0.1].map(|off| off * off);
            7.0 - squares[0] - 2.0 * squares[1] - 4.0 * squares[2]
        };
        let step = newton_step(hill);
        assert!(is_near(step, [0.5, -0.25, 0.1]), "{step:?}");
        let far = newton_step(|[x, y, z]| -(x - 9.0) * (x - 9.0) - (y + 9.0) * (y + 9.0) - z * z);
        assert!(is_near(far, [1.5, -1.5, 0.0]), "{far:?}");
        assert_eq!(newton_step(|[x, y, z]| x * x + y * y + z * z), None);
    }

    /// The summit of x - x^2 - y^2 - z^2 + x y. Half of the cross term counts, so that 2 x - y / 2
    /// = 1 and 2 y = x / 2: x is 8/15 and y 2/15. The same holds for the other two pairs.
    #[test]
    fn half_of_a_cross_term_counts() {
        for (one, other) in [(0, 1), (0, 2), (1, 2)] {
            let step = newton_step(|at| {
                let squares: f32 = at.iter().map(|along| along * along).sum();
                at[one] - squares + at[one] * at[other]
            });
            let mut expected = [0.0; 3];
            (expected[one], expected[other]) = (8.0 / 15.0, 2.0 / 15.0);
            assert!(is_near(step, expected), "{one} {other} {step:?}");
        }
    }

    /// Weights of 64 for a point a quarter into its cell: 48^2 / 128 = 18 and 16^2 / 128 = 2 for
    /// the two neighbours, and the rest for the cell. At the border both cells have half.
    #[test]
    fn the_splines_weights_are_squares() {
        let at = |part: i32| spline(part << (CELL_BITS - FRACTION_BITS));
        assert_eq!(
            [at(0), at(16), at(48)],
            [[32, 32, 0], [18, 44, 2], [2, 44, 18]]
        );
        assert_eq!(at(64 + 16), at(16));
    }

    /// The points are in sixteenths of a cell. (48, -64) is 5 cells away, a 3-4-5 triangle, and (0,
    /// 16) is 1 cell away: the mean is 3 cells.
    #[test]
    fn the_mean_reach_is_in_cells() {
        assert_eq!(mean_reach_cells(&[[48, -64], [0, 16]]), 3.0);
        assert_eq!(mean_reach_cells(&[]), 0.0);
    }
}
