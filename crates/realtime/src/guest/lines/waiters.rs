//! Threads that wait until a modem line changes (TIOCMIWAIT), or until all written bytes have left
//! (tcdrain). They stay stopped while the rig is asked repeatedly.

use core::time::Duration;
use std::collections::BTreeMap;

use nix::errno::Errno;
use nix::sys::ptrace;
use nix::unistd::Pid;
use rustix::process::WaitOptions;
use serde_json::json;

use super::super::call::Call;
use super::super::news::{group_of, wait};
use super::super::pending::Pending;
use super::terminals::{self, code};
use super::{RI, Tracer};
use crate::clock::{Clock as _, WallClock};

/// Interval between two questions to the rig.
const ASK_EVERY: Duration = Duration::from_millis(2);

/// A thread that waits at its call.
pub(super) struct Waiter {
    call: Call,
    device: u64,
    port: String,
    what: What,
}

/// The event that a thread waits for.
enum What {
    Line {
        /// The last known levels of the lines.
        lines: u32,
        /// Bits of the lines that the thread waits for.
        wanted: u64,
    },
    Sent,
}

impl Waiter {
    pub(super) const fn for_line(
        call: Call,
        device: u64,
        port: String,
        lines: u32,
        wanted: u64,
    ) -> Self {
        let what = What::Line { lines, wanted };
        Self {
            call,
            device,
            port,
            what,
        }
    }

    pub(super) const fn for_sent(call: Call, device: u64, port: String) -> Self {
        Self {
            call,
            device,
            port,
            what: What::Sent,
        }
    }

    /// Whether the event has come, with the levels `seen` and `waiting` bytes. For RI only a
    /// falling level counts, as in a 16550.
    fn sees(&mut self, seen: u32, waiting: u64) -> bool {
        match &mut self.what {
            What::Line { lines, wanted } => {
                let changed = core::mem::replace(lines, seen) ^ seen;
                let counts = changed & !(seen & RI);
                *wanted & u64::from(counts) != 0
            }
            What::Sent => waiting == 0,
        }
    }
}

impl Tracer {
    /// Returns the next event of any process. While a process waits for a modem line, polls the rig
    /// for it.
    pub(super) fn next_news(&mut self) -> Option<(i32, i32)> {
        if let Some(news) = self.ended.pop_front() {
            return Some(news);
        }
        while !self.waiters.is_empty() || !self.halted.is_empty() {
            if let Some(news) = wait(None, WaitOptions::NOHANG) {
                return Some(news);
            }
            self.look_at_lines();
            self.look_at_halted();
            let clock = WallClock::start();
            clock.sleep_until(clock.now() + ASK_EVERY);
        }
        wait(None, WaitOptions::empty())
    }

    /// Resumes processes that a signal stopped, once a signal that continues them is pending.
    fn look_at_halted(&mut self) {
        let goes_on = |&tid: &i32| {
            let process = group_of(tid).unwrap_or(tid);
            Pending::of(process, tid).continues()
        };
        let going: Vec<i32> = self.halted.iter().copied().filter(goes_on).collect();
        for tid in going {
            self.halted.remove(&tid);
            let _ = ptrace::cont(Pid::from_raw(tid), None);
        }
    }

    fn look_at_lines(&mut self) {
        let waiters = core::mem::take(&mut self.waiters);
        let mut still = BTreeMap::new();
        for (tid, mut waiter) in waiters {
            let port = &waiter.port;
            let lines = self.ask(port, &json!({"do": "modem", "port": port}));
            let result = match waiter.sees(lines, self.waiting) {
                true => Some(self.finish(Pid::from_raw(tid), &waiter)),
                false if Pending::of(tid, tid).interrupts() => {
                    Some(-i64::from(Errno::EINTR as i32))
                }
                // The rig has ended, so no line will ever change.
                false if self.rig.is_none() => Some(-i64::from(Errno::EIO as i32)),
                false => None,
            };
            let Some(result) = result else {
                still.insert(tid, waiter);
                continue;
            };
            let _ = waiter.call.answer(Pid::from_raw(tid), result);
            let _ = ptrace::cont(Pid::from_raw(tid), None);
        }
        self.waiters = still;
    }

    /// Executes the call of a thread after its wait; returns the result for the thread.
    fn finish(&mut self, pid: Pid, waiter: &Waiter) -> i64 {
        let file = terminals::copy_of(pid, waiter.call.args[0]);
        match (&waiter.what, file) {
            (What::Sent, Some(file)) => {
                let port = (waiter.device, &*waiter.port);
                code(self.once_sent(pid, &waiter.call, port, &file))
            }
            (What::Sent, None) => code(Err(Errno::EBADF)),
            (What::Line { .. }, _) => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(lines: u32, wanted: u64) -> Waiter {
        Waiter::for_line(Call::made(0, &[]), 7, "sonar".to_owned(), lines, wanted)
    }

    /// TIOCMIWAIT: a change of a line that is waited for; of RI, 0x80, only the end.
    #[test]
    fn a_change_of_a_wanted_line_is_seen() {
        let (cts, dcd, ri) = (0x20, 0x40, 0x80);
        let mut waiter = line(cts, (cts | ri).into());
        assert!(!waiter.sees(cts, 9));
        assert!(waiter.sees(0, 0));
        assert!(!waiter.sees(0, 0), "it is seen once");
        assert!(waiter.sees(cts, 0));
        assert!(!waiter.sees(cts | dcd, 0), "another line");
        assert!(!waiter.sees(cts | dcd | ri, 0), "the beginning of a ring");
        assert!(waiter.sees(cts | dcd, 0), "its end");
        assert!(!line(0, 0).sees(cts, 0), "it waits for none");
        assert!(line(ri, (cts | ri).into()).sees(cts, 0), "two at once");
    }

    /// tcdrain(3): until no byte waits.
    #[test]
    fn an_empty_queue_is_seen() {
        let mut waiter = Waiter::for_sent(Call::made(0, &[]), 7, "sonar".to_owned());
        assert!(!waiter.sees(0x20, 1) && !waiter.sees(0, 1));
        assert!(waiter.sees(0, 0));
    }
}
