//! Work of the main loop: fill registers, answer requests, regulate and stop motors.

use core::time::Duration;

use protocols::Instant;
use protocols::avr::registers::{self, Access};
use protocols::avr::{self, ERROR_REGISTER, Frame};

use super::config::{Announce, DebugText};
use super::journal::rules;
use super::memory::Memory;
use super::profile::{
    BatteryRegisters, Bounds, EncoderCopy, Processor, SET_POINT_MAX, SetPoints, Status,
};
use super::request::{Request, RequestKind};
use super::{AvrBase, SET_POINT_REGISTERS};

/// Delay by the text of the debug build: 72 of its 103 bytes leave at 90 us each before the rest
/// fits the ring, and `printf` takes time as well. Measured: replies 7.2 to 8.4 ms late.
pub(super) const DEBUG_TEXT_TIME: Duration = Duration::from_micros(7_150);
/// Length of that text. Its wording is not known.
const DEBUG_TEXT_LEN: usize = 103;

const ENCODER_REGISTERS: [u8; 2] = [registers::ENCODER_LEFT, registers::ENCODER_RIGHT];
const SPEED_REGISTERS: [u8; 2] = [registers::SPEED_LEFT_IS, registers::SPEED_RIGHT_IS];

impl AvrBase {
    /// Fills the registers from the variables, and the set-points from their registers.
    pub(super) fn main_loop_pass(&mut self) {
        self.memory.refill();
        if self.quirks.battery == BatteryRegisters::HighByteOnly {
            self.memory.refill_battery();
        }
        let status = self.status();
        self.memory.set(registers::SYSTEM_STATUS, status);
        for (side, address) in self.sides.iter().zip(ENCODER_REGISTERS) {
            self.memory.set_i32(address, side.counter.count());
        }
        for (side, address) in self.sides.iter_mut().zip(SPEED_REGISTERS) {
            self.memory.set(address, side.is.to_le_bytes()[0]);
        }
        for (side, address) in self.sides.iter_mut().zip(SET_POINT_REGISTERS) {
            let register = self.memory.get(address);
            side.set_point = match self.quirks.set_points {
                SetPoints::Unsigned => i16::from(register),
                SetPoints::Signed | SetPoints::SignedAndReported => {
                    i16::from(register.cast_signed())
                }
            };
        }
    }

    fn status(&self) -> u8 {
        match self.quirks.status {
            Status::Zero => 0,
            Status::Reported => {
                let off = self.is_stopped() || !self.motors_enabled();
                u8::from(off) << 1
            }
        }
    }

    pub(super) fn announce(&mut self, now: Instant) {
        if self.quirks.status == Status::Reported && self.config.announce == Announce::StopButton {
            let status = self.status();
            let frame = Frame::write(registers::SYSTEM_STATUS, &[status], self.quirks.checksum);
            self.bus.send(now, frame.as_bytes());
            self.announces_until = self.bus.free_at();
        }
    }

    /// Executes `request` at `at` and returns the reply.
    pub(super) fn answer(&mut self, at: Instant, request: &Request) -> Frame {
        self.last_frame = request.at;
        self.print_debug_text(at);
        let reply = if request.valid {
            self.judge(request);
            self.restart_watchdog(at, request);
            match self.quirks.bounds {
                Bounds::Memory => self.access_memory(request),
                Bounds::Refused => self.access_registers(request),
            }
        } else {
            self.refuse()
        };
        self.main_loop_pass();
        reply
    }

    /// The error frame.
    fn refuse(&mut self) -> Frame {
        let reply = Frame::read(ERROR_REGISTER, 0, self.quirks.checksum);
        self.memory.hold_error(ERROR_REGISTER, sum(&reply));
        reply
    }

    /// Runs `access` on `count` bytes from `register` on. If they include the motors' state, that
    /// state is copied to the memory before, and back to the motors after.
    fn with_motors(&mut self, register: u8, count: u8, access: impl FnOnce(&mut Memory)) {
        if !Memory::reaches_motors(register, count) {
            return access(&mut self.memory);
        }
        let before = self.motor_state();
        self.memory.hold_motors(&before);
        access(&mut self.memory);
        let after = self.memory.motors();
        if after != before {
            self.take_motor_state(&after);
        }
    }

    fn print_debug_text(&mut self, at: Instant) {
        if self.config.debug_text == DebugText::On && self.quirks.processor == Processor::Measured {
            let mut text = [b'.'; DEBUG_TEXT_LEN];
            text[..7].copy_from_slice(b"request");
            text[DEBUG_TEXT_LEN - 1] = b'\n';
            self.debug.send(at, &text);
        }
    }

    /// Access of the fielded builds: no address check, and the request itself lies behind the
    /// registers.
    fn access_memory(&mut self, request: &Request) -> Frame {
        let order = self.quirks.checksum;
        let [.., first, second] = request.bytes[..] else {
            return Frame::read(ERROR_REGISTER, 0, order);
        };
        let (register, count) = (request.register(), request.count());
        self.memory
            .hold_request(register, request.bytes[2], [first, second]);
        match request.kind() {
            RequestKind::Write => {
                // A receiver without the fielded interrupt has not stored it yet.
                for (&byte, index) in request.data().iter().zip(0..) {
                    self.memory.store(index, byte);
                }
                if !self.memory.holds(request.data()) {
                    // The checksum covers the bytes at the data pointer.
                    return self.refuse();
                }
                self.memory.begin_reply(register);
                self.with_motors(register, count, |memory| memory.copy_data(register, count));
                let reply = Frame::read(self.memory.reply_register(), 0, order);
                self.memory.hold_acknowledgement();
                self.memory.hold_reply_checksum(sum(&reply));
                reply
            }
            RequestKind::Read => {
                self.with_motors(register, count, |_| {});
                self.memory.hold_reply(register, 0x80 | count);
                let torn = self.tear_encoders(request);
                let memory = torn.as_ref().unwrap_or(&self.memory);
                let data = memory.read(request.register(), request.count());
                let reply = Frame::write(request.register(), data, order);
                self.memory.hold_reply_checksum(sum(&reply));
                reply
            }
        }
    }

