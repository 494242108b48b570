//! When a command that would run for ever ends: a signal, or its time is up.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::io;
use std::sync::Arc;
use std::thread;

use protocols::Instant;
use tokio::runtime;
use tokio::signal::unix::{SignalKind, signal};

use super::CliError;

/// Tells when to stop.
pub(super) struct Stop {
    signalled: Arc<AtomicBool>,
    deadline: Option<Instant>,
}

impl Stop {
    /// Stops at SIGINT or SIGTERM, or `duration` after the start.
    pub(super) fn new(duration: Option<Duration>) -> Result<Self, CliError> {
        let signalled = Arc::new(AtomicBool::new(false));
        listen(Arc::clone(&signalled))
            .map_err(|error| CliError::Other(format!("cannot listen for signals: {error}")))?;
        Ok(Self {
            signalled,
            deadline: duration.map(|duration| Instant::ZERO + duration),
        })
    }

    /// Whether it is time.
    pub(super) fn is_due(&self, now: Instant) -> bool {
        self.signalled.load(Ordering::Relaxed) || self.deadline.is_some_and(|at| at <= now)
    }
}

/// Waits for signals on a thread of its own. They are caught before this returns, so that none
/// that comes later ends the process with its ports still in place.
fn listen(signalled: Arc<AtomicBool>) -> io::Result<()> {
    let runtime = runtime::Builder::new_current_thread().enable_io().build()?;
    let (mut interrupt, mut terminate) = {
        let _context = runtime.enter();
        (
            signal(SignalKind::interrupt())?,
            signal(SignalKind::terminate())?,
        )
    };
    thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            runtime.block_on(core::future::poll_fn(|context| {
                let caught = interrupt.poll_recv(context).is_ready()
                    || terminate.poll_recv(context).is_ready();
                if caught {
                    core::task::Poll::Ready(())
                } else {
                    core::task::Poll::Pending
                }
            }));
            signalled.store(true, Ordering::Relaxed);
        })?;
    Ok(())
}
