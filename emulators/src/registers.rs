//! A register slave described by data: a table of named values behind the checked frames of
//! [`protocols::avr`].
//!
//! ```text
//! | AB | register u8 | W(7) count(6..0) | count data bytes, only if W | checksum u16 |
//! ```
//!
//! The slave behaves as a careful small slave: it answers reads, acknowledges writes and answers a
//! bad checksum with the error frame. It discards a partial frame after a pause, and sets safe
//! values when its master falls silent. It reports a master's mistakes and survives them: a value
//! out of range becomes the nearest allowed one, unknown registers read 0.

use std::collections::VecDeque;

use core::time::Duration;

use protocols::avr::{self, ChecksumOrder, ERROR_REGISTER, Frame};
use protocols::{Decode, FrameError, Instant, LineConfig, LineEvent, Port};

use crate::board::{Board, BoardConfig, PIN_LINE, RESET_PIN};
use crate::device::{BrokenRules, Device, Event, EventKind, byte_end, earliest, take};
use crate::event_log::EventLog;
use crate::quantity::{Variable, VariableError, Variables, Wanted, Watchdog};
use crate::world::{Chassis, World};

/// Layout of a value in the registers: low byte first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// One register, 0 to 255.
    U8,
    /// One register, -128 to 127.
    I8,
    /// Two registers, 0 to 65,535.
    U16,
    /// Two registers, -32,768 to 32,767.
    I16,
    /// Four registers, without sign.
    U32,
    /// Four registers, with sign.
    I32,
}

impl Width {
    /// Number of registers.
    pub const fn bytes(self) -> u8 {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 => 4,
        }
    }

    /// Minimum and maximum value.
    pub const fn limits(self) -> [i64; 2] {
        let values = 1_i64 << (8 * self.bytes());
        match self {
            Self::U8 | Self::U16 | Self::U32 => [0, values - 1],
            Self::I8 | Self::I16 | Self::I32 => [-values / 2, values / 2 - 1],
        }
    }

    fn value(self, bytes: [u8; 4]) -> i64 {
        match self {
            Self::U8 => i64::from(bytes[0]),
            Self::I8 => i64::from(bytes[0].cast_signed()),
            Self::U16 => i64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            Self::I16 => i64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            Self::U32 => i64::from(u32::from_le_bytes(bytes)),
            Self::I32 => i64::from(i32::from_le_bytes(bytes)),
        }
    }
}

/// Whether a master may write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Access {
    /// Only the device changes it.
    #[default]
    Read,
    /// The master may write it.
    Write,
}

/// One value of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Register {
    /// Address of its first byte.
    pub address: u8,
    /// Type of the value in the registers.
    pub width: Width,
    /// Whether a master may write it.
    pub access: Access,
    /// The value.
    pub variable: Variable,
}

/// Configuration of a register slave.
#[derive(Clone, Debug, PartialEq)]
pub struct RegistersConfig {
    /// Coding of its line.
    pub line: LineConfig,
    /// Byte order of the checksum.
    pub order: ChecksumOrder,
    /// From the last byte of a request to the first of the answer.
    pub latency: Duration,
    /// Pause that ends a half-received frame.
    pub idle_gap: Duration,
    /// Silence of the master after which values become safe; `None`: never.
    pub watchdog: Option<Duration>,
    /// The table.
    pub registers: Vec<Register>,
    /// The board that it sits on.
    pub board: BoardConfig,
}

/// Maximum number of waiting requests; further ones are lost and reported.
const QUEUE_MAX: usize = 4;

/// The slave.
#[derive(Clone, Debug)]
pub struct Registers {
    config: RegistersConfig,
    variables: Variables,
    decoder: avr::Decoder,
    quiet_at: Option<Instant>,
    watchdog: Watchdog,
    board: Board,
    pending: VecDeque<(Instant, Option<Frame>)>,
    output: VecDeque<u8>,
    /// End of the last answer.
    free_at: Instant,
    log: EventLog,
}

impl Registers {
    /// The bus.
    pub const BUS: Port = Port(0);

    /// A slave that is up as the run begins.
    ///
    /// # Errors
    /// If the table contradicts itself.
    pub fn new(config: RegistersConfig) -> Result<Self, VariableError> {
        for (index, register) in config.registers.iter().enumerate() {
            if let Some(message) = register.fault(&config.registers[..index]) {
                return Err(VariableError { index, message });
            }
        }
        let known = config.registers.iter();
        let variables = Variables::new(known.map(|r| r.variable.clone()).collect())?;
        let board = Board::new(&config.board, &variables).map_err(|name| VariableError {
            index: 0,
            message: format!("there is no register \"{name}\", which a modem line follows"),
        })?;
        Ok(Self {
            board,
            variables,
            decoder: avr::Decoder::new(config.order),
            quiet_at: None,
            watchdog: Watchdog::new(config.watchdog),
            pending: VecDeque::new(),
            output: VecDeque::new(),
            free_at: Instant::ZERO,
            log: EventLog::default(),
            config,
        })
    }

