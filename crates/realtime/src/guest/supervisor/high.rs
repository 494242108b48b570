//! Delivery of signals above 31, including those of timers and ports with their data.

use nix::sys::signal::Signal;
use nix::unistd::Pid;

use super::{Flow, Supervisor};
use crate::guest::high_signals::{Delivered, deliver};

impl Supervisor {
    /// Handles a thread that has stopped at this signal.
    pub(super) fn high_signal(&mut self, tid: i32, signal: i32) -> Flow {
        let Some(process) = self.threads.get(&tid).map(|thread| thread.process) else {
            return Flow::Goes(None);
        };
        let told = self.told_by_timer(process, signal);
        let told = told.or_else(|| self.told_by_notice(process, signal));
        match deliver(
            process,
            Pid::from_raw(tid),
            signal,
            told.as_ref().map(|told| &told[..]),
        ) {
            Delivered::Goes => Flow::Goes(None),
            Delivered::Fatal => {
                if let Some(process) = self.processes.get_mut(&process) {
                    process.fatal = Some(signal);
                }
                Flow::Goes(Some(Signal::SIGKILL))
            }
            Delivered::Ended(status) => {
                self.died(tid, status);
                Flow::Stays
            }
            Delivered::Refused => {
                self.note(format!("signal {signal} could not be passed on"));
                Flow::Goes(None)
            }
        }
    }
}
