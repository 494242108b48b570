//! A pseudo-terminal, which a client opens like a serial port.
//!
//! A client need not know of the rig. The terminal is raw before its name appears, so no byte is
//! ever echoed or translated. A client that opens late reads no earlier bytes. A client that does
//! not read loses bytes, as on a UART. All of this was found by tries; no standard guarantees it.
//!
//! The master cannot query whether the terminal is open. It reports a hang-up after the last client
//! closed, until the next one opens. A terminal that was never opened reports no hang-up, so we
//! open and close it once.
//!
//! Only the kernel knows the number of unread bytes: the client may read a part, or flush. The
//! count kept here is an upper bound. The kernel is queried before a byte counts as lost.

mod ask;
#[cfg(test)]
mod tests;

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
use rustix::termios::{ControlModes, OptionalActions, tcgetattr, tcsetattr};

use super::directory::{Link, PortDir};
use super::terminal::{Code, Settings, Terminal};
use super::watch::Watch;
use super::{Counters, Modes, PortEvent, Transport, TransportError};
use engine::rig::line::Mark;

/// The rig's end of a pseudo-terminal.
#[derive(Debug)]
pub struct Pty {
    link: Link,
    line: LineConfig,
    /// `None` while its plug is pulled.
    plugged: Option<Plugged>,
    /// Number of terminals created for this port.
    made: u64,
    open: bool,
    /// Maximum number of bytes that the client may not have read yet; see [`ask`].
    unread: usize,
    /// Bytes written since the last visible read of the client.
    since_read: usize,
    asked: ask::Asked,
    reads: u64,
    baud: u32,
    terminal: Terminal,
    /// Whether the client's supervisor reports the settings that the kernel does not store.
    is_told: bool,
    /// Bytes that the terminal itself sends.
    own: VecDeque<u8>,
    counters: Counters,
    events: VecDeque<PortEvent>,
}

/// A plugged-in pseudo-terminal.
#[derive(Debug)]
struct Plugged {
    master: OwnedFd,
    watch: Watch,
}

impl Pty {
    /// Maximum number of unread bytes for a client that never reads, as in a Linux terminal.
    /// Further bytes are an overrun, as in a UART driver.
    pub const UNREAD_MAX: usize = 4096;

