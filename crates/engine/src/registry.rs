//! Lists of named items: built-in ones, and items that other crates add.
//!
//! A list only grows, and its items stay as long as the process lives. A handle is therefore a
//! plain `&'static T` that is copied, compared and kept without an owner. The order never changes:
//! first the built-in items, then the added ones in the order of their addition.

use core::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// An item of a [`Registry`].
pub(crate) trait Named {
    /// Name on the command line and in files.
    fn name(&self) -> &str;
}

/// A list of named items, process-wide if it is a `static`.
pub(crate) struct Registry<T: ?Sized + 'static> {
    built_in: &'static [&'static T],
    added: Mutex<Vec<&'static T>>,
}

impl<T: ?Sized + Named> Registry<T> {
    /// A list of built-in items with different names.
    pub(crate) const fn new(built_in: &'static [&'static T]) -> Self {
        let added = Mutex::new(Vec::new());
        Self { built_in, added }
    }

    /// All items, in their order.
    pub(crate) fn all(&self) -> Vec<&'static T> {
        [self.built_in, &self.added()[..]].concat()
    }

    /// The item called `name`.
    pub(crate) fn find(&self, name: &str) -> Option<&'static T> {
        self.all().into_iter().find(|one| one.name() == name)
    }

    /// All names in alphabetical order, for a message.
    pub(crate) fn names(&self) -> Vec<&'static str> {
        let mut names: Vec<_> = self.all().into_iter().map(Named::name).collect();
        names.sort_unstable();
        names
    }

    /// Adds `one` after the others.
    ///
    /// # Errors
    /// If there is an item with its name.
    pub(crate) fn register(&self, one: Box<T>) -> Result<&'static T, NameTaken> {
        let mut added = self.added();
        let mut others = self.built_in.iter().chain(added.iter());
        if others.any(|other| other.name() == one.name()) {
            return Err(NameTaken::new(one.name()));
        }
        let one: &'static T = Box::leak(one);
        added.push(one);
        Ok(one)
    }

    /// A panic of another thread cannot have left the list incomplete.
    fn added(&self) -> MutexGuard<'_, Vec<&'static T>> {
        self.added.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An item with this name exists. Written by hand, because the fuzzers' build of the codecs has no
/// dependency for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NameTaken {
    /// The name.
    pub name: String,
}

impl fmt::Display for NameTaken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the name \"{}\" is already taken", self.name)
    }
}

impl core::error::Error for NameTaken {}

impl NameTaken {
    pub(crate) fn new(name: &str) -> Self {
        let name = name.to_owned();
        Self { name }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Thing(&'static str);

    impl Named for Thing {
        fn name(&self) -> &str {
            self.0
        }
    }

    #[test]
    fn what_is_added_comes_behind_what_is_built_in_and_names_are_unique() {
        let list = Registry::new(&[&Thing("m"), &Thing("b")]);
        let added = list.register(Box::new(Thing("k"))).expect("a new name");
        assert!(core::ptr::eq(added, list.find("k").expect("added")));
        for taken in ["k", "b"] {
            let refused = list.register(Box::new(Thing(taken)));
            assert_eq!(refused.err(), Some(NameTaken::new(taken)));
        }
        let order: Vec<_> = list.all().iter().map(|thing| thing.0).collect();
        assert_eq!(order, ["m", "b", "k"]);
        assert_eq!(list.names(), ["b", "k", "m"]);
        assert!(list.find("x").is_none());
    }
}
