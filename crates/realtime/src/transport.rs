//! Ports outside of the process: pseudo-terminals, real serial ports, network ports, memory.
//!
//! A transport only carries bytes: it has no timing, faults or line coding. These belong to the
//! line of the rig. A pseudo-terminal would hide them: it has no baud rate, and it holds some 16 kB
//! before a writer notices that the reader has stopped. A transport adds only information from
//! outside: whether a client has the port open, at which baud rate, and whether the plug was
//! pulled.

mod directory;
mod memory;
mod modes;
mod pty;
mod serial;
pub(crate) mod terminal;
mod udp;
mod watch;

use core::net::SocketAddr;
use core::time::Duration;
use std::io;
use std::os::fd::{BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use engine::rig::line::Mark;

pub use directory::{Note, PortDir};
pub use memory::Memory;
pub use modes::{Modes, Setting, Special};
pub use pty::Pty;
pub use serial::Serial;
pub use terminal::{Code, Settings, Terminal};
pub use udp::Udp;

/// One end of a byte pipe; the other end is outside the rig.
///
/// No method waits. The transport has no clock: its owner polls it, and waits with [`wait`].
pub trait Transport {
    /// Reads bytes of the other end into `buf`. Returns 0 if there are none now, or if `buf` is
    /// empty.
    ///
    /// Events come first: an event that [`next_event`](Self::next_event) returns after this call
    /// happened before the bytes of this call. If the other end sets its baud rate and then sends,
    /// the caller sees both in this order.
    ///
    /// # Errors
    /// [`TransportError::Lost`] if the port disappeared. Bytes that arrived before are returned
    /// first.
    fn read(&mut self, buf: &mut [u8]) -> Result<usize, TransportError>;

    /// Sends `bytes`, oldest first. Returns the number of bytes that the other end will be able to
    /// read. The rest is lost, as on a UART, and counted in [`counters`](Self::counters): the
    /// transport stores no bytes for an end that is closed or does not read.
    fn write(&mut self, bytes: &[u8]) -> usize;

    /// Sends `bytes` with damaged characters among them, `marks`. The settings of the other end
    /// decide about their form.
    fn write_marked(&mut self, bytes: &[u8], _marks: &[Mark]) -> usize {
        self.write(bytes)
    }

    /// Pulls the plug: the other end's files hang up, and its name disappears. Without effect where
    /// this is impossible.
    fn unplug(&mut self) {}

    /// Plugs in again: another port appears under the same name or under `name`. No client has it
    /// open.
    ///
    /// # Errors
    /// If the system has no port left, or the name is taken.
    fn plug(&mut self, _name: Option<&str>) -> Result<(), TransportError> {
        Ok(())
    }

    /// Number of ports that existed here so far: a new one after each plugging.
    fn made(&self) -> u64 {
        1
    }

    /// Emulates the terminal in this process from now on, at the rig's own times, and not in the
    /// kernel.
    fn model(&mut self) {}

    /// The terminal, if it is emulated here.
    fn terminal(&mut self) -> Option<&mut Terminal> {
        None
    }

    /// Applies the other end's settings to this terminal. Returns the number of bytes that become
    /// readable.
    fn set_terminal(&mut self, _settings: Settings) -> usize {
        0
    }

    /// Applies the other end's settings, where the kernel does not store all of them.
    fn tell(&mut self, _settings: Settings) {}

    /// The next event of the port, oldest first; each event is returned once.
    fn next_event(&mut self) -> Option<PortEvent>;

    /// Path under which the other end finds the port.
    fn path(&self) -> &Path;

    /// Number of lost bytes so far.
    fn counters(&self) -> Counters;

    /// Whether the other end has read all bytes since the last write, or does not need this end any
    /// more. For the end of a port.
    fn is_drained(&mut self) -> bool {
        true
    }

    /// Number of times that the other end took bytes, as of the last call of another method; `None`
    /// if reads are not visible.
    fn reads(&self) -> Option<u64> {
        None
    }

    /// Whether the other end requests RTS/CTS flow control from us; we act as its driver.
    fn has_flow_control(&self) -> bool {
        false
    }

    /// Line settings of the other end, as of the last call of [`read`](Self::read); `None` if they
    /// are not visible.
    fn modes(&self) -> Option<Modes> {
        None
    }

    /// Number of characters so far that lost bits because the other end uses fewer than eight bits,
    /// as far as this is visible.
    fn cut(&self) -> u64 {
        0
    }

    /// The other end's side, opened temporarily; `None` if it is not accessible.
    fn client_side(&self) -> Option<OwnedFd> {
        None
    }

    /// Appends the files that become readable when a [`read`](Self::read) may return new bytes. The
    /// list may be empty for a while, so the caller also polls again after a few milliseconds.
    fn readiness<'a>(&'a self, fds: &mut Vec<BorrowedFd<'a>>);

    /// Files of which one is ready or has hung up if a [`read`](Self::read) would find anything new
    /// except a changed rate; `None` if only that call can find it.
    fn stirs(&self) -> Option<Vec<BorrowedFd<'_>>> {
        None
    }

    /// Whether [`read`](Self::read) finds nothing new until the supervised other end makes a call.
    fn rests(&self) -> bool {
        false
    }

    /// Passes the bytes that the other end can read to the kernel, permanently.
    fn release(&mut self) {}
}