    /// The memory as a read finds it if an encoder's count carried while it was copied.
    fn tear_encoders(&mut self, request: &Request) -> Option<Memory> {
        if self.quirks.encoder == EncoderCopy::Snapshot {
            return None;
        }
        let torn = self.tear.chance(self.config.encoder_tear);
        let counts = self.sides.map(|side| side.counter.torn());
        if !torn || counts == [None; 2] || request.register() >= registers::SPEED_LEFT_IS {
            return None;
        }
        let mut memory = self.memory.clone();
        for (address, count) in ENCODER_REGISTERS.into_iter().zip(counts) {
            if let Some(count) = count {
                memory.set_i32(address, count);
            }
        }
        Some(memory)
    }

    /// Access as documented: refuses the whole request if it leaves the map or writes a read-only
    /// register.
    fn access_registers(&mut self, request: &Request) -> Frame {
        let order = self.quirks.checksum;
        let (first, count) = (request.register(), request.count());
        let end = usize::from(first) + usize::from(count);
        let known = usize::from(first) < self.map_len() && end <= self.map_len();
        let allowed = request.kind() == RequestKind::Read || read_only(first, count).is_none();
        if !known || !allowed {
            return Frame::read(ERROR_REGISTER, 0, order);
        }
        if request.kind() == RequestKind::Read {
            return Frame::write(first, self.memory.read(first, count), order);
        }
        self.memory.write(first, request.data());
        for address in SET_POINT_REGISTERS {
            let asked = i16::from(self.memory.get(address).cast_signed());
            let limited = asked.clamp(-SET_POINT_MAX, SET_POINT_MAX);
            self.memory.set(address, limited.to_le_bytes()[0]);
        }
        Frame::read(first, 0, order)
    }

    /// Reports requests that a well-behaved master does not send.
    fn judge(&mut self, request: &Request) {
        let (first, count) = (request.register(), request.count());
        let last = u16::from(first) + u16::from(count.max(1)) - 1;
        let at = request.at;
        let map_end = self.map_len() - 1;
        if usize::from(last) > map_end {
            let rule = rules::UNKNOWN_REGISTER;
            self.journal.violation(at, rule, &request.bytes, || {
                format!("registers {first} to {last}; the map ends at {map_end}")
            });
        }
        if let Some(name) = cut_value(first, count) {
            self.journal
                .violation(at, rules::VALUE_CUT, &request.bytes, || {
                    format!("registers {first} to {last} hold a part of {name}")
                });
        }
        if request.kind() == RequestKind::Write {
            self.judge_write(request);
        }
    }

    fn judge_write(&mut self, request: &Request) {
        let (first, at) = (request.register(), request.at);
        if let Some(name) = read_only(first, request.count()) {
            let rule = rules::WRITE_READ_ONLY;
            self.journal.violation(at, rule, &request.bytes, || {
                format!("{name} is read-only: the base sets it")
            });
        }
        for address in SET_POINT_REGISTERS {
            let written = address
                .checked_sub(first)
                .and_then(|index| request.data().get(usize::from(index)));
            let Some(&byte) = written else { continue };
            let asked = i16::from(byte.cast_signed());
            if asked.abs() > SET_POINT_MAX {
                let rule = rules::SET_POINT_OUT_OF_RANGE;
                self.journal.violation(at, rule, &request.bytes, || {
                    format!("speed {asked}, limit {SET_POINT_MAX}")
                });
            }
        }
    }
}

/// Sum of a reply, as its header holds it.
fn sum(reply: &Frame) -> u16 {
    let bytes = reply.as_bytes();
    avr::checksum(&bytes[..bytes.len() - 2])
}

/// Name of the first value among `count` registers from `first` on that the base itself feeds.
fn read_only(first: u8, count: u8) -> Option<&'static str> {
    values(first, count)
        .find(|value| value.access == Access::ReadOnly)
        .map(|value| value.name)
}

/// Name of a value of which only a part lies in `count` registers from `first` on.
fn cut_value(first: u8, count: u8) -> Option<&'static str> {
    let end = u16::from(first) + u16::from(count);
    values(first, count)
        .filter(|value| value.access != Access::Scratch)
        .find(|value| {
            let value_end = u16::from(value.address) + u16::from(value.width.bytes());
            value.address < first || value_end > end
        })
        .map(|value| value.name)
}

/// The values that lie at least partly in `count` registers from `first` on.
fn values(first: u8, count: u8) -> impl Iterator<Item = &'static registers::Register> {
    let end = u16::from(first) + u16::from(count);
    registers::TABLE.iter().filter(move |value| {
        let value_end = u16::from(value.address) + u16::from(value.width.bytes());
        u16::from(value.address) < end && value_end > u16::from(first)
    })
}