    /// Creates a terminal and publishes it in `dir` as `name`. It is raw and has the baud rate of
    /// `line`, so that a client without settings is right.
    ///
    /// # Errors
    /// If the system has no terminal left, or if a file of another program has the name.
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
            line,
            plugged: Some(Plugged { master, watch }),
            made: 1,
            open: false,
            unread: 0,
            since_read: 0,
            asked: ask::Asked::default(),
            reads: 0,
            baud: line.baud,
            terminal: Terminal::default(),
            is_told: false,
            own: VecDeque::new(),
            counters: Counters::default(),
            events: VecDeque::new(),
        })
    }

    /// Whether a client has the port open, as of the last `read` or `write`.
    pub fn is_open(&self) -> bool {
        self.open
    }

    fn master(&self) -> Option<&OwnedFd> {
        self.plugged.as_ref().map(|plugged| &plugged.master)
    }

    /// Records openings and closings; returns whether a client has the port open.
    fn look(&mut self) -> bool {
        let open = !self.is_hung_up();
        let Some(plugged) = &mut self.plugged else {
            return false;
        };
        let mut seen = plugged.watch.look(open);
        seen.read |= self.terminal.take_is_read();
        if seen.read {
            self.note_read();
        }
        if open && !self.open {
            self.opened();
        } else if open && seen.reopened {
            self.discard_unread();
            self.events.push_back(PortEvent::Closed);
            self.opened();
        } else if seen.visited && !self.open {
            // The next read finds that the client has closed the port.
            self.opened();
        }
        open
    }

    fn note_read(&mut self) {
        self.reads += 1;
        self.since_read = 0;
        self.asked.is_due = true;
    }

    fn opened(&mut self) {
        self.open = true;
        self.forget_unread();
        self.events.push_back(PortEvent::Opened);
    }

    fn closed(&mut self) {
        self.open = false;
        self.discard_unread();
        self.terminal.close();
        self.events.push_back(PortEvent::Closed);
        self.open_up();
    }

    /// Handles the end of a client that used the port exclusively. A serial port is free again
    /// after its last client, but a pseudo-terminal is not: a new one replaces it.
    fn open_up(&mut self) {
        let Some(master) = self.master() else {
            return;
        };
        let is_taken = open_client_side(master).err() == Some(Errno::BUSY);
        // This opening is not one of a client.
        if let Some(plugged) = &mut self.plugged {
            plugged.watch.look(false);
        }
        if !is_taken {
            return;
        }
        let settings = self.master().map(tcgetattr);
        self.unplug();
        if self.plug(None).is_ok()
            && let (Some(Ok(settings)), Some(master)) = (settings, self.master())
        {
            let _ = tcsetattr(master, OptionalActions::Now, &settings);
        }
    }

    fn is_hung_up(&self) -> bool {
        let Some(master) = self.master() else {
            return true;
        };
        let mut fds = [PollFd::new(master, PollFlags::empty())];
        let polled = poll(&mut fds, Some(&Timespec::default()));
        polled.is_ok() && fds[0].revents().contains(PollFlags::HUP)
    }

    /// Records the baud rate that the client has set; it is visible at the master.
    fn check_baud(&mut self) {
        let baud = match self.terminal.is_whole() {
            true => Some(self.terminal.settings().speeds[1]),
            false => self.kernel_settings().map(|settings| settings.speeds[1]),
        };
        if let Some(baud) = baud.filter(|&baud| baud != self.baud) {
            self.baud = baud;
            self.events.push_back(PortEvent::BaudChanged(baud));
        }
    }

    /// The client's settings, as far as the kernel stores them.
    fn kernel_settings(&self) -> Option<Settings> {
        let termios = tcgetattr(self.master()?).ok()?;
        Some(Settings::of_kernel(&termios))
    }

    /// The bytes that the client can read of the arrived ones.
    fn received(&mut self, bytes: &[u8], marks: &[Mark]) -> Vec<u8> {
        if !self.terminal.is_whole() && !self.is_told {
            // The kernel does all the work except for damaged characters. It doubles FF if they are
            // to be marked, and would also double a mark that was inserted here.
            let settings = self.kernel_settings().filter(|_| !marks.is_empty());
            let Some(settings) = settings else {
                return bytes.to_vec();
            };
            self.terminal.set(settings.without_marks());
        }
        let received = self.terminal.receive(bytes, marks);
        if received.flushes {
            let terminal = self.terminal.clone();
            self.discard_unread();
            self.terminal = terminal;
        }
        self.counters.overrun += received.lost as u64;
        received.ready
    }
}

