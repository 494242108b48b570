//! `AsyncRead` and `AsyncWrite` of tokio, and a runtime in virtual time.
//!
//! tokio's own paused clock jumps to its next timer when all tasks wait; a byte that arrives before
//! that time would be late. Therefore this runtime controls the clock: when all tasks wait, the rig
//! runs to its next byte for one of them, at most for a millisecond, which is the resolution of
//! tokio's timers. tokio's clock follows.
//!
//! ```text
//! tasks wait -> on_thread_park wakes the root -> the rig runs -> tokio::time::advance
//!     ^                                                                 |
//!     +---------------- tasks whose byte or timer has arrived <---------+
//! ```

use core::future::{Future, poll_fn};
use core::pin::{Pin, pin};
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::{Context, Poll, Waker, ready};
use core::time::Duration;
use std::io;
use std::sync::{Arc, Mutex, PoisonError};

use protocols::Instant;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::runtime::Builder;

use crate::executor::Executor;
use crate::{Bench, VirtualPort};

/// Resolution of tokio's timers.
const TICK: Duration = Duration::from_millis(1);
/// Number of parks without a task in between after which all tasks wait: after the first one tokio
/// checks its timers.
const PARKS: u32 = 2;
/// Maximum number of clock steps after the end of the run: a future that waits longer would wait
/// forever.
const STEPS_AFTER_END: u32 = 600_000;

/// The state that the runtime reports when it parks.
#[derive(Default)]
struct Parking {
    parks: AtomicU32,
    root: Mutex<Option<Waker>>,
}

impl Parking {
    fn park(&self) {
        self.parks.fetch_add(1, Ordering::Relaxed);
        let root = self.root.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(root) = &*root {
            root.wake_by_ref();
        }
    }

    fn set_root(&self, waker: &Waker) {
        let mut root = self.root.lock().unwrap_or_else(PoisonError::into_inner);
        if !root.as_ref().is_some_and(|known| known.will_wake(waker)) {
            *root = Some(waker.clone());
        }
    }

    /// Whether all tasks wait; resets the state.
    fn is_idle(&self) -> bool {
        let is_idle = self.parks.load(Ordering::Relaxed) >= PARKS;
        if is_idle {
            self.parks.store(0, Ordering::Relaxed);
        }
        is_idle
    }
}

/// The clocks of the rig and of tokio.
struct Clocks<'a> {
    bench: &'a Bench,
    /// The start of both clocks.
    rig: Instant,
    tokio: tokio::time::Instant,
    after_end: u32,
}

impl Clocks<'_> {
    /// Runs until a task can continue, at most to tokio's next tick.
    fn step(&mut self, cx: &mut Context<'_>) {
        let passed = self.tokio.elapsed();
        let ticks = u32::try_from(passed.as_millis()).unwrap_or(u32::MAX);
        let tick = TICK * ticks.saturating_add(1);
        let turn = self.bench.core.enter();
        // After the verdict virtual time stands still; tokio's timers continue.
        let waited = turn.and_then(|turn| turn.wait_for_tasks(self.rig + tick));
        crate::expect_turn(waited);
        let mut reached = self.bench.now() - self.rig;
        if reached <= passed && self.bench.core.lock().is_at_end() {
            self.after_end += 1;
            assert!(
                self.after_end < STEPS_AFTER_END,
                "the future waits for an event that never comes: the run has been over for ten minutes"
            );
            reached = tick;
        }
        let advance = pin!(tokio::time::advance(reached.saturating_sub(passed)));
        // The second half of `advance` only lets other tasks run.
        let _ = advance.poll(cx);
    }
}

impl Bench {
    /// Runs a future on a tokio runtime of this thread, whose timers follow virtual time:
    /// `tokio::time::sleep`, `timeout`, `interval` and `spawn` work as usual. Timers have tokio's
    /// resolution of 1 ms; bytes arrive with nanosecond resolution. `spawn_blocking` and
    /// `tokio::fs` are not supported: virtual time does not wait for their threads.
    ///
    /// # Panics
    /// If the future waits for an event that never occurs, or if it runs inside another runtime.
    pub fn tokio<F: Future>(&self, future: F) -> F::Output {
        let parking = Arc::new(Parking::default());
        let parks = Arc::clone(&parking);
        let mut builder = Builder::new_current_thread();
        let builder = builder.enable_time().start_paused(true);
        let runtime = builder.on_thread_park(move || parks.park()).build();
        let runtime = runtime.expect("a runtime without input and output");
        let executor = Executor::of(self);
        let output = runtime.block_on(async {
            let mut clocks = Clocks {
                bench: self,
                rig: self.now(),
                // The current time of tokio's paused clock.
                tokio: tokio::time::sleep(Duration::ZERO).deadline(),
                after_end: 0,
            };
            let mut future = pin!(future);
            poll_fn(|cx| {
                parking.set_root(cx.waker());
                let polled = future.as_mut().poll(cx);
                if polled.is_pending() && parking.is_idle() {
                    clocks.step(cx);
                }
                polled
            })
            .await
        });
        // Remaining tasks are dropped before their bench.
        drop(runtime);
        drop(executor);
        output
    }
}

impl AsyncRead for VirtualPort {
    fn poll_read(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buf: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let len = ready!(Self::poll_read(&self, cx, buf.initialize_unfilled()))?;
        buf.advance(len);
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for VirtualPort {
    fn poll_write(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buf: &[u8],
    ) -> Poll<io::Result<usize>> {
        Self::poll_write(&self, cx, buf)
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Self::poll_flush(&self, cx)
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Self::poll_flush(&self, cx)
    }
}
