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

#[cfg(test)]
mod tests {
    use nix::libc;
    use rustix::pty::{OpenptFlags, grantpt, openpt, unlockpt};

    use super::*;
    use crate::guest::supervisor::tests::{Bench, fd};
    use crate::guest::tests::Room;

    /// Bytes that are typed at a terminal arrive before anything else happens. Ctrl-C is a signal.
    #[test]
    fn typed_bytes_arrive_first() {
        let mut bench = Bench::new();
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY;
        let master = openpt(flags).expect("the system has them");
        grantpt(&master).expect("ours");
        unlockpt(&master).expect("ours");
        let name = ptsname(&master, Vec::new()).expect("it has one");
        let path = Path::new(OsStr::from_bytes(name.to_bytes())).to_owned();
        let text = Room::of(b"x");
        let types = |bench: &mut Bench, file: u64| {
            bench.supervisor.is_signalled = false;
            bench.calls(libc::SYS_write, &[file, text.at(0), 1]);
            assert!(bench.supervisor.is_signalled);
            bench.supervisor.typed.clone()
        };
        for _ in 0..2 {
            assert_eq!(types(&mut bench, fd(&master)), core::slice::from_ref(&path));
        }
        let settles = |bench: &mut Bench| {
            bench.supervisor.is_changed = false;
            bench.supervisor.settle_typed();
            assert!(bench.supervisor.typed.is_empty());
            bench.supervisor.is_changed
        };
        assert!(!settles(&mut bench), "no program has it open");
        let flags = OFlags::RDWR | OFlags::NOCTTY;
        let slave = open(&path, flags, Mode::empty()).expect("it is there");
        assert!(!settles(&mut bench), "nothing was typed");
        types(&mut bench, fd(&master));
        assert!(settles(&mut bench));
        // What the program shows at the other end is not typed.
        assert!(types(&mut bench, fd(&slave)).is_empty());
        // A pipe is no terminal.
        let (_ears, mouth) = std::io::pipe().expect("the system has pipes");
        bench.supervisor.is_signalled = false;
        bench.calls(libc::SYS_write, &[fd(&mouth), text.at(0), 1]);
        assert!(!bench.supervisor.is_signalled && bench.supervisor.typed.is_empty());
        // At most 64 are kept.
        bench.supervisor.typed = (0..64).map(|it| format!("/{it}").into()).collect();
        assert_eq!(types(&mut bench, fd(&master)).len(), 64);
        bench.supervisor.typed.pop();
        assert_eq!(types(&mut bench, fd(&master)).len(), 64);
    }
}
