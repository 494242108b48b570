use crate::grid;

/// Map cells along the edge of a planner's cell.
pub(super) const COARSE: usize = 3;
/// Cells along an edge.
pub(super) const SIDE: usize = grid::SIDE / COARSE;
#[expect(clippy::cast_possible_truncation, reason = "a third of 8191 at most")]
pub(super) const EDGE: u16 = SIDE as u16;
const _: () = assert!(SIDE * COARSE == grid::SIDE, "no rest at the map's rim");

/// A cell of the planner's map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cell {
    pub(super) x: u16,
    pub(super) y: u16,
}

impl Cell {
    /// The cell `dx` and `dy` from this one, if it lies in the map.
    pub(super) fn moved(self, dx: i8, dy: i8) -> Option<Self> {
        let inside = |index: &u16| *index < EDGE;
        Some(Self {
            x: self.x.checked_add_signed(i16::from(dx)).filter(inside)?,
            y: self.y.checked_add_signed(i16::from(dy)).filter(inside)?,
        })
    }

    /// Calls `visit` for each cell of the map that is at most `reach` cells away.
    pub(super) fn each_within(self, reach: i8, mut visit: impl FnMut(Self)) {
        let limit = i16::from(reach) * i16::from(reach);
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let apart = i16::from(dx) * i16::from(dx) + i16::from(dy) * i16::from(dy);
                if apart <= limit
                    && let Some(cell) = self.moved(dx, dy)
                {
                    visit(cell);
                }
            }
        }
    }
}

/// The eight cells around one.
pub(super) const NEIGHBOURS: [(i8, i8); 8] = [
    (1, 0),
    (0, 1),
    (-1, 0),
    (0, -1),
    (1, 1),
    (-1, 1),
    (-1, -1),
    (1, -1),
];

pub(super) fn neighbour(cell: Cell, index: usize) -> Option<Cell> {
    let (dx, dy) = NEIGHBOURS[index];
    cell.moved(dx, dy)
}

/// Bytes of a row of such a set.
const ROW_LEN: usize = SIDE.div_ceil(8);
/// Bits of a row's last byte that are cells.
const LAST_BITS: u8 = u8::MAX >> (8 * ROW_LEN - SIDE);

/// A set of cells of the planner's map, one bit each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Cells([[u8; ROW_LEN]; SIDE]);

impl Cells {
    pub(super) const NONE: Self = Self([[0; ROW_LEN]; SIDE]);

    pub(super) const fn has(&self, Cell { x, y }: Cell) -> bool {
        self.0[y as usize][x as usize / 8] & 1 << (x % 8) != 0
    }

    pub(super) const fn set(&mut self, Cell { x, y }: Cell) {
        self.0[y as usize][x as usize / 8] |= 1 << (x % 8);
    }

    pub(super) const fn clear(&mut self, Cell { x, y }: Cell) {
        self.0[y as usize][x as usize / 8] &= !(1 << (x % 8));
    }

    /// Calls `visit` for each cell of the set.
    pub(super) fn each(&self, mut visit: impl FnMut(Cell)) {
        for y in 0..EDGE {
            for x in 0..EDGE {
                if self.has(Cell { x, y }) {
                    visit(Cell { x, y });
                }
            }
        }
    }

    /// Adds the cells of the other set.
    pub(super) fn add(&mut self, others: &Self) {
        let rows = self.0.iter_mut().zip(&others.0);
        rows.flat_map(|(row, other)| row.iter_mut().zip(other))
            .for_each(|(bits, other)| *bits |= other);
    }

    /// The set and all cells at most `reach` cells away from it.
    pub(super) fn grown(&self, reach: i8) -> Self {
        let mut grown = Self::NONE;
        for (y, row) in self.0.iter().enumerate() {
            if *row != [0; ROW_LEN] {
                grown.add_discs(y, *row, usize::from(reach.unsigned_abs()));
            }
        }
        for row in &mut grown.0 {
            row[ROW_LEN - 1] &= LAST_BITS;
        }
        grown
    }

    /// Adds the discs of `reach` cells around the cells `row` of row `y`. A row of a disc is wider
    /// the nearer it is to the middle, so the row is widened from one to the next.
    fn add_discs(&mut self, y: usize, mut row: [u8; ROW_LEN], reach: usize) {
        let mut width = 0;
        for off in (0..=reach).rev() {
            while (width + 1) * (width + 1) + off * off <= reach * reach {
                row = widened(&row);
                width += 1;
            }
            for y in [y.checked_sub(off), y.checked_add(off)] {
                let cells = y.and_then(|y| self.0.get_mut(y)).into_iter().flatten();
                cells.zip(&row).for_each(|(bits, more)| *bits |= more);
            }
        }
    }
}

/// The cells of a row and both neighbours of each.
fn widened(row: &[u8; ROW_LEN]) -> [u8; ROW_LEN] {
    let at = |index: Option<usize>| index.and_then(|index| row.get(index)).copied();
    core::array::from_fn(|index| {
        let bits = row[index];
        let before = at(index.checked_sub(1)).unwrap_or(0) >> 7;
        let behind = at(index.checked_add(1)).unwrap_or(0) << 7;
        bits | bits << 1 | bits >> 1 | before | behind
    })
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The set grown row by row is that of the discs around each of its cells, also at the
        /// map's edges.
        #[test]
        fn grown_cells_are_the_discs_around_each(
            places in proptest::collection::vec([0..EDGE, 0..EDGE], 0..60),
            at_edges in proptest::collection::vec([0..EDGE, 0_u16..2], 0..4),
            reach in 0_i8..12,
        ) {
            let mut cells = Cells::NONE;
            places.iter().for_each(|&[x, y]| cells.set(Cell { x, y }));
            for &[along, side] in &at_edges {
                let across = side * (EDGE - 1);
                cells.set(Cell { x: along, y: across });
                cells.set(Cell { x: across, y: along });
            }
            let mut discs = Cells::NONE;
            cells.each(|cell| cell.each_within(reach, |near| discs.set(near)));
            prop_assert_eq!(cells.grown(reach), discs);
        }
    }

    /// A disc of radius 2 has 13 cells; at a corner of the map 6 of them lie on the map.
    #[test]
    fn cells_grow_into_discs_and_not_beyond_the_map() {
        let count = |x, y| {
            let mut cells = Cells::NONE;
            cells.set(Cell { x, y });
            let grown = cells.grown(2);
            let all = (0..EDGE).flat_map(|y| (0..EDGE).map(move |x| Cell { x, y }));
            all.filter(|&cell| grown.has(cell)).count()
        };
        assert_eq!(count(50, 50), 13);
        assert_eq!(count(0, 99), 6);
    }
}
