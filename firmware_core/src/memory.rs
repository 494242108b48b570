//! Record of writes outside their buffer.
//!
//! Some defects of the fielded programs write beyond a buffer. If such a defect is enabled, the
//! write is recorded instead of made, and the program continues as if the write had hit unused
//! memory. A defect that ended the fielded program ends it here too, see
//! [`Inspect::is_dead`](crate::Inspect::is_dead).

/// Writes outside one buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StrayWrites {
    /// Number of writes.
    pub count: u32,
    /// Position of the first write, in elements from the buffer's start.
    pub first: i32,
    /// Position of the last write.
    pub last: i32,
}

impl StrayWrites {
    /// No writes.
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
