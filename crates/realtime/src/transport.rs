//! Where bytes leave the process: pseudo-terminals, real serial ports, network ports, memory.
//!
//! A transport carries bytes and nothing else: no timing, no faults, no line coding. Those belong
//! to the line of the rig. A pseudo-terminal would hide them: it has no baud rate, and it holds
//! some 16 kB before a writer notices that the reader has stopped. A transport adds only what the
//! outside knows: whether a client has the port open, at which baud rate, and whether the plug was
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

/// One end of a byte pipe whose other end is outside the rig.
///
/// Nothing here ever waits. The transport has no clock: its owner polls it, and waits with
/// [`wait`].
pub trait Transport {
    /// Moves bytes that the other end has sent into `buf`; 0: nothing now, or `buf` is empty.
    ///
    /// Events come first: what [`next_event`](Self::next_event) tells after this call happened
    /// before the bytes that the call returned. So a other end that set its baud rate and then sent
    /// is received in that order.
    ///
    /// # Errors
    /// [`TransportError::Lost`] if the port went away. Bytes that arrived before come first.
    fn read(&mut self, buf: &mut [u8]) -> Result<usize, TransportError>;

    /// Sends `bytes`, oldest first, and returns how many the other end will be able to read. The
    /// rest is lost, as on a UART, and counted in [`counters`](Self::counters): the transport
    /// keeps no bytes for a other end that is closed or does not read.
    fn write(&mut self, bytes: &[u8]) -> usize;

    /// The same where characters among them are damaged, `marks`: what the other end has of those
    /// is up to its settings.
    fn write_marked(&mut self, bytes: &[u8], _marks: &[Mark]) -> usize {
        self.write(bytes)
    }

    /// The plug is pulled: the other end's files hang up, and its name is gone. Nothing where that
    /// cannot be.
    fn unplug(&mut self) {}

    /// The plug is back: another port is there under the same name or under `name`, and no client
    /// has it open yet.
    ///
    /// # Errors
    /// If there is none left, or the name is taken.
    fn plug(&mut self, _name: Option<&str>) -> Result<(), TransportError> {
        Ok(())
    }

    /// Counts the ports that there were here one after the other.
    fn made(&self) -> u64 {
        1
    }

    /// From now on all that a terminal does is done here, at the rig's own moments, and nothing by
    /// the kernel.
    fn model(&mut self) {}

    /// The terminal of which all is done here.
    fn terminal(&mut self) -> Option<&mut Terminal> {
        None
    }

    /// The other end changes the settings of that terminal; how many bytes it can read because of
    /// that.
    fn set_terminal(&mut self, _settings: Settings) -> usize {
        0
    }

    /// The other end's settings, where the kernel does not keep all of them.
    fn tell(&mut self, _settings: Settings) {}

    /// What happened to the port, oldest first, each told once.
    fn next_event(&mut self) -> Option<PortEvent>;

    /// The name under which the other end finds the port.
    fn path(&self) -> &Path;

    /// What was lost so far.
    fn counters(&self) -> Counters;

    /// Whether the other end has read since the last write, or does not depend on this end any
    /// more. Asked before a port is given up.
    fn is_drained(&mut self) -> bool {
        true
    }

    /// How often the other end was seen to take bytes; `None` where that cannot be seen. As of the
    /// last call of anything else here.
    fn reads(&self) -> Option<u64> {
        None
    }

    /// Whether the other end wants RTS/CTS flow control of us, which stand in for its driver.
    fn has_flow_control(&self) -> bool {
        false
    }

    /// Line settings of the other end, as of the last call of [`read`](Self::read); `None` where
    /// they cannot be seen.
    fn modes(&self) -> Option<Modes> {
        None
    }

    /// Characters so far that lost bits because the other end has fewer than eight in each, as far
    /// as that can be seen.
    fn cut(&self) -> u64 {
        0
    }

