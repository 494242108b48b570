//! An occupancy map without an edge: it grows to contain each written cell. For the part of a
//! robot's program that runs on a PC; feature `host`.

use alloc::vec::Vec;

use crate::grid::UNKNOWN;
use crate::map_view::MapView;
use crate::pose::Point;

/// Minimum growth in cells, so that a beam does not grow the map cell by cell.
const STEP: i32 = 64;

/// Reason why a cell was not written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum NotWritten {
    /// The position has no finite coordinates.
    NoPlace,
    /// The map would have more cells than it may.
    TooLarge,
}

/// Cells of one size around the origin of the robot's poses, each one byte as in
/// [`grid`](crate::grid).
#[derive(Clone, Debug, PartialEq)]
pub struct GrowingMap {
    cells: Vec<u8>,
    cell_mm: f32,
    /// The cell of least x and y, counted from the one with its corner at the origin.
    low: [i32; 2],
    /// Cells along x and y.
    size: [i32; 2],
    cells_max: usize,
}

impl GrowingMap {
    /// An unknown map of cells with edges of `cell_mm`, which may grow to `cells_max` cells.
    ///
    /// # Panics
    /// If the cells have no size, or not even the first `STEP` x `STEP` cells are allowed.
    pub fn new(cell_mm: f32, cells_max: usize) -> Self {
        let step = usize::try_from(STEP).unwrap_or(0);
        assert!(cell_mm > 0.0 && cell_mm.is_finite(), "cells have a size");
        assert!(cells_max >= step * step, "the map has a first part");
        Self {
            cells: alloc::vec![UNKNOWN; step * step],
            cell_mm,
            low: [-STEP / 2; 2],
            size: [STEP; 2],
            cells_max,
        }
    }

    /// Edge of a cell, mm.
    pub const fn cell_mm(&self) -> f32 {
        self.cell_mm
    }

    /// The cell at `place`; unknown outside the written area.
    pub fn get(&self, place: Point) -> u8 {
        let index = self.cell(place).and_then(|cell| self.index(cell));
        index.map_or(UNKNOWN, |index| self.cells[index])
    }

    /// Writes the cell at `place`; the map grows to contain the cell.
    ///
    /// # Errors
    /// If the coordinates are not finite, or the map would become too large: it stays unchanged.
    pub fn set(&mut self, place: Point, value: u8) -> Result<(), NotWritten> {
        let cell = self.cell(place).ok_or(NotWritten::NoPlace)?;
        if self.index(cell).is_none() {
            self.grow(cell)?;
        }
        if let Some(index) = self.index(cell) {
            self.cells[index] = value;
        }
        Ok(())
    }