/// An event of the other end, besides bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortEvent {
    /// A client opened the port.
    Opened,
    /// The last client that had the port open closed it.
    Closed,
    /// The other end uses this baud rate from now on.
    BaudChanged(u32),
}

/// Bytes that were given to a transport and lost, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Written while the other end was closed.
    pub unheard: u64,
    /// Written while the other end was open and its buffer was full, because it did not read.
    pub overrun: u64,
}

/// Waits until one of `fds` is readable or `timeout` is over. May return early without a reason.
///
/// # Errors
/// Errors of poll(2), except an interrupted wait.
pub fn wait(fds: &[BorrowedFd<'_>], timeout: Duration) -> io::Result<()> {
    let timeout = Timespec::try_from(timeout).map_err(io::Error::other)?;
    match poll(&mut to_be_read(fds), Some(&timeout)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(errno) => Err(errno.into()),
    }
}

/// The `transports` that may have something new to read, found with one poll.
pub(crate) fn stirred<'a>(transports: impl Iterator<Item = &'a dyn Transport>) -> Vec<bool> {
    let (mut stirred, mut indices, mut files) = (Vec::new(), Vec::new(), Vec::new());
    for (index, transport) in transports.enumerate() {
        let stirs = transport.stirs();
        stirred.push(stirs.is_none());
        for file in stirs.into_iter().flatten() {
            indices.push(index);
            files.push(file);
        }
    }
    let mut fds = to_be_read(&files);
    let is_told = poll(&mut fds, Some(&Timespec::default())).is_ok();
    for (index, fd) in indices.into_iter().zip(&fds) {
        stirred[index] |= !is_told || !fd.revents().is_empty();
    }
    stirred
}

fn to_be_read<'a>(fds: &[BorrowedFd<'a>]) -> Vec<PollFd<'a>> {
    let fds = fds.iter();
    fds.map(|&fd| PollFd::from_borrowed_fd(fd, PollFlags::IN))
        .collect()
}

/// The reason why a port cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TransportError {
    /// A port name that cannot be a file name.
    #[error("port name {name:?}: expected a plain file name such as lidar")]
    Name {
        /// The given name.
        name: String,
    },
    /// The directory for the ports cannot be used.
    #[error("{}: expected a directory to put ports in: {source}", .path.display())]
    Directory {
        /// The directory.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The directory belongs to another running rig.
    #[error(
        "{}: another rig has its ports here: stop it or choose another \
         directory",
        .path.display()
    )]
    DirectoryInUse {
        /// The directory.
        path: PathBuf,
    },
    /// A file has the name of the port.
    #[error(
        "{}: expected a free name: this is not a link that a rig left behind; \
         remove it or choose another directory",
        .path.display()
    )]
    Occupied {
        /// Path of the file.
        path: PathBuf,
    },
    /// A link has the name of a file of the rig.
    #[error(
        "{}: expected a file of hilrig's or nothing, found a link: it may lead to a \
         file of another user; remove it or choose another directory",
        .path.display()
    )]
    LinkInTheWay {
        /// Path of the link.
        path: PathBuf,
    },
    /// The system provides no pseudo-terminal.
    #[error("{}: the system gave no pseudo-terminal: {source}", .path.display())]
    Pty {
        /// Path of the port.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The port does not exist.
    #[error(
        "{}: no such port: expected a serial port such as /dev/ttyUSB0 or a \
         link to one",
        .path.display()
    )]
    Missing {
        /// The given path.
        path: PathBuf,
    },
    /// The file is not a serial port.
    #[error(
        "{}: not a serial port: expected a device such as /dev/ttyUSB0 or a \
         link to one",
        .path.display()
    )]
    NotAPort {
        /// The given path.
        path: PathBuf,
    },
    /// Another program uses the port.
    #[error("{}: another program has this port: expected to have it alone", .path.display())]
    Busy {
        /// The given path.
        path: PathBuf,
    },
    /// The port exists, but cannot be opened or set up.
    #[error(
        "{}: expected a serial port that can be set to {baud} baud: \
         {source}",
        .path.display()
    )]
    Open {
        /// The given path.
        path: PathBuf,
        /// The requested rate.
        baud: u32,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The address does not exist on this machine, or another process uses it.
    #[error("udp:{address}: expected a free port of this machine: {source}")]
    Network {
        /// The given address.
        address: SocketAddr,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The port disappeared during the run.
    #[error(
        "{}: the port went away: expected it to stay until the end: \
         {source}",
        .path.display()
    )]
    Lost {
        /// The port.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
}
