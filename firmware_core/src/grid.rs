//! Occupancy grid: one byte per cell, in rows of equal y, origin at the lower left.
//!
//! ```text
//!   y ^   cell (0, 1) | cell (1, 1)      value 0: free, 127: never seen, 255: obstacle
//!     |   cell (0, 0) | cell (1, 0)
//!     +------------------------------> x
//! ```
//!
//! Cell (ix, iy) covers `ix * resolution <= x < (ix + 1) * resolution`, and y likewise. (The seed
//! report rounds to the nearest multiple of the resolution instead, which only moves its whole map
//! by half a cell.) 300 x 300 is the seed report's size.

use crate::map_view::MapView;
use crate::pose::Point;

/// Cells along an edge of the default map: the seed report's 300. With the feature `large` it is
/// the 2828 of the report's outlook and one more, because three by three of these cells make a
/// planner's cell.
pub const SIDE: usize = if cfg!(feature = "large") { 2829 } else { 300 };

/// Value of a cell that no beam has touched.
pub const UNKNOWN: u8 = 127;
/// Value of a cell that beams pass through.
pub const FREE: u8 = 0;
/// Value of a cell that beams end in.
pub const OBSTACLE: u8 = 255;

/// `W` x `H` cells. Plain data; the size is part of the type so that memory is known at compile
/// time.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<const W: usize = SIDE, const H: usize = SIDE> {
    cells: [[u8; W]; H],
    resolution_mm: f32,
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "checked to be at most 8191"
)]
impl<const W: usize, const H: usize> Grid<W, H> {
    /// Cells along x, as a coordinate.
    pub(crate) const WIDTH: i32 = W as i32;
    /// Cells along y, as a coordinate.
    pub(crate) const HEIGHT: i32 = H as i32;
}

impl<const W: usize, const H: usize> Grid<W, H> {
    /// A grid of unknown cells with edges of `resolution_mm`.
    pub const fn new(resolution_mm: f32) -> Self {
        assert!(
            W <= 8191 && H <= 8191,
            "cell coordinates have 14 bits with sign"
        );
        assert!(resolution_mm > 0.0, "cells have a size");
        Self {
            cells: [[UNKNOWN; W]; H],
            resolution_mm,
        }
    }

    /// Cells along x.
    pub const fn width(&self) -> usize {
        W
    }

    /// Cells along y.
    pub const fn height(&self) -> usize {
        H
    }

    /// Edge of a cell.
    pub const fn resolution_mm(&self) -> f32 {
        self.resolution_mm
    }

    /// Sets all cells to unknown.
    pub fn clear(&mut self) {
        self.cells = [[UNKNOWN; W]; H];
    }

    /// The cells of equal y, in order of x; `None` above the map.
    pub fn row(&self, iy: usize) -> Option<&[u8; W]> {
        self.cells.get(iy)
    }

    /// The grid as an observer sees it.
    pub const fn view(&self) -> MapView<'_> {
        MapView::new(W, self.resolution_mm, [0.0; 2], self.cells.as_flattened())
    }

    /// All rows, lowest y first.
    pub const fn rows(&self) -> &[[u8; W]; H] {
        &self.cells
    }

    pub(crate) const fn rows_mut(&mut self) -> &mut [[u8; W]; H] {
        &mut self.cells
    }

    /// A cell's value; `None` outside.
    pub fn get(&self, ix: usize, iy: usize) -> Option<u8> {
        self.cells.get(iy)?.get(ix).copied()
    }

    /// Writes a cell; ignores cells outside the map.
    pub fn set(&mut self, ix: usize, iy: usize, value: u8) {
        if let Some(cell) = self.cells.get_mut(iy).and_then(|row| row.get_mut(ix)) {
            *cell = value;
        }
    }

    /// The cell that holds `point`; `None` outside.
    pub fn cell_of(&self, point: Point) -> Option<(usize, usize)> {
        let index = |mm: f32, limit: usize| {
            let cell = libm::floorf(mm / self.resolution_mm);
            let inside = cell >= 0.0 && cell < limit as f32;
            #[expect(clippy::cast_possible_truncation, reason = "range checked")]
            inside.then_some(cell as usize)
        };
        Some((index(point.x_mm, W)?, index(point.y_mm, H)?))
    }

    /// The middle of a cell.
    pub fn centre_of(&self, ix: usize, iy: usize) -> Point {
        Point {
            x_mm: (ix as f32 + 0.5) * self.resolution_mm,
            y_mm: (iy as f32 + 0.5) * self.resolution_mm,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_covers_its_lower_edges_only() {
        let grid = Grid::<300, 300>::new(10.0);
        assert_eq!(grid.cell_of(Point::new(0.0, 9.99)), Some((0, 0)));
        assert_eq!(grid.cell_of(Point::new(10.0, 2999.9)), Some((1, 299)));
        assert_eq!(grid.cell_of(Point::new(-0.01, 5.0)), None);
        assert_eq!(grid.cell_of(Point::new(5.0, 3000.0)), None);
        assert_eq!(grid.cell_of(Point::new(f32::NAN, 5.0)), None);
    }

    #[test]
    fn the_middle_of_a_cell_lies_in_it() {
        let grid = Grid::<30, 20>::new(20.0);
        assert_eq!(grid.centre_of(3, 7), Point::new(70.0, 150.0));
        assert_eq!(grid.cell_of(grid.centre_of(29, 19)), Some((29, 19)));
    }

    #[test]
    fn rows_run_along_x() {
        let mut grid = Grid::<4, 3>::new(10.0);
        grid.set(2, 1, OBSTACLE);
        grid.set(4, 0, FREE);
        assert_eq!(grid.row(1), Some(&[UNKNOWN, UNKNOWN, OBSTACLE, UNKNOWN]));
        assert_eq!(
            (grid.get(2, 1), grid.get(4, 0), grid.row(3)),
            (Some(255), None, None)
        );
    }
}
