//! A file of the program: the supervisor's copy and its kind.

use std::os::fd::OwnedFd;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_getfl};

/// The kind of a file, as far as waiting is concerned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Reading and writing never wait.
    Prompt,
    /// A port of the rig.
    Port(usize),
    /// One that the supervisor answers.
    Told(usize),
    /// What was a port of the rig, and hung up: nothing waits there.
    Gone,
    /// The system's source of chance.
    Chance,
    /// What the program says: heard in wall time.
    Mouth,
    /// Signals, as bits.
    Signals(u64),
    /// Pipes, sockets, events: may wait.
    Stream,
}

/// A file of the program.
#[derive(Debug)]
pub(super) struct File {
    pub(super) fd: OwnedFd,
    pub(super) kind: Kind,
    /// The device that it is, if it is one of characters.
    pub(super) device: Option<u64>,
}

impl File {
    /// Whether its owner does not want to wait.
    pub(super) fn never_waits(&self) -> bool {
        fcntl_getfl(&self.fd).is_ok_and(|flags| flags.contains(OFlags::NONBLOCK))
    }

    /// What can be done now, of `wanted`.
    pub(super) fn readiness(&self, wanted: PollFlags) -> PollFlags {
        let mut fds = [PollFd::new(&self.fd, wanted)];
        match poll(&mut fds, Some(&Timespec::default())) {
            Ok(_) => fds[0].revents(),
            Err(_) => PollFlags::empty(),
        }
    }
}
