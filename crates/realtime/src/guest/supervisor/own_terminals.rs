//! Terminals that the program creates for its own children: a kernel thread transfers the typed
//! bytes, at any time.

use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::{ffi::OsStr, fs::read_link};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, major, minor, open};
use rustix::pty::ptsname;

use super::Supervisor;
use super::files::{File, numbers};

/// Maximum number of terminals that are settled after a turn.
const TYPED_MAX: usize = 64;

impl Supervisor {
    /// Records that the program is about to write to one of its own terminals: Ctrl-C is a signal.
    pub(super) fn types(&mut self, file: &File) {
        self.is_signalled = true;
        let is_master = file
            .device
            .is_some_and(|it| (major(it), minor(it)) == (5, 2));
        if !is_master || self.typed.len() >= TYPED_MAX {
            return;
        }
        if let Ok(name) = ptsname(&file.fd, Vec::new()) {
            let path = Path::new(OsStr::from_bytes(name.to_bytes())).to_owned();
            if !self.typed.contains(&path) {
                self.typed.push(path);
            }
        }
    }

    /// Waits until all typed bytes have arrived, with their echo and their signals, before anything
    /// else happens. A query of the terminal waits for the kernel thread.
    pub(super) fn settle_typed(&mut self) {
        for path in core::mem::take(&mut self.typed) {
            // A terminal without another open file would hang up when it is closed here.
            let is_open = self.processes.keys().any(|&pid| {
                let links = numbers(pid).map(|fd| read_link(format!("/proc/{pid}/fd/{fd}")));
                links.into_iter().flatten().any(|it| it == path)
            });
            let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
            if is_open && let Ok(terminal) = open(&path, flags, Mode::empty()) {
                let mut looks = [PollFd::new(&terminal, PollFlags::IN)];
                let _ = poll(&mut looks, Some(&Timespec::default()));
                self.is_changed = true;
            }
        }
    }
}
