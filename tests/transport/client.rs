//! A foreign program in its own process: it answers on the register bus, written only from the
//! format's document, correct or with one bug.

use core::time::Duration;
use std::io::{ErrorKind, Read, Write};
use std::path::Path;

use serialport::TTYPort;

/// The variable that makes this test binary a client with that bug.
pub(crate) const BUG: &str = "HILRIG_TEST_CLIENT";

/// Silence that ends a partial frame. On a busy machine a shorter silence may occur inside a frame.
const IDLE: Duration = Duration::from_millis(15);
/// Registers that it has.
const REGISTERS: u8 = 32;

/// Not a test: `hilrig fuzz --exec` starts it as a client in other tests. Without the variable it
/// does nothing.
#[test]
fn the_client_of_other_tests_ends_only_when_its_port_does() {
    let (Ok(bug), Ok(dir)) = (std::env::var(BUG), std::env::var("HILRIG_DIR")) else {
        return;
    };
    let path = Path::new(&dir).join("gripper");
    let builder = serialport::new(path.to_string_lossy(), 115_200).timeout(IDLE);
    let mut port = TTYPort::open(&builder).expect("the rig offers it");
    let mut client = Client::with(&bug);
    let mut buf = [0; 256];
    loop {
        let heard = match port.read(&mut buf) {
            Ok(0) => return,
            Ok(len) => &buf[..len],
            Err(error) if error.kind() == ErrorKind::TimedOut => &[],
            Err(_) => return,
        };
        let reply = client.hears(heard);
        port.write_all(&reply).expect("the rig reads");
    }
}

/// A client with its received bytes and its bug: `crash`, `hang`, `accept`, `meddle`, `patient`;
/// any other word is a client without a bug.
pub(crate) struct Client {
    bug: String,
    pending: Vec<u8>,
}

impl Client {
    pub(crate) fn with(bug: &str) -> Self {
        Self {
            bug: bug.to_owned(),
            pending: Vec::new(),
        }
    }

    /// The answer to `bytes`; no bytes mean an idle line.
    pub(crate) fn hears(&mut self, bytes: &[u8]) -> Vec<u8> {
        if bytes.is_empty() {
            if self.bug != "patient" {
                self.pending.clear();
            }
            if self.bug == "meddle" {
                // A write to the first register, which the gripper calls its uptime.
                return frame(0, &[1]);
            }
        }
        self.pending.extend_from_slice(bytes);
        core::iter::from_fn(|| self.step()).flatten().collect()
    }

    /// Drops bytes that begin no frame, takes the first frame out and answers it; `None` if more
    /// bytes are needed.
    fn step(&mut self) -> Option<Vec<u8>> {
        let start = self.pending.iter().position(|&byte| byte == 0xAB);
        self.pending.drain(..start.unwrap_or(self.pending.len()));
        let control = *self.pending.get(2)?;
        if self.bug == "hang" && self.pending[1] == 0xAB {
            loop {
                std::thread::park();
            }
        }
        let data = usize::from(control.saturating_sub(128));
        let (sum, end) = (self.pending.get(..3 + data)?, 3 + data);
        let sum: u16 = sum.iter().map(|&byte| u16::from(byte)).sum();
        let found = [*self.pending.get(end)?, *self.pending.get(end + 1)?];
        if self.bug == "crash" && data > 64 {
            eprintln!("*** buffer overflow detected ***");
            std::process::abort();
        }
        let holds = match self.bug.as_str() {
            "accept" => found[0] == sum.to_le_bytes()[0],
            _ => found == sum.to_le_bytes(),
        };
        let register = self.pending[1];
        if !holds {
            self.pending.remove(0);
            return Some(frame(0xFF, &[]));
        }
        self.pending.drain(..end + 2);
        Some(match control {
            _ if register >= REGISTERS => Vec::new(),
            0..=16 => frame(register, &vec![register; usize::from(control)]),
            17..=127 => Vec::new(),
            _ => frame(register, &[]),
        })
    }
}

/// A frame of the bus, checksum low byte first.
fn frame(register: u8, data: &[u8]) -> Vec<u8> {
    let control = 0x80 | u8::try_from(data.len()).expect("at most 16");
    let mut frame = [&[0xAB, register, control], data].concat();
    let sum: u16 = frame.iter().map(|&byte| u16::from(byte)).sum();
    frame.extend(sum.to_le_bytes());
    frame
}
