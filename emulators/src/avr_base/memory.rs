//! The registers, and in the fielded builds the memory that lies around them.
//!
//! ```text
//!  -24..=-1   task table: four tasks of six bytes
//!    0..=52   register map
//!   53..=58   the request: register, count with W, data pointer, checksum
//!   59..=64   the last reply's header, in the same order
//!   65..=192  receive buffer, where the data pointer points
//!  195..=196  reading of the floor sensor
//!  235..=262  infrared distances
//!  263..=266  battery: reading and mV
//! ```
//!
//! Nothing checks an address in those builds, so a request reads and writes all of it from 0 on.
//! Source: field firmware b77a6df run in a simulated ATmega2560. Seen on the wire: the data
//! pointer 02ED, the header at 59, the task table at 0294 below the map at 02AC, and what lies at
//! 195, 235 and 263. The receive buffer follows from the pointer. The order of the distances is a
//! guess. What is not listed reads as what was written to it last, 0 at first.

use protocols::avr::registers;

/// Addresses that a request can name: 255 + 127 - 1 is the last.
const SIZE: usize = 382;
/// Where the request being worked on lies.
const REQUEST: usize = registers::COUNT;
/// Where the reply's header lies.
const REPLY: usize = 59;
/// Where the receive buffer lies.
const BUFFER: i16 = 65;
/// Address of the register map in the processor's memory.
const MAP: u16 = 0x02AC;
/// Address of the receive buffer.
const DATA_POINTER: u16 = 0x02ED;
/// Bytes of the task table: from 0294 up to the map.
const TASK_BYTES: usize = 24;
/// Registers that the main loop refills from variables, how many, and where those lie.
const FED: [(usize, usize, usize); 4] = [(1, 12, 235), (21, 12, 247), (15, 2, 195), (19, 2, 263)];
/// Where the battery's voltage lies, low byte first.
const BATTERY_MV: usize = 265;

/// Registers and what is around them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Memory {
    bytes: [u8; SIZE],
    /// Which bytes of the task table were overwritten.
    tasks: [bool; TASK_BYTES],
    /// Variable behind the register of the battery's percent; its place is not known.
    percent: u8,
}

/// What is left of the task table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tasks {
    Sound,
    /// The next tick meets a task of which a part is overwritten.
    Damaged,
    /// None of its periods comes to an end within a run.
    Gone,
}

impl Memory {
    /// As after a reset: all registers 0.
    pub(super) fn new() -> Self {
        let mut memory = Self {
            bytes: [0; SIZE],
            tasks: [false; TASK_BYTES],
            percent: 0,
        };
        memory.bytes[REQUEST + 2..][..2].copy_from_slice(&DATA_POINTER.to_le_bytes());
        memory
    }

    /// One byte.
    pub(super) fn get(&self, address: u8) -> u8 {
        self.bytes[usize::from(address)]
    }

    /// Sets one byte.
    pub(super) fn set(&mut self, address: u8, value: u8) {
        self.bytes[usize::from(address)] = value;
    }

    /// Sets a value of four registers, low byte first.
    pub(super) fn set_i32(&mut self, address: u8, value: i32) {
        self.write(address, &value.to_le_bytes());
    }

    /// `count` bytes from `address` on.
    pub(super) fn read(&self, address: u8, count: u8) -> &[u8] {
        &self.bytes[usize::from(address)..][..usize::from(count)]
    }

    /// Writes `data`, at most 127 bytes, from `address` on.
    pub(super) fn write(&mut self, address: u8, data: &[u8]) {
        self.bytes[usize::from(address)..][..data.len()].copy_from_slice(data);
    }

    /// Sets the variable behind a register that the base feeds, and the register.
    pub(super) fn feed_i16(&mut self, register: u8, value: i16) {
        let place = FED.iter().find_map(|&(first, count, variable)| {
            let index = usize::from(register).checked_sub(first)?;
            (index < count).then_some(variable + index)
        });
        if let Some(place) = place {
            self.bytes[place..][..2].copy_from_slice(&value.to_le_bytes());
        }
        self.write(register, &value.to_le_bytes());
    }

    /// Sets the variables of the battery.
    pub(super) fn feed_battery(&mut self, mv: u16, percent: Option<u8>) {
        self.bytes[BATTERY_MV..][..2].copy_from_slice(&mv.to_le_bytes());
        self.percent = percent.unwrap_or(self.percent);
    }

    /// The main loop refills what the base feeds.
    pub(super) fn refill(&mut self) {
        for (register, count, variable) in FED {
            self.bytes.copy_within(variable..variable + count, register);
        }
    }

