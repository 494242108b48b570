//! The ports of a rig in virtual time, for a driver of any style that is to be tested in this
//! process.
//!
//! ```text
//! driver under test --> port --> line --> device     no clock: time continues while a call waits
//! ```
//!
//! | style of the driver | begin with | feature |
//! |---|---|---|
//! | [`Read`](std::io::Read) and [`Write`](std::io::Write) | [`Bench::port`] | |
//! | `Box<dyn SerialPort>` | `Bench::serial` | `serialport` |
//! | a thread that reads | [`Bench::spawn`], [`Bench::expect_thread`] | |
//! | `tokio` | `Bench::tokio` with [`Bench::port`] | `tokio` |
//! | `AsyncRead` of `futures` | [`Bench::block_on`] with [`Bench::port`] | `futures` |
//! | `embedded-io`, `embedded-io-async` 0.6 and 0.7 | [`Bench::port`] | `embedded` |
//! | `embedded-hal` 1.0, also async | `Bench::i2c`, `Bench::pin`, `Bench::delay` | `embedded` |
//!
//! A read that finds nothing lets the rig run until a byte arrives or the port's timeout is over; a
//! write is taken at once as by an operating system, [`flush`](std::io::Write::flush) waits until
//! the last bit is on the wire. Between calls no time passes: computing costs nothing, and a
//! program that waits for something else calls [`Bench::sleep`]. The same calls give the same
//! bytes, always.
//!
//! ```
//! use std::io::Read as _;
//! use hilrig_ports::Bench;
//!
//! let bench = Bench::from_text(
//!     r#"
//!     schema = 1
//!     name = "sonar"
//!     robot = "none"
//!     duration = "10s"
//!     [device.sonar.text]
//!     baud = 9600
//!     command = []
//!     periodic = { line = "mm=700", period = "1s" }
//!     "#,
//! )?;
//! let mut sonar = bench.port("sonar")?;
//! let mut line = [0; 6];
//! sonar.set_timeout(core::time::Duration::from_secs(2));
//! sonar.read_exact(&mut line)?;
//! assert_eq!(&line, b"mm=700");
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```
//!
//! # Threads
//!
//! One thread runs at a time. The others wait for their turn; when none can go on, the rig runs. A
//! thread hands its turn over whenever it calls the bench or one of its ports, never elsewhere. So
//! the order depends on virtual time alone, and the trace is the same in each run.
//!
//! A thread that blocks elsewhere, e.g. in `Receiver::recv`, holds the turn forever. After ten
//! seconds of wall time all calls of the bench are an error that names the thread. Wait with
//! [`Bench::wait_until`] in its place.

mod executor;
mod port;
mod state;
mod styles;
mod turns;

use core::fmt;
use core::ops::Deref;
use core::time::Duration;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::{Arc, MutexGuard};
use std::thread;

use engine::rig::LinkKind;
use engine::robots::{self, Dut, PcEnd, Wired};
use engine::run::{Outcome, Run};
use engine::scenario::{Scenario, ScenarioError, Source};
use protocols::{Instant, LineEvent};

pub use executor::Timer;
pub use port::{TIMEOUT, VirtualPort};
#[cfg(feature = "embedded")]
pub use styles::{Delay, I2cError, I2cPort, PinError, PinPort};
pub use turns::PATIENCE;

use state::PortState;
use turns::{Core, NEVER, State, Until};

/// A run whose program is the test itself.
///
/// Clones, and all their ports, are of the same run.
#[derive(Clone)]
pub struct Bench {
    core: Arc<Core>,
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
            open_ends,
            instruments,
        } = wired;
        let port = |end: robots::OpenEnd| {
            let kind = rig.link(&end.link).map(|link| link.kind);
            PortState::new(end, kind.unwrap_or_default())
        };
        let ports = open_ends.into_iter().map(port).collect();
        let core = Core::new(Run::with_rig(scenario, rig, instruments), ports);
        Ok(Self { core })
    }

    /// The bench of a scenario's text.
    ///
    /// # Errors
    /// If it is no sound scenario.
    pub fn from_text(toml: &str) -> Result<Self, ScenarioError> {
        let (scenario, source) = Scenario::from_text(toml)?;
        Self::new(scenario, &source)
    }

    /// The bench of a scenario's file.
    ///
    /// # Errors
    /// If it cannot be read, or is no sound scenario.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, ScenarioError> {
        let (scenario, source) = Scenario::read(path.as_ref())?;
        Self::new(scenario, &source)
    }

    /// Opens the end of the link `name`, e.g. `lidar`.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`] with the known names, [`ErrorKind::InvalidInput`] if it is no serial
    /// port, [`ErrorKind::BrokenPipe`] after the run was judged.
    pub fn port(&self, name: &str) -> io::Result<VirtualPort> {
        let index = self.open(name, &[LinkKind::Uart, LinkKind::Datagram])?;
        Ok(VirtualPort::new(self.clone(), index, name))
    }

    /// Opens the end of a link of any kind: a write to a bus or a network is one message, a byte
    /// written to a pin is its level.
    ///
    /// # Errors
    /// As [`Bench::port`], but for the kind.
    pub fn raw(&self, name: &str) -> io::Result<VirtualPort> {
        let index = self.open(name, &LinkKind::ALL)?;
        Ok(VirtualPort::new(self.clone(), index, name))
    }

    /// Opens a port of one of these kinds; its number.
    fn open(&self, name: &str, kinds: &[LinkKind]) -> io::Result<usize> {
        let mut turn = self.core.enter()?;
        let Some(index) = turn.find(name) else {
            let known = turn.names().join(", ");
            let message = format!("no port {name}, expected one of {known}");
            return Err(io::Error::new(ErrorKind::NotFound, message));
        };
        let (run, port) = turn.port(index)?;
        if !kinds.contains(&port.kind) {
            let how = match port.kind {
                LinkKind::Uart | LinkKind::Datagram => "Bench::port",
                LinkKind::I2c => "Bench::i2c (feature `embedded`)",
                LinkKind::Pin => "Bench::pin (feature `embedded`)",
            };
            let kind = port.kind;
            let message = format!("the port {name} is of kind {kind}: open it with {how}");
            return Err(io::Error::new(ErrorKind::InvalidInput, message));
        }
        run.rig.change_line(port.end.node, LineEvent::Opened);
        Ok(index)
    }

    /// The names of the ports.
    pub fn names(&self) -> Vec<String> {
        self.core.lock().names()
    }

    /// Virtual time; the end of the run after it was judged.
    pub fn now(&self) -> Instant {
        self.core.lock().now()
    }

    /// Lets `span` of virtual time pass, no further than to the end of the scenario.
    ///
    /// # Panics
    /// If a thread of the bench blocks outside of it.
    pub fn sleep(&self, span: Duration) {
        let slept = self.core.enter().and_then(|turn| {
            let until = (turn.now() + span).min(turn.end());
            turn.wait(Until::Time, until).map(drop)
        });
        expect_turn(slept);
    }

    /// Lets time pass and other threads work until `found` gives a value, at most for `timeout` of
    /// virtual time: in place of a wait for a channel, a lock or a variable.
    ///
    /// # Panics
    /// If a thread of the bench blocks outside of it.
    pub fn wait_until<T>(
        &self,
        timeout: Duration,
        mut found: impl FnMut() -> Option<T>,
    ) -> Option<T> {
        let deadline = (self.now() + timeout).min(self.core.lock().end());
        if let Ok(mut turn) = self.core.enter() {
            // What this thread did since its last call may be what another waits for.
            turn.act();
        }
        loop {
            if let Some(value) = found() {
                return Some(value);
            }
            if self.now() >= deadline {
                return None;
            }
            let waited = self.core.enter().and_then(|turn| {
                let acts = turn.acts();
                turn.wait(Until::Act(acts), deadline).map(drop)
            });
            let is_over = waited.is_err();
            expect_turn(waited);
            if is_over {
                return found();
            }
        }
    }

    /// Starts a thread of the bench. It begins when the caller first waits.
    ///
    /// # Panics
    /// If the operating system starts no thread.
    pub fn spawn<T: Send + 'static>(
        &self,
        name: &str,
        body: impl FnOnce() -> T + Send + 'static,
    ) -> BenchThread<T> {
        let index = self.core.announce(name, true);
        let core = Arc::clone(&self.core);
        let builder = thread::Builder::new().name(name.to_owned());
        let handle = builder.spawn(move || {
            let _part = core.join_as(index);
            // An error is that of the first call in `body`.
            drop(core.enter());
            body()
        });
        BenchThread {
            bench: self.clone(),
            index,
            handle: handle.expect("a thread"),
        }
    }

    /// Announces a thread that a driver will start by itself. Time does not pass until this thread
    /// has called the bench or one of its ports. A thread takes the place of its own name, else the
    /// only free one; several free places and a thread of another name are an error.
    pub fn expect_thread(&self, name: &str) {
        self.core.announce(name, false);
    }

    /// Sets the wall time after which a thread that blocks outside of the bench is an error; see
    /// [`PATIENCE`].
    pub fn set_patience(&self, patience: Duration) {
        self.core.set_patience(patience);
    }

    /// The run: its rig, world, instruments.
    ///
    /// # Panics
    /// If it was judged. While the result is borrowed, this thread cannot use the bench.
    pub fn run(&self) -> RunRef<'_> {
        drop(self.core.enter().unwrap_or_else(|error| panic!("{error}")));
        let core = &self.core;
        let state = core.look();
        RunRef { core, state }
    }

    /// Ends the run here and judges it; its ports are hung up, and threads that wait go on.
    ///
    /// # Panics
    /// If it was judged already, or if a thread of the bench blocked outside of it.
    pub fn judge(&self) -> Outcome {
        expect_turn(self.core.enter().map(drop));
        self.core.end().expect("judged once").judge()
    }
}