    /// Sets the value called `name` at `now`, as a master would.
    ///
    /// # Errors
    /// If there is no such value, it has a source of its own, or the number is beyond its limits.
    pub fn set(&mut self, now: Instant, name: &str, value: i64) -> Result<(), String> {
        self.variables.set(now, name, value)
    }

    /// Encoders and actuators that its values need; without them, a value reads 0 and drives
    /// nothing.
    pub fn wanted(&self) -> impl Iterator<Item = Wanted<'_>> {
        self.variables.wanted().map(|(_, wanted)| wanted)
    }

    /// Values that a master would read at `now`, in the order of the table.
    pub fn values(&self, now: Instant, world: &World) -> Vec<i64> {
        let registers = 0..self.config.registers.len();
        let read = |index| self.variables.read(index, now, world);
        registers.map(read).collect()
    }

    /// Checks that `chassis` has all [wanted](Self::wanted) encoders and actuators.
    ///
    /// # Errors
    /// The first register that lacks its source, and the sources that exist.
    pub fn check_chassis(&self, chassis: &dyn Chassis) -> Result<(), VariableError> {
        self.variables.check_chassis(chassis)
    }

    fn tell(&mut self, at: Instant, rule: &'static str, detail: impl FnOnce() -> String) {
        self.log.repeated(at, EventKind::Violation, rule, detail);
    }

    /// The board restarts at `at`.
    fn restart(&mut self, at: Instant, why: &str) {
        self.decoder = avr::Decoder::new(self.config.order);
        self.quiet_at = None;
        self.pending.clear();
        self.output.clear();
        self.free_at = at;
        self.watchdog = Watchdog::new(self.config.watchdog);
        self.variables.restart(at);
        self.board.tell_reset(at, why, &mut self.log);
    }

    /// Handles a frame, good or bad, whose last byte ended at `at`.
    fn hear(&mut self, at: Instant, heard: Result<Frame, FrameError>) {
        let request = match heard {
            Ok(frame) => Some(frame),
            // A truncated frame is logged and not answered: its master waits no longer.
            Err(error @ FrameError::Truncated { .. }) => {
                return self.tell(at, "frame-cut-off", || error.to_string());
            }
            Err(error) => {
                self.tell(at, "bad-checksum", || error.to_string());
                None
            }
        };
        if !self.pending.is_empty() || at < self.free_at {
            self.tell(at, "request-before-reply", || {
                "a frame ends before the previous frame is answered".to_owned()
            });
        }
        if self.pending.len() == QUEUE_MAX {
            return self.tell(at, "queue-full", || {
                format!("{QUEUE_MAX} requests wait already")
            });
        }
        if request.is_some() {
            self.watchdog.heard(at);
        }
        self.pending.push_back((at + self.config.latency, request));
    }

    fn answer(&mut self, now: Instant, request: Option<&Frame>, world: &World) {
        let order = self.config.order;
        let reply = match request {
            None => Frame::read(ERROR_REGISTER, 0, order),
            Some(frame) if frame.is_write() => {
                self.write(now, frame);
                Frame::read(frame.register(), 0, order)
            }
            Some(frame) => {
                let data = self.read(now, frame.register(), frame.count(), world);
                Frame::write(frame.register(), &data, order)
            }
        };
        self.output.extend(reply.as_bytes());
        let time = self.config.line.bytes_time(reply.as_bytes().len() as u64);
        self.free_at = self.free_at.max(now) + time;
    }

    fn read(&mut self, now: Instant, first: u8, count: u8, world: &World) -> Vec<u8> {
        let mut data = vec![0; usize::from(count)];
        let mut known = vec![false; data.len()];
        for index in 0..self.config.registers.len() {
            let Register { address, width, .. } = self.config.registers[index];
            let bytes = self.variables.read(index, now, world).to_le_bytes();
            for (offset, byte) in (0..width.bytes()).zip(bytes) {
                let at = usize::from(address + offset).checked_sub(usize::from(first));
                if let Some(slot) = at.filter(|&at| at < data.len()) {
                    (data[slot], known[slot]) = (byte, true);
                }
            }
        }
        self.judge_span(now, first, &known);
        data
    }

    fn write(&mut self, now: Instant, frame: &Frame) {
        let (first, data) = (usize::from(frame.register()), frame.data());
        let mut known = vec![false; data.len()];
        for index in 0..self.config.registers.len() {
            let register = &self.config.registers[index];
            let (width, access) = (register.width, register.access);
            let start = usize::from(register.address);
            let mut bytes = [0; 4];
            let mut touched = 0;
            for offset in 0..usize::from(width.bytes()) {
                let slot = (start + offset).checked_sub(first);
                if let Some(slot) = slot.filter(|&slot| slot < data.len()) {
                    (bytes[offset], known[slot]) = (data[slot], true);
                    touched += 1;
                }
            }
            let name = || self.variables.get(index).name.clone();
            match (touched, access) {
                (0, _) => {}
                (_, Access::Read) => {
                    let name = name();
                    self.tell(now, "write-read-only", || format!("{name} is read-only"));
                }
                (touched, Access::Write) if touched < width.bytes() => {
                    let name = name();
                    let all = width.bytes();
                    self.tell(now, "value-cut", || {
                        format!("{touched} of {all} bytes of {name}; it keeps its value")
                    });
                }
                (_, Access::Write) => {
                    let (name, value) = (name(), width.value(bytes));
                    if !self.variables.write(now, index, value) {
                        let [least, greatest] = self.variables.get(index).limits;
                        self.tell(now, "out-of-range", || {
                            format!("{name} = {value}, expected {least} to {greatest}")
                        });
                    }
                }
            }
        }
        self.judge_span(now, frame.register(), &known);
    }

    fn judge_span(&mut self, now: Instant, first: u8, known: &[bool]) {
        if let Some(offset) = known.iter().position(|known| !known) {
            let address = usize::from(first) + offset;
            self.tell(now, "unknown-register", || {
                format!("there is no register {address}")
            });
        }
    }
}