    /// The whole map, for an observer.
    pub fn view(&self) -> MapView<'_> {
        let origin = self.low.map(|low| low as f32 * self.cell_mm);
        let width = usize::try_from(self.size[0]).unwrap_or(1);
        MapView::new(width, self.cell_mm, origin, &self.cells)
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "checked to be at most 2^30"
    )]
    fn cell(&self, place: Point) -> Option<[i32; 2]> {
        let cell = [place.x_mm, place.y_mm].map(|mm| libm::floorf(mm / self.cell_mm));
        let is_sound = |along: &f32| along.is_finite() && along.abs() < (1 << 30) as f32;
        cell.iter()
            .all(is_sound)
            .then(|| cell.map(|along| along as i32))
    }

    fn index(&self, cell: [i32; 2]) -> Option<usize> {
        let [x, y] = core::array::from_fn(|axis| cell[axis] - self.low[axis]);
        let is_inside = (0..self.size[0]).contains(&x) && (0..self.size[1]).contains(&y);
        is_inside.then(|| usize::try_from(y * self.size[0] + x).ok())?
    }

    /// Grows so that `cell` is inside.
    fn grow(&mut self, cell: [i32; 2]) -> Result<(), NotWritten> {
        let (mut low, mut size) = (self.low, self.size);
        for axis in 0..2 {
            let end = low[axis] + size[axis];
            if cell[axis] < low[axis] {
                low[axis] -= (low[axis] - cell[axis]).max(STEP);
                size[axis] = end - low[axis];
            } else if cell[axis] >= end {
                size[axis] += (cell[axis] - end + 1).max(STEP);
            }
        }
        let [width, height] = size.map(|cells| usize::try_from(cells).unwrap_or(usize::MAX));
        let count = width.checked_mul(height);
        let count = count.filter(|count| *count <= self.cells_max);
        let mut cells = alloc::vec![UNKNOWN; count.ok_or(NotWritten::TooLarge)?];
        let right = usize::try_from(self.low[0] - low[0]).unwrap_or(0);
        let up = usize::try_from(self.low[1] - low[1]).unwrap_or(0);
        for (row, old) in self.view().rows().enumerate() {
            let from = (row + up) * width + right;
            cells[from..from + old.len()].copy_from_slice(old);
        }
        (self.cells, self.low, self.size) = (cells, low, size);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{FREE, OBSTACLE};

    const fn at(x_mm: f32, y_mm: f32) -> Point {
        Point::new(x_mm, y_mm)
    }

    /// Growth in any direction keeps the written cells in position.
    #[test]
    fn it_grows_to_where_it_is_written_and_forgets_nothing() {
        let mut map = GrowingMap::new(50.0, 1 << 20);
        let places = [
            (at(10.0, -10.0), OBSTACLE),
            (at(9_000.0, 20.0), FREE),
            (at(-7_000.0, -5_000.0), OBSTACLE),
            (at(-20.0, 12_340.0), 3),
        ];
        for (done, (place, value)) in places.into_iter().enumerate() {
            assert_eq!(map.get(place), UNKNOWN);
            assert_eq!(map.set(place, value), Ok(()));
            for (earlier, value) in &places[..=done] {
                assert_eq!(map.get(*earlier), *value);
            }
        }
        let view = map.view();
        let known = view.cells().iter().filter(|cell| **cell != UNKNOWN);
        assert_eq!(known.count(), 4);
        // 10 mm lies in the cell from 0 to 50 mm, -10 mm in the one from -50 to 0.
        let [x, y] = view.origin_mm();
        let corners = view.rows().enumerate().flat_map(|(iy, row)| {
            let cells = row.iter().enumerate();
            let obstacles = cells.filter(|(_, cell)| **cell == OBSTACLE);
            obstacles.map(move |(ix, _)| [x + ix as f32 * 50.0, y + iy as f32 * 50.0])
        });
        let corners: Vec<_> = corners.collect();
        assert_eq!(corners, [[-7_000.0, -5_000.0], [0.0, -50.0]]);
    }

    #[test]
    fn a_map_that_would_be_too_large_stays_as_it_was() {
        let mut map = GrowingMap::new(10.0, 64 * 64);
        let before = map.clone();
        assert_eq!(map.set(at(400.0, 0.0), 1), Err(NotWritten::TooLarge));
        assert_eq!(map.set(at(f32::MAX, 0.0), 1), Err(NotWritten::NoPlace));
        assert_eq!(map.set(at(f32::NAN, 0.0), 1), Err(NotWritten::NoPlace));
        assert_eq!(map, before);
        assert_eq!(map.set(at(319.0, -320.0), 1), Ok(()));
    }

    /// 64 cells from -32 on: a cell above the last row adds 64 rows and no column, one left of the
    /// first column adds 64 columns and no row, one 100 above the last row adds 101 rows.
    #[test]
    fn it_grows_only_where_it_has_to() {
        let grown = |x_mm: f32, y_mm: f32| {
            let mut map = GrowingMap::new(10.0, 1 << 20);
            assert_eq!(map.set(at(x_mm, y_mm), OBSTACLE), Ok(()));
            assert_eq!(map.get(at(x_mm, y_mm)), OBSTACLE);
            let view = map.view();
            (
                view.rows().next().map_or(0, <[u8]>::len),
                view.rows().count(),
                view.origin_mm(),
            )
        };
        assert_eq!(grown(-315.0, 315.0), (64, 64, [-320.0; 2]));
        assert_eq!(grown(-315.0, 325.0), (64, 128, [-320.0; 2]));
        assert_eq!(grown(-325.0, 315.0), (128, 64, [-960.0, -320.0]));
        assert_eq!(grown(-315.0, 1325.0), (64, 165, [-320.0; 2]));
        assert_eq!(grown(-1325.0, -315.0), (165, 64, [-1330.0, -320.0]));
    }

    #[test]
    #[should_panic(expected = "the map has a first part")]
    fn a_map_needs_room_for_its_first_part() {
        let _ = GrowingMap::new(10.0, 64 * 64 - 1);
    }

    /// Cells are counted to 2^30 at most.
    #[test]
    fn a_place_beyond_all_cells_is_none() {
        let mut map = GrowingMap::new(1.0, 64 * 64);
        let far = (1_u32 << 30) as f32;
        assert_eq!(map.set(at(far, 0.0), 1), Err(NotWritten::NoPlace));
        assert_eq!(map.set(at(0.0, -far), 1), Err(NotWritten::NoPlace));
        assert_eq!(map.set(at(far / 2.0, 0.0), 1), Err(NotWritten::TooLarge));
    }
}
