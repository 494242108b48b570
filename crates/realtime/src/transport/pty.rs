//! A pseudo-terminal: what a client opens as if it were a serial port.
//!
//! Made for a client that knows nothing of us: the terminal is raw before its name appears, so no
//! byte is ever echoed or translated; a client that opens late reads nothing that was sent before
//! it came; one that does not read loses bytes as on a UART. All of it was found out by trying;
//! nothing of it is promised by a standard.
//!
//! The master has no notion of "open": it reports a hang-up after the last client closed, until the
//! next one opens. A terminal that was never opened reports none, so we open and close it once.
//!
//! How much a client has not read only the kernel knows: the client may read a part, or flush. The
//! count kept here is an upper bound; the kernel is asked before a byte is given up for lost.

mod ask;

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
    /// `None` as long as its plug is out.
    plugged: Option<Plugged>,
    /// Counts the terminals that were made for this port.
    made: u64,
    open: bool,
    /// Most bytes that the client may not have read yet; see [`ask`].
    unread: usize,
    /// Bytes written since the client was last seen to read.
    since_read: usize,
    asked: ask::Asked,
    reads: u64,
    baud: u32,
    terminal: Terminal,
    /// Whether its client's supervisor told the settings that the kernel does not keep.
    is_told: bool,
    /// What the terminal itself sends.
    own: VecDeque<u8>,
    counters: Counters,
    events: VecDeque<PortEvent>,
}

/// A pseudo-terminal that is there.
#[derive(Debug)]
struct Plugged {
    master: OwnedFd,
    watch: Watch,
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

    /// Whether a client has the port open, as far as the last call of `read` or `write` saw.
    pub fn is_open(&self) -> bool {
        self.open
    }

    fn master(&self) -> Option<&OwnedFd> {
        self.plugged.as_ref().map(|plugged| &plugged.master)
    }

    /// Records clients that came and went; whether any client is there.
    fn look(&mut self) -> bool {
        let open = !self.is_hung_up();
        let Some(plugged) = &mut self.plugged else {
            return false;
        };
        let mut seen = plugged.watch.look(open);
        seen.read |= self.terminal.take_is_read();
        if seen.read {
            self.reads += 1;
            self.since_read = 0;
            self.asked.is_due = true;
        }
        if open && !self.open {
            self.opened();
        } else if open && seen.reopened {
            self.discard_unread();
            self.events.push_back(PortEvent::Closed);
            self.opened();
        } else if seen.visited && !self.open {
            // The next read finds that the client has gone.
            self.opened();
        }
        open
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

    /// The client that took the port for itself alone has closed it. That ends with the last client
    /// of a serial port, but not of a pseudo-terminal: another one takes its place.
    fn open_up(&mut self) {
        let Some(master) = self.master() else {
            return;
        };
        let is_taken = open_client_side(master).err() == Some(Errno::BUSY);
        // This opening is not a client's.
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

    /// Takes note of the baud rate that the client has set; the master sees it.
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

    /// The settings that the kernel keeps of the client's.
    fn kernel_settings(&self) -> Option<Settings> {
        let termios = tcgetattr(self.master()?).ok()?;
        Some(Settings::of_kernel(&termios))
    }

    /// What the client gets to read of what arrived.
    fn received(&mut self, bytes: &[u8], marks: &[Mark]) -> Vec<u8> {
        if !self.terminal.is_whole() && !self.is_told {
            // The kernel does it all but for damaged characters. It doubles FF if they are to be
            // marked, and a mark that was put in here as well.
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
                    // Came, sent and went between two looks.
                    self.opened();
                }
                // After reading: the client set its rate before it sent these bytes.
                self.check_baud();
                if self.is_told {
                    let sent = self.terminal.send(&buf[..len]);
                    buf[..len].copy_from_slice(&sent);
                }
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

    /// What its client has not read yet is lost with the terminal.
    fn is_drained(&mut self) -> bool {
        if !self.look() {
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
            // The kernel forgets some modes of input and line, e.g. parity, and keeps the rest.
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
        // The kernel hangs up the client's files as it does those of a USB adapter that goes.
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
        // A hung-up master is ready all the time: waiting for it would be a busy loop.
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
        // Without a client the terminal reports a hang-up all the time.
        fds.extend(self.open.then(|| plugged.master.as_fd()));
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
