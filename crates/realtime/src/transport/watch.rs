//! Openings, closings and reads of the client's end of a pseudo-terminal.
//!
//! The master alone cannot detect a client that closed and reopened the port between two polls, nor
//! a client's reads. inotify on the terminal's node reports both. Without inotify (its instances
//! are limited per user) the rig still works, but only notices a client that is absent at the time
//! of a poll.

use core::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;

use rustix::fs::inotify::{self, CreateFlags, ReadFlags, Reader, WatchFlags};

/// Maximum number of entries read from the kernel's queue in one poll; the next poll reads the
/// rest.
const ENTRIES_MAX: usize = 64;

/// Events since the last poll.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PortChanges {
    /// Whether the last client closed, and a client opened after that.
    pub(super) reopened: bool,
    /// Whether a client read bytes.
    pub(super) read: bool,
    /// Whether a client opened and closed the node since the last poll, and none is there now.
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

    /// Reads the queue. `open`: whether a client had the node open immediately before.
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

/// Clients that have the node open, according to the queue, which merges equal neighbours. An entry
/// may be newer than the time at which `open` was determined.
#[derive(Clone, Copy, Debug, Default)]
struct Clients {
    count: u32,
    /// Whether no client was there at the last poll.
    was_away: bool,
    /// Number of further polls in which an opening counts as one after the last client closed.
    left: u8,
    /// Whether a client reopened the port and the rig does not know it yet.
    reopened: bool,
    /// Whether a client was there at the last poll that the queue has not reported yet.
    is_ahead: bool,
    /// Whether a client opened since the last poll.
    has_opened: bool,
    /// Whether a client opened, and the last one closed after that.
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

    /// Whether a client opened and the last one closed after that, since the last poll.
    fn take_visit(&mut self) -> bool {
        self.has_opened = false;
        core::mem::take(&mut self.has_visited)
    }

    /// Ends a poll with an empty queue; `open`: whether a client was there immediately before.
    /// Returns whether this client opened after the client of the last poll had closed.
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

    /// Processes the queue's events of one poll, oldest first. `open`: whether a client was there
    /// immediately before.
    fn look(clients: &mut Clients, told: &str, open: bool) -> bool {
        for what in told.chars() {
            match what {
                '+' => clients.opened(),
                _ => clients.closed(),
            }
        }
        clients.looked(open)
    }

    /// An earlier client closes, another one opens. The rig reports this once when a client is
    /// there, at any order of polls.
    #[test]
    fn who_opens_again_is_heard_of_wherever_the_looks_fall() {
        let looks: [&[(&str, bool)]; 6] = [
            // Both before the poll.
            &[("-+", true)],
            // The old client is there when `open` is determined, and closes before the queue is
            // read.
            &[("-", true), ("+", true)],
            &[("-+", true), ("", true)],
            // No client is there when `open` is determined; the new one opens before the queue is
            // read.
            &[("-+", false), ("", true)],
            &[("-", false), ("+", true)],
            // The new client is there when `open` is determined; the queue reports it later.
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
            // A repetition shows that the count is right.
            assert!(look(&mut clients, "-+", true), "{looks:?}");
        }
    }

    /// A client that is absent at a poll has closed; it opens when a client is there again.
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

    /// A client that opens and closes between two polls is noticed once; a client that stays is not
    /// a visit.
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

    /// The queue reports two simultaneous openings as one. After the first client has closed, the
    /// second one is still there, and a third one joins it.
    #[test]
    fn who_comes_beside_another_has_not_opened_again() {
        let mut clients = Clients::default();
        assert!(!look(&mut clients, "+", true));
        assert!(!look(&mut clients, "-", true));
        assert!(!look(&mut clients, "", true));
        assert!(!look(&mut clients, "+", true));
        assert!(!look(&mut clients, "-+", true));
    }

    /// A client is there before the queue reports it: this is one client.
    #[test]
    fn who_is_there_before_the_queue_says_so_counts_once() {
        let mut clients = Clients::default();
        assert!(!look(&mut clients, "", true));
        assert!(!look(&mut clients, "+", true));
        assert!(look(&mut clients, "-+", true));
    }
}
