//! A pseudo-terminal: what a client opens as if it were a serial port.
//!
//! Made for a client that knows nothing of us: the terminal is raw before its name appears, so no
//! byte is ever echoed or translated; a client that opens late reads nothing that was sent before
//! it came; one that does not read loses bytes as on a UART. All of it was found out by trying;
//! nothing of it is promised by a standard.
//!
//! The master has no notion of "open": it reports a hang-up after the last client closed, until the
//! next one opens. A terminal that nobody ever opened reports none, so we open and close it once.

use std::collections::VecDeque;
use std::ffi::OsStr;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use protocols::LineConfig;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, ioctl_tiocgptpeer, openpt, ptsname, unlockpt};
use rustix::termios::{
    ControlModes, OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr,
};

use super::directory::{Link, PortDir};
use super::watch::Watch;
use super::{Counters, PortEvent, Transport, TransportError};

/// The rig's end of a pseudo-terminal.
#[derive(Debug)]
pub struct Pty {
    link: Link,
    master: OwnedFd,
    watch: Watch,
    open: bool,
    /// Bytes written since the client last read anything, or opened.
    unread: usize,
    reads: u64,
    baud: u32,
    counters: Counters,
    events: VecDeque<PortEvent>,
}

impl Pty {
    /// Unread bytes that a client which never reads is given; what a Linux terminal holds. More is
    /// an overrun, as in a UART driver.
    pub const UNREAD_MAX: usize = 4096;

    /// Makes a terminal and lets it appear in `dir` as `name`, raw and at the baud rate of `line`,
    /// so that a client which sets nothing is right.
    ///
    /// # Errors
    /// If the system has no terminal left, or `name` is taken by something that is not ours.
    pub fn open(dir: &PortDir, name: &str, line: LineConfig) -> Result<Self, TransportError> {
        let made = make(line.baud).map_err(|source| TransportError::Pty {
            path: dir.path().join(name),
            source,
        });
        let (master, node) = made?;
        let node = Path::new(OsStr::from_bytes(node.as_bytes()));
        let watch = Watch::new(node);
        Ok(Self {
            link: dir.publish(name, node)?,
            master,
            watch,
            open: false,
            unread: 0,
            reads: 0,
            baud: line.baud,
            counters: Counters::default(),
            events: VecDeque::new(),
        })
    }

    /// Whether a client has the port open, as far as the last call of `read` or `write` saw.
    pub fn is_open(&self) -> bool {
        self.open
    }

    /// Notices who came and went; whether anybody is there.
    fn look(&mut self) -> bool {
        let open = !self.is_hung_up();
        let seen = self.watch.look(open);
        if seen.read {
            self.reads += 1;
            self.unread = 0;
        }
        if open && !self.open {
            self.opened();
        } else if open && seen.reopened {
            self.discard_unread();
            self.events.push_back(PortEvent::Closed);
            self.opened();
        }
        open
    }

    fn opened(&mut self) {
        self.open = true;
        self.unread = 0;
        self.events.push_back(PortEvent::Opened);
    }

    fn closed(&mut self) {
        self.open = false;
        self.discard_unread();
        self.events.push_back(PortEvent::Closed);
    }

    fn is_hung_up(&self) -> bool {
        let mut fds = [PollFd::new(&self.master, PollFlags::empty())];
        let polled = poll(&mut fds, Some(&Timespec::default()));
        polled.is_ok() && fds[0].revents().contains(PollFlags::HUP)
    }

    /// Throws away what no client has read yet. The kernel would keep it for the next one.
    fn discard_unread(&mut self) {
        self.unread = 0;
        // First what is still on its way to the client's side, then what has arrived there; that
        // queue can only be reached from that side. A client that came at this moment and took the
        // port for itself may refuse us; then it finds a few old bytes, as after a real reopening.
        let _ = tcflush(&self.master, QueueSelector::OFlush);
        if let Ok(client_side) = open_client_side(&self.master) {
            let _ = tcflush(&client_side, QueueSelector::IFlush);
        }
    }

