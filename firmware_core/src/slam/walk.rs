//! The path of a beam from cell to cell. The long axis advances in every step, the short one by a
//! part of a cell. The classic algorithm with a whole-number error visits the same cells, but each
//! of its steps depends on the one before.

/// A walk over the cells of a map; its rows are stored one behind the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    /// Index of the current cell; an index before the map wraps to a huge one.
    pub(super) at: usize,
    /// Added to the index in a step, without and with a step along the short axis.
    pub(super) straight: usize,
    pub(super) diagonal: usize,
    /// Position along the short axis, 32 binary places of a cell from its border, and its advance.
    pub(super) place: u32,
    pub(super) slope: u32,
}

impl Walk {
    /// A walk that never changes its direction.
    pub(super) const fn straight(at: usize, step: usize) -> Self {
        Self {
            at,
            straight: step,
            diagonal: step,
            place: 0,
            slope: 0,
        }
    }

    /// Returns the index of the current cell and advances to the next.
    #[inline]
    pub(super) fn next(&mut self) -> usize {
        let at = self.at;
        let (place, crosses) = self.place.overflowing_add(self.slope);
        self.place = place;
        self.at = at.wrapping_add(if crosses {
            self.diagonal
        } else {
            self.straight
        });
        at
    }

    /// Replaces the value of each of the next `count` cells by its entry in the table `then`.
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

/// Steps of a cell towards a drawn value, for each difference of the two.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Steps {
    /// Step modulo 256, indexed by the drawn value minus the cell's value, modulo 512.
    by_difference: [u8; 512],
}

impl Steps {
    /// Steps of `weight` parts of 256 of the difference; `up` is added before an upward step is
    /// rounded down.
    pub(super) fn new(weight: i32, up: i32) -> Self {
        let mut by_difference = [0; 512];
        for (difference, step) in (-256..256).zip(&mut by_difference) {
            let moved = difference * weight + if difference > 0 { up } else { 0 };
            [*step, ..] = (moved >> 8).to_le_bytes();
        }
        by_difference.rotate_left(256);
        Self { by_difference }
    }

    /// Moves `cell` towards `value`.
    #[inline]
    pub(super) fn apply(&self, cell: &mut u8, value: usize) {
        let difference = value.wrapping_sub(usize::from(*cell)) % self.by_difference.len();
        *cell = cell.wrapping_add(self.by_difference[difference]);
    }
}

/// A table of every value reduced by `away` parts of 256, rounded down.
pub(super) fn faded(away: u16) -> [u8; 256] {
    let mut then = [0; 256];
    for (value, to) in (0_u16..).zip(&mut then) {
        [_, *to] = ((256 - away) * value).to_le_bytes();
    }
    then
}
