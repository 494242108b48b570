//! The processor's counter, hidden from the supervisor as well as from the program.
//!
//! A supervised program cannot read the counter (PR_SET_TSC, prctl(2)). The kernel changes the
//! processor's CR4 register whenever one of two threads can read it and the other cannot. In a
//! virtual machine each change takes 4 us, because the host makes it: 9 us of the 25 us of a stop.
//! So the supervisor hides the counter from its own thread while it works.
//!
//! A hidden counter hides the system's clocks, too, because they are read with it, without a call.

use core::cell::Cell;
use core::marker::PhantomData;

use rustix::process::{TimeStampCounterReadability, set_time_stamp_counter_readability};

std::thread_local! {
    static IS_HIDDEN: Cell<bool> = const { Cell::new(false) };
}

fn show(is_shown: bool) -> bool {
    let readability = match is_shown {
        true => TimeStampCounterReadability::Readable,
        false => TimeStampCounterReadability::RaiseSIGSEGV,
    };
    set_time_stamp_counter_readability(readability).is_ok()
}

/// Reads a clock, for which the counter is readable.
pub(super) fn shown<T>(read: impl FnOnce() -> T) -> T {
    if !IS_HIDDEN.get() {
        return read();
    }
    show(true);
    let value = read();
    show(false);
    value
}

/// Hides the counter from this thread up to its end. Meanwhile only [`WallClock`] may read a clock,
/// and no thread or process may be started, because they inherit the state.
///
/// [`WallClock`]: super::WallClock
#[derive(Debug)]
pub(crate) struct Hidden {
    /// Whether another `Hidden` already hides the counter, or the system cannot hide it.
    is_idle: bool,
    /// The state belongs to one thread.
    not_send: PhantomData<*const ()>,
}

impl Hidden {
    pub(crate) fn begin() -> Self {
        let is_idle = IS_HIDDEN.get() || !show(false);
        if !is_idle {
            IS_HIDDEN.set(true);
        }
        Self {
            is_idle,
            not_send: PhantomData,
        }
    }
}

impl Drop for Hidden {
    fn drop(&mut self) {
        if !self.is_idle {
            show(true);
            IS_HIDDEN.set(false);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{Clock as _, WallClock, utc};

    /// Without the switch each of these readings would end the process with SIGSEGV.
    #[test]
    fn clocks_are_read_while_the_counter_is_hidden() {
        let before = WallClock::start();
        let hidden = Hidden::begin();
        assert!(IS_HIDDEN.get());
        drop(Hidden::begin());
        assert!(IS_HIDDEN.get());
        let inside = WallClock::start();
        assert!(inside.now() <= before.now());
        assert!(utc() > protocols::Instant::ZERO);
        drop(hidden);
        assert!(!IS_HIDDEN.get());
        assert!(before.now() >= inside.now());
    }
}
