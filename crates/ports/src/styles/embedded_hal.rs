//! `embedded-hal` and `embedded-hal-async` 1.0: I2C, digital pins, delays.
//!
//! The rig has no SPI bus: nothing here implements that trait.

use core::fmt;
use core::future::poll_fn;
use core::time::Duration;
use std::io;

use embedded_hal::digital::{self, InputPin, OutputPin, StatefulOutputPin};
use embedded_hal::i2c::{self, ErrorKind, NoAcknowledgeSource, Operation};
use embedded_hal_async::{delay, i2c as i2c_async};
use engine::rig::LinkKind;

use crate::Bench;
use crate::turns::Until;

/// First byte of a frame with a transaction, see `docs/pty.md`.
const FRAME: u8 = 0x01;
/// Timeout for the answer of a bus.
const ANSWER: Duration = Duration::from_secs(1);
/// Highest 7-bit address.
const ADDRESS_MAX: u8 = 0x7F;
/// Maximum number of bytes in one transfer, without the address.
const TRANSFER_MAX: usize = 254;

impl Bench {
    /// Opens the I2C bus `name` as its master.
    ///
    /// # Errors
    /// Those of [`Bench::port`], also if the link is not an I2C bus.
    pub fn i2c(&self, name: &str) -> io::Result<I2cPort> {
        let index = self.open(name, &[LinkKind::I2c])?;
        let bench = self.clone();
        Ok(I2cPort { bench, index })
    }

    /// Opens the pin `name`, e.g. `lidar-dtr`.
    ///
    /// # Errors
    /// Those of [`Bench::port`], also if the link is not a pin.
    pub fn pin(&self, name: &str) -> io::Result<PinPort> {
        let index = self.open(name, &[LinkKind::Pin])?;
        let bench = self.clone();
        Ok(PinPort {
            bench,
            index,
            is_high: false,
        })
    }

    /// A delay in virtual time.
    pub fn delay(&self) -> Delay {
        Delay(self.clone())
    }
}

/// The reason why a transaction failed.
#[derive(Debug)]
pub struct I2cError {
    kind: ErrorKind,
    message: String,
}

impl fmt::Display for I2cError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl core::error::Error for I2cError {}

impl i2c::Error for I2cError {
    fn kind(&self) -> ErrorKind {
        self.kind
    }
}

impl From<io::Error> for I2cError {
    fn from(error: io::Error) -> Self {
        Self {
            kind: ErrorKind::Other,
            message: error.to_string(),
        }
    }
}

/// The master's end of an I2C bus, in virtual time.
#[derive(Debug)]
pub struct I2cPort {
    bench: Bench,
    index: usize,
}

/// Adjacent operations of the same direction, which form one transfer.
enum Transfer {
    Write(Vec<u8>),
    Read(usize),
}

fn transfers(operations: &[Operation<'_>]) -> Vec<Transfer> {
    let mut transfers: Vec<Transfer> = Vec::new();
    for operation in operations {
        match (transfers.last_mut(), operation) {
            (Some(Transfer::Write(bytes)), Operation::Write(more)) => bytes.extend(*more),
            (Some(Transfer::Read(count)), Operation::Read(more)) => *count += more.len(),
            (_, Operation::Write(bytes)) => transfers.push(Transfer::Write(bytes.to_vec())),
            (_, Operation::Read(buf)) => transfers.push(Transfer::Read(buf.len())),
        }
    }
    transfers
}

/// Distributes the bytes read over the buffers of the read operations.
fn distribute(read: &[u8], operations: &mut [Operation<'_>]) {
    let mut left = read;
    for operation in operations {
        if let Operation::Read(buf) = operation {
            let (these, rest) = left.split_at(buf.len().min(left.len()));
            buf[..these.len()].copy_from_slice(these);
            left = rest;
        }
    }
}

impl I2cPort {
    /// Sends the request of a transfer.
    fn send(&self, address: u8, transfer: &Transfer) -> Result<(), I2cError> {
        if address > ADDRESS_MAX {
            return Err(I2cError {
                kind: ErrorKind::Other,
                message: format!(
                    "the address {address:#04x} has more than 7 bits, expected at most \
                     {ADDRESS_MAX:#04x}: an address of a data sheet with the read bit is twice it"
                ),
            });
        }
        let len = match transfer {
            Transfer::Write(bytes) => bytes.len(),
            Transfer::Read(count) => *count,
        };
        let count = u8::try_from(len).ok().filter(|_| len <= TRANSFER_MAX);
        let Some(count) = count else {
            return Err(I2cError {
                kind: ErrorKind::Overrun,
                message: format!("a transfer of {len} bytes, expected at most {TRANSFER_MAX}"),
            });
        };
        let frame = match transfer {
            Transfer::Write(bytes) => [&[FRAME, count + 1, address << 1], &bytes[..]].concat(),
            Transfer::Read(_) => vec![FRAME, 2, address << 1 | 1, count],
        };
        let mut turn = self.bench.core.enter()?;
        turn.check_open()?;
        let (run, port) = turn.port(self.index)?;
        port.request(run, &frame);
        Ok(())
    }

    /// The answer to a transfer, if it has arrived.
    fn answer(&self, address: u8, transfer: &Transfer) -> Result<Vec<u8>, I2cError> {
        let mut turn = self.bench.core.enter()?;
        let (run, port) = turn.port(self.index)?;
        let frame = port.take_answer(run).unwrap_or_default();
        let count = match transfer {
            Transfer::Write(_) => 0,
            Transfer::Read(count) => *count,
        };
        match &frame[..] {
            [FRAME, 0, _, read @ ..] if read.len() == count => Ok(read.to_vec()),
            [FRAME, status, ..] if *status != 0 => Err(I2cError {
                kind: ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address),
                message: format!("no chip acknowledges the address {address:#04x}"),
            }),
            _ => Err(I2cError {
                kind: ErrorKind::Bus,
                message: format!(
                    "the bus does not answer a transfer at the address {address:#04x}"
                ),
            }),
        }
    }
}

impl i2c::ErrorType for I2cPort {
    type Error = I2cError;
}

impl i2c::I2c for I2cPort {
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), I2cError> {
        let mut read = Vec::new();
        for transfer in transfers(operations) {
            self.send(address, &transfer)?;
            let turn = self.bench.core.enter()?;
            let deadline = (turn.now() + ANSWER).min(turn.end());
            drop(turn.wait(Until::Readable(self.index), deadline)?);
            read.extend(self.answer(address, &transfer)?);
        }
        distribute(&read, operations);
        Ok(())
    }
}

