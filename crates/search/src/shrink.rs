//! Making what fails smaller while it still fails for the same reason.
//!
//! Everything here is deterministic: the same case and the same judge come to the same bytes. When
//! the effort is over the best so far is the result.

mod branches;
mod capture;
mod culprit;
mod list;
mod scenario;

pub use branches::Branches;
pub use capture::{Repair, Unit, capture, fault_of, to_bytes, units, with_units};
pub use list::fewest;
pub use scenario::{in_words, scenario};

/// What a try came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Judged {
    /// Nothing is wrong.
    Passes,
    /// It fails for the cause that is looked for.
    FailsAlike,
    /// It fails for another one.
    FailsOtherwise,
}

impl Judged {
    /// Of a run that failed for `found`, or passed, when `wanted` is looked for.
    pub fn of(found: Option<&str>, wanted: &str) -> Self {
        match found {
            None => Self::Passes,
            Some(found) if found == wanted => Self::FailsAlike,
            Some(_) => Self::FailsOtherwise,
        }
    }
}

/// How much may be spent.
pub struct Effort<'a> {
    tries: u32,
    most: u32,
    is_over: Option<&'a dyn Fn() -> bool>,
}

impl core::fmt::Debug for Effort<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "Effort({} of {})", self.tries, self.most)
    }
}

impl Effort<'static> {
    /// At most this many tries.
    pub const fn tries(most: u32) -> Self {
        Self {
            tries: 0,
            most,
            is_over: None,
        }
    }
}

impl<'a> Effort<'a> {
    /// At most this many tries, and none once `is_over` says so: then the best so far is taken.
    pub const fn until(most: u32, is_over: &'a dyn Fn() -> bool) -> Self {
        Self {
            tries: 0,
            most,
            is_over: Some(is_over),
        }
    }

    /// How many tries were made.
    pub const fn spent(&self) -> u32 {
        self.tries
    }

    /// Whether one more try is allowed; it is counted.
    pub fn spend(&mut self) -> bool {
        if self.tries >= self.most || self.is_over.is_some_and(|is_over| is_over()) {
            return false;
        }
        self.tries += 1;
        true
    }
}

#[cfg(test)]
mod tests;
