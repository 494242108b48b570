//! Finds the few walls that a ray can meet.
//!
//! The floor is cut into square cells, each with a list of the primitives that enter it. An empty
//! cell knows how far off the nearest cell with content is, so a ray crosses open floor in a few
//! jumps and tests only what stands in its way. Cells are a micrometre wider than they look when
//! the lists are made; rounding while walking can therefore never step over a wall.

use super::geometry::{Bounds, Crossing, Point, Primitive, Ray};

/// Side of a cell in a flat. Measured with the ray bench: 5 cm and 20 cm are slower.
const CELL_M: f64 = 0.1;
/// Cells along one axis at most; larger scenes get larger cells.
const CELLS_MAX: f64 = 512.0;
/// See the module's words on rounding.
const MARGIN_M: f64 = 1e-6;
/// Farther than any grid is wide: the gap in a grid without content.
const GAP_MAX: i32 = 1 << 16;
/// A direction component below this counts as none; the drift stays below the margin.
const STILL: f64 = 1e-10;

/// The index over the fixtures of a scene.
#[derive(Debug)]
pub(super) struct Grid {
    origin: Point,
    per_metre: f64,
    columns: i32,
    rows: i32,
    cells: Vec<Cell>,
    lists: Vec<u32>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    start: u32,
    count: u32,
    /// Cells to the nearest one with content, diagonals counted as one; 0 if this has content.
    gap: i32,
}

impl Grid {
    pub(super) fn new(primitives: &[Primitive], bounds: Bounds) -> Self {
        let width = bounds.max.x - bounds.min.x + 4.0 * MARGIN_M;
        let height = bounds.max.y - bounds.min.y + 4.0 * MARGIN_M;
        let cell = CELL_M.max(width.max(height) / CELLS_MAX);
        let origin = Point::new(bounds.min.x - 2.0 * MARGIN_M, bounds.min.y - 2.0 * MARGIN_M);
        let columns = floor(width / cell) + 1;
        let rows = floor(height / cell) + 1;
        let mut grid = Self {
            origin,
            per_metre: 1.0 / cell,
            columns,
            rows,
            cells: vec![],
            lists: vec![],
        };
        grid.fill(primitives, cell);
        grid.measure_gaps();
        grid
    }

    /// Which primitive `ray` meets first, no farther than `limit`. Of several at the same
    /// distance the one with the lowest index.
    pub(super) fn cross(
        &self,
        primitives: &[Primitive],
        ray: Ray,
        limit: f64,
    ) -> Option<(usize, Crossing)> {
        let mut walk = Walk::new(self, ray, limit)?;
        let mut best: Option<(u32, Crossing)> = None;
        let mut reach = limit;
        while let Some(cell) = walk.cell(self) {
            if walk.entered > reach {
                break;
            }
            for &index in self.list(cell) {
                let Some(crossing) = primitives[index as usize].cross(ray, reach) else {
                    continue;
                };
                let better = best.is_none_or(|(other, b)| {
                    crossing.distance < b.distance
                        || (crossing.distance == b.distance && index < other)
                });
                if better {
                    best = Some((index, crossing));
                    reach = crossing.distance;
                }
            }
            walk.jump(cell.gap.max(1));
        }
        best.map(|(index, crossing)| (index as usize, crossing))
    }

    /// Calls `visit` for every primitive that may be within `reach` of `point`, possibly more
    /// than once.
    pub(super) fn each_near(&self, point: Point, reach: f64, mut visit: impl FnMut(usize)) {
        let column = |x: f64, max: i32| floor((x - self.origin.x) * self.per_metre).clamp(0, max);
        let row = |y: f64, max: i32| floor((y - self.origin.y) * self.per_metre).clamp(0, max);
        let columns = column(point.x - reach, self.columns)..=column(point.x + reach, self.columns);
        for y in row(point.y - reach, self.rows)..=row(point.y + reach, self.rows) {
            for x in columns.clone() {
                if let Some(cell) = self.cell(x, y) {
                    self.list(cell)
                        .iter()
                        .for_each(|&index| visit(index as usize));
                }
            }
        }
    }

