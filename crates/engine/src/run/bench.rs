//! The ports of a rig as [`Read`] and [`Write`], in virtual time: for a driver or a parser that was
//! written for a serial port and is to be tested in this process.
//!
//! ```text
//! driver under test -- Read + Write --> VirtualPort --> line --> device     one thread, no clock:
//!                                                                time continues while a call waits
//! ```
//!
//! A read that finds nothing lets the rig run until a byte arrives or the port's timeout is over; a
//! write is taken at once as by an operating system, [`flush`](Write::flush) waits until the last
//! bit is on the wire. Between calls no time passes: computing costs nothing, and a program that
//! waits for something else calls [`Bench::sleep`]. The same calls give the same bytes, always.
//!
//! ```
//! use std::io::Read as _;
//! use hilrig_engine::run::bench::Bench;
//! use hilrig_engine::scenario::Scenario;
//!
//! let (scenario, source) = Scenario::from_text(
//!     r#"
//!     schema = 1
//!     name = "sonar"
//!     robot = "none"
//!     duration = "10s"
//!     world = { start = { x_m = 0, y_m = 0, heading_deg = 0 } }
//!     [device.sonar.text]
//!     baud = 9600
//!     command = []
//!     periodic = { line = "mm=700", period = "1s" }
//!     "#,
//! )?;
//! let bench = Bench::new(scenario, &source)?;
//! let mut sonar = bench.port("sonar")?;
//! let mut line = [0; 6];
//! sonar.set_timeout(core::time::Duration::from_secs(2));
//! sonar.read_exact(&mut line)?;
//! assert_eq!(&line, b"mm=700");
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

use bytes::Bytes;
use core::cell::{Ref, RefCell};
use core::fmt;
use core::time::Duration;
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::rc::Rc;

use protocols::{Instant, LineConfig, LineEvent};

use super::{Outcome, Run};
use crate::robots::{self, Dut, OpenEnd, PcEnd, Wired};
use crate::scenario::{Scenario, ScenarioError, Source};

/// Default timeout of a read, virtual time.
pub const TIMEOUT: Duration = Duration::from_secs(1);
/// Bytes written that may wait for the line before a write waits too, as in a UART's driver.
const BACKLOG_MAX: usize = 4096;

/// A run whose program is the test itself.
///
/// Clones, and all their ports, are of the same run.
#[derive(Clone)]
pub struct Bench(Rc<RefCell<Inner>>);

struct Inner {
    /// `None` once it was judged.
    run: Option<Run>,
    /// Time of the verdict.
    ended: Instant,
    ends: Vec<OpenEnd>,
}

impl Bench {
    /// Wires `scenario` with the program's ends of all links open, and the PC's if its robot has
    /// one without a player.
    ///
    /// # Errors
    /// If the scenario sets the robot up in a way that it cannot be.
    pub fn new(scenario: Scenario, source: &Source) -> Result<Self, ScenarioError> {
        let wired = robots::wire(&scenario, source, Dut::External, PcEnd::Scripted)?;
        let Wired {
            rig,
            open_ends: ends,
            instruments,
        } = wired;
        let run = Some(Run::with_rig(scenario, rig, instruments));
        let ended = Instant::ZERO;
        let inner = Inner { run, ended, ends };
        Ok(Self(Rc::new(RefCell::new(inner))))
    }

    /// Opens the end of the link `name`, e.g. `lidar`.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`] with the names that there are, [`ErrorKind::BrokenPipe`] after the
    /// run was judged.
    pub fn port(&self, name: &str) -> io::Result<VirtualPort> {
        let mut inner = self.0.borrow_mut();
        let Some(end) = inner.ends.iter().find(|end| end.name == name) else {
            let known: Vec<_> = inner.ends.iter().map(|end| end.name.as_str()).collect();
            let message = format!("no port {name}, expected one of {}", known.join(", "));
            return Err(io::Error::new(ErrorKind::NotFound, message));
        };
        let (end, node) = (end.clone(), end.node);
        let run = inner.run()?;
        let link = run.rig.link(&end.link);
        let has_messages = link.is_some_and(|link| link.kind.carries_messages());
        run.rig.change_line(node, LineEvent::Opened);
        Ok(VirtualPort {
            bench: self.clone(),
            end,
            has_messages,
            timeout: TIMEOUT,
            received: VecDeque::new(),
            messages: VecDeque::new(),
        })
    }

    /// The names of the ports.
    pub fn names(&self) -> Vec<String> {
        let inner = self.0.borrow();
        inner.ends.iter().map(|end| end.name.clone()).collect()
    }

    /// Virtual time; the end of the run after it was judged.
    pub fn now(&self) -> Instant {
        let inner = self.0.borrow();
        let run = inner.run.as_ref();
        run.map_or(inner.ended, |run| run.rig.now())
    }

    /// Lets `span` of virtual time pass, no further than to the end of the scenario.
    pub fn sleep(&self, span: Duration) {
        if let Some(run) = &mut self.0.borrow_mut().run {
            let until = (run.rig.now() + span).min(end_of(run));
            run.go_on_until(until);
        }
    }

    /// The run: its rig, world, instruments.
    ///
    /// # Panics
    /// If it was judged, or if a port is used while the run is still being looked at.
    pub fn run(&self) -> Ref<'_, Run> {
        let inner = self.0.borrow();
        Ref::map(inner, |inner| inner.run.as_ref().expect("not judged yet"))
    }

    /// Ends the run here and judges it; its ports are hung up.
    ///
    /// # Panics
    /// If it was judged already.
    pub fn judge(&self) -> Outcome {
        let mut inner = self.0.borrow_mut();
        let run = inner.run.take().expect("judged once");
        inner.ended = run.rig.now();
        drop(inner);
        run.judge()
    }
}