impl i2c_async::I2c for I2cPort {
    async fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), I2cError> {
        let mut read = Vec::new();
        for transfer in transfers(operations) {
            self.send(address, &transfer)?;
            let deadline = self.bench.now() + ANSWER;
            poll_fn(|cx| {
                let mut turn = self.bench.core.enter()?;
                let deadline = deadline.min(turn.end());
                turn.poll(cx, Until::Readable(self.index), deadline)
            })
            .await?;
            read.extend(self.answer(address, &transfer)?);
        }
        distribute(&read, operations);
        Ok(())
    }
}

/// A pin, in virtual time.
#[derive(Debug)]
pub struct PinPort {
    bench: Bench,
    index: usize,
    is_high: bool,
}

impl PinPort {
    fn set(&mut self, is_high: bool) -> Result<(), PinError> {
        let mut turn = self.bench.core.enter().map_err(PinError)?;
        turn.check_open().map_err(PinError)?;
        let (run, port) = turn.port(self.index).map_err(PinError)?;
        port.put(run, &[u8::from(is_high)]);
        self.is_high = is_high;
        Ok(())
    }

    fn level(&self) -> Result<bool, PinError> {
        let mut turn = self.bench.core.enter().map_err(PinError)?;
        let (run, port) = turn.port(self.index).map_err(PinError)?;
        run.go_on_until(run.rig.now());
        let is_high = run.rig.level(port.end.node).unwrap_or(false);
        turn.asked().map_err(PinError)?;
        Ok(is_high)
    }
}

/// The reason why a pin cannot be used.
#[derive(Debug)]
pub struct PinError(io::Error);

impl fmt::Display for PinError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl core::error::Error for PinError {}

impl digital::Error for PinError {
    fn kind(&self) -> digital::ErrorKind {
        digital::ErrorKind::Other
    }
}

impl digital::ErrorType for PinPort {
    type Error = PinError;
}

impl OutputPin for PinPort {
    fn set_low(&mut self) -> Result<(), PinError> {
        self.set(false)
    }

    fn set_high(&mut self) -> Result<(), PinError> {
        self.set(true)
    }
}

impl StatefulOutputPin for PinPort {
    fn is_set_high(&mut self) -> Result<bool, PinError> {
        Ok(self.is_high)
    }

    fn is_set_low(&mut self) -> Result<bool, PinError> {
        Ok(!self.is_high)
    }
}

impl InputPin for PinPort {
    fn is_high(&mut self) -> Result<bool, PinError> {
        self.level()
    }

    fn is_low(&mut self) -> Result<bool, PinError> {
        self.level().map(|is_high| !is_high)
    }
}

/// A delay in virtual time.
#[derive(Clone, Debug)]
pub struct Delay(Bench);

impl embedded_hal::delay::DelayNs for Delay {
    fn delay_ns(&mut self, ns: u32) {
        self.0.sleep(Duration::from_nanos(ns.into()));
    }

    fn delay_us(&mut self, us: u32) {
        self.0.sleep(Duration::from_micros(us.into()));
    }

    fn delay_ms(&mut self, ms: u32) {
        self.0.sleep(Duration::from_millis(ms.into()));
    }
}

impl delay::DelayNs for Delay {
    async fn delay_ns(&mut self, ns: u32) {
        self.0.timer(Duration::from_nanos(ns.into())).await;
    }

    async fn delay_us(&mut self, us: u32) {
        self.0.timer(Duration::from_micros(us.into())).await;
    }

    async fn delay_ms(&mut self, ms: u32) {
        self.0.timer(Duration::from_millis(ms.into())).await;
    }
}