impl Transport for Pty {
    fn read(&mut self, buf: &mut [u8]) -> Result<usize, TransportError> {
        self.look();
        if buf.is_empty() {
            return Ok(0);
        }
        self.own.extend(self.terminal.take_own());
        if !self.own.is_empty() {
            let len = buf.len().min(self.own.len());
            for (to, from) in buf.iter_mut().zip(self.own.drain(..len)) {
                *to = from;
            }
            return Ok(len);
        }
        let Some(Plugged { master, .. }) = &self.plugged else {
            return Ok(0);
        };
        match rustix::io::read(master, &mut *buf) {
            Ok(len) => {
                if !self.open {
                    // A client opened, sent and closed between two polls.
                    self.opened();
                }
                // After the read: the client set its rate before it sent these bytes.
                self.check_baud();
                if self.is_told {
                    let sent = self.terminal.send(&buf[..len]);
                    buf[..len].copy_from_slice(&sent);
                }
                Ok(len)
            }
            // EIO means that no client has the port open.
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
        self.write_marked(bytes, &[])
    }

    fn write_marked(&mut self, bytes: &[u8], marks: &[Mark]) -> usize {
        // The supervisor reports openings and closings before it writes.
        let is_there = match self.terminal.holds() {
            true => self.open,
            false => self.look(),
        };
        if !is_there {
            self.counters.unheard += bytes.len() as u64;
            return 0;
        }
        let is_plain = marks.is_empty() && !self.is_told && !self.terminal.is_whole();
        if is_plain {
            return self.put(bytes);
        }
        let ready = self.received(bytes, marks);
        self.put(&ready)
    }

    /// Unread bytes of the client are lost with the terminal.
    fn is_drained(&mut self) -> bool {
        // The supervisor reports openings, closings and reads before it asks.
        let is_there = match self.terminal.holds() {
            true if self.terminal.take_is_read() => {
                self.note_read();
                self.open
            }
            true => self.open,
            false => self.look(),
        };
        if !is_there {
            return true;
        }
        if self.terminal.is_whole() {
            let terminal = &self.terminal;
            let is_short = !terminal.is_canonical() && !terminal.is_readable();
            return !terminal.is_waiting() || is_short;
        }
        self.since_read == 0 || !self.may_be_read()
    }

    fn reads(&self) -> Option<u64> {
        match &self.plugged {
            Some(plugged) => plugged.watch.fd().map(|_| self.reads),
            None => Some(self.reads),
        }
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
        let crtscts = ControlModes::CRTSCTS.bits();
        let settings = match self.terminal.is_whole() {
            true => Some(*self.terminal.settings()),
            false => self.kernel_settings(),
        };
        settings.is_some_and(|settings| settings.control & crtscts != 0)
    }

    fn modes(&self) -> Option<Modes> {
        let told = *self.terminal.settings();
        let settings = match (self.terminal.is_whole(), self.is_told) {
            (true, _) => Some(told),
            (false, false) => self.kernel_settings(),
            // The kernel drops some modes of input and line, e.g. parity, and stores the others.
            (false, true) => (self.kernel_settings()).map(|kept| kept.with_modes_of(&told)),
        };
        settings.as_ref().map(Modes::of)
    }

    fn cut(&self) -> u64 {
        self.terminal.cut()
    }

    fn client_side(&self) -> Option<OwnedFd> {
        open_client_side(self.master()?).ok()
    }

    fn unplug(&mut self) {
        // The kernel hangs up the client's files like those of an unplugged USB adapter.
        if self.plugged.take().is_none() {
            return;
        }
        self.link.withdraw();
        self.forget_unread();
        self.own.clear();
        if core::mem::take(&mut self.open) {
            self.events.push_back(PortEvent::Closed);
        }
    }

    fn plug(&mut self, name: Option<&str>) -> Result<(), TransportError> {
        if self.plugged.is_some() {
            return Ok(());
        }
        let (master, node) = make(self.line.baud).map_err(|source| TransportError::Pty {
            path: self.path().to_owned(),
            source,
        })?;
        let node = Path::new(OsStr::from_bytes(node.as_bytes()));
        let watch = Watch::new(node);
        self.link.publish_again(name, node)?;
        self.plugged = Some(Plugged { master, watch });
        self.made += 1;
        let is_whole = self.terminal.is_whole();
        (self.terminal, self.is_told) = (Terminal::default(), false);
        if is_whole {
            self.model();
        }
        self.check_baud();
        Ok(())
    }

    fn made(&self) -> u64 {
        self.made
    }

    fn model(&mut self) {
        let settings = self.kernel_settings().unwrap_or_default();
        self.terminal = Terminal::whole(settings);
    }

    fn terminal(&mut self) -> Option<&mut Terminal> {
        (self.terminal.is_whole() && self.plugged.is_some()).then_some(&mut self.terminal)
    }

    fn set_terminal(&mut self, settings: Settings) -> usize {
        let ready = self.terminal.set(settings);
        self.check_baud();
        self.put(&ready)
    }

    fn tell(&mut self, settings: Settings) {
        self.is_told = true;
        self.terminal.set(settings);
    }

    fn readiness<'a>(&'a self, fds: &mut Vec<BorrowedFd<'a>>) {
        let Some(plugged) = &self.plugged else {
            return;
        };
        fds.extend(plugged.watch.fd());
        // A hung-up master is always ready: waiting for it would be a busy loop.
        if self.open && !self.is_hung_up() {
            fds.push(plugged.master.as_fd());
        }
    }

    fn rests(&self) -> bool {
        let has_own = !self.own.is_empty() || self.terminal.has_own();
        self.terminal.holds() && !has_own && self.events.is_empty()
    }

    fn release(&mut self) {
        // These bytes are counted already.
        let held = self.terminal.release();
        let lost = held.len() - self.hand_over(&held);
        if lost > 0 {
            self.counters.overrun += lost as u64;
            self.unread = self.unread.saturating_sub(lost);
            let unread = self.terminal.unread().saturating_sub(lost);
            self.terminal.correct_unread(unread);
        }
    }

    fn stirs(&self) -> Option<Vec<BorrowedFd<'_>>> {
        let Some(plugged) = &self.plugged else {
            return Some(Vec::new());
        };
        if !self.own.is_empty() || self.terminal.is_whole() && self.terminal.has_own() {
            return None;
        }
        let mut fds = vec![plugged.watch.fd()?];
        // Without a client the terminal always reports a hang-up.
        fds.extend(self.open.then(|| plugged.master.as_fd()));
        Some(fds)
    }
}

/// Creates a master and the path of its client side: raw, at `baud`, opened and closed once.
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
