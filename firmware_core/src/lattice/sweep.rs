//! Cells that a primitive passes: those of the reference point and those that the outline sweeps.

use alloc::vec::Vec;

use super::primitives::{Primitive, PrimitiveSet};
use crate::ackermann::wrapped;
use crate::costmap::{Costmap, INSCRIBED, LETHAL};

/// A robot's outline: a convex polygon around its reference point, metres, x ahead and y to the
/// left.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline(Vec<[f64; 2]>);

impl Outline {
    /// A rectangle with these distances from the reference point ahead, behind and to each side.
    pub fn rectangle(ahead_m: f64, behind_m: f64, side_m: f64) -> Self {
        Self(alloc::vec![
            [ahead_m, side_m],
            [-behind_m, side_m],
            [-behind_m, -side_m],
            [ahead_m, -side_m],
        ])
    }

    /// Whether the outline at this pose overlaps the square of side `edge_m` around `middle_m`;
    /// sides that only touch do not.
    pub fn overlaps(&self, pose: [f64; 3], middle_m: [f64; 2], edge_m: f64) -> bool {
        Placed::new(self, pose, edge_m).overlaps(middle_m)
    }

    /// Cells of `cell_m` that the outline covers or cuts at this pose, relative to the cell with
    /// the coordinates' origin in its middle, without those already `known`.
    fn cells(
        &self,
        pose: [f64; 3],
        cell_m: f64,
        known: impl Fn([i32; 2]) -> bool,
    ) -> impl Iterator<Item = [i32; 2]> {
        let placed = Placed::new(self, pose, cell_m);
        // The last two axes are x and y.
        let range = |axis: usize| {
            let [low, high] = placed.spans[placed.spans.len() - 2 + axis].outline;
            #[expect(clippy::cast_possible_truncation, reason = "saturates")]
            let cells = (
                libm::floor(low / cell_m) as i32,
                libm::ceil(high / cell_m) as i32,
            );
            cells.0..=cells.1
        };
        let xs = range(0);
        let cells = range(1).flat_map(move |y| xs.clone().map(move |x| [x, y]));
        let overlaps = move |cell: [i32; 2]| placed.overlaps(cell.map(|at| f64::from(at) * cell_m));
        cells.filter(move |cell| !known(*cell) && overlaps(*cell))
    }

    /// Largest distance of the outline from the reference point, in cells, rounded up.
    fn reach(&self, cell_m: f64) -> i32 {
        let far = |[ahead, left]: &[f64; 2]| libm::hypot(*ahead, *left);
        let farthest = self.0.iter().map(far).fold(0.0, f64::max);
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let cells = libm::ceil(farthest / cell_m) as i32;
        cells
    }
}

/// Cells around a motion, and the cells that the outline sweeps. Most cells are swept at many of
/// the poses, so they are marked.
struct Swept {
    low: [i32; 2],
    /// Cells along y.
    height: i32,
    /// Column by column.
    cells: Vec<Cell>,
}

#[derive(Clone, Copy, PartialEq)]
enum Cell {
    Open,
    /// Swept, and not covered at the start.
    Swept,
    Covered,
}

impl Swept {
    /// Empty marks for all cells that an outline with this `reach` can touch from `poses`, except
    /// those `covered` at the first pose.
    fn new(poses: &[[f64; 3]], cell_m: f64, reach: i32, covered: &[[i32; 2]]) -> Self {
        let along = |axis: usize| poses.iter().map(move |pose| pose[axis] / cell_m);
        // One more cell on either side for the rounding of the reach and of the cells.
        let [low, high] = [
            [0, 1].map(|axis| along(axis).fold(0.0, f64::min)),
            [0, 1].map(|axis| along(axis).fold(0.0, f64::max)),
        ];
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let (low, high) = (
            low.map(|at| libm::floor(at) as i32 - reach - 1),
            high.map(|at| libm::ceil(at) as i32 + reach + 1),
        );
        let [width, height] = [0, 1].map(|axis| high[axis] - low[axis] + 1);
        let len = usize::try_from(width.saturating_mul(height)).unwrap_or_default();
        let mut swept = Self {
            low,
            height,
            cells: alloc::vec![Cell::Open; len],
        };
        covered
            .iter()
            .for_each(|cell| swept.mark(*cell, Cell::Covered));
        swept
    }

    fn index(&self, [x, y]: [i32; 2]) -> usize {
        let index = (x - self.low[0]) * self.height + y - self.low[1];
        usize::try_from(index).unwrap_or(usize::MAX)
    }

