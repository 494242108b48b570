//! Search for the few walls that a ray can meet.
//!
//! The floor is divided into square cells, each with the primitives that enter it. A ray goes from
//! cell to cell and stops in the first cell with a hit. When filled, cells are a micrometre wider
//! than they look, so rounding can never make the walk skip a wall. A ring of cells around the grid
//! ends the walk.
//!
//! The result is the same as that of a test of every primitive, to the last bit.

use super::bundle::{Beam, Bundle, single, tolerance};
use super::geometry::{Bounds, Crossing, Point, Primitive, Ray};

/// Side of a cell in a flat. By the ray bench 0.4 m to 0.6 m are equally quick, 0.25 m and 1 m are
/// slower by a fifth.
const CELL_M: f64 = 0.5;
/// Cells along one axis at most; larger scenes get larger cells.
const CELLS_MAX: f64 = 128.0;
/// Margin of the cells against rounding, see the module's text.
const MARGIN_M: f64 = 1e-6;
/// A direction component below this never changes the cell; the drift stays below the margin.
const STILL: f64 = 1e-10;
/// Marks the cells of the ring.
const END: u32 = u32::MAX;

/// The index over the fixtures of a scene.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    /// Corner of the ring with the least coordinates.
    corner: Point,
    cell_m: f64,
    per_metre: f64,
    /// Number of columns, including the ring.
    columns: i32,
    rows: i32,
    /// Maximum distance of two positions in the grid, metres.
    extent_m: f64,
    /// The first bundle of each cell, row by row, then the bundles that did not fit.
    bundles: Vec<Bundle>,
}

impl Grid {
    pub(super) fn new(primitives: &[Primitive], bounds: Bounds) -> Self {
        let width = bounds.max.x - bounds.min.x + 4.0 * MARGIN_M;
        let height = bounds.max.y - bounds.min.y + 4.0 * MARGIN_M;
        let cell_m = CELL_M.max(width.max(height) / CELLS_MAX);
        let inset = cell_m + 2.0 * MARGIN_M;
        let columns = whole(width / cell_m) + 3;
        let rows = whole(height / cell_m) + 3;
        let mut grid = Self {
            corner: Point::new(bounds.min.x - inset, bounds.min.y - inset),
            cell_m,
            per_metre: 1.0 / cell_m,
            columns,
            rows,
            extent_m: f64::from(columns + rows) * cell_m,
            bundles: vec![Bundle::empty(); slot(columns * rows)],
        };
        for (index, primitive) in (0..).zip(primitives) {
            grid.insert(index, primitive);
        }
        for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
            if x == 0 || y == 0 || x == columns - 1 || y == rows - 1 {
                grid.bundles[slot(y * columns + x)].next = END;
            }
        }
        grid
    }

    /// The primitive that `ray` meets first within `limit`. At equal distances, the one with the
    /// lowest index.
    #[inline]
    pub(super) fn cross(
        &self,
        primitives: &[Primitive],
        ray: Ray,
        limit: f64,
    ) -> Option<(usize, Crossing)> {
        let mut walk = Walk::new(self, ray, limit)?;
        let entered = walk.entered;
        let beam = Beam::new(ray, entered, self.corner);
        let mut best = Best {
            distance: limit,
            incidence: 0.0,
            index: NOTHING,
        };
        loop {
            let exit = walk.exit();
            let within = single(
                (if best.distance < exit {
                    best.distance
                } else {
                    exit
                }) - entered,
            );
            let mut bundle = &self.bundles[slot(walk.cell)];
            loop {
                let [a, b, c, d] = bundle.screen(&beam, within);
                if a | b | c | d {
                    best.try_lane(a, 0, bundle, primitives, ray);
                    best.try_lane(b, 1, bundle, primitives, ray);
                    best.try_lane(c, 2, bundle, primitives, ray);
                    best.try_lane(d, 3, bundle, primitives, ray);
                }
                match bundle.next {
                    0 => break,
                    END => return best.found(),
                    next => bundle = &self.bundles[next as usize],
                }
            }
            if best.distance <= exit {
                return best.found();
            }
            walk.step();
        }
    }

    /// Calls `visit` for every primitive that may be within `reach` of `point`, possibly more
    /// than once.
    pub(super) fn each_near(&self, point: Point, reach: f64, mut visit: impl FnMut(usize)) {
        for cell in self.cells(Bounds::around(point, reach)) {
            let mut at = cell;
            while at != END {
                let bundle = &self.bundles[at as usize];
                bundle.indices().for_each(&mut visit);
                at = if bundle.next == 0 { END } else { bundle.next };
            }
        }
    }

    /// Cells inside the ring that lie within `bounds`.
    fn cells(&self, bounds: Bounds) -> impl Iterator<Item = u32> + use<> {
        let column = |x: f64| whole((x - self.corner.x) * self.per_metre);
        let row = |y: f64| whole((y - self.corner.y) * self.per_metre);
        let columns = column(bounds.min.x).max(1)..=column(bounds.max.x).min(self.columns - 2);
        let rows = row(bounds.min.y).max(1)..=row(bounds.max.y).min(self.rows - 2);
        let width = self.columns;
        rows.flat_map(move |y| {
            columns
                .clone()
                .map(move |x| (y * width + x).cast_unsigned())
        })
    }

    fn insert(&mut self, index: u32, primitive: &Primitive) {
        let tolerance = tolerance(self.extent_m);
        let bounds = primitive.bounds().grown(MARGIN_M);
        for cell in self.cells(bounds) {
            let (x, y) = (
                cell.cast_signed() % self.columns,
                cell.cast_signed() / self.columns,
            );
            let center = Point::new(
                self.corner.x + (f64::from(x) + 0.5) * self.cell_m,
                self.corner.y + (f64::from(y) + 0.5) * self.cell_m,
            );
            if !primitive.enters(center, 0.5 * self.cell_m + MARGIN_M) {
                continue;
            }
            let mut at = cell as usize;
            while self.bundles[at].next != 0 {
                at = self.bundles[at].next as usize;
            }
            if !self.bundles[at].add(index, primitive, self.corner, tolerance) {
                let next = self.bundles.len();
                self.bundles[at].next = u32::try_from(next).expect("bounded by the scene's limit");
                self.bundles.push(Bundle::empty());
                self.bundles[next].add(index, primitive, self.corner, tolerance);
            }
        }
    }
}

