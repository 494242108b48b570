//! A port as [`Read`] and [`Write`].

#[cfg(any(feature = "embedded", feature = "futures", feature = "tokio"))]
mod poll;

use core::time::Duration;
use std::io::{self, ErrorKind, Read, Write};

use protocols::LineConfig;

use crate::Bench;
use crate::state::hung_up;
use crate::turns::Until;

/// Default timeout of a read, virtual time.
pub const TIMEOUT: Duration = Duration::from_secs(1);

/// An end of a link as a serial port, in virtual time.
///
/// | call | effect |
/// |---|---|
/// | `read` | returns available bytes; otherwise waits for a byte, at most for the timeout: `TimedOut` |
/// | `write` | accepts bytes while the driver's buffer of 4096 bytes has room; otherwise waits |
/// | `flush` | waits until the last bit has been sent |
///
/// When the scenario's time is over, the port hangs up: `read` returns the remaining bytes, then 0
/// bytes; `write`, `flush` and queries such as [`available`](Self::available) return `BrokenPipe`.
/// Therefore a program that serves its ports forever ends too. As with a real driver, unread bytes
/// beyond 4096 are lost. On a link with messages, one read returns one message, whose rest is lost
/// if `buf` is too short, and one write sends one message.
///
/// Clones are handles of the same port: they share its bytes and settings; each has its own
/// timeout. Async reads have no timeout.
#[derive(Clone, Debug)]
pub struct VirtualPort {
    pub(crate) bench: Bench,
    pub(crate) index: usize,
    name: String,
    timeout: Duration,
}

impl VirtualPort {
    pub(crate) fn new(bench: Bench, index: usize, name: &str) -> Self {
        Self {
            bench,
            index,
            name: name.to_owned(),
            timeout: TIMEOUT,
        }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Timeout of a read, virtual time; zero: none.
    pub fn set_timeout(&mut self, timeout: Duration) {
        self.timeout = timeout;
    }

    /// The timeout of a read.
    pub const fn timeout(&self) -> Duration {
        self.timeout
    }

    /// Sets baud rate and format; initially they match the device. A different baud rate gives
    /// garbage, as on real hardware.
    ///
    /// # Errors
    /// [`ErrorKind::InvalidInput`] if no UART supports the setting, [`ErrorKind::BrokenPipe`] after
    /// the verdict.
    pub fn set_line(&mut self, line: LineConfig) -> io::Result<()> {
        check(line)?;
        let mut turn = self.bench.core.enter()?;
        let (run, port) = turn.port(self.index)?;
        port.line = line;
        run.rig.set_line_config(port.end.node, line);
        Ok(())
    }

    /// Baud rate and format.
    ///
    /// # Errors
    /// [`ErrorKind::BrokenPipe`] after the verdict.
    pub fn line(&self) -> io::Result<LineConfig> {
        let mut turn = self.bench.core.enter()?;
        Ok(turn.port(self.index)?.1.line)
    }

    /// Number of bytes that can be read without waiting; on a link with messages, those of the next
    /// message.
    ///
    /// # Errors
    /// [`ErrorKind::BrokenPipe`] when the run is over.
    pub fn available(&self) -> io::Result<usize> {
        let mut turn = self.bench.core.enter()?;
        let (run, port) = turn.port(self.index)?;
        port.collect(run);
        let len = port.len();
        turn.asked()?;
        Ok(len)
    }
}

/// Rejects a setting that no UART supports.
fn check(line: LineConfig) -> io::Result<()> {
    let message = match line {
        LineConfig { baud: 0, .. } => "a baud rate of 0, expected 1 or more".to_owned(),
        LineConfig { data_bits, .. } if !(5..=8).contains(&data_bits) => {
            format!("{data_bits} data bits, expected 5 to 8")
        }
        LineConfig { stop_bits, .. } if !(1..=2).contains(&stop_bits) => {
            format!("{stop_bits} stop bits, expected 1 or 2")
        }
        _ => return Ok(()),
    };
    Err(io::Error::new(ErrorKind::InvalidInput, message))
}

impl Read for VirtualPort {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        if buf.is_empty() {
            return Ok(0);
        }
        let mut turn = self.bench.core.enter()?;
        let (run, _) = turn.port(self.index)?;
        run.go_on_until(run.rig.now());
        let end = turn.end();
        let deadline = (turn.now() + self.timeout).min(end);
        let mut turn = turn.wait(Until::Readable(self.index), deadline)?;
        let (run, port) = turn.port(self.index)?;
        if port.collect(run) {
            return Ok(port.take(buf));
        }
        if turn.now() >= end {
            return Ok(0);
        }
        turn.asked()?;
        Err(io::Error::new(
            ErrorKind::TimedOut,
            "no byte within the timeout",
        ))
    }
}

impl Write for VirtualPort {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        let turn = self.bench.core.enter()?;
        let end = turn.end();
        let mut turn = turn.wait(Until::Room(self.index), end)?;
        if turn.now() >= end {
            return Err(hung_up());
        }
        let (run, port) = turn.port(self.index)?;
        port.give(run, buf)
    }

    fn flush(&mut self) -> io::Result<()> {
        let turn = self.bench.core.enter()?;
        let end = turn.end();
        let mut turn = turn.wait(Until::Sent(self.index), end)?;
        let (run, port) = turn.port(self.index)?;
        port.is_sent(run).then_some(()).ok_or_else(hung_up)
    }
}