    #[inline]
    fn cell(&self, x: i32, y: i32) -> Option<Cell> {
        let inside = x >= 0 && x < self.columns && y >= 0 && y < self.rows;
        let index = y.wrapping_mul(self.columns).wrapping_add(x).cast_unsigned();
        if inside {
            self.cells.get(index as usize).copied()
        } else {
            None
        }
    }

    #[inline]
    fn list(&self, cell: Cell) -> &[u32] {
        let start = cell.start as usize;
        &self.lists[start..start + cell.count as usize]
    }

    fn fill(&mut self, primitives: &[Primitive], cell: f64) {
        let count = self.columns.cast_unsigned() as usize * self.rows.cast_unsigned() as usize;
        let mut entries: Vec<Vec<u32>> = vec![Vec::new(); count];
        for (index, primitive) in (0_u32..).zip(primitives) {
            let own = primitive.bounds();
            let from_x = floor((own.min.x - MARGIN_M - self.origin.x) * self.per_metre).max(0);
            let from_y = floor((own.min.y - MARGIN_M - self.origin.y) * self.per_metre).max(0);
            let to_x = floor((own.max.x + MARGIN_M - self.origin.x) * self.per_metre);
            let to_y = floor((own.max.y + MARGIN_M - self.origin.y) * self.per_metre);
            for y in from_y..=to_y.min(self.rows - 1) {
                for x in from_x..=to_x.min(self.columns - 1) {
                    let center = Point::new(
                        self.origin.x + (f64::from(x) + 0.5) * cell,
                        self.origin.y + (f64::from(y) + 0.5) * cell,
                    );
                    if primitive.enters(center, 0.5 * cell + MARGIN_M) {
                        entries[(y * self.columns + x).cast_unsigned() as usize].push(index);
                    }
                }
            }
        }
        for list in entries {
            let start = u32::try_from(self.lists.len()).expect("bounded by the primitive limit");
            let count = u32::try_from(list.len()).expect("bounded by the primitive limit");
            self.lists.extend(list);
            self.cells.push(Cell {
                start,
                count,
                gap: 0,
            });
        }
    }

    /// Two sweeps give every empty cell its distance to the nearest one with content.
    fn measure_gaps(&mut self) {
        for cell in &mut self.cells {
            cell.gap = if cell.count > 0 { 0 } else { GAP_MAX };
        }
        for y in 0..self.rows {
            for x in 0..self.columns {
                self.relax(x, y, [(-1, 0), (-1, -1), (0, -1), (1, -1)]);
            }
        }
        for y in (0..self.rows).rev() {
            for x in (0..self.columns).rev() {
                self.relax(x, y, [(1, 0), (1, 1), (0, 1), (-1, 1)]);
            }
        }
    }

    fn relax(&mut self, x: i32, y: i32, neighbours: [(i32, i32); 4]) {
        let near = neighbours
            .into_iter()
            .filter_map(|(dx, dy)| self.cell(x + dx, y + dy))
            .map(|cell| (cell.gap + 1).min(GAP_MAX))
            .min();
        let own = &mut self.cells[(y * self.columns + x).cast_unsigned() as usize];
        own.gap = own.gap.min(near.unwrap_or(GAP_MAX));
    }
}

/// A ray on its way through the grid; lengths along the ray stay in metres.
struct Walk {
    x: Axis,
    y: Axis,
    /// Distance at which the ray entered the cell it is in.
    entered: f64,
}

/// One coordinate of the walk, in cells.
struct Axis {
    index: i32,
    /// Where the ray starts, and how far it goes per metre.
    start: f64,
    per_metre: f64,
    /// `distance = edge * scale + shift` for the edge between two cells.
    scale: f64,
    shift: f64,
    forward: bool,
}