    /// The other end's side, opened once more for a moment; `None` where it is out of reach.
    fn client_side(&self) -> Option<OwnedFd> {
        None
    }

    /// Appends what becomes readable when a [`read`](Self::read) may bring something new. May be
    /// empty for a while, so the caller also polls again after a few milliseconds.
    fn readiness<'a>(&'a self, fds: &mut Vec<BorrowedFd<'a>>);

    /// The files of which one is ready, or hung up, if a [`read`](Self::read) would bring anything
    /// new but a changed rate; `None` where only that call tells.
    fn stirs(&self) -> Option<Vec<BorrowedFd<'_>>> {
        None
    }

    /// Whether [`read`](Self::read) brings nothing new until the supervised far end makes a call.
    fn rests(&self) -> bool {
        false
    }

    /// Hands the bytes that the far end can read to the kernel, for good.
    fn release(&mut self) {}
}

/// Something besides bytes happened at the other end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortEvent {
    /// A client opened the port.
    Opened,
    /// The last client that had the port open closed it.
    Closed,
    /// The other end runs at this baud rate from here on.
    BaudChanged(u32),
}

/// Bytes that were given to a transport and lost, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Written while the other end was closed.
    pub unheard: u64,
    /// Written while the other end was open and had no room, because it did not read.
    pub overrun: u64,
}

/// Waits until one of `fds` is readable or `timeout` is over. May return early for no reason.
///
/// # Errors
/// Those of poll(2); an interrupted wait is none.
pub fn wait(fds: &[BorrowedFd<'_>], timeout: Duration) -> io::Result<()> {
    let timeout = Timespec::try_from(timeout).map_err(io::Error::other)?;
    match poll(&mut to_be_read(fds), Some(&timeout)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(errno) => Err(errno.into()),
    }
}

/// Which of `transports` may have something new to read, by one look at all of them.
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

/// Why a port cannot be had, or is had no longer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TransportError {
    /// A port name that cannot be a file name.
    #[error("port name {name:?}: expected a plain file name such as lidar")]
    Name {
        /// As given.
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
    /// Something stands where the port should appear.
    #[error(
        "{}: expected a free name: this is not a link that a rig left behind; \
         remove it or choose another directory",
        .path.display()
    )]
    Occupied {
        /// Where.
        path: PathBuf,
    },
    /// A link stands where a rig would write a file of its own.
    #[error(
        "{}: expected a file of hilrig's or nothing, found a link: it may lead to a \
         file of another user; remove it or choose another directory",
        .path.display()
    )]
    LinkInTheWay {
        /// Where.
        path: PathBuf,
    },
    /// The system gave no pseudo-terminal.
    #[error("{}: the system gave no pseudo-terminal: {source}", .path.display())]
    Pty {
        /// Where it should have appeared.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// There is no such port.
    #[error(
        "{}: no such port: expected a serial port such as /dev/ttyUSB0 or a \
         link to one",
        .path.display()
    )]
    Missing {
        /// As given.
        path: PathBuf,
    },
    /// The file is no serial port.
    #[error(
        "{}: not a serial port: expected a device such as /dev/ttyUSB0 or a \
         link to one",
        .path.display()
    )]
    NotAPort {
        /// As given.
        path: PathBuf,
    },
    /// Another program has the port.
    #[error("{}: another program has this port: expected to have it alone", .path.display())]
    Busy {
        /// As given.
        path: PathBuf,
    },
    /// The port is there and cannot be opened or set up.
    #[error(
        "{}: expected a serial port that can be set to {baud} baud: \
         {source}",
        .path.display()
    )]
    Open {
        /// As given.
        path: PathBuf,
        /// What was tried.
        baud: u32,
        /// The error of the operating system.
        source: io::Error,
    },
    /// There is no such address here, or another process listens there.
    #[error("udp:{address}: expected a free port of this machine: {source}")]
    Network {
        /// As given.
        address: SocketAddr,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The port was there and went away.
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