    fn mark(&mut self, cell: [i32; 2], as_what: Cell) {
        let index = self.index(cell);
        if let Some(slot) = self.cells.get_mut(index) {
            *slot = as_what;
        }
    }

    fn add(&mut self, outline: &Outline, pose: [f64; 3], cell_m: f64) {
        let known = |cell| self.cells.get(self.index(cell)) != Some(&Cell::Open);
        let new: Vec<[i32; 2]> = outline.cells(pose, cell_m, known).collect();
        new.into_iter()
            .for_each(|cell| self.mark(cell, Cell::Swept));
    }

    fn into_cells(self) -> Vec<[i32; 2]> {
        let indices = (0..).zip(&self.cells);
        let swept = indices.filter(|(_, cell)| **cell == Cell::Swept);
        let place = |index: i32| [index / self.height, index % self.height];
        let cells = swept.map(|(index, _)| place(index));
        cells
            .map(|[x, y]| [x + self.low[0], y + self.low[1]])
            .collect()
    }
}

/// An outline at a pose, and a square of fixed size at any position. Two convex shapes are apart if
/// one shape is completely beyond a side of the other shape.
struct Placed {
    /// Spans along the normals of the outline's sides, then along x and y.
    spans: Vec<Span>,
}

struct Span {
    normal: [f64; 2],
    /// Interval of the outline.
    outline: [f64; 2],
    /// Half of the square, less the tolerance of a touch.
    half: f64,
}

impl Placed {
    fn new(outline: &Outline, [x, y, heading]: [f64; 3], edge_m: f64) -> Self {
        let (sin, cos) = libm::sincos(heading);
        let place =
            |[ahead, left]: &[f64; 2]| [x + cos * ahead - sin * left, y + sin * ahead + cos * left];
        let corners: Vec<[f64; 2]> = outline.0.iter().map(place).collect();
        let next = corners.iter().cycle().skip(1);
        let sides = corners.iter().zip(next);
        let normals = sides.map(|([x0, y0], [x1, y1])| [y1 - y0, x0 - x1]);
        let span = |normal: [f64; 2]| {
            let along = corners.iter().map(|[x, y]| x * normal[0] + y * normal[1]);
            let outline = along.fold([f64::MAX, f64::MIN], |[low, high], value| {
                [low.min(value), high.max(value)]
            });
            let touch = 1e-9 * edge_m * libm::hypot(normal[0], normal[1]);
            let half = edge_m / 2.0 * (normal[0].abs() + normal[1].abs()) - touch;
            Span {
                normal,
                outline,
                half,
            }
        };
        let axes = [[1.0, 0.0], [0.0, 1.0]];
        Self {
            spans: normals.chain(axes).map(span).collect(),
        }
    }

    fn overlaps(&self, [x, y]: [f64; 2]) -> bool {
        self.spans.iter().all(|span| {
            let middle = x * span.normal[0] + y * span.normal[1];
            let [low, high] = span.outline;
            middle - span.half < high && middle + span.half > low
        })
    }
}

/// A primitive with the data that the search needs.
#[derive(Clone, Debug)]
pub(super) struct Action {
    /// Index in [`PrimitiveSet::all`].
    pub(super) primitive: usize,
    pub(super) end: [i32; 2],
    pub(super) end_angle: u32,
    pub(super) base_cost: u32,
    /// Cells of the reference point after the first one.
    middle: Vec<[i32; 2]>,
    /// Cells that the outline sweeps beyond those it covers at the start.
    swept: Vec<[i32; 2]>,
}

/// Primitives and an outline: the basis of plans.
#[derive(Clone, Debug)]
pub struct Lattice {
    set: PrimitiveSet,
    /// Actions by heading; primitives equal to another one are left out.
    actions: Vec<Vec<Action>>,
    /// Cells of the outline at rest, by heading.
    at_rest: Vec<Vec<[i32; 2]>>,
    /// Maximum ratio of the path through cells to the path itself.
    detour: f64,
}

