//! An occupancy map of whole cells that grows only as far as needed. For the part of a robot's
//! program that runs on a PC; feature `host`.

use alloc::vec::Vec;

use crate::grid::{FREE, OBSTACLE, UNKNOWN};
use crate::growing_map::NotWritten;
use crate::map_view::MapView;
use crate::pose::Point;

/// Coordinates of a cell. Cell (0, 0) has its lower left corner at the origin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cell {
    /// Along x.
    pub x: i32,
    /// Along y.
    pub y: i32,
}

impl Cell {
    /// The cell of these coordinates.
    pub const fn new(x: i32, y: i32) -> Self {
        Self { x, y }
    }

    /// The four cells that share an edge with this one.
    pub const fn edge_neighbours(self) -> [Self; 4] {
        let Self { x, y } = self;
        [
            Self::new(x + 1, y),
            Self::new(x, y + 1),
            Self::new(x - 1, y),
            Self::new(x, y - 1),
        ]
    }

    /// The eight cells around this one.
    pub fn neighbours(self) -> impl Iterator<Item = Self> {
        self.block().filter(move |cell| *cell != self)
    }

    /// The nine cells of the 3 x 3 block around this one.
    pub fn block(self) -> impl Iterator<Item = Self> {
        (-1..=1).flat_map(move |y| (-1..=1).map(move |x| Self::new(self.x + x, self.y + y)))
    }

    /// Distance between the middles of the two cells, in cells.
    pub fn distance(self, other: Self) -> f32 {
        libm::hypotf((self.x - other.x) as f32, (self.y - other.y) as f32)
    }
}

/// Cells of one size, each one byte as in [`grid`](crate::grid).
#[derive(Clone, Debug, PartialEq)]
pub struct CellMap {
    cells: Vec<u8>,
    cell_mm: f32,
    low: Cell,
    width: i32,
    height: i32,
    /// Cells added beyond the one that caused the growth.
    margin: i32,
    cells_max: usize,
}

impl CellMap {
    /// An empty map with cells of `cell_mm`. Each growth adds `margin` cells beyond the required
    /// ones; the map has at most `cells_max` cells.
    ///
    /// # Panics
    /// If cells have no size.
    pub fn new(cell_mm: f32, margin: u8, cells_max: usize) -> Self {
        assert!(cell_mm > 0.0 && cell_mm.is_finite(), "cells have a size");
        Self {
            cells: Vec::new(),
            cell_mm,
            low: Cell::default(),
            width: 0,
            height: 0,
            margin: i32::from(margin),
            cells_max,
        }
    }

    /// Edge of a cell, mm.
    pub const fn cell_mm(&self) -> f32 {
        self.cell_mm
    }

    /// The cell of least x and y.
    pub const fn low(&self) -> Cell {
        self.low
    }

    /// Cells along x and y.
    pub const fn size(&self) -> (i32, i32) {
        (self.width, self.height)
    }

    /// A cell's value; unknown outside the map.
    pub fn get(&self, cell: Cell) -> u8 {
        self.index(cell).map_or(UNKNOWN, |index| self.cells[index])
    }

    /// Whether the cell is known to be free.
    pub fn is_free(&self, cell: Cell) -> bool {
        self.get(cell) == FREE
    }

    /// Writes a cell; the map grows to contain the cell.
    ///
    /// # Errors
    /// If the map would become too large: it stays unchanged.
    pub fn set(&mut self, cell: Cell, value: u8) -> Result<(), NotWritten> {
        if self.index(cell).is_none() {
            self.grow(cell)?;
        }
        if let Some(index) = self.index(cell) {
            self.cells[index] = value;
        }
        Ok(())
    }

    /// The cell that holds `place`.
    ///
    /// # Errors
    /// If the coordinates are not finite.
    pub fn cell_of(&self, place: Point) -> Result<Cell, NotWritten> {
        let [x, y] = [place.x_mm, place.y_mm].map(|mm| libm::floorf(mm / self.cell_mm));
        let is_sound = |along: f32| along.abs() < (1 << 24) as f32;
        #[expect(clippy::cast_possible_truncation, reason = "whole, and less than 2^24")]
        let cell = || Cell::new(x as i32, y as i32);
        (is_sound(x) && is_sound(y))
            .then(cell)
            .ok_or(NotWritten::NoPlace)
    }

    /// The middle of a cell.
    pub fn centre_of(&self, cell: Cell) -> Point {
        let middle = |along: i32| (along as f32 + 0.5) * self.cell_mm;
        Point::new(middle(cell.x), middle(cell.y))
    }

    /// All cells with their values, row by row.
    pub fn iter(&self) -> impl Iterator<Item = (Cell, u8)> {
        let cells = (0..self.height).flat_map(move |y| {
            (0..self.width).map(move |x| Cell::new(self.low.x + x, self.low.y + y))
        });
        cells.zip(self.cells.iter().copied())
    }

