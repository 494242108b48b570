//! The map in the planner's cells.

use crate::grid::Grid;
use crate::pose::{Point, Pose};

use super::Surroundings;
use super::cells::{COARSE, Cell, Cells, EDGE, SIDE};

/// Map value from which a cell counts as an obstacle. A beam's end is drawn as a ramp; cells with
/// this value lie within 25 mm of the end.
pub(super) const OBSTACLE_FROM: u8 = 215;
/// Radius around start and goal in which cells blocked only by nearness are opened.
pub(super) const OPENED_MM: f32 = 120.0;
/// Maximum length of a wave front, limited by the map's edge.
const FRONT_MAX: usize = 4 * SIDE + 112;

/// Position of the planner's cells on the map.
#[derive(Clone, Copy, Debug)]
pub(super) struct Raster {
    cell_mm: f32,
}

impl Raster {
    /// A raster without a map.
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

    /// Cells within `reach` of an obstacle, except around `ends`.
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

/// Cells that the wave has reached but not yet expanded.
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

    /// Appends a cell. A full front loses the cell: the path may then lead around it.
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

#[cfg(test)]
mod tests {
    extern crate std;

    use std::boxed::Box;

    use super::*;

    /// Cells of 30 mm on a map of 10 mm: up to 215 a cell counts as free.
    #[test]
    fn a_dark_cell_of_nine_is_an_obstacle() {
        let mut map = Box::new(Grid::new(10.0));
        map.set(8, 5, 215);
        map.set(11, 5, 214);
        let raster = Raster::of(&map);
        let seen = Surroundings::of([Point::new(100.0, 0.0)].into_iter());
        let pose = Pose::new(305.0, 315.0, core::f32::consts::FRAC_PI_2);
        let obstacles = raster.obstacles(&map, pose, &seen);
        let has = |x, y| obstacles.has(Cell { x, y });
        assert!(has(2, 1) && !has(3, 1) && !has(2, 0) && !has(1, 1));
        // The seen point lies 100 mm along y from the robot.
        assert!(has(10, 13) && !has(10, 10) && !has(13, 10));
    }

    #[test]
    fn a_place_has_a_cell_on_the_map_only() {
        let raster = Raster { cell_mm: 30.0 };
        let cell = |x_mm, y_mm| raster.cell_of(Point::new(x_mm, y_mm));
        assert_eq!(cell(29.9, 30.0), Some(Cell { x: 0, y: 1 }));
        let edge = f32::from(EDGE) * 30.0;
        assert_eq!(cell(edge - 1.0, 0.0), Some(Cell { x: EDGE - 1, y: 0 }));
        assert_eq!(
            [
                cell(-0.1, 5.0),
                cell(5.0, -0.1),
                cell(edge, 0.0),
                cell(0.0, edge)
            ],
            [None; 4]
        );
        assert_eq!(raster.middle(Cell { x: 2, y: 1 }), Point::new(75.0, 45.0));
        assert_eq!(
            [raster.reach(120.0), raster.reach(179.0), raster.reach(9e9)],
            [4, 5, 20]
        );
    }

    /// Cells near an obstacle are opened 120 mm around both ends, the obstacle itself is not.
    #[test]
    fn what_is_near_is_open_around_the_ends() {
        let raster = Raster { cell_mm: 30.0 };
        let mut obstacles = Cells::NONE;
        obstacles.set(Cell { x: 20, y: 20 });
        let far = Point::new(2_000.0, 2_000.0);
        let blocked = |end| raster.blocked(&obstacles, 3, [end, far]);
        let near = blocked(Point::new(615.0, 465.0));
        let is_blocked = |cells: &Cells, y| cells.has(Cell { x: 20, y });
        assert!([17, 18, 19].into_iter().all(|y| !is_blocked(&near, y)));
        assert!([20, 21, 22, 23].into_iter().all(|y| is_blocked(&near, y)));
        let elsewhere = blocked(far);
        assert!((17..=23).all(|y| is_blocked(&elsewhere, y)));
        assert!(!is_blocked(&elsewhere, 16) && !is_blocked(&elsewhere, 24));
    }

    /// The queue is a ring, first in, first out; cells that do not fit are lost.
    #[test]
    fn a_front_is_a_queue() {
        let mut front = Front::new();
        let mut next = 0;
        for round in 0..3_u16 {
            for n in 0..500 {
                front.push(Cell {
                    x: round * 500 + n,
                    y: 0,
                });
            }
            assert_eq!(front.len(), 500.min(FRONT_MAX));
            while let Some(cell) = front.pop() {
                assert_eq!(cell.x, next);
                next += 1;
            }
        }
        (0..FRONT_MAX + 3).for_each(|_| front.push(Cell { x: 7, y: 7 }));
        assert_eq!(front.len(), FRONT_MAX);
    }
}
