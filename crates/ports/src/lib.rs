//! The ports of a rig in virtual time, for tests of a driver of any style within this process.
//!
//! ```text
//! driver under test --> port --> line --> device     no clock: time continues while a call waits
//! ```
//!
//! | style of the driver | start with | feature |
//! |---|---|---|
//! | [`Read`](std::io::Read) and [`Write`](std::io::Write) | [`Bench::port`] | |
//! | `Box<dyn SerialPort>` | `Bench::serial` | `serialport` |
//! | a thread that reads | [`Bench::spawn`], [`Bench::expect_thread`] | |
//! | `tokio` | `Bench::tokio` with [`Bench::port`] | `tokio` |
//! | `AsyncRead` of `futures` | [`Bench::block_on`] with [`Bench::port`] | `futures` |
//! | `embedded-io`, `embedded-io-async` 0.6 and 0.7 | [`Bench::port`] | `embedded` |
//! | `embedded-hal` 1.0, also async | `Bench::i2c`, `Bench::pin`, `Bench::delay` | `embedded` |
//!
//! A read without available bytes lets the rig run until a byte arrives or the port's timeout is
//! over. A write returns at once, as with an operating system; [`flush`](std::io::Write::flush)
//! waits until the last bit is on the wire. No time passes between calls: computation costs
//! nothing, and a program that waits for something else calls [`Bench::sleep`]. The same calls
//! always give the same bytes.
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
//! One thread runs at a time. The others wait for their turn; if none can continue, the rig runs. A
//! thread hands over its turn only when it calls the bench or one of its ports. Therefore the order
//! depends on virtual time alone, and the trace is the same in each run.
//!
//! A thread that blocks elsewhere, e.g. in `Receiver::recv`, holds the turn forever. After ten
//! seconds of wall time all calls of the bench return an error that names the thread. Use
//! [`Bench::wait_until`] instead.

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
/// Clones and all their ports belong to the same run.
#[derive(Clone)]
pub struct Bench {
    core: Arc<Core>,
}

impl Bench {
    /// Wires `scenario` with open ends for the program on all links, and for the PC if its robot
    /// has a PC without a player.
    ///
    /// # Errors
    /// If the scenario cannot be wired.
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

    /// The bench for the text of a scenario.
    ///
    /// # Errors
    /// If the text is not a valid scenario.
    pub fn from_text(toml: &str) -> Result<Self, ScenarioError> {
        let (scenario, source) = Scenario::from_text(toml)?;
        Self::new(scenario, &source)
    }

    /// The bench for the file of a scenario.
    ///
    /// # Errors
    /// If the file cannot be read, or is not a valid scenario.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, ScenarioError> {
        let (scenario, source) = Scenario::read(path.as_ref())?;
        Self::new(scenario, &source)
    }

    /// Opens the end of the link `name`, e.g. `lidar`.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`] with the known names, [`ErrorKind::InvalidInput`] if the link is not
    /// a serial port, [`ErrorKind::BrokenPipe`] after the verdict.
    pub fn port(&self, name: &str) -> io::Result<VirtualPort> {
        let index = self.open(name, &[LinkKind::Uart, LinkKind::Datagram])?;
        Ok(VirtualPort::new(self.clone(), index, name))
    }

    /// Opens the end of a link of any kind: a write to a bus or a network is one message, a byte
    /// written to a pin is its level.
    ///
    /// # Errors
    /// Those of [`Bench::port`], except for the kind.
    pub fn raw(&self, name: &str) -> io::Result<VirtualPort> {
        let index = self.open(name, &LinkKind::ALL)?;
        Ok(VirtualPort::new(self.clone(), index, name))
    }

    /// Opens a port of one of these kinds; returns its index.
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

    /// Virtual time; after the verdict the end of the run.
    pub fn now(&self) -> Instant {
        self.core.lock().now()
    }

    /// Lets `span` of virtual time pass, at most to the end of the scenario.
    ///
    /// # Panics
    /// If a thread of the bench blocks outside the bench.
    pub fn sleep(&self, span: Duration) {
        let slept = self.core.enter().and_then(|turn| {
            let until = (turn.now() + span).min(turn.end());
            turn.wait(Until::Time, until).map(drop)
        });
        expect_turn(slept);
    }

    /// Lets time pass and other threads run until `found` returns a value, at most for `timeout` of
    /// virtual time. Replaces waiting for a channel, a lock or a variable.
    ///
    /// # Panics
    /// If a thread of the bench blocks outside the bench.
    pub fn wait_until<T>(
        &self,
        timeout: Duration,
        mut found: impl FnMut() -> Option<T>,
    ) -> Option<T> {
        let deadline = (self.now() + timeout).min(self.core.lock().end());
        if let Ok(mut turn) = self.core.enter() {
            // Another thread may wait for an action of this thread since its last call.
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
    /// If the operating system cannot start a thread.
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
            // The first call in `body` reports the error.
            drop(core.enter());
            body()
        });
        BenchThread {
            bench: self.clone(),
            index,
            handle: handle.expect("a thread"),
        }
    }

    /// Announces a thread that a driver will start. Time does not pass until that thread has called
    /// the bench or one of its ports. The thread is recognised by its name, else as the only
    /// announced thread. Several announced threads and a thread with another name are an error.
    pub fn expect_thread(&self, name: &str) {
        self.core.announce(name, false);
    }

    /// Sets the wall time after which a thread that blocks outside the bench is an error; see
    /// [`PATIENCE`].
    pub fn set_patience(&self, patience: Duration) {
        self.core.set_patience(patience);
    }

    /// The run: its rig, world, instruments. While the result is borrowed, this thread cannot use
    /// the bench.
    ///
    /// # Panics
    /// After the verdict.
    pub fn run(&self) -> RunRef<'_> {
        drop(self.core.enter().unwrap_or_else(|error| panic!("{error}")));
        let core = &self.core;
        let state = core.look();
        RunRef { core, state }
    }

    /// Ends the run and judges it; its ports hang up, and waiting threads continue.
    ///
    /// # Panics
    /// If the run was judged before, or if a thread of the bench blocked outside the bench.
    pub fn judge(&self) -> Outcome {
        expect_turn(self.core.enter().map(drop));
        let (run, was_read) = self.core.end().expect("judged once");
        let mut outcome = run.judge();
        // A test that only listens has observed its device.
        outcome.was_asked |= was_read;
        outcome
    }
}

impl fmt::Debug for Bench {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Bench({:?}, {})", self.names(), self.now())
    }
}

/// A finished run is not an error here, a stuck bench is.
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
    /// Lets time pass until the thread has ended, and returns its result.
    ///
    /// # Panics
    /// With the message of the thread, if it panicked.
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
