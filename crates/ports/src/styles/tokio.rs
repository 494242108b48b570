//! `AsyncRead` and `AsyncWrite` of tokio, and a runtime in virtual time.
//!
//! tokio's own paused clock jumps to its next timer as soon as all tasks wait. A byte that arrives
//! before that would be late. So this runtime never lets it jump: when all tasks wait, the rig runs
//! to its next byte for one of them, at most to the next millisecond, which is the step of tokio's
//! timers; then tokio's clock follows.
//!
//! ```text
//! tasks wait -> on_thread_park wakes the root -> the rig goes on -> tokio::time::advance
//!     ^                                                                   |
//!     +--------------------- tasks whose byte or timer came <-------------+
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

/// Step of tokio's timers.
const TICK: Duration = Duration::from_millis(1);
/// Parks without a task in between that show that all wait: in the first one tokio looks at its
/// timers.
const PARKS: u32 = 2;
/// Steps of tokio's clock after the end of the run: a future that waits longer waits forever.
const STEPS_AFTER_END: u32 = 600_000;

/// What the runtime says when it parks.
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

    /// Whether all tasks wait; asked once.
    fn is_idle(&self) -> bool {
        let is_idle = self.parks.load(Ordering::Relaxed) >= PARKS;
        if is_idle {
            self.parks.store(0, Ordering::Relaxed);
        }
        is_idle
    }
}

/// Time of the rig and of tokio side by side.
struct Clocks<'a> {
    bench: &'a Bench,
    /// Where both began.
    rig: Instant,
    tokio: tokio::time::Instant,
    after_end: u32,
}

impl Clocks<'_> {
    /// Goes on until a task can, at most to tokio's next tick.
    fn step(&mut self, cx: &mut Context<'_>) {
        let passed = self.tokio.elapsed();
        let ticks = u32::try_from(passed.as_millis()).unwrap_or(u32::MAX);
        let tick = TICK * ticks.saturating_add(1);
        let turn = self.bench.core.enter();
        // After the verdict the rig stands; tokio's timers go on.
        let waited = turn.and_then(|turn| turn.wait_for_tasks(self.rig + tick));
        crate::expect_turn(waited);
        let mut reached = self.bench.now() - self.rig;
        if reached <= passed && self.bench.core.lock().is_at_end() {
            self.after_end += 1;
            assert!(
                self.after_end < STEPS_AFTER_END,
                "the future waits for something that never comes: the run is over since ten minutes"
            );
            reached = tick;
        }
        let advance = pin!(tokio::time::advance(reached.saturating_sub(passed)));
        // Its second half only lets other tasks work.
        let _ = advance.poll(cx);
    }
}

impl Bench {
    /// Runs a future on a tokio runtime of this thread, whose timers follow the rig's clock:
    /// `tokio::time::sleep`, `timeout`, `interval` and `spawn` work as usual. Timers have tokio's
    /// resolution of 1 ms; bytes arrive at their nanosecond. `spawn_blocking` and `tokio::fs`
    /// are not supported: virtual time does not wait for their threads.
    ///
    /// # Panics
    /// If the future waits for something that never comes, or inside of another runtime.
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
                // The present of tokio's paused clock.
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
        // Tasks that are left are dropped while their bench is still there.
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