impl Lattice {
    /// A lattice for a robot of this outline; the primitives move its reference point.
    pub fn new(set: PrimitiveSet, outline: &Outline) -> Self {
        let cell_m = set.resolution_m();
        let at_rest = (0..set.angles()).map(|angle| {
            let pose = [0.0, 0.0, set.heading_rad(angle)];
            outline.cells(pose, cell_m, |_| false).collect()
        });
        let at_rest: Vec<Vec<[i32; 2]>> = at_rest.collect();
        let mut actions: Vec<Vec<Action>> = Vec::new();
        let mut detour = 1.0_f64;
        for angle in 0..set.angles() {
            let mut of_angle: Vec<Action> = Vec::new();
            let covered = &at_rest[angle as usize];
            for (primitive, one) in set.all().iter().enumerate() {
                if one.start != angle {
                    continue;
                }
                let action = action(primitive, one, outline, cell_m, covered);
                detour = detour.max(octile(&action.middle) * cell_m / one.length_m().max(1e-9));
                let is_same = |known: &Action| {
                    (known.end, known.end_angle) == (action.end, action.end_angle)
                        && known.base_cost <= action.base_cost
                        && known.middle == action.middle
                };
                if !of_angle.iter().any(is_same) {
                    of_angle.push(action);
                }
            }
            actions.push(of_angle);
        }
        Self {
            set,
            actions,
            at_rest,
            detour,
        }
    }

    /// The primitives.
    pub const fn set(&self) -> &PrimitiveSet {
        &self.set
    }

    pub(super) fn actions(&self, angle: u32) -> &[Action] {
        &self.actions[angle as usize]
    }

    pub(super) const fn detour(&self) -> f64 {
        self.detour
    }

    /// Whether the robot can be in this cell with this heading.
    pub fn is_free(&self, map: &Costmap, [x, y]: [i32; 2], angle: u32) -> bool {
        let outline = self.at_rest.get(angle as usize);
        map.cost([x, y]) < INSCRIBED
            && outline.is_some_and(|cells| {
                let mut cells = cells.iter();
                cells.all(|[dx, dy]| !map.is_obstacle([x + dx, y + dy]))
            })
    }
}

impl Action {
    /// Cost of the motion from the cell `from`; `None` if the robot would touch an obstacle.
    pub(super) fn cost(&self, map: &Costmap, from: [i32; 2]) -> Option<u32> {
        let at = |[dx, dy]: [i32; 2]| [from[0].wrapping_add(dx), from[1].wrapping_add(dy)];
        let mut dearest = map.cost(from);
        for cell in &self.middle {
            let cost = map.cost(at(*cell));
            if cost >= INSCRIBED {
                return None;
            }
            dearest = dearest.max(cost);
        }
        // Far from all obstacles the outline is free if its middle is.
        if dearest > 0 {
            for cell in &self.swept {
                let cost = map.cost(at(*cell));
                if cost >= LETHAL {
                    return None;
                }
                dearest = dearest.max(cost.min(INSCRIBED - 1));
            }
        }
        Some(self.base_cost.saturating_mul(1 + u32::from(dearest)))
    }
}

fn action(
    primitive: usize,
    one: &Primitive,
    outline: &Outline,
    cell_m: f64,
    covered: &[[i32; 2]],
) -> Action {
    let mut middle = Vec::new();
    let way = on_the_way(&one.poses, cell_m / 4.0);
    let mut swept = Swept::new(&way, cell_m, outline.reach(cell_m), covered);
    for pose in way {
        let cell = [pose[0], pose[1]].map(|m| {
            #[expect(clippy::cast_possible_truncation, reason = "saturates")]
            let cell = libm::floor(m / cell_m + 0.5) as i32;
            cell
        });
        if middle.last().copied().unwrap_or_default() != cell {
            middle.push(cell);
        }
        swept.add(outline, pose, cell_m);
    }
    Action {
        primitive,
        end: one.end.0,
        end_angle: one.end.1,
        base_cost: one.base_cost(),
        middle,
        swept: swept.into_cells(),
    }
}

/// The poses, with others in between so that neighbours are at most `step_m` apart.
fn on_the_way(poses: &[[f64; 3]], step_m: f64) -> Vec<[f64; 3]> {
    let mut all: Vec<[f64; 3]> = poses.first().copied().into_iter().collect();
    for pair in poses.windows(2) {
        let [x, y] = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
        let turn = wrapped(pair[1][2] - pair[0][2]);
        let parts = libm::ceil(libm::hypot(x, y) / step_m).clamp(1.0, 1e4);
        let mut part = 1.0;
        while part <= parts {
            let share = part / parts;
            all.push([
                pair[0][0] + x * share,
                pair[0][1] + y * share,
                pair[0][2] + turn * share,
            ]);
            part += 1.0;
        }
    }
    all
}

