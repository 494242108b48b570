//! Queries of the unread bytes: only the kernel knows them, and only the client's side can ask it.
//!
//! The master sees neither a read nor a flush of a client. A watch on the terminal's node reports
//! reads; nothing reports flushes. A client that flushed a full port once left it silent forever,
//! because the rig's own count showed no room.

use rustix::io::{Errno, ioctl_fionread};
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};

use super::{Code, Pty, open_client_side};

/// Number of refused bytes or fruitless polls after which the kernel is queried again.
const PATIENCE: u32 = 64;

/// State of the queries.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Asked {
    /// Whether an event since the last query makes the count too large.
    pub(super) is_due: bool,
    /// Refused bytes and fruitless polls since the last query.
    refused: u32,
    looks: u32,
}

impl Pty {
    /// Makes bytes readable for the client; returns the number of bytes with room.
    pub(super) fn put(&mut self, bytes: &[u8]) -> usize {
        let room = self.room(bytes.len());
        if self.plugged.is_some() && self.terminal.hold(bytes) {
            self.unread += bytes.len();
            self.since_read += bytes.len();
            return bytes.len();
        }
        if self.plugged.is_none() {
            return 0;
        }
        let written = self.hand_over(&bytes[..room]);
        self.unread += written;
        self.since_read += written;
        self.counters.overrun += (bytes.len() - written) as u64;
        written
    }

    /// Writes bytes to the kernel's terminal; returns the number that it took.
    pub(super) fn hand_over(&self, bytes: &[u8]) -> usize {
        let mut written = 0;
        while let Some(master) = self.master().filter(|_| written < bytes.len()) {
            match rustix::io::write(master, &bytes[written..]) {
                Ok(len) if len > 0 => written += len,
                Err(Errno::INTR) => {}
                // The kernel's own buffer is full. The next read reports any other error.
                _ => break,
            }
        }
        written
    }

    /// Number of bytes, up to `wanted`, that the client may get.
    pub(super) fn room(&mut self, wanted: usize) -> usize {
        if self.terminal.is_whole() {
            // The terminal model has already checked the room.
            return wanted;
        }
        if self.unread + wanted > Self::UNREAD_MAX && self.is_time_to_ask(wanted) {
            self.ask();
        }
        Self::UNREAD_MAX.saturating_sub(self.unread).min(wanted)
    }

    /// Whether to query the kernel although this opens the client's side.
    fn is_time_to_ask(&mut self, wanted: usize) -> bool {
        let refused = u32::try_from(wanted).unwrap_or(u32::MAX);
        self.asked.refused = self.asked.refused.saturating_add(refused);
        self.asked.is_due || self.asked.refused >= PATIENCE
    }

    /// Updates the count of unread bytes from the kernel.
    fn ask(&mut self) {
        self.asked = Asked::default();
        let Some(master) = self.master() else {
            return;
        };
        self.unread = match open_client_side(master) {
            Ok(client_side) => ioctl_fionread(&client_side)
                .ok()
                .and_then(|len| usize::try_from(len).ok())
                .unwrap_or(self.unread),
            // The client uses the port exclusively (TIOCEXCL): the kernel refuses bytes without
            // room.
            Err(_) => 0,
        };
        if self.unread == 0 {
            self.since_read = 0;
        }
    }

    /// Whether the client can read the bytes since its last read; it may have flushed, or wait for
    /// more (VMIN).
    pub(super) fn may_be_read(&mut self) -> bool {
        self.asked.looks += 1;
        if self.asked.looks < PATIENCE {
            return true;
        }
        self.asked.looks = 0;
        let Some(settings) = self.kernel_settings() else {
            return true;
        };
        if settings.is_canonical() {
            return true;
        }
        self.ask();
        self.unread >= usize::from(settings.code(Code::Least)).max(1)
    }

    /// Records that the client has no unread bytes.
    pub(super) fn forget_unread(&mut self) {
        (self.unread, self.since_read) = (0, 0);
        self.asked = Asked::default();
    }

    /// Discards unread bytes, because the kernel would keep them for the next client.
    pub(super) fn discard_unread(&mut self) {
        self.forget_unread();
        if self.terminal.holds() {
            self.terminal.forget();
        }
        let Some(master) = self.master() else {
            return;
        };
        // First discard bytes on their way to the client's side, then those that have arrived
        // there; the second queue is accessible only from that side.
        let _ = tcflush(master, QueueSelector::OFlush);
        match open_client_side(master) {
            Ok(client_side) => {
                let _ = tcflush(&client_side, QueueSelector::IFlush);
            }
            // A client uses or used the port exclusively. Setting the modes again also flushes.
            Err(Errno::BUSY) => {
                if let Ok(termios) = tcgetattr(master) {
                    let _ = tcsetattr(master, OptionalActions::Flush, &termios);
                }
            }
            Err(_) => {}
        }
    }
}