impl fmt::Debug for Bench {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Bench({:?}, {})", self.names(), self.now())
    }
}

/// A run that is over is not an error here; a bench that is stuck is.
fn expect_turn(outcome: io::Result<()>) {
    if let Err(error) = outcome {
        assert!(error.kind() == ErrorKind::BrokenPipe, "{error}");
    }
}

/// A thread that [`Bench::spawn`] started.
#[derive(Debug)]
pub struct BenchThread<T> {
    bench: Bench,
    index: usize,
    handle: thread::JoinHandle<T>,
}

impl<T> BenchThread<T> {
    /// Lets time pass until the thread is over, and returns its result.
    ///
    /// # Panics
    /// If the thread panicked: with its message.
    pub fn join(self) -> T {
        let waited = self.bench.core.enter().and_then(|turn| {
            let over = Until::Over(self.index);
            turn.wait(over, NEVER).map(drop)
        });
        expect_turn(waited);
        let joined = self.handle.join();
        joined.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

/// The run of a bench, borrowed by [`Bench::run`].
pub struct RunRef<'a> {
    core: &'a Core,
    state: MutexGuard<'a, State>,
}

impl Deref for RunRef<'_> {
    type Target = Run;

    fn deref(&self) -> &Run {
        self.state.run.as_ref().expect("not judged yet")
    }
}

impl Drop for RunRef<'_> {
    fn drop(&mut self) {
        self.core.looked();
    }
}

impl fmt::Debug for RunRef<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RunRef({})", self.state.now())
    }
}
