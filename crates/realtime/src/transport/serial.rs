//! A serial port of this machine: a real one, or another program's pseudo-terminal.
//!
//! The library for ports blocks: for bytes, for room, for a missing cable. Two threads with a pipe
//! each are therefore between the port and the rig. No action of the port can stop the rig, and the
//! rig waits for the pipe. The pipes are also the limits: bytes that do not fit into the outgoing
//! pipe are lost and counted.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::collections::VecDeque;
use std::fs;
use std::io::{self, PipeReader, PipeWriter, Read, Write, pipe};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use protocols::{LineConfig, Parity};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::pipe::fcntl_setpipe_size;
use serialport::{ClearBuffer, DataBits, ErrorKind, FlowControl, SerialPort, StopBits, TTYPort};

use super::{Counters, PortEvent, Transport, TransportError};

/// Maximum number of bytes that wait for the port: one page, as in a Linux serial driver.
const BACKLOG_MAX: usize = 4096;
/// Maximum wait of a thread for the port until it checks whether it must end.
const PATIENCE: Duration = Duration::from_millis(50);
/// A receiver samples the last bit of a character within half a bit if the rates differ by less
/// than 5 %. Both ends share this tolerance, so one end may deviate by this much.
const BAUD_ERROR_PERCENT_MAX: u32 = 2;

/// A serial port, opened exclusively.
#[derive(Debug)]
pub struct Serial {
    path: PathBuf,
    port: TTYPort,
    incoming: Option<PipeReader>,
    outgoing: Option<PipeWriter>,
    threads: Vec<JoinHandle<()>>,
    shared: Arc<Shared>,
    counters: Counters,
    events: VecDeque<PortEvent>,
}

/// State shared by the port and its threads.
#[derive(Debug, Default)]
struct Shared {
    stop: AtomicBool,
    failure: Mutex<Option<io::Error>>,
}

impl Serial {
    /// Opens `path` exclusively, sets it to `line`, and discards bytes that arrived before.
    ///
    /// # Errors
    /// If the port does not exist, is in use, or cannot be set up.
    pub fn open(path: &Path, line: LineConfig) -> Result<Self, TransportError> {
        let port = open_port(path, line)?;
        Self::start(path, port).map_err(|source| TransportError::Open {
            path: path.to_owned(),
            baud: line.baud,
            source,
        })
    }

    fn start(path: &Path, port: TTYPort) -> io::Result<Self> {
        port.clear(ClearBuffer::All)?;
        let (incoming, to_rig) = pipe()?;
        let (from_rig, outgoing) = pipe()?;
        set_nonblocking(&incoming)?;
        set_nonblocking(&outgoing)?;
        fcntl_setpipe_size(&outgoing, BACKLOG_MAX)?;
        let shared = Arc::<Shared>::default();
        let mut this = Self {
            path: path.to_owned(),
            incoming: Some(incoming),
            outgoing: Some(outgoing),
            threads: Vec::new(),
            shared,
            counters: Counters::default(),
            events: VecDeque::from([PortEvent::Opened]),
            port,
        };
        let (port, shared) = (this.port.try_clone_native()?, Arc::clone(&this.shared));
        this.spawn("port reader", move || carry_in(port, to_rig, &shared))?;
        let (port, shared) = (this.port.try_clone_native()?, Arc::clone(&this.shared));
        this.spawn("port writer", move || carry_out(port, from_rig, &shared))?;
        Ok(this)
    }

    fn spawn(&mut self, name: &str, work: impl FnOnce() + Send + 'static) -> io::Result<()> {
        let thread = thread::Builder::new().name(name.to_owned()).spawn(work)?;
        self.threads.push(thread);
        Ok(())
    }

    fn lost(&mut self) -> TransportError {
        let failure = self.shared.failure.lock().map(|mut failure| failure.take());
        TransportError::Lost {
            path: self.path.clone(),
            source: failure
                .ok()
                .flatten()
                .unwrap_or_else(|| io::ErrorKind::BrokenPipe.into()),
        }
    }
}

