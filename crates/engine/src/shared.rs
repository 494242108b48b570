//! A value that a run and its observers share.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// A value with several owners, e.g. the notes of a [tap](crate::rig::trace::Tap) in a rig and in
/// the test that reads them. A rig moves between threads, so its observers do.
#[derive(Debug, Default)]
pub struct Shared<T>(Arc<Mutex<T>>);

impl<T> Shared<T> {
    /// A shared `value` with one owner.
    pub fn new(value: T) -> Self {
        Self(Arc::new(Mutex::new(value)))
    }

    /// The value, locked. A second lock on the same thread waits forever.
    pub fn lock(&self) -> MutexGuard<'_, T> {
        // A panic of an owner leaves the value valid.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A reference that does not own the value.
    pub(crate) fn downgrade(&self) -> WeakShared<T> {
        WeakShared(Arc::downgrade(&self.0))
    }
}

impl<T> Clone for Shared<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

/// A reference to a [`Shared`] value that does not own it.
#[derive(Debug)]
pub(crate) struct WeakShared<T>(Weak<Mutex<T>>);

impl<T> WeakShared<T> {
    /// The value, unless its last owner was dropped.
    pub(crate) fn upgrade(&self) -> Option<Shared<T>> {
        self.0.upgrade().map(Shared)
    }
}