/// Length of the path from the cell 0, 0 through these cells, in cells.
fn octile(cells: &[[i32; 2]]) -> f64 {
    let (mut from, mut length) = ([0, 0], 0.0);
    for cell in cells {
        let [dx, dy] = [0, 1].map(|axis: usize| f64::from((cell[axis] - from[axis]).abs()));
        length += dx.max(dy) + (core::f64::consts::SQRT_2 - 1.0) * dx.min(dy);
        from = *cell;
    }
    length
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::costmap::Inflation;

    fn cells(map: &[(i32, i32)]) -> Vec<[i32; 2]> {
        map.iter().map(|&(x, y)| [x, y]).collect()
    }

    /// An outline 2 m long and 1 m wide at (10, 5), unturned and turned by a quarter: squares of
    /// 0.4 m with middles 1.2 m and 0.7 m away only touch.
    #[test]
    fn an_outline_overlaps_what_is_nearer_than_half_of_both() {
        let outline = Outline::rectangle(1.0, 1.0, 0.5);
        let overlaps = |heading: f64, dx: f64, dy: f64| {
            outline.overlaps([10.0, 5.0, heading], [10.0 + dx, 5.0 + dy], 0.4)
        };
        let quarter = core::f64::consts::FRAC_PI_2;
        for side in [-1.0, 1.0] {
            assert!(overlaps(0.0, 1.19 * side, 0.0) && overlaps(0.0, 0.3, 0.69 * side));
            assert!(!overlaps(0.0, 1.21 * side, 0.0) && !overlaps(0.0, 0.3, 0.71 * side));
            assert!(overlaps(quarter, 0.69 * side, 0.3) && overlaps(quarter, 0.3, 1.19 * side));
            assert!(!overlaps(quarter, 0.71 * side, 0.3) && !overlaps(quarter, 0.3, 1.21 * side));
            assert!(!overlaps(0.0, 1.2 * side, 0.0) && !overlaps(0.0, 0.0, 0.7 * side));
        }
        // Turned by an eighth, the corner is 1.5 / sqrt(2) = 1.0607 away along both axes, and the
        // long side 0.5 m. A square that is 0.2 * sqrt(2) wide in that direction reaches to 0.7828.
        let eighth = core::f64::consts::FRAC_PI_4;
        let across = 0.782 / core::f64::consts::SQRT_2;
        assert!(overlaps(eighth, across, -across) && !overlaps(eighth, 0.555, -0.555));
        assert!(overlaps(eighth, 0.35, 1.25) && !overlaps(eighth, 0.35, 1.27));
        // The extents ahead and behind, and those to the left and right, differ.
        let outline = Outline::rectangle(2.0, 0.5, 0.25);
        let overlaps = |dx, dy| outline.overlaps([0.0; 3], [dx, dy], 0.2);
        assert!(overlaps(2.09, 0.0) && !overlaps(2.11, 0.0) && overlaps(-0.59, 0.34));
        assert!(!overlaps(-0.61, 0.0) && !overlaps(0.0, 0.36) && !overlaps(0.0, -0.36));
    }

    /// A rectangle of 0.3 m by 0.1 m around the middle of a cell of 0.1 m covers five by three
    /// cells; the cells at its edge are cut in half. At rest it reaches 0.158 m, two cells.
    #[test]
    fn an_outline_covers_and_cuts_cells() {
        let outline = Outline::rectangle(0.16, 0.16, 0.06);
        let covered: Vec<[i32; 2]> = outline.cells([0.0; 3], 0.1, |_| false).collect();
        let expected = (-1..=1).flat_map(|y| (-2..=2).map(move |x| [x, y]));
        assert!(covered.iter().copied().eq(expected));
        let new: Vec<[i32; 2]> = outline
            .cells([0.1, 0.0, 0.0], 0.1, |at| at[0] < 3)
            .collect();
        assert_eq!(new, cells(&[(3, -1), (3, 0), (3, 1)]));
        assert_eq!((outline.reach(0.1), outline.reach(0.2)), (2, 1));
        assert_eq!(Outline::rectangle(0.3, 0.1, 0.4).reach(0.1), 5);
    }

    /// Two cells ahead: the cells that the body sweeps beyond those it covered.
    #[test]
    fn a_body_sweeps_the_cells_before_it() {
        let outline = Outline::rectangle(0.16, 0.16, 0.06);
        let covered: Vec<[i32; 2]> = outline.cells([0.0; 3], 0.1, |_| false).collect();
        let way = [[0.0; 3], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]];
        let mut swept = Swept::new(&way, 0.1, 2, &covered);
        assert_eq!(swept.low, [-3, -3]);
        way.iter().for_each(|pose| swept.add(&outline, *pose, 0.1));
        let expected = cells(&[(3, -1), (3, 0), (3, 1), (4, -1), (4, 0), (4, 1)]);
        assert_eq!(swept.into_cells(), expected);
    }

    /// 0.1 m in parts of at most 0.04 m are three; a turn on the spot is one.
    #[test]
    fn poses_on_the_way_are_near_each_other() {
        let way = on_the_way(
            &[[0.0, 0.0, 0.2], [0.06, 0.08, 0.5], [0.06, 0.08, 0.1]],
            0.04,
        );
        let expected = [
            [0.0, 0.0, 0.2],
            [0.02, 0.08 / 3.0, 0.3],
            [0.04, 0.16 / 3.0, 0.4],
            [0.06, 0.08, 0.5],
            [0.06, 0.08, 0.1],
        ];
        assert_eq!(way.len(), 5);
        for (found, expected) in way.iter().zip(expected) {
            assert!((0..3).all(|axis| (found[axis] - expected[axis]).abs() < 1e-12));
        }
        // Across half a turn in the shorter direction.
        let way = on_the_way(&[[0.0, 0.0, 3.1], [0.0, 0.08, -3.1]], 0.04);
        assert!((way[1][2] - core::f64::consts::PI).abs() < 1e-9, "{way:?}");
    }

    /// Lengths in cells: 1 for a step ahead, 1.4142 for a diagonal one, and 2.4142 for a knight's
    /// move.
    #[test]
    fn ways_through_cells_go_ahead_and_aslant() {
        let length = octile(&cells(&[(1, 0), (2, 1), (3, -1)]));
        assert!(
            (length - 2.0 - 2.0 * core::f64::consts::SQRT_2).abs() < 1e-12,
            "{length}"
        );
        assert_eq!(octile(&[]), 0.0);
    }

    /// The cost is 1 + the most expensive cell. Cells of the outline may have any cost except that
    /// of an obstacle, and are checked only where an obstacle is near.
    #[test]
    fn an_action_costs_the_dearest_cell_that_it_passes() {
        let inflation = Inflation {
            inscribed_m: 0.16,
            radius_m: 0.40,
        };
        let mut obstacles = alloc::vec![false; 40 * 21];
        obstacles[10 * 40 + 10] = true;
        let map = Costmap::new(40, 0.05, [0.0; 2], obstacles, inflation);
        let cost = |middle: &[(i32, i32)], swept: &[(i32, i32)], from| {
            let action = Action {
                primitive: 0,
                end: [0, 0],
                end_angle: 0,
                base_cost: 100,
                middle: cells(middle),
                swept: cells(swept),
            };
            action.cost(&map, from)
        };
        // Costs around the obstacle in cell 10: 19 up to three cells away, then less and less.
        let of = |x| u32::from(map.cost([x, 10]));
        assert!(of(13) == 19 && of(14) < 19 && of(16) < of(14) && of(30) == 0);
        assert_eq!(cost(&[(1, 0)], &[(9, 9)], [30, 10]), Some(100));
        assert_eq!(cost(&[(-14, 0)], &[], [30, 10]), Some(100 * (1 + of(16))));
        assert_eq!(
            cost(&[(1, 0), (4, 0)], &[], [14, 10]),
            Some(100 * (1 + of(14)))
        );
        assert_eq!(cost(&[(1, 0), (-1, 0)], &[], [14, 10]), None);
        // Cells of the outline may cost more, up to 18, but none of them is an obstacle.
        assert_eq!(
            cost(&[(1, 0)], &[(-2, 0)], [16, 10]),
            Some(100 * (1 + of(14)))
        );
        assert_eq!(cost(&[(1, 0)], &[(-3, 0)], [16, 10]), Some(100 * 19));
        assert_eq!(cost(&[(1, 0)], &[(-6, 0)], [16, 10]), None);
        assert_eq!(cost(&[(1, 0)], &[(-20, 0)], [30, 10]), Some(100));
    }

    /// A metre straight on without a pose between: in steps of a quarter of a cell no cell of the
    /// path is left out, for any cell size.
    #[test]
    fn an_action_passes_every_cell_of_its_way() {
        for cell_m in [0.05, 0.2, 1.0] {
            let one = Primitive {
                start: 0,
                end: ([10, 0], 0),
                multiplier: 1,
                poses: [[0.0; 3], [10.0 * cell_m, 0.0, 0.0]].into(),
            };
            let outline = Outline::rectangle(0.1 * cell_m, 0.1 * cell_m, 0.1 * cell_m);
            let action = action(7, &one, &outline, cell_m, &[[0, 0]]);
            let ahead: Vec<[i32; 2]> = (1..=10).map(|x| [x, 0]).collect();
            assert_eq!((action.primitive, action.end), (7, [10, 0]));
            assert_eq!((&action.middle, &action.swept), (&ahead, &ahead));
        }
    }
}
