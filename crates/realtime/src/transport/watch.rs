//! Openings, closings and reads of the client's end of a pseudo-terminal.
//!
//! The master alone cannot tell a client that closed and reopened between two looks, nor whether a
//! client reads. inotify on the terminal's node tells both. It is a help, not a need: where inotify
//! is not available (its instances are limited per user), the rig only notices a client that is
//! away at the moment of a look.

use core::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;

use rustix::fs::inotify::{self, CreateFlags, ReadFlags, Reader, WatchFlags};

/// Maximum number of entries taken from the kernel's queue in one look; the next look takes the
/// rest.
const ENTRIES_MAX: usize = 64;

/// What happened since the last look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PortChanges {
    /// The last client closed, and a client opened after that.
    pub(super) reopened: bool,
    /// A client took bytes out.
    pub(super) read: bool,
    /// No client is there, but one opened and closed the node since the last look.
    pub(super) visited: bool,
}

/// A watch on one node.
#[derive(Debug)]
pub(super) struct Watch {
    queue: Option<OwnedFd>,
    clients: Clients,
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
        let clients = Clients::default();
        Self { queue, clients }
    }

    /// Empties the queue. `open` is whether any client had the node open right before.
    pub(super) fn look(&mut self, open: bool) -> PortChanges {
        let mut read = false;
        if let Some(queue) = &self.queue {
            let mut buf = [MaybeUninit::uninit(); 1024];
            let mut reader = Reader::new(queue, &mut buf);
            for _ in 0..ENTRIES_MAX {
                let Ok(entry) = reader.next() else { break };
                let what = entry.events();
                read |= what.contains(ReadFlags::ACCESS);
                if what.contains(ReadFlags::OPEN) {
                    self.clients.opened();
                }
                if what.intersects(ReadFlags::CLOSE_WRITE | ReadFlags::CLOSE_NOWRITE) {
                    self.clients.closed();
                }
            }
        }
        let visited = self.clients.take_visit() && !open;
        let reopened = self.clients.looked(open);
        PortChanges {
            reopened,
            read,
            visited,
        }
    }

    pub(super) fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.queue.as_ref().map(AsFd::as_fd)
    }
}

/// Clients that have the node open, as far as the queue tells: it merges equal neighbours. What it
/// says may be from after the moment for which it is known whether any client is there.
#[derive(Clone, Copy, Debug, Default)]
struct Clients {
    count: u32,
    /// No client was there at the last look.
    was_away: bool,
    /// For this many looks more, an opening counts as one after the last client closed.
    left: u8,
    /// A client did reopen the port, and the rig has not been told yet.
    reopened: bool,
    /// At the last look one was there that the queue may only now tell of.
    is_ahead: bool,
    /// A client opened since the last look.
    has_opened: bool,
    /// A client opened, and the last one closed after that.
    has_visited: bool,
}

impl Clients {
    fn opened(&mut self) {
        self.reopened |= core::mem::take(&mut self.left) > 0;
        self.has_opened = true;
        if !core::mem::take(&mut self.is_ahead) {
            self.count += 1;
        }
    }

    fn closed(&mut self) {
        self.count = self.count.saturating_sub(1);
        if self.count == 0 {
            self.left = 2;
            self.has_visited |= self.has_opened;
        }
    }

    /// Whether a client opened and the last one closed after that, since the last look.
    fn take_visit(&mut self) -> bool {
        self.has_opened = false;
        core::mem::take(&mut self.has_visited)
    }

    /// The queue is empty, and `open` tells whether a client was there right before that. Returns
    /// whether this client opened after the last look's client had closed.
    fn looked(&mut self, open: bool) -> bool {
        self.left = self.left.saturating_sub(1);
        self.is_ahead = open && self.count == 0;
        if !open {
            (self.count, self.left, self.was_away) = (0, 0, true);
            return false;
        }
        self.count = self.count.max(1);
        core::mem::take(&mut self.reopened) | core::mem::take(&mut self.was_away)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Feeds the queue's events of one look, oldest first. `open`: whether a client was there right
    /// before.
    fn look(clients: &mut Clients, told: &str, open: bool) -> bool {
        for what in told.chars() {
            match what {
                '+' => clients.opened(),
                _ => clients.closed(),
            }
        }
        clients.looked(open)
    }

    /// A client of before closes, another opens. The rig reports this once, when a client is there,
    /// at whatever moments it looks.
    #[test]
    fn who_opens_again_is_heard_of_wherever_the_looks_fall() {
        let looks: [&[(&str, bool)]; 6] = [
            // Both before it looks.
            &[("-+", true)],
            // The old one is there when it asks, and closes before it empties the queue.
            &[("-", true), ("+", true)],
            &[("-+", true), ("", true)],
            // No client is there when it asks, the new one comes before it empties the queue.
            &[("-+", false), ("", true)],
            &[("-", false), ("+", true)],
            // The new one is there when it asks, the queue says so later.
            &[("-", false), ("", true), ("+", true)],
        ];
        for looks in looks {
            let mut clients = Clients::default();
            assert!(!look(&mut clients, "+", true), "{looks:?}");
            let told = looks
                .iter()
                .map(|(told, open)| look(&mut clients, told, *open))
                .filter(|told| *told);
            assert_eq!(told.count(), 1, "{looks:?}");
            assert!(!look(&mut clients, "", true), "{looks:?}");
            // The same once more: the count is right.
            assert!(look(&mut clients, "-+", true), "{looks:?}");
        }
    }

    /// A client that is away at a look has closed, and opens when a client is there again.
    #[test]
    fn who_was_away_opens_once() {
        let mut clients = Clients::default();
        assert!(!look(&mut clients, "", false));
        assert!(look(&mut clients, "+", true));
        assert!(!look(&mut clients, "", true));
        assert!(!look(&mut clients, "-", false));
        assert!(!look(&mut clients, "+-", false));
        assert!(look(&mut clients, "+", true));
        assert!(!look(&mut clients, "+", true));
    }

    /// A client that opens and closes between two looks is noticed once; one that stays is not a
    /// visit.
    #[test]
    fn a_visit_between_two_looks_is_noticed() {
        let mut clients = Clients::default();
        let mut visit = |told: &str, open| {
            for what in told.chars() {
                match what {
                    '+' => clients.opened(),
                    _ => clients.closed(),
                }
            }
            let visited = clients.take_visit();
            clients.looked(open);
            visited
        };
        assert!(visit("+-", false));
        assert!(!visit("", false));
        assert!(!visit("+", true));
        assert!(!visit("-", false));
        assert!(visit("+-+-", false));
    }

    /// The queue reports two openings at the same moment as one. When the first of them has closed,
    /// the second is still there, and a later client comes beside it.
    #[test]
    fn who_comes_beside_another_has_not_opened_again() {
        let mut clients = Clients::default();
        assert!(!look(&mut clients, "+", true));
        assert!(!look(&mut clients, "-", true));
        assert!(!look(&mut clients, "", true));
        assert!(!look(&mut clients, "+", true));
        assert!(!look(&mut clients, "-+", true));
    }

    /// A client is there before the queue says so: that is one client.
    #[test]
    fn who_is_there_before_the_queue_says_so_counts_once() {
        let mut clients = Clients::default();
        assert!(!look(&mut clients, "", true));
        assert!(!look(&mut clients, "+", true));
        assert!(look(&mut clients, "-+", true));
    }
}