    /// Takes note of the baud rate that the client has set; the master sees it.
    fn check_baud(&mut self) {
        if let Ok(termios) = tcgetattr(&self.master) {
            let baud = termios.output_speed();
            if baud != self.baud {
                self.baud = baud;
                self.events.push_back(PortEvent::BaudChanged(baud));
            }
        }
    }
}

impl Transport for Pty {
    fn read(&mut self, buf: &mut [u8]) -> Result<usize, TransportError> {
        self.look();
        if buf.is_empty() {
            return Ok(0);
        }
        match rustix::io::read(&self.master, buf) {
            Ok(len) => {
                if !self.open {
                    // Came, sent and went between two looks.
                    self.opened();
                }
                // After reading: the client set its rate before it sent these bytes.
                self.check_baud();
                Ok(len)
            }
            // The system's way of saying that no client is there.
            Err(Errno::IO) => {
                if self.open {
                    self.closed();
                }
                Ok(0)
            }
            Err(Errno::AGAIN | Errno::INTR) => {
                self.check_baud();
                Ok(0)
            }
            Err(errno) => Err(TransportError::Lost {
                path: self.path().to_owned(),
                source: errno.into(),
            }),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> usize {
        if !self.look() {
            self.counters.unheard += bytes.len() as u64;
            return 0;
        }
        let room = Self::UNREAD_MAX
            .saturating_sub(self.unread)
            .min(bytes.len());
        let mut written = 0;
        while written < room {
            match rustix::io::write(&self.master, &bytes[written..room]) {
                Ok(len) if len > 0 => written += len,
                Err(Errno::INTR) => {}
                // The kernel's own buffer is full. Any other failure shows in the next read.
                _ => break,
            }
        }
        self.unread += written;
        self.counters.overrun += (bytes.len() - written) as u64;
        written
    }

    /// What its client has not read yet is lost with the terminal. How much that is the system does
    /// not say, but the client is seen to read.
    fn is_drained(&mut self) -> bool {
        !self.look() || self.unread == 0
    }

    fn reads(&self) -> Option<u64> {
        self.watch.fd().map(|_| self.reads)
    }

    fn next_event(&mut self) -> Option<PortEvent> {
        self.events.pop_front()
    }

    fn path(&self) -> &Path {
        self.link.path()
    }

    fn counters(&self) -> Counters {
        self.counters
    }

    fn has_flow_control(&self) -> bool {
        let modes = tcgetattr(&self.master).map(|termios| termios.control_modes);
        modes.is_ok_and(|modes| modes.contains(ControlModes::CRTSCTS))
    }

    fn client_side(&self) -> Option<OwnedFd> {
        open_client_side(&self.master).ok()
    }

    fn readiness<'a>(&'a self, fds: &mut Vec<BorrowedFd<'a>>) {
        fds.extend(self.watch.fd());
        // A hung-up master is ready all the time: waiting for it would be a busy loop.
        if self.open && !self.is_hung_up() {
            fds.push(self.master.as_fd());
        }
    }

    fn stirs(&self) -> Option<Vec<BorrowedFd<'_>>> {
        let mut fds = vec![self.watch.fd()?];
        // Nobody is there, and so it is hung up.
        fds.extend(self.open.then(|| self.master.as_fd()));
        Some(fds)
    }
}

/// A master and the path of its client side, raw, at `baud`, opened and closed once.
fn make(baud: u32) -> io::Result<(OwnedFd, std::ffi::CString)> {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    unlockpt(&master)?;
    let client_side = open_client_side(&master)?;
    let mut termios = tcgetattr(&client_side)?;
    termios.make_raw();
    termios.set_speed(baud)?;
    tcsetattr(&client_side, OptionalActions::Flush, &termios)?;
    fcntl_setfl(&master, fcntl_getfl(&master)? | OFlags::NONBLOCK)?;
    let node = ptsname(&master, Vec::new())?;
    Ok((master, node))
}

fn open_client_side(master: &OwnedFd) -> rustix::io::Result<OwnedFd> {
    ioctl_tiocgptpeer(
        master,
        OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC,
    )
}
