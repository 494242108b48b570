//! A port as the other end of a line.

use core::time::Duration;

use protocols::{Instant, LineConfig};

use description::peer::Peer;

use super::CliError;
use crate::realtime::clock::{Clock as _, WallClock};
use crate::realtime::transport::{Serial, Transport as _, wait};

/// A serial port, or a terminal offered by a rig.
pub(super) struct PortPeer {
    serial: Serial,
    line: LineConfig,
    clock: WallClock,
}

impl PortPeer {
    /// Opens the port at `path`.
    pub(super) fn open(path: &std::path::Path, line: LineConfig) -> Result<Self, CliError> {
        Ok(Self {
            serial: Serial::open(path, line)?,
            line,
            clock: WallClock::start(),
        })
    }
}

/// Longest pause within a frame that a busy computer or an adapter causes.
const LATENESS: Duration = Duration::from_secs(1);

impl Peer for PortPeer {
    fn lateness(&self) -> Duration {
        LATENESS
    }

    fn now(&self) -> Instant {
        self.clock.now()
    }

    fn send(&mut self, bytes: &[u8]) -> Result<Instant, String> {
        let sent = self.serial.write(bytes);
        if sent < bytes.len() {
            return Err(format!("the port took {sent} of {} bytes", bytes.len()));
        }
        Ok(self.clock.now() + self.line.bytes_time(bytes.len() as u64))
    }

    fn hear(&mut self, until: Instant) -> Result<Option<(Instant, Vec<u8>)>, String> {
        let mut buf = [0; 1_024];
        loop {
            let len = self
                .serial
                .read(&mut buf)
                .map_err(|error| error.to_string())?;
            let now = self.clock.now();
            if len > 0 {
                // The last byte has just arrived.
                let took = self.line.bytes_time(len as u64);
                let began = Instant::ZERO + (now - Instant::ZERO).saturating_sub(took);
                return Ok(Some((began, buf[..len].to_vec())));
            }
            if now >= until {
                return Ok(None);
            }
            let mut files = Vec::new();
            self.serial.readiness(&mut files);
            wait(&files, until - now).map_err(|error| error.to_string())?;
        }
    }
}
