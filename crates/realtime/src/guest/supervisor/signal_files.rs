//! Files from which signals are read (signalfd): the kernel shows pending signals only to their
//! owner, so the supervisor keeps track of them itself.

use std::fs::read_to_string;
use std::os::fd::AsRawFd as _;

use nix::errno::Errno;
use rustix::event::PollFlags;

use super::clocks::low_i32;
use super::files::{File, Kind};
use super::{On, Outcome, Supervisor, Wait};
use crate::guest::pending::Pending;

impl Supervisor {
    /// Whether `tid` would find a signal in `file`, which is of this kind.
    pub(super) fn has_signal(&self, tid: i32, file: &File) -> bool {
        let process = self.threads.get(&tid).map_or(tid, |thread| thread.process);
        let pending = Pending::of(process, tid);
        (pending.own | pending.common) & signals_of(file).unwrap_or(0) != 0
    }

    pub(super) fn read_signals(&self, tid: i32, file: &File) -> Outcome {
        match self.has_signal(tid, file) || file.never_waits() {
            true => Outcome::Kernel,
            false => Outcome::Block(Wait {
                on: On::Files,
                deadline: None,
            }),
        }
    }

    /// The report of an epoll set about such files in it: flags and the program's own data.
    pub(super) fn epoll_signals(&mut self, tid: i32, set: u64) -> Result<Vec<(u32, u64)>, Errno> {
        if !self.has_signal_files {
            return Ok(Vec::new());
        }
        let process = self.threads.get(&tid).map_or(tid, |thread| thread.process);
        let info = read_to_string(format!("/proc/{process}/fdinfo/{}", low_i32(set)));
        let info = info.map_err(|_| Errno::EBADF)?;
        let mut found = Vec::new();
        // Format: "tfd:        5 events:       19 data:                5 ..", all numbers but the
        // first in hex.
        for line in info.lines() {
            let mut words = line.split_ascii_whitespace();
            if words.next() != Some("tfd:") {
                continue;
            }
            let fd = words.next().and_then(|word| word.parse().ok());
            let mut number = || u64::from_str_radix(words.nth(1)?, 16).ok();
            let (Some(fd), Some(events), Some(data)) = (fd, number(), number()) else {
                continue;
            };
            let wanted = u64::from(PollFlags::IN.bits());
            let file = self.file(tid, fd);
            let Some(file) = file.filter(|file| file.kind == Kind::Signals) else {
                continue;
            };
            if events & wanted != 0 && self.has_signal(tid, &file) {
                found.push((u32::from(PollFlags::IN.bits()), data));
            }
        }
        Ok(found)
    }
}

/// The signals of a signalfd, as bits; `None` for another file.
fn signals_of(file: &File) -> Option<u64> {
    let info = read_to_string(format!("/proc/self/fdinfo/{}", file.fd.as_raw_fd())).ok()?;
    let mask = info
        .lines()
        .find_map(|line| line.strip_prefix("sigmask:"))?;
    u64::from_str_radix(mask.trim(), 16).ok()
}
