//! Futures in virtual time: time continues while all of them wait.

use core::fmt;
use core::future::Future;
use core::pin::{Pin, pin};
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::{Context, Poll, Waker};
use core::time::Duration;
use std::sync::Arc;
use std::task::Wake;

use protocols::Instant;

use crate::Bench;
use crate::turns::{NEVER, Until};

/// Records that a future was woken.
struct Flag(Arc<AtomicBool>);

impl Wake for Flag {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Runs futures on the current thread until it is dropped.
pub(crate) struct Executor<'a> {
    bench: &'a Bench,
    pub(crate) woken: Arc<AtomicBool>,
    before: Option<Arc<AtomicBool>>,
}

impl<'a> Executor<'a> {
    pub(crate) fn of(bench: &'a Bench) -> Self {
        let woken = Arc::new(AtomicBool::new(false));
        let mut turn = bench.core.enter().unwrap_or_else(|error| panic!("{error}"));
        let before = turn.set_executor(Some(Arc::clone(&woken)));
        drop(turn);
        Self {
            bench,
            woken,
            before,
        }
    }
}

impl Drop for Executor<'_> {
    fn drop(&mut self) {
        // After the verdict no future waits any more.
        if let Ok(mut turn) = self.bench.core.enter() {
            turn.set_executor(self.before.take());
        }
    }
}

impl Bench {
    /// Runs a future in virtual time. Time continues while the future waits for a port or a
    /// [timer](Self::timer) of the bench.
    ///
    /// # Panics
    /// If the future waits for anything else: it would wait forever.
    pub fn block_on<F: Future>(&self, future: F) -> F::Output {
        let executor = Executor::of(self);
        let waker = Waker::from(Arc::new(Flag(Arc::clone(&executor.woken))));
        let mut context = Context::from_waker(&waker);
        let mut future = pin!(future);
        loop {
            executor.woken.store(false, Ordering::Relaxed);
            if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
                return output;
            }
            let turn = self.core.enter().unwrap_or_else(|error| panic!("{error}"));
            let waited = turn.wait_for_tasks(NEVER);
            waited.unwrap_or_else(|error| panic!("{error}"));
        }
    }

    /// A future that completes after `span` of virtual time, or when the run is over.
    pub fn timer(&self, span: Duration) -> Timer {
        Timer {
            bench: self.clone(),
            span,
            until: None,
            number: 0,
        }
    }
}

/// A span of virtual time, see [`Bench::timer`]. It begins when the future is first polled.
#[must_use = "a timer does nothing unless awaited"]
pub struct Timer {
    bench: Bench,
    span: Duration,
    until: Option<Instant>,
    /// Number of the timer, set at the first poll.
    number: u64,
}

impl Drop for Timer {
    fn drop(&mut self) {
        if self.until.is_some() {
            self.bench.core.forget(self.number);
        }
    }
}

impl fmt::Debug for Timer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Timer").field(&self.span).finish()
    }
}

impl Future for Timer {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let bench = self.bench.clone();
        let Ok(mut turn) = bench.core.enter() else {
            return Poll::Ready(());
        };
        let (now, end, span) = (turn.now(), turn.end(), self.span);
        let until = match self.until {
            Some(until) => until,
            None => {
                self.number = turn.new_timer();
                *self.until.insert((now + span).min(end))
            }
        };
        let polled = turn.poll(cx, Until::Timer(self.number), until);
        polled.map(|outcome| outcome.unwrap_or_else(|error| panic!("{error}")))
    }
}
