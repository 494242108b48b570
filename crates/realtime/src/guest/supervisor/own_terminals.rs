//! Terminals that the program makes for its own children: a worker of the kernel hands on what is
//! typed there, at any time.

use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::{ffi::OsStr, fs::read_link};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, major, minor, open};
use rustix::pty::ptsname;

use super::Supervisor;
use super::files::{File, numbers};

/// Most terminals that are settled after a turn.
const TYPED_MAX: usize = 64;

impl Supervisor {
    /// The program is about to write to a terminal of its own: Ctrl-C is a signal.
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

    /// Lets what was typed arrive before anything else happens, with its echo and its signals: a
    /// look at the terminal waits for the kernel's worker.
    pub(super) fn settle_typed(&mut self) {
        for path in core::mem::take(&mut self.typed) {
            // A terminal that is open nowhere would hang up when it is closed here.
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