    /// The same for the battery's high byte and percent, where the fielded builds have them.
    pub(super) fn refill_battery(&mut self) {
        self.set(registers::BATTERY_MV, self.bytes[BATTERY_MV + 1]);
        self.set(registers::BATTERY_PERCENT, self.percent);
    }

    /// Puts the request that is worked on where the fielded builds have it, and the header of its
    /// reply.
    pub(super) fn hold_request(&mut self, register: u8, control: u8, checksum: [u8; 2]) {
        let [low, high] = DATA_POINTER.to_le_bytes();
        let [sum_high, sum_low] = checksum;
        let request = [register, control, low, high, sum_low, sum_high];
        self.bytes[REQUEST..][..request.len()].copy_from_slice(&request);
        self.bytes[REPLY] = register;
    }

    /// Copies `count` bytes from where the request's pointer points to where its register says.
    /// Both are read again for each byte, from the last byte to the first: a write of ten bytes 55
    /// to 50 has changed the reply's register before it reaches its own at 53.
    pub(super) fn copy_data(&mut self, count: u8) {
        for index in (0..u16::from(count)).rev() {
            let [low, high] = [self.bytes[REQUEST + 2], self.bytes[REQUEST + 3]];
            let from = u16::from_le_bytes([low, high]).wrapping_add(index);
            let place = usize::from(from.wrapping_sub(MAP));
            // What lies outside is not known; most of the processor's memory is unused.
            let byte = self.bytes.get(place).copied().unwrap_or(0);
            let to = usize::from(self.bytes[REQUEST]) + usize::from(index);
            self.bytes[to] = byte;
        }
    }

    /// Register of the reply, from its header.
    pub(super) fn reply_register(&self) -> u8 {
        self.bytes[REPLY]
    }

    /// The reply's header is complete but for its checksum.
    pub(super) fn hold_reply(&mut self, control: u8) {
        let data = MAP + u16::from(self.bytes[REPLY]);
        let [low, high] = data.to_le_bytes();
        self.bytes[REPLY + 1..][..3].copy_from_slice(&[control, low, high]);
    }

    /// The reply was sent.
    pub(super) fn hold_reply_checksum(&mut self, checksum: u16) {
        self.bytes[REPLY + 4..][..2].copy_from_slice(&checksum.to_le_bytes());
    }

    /// An error frame was sent.
    pub(super) fn hold_error(&mut self, register: u8, checksum: u16) {
        self.bytes[REPLY..][..2].copy_from_slice(&[register, 0]);
        self.hold_reply_checksum(checksum);
    }

    /// The receive interrupt stores a byte of data. The index has a sign, so that the byte may lie
    /// below the buffer.
    pub(super) fn store(&mut self, index: i8, byte: u8) {
        let address = i16::from(index) + BUFFER;
        if let Ok(place) = usize::try_from(address) {
            self.bytes[place] = byte;
            return;
        }
        let below = usize::from(address.unsigned_abs());
        if below <= TASK_BYTES {
            self.tasks[TASK_BYTES - below] = true;
        }
    }

    /// Count of the request, with W.
    pub(super) fn request_control(&self) -> u8 {
        self.bytes[REQUEST + 1]
    }

    /// A request with this count begins.
    pub(super) fn hold_control(&mut self, control: u8) {
        self.bytes[REQUEST + 1] = control;
    }

    /// What is left of the task table.
    pub(super) fn tasks(&self) -> Tasks {
        match self.tasks.iter().filter(|&&damaged| damaged).count() {
            0 => Tasks::Sound,
            TASK_BYTES => Tasks::Gone,
            _ => Tasks::Damaged,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_farthest_address_of_a_request_exists() {
        let mut memory = Memory::new();
        memory.write(255, &[7; 127]);
        assert_eq!(memory.read(255, 127), [7; 127]);
    }

    #[test]
    fn every_index_of_the_receive_interrupt_is_harmless_here() {
        let mut memory = Memory::new();
        for index in i8::MIN..=i8::MAX {
            memory.store(index, 0x5A);
        }
        assert_eq!(memory.tasks(), Tasks::Gone);
        assert_eq!(memory.read(0, 127), [0x5A; 127]);
    }

    /// Three bytes of a register, a pointer anywhere: nothing is out of reach of `copy_data`.
    #[test]
    fn a_pointer_to_nowhere_reads_as_zero() {
        let mut memory = Memory::new();
        memory.hold_request(53, 0xFF, [0, 0]);
        for index in 0..=127 {
            memory.store(index, 0xFF);
        }
        memory.copy_data(127);
        assert_eq!(memory.reply_register(), 0xFF);
        assert_eq!(memory.read(53, 2), [0, 0]);
    }
}
