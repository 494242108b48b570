//! Threads that build robots' programs.

use std::thread::{Builder, Scope, ScopedJoinHandle};

/// What a program goes over on its way to the heap: with a map of 28 m that is 10 MB, some times.
const STACK: usize = if cfg!(feature = "large") {
    128 << 20
} else {
    2 << 20
};

/// Does `work` beside the caller.
///
/// # Panics
/// If the host has no room for a thread.
pub fn spawn<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    work: impl FnOnce() -> T + Send + 'scope,
) -> ScopedJoinHandle<'scope, T> {
    let thread = Builder::new().stack_size(STACK);
    let started = thread.spawn_scoped(scope, work);
    started.expect("a host has room for a thread")
}
