//! Things known by name, ours and those of other crates: robots, kinds of devices, codecs.

use core::fmt;
use std::sync::{PoisonError, RwLock};

/// Values by name, in a fixed order: the built-in ones, then others as they were added. Nothing is
/// ever taken out, so that a name goes on meaning the same.
pub(crate) struct Registry<T: ?Sized + Sync + 'static> {
    built_in: &'static [&'static T],
    name: fn(&T) -> &'static str,
    added: RwLock<Vec<&'static T>>,
}

/// There is one of this name already.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NameTaken {
    /// The name.
    pub name: &'static str,
}

impl fmt::Display for NameTaken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{}\" is taken, expected another name", self.name)
    }
}

impl core::error::Error for NameTaken {}

impl<T: ?Sized + Sync + 'static> Registry<T> {
    /// The built-in values; `name` tells how each is called.
    pub(crate) const fn new(built_in: &'static [&'static T], name: fn(&T) -> &'static str) -> Self {
        Self {
            built_in,
            name,
            added: RwLock::new(Vec::new()),
        }
    }

    /// All of them.
    pub(crate) fn all(&self) -> Vec<&'static T> {
        let added = self.added.read().unwrap_or_else(PoisonError::into_inner);
        self.built_in.iter().chain(added.iter()).copied().collect()
    }

    /// The one called `name`.
    pub(crate) fn find(&self, name: &str) -> Option<&'static T> {
        self.all().into_iter().find(|one| (self.name)(one) == name)
    }

    /// Adds one for the rest of the process.
    ///
    /// # Errors
    /// If there is one of that name already, even the same.
    pub(crate) fn add(&self, one: &'static T) -> Result<(), NameTaken> {
        let name = (self.name)(one);
        let mut added = self.added.write().unwrap_or_else(PoisonError::into_inner);
        let mut known = self.built_in.iter().chain(added.iter());
        if known.any(|other| (self.name)(other) == name) {
            return Err(NameTaken { name });
        }
        added.push(one);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_added_comes_last_and_no_name_twice() {
        static NAMES: Registry<str> = Registry::new(&["b"], |_| "b");
        assert_eq!(NAMES.find("b"), Some("b"));
        assert_eq!(NAMES.add("b"), Err(NameTaken { name: "b" }));
        let numbers: Registry<(&'static str, u8)> = Registry::new(&[&("z", 1)], |one| one.0);
        assert_eq!(numbers.add(&("a", 2)), Ok(()));
        assert!(numbers.add(&("a", 3)).is_err());
        assert_eq!(numbers.all(), [&("z", 1), &("a", 2)]);
    }
}