impl Axis {
    fn new(start: f64, per_metre: f64, direction: f64) -> Self {
        let still = direction.abs() < STILL;
        let scale = if still { 0.0 } else { 1.0 / per_metre };
        let shift = if still { f64::INFINITY } else { -start * scale };
        Self {
            index: 0,
            start,
            per_metre,
            scale,
            shift,
            forward: direction > 0.0,
        }
    }

    /// Distance at which the ray leaves the square of cells around the one it is in.
    #[inline]
    fn exit(&self, cells: i32) -> f64 {
        let edge = self.index + if self.forward { cells } else { 1 - cells };
        f64::from(edge) * self.scale + self.shift
    }

    #[inline]
    fn step(&mut self, cells: i32) {
        self.index += if self.forward { cells } else { -cells };
    }

    /// Follows the other axis, but not out of the square of cells known to be empty.
    #[inline]
    fn follow(&mut self, distance: f64, cells: i32) {
        let at = floor_near_zero(self.start + self.per_metre * distance);
        self.index = at.clamp(self.index - (cells - 1), self.index + (cells - 1));
    }
}

impl Walk {
    /// `None` if the ray misses the grid, or reaches it only beyond `limit`.
    fn new(grid: &Grid, ray: Ray, limit: f64) -> Option<Self> {
        let scale = grid.per_metre;
        let start_x = (ray.from.x - grid.origin.x) * scale;
        let start_y = (ray.from.y - grid.origin.y) * scale;
        let (columns, rows) = (f64::from(grid.columns), f64::from(grid.rows));
        let mut x = Axis::new(start_x, ray.dir.x * scale, ray.dir.x);
        let mut y = Axis::new(start_y, ray.dir.y * scale, ray.dir.y);
        let inside = start_x >= 0.0 && start_x < columns && start_y >= 0.0 && start_y < rows;
        let entered = if inside {
            0.0
        } else {
            entry(&x, columns, &y, rows)?
        };
        if entered > limit {
            return None;
        }
        x.index = floor(x.start + x.per_metre * entered).clamp(0, grid.columns - 1);
        y.index = floor(y.start + y.per_metre * entered).clamp(0, grid.rows - 1);
        Some(Self { x, y, entered })
    }

    #[inline]
    fn cell(&self, grid: &Grid) -> Option<Cell> {
        grid.cell(self.x.index, self.y.index)
    }

    /// Goes on to the first cell that is `gap` cells away along either axis.
    #[inline]
    fn jump(&mut self, cells: i32) {
        let (exit_x, exit_y) = (self.x.exit(cells), self.y.exit(cells));
        if exit_x < exit_y {
            self.x.step(cells);
            self.y.follow(exit_x, cells);
            self.entered = exit_x;
        } else {
            self.y.step(cells);
            self.x.follow(exit_y, cells);
            self.entered = exit_y;
        }
    }
}

/// Distance at which a ray from outside enters the grid.
#[cold]
fn entry(x: &Axis, columns: f64, y: &Axis, rows: f64) -> Option<f64> {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for (axis, cells) in [(x, columns), (y, rows)] {
        if axis.scale == 0.0 {
            if !(0.0..=cells).contains(&axis.start) {
                return None;
            }
            continue;
        }
        let (one, other) = (axis.shift, cells * axis.scale + axis.shift);
        enter = enter.max(one.min(other));
        leave = leave.min(one.max(other));
    }
    (enter <= leave).then_some(enter)
}

/// Rounds down.
fn floor(value: f64) -> i32 {
    floor_near_zero(value.floor())
}

/// Rounds towards zero, which is down for every place inside the grid and quicker.
#[inline]
fn floor_near_zero(value: f64) -> i32 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "saturates; callers clamp to the grid"
    )]
    let whole = value as i32;
    whole
}
