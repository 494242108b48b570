//! Observer's view of a map of any size and origin.

/// A view of an occupancy map: one byte a cell, in rows of equal y, lowest y first, as in
/// [`grid`](crate::grid): 0 free, 127 never seen, 255 obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapView<'a> {
    width: usize,
    cell_mm: f32,
    origin_mm: [f32; 2],
    cells: &'a [u8],
}

impl<'a> MapView<'a> {
    /// A map of rows of `width` cells with edges of `cell_mm`; `origin_mm` is the corner of least x
    /// and y, in the frame of the robot's poses. An incomplete last row is ignored.
    ///
    /// # Panics
    /// If `width` is 0 or the cells have no size.
    pub const fn new(width: usize, cell_mm: f32, origin_mm: [f32; 2], cells: &'a [u8]) -> Self {
        assert!(width > 0, "a row has cells");
        assert!(cell_mm > 0.0, "cells have a size");
        let (cells, _) = cells.split_at(cells.len() / width * width);
        Self {
            width,
            cell_mm,
            origin_mm,
            cells,
        }
    }

    /// Cells along x.
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Cells along y.
    pub const fn height(&self) -> usize {
        self.cells.len() / self.width
    }

    /// Edge of a cell, mm.
    pub const fn cell_mm(&self) -> f32 {
        self.cell_mm
    }

    /// The corner of least x and y, mm.
    pub const fn origin_mm(&self) -> [f32; 2] {
        self.origin_mm
    }

    /// All cells, row by row.
    pub const fn cells(&self) -> &'a [u8] {
        self.cells
    }

    /// All rows, lowest y first.
    pub fn rows(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        self.cells.chunks_exact(self.width)
    }

    /// The cells of equal y, in order of x; `None` above the map.
    #[inline]
    pub fn row(&self, iy: usize) -> Option<&'a [u8]> {
        let from = iy.checked_mul(self.width)?;
        self.cells.get(from..from.checked_add(self.width)?)
    }

    /// A cell's value; `None` outside.
    #[inline]
    pub fn get(&self, ix: usize, iy: usize) -> Option<u8> {
        self.row(iy)?.get(ix).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells of two rows of three, and one cell too many.
    #[test]
    fn cells_lie_in_rows_from_the_lowest() {
        let map = MapView::new(3, 50.0, [-100.0, 0.0], &[1, 2, 3, 4, 5, 6, 7]);
        assert_eq!((map.width(), map.height()), (3, 2));
        assert_eq!(map.row(1), Some(&[4, 5, 6][..]));
        assert_eq!(
            (map.get(2, 0), map.get(3, 0), map.get(0, 2)),
            (Some(3), None, None)
        );
        assert_eq!(map.row(usize::MAX), None);
    }
}
