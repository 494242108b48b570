//! Who opens, closes and reads the client's end of a pseudo-terminal.
//!
//! The master alone cannot tell a client that closed and reopened between two looks, nor whether
//! a client reads. inotify on the terminal's node tells both. It is a help, not a need: where it is
//! not to be had (its instances are limited per user), nothing is ever seen.

use core::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;

use rustix::fs::inotify::{self, CreateFlags, ReadFlags, Reader, WatchFlags};

/// Most entries taken from the kernel's queue in one look; the next look takes the rest.
const ENTRIES_MAX: usize = 64;

/// What happened since the last look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PortChanges {
    /// The last client closed, and somebody opened after that.
    pub(super) reopened: bool,
    /// A client took bytes out.
    pub(super) read: bool,
}

/// A watch on one node.
#[derive(Debug)]
pub(super) struct Watch {
    queue: Option<OwnedFd>,
    /// Clients that have the node open, as far as the queue tells: it merges equal neighbours.
    clients: u32,
}

impl Watch {
    pub(super) fn new(node: &Path) -> Self {
        let flags = WatchFlags::OPEN
            | WatchFlags::CLOSE_WRITE
            | WatchFlags::CLOSE_NOWRITE
            | WatchFlags::ACCESS;
        let queue = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)
            .and_then(|queue| inotify::add_watch(&queue, node, flags).map(|_| queue))
            .ok();
        Self { queue, clients: 0 }
    }

    /// Empties the queue. `open` is the truth about now: whether any client has the node open.
    pub(super) fn look(&mut self, open: bool) -> PortChanges {
        let mut seen = PortChanges::default();
        let mut closed = false;
        if let Some(queue) = &self.queue {
            let mut buf = [MaybeUninit::uninit(); 1024];
            let mut reader = Reader::new(queue, &mut buf);
            for _ in 0..ENTRIES_MAX {
                let Ok(entry) = reader.next() else { break };
                let what = entry.events();
                seen.read |= what.contains(ReadFlags::ACCESS);
                if what.contains(ReadFlags::OPEN) {
                    seen.reopened |= closed;
                    self.clients += 1;
                }
                if what.intersects(ReadFlags::CLOSE_WRITE | ReadFlags::CLOSE_NOWRITE) {
                    self.clients = self.clients.saturating_sub(1);
                    closed |= self.clients == 0;
                }
            }
        }
        self.clients = if open { self.clients.max(1) } else { 0 };
        seen
    }

    pub(super) fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.queue.as_ref().map(AsFd::as_fd)
    }
}