    /// The whole map for an observer; `None` if it has no cells.
    pub fn view(&self) -> Option<MapView<'_>> {
        let width = usize::try_from(self.width)
            .ok()
            .filter(|width| *width > 0)?;
        let origin = [self.low.x, self.low.y].map(|low| low as f32 * self.cell_mm);
        Some(MapView::new(width, self.cell_mm, origin, &self.cells))
    }

    /// Cells in which the middle of a robot three cells wide fits: free cells with only free
    /// neighbours. All other cells, including unknown ones, are obstacles.
    pub fn eroded(&self) -> Self {
        let mut eroded = self.clone();
        for (index, (cell, _)) in self.iter().enumerate() {
            let is_open = cell.block().all(|near| self.is_free(near));
            eroded.cells[index] = if is_open { FREE } else { OBSTACLE };
        }
        eroded
    }

    /// A map of the same cells that are all unknown.
    pub fn blank(&self) -> Self {
        let mut blank = self.clone();
        blank.cells.fill(UNKNOWN);
        blank
    }

    /// Merges another map with cells of equal size: unknown cells become known, free cells become
    /// obstacles. Obstacles are never cleared, as in the original robot's program.
    ///
    /// # Errors
    /// If the map would become too large; the cells that fit are merged.
    pub fn merge(&mut self, local: &Self) -> Result<(), NotWritten> {
        let known = local.iter().filter(|(_, value)| *value != UNKNOWN);
        for (cell, value) in known {
            match (self.get(cell), value) {
                (UNKNOWN, _) | (FREE, OBSTACLE) => self.set(cell, value)?,
                _ => {}
            }
        }
        Ok(())
    }

    /// Calls `visit` for each cell that the straight line from `from` to `to` touches, in order,
    /// until `visit` returns false. The method of Amanatides and Woo.
    ///
    /// # Errors
    /// If the coordinates of an end are not finite.
    pub fn walk(
        &self,
        from: Point,
        to: Point,
        mut visit: impl FnMut(Cell) -> bool,
    ) -> Result<(), NotWritten> {
        let (mut cell, last) = (self.cell_of(from)?, self.cell_of(to)?);
        let axis = |from: f32, to: f32, cell: i32| {
            let (from, length) = (from / self.cell_mm, (to - from) / self.cell_mm);
            let edge = if length > 0.0 { cell + 1 } else { cell };
            // Beyond the end if the line crosses no border on this axis.
            match length == 0.0 {
                true => (f32::MAX, 0.0),
                false => ((edge as f32 - from) / length, 1.0 / length.abs()),
            }
        };
        let (mut next_x, step_x) = axis(from.x_mm, to.x_mm, cell.x);
        let (mut next_y, step_y) = axis(from.y_mm, to.y_mm, cell.y);
        let count = (last.x - cell.x).abs() + (last.y - cell.y).abs();
        for _ in 0..count {
            if !visit(cell) {
                return Ok(());
            }
            // Rounding must not lead past the last column or row.
            let is_along_x = cell.y == last.y || (cell.x != last.x && next_x < next_y);
            if is_along_x {
                cell.x += (last.x - cell.x).signum();
                next_x += step_x;
            } else {
                cell.y += (last.y - cell.y).signum();
                next_y += step_y;
            }
        }
        visit(last);
        Ok(())
    }

    fn index(&self, cell: Cell) -> Option<usize> {
        let (x, y) = (cell.x - self.low.x, cell.y - self.low.y);
        let is_inside = (0..self.width).contains(&x) && (0..self.height).contains(&y);
        is_inside.then(|| usize::try_from(y * self.width + x).ok())?
    }

    /// Grows so that `cell` is inside.
    fn grow(&mut self, cell: Cell) -> Result<(), NotWritten> {
        let axis = |low: i32, size: i32, cell: i32| {
            let end = low + size;
            match (size == 0, cell < low, cell >= end) {
                (true, ..) => (cell - self.margin, 2 * self.margin + 1),
                (_, true, _) => (cell - self.margin, end - cell + self.margin),
                (_, _, true) => (low, cell - low + 1 + self.margin),
                _ => (low, size),
            }
        };
        let (x, width) = axis(self.low.x, self.width, cell.x);
        let (y, height) = axis(self.low.y, self.height, cell.y);
        let count = i64::from(width) * i64::from(height);
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        if count > self.cells_max {
            return Err(NotWritten::TooLarge);
        }
        let mut grown = Self {
            cells: alloc::vec![UNKNOWN; count],
            low: Cell::new(x, y),
            width,
            height,
            ..*self
        };
        for (cell, value) in self.iter() {
            if let Some(index) = grown.index(cell) {
                grown.cells[index] = value;
            }
        }
        *self = grown;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(cells: &[(i32, i32, u8)]) -> CellMap {
        let mut map = CellMap::new(100.0, 2, 1_000);
        for (x, y, value) in cells {
            map.set(Cell::new(*x, *y), *value).expect("fits");
        }
        map
    }

    /// Growth in any direction keeps the written cells in position and adds two cells around them.
    #[test]
    fn it_grows_no_further_than_it_must() {
        let cells = [(0, 0, FREE), (7, -3, OBSTACLE), (-4, 5, 9)];
        let map = map(&cells);
        for (x, y, value) in cells {
            assert_eq!(map.get(Cell::new(x, y)), value);
        }
        // The written cells reach from -4 to 7 and from -3 to 5; the map has two more cells on each
        // side.
        assert_eq!((map.low(), map.size()), (Cell::new(-6, -5), (16, 13)));
        assert_eq!(map.iter().filter(|(_, value)| *value != UNKNOWN).count(), 3);
        assert_eq!(map.get(Cell::new(900, 0)), UNKNOWN);
        let mut small = map.clone();
        assert_eq!(
            small.set(Cell::new(900, 0), FREE),
            Err(NotWritten::TooLarge)
        );
        assert_eq!(small, map);
        assert_eq!(CellMap::new(100.0, 2, 10).view(), None);
        assert_eq!(
            map.cell_of(Point::new(f32::NAN, 0.0)),
            Err(NotWritten::NoPlace)
        );
        assert_eq!(map.cell_of(Point::new(-0.1, 99.9)), Ok(Cell::new(-1, 0)));
    }

    /// By hand: the line from (0.5, 0.5) to (2.5, 1.5) cells meets edges in x at a quarter and
    /// three quarters of its length, and the edge in y at half of it.
    #[test]
    fn a_walk_touches_every_cell_on_the_way() {
        let map = map(&[]);
        let walked = |from: Point, to: Point| {
            let mut cells = Vec::new();
            let walk = map.walk(from, to, |cell| {
                cells.push((cell.x, cell.y));
                true
            });
            walk.map(|()| cells)
        };
        let (low, high) = (Point::new(50.0, 50.0), Point::new(250.0, 150.0));
        assert_eq!(
            walked(low, high),
            Ok(alloc::vec![(0, 0), (1, 0), (1, 1), (2, 1)])
        );
        assert_eq!(
            walked(high, low),
            Ok(alloc::vec![(2, 1), (1, 1), (1, 0), (0, 0)])
        );
        assert_eq!(walked(low, low), Ok(alloc::vec![(0, 0)]));
        let up = Point::new(50.0, 250.0);
        assert_eq!(walked(up, low), Ok(alloc::vec![(0, 2), (0, 1), (0, 0)]));
    }

    /// B7: unknown cells take the observed value, free cells become occupied, occupied cells are
    /// never cleared.
    #[test]
    fn obstacles_are_never_cleared() {
        let mut known = map(&[(0, 0, FREE), (1, 0, OBSTACLE), (2, 0, FREE)]);
        let local = map(&[(0, 0, OBSTACLE), (1, 0, FREE), (3, 0, FREE)]);
        known.merge(&local).expect("fits");
        let row = [0, 1, 2, 3].map(|x| known.get(Cell::new(x, 0)));
        assert_eq!(row, [OBSTACLE, OBSTACLE, FREE, FREE]);
    }

    /// Five by five free cells leave nine open ones; an unknown cell counts as a wall.
    #[test]
    fn erosion_takes_one_cell_all_around() {
        let cells: Vec<_> = (0..25).map(|at| (at % 5, at / 5, FREE)).collect();
        let open = map(&cells).eroded();
        let free = open.iter().filter(|(_, value)| *value == FREE);
        let free: Vec<Cell> = free.map(|(cell, _)| cell).collect();
        assert!(free.iter().all(|cell| (1..4).contains(&cell.x)));
        assert_eq!(free.len(), 9);
    }

    /// Row by row from below, each from left to right; the neighbours are the same without the
    /// middle.
    #[test]
    fn a_block_is_told_row_by_row() {
        let places = |cells: Vec<Cell>| cells.iter().map(|it| (it.x, it.y)).collect::<Vec<_>>();
        let block = places(Cell::new(5, -7).block().collect());
        let rows = [-8, -7, -6].map(|y| [(4, y), (5, y), (6, y)]);
        assert_eq!(block, rows.concat());
        let around = places(Cell::new(5, -7).neighbours().collect());
        assert_eq!(around, [&rows.concat()[..4], &rows.concat()[5..]].concat());
        let edges = places(Cell::new(5, -7).edge_neighbours().to_vec());
        assert_eq!(edges, [(6, -7), (5, -6), (4, -7), (5, -8)]);
        // The second cell is three to the right and four down, so 5 away.
        assert_eq!(Cell::new(5, -7).distance(Cell::new(8, -11)), 5.0);
    }
}
