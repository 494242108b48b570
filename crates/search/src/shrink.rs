//! Minimisation of failing cases: the smaller case must fail for the same reason.
//!
//! Minimisation is deterministic: the same case and the same judge give the same bytes. When the
//! effort is used up, the smallest case so far is the result.

mod branches;
mod capture;
mod culprit;
mod list;
mod scenario;

pub use branches::Branches;
pub use capture::{Repair, Unit, capture, fault_of, to_bytes, units, with_units};
pub use list::fewest;
pub use scenario::{in_words, scenario, unminimised_in_words};

/// The result of a try.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Judged {
    /// The case passes.
    Passes,
    /// The case fails for the wanted cause.
    FailsAlike,
    /// The case fails for another cause.
    FailsOtherwise,
}

impl Judged {
    /// The result of a run with the cause `found`, or without a failure, when `wanted` is the
    /// wanted cause.
    pub fn of(found: Option<&str>, wanted: &str) -> Self {
        match found {
            None => Self::Passes,
            Some(found) if found == wanted => Self::FailsAlike,
            Some(_) => Self::FailsOtherwise,
        }
    }
}

/// The remaining effort.
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
    /// At most `most` tries.
    pub const fn tries(most: u32) -> Self {
        Self {
            tries: 0,
            most,
            is_over: None,
        }
    }
}

impl<'a> Effort<'a> {
    /// At most `most` tries, and none after `is_over` returns true.
    pub const fn until(most: u32, is_over: &'a dyn Fn() -> bool) -> Self {
        Self {
            tries: 0,
            most,
            is_over: Some(is_over),
        }
    }

    /// Number of tries so far.
    pub const fn spent(&self) -> u32 {
        self.tries
    }

    /// Whether one more try is allowed. A search ends without it: even a step without a try copies
    /// the case, which may have a hundred thousand damaged bytes.
    pub fn is_left(&self) -> bool {
        self.tries < self.most && !self.is_over.is_some_and(|is_over| is_over())
    }

    /// Whether one more try is allowed; counts it.
    pub fn spend(&mut self) -> bool {
        let is_left = self.is_left();
        self.tries += u32::from(is_left);
        is_left
    }
}

#[cfg(test)]
mod tests;
