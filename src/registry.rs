//! Things known by name: those that come with the rig, and those that another crate adds.

use core::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Entries by name, built-in ones first. Entries are only ever added, so that what was found once
/// stays what it was.
pub(crate) struct Registry<T: ?Sized + 'static> {
    name_of: fn(&T) -> &'static str,
    built_in: &'static [&'static T],
    added: Mutex<Vec<&'static T>>,
}

impl<T: ?Sized + Sync> Registry<T> {
    /// A registry of `built_in`, whose names `name_of` tells.
    pub(crate) const fn new(
        name_of: fn(&T) -> &'static str,
        built_in: &'static [&'static T],
    ) -> Self {
        Self {
            name_of,
            built_in,
            added: Mutex::new(Vec::new()),
        }
    }

    /// Adds an entry.
    ///
    /// # Errors
    /// If there is one of its name.
    pub(crate) fn register(&self, entry: &'static T) -> Result<(), NameTaken> {
        let name = (self.name_of)(entry);
        let mut added = self.added();
        let mut known = self.built_in.iter().chain(added.iter());
        if known.any(|known| (self.name_of)(known) == name) {
            return Err(NameTaken { name });
        }
        added.push(entry);
        Ok(())
    }

    /// The entry called `name`.
    pub(crate) fn find(&self, name: &str) -> Option<&'static T> {
        self.all()
            .into_iter()
            .find(|entry| (self.name_of)(entry) == name)
    }

    /// All entries in the order in which they were added.
    pub(crate) fn all(&self) -> Vec<&'static T> {
        let added = self.added();
        self.built_in.iter().chain(added.iter()).copied().collect()
    }

    /// A panic elsewhere cannot leave a list half pushed to.
    fn added(&self) -> MutexGuard<'_, Vec<&'static T>> {
        self.added.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A name that is in use already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NameTaken {
    /// The name.
    pub name: &'static str,
}

impl fmt::Display for NameTaken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{}\" is registered already", self.name)
    }
}

impl core::error::Error for NameTaken {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_taken_once_and_found_ever_after() {
        static NAMES: Registry<str> = Registry::new(|_| "a", &["a"]);
        assert_eq!(NAMES.register("b"), Err(NameTaken { name: "a" }));
        static LENGTHS: Registry<str> =
            Registry::new(|text| if text.len() == 1 { "one" } else { "more" }, &["x"]);
        assert_eq!(LENGTHS.register("xx"), Ok(()));
        assert_eq!(LENGTHS.register("xxx"), Err(NameTaken { name: "more" }));
        assert_eq!(LENGTHS.find("more"), Some("xx"));
        assert_eq!(LENGTHS.all(), ["x", "xx"]);
    }
}
