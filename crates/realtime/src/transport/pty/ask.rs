//! What a client has not read: the kernel knows, and is asked through the client's side.
//!
//! The master sees neither that a client reads nor that it flushes. A watch on the terminal's node
//! reports the first, and nothing reports the second. A client that flushed a full port once left
//! it silent forever, because the rig's own count said that there was no room.

use rustix::io::{Errno, ioctl_fionread};
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};

use super::{Code, Pty, open_client_side};

/// Refused bytes, or looks, after which the kernel is asked once more.
const PATIENCE: u32 = 64;

/// When the kernel was asked last.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Asked {
    /// Something happened since that makes the count too large.
    pub(super) is_due: bool,
    /// Bytes refused, and looks in vain, since then.
    refused: u32,
    looks: u32,
}

impl Pty {
    /// Puts bytes where the client reads them; how many there was room for.
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

    /// Gives bytes to the kernel's terminal; how many it took.
    pub(super) fn hand_over(&self, bytes: &[u8]) -> usize {
        let mut written = 0;
        while let Some(master) = self.master().filter(|_| written < bytes.len()) {
            match rustix::io::write(master, &bytes[written..]) {
                Ok(len) if len > 0 => written += len,
                Err(Errno::INTR) => {}
                // The kernel's own buffer is full. Any other failure shows in the next read.
                _ => break,
            }
        }
        written
    }

    /// How many of `wanted` bytes the client may be given.
    pub(super) fn room(&mut self, wanted: usize) -> usize {
        if self.terminal.is_whole() {
            // It has seen to that already.
            return wanted;
        }
        if self.unread + wanted > Self::UNREAD_MAX && self.is_time_to_ask(wanted) {
            self.ask();
        }
        Self::UNREAD_MAX.saturating_sub(self.unread).min(wanted)
    }

    /// Whether to ask the kernel although that costs an opening of the client's side.
    fn is_time_to_ask(&mut self, wanted: usize) -> bool {
        let refused = u32::try_from(wanted).unwrap_or(u32::MAX);
        self.asked.refused = self.asked.refused.saturating_add(refused);
        self.asked.is_due || self.asked.refused >= PATIENCE
    }

    /// Takes the kernel's word for what is unread.
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
            // The client has the port to itself (TIOCEXCL): the kernel refuses what has no room.
            Err(_) => 0,
        };
        if self.unread == 0 {
            self.since_read = 0;
        }
    }

    /// Whether what was written since the client last read can be read by it: it may have flushed,
    /// or wait for more (VMIN).
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

    /// Nothing is there that the client could read.
    pub(super) fn forget_unread(&mut self) {
        (self.unread, self.since_read) = (0, 0);
        self.asked = Asked::default();
    }

    /// Throws away what no client has read yet. The kernel would keep it for the next one.
    pub(super) fn discard_unread(&mut self) {
        self.forget_unread();
        if self.terminal.holds() {
            self.terminal.forget();
        }
        let Some(master) = self.master() else {
            return;
        };
        // First what is still on its way to the client's side, then what has arrived there; that
        // queue can only be reached from that side.
        let _ = tcflush(master, QueueSelector::OFlush);
        match open_client_side(master) {
            Ok(client_side) => {
                let _ = tcflush(&client_side, QueueSelector::IFlush);
            }
            // A client has, or had, the port to itself. Settings that are set again flush, too.
            Err(Errno::BUSY) => {
                if let Ok(termios) = tcgetattr(master) {
                    let _ = tcsetattr(master, OptionalActions::Flush, &termios);
                }
            }
            Err(_) => {}
        }
    }
}
