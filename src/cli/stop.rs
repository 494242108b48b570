//! The end of a command without a fixed end: a signal or a time limit.

use core::sync::atomic::{AtomicU8, Ordering};
use core::time::Duration;
use std::io;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::thread;

use nodes::process::stop_waiting;
use protocols::Instant;
use tokio::runtime;
use tokio::signal::unix::{SignalKind, signal};

use super::CliError;

/// Maximum number of pairs of descriptors that the runtime needs: its queue, its alarm, two ends of
/// a pipe for signals and copies of them.
const SPARE_PAIRS: usize = 4;
/// Numbers of the handled signals, the same on all processors of Linux.
const SIGHUP: u8 = 1;
const SIGINT: u8 = 2;
pub(super) const SIGTERM: u8 = 15;

/// The condition to stop.
pub(super) struct Stop {
    /// Number of the received signal; 0: none yet.
    signal: Arc<AtomicU8>,
    deadline: Option<Instant>,
}

impl Stop {
    /// Stops at SIGINT, SIGTERM or the SIGHUP of a closed terminal, or `duration` after the start.
    pub(super) fn new(duration: Option<Duration>) -> Result<Self, CliError> {
        let signal = Arc::<AtomicU8>::default();
        listen(Arc::clone(&signal)).map_err(CliError::Signals)?;
        Ok(Self {
            signal,
            deadline: duration.map(|duration| Instant::ZERO + duration),
        })
    }

    /// Treats the end of standard input as SIGTERM: the process at its other end has ended, even by
    /// SIGKILL. Data before that is ignored.
    pub(super) fn at_end_of_input(&self) {
        let signal = Arc::clone(&self.signal);
        thread::spawn(move || {
            // No input follows an error either.
            let _ = io::copy(&mut io::stdin().lock(), &mut io::sink());
            signal.store(SIGTERM, Ordering::Relaxed);
            stop_waiting();
        });
    }

    /// Whether to stop now.
    pub(super) fn is_due(&self, now: Instant) -> bool {
        self.signal().is_some() || self.deadline.is_some_and(|at| at <= now)
    }

    /// Number of the received signal, if any.
    pub(super) fn signal(&self) -> Option<u8> {
        Some(self.signal.load(Ordering::Relaxed)).filter(|&signal| signal != 0)
    }
}

/// Name of a signal that [`Stop::signal`] gives.
pub(super) const fn name_of(signal: u8) -> &'static str {
    match signal {
        SIGHUP => "SIGHUP",
        SIGTERM => "SIGTERM",
        _ => "SIGINT",
    }
}

/// Waits for signals on a separate thread. The handlers are installed before this returns, so that
/// no later signal ends the process without removing its ports.
fn listen(caught: Arc<AtomicU8>) -> io::Result<()> {
    // The runtime panics without free descriptors; this check returns an error instead.
    let spare: Vec<_> = (0..SPARE_PAIRS)
        .map(|_| UnixStream::pair())
        .collect::<io::Result<_>>()?;
    drop(spare);
    let runtime = runtime::Builder::new_current_thread().enable_io().build()?;
    let (mut interrupt, mut terminate, mut hangup) = {
        let _context = runtime.enter();
        (
            signal(SignalKind::interrupt())?,
            signal(SignalKind::terminate())?,
            is_hangup_heard()
                .then(|| signal(SignalKind::hangup()))
                .transpose()?,
        )
    };
    thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            let number = runtime.block_on(core::future::poll_fn(|context| {
                if interrupt.poll_recv(context).is_ready() {
                    return core::task::Poll::Ready(SIGINT);
                }
                let hangup = hangup.as_mut();
                if hangup.is_some_and(|hangup| hangup.poll_recv(context).is_ready()) {
                    return core::task::Poll::Ready(SIGHUP);
                }
                terminate.poll_recv(context).map(|_| SIGTERM)
            }));
            caught.store(number, Ordering::Relaxed);
            stop_waiting();
        })?;
    Ok(())
}

/// Whether a SIGHUP would end this process: below `nohup` it is ignored and must stay ignored.
fn is_hangup_heard() -> bool {
    let status = std::fs::read_to_string("/proc/self/status");
    status.is_ok_and(|status| ignores_hangup(&status) == Some(false))
}

/// Whether SIGHUP, the lowest bit, is among the ignored signals of a `/proc/PID/status`.
fn ignores_hangup(status: &str) -> Option<bool> {
    let mut lines = status.lines();
    let mask = lines.find_map(|line| line.strip_prefix("SigIgn:"))?;
    let mask = u64::from_str_radix(mask.trim(), 16).ok()?;
    Some(mask & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lines are those of a shell and of the same below `nohup`.
    #[test]
    fn a_hangup_that_is_ignored_stays_ignored() {
        let status =
            |mask: &str| format!("SigBlk:\t0000000000000001\nSigIgn:\t{mask}\nSigCgt:\t0\n");
        assert_eq!(ignores_hangup(&status("0000000000000004")), Some(false));
        assert_eq!(ignores_hangup(&status("0000000000000005")), Some(true));
        assert_eq!(ignores_hangup("Name:\tsh\n"), None);
    }
}
