//! The way of a beam from cell to cell. The long axis advances in every step, the short one by a
//! part of a cell. The classic whole-number error gives the same cells, but each of its steps waits
//! for the one before.

/// A walk over the cells of a map, whose rows lie one behind the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    /// Index of the cell that would be reached along the long axis alone; a huge one would lie
    /// before the map.
    pub(super) along: usize,
    /// What a step adds to it.
    pub(super) ahead: usize,
    /// Way along the short axis in cells with 32 binary places, and its advance in a step.
    pub(super) across: u64,
    pub(super) slope: u64,
    /// What a cell along the short axis adds to the index.
    pub(super) aside: usize,
}

impl Walk {
    /// The index of the current cell; goes on to the next.
    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "32 bits")]
    pub(super) fn next(&mut self) -> usize {
        let cells = (self.across >> 32) as usize;
        let at = self.along.wrapping_add(cells.wrapping_mul(self.aside));
        self.along = self.along.wrapping_add(self.ahead);
        self.across = self.across.wrapping_add(self.slope);
        at
    }

    /// Gives the next `count` cells what `then` says of each value.
    #[inline(never)]
    pub(super) fn map(&mut self, cells: &mut [u8], count: i32, then: &[u8; 256]) {
        let mut walk = *self;
        for _ in 0..count {
            if let Some(cell) = cells.get_mut(walk.next()) {
                *cell = then[usize::from(*cell)];
            }
        }
        *self = walk;
    }
}

/// Every value, less `away` parts of 256, rounded down.
pub(super) fn faded(away: u16) -> [u8; 256] {
    let mut then = [0; 256];
    for (value, to) in (0_u16..).zip(&mut then) {
        [_, *to] = ((256 - away) * value).to_le_bytes();
    }
    then
}
