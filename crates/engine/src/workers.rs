//! Threads that build robots' programs.

use std::thread::{Builder, Scope, ScopedJoinHandle};

/// Stack of a thread. A program is built on the stack before it moves to the heap: with a map of 28
/// m these are several copies of 10 MB.
const STACK: usize = if cfg!(feature = "large") {
    128 << 20
} else {
    2 << 20
};

/// Runs `work` on a thread beside the caller.
///
/// # Panics
/// If the host cannot create a thread.
pub fn spawn<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    work: impl FnOnce() -> T + Send + 'scope,
) -> ScopedJoinHandle<'scope, T> {
    let thread = Builder::new().stack_size(STACK);
    let started = thread.spawn_scoped(scope, work);
    started.expect("a host has room for a thread")
}