impl Register {
    fn fault(&self, before: &[Self]) -> Option<String> {
        let end = |register: &Self| u16::from(register.address) + u16::from(register.width.bytes());
        let [least, greatest] = self.width.limits();
        let overlaps = |other: &&Self| {
            u16::from(self.address) < end(other) && u16::from(other.address) < end(self)
        };
        if end(self) > u16::from(ERROR_REGISTER) {
            return Some(format!("it ends at {}, expected before 255", end(self)));
        }
        if let Some(other) = before.iter().find(overlaps) {
            let name = &other.variable.name;
            return Some(format!("address {} belongs to \"{name}\"", self.address));
        }
        let limits = self.variable.limits;
        if limits[0] < least || limits[1] > greatest {
            let [from, to] = limits;
            return Some(format!(
                "limits are {from} and {to}, its width holds {least} to {greatest}"
            ));
        }
        if self.access == Access::Read && self.variable.drives.is_some() {
            return Some("it drives an actuator, so a master must be able to write it".to_owned());
        }
        if self.access == Access::Write && !self.variable.is_stored() {
            return Some("it has a source, so that writing it would have no effect".to_owned());
        }
        None
    }
}

impl Device for Registers {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        if port == RESET_PIN {
            if let Some(at) = self.board.pin(now, bytes) {
                self.restart(at, "the host raises its line");
            }
            return;
        }
        if self.board.is_deaf(now, &mut self.log) {
            return;
        }
        for (index, &byte) in bytes.iter().enumerate() {
            let at = byte_end(now, self.config.line, index, bytes.len());
            self.expire(at);
            self.quiet_at = Some(at + self.config.idle_gap);
            let before = (self.decoder.discarded(), self.decoder.pending());
            let heard: Vec<_> = self.decoder.push(&[byte]).collect();
            if heard.is_empty() && self.decoder.discarded() > before.0 && before.1 == 0 {
                self.tell(at, "stray-bytes", || {
                    format!("byte {byte:02X} outside a frame")
                });
            }
            heard.into_iter().for_each(|heard| self.hear(at, heard));
        }
    }

    /// A UART receives a break as a NUL without a stop bit; few programs check for this.
    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        if port != Self::BUS || event != LineEvent::Break {
            return;
        }
        if self.board.is_reset_by_break(now) {
            return self.restart(now, "a break");
        }
        let detail = "a break: received as a NUL".to_owned();
        self.log.note(now, "break", detail);
        self.receive(port, now, &[0]);
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        self.log.poll(now);
        self.expire(now);
        self.board.poll(now, &self.variables, world);
        while let Some((due, request)) = self.pending.pop_front() {
            if due > now {
                self.pending.push_front((due, request));
                break;
            }
            self.answer(now, request.as_ref(), world);
        }
        self.watchdog.poll(now, &mut self.variables, &mut self.log);
        self.variables.drive(now, world, &mut self.log);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        match port {
            Self::BUS => take(&mut self.output, buf),
            pin => self.board.transmit(pin, buf),
        }
    }

    fn poll_at(&self) -> Option<Instant> {
        let due = self.pending.front().map(|(due, _)| *due);
        earliest([
            due,
            self.quiet_at,
            self.watchdog.silent_at(),
            self.variables.changed_at(),
            self.board.poll_at(),
            self.log.poll_at(),
        ])
    }

    fn line_config(&self, port: Port) -> LineConfig {
        match port {
            Self::BUS => self.config.line,
            _ => PIN_LINE,
        }
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }
}

impl Registers {
    /// Discards the partial frame that a pause of the line has cut off.
    fn expire(&mut self, now: Instant) {
        let Some(at) = self.quiet_at.filter(|&at| at <= now) else {
            return;
        };
        self.quiet_at = None;
        self.decoder.idle();
        let heard: Vec<_> = self.decoder.push(&[]).collect();
        heard.into_iter().for_each(|heard| self.hear(at, heard));
    }
}

#[cfg(test)]
mod tests;