/// No primitive.
const NOTHING: usize = usize::MAX;

/// The nearest crossing so far; plain numbers, which stay in registers.
struct Best {
    distance: f64,
    incidence: f64,
    index: usize,
}

impl Best {
    #[inline(always)]
    fn try_lane(
        &mut self,
        passed: bool,
        lane: usize,
        bundle: &Bundle,
        primitives: &[Primitive],
        ray: Ray,
    ) {
        if !passed {
            return;
        }
        let index = bundle.index(lane);
        let Some(found) = primitives[index].cross(ray, self.distance) else {
            return;
        };
        if found.distance < self.distance || index < self.index {
            *self = Self {
                distance: found.distance,
                incidence: found.incidence,
                index,
            };
        }
    }

    fn found(self) -> Option<(usize, Crossing)> {
        let crossing = Crossing {
            distance: self.distance,
            incidence: self.incidence,
        };
        (self.index != NOTHING).then_some((self.index, crossing))
    }
}

/// The walk of a ray through the grid.
struct Walk {
    /// Current cell; a signed number, because the walk goes up and down.
    cell: i32,
    /// Distance along the ray at which it entered the grid; 0 if it began inside.
    entered: f64,
    /// Distance at which it leaves the present column and row.
    exit_x: f64,
    exit_y: f64,
    /// Distance along the ray from one column or row to the next.
    across_x: f64,
    across_y: f64,
    step_x: i32,
    step_y: i32,
}

