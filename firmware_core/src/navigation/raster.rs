//! The map in the planner's cells.

use crate::grid::Grid;
use crate::pose::{Point, Pose};

use super::Surroundings;
use super::cells::{COARSE, Cell, Cells, EDGE, SIDE};

/// Map value from which a cell counts as an obstacle. A beam's end is drawn as a ramp; this much of
/// it lies within 25 mm of the end.
pub(super) const OBSTACLE_FROM: u8 = 215;
/// What is blocked only because it is near something is opened this far around start and goal.
pub(super) const OPENED_MM: f32 = 120.0;
/// A wave front cannot be longer than the map's rim.
const FRONT_MAX: usize = 4 * SIDE + 112;

/// How the planner's cells lie on the map.
#[derive(Clone, Copy, Debug)]
pub(super) struct Raster {
    cell_mm: f32,
}

impl Raster {
    /// Of no map.
    pub(super) const NONE: Self = Self { cell_mm: 1.0 };

    pub(super) const fn of(map: &Grid) -> Self {
        Self {
            cell_mm: map.resolution_mm() * COARSE as f32,
        }
    }

    pub(super) const fn cell_mm(self) -> f32 {
        self.cell_mm
    }

    pub(super) fn obstacles(self, map: &Grid, pose: Pose, around: &Surroundings) -> Cells {
        let mut obstacles = Cells::NONE;
        for (y, rows) in (0..).zip(map.rows().chunks_exact(COARSE)) {
            for row in rows {
                for (x, cells) in (0..).zip(row.chunks_exact(COARSE)) {
                    if cells.iter().any(|value| *value >= OBSTACLE_FROM) {
                        obstacles.set(Cell { x, y });
                    }
                }
            }
        }
        for (point, _) in around.points() {
            if let Some(cell) = self.cell_of(pose.to_world(point)) {
                obstacles.set(cell);
            }
        }
        obstacles
    }

    /// What lies within `reach` cells of an obstacle, but open around `ends`.
    pub(super) fn blocked(self, obstacles: &Cells, reach: i8, ends: [Point; 2]) -> Cells {
        let mut blocked = obstacles.grown(reach);
        for cell in ends.into_iter().filter_map(|end| self.cell_of(end)) {
            cell.each_within(self.reach(OPENED_MM), |cell| {
                if !obstacles.has(cell) {
                    blocked.clear(cell);
                }
            });
        }
        blocked
    }

    pub(super) fn reach(self, mm: f32) -> i8 {
        super::ticks((mm / self.cell_mm).min(20.0))
    }

    pub(super) fn cell_of(self, point: Point) -> Option<Cell> {
        let index = |mm: f32| {
            let cell = libm::floorf(mm / self.cell_mm);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "range checked"
            )]
            (cell >= 0.0 && cell < f32::from(EDGE)).then_some(cell as u16)
        };
        Some(Cell {
            x: index(point.x_mm)?,
            y: index(point.y_mm)?,
        })
    }

    pub(super) fn middle(self, cell: Cell) -> Point {
        let middle = |index: u16| (f32::from(index) + 0.5) * self.cell_mm;
        Point::new(middle(cell.x), middle(cell.y))
    }
}

/// Cells that the wave has reached but not yet left.
pub(super) struct Front {
    cells: [Cell; FRONT_MAX],
    head: usize,
    len: usize,
}

impl Front {
    pub(super) const fn new() -> Self {
        Self {
            cells: [Cell { x: 0, y: 0 }; FRONT_MAX],
            head: 0,
            len: 0,
        }
    }

    pub(super) const fn len(&self) -> usize {
        self.len
    }

    /// A front that is full loses the cell: the way may then lead around it.
    pub(super) const fn push(&mut self, cell: Cell) {
        if self.len < FRONT_MAX {
            self.cells[(self.head + self.len) % FRONT_MAX] = cell;
            self.len += 1;
        }
    }

    pub(super) const fn pop(&mut self) -> Option<Cell> {
        if self.len == 0 {
            return None;
        }
        let cell = self.cells[self.head];
        self.head = (self.head + 1) % FRONT_MAX;
        self.len -= 1;
        Some(cell)
    }
}