impl Transport for Serial {
    fn read(&mut self, buf: &mut [u8]) -> Result<usize, TransportError> {
        if buf.is_empty() {
            return Ok(0);
        }
        let Some(incoming) = &mut self.incoming else {
            return Err(self.lost());
        };
        match incoming.read(buf) {
            // The reading thread ends only if the port failed.
            Ok(0) => {
                self.incoming = None;
                self.events.push_back(PortEvent::Closed);
                Err(self.lost())
            }
            Ok(len) => Ok(len),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(0),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(0),
            Err(source) => Err(TransportError::Lost {
                path: self.path.clone(),
                source,
            }),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> usize {
        let Some(outgoing) = self.outgoing.as_mut().filter(|_| self.incoming.is_some()) else {
            self.counters.unheard += bytes.len() as u64;
            return 0;
        };
        let mut written = 0;
        while written < bytes.len() {
            match outgoing.write(&bytes[written..]) {
                Ok(len) if len > 0 => written += len,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                _ => break,
            }
        }
        self.counters.overrun += (bytes.len() - written) as u64;
        written
    }

    fn next_event(&mut self) -> Option<PortEvent> {
        self.events.pop_front()
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn counters(&self) -> Counters {
        self.counters
    }

    fn readiness<'a>(&'a self, fds: &mut Vec<BorrowedFd<'a>>) {
        fds.extend(self.incoming.as_ref().map(AsFd::as_fd));
    }
}

impl Drop for Serial {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.incoming = None;
        self.outgoing = None;
        // Pending output is sent. Output that the port does not take is discarded. The system does
        // not report this to a blocked write, but any setting of the port wakes the write.
        let _ = self.port.flush();
        let _ = self.port.clear(ClearBuffer::Output);
        let _ = self.port.set_flow_control(FlowControl::None);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// Copies bytes from the port to the rig, until the port fails or the rig closes the pipe.
fn carry_in(mut port: TTYPort, mut to_rig: PipeWriter, shared: &Shared) {
    let mut buf = [0; 4096];
    while !shared.stop.load(Ordering::Relaxed) {
        match port.read(&mut buf) {
            Ok(0) => return fail(shared, io::ErrorKind::UnexpectedEof.into()),
            Ok(len) => {
                if to_rig.write_all(&buf[..len]).is_err() {
                    return;
                }
            }
            Err(error) if is_passing(&error) => {}
            Err(error) => return fail(shared, error),
        }
    }
}

/// Copies bytes from the rig to the port, until the rig closes its end. The reading thread reports
/// a failed port.
fn carry_out(mut port: TTYPort, mut from_rig: PipeReader, shared: &Shared) {
    let mut buf = [0; BACKLOG_MAX];
    while let Ok(len) = from_rig.read(&mut buf) {
        let mut left = &buf[..len];
        if left.is_empty() {
            return;
        }
        while !left.is_empty() {
            match port.write(left) {
                Ok(len) => left = &left[len..],
                Err(error) if is_passing(&error) && !shared.stop.load(Ordering::Relaxed) => {}
                Err(_) => return,
            }
        }
    }
}

fn fail(shared: &Shared, error: io::Error) {
    if let Ok(mut failure) = shared.failure.lock() {
        *failure = Some(error);
    }
}

/// Whether the error only means that the port has no bytes or no room yet.
fn is_passing(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}

fn open_port(path: &Path, line: LineConfig) -> Result<TTYPort, TransportError> {
    let path = path.to_owned();
    match fs::metadata(&path) {
        Ok(meta) if !meta.file_type().is_char_device() => {
            return Err(TransportError::NotAPort { path });
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Err(TransportError::Missing { path });
        }
        _ => {}
    }
    let builder = serialport::new(path.to_string_lossy(), line.baud)
        .data_bits(match line.data_bits {
            5 => DataBits::Five,
            6 => DataBits::Six,
            7 => DataBits::Seven,
            _ => DataBits::Eight,
        })
        .parity(match line.parity {
            Parity::None => serialport::Parity::None,
            Parity::Even => serialport::Parity::Even,
            Parity::Odd => serialport::Parity::Odd,
        })
        .stop_bits(match line.stop_bits {
            2 => StopBits::Two,
            _ => StopBits::One,
        })
        .timeout(PATIENCE);
    let port = TTYPort::open(&builder).and_then(|port| Ok((port.baud_rate()?, port)));
    match port {
        Ok((baud, port)) if is_near(baud, line.baud) => Ok(port),
        Ok((baud, _)) => Err(TransportError::Open {
            path,
            baud: line.baud,
            source: io::Error::other(format!("its nearest is {baud}")),
        }),
        // The library reports "no device" both for a lock of another program and for a busy device.
        Err(error) if error.kind() == ErrorKind::NoDevice => Err(TransportError::Busy { path }),
        Err(error) => Err(TransportError::Open {
            path,
            baud: line.baud,
            source: error.into(),
        }),
    }
}

fn is_near(baud: u32, wanted: u32) -> bool {
    u64::from(baud.abs_diff(wanted)) * 100 <= u64::from(wanted) * u64::from(BAUD_ERROR_PERCENT_MAX)
}

fn set_nonblocking(fd: impl AsFd) -> io::Result<()> {
    fcntl_setfl(&fd, fcntl_getfl(&fd)? | OFlags::NONBLOCK)?;
    Ok(())
}