impl fmt::Debug for Bench {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Bench({:?}, {})", self.names(), self.now())
    }
}

impl Inner {
    fn run(&mut self) -> io::Result<&mut Run> {
        self.run.as_mut().ok_or_else(hung_up)
    }
}

fn hung_up() -> io::Error {
    io::Error::new(ErrorKind::BrokenPipe, "the run is over")
}

fn end_of(run: &Run) -> Instant {
    Instant::ZERO + run.scenario().duration.0
}

/// Runs to the next event, at most to `deadline`.
fn wait(run: &mut Run, deadline: Instant) {
    let next = run.rig.next_event().unwrap_or(deadline);
    run.go_on_until(next.clamp(run.rig.now(), deadline));
}

/// An end of a link as a serial port, in virtual time.
///
/// | call | does |
/// |---|---|
/// | `read` | gives what is there; else waits for a byte, at most for the timeout: `TimedOut` |
/// | `write` | takes bytes as long as the driver's buffer of 4096 bytes has room; else waits |
/// | `flush` | waits until the last bit has left |
///
/// When the scenario's time is up the port is hung up: `read` gives 0 bytes, `write` and `flush`
/// are a `BrokenPipe`; so a program that serves its ports forever ends all the same. As with a
/// real driver, unread bytes beyond 4096 are lost. On a link that carries messages one
/// read gives one message, whose rest is lost if `buf` is too short, and one write is one.
#[derive(Clone, Debug)]
pub struct VirtualPort {
    bench: Bench,
    end: OpenEnd,
    has_messages: bool,
    timeout: Duration,
    received: VecDeque<u8>,
    messages: VecDeque<Bytes>,
}

impl VirtualPort {
    /// Its name.
    pub fn name(&self) -> &str {
        &self.end.name
    }

    /// Timeout of a read, virtual time; zero: none.
    pub fn set_timeout(&mut self, timeout: Duration) {
        self.timeout = timeout;
    }

    /// Sets baud rate and format; initially those that the device expects.
    ///
    /// # Errors
    /// [`ErrorKind::BrokenPipe`] after the run was judged.
    pub fn set_line(&mut self, line: LineConfig) -> io::Result<()> {
        let mut inner = self.bench.0.borrow_mut();
        inner.run()?.rig.set_line_config(self.end.node, line);
        Ok(())
    }

    /// Bytes that can be read without waiting; of the next message, if it carries messages.
    ///
    /// # Errors
    /// [`ErrorKind::BrokenPipe`] after the run was judged.
    pub fn available(&mut self) -> io::Result<usize> {
        let bench = self.bench.clone();
        let mut inner = bench.0.borrow_mut();
        let run = inner.run()?;
        self.collect(run);
        Ok(self.received.len())
    }

    /// Takes the arrived bytes.
    fn collect(&mut self, run: &mut Run) {
        let (rig, node) = (&mut run.rig, self.end.node);
        match self.has_messages {
            true => self.messages.extend(rig.take_messages(node)),
            false => self.received.extend(rig.take_output(node)),
        }
        // What is left of a message that was read is not there any more.
        if let Some(message) = self.messages.front() {
            self.received = message.iter().copied().collect();
        }
    }

    /// Moves the available bytes into `buf`.
    fn take(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        let len = self.received.read(buf)?;
        if self.messages.pop_front().is_some() {
            self.received.clear();
        }
        Ok(len)
    }

    /// Whether all that was written has left.
    fn is_sent(&self, run: &Run) -> bool {
        let node = self.end.node;
        let link = run.rig.link(&self.end.link);
        let mut lines = link.iter().flat_map(|link| &link.lines);
        let line = lines.find(|line| line.from.node == node);
        let free_at = line.map_or(Instant::ZERO, |line| line.free_at());
        run.rig.backlog(node) == 0 && free_at <= run.rig.now()
    }
}

impl Read for VirtualPort {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        if buf.is_empty() {
            return Ok(0);
        }
        let bench = self.bench.clone();
        let mut inner = bench.0.borrow_mut();
        let run = inner.run()?;
        let end = end_of(run);
        let deadline = (run.rig.now() + self.timeout).min(end);
        run.go_on_until(run.rig.now());
        loop {
            self.collect(run);
            if !self.received.is_empty() {
                return self.take(buf);
            }
            if run.rig.now() >= deadline {
                break;
            }
            wait(run, deadline);
        }
        match deadline < end {
            true => Err(io::Error::new(ErrorKind::TimedOut, "nothing came")),
            false => Ok(0),
        }
    }
}

impl Write for VirtualPort {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        let mut inner = self.bench.0.borrow_mut();
        let run = inner.run()?;
        let (end, node) = (end_of(run), self.end.node);
        while run.rig.backlog(node) >= BACKLOG_MAX && run.rig.now() < end {
            wait(run, end);
        }
        if run.rig.now() >= end {
            return Err(hung_up());
        }
        let room = match self.has_messages {
            true => buf.len(),
            false => BACKLOG_MAX - run.rig.backlog(node),
        };
        let taken = &buf[..buf.len().min(room)];
        run.rig.inject(node, taken);
        // The line takes the first byte now, not at the next wait.
        run.go_on_until(run.rig.now());
        Ok(taken.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let mut inner = self.bench.0.borrow_mut();
        let run = inner.run()?;
        let end = end_of(run);
        while !self.is_sent(run) {
            if run.rig.now() >= end {
                return Err(hung_up());
            }
            wait(run, end);
        }
        Ok(())
    }
}
