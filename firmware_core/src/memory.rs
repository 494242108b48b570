//! Writes that leave their buffer, as a finding.
//!
//! Some defects of the fielded programs write beyond a buffer. Where such a defect is switched on,
//! the write is not made but noted, and the program continues as if it had hit nothing that
//! matters; a defect that ended the program in life ends it here too, see
//! [`Inspect::is_dead`](crate::Inspect::is_dead).

/// Writes outside one buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StrayWrites {
    /// How many.
    pub count: u32,
    /// Where the first would have gone, in elements from the buffer's start.
    pub first: i32,
    /// Where the last would have gone.
    pub last: i32,
}

impl StrayWrites {
    /// None so far.
    pub const NONE: Self = Self {
        count: 0,
        first: 0,
        last: 0,
    };

    /// Notes a write at `offset` from the buffer's start.
    pub(crate) const fn note(&mut self, offset: i32) {
        if self.count == 0 {
            self.first = offset;
        }
        self.last = offset;
        self.count = self.count.saturating_add(1);
    }
}