impl Walk {
    /// `None` if the ray misses the grid, or reaches it only beyond `limit`.
    #[inline]
    fn new(grid: &Grid, ray: Ray, limit: f64) -> Option<Self> {
        let mut x = (ray.from.x - grid.corner.x) * grid.per_metre;
        let mut y = (ray.from.y - grid.corner.y) * grid.per_metre;
        let (right, top) = (f64::from(grid.columns - 1), f64::from(grid.rows - 1));
        let mut entered = 0.0;
        if !(x >= 1.0 && x < right && y >= 1.0 && y < top) {
            let (dx, dy) = (ray.dir.x * grid.per_metre, ray.dir.y * grid.per_metre);
            entered = entry([(x, dx, right), (y, dy, top)])?;
            x = (x + dx * entered).clamp(1.0, right - 1e-9);
            y = (y + dy * entered).clamp(1.0, top - 1e-9);
        }
        if entered > limit {
            return None;
        }
        let (column, row) = (whole_positive(x), whole_positive(y));
        let (to_x, across_x) = Self::axis(x - f64::from(column), ray.dir.x, grid.cell_m);
        let (to_y, across_y) = Self::axis(y - f64::from(row), ray.dir.y, grid.cell_m);
        Some(Self {
            cell: row * grid.columns + column,
            entered,
            exit_x: entered + to_x,
            exit_y: entered + to_y,
            across_x,
            across_y,
            step_x: if ray.dir.x > 0.0 { 1 } else { -1 },
            step_y: if ray.dir.y > 0.0 {
                grid.columns
            } else {
                -grid.columns
            },
        })
    }

    /// Distance to the edge of the present cell, and from edge to edge. `part` is the ray's start
    /// within the cell, 0 to 1.
    #[inline]
    fn axis(part: f64, direction: f64, cell_m: f64) -> (f64, f64) {
        let across = cell_m / direction.abs().max(STILL);
        (
            if direction > 0.0 {
                (1.0 - part) * across
            } else {
                part * across
            },
            across,
        )
    }

    /// Distance at which the ray leaves the cell.
    #[inline]
    fn exit(&self) -> f64 {
        if self.exit_x < self.exit_y {
            self.exit_x
        } else {
            self.exit_y
        }
    }

    #[inline]
    fn step(&mut self) {
        let sideways = self.exit_x < self.exit_y;
        self.cell += if sideways { self.step_x } else { self.step_y };
        self.exit_x += if sideways { self.across_x } else { 0.0 };
        self.exit_y += if sideways { 0.0 } else { self.across_y };
    }
}

/// Distance at which a ray from outside enters the grid, for both axes in cells: its start, its
/// progress per metre, and the end of the grid, which begins at 1.
#[cold]
fn entry(axes: [(f64, f64, f64); 2]) -> Option<f64> {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for (start, per_metre, end) in axes {
        let inside = (1.0..=end).contains(&start);
        if per_metre.abs() < STILL {
            if !inside {
                return None;
            }
            continue;
        }
        let (one, other) = ((1.0 - start) / per_metre, (end - start) / per_metre);
        enter = enter.max(one.min(other));
        leave = leave.min(one.max(other));
    }
    (enter <= leave).then_some(enter)
}

/// Rounds down.
fn whole(value: f64) -> i32 {
    whole_positive(value.floor())
}

/// Rounds towards zero, which is quicker.
#[inline]
fn whole_positive(value: f64) -> i32 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "saturates; callers stay in the grid"
    )]
    let whole = value as i32;
    whole
}

#[inline]
fn slot(cell: i32) -> usize {
    cell.cast_unsigned() as usize
}

#[cfg(test)]
mod tests {
    use super::super::geometry::{Circle, Segment};
    use super::*;
    use proptest::prelude::*;

    /// The specification in three lines: test every primitive and keep the nearest, or the first of
    /// equally near ones.
    fn naive(primitives: &[Primitive], ray: Ray, limit: f64) -> Option<(usize, Crossing)> {
        let all = primitives
            .iter()
            .map(|primitive| primitive.cross(ray, limit))
            .enumerate();
        let hits = all.filter_map(|(index, crossing)| Some((index, crossing?)));
        hits.reduce(|a, b| if b.1.distance < a.1.distance { b } else { a })
    }

    fn bounds(primitives: &[Primitive]) -> Bounds {
        primitives
            .iter()
            .map(Primitive::bounds)
            .reduce(Bounds::union)
            .unwrap()
    }

    /// Coordinates on a coarse lattice, so that corners meet, walls overlap, rays run along cell
    /// edges and through corners; and a few anywhere.
    fn coordinate() -> impl Strategy<Value = f64> {
        prop_oneof![
            3 => (-12..=12_i32).prop_map(|step| f64::from(step) * 0.25),
            1 => -3.0..3.0_f64,
            1 => -900.0..900.0_f64,
        ]
    }

    fn point() -> impl Strategy<Value = Point> {
        (coordinate(), coordinate()).prop_map(|(x, y)| Point::new(x, y))
    }

    fn primitive() -> impl Strategy<Value = Primitive> {
        let wall = (point(), point()).prop_filter_map("no length", |(a, b)| {
            Segment::new(a, b).map(Primitive::Segment)
        });
        let circle = (point(), prop_oneof![Just(0.25), 0.005..1.5_f64])
            .prop_map(|(center, radius)| Primitive::Circle(Circle { center, radius }));
        prop_oneof![3 => wall, 1 => circle]
    }

    fn angle() -> impl Strategy<Value = f64> {
        let eighth = core::f64::consts::FRAC_PI_4;
        prop_oneof![
            (-8..=8_i32).prop_map(move |n| f64::from(n) * eighth),
            -4.0..4.0_f64
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8 * ProptestConfig::default().cases))]

        #[test]
        fn the_grid_finds_what_testing_everything_finds(
            primitives in prop::collection::vec(primitive(), 1..60),
            from in point(),
            angle in angle(),
            limit in prop_oneof![Just(6.0), Just(f64::INFINITY), 0.0..3000.0_f64],
        ) {
            let grid = Grid::new(&primitives, bounds(&primitives));
            let ray = Ray::new(from, angle);
            prop_assert_eq!(grid.cross(&primitives, ray, limit), naive(&primitives, ray, limit));
        }

        #[test]
        fn no_near_primitive_is_overlooked(
            primitives in prop::collection::vec(primitive(), 1..60),
            from in point(),
            reach in 0.0..3.0_f64,
        ) {
            let grid = Grid::new(&primitives, bounds(&primitives));
            let mut seen = vec![];
            grid.each_near(from, reach, |index| seen.push(index));
            let near = |index: &usize| primitives[*index].nearest(from).1 <= reach;
            let missed: Vec<_> =
                (0..primitives.len()).filter(near).filter(|i| !seen.contains(i)).collect();
            prop_assert!(missed.is_empty(), "{:?}", missed);
        }
    }

    #[test]
    fn rays_without_a_number_hit_nothing() {
        let primitives = [Primitive::Circle(Circle {
            center: Point::default(),
            radius: 1.0,
        })];
        let grid = Grid::new(&primitives, bounds(&primitives));
        let from = Point::new(f64::NAN, 0.0);
        assert_eq!(grid.cross(&primitives, Ray::new(from, 0.0), 6.0), None);
        assert_eq!(
            grid.cross(&primitives, Ray::new(Point::default(), f64::NAN), 6.0),
            None
        );
    }

    /// A search of any radius ends at the edge of the grid and finds all primitives in it.
    #[test]
    fn a_look_around_ends_with_the_grid() {
        let corners = [(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0)];
        let pillars = corners.map(|(x, y)| {
            let center = Point::new(x, y);
            Primitive::Circle(Circle {
                center,
                radius: 0.1,
            })
        });
        let grid = Grid::new(&pillars, bounds(&pillars));
        let seen = |x: f64, y: f64, reach: f64| {
            let mut seen = [false; 4];
            grid.each_near(Point::new(x, y), reach, |index| seen[index] = true);
            seen
        };
        for (index, (x, y)) in corners.into_iter().enumerate() {
            let mut own = [false; 4];
            own[index] = true;
            assert_eq!(seen(x, y, 0.1), own);
            assert_eq!(seen(x, y, 90.0), [true; 4]);
        }
        assert_eq!(seen(2.0, 1.0, 0.2), [false; 4]);
        assert_eq!(seen(-90.0, 1.0, 1.0), [false; 4]);
        assert_eq!(seen(2.0, 90.0, 1.0), [false; 4]);
    }

    /// The ray starts a quarter into a cell of half a metre: three quarters remain ahead and a
    /// quarter behind. With half a metre of progress per metre, the distances are twice as long.
    /// Along the other axis the ray never leaves the cell.
    #[test]
    fn a_cell_is_left_at_the_side_that_the_ray_goes_to() {
        assert_eq!(Walk::axis(0.25, 1.0, 0.5), (0.375, 0.5));
        assert_eq!(Walk::axis(0.25, -1.0, 0.5), (0.125, 0.5));
        assert_eq!(Walk::axis(0.25, 0.5, 0.5), (0.75, 1.0));
        assert_eq!(Walk::axis(0.25, -0.5, 0.5), (0.25, 1.0));
        let (to, across) = Walk::axis(0.25, 0.0, 0.5);
        assert!((1e9..2e9).contains(&to) && (4e9..6e9).contains(&across));
    }

    /// Two walls along the sides of 4 m by 2 m: cells of half a metre, 9 by 5 of them, and a ring
    /// around them. The ring is half a metre wide, so (1.2, 0.7) lies in column 3 and row 2 of 11.
    #[test]
    fn a_place_lies_in_its_cells() {
        let wall = |x: f64, y: f64| {
            let wall = Segment::new(Point::default(), Point::new(x, y)).expect("long");
            Primitive::Segment(wall)
        };
        let walls = [wall(4.0, 0.0), wall(0.0, 2.0)];
        let grid = Grid::new(&walls, bounds(&walls));
        assert_eq!((grid.columns, grid.rows, grid.cell_m), (11, 7, 0.5));
        let cells = |x: f64, y: f64, reach: f64| -> Vec<u32> {
            grid.cells(Bounds::around(Point::new(x, y), reach))
                .collect()
        };
        assert_eq!(cells(1.2, 0.7, 0.1), [25]);
        assert_eq!(cells(1.2, 0.7, 0.25), [13, 14, 24, 25]);
        // The corners of the grid, within the ring.
        assert_eq!(cells(-0.2, -0.2, 0.25), [12]);
        assert_eq!(cells(4.3, 2.3, 0.1), [5 * 11 + 9]);
        assert_eq!(cells(2.0, 1.0, 90.0).len(), 45);
        // Larger scenes have larger cells: 640 m by 128.
        let far = [wall(640.0, 0.0), wall(0.0, 64.0)];
        let grid = Grid::new(&far, bounds(&far));
        assert!((grid.cell_m - 5.0).abs() < 1e-6 && (grid.per_metre - 0.2).abs() < 1e-6);
        assert!((130..=131).contains(&grid.columns) && (15..=16).contains(&grid.rows));
    }

    /// From column 0, at half a column a metre, the grid begins after 2 m; from row 14, backwards,
    /// after 2 m at two rows a metre, and ends after 6.5 m.
    #[test]
    fn a_ray_enters_the_grid_at_its_later_side() {
        assert_eq!(entry([(0.0, 0.5, 9.0), (5.0, 0.0, 10.0)]), Some(2.0));
        assert_eq!(entry([(5.0, 0.0, 9.0), (14.0, -2.0, 10.0)]), Some(2.0));
        assert_eq!(entry([(0.0, 0.25, 9.0), (14.0, -2.0, 10.0)]), Some(4.0));
        assert_eq!(entry([(0.0, 0.125, 9.0), (14.0, -2.0, 10.0)]), None);
        // Beside the grid, and away from it.
        assert_eq!(entry([(0.5, 0.0, 9.0), (5.0, 1.0, 10.0)]), None);
        assert_eq!(entry([(9.5, 0.0, 9.0), (5.0, 1.0, 10.0)]), None);
        assert_eq!(entry([(0.0, -0.5, 9.0), (5.0, 0.0, 10.0)]), None);
        // So slow that it stays in its column, and just not.
        assert_eq!(entry([(0.0, 0.5 * STILL, 9.0), (5.0, 0.0, 9.0)]), None);
        assert_eq!(entry([(0.0, STILL, 9.0), (5.0, 0.0, 9.0)]), Some(1e10));
        // The sides of the grid belong to it.
        assert_eq!(entry([(1.0, 0.0, 9.0), (9.0, -1.0, 8.0)]), Some(1.0));
        assert_eq!(entry([(9.0, 0.0, 9.0), (9.0, -1.0, 8.0)]), Some(1.0));
    }
}
