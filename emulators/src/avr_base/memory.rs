//! The registers, and in the fielded builds the memory that lies around them.
//!
//! ```text
//!  -24..=-1   task table: four tasks of six bytes
//!    0..=52   register map
//!   53..=58   the request: register, count with W, data pointer, checksum
//!   59..=64   the last reply's header, in the same order
//!   65..=192  receive buffer, where the data pointer points at first
//!  193..=194  right impasse sensor; 195 floor; 197 left impasse sensor
//!  199..=230  readings of the infrared sensors; 231..=262 their distances
//!  263..=264  which blocks of them are wanted, which are measured
//!  265..=266  battery's reading
//!  267..=312  motors, see [`Motors`]
//! ```
//!
//! Those builds check no address, so a request reads and writes all of it from 0 on. Sources: field
//! firmware b77a6df run in a simulated ATmega2560, and its public source (structs in their order,
//! 16-bit integers low byte first). Build 5f54f4d has the same layout one byte higher. Memory
//! behind 312 is unused: it reads as the last byte written to it, AA at first.

use std::collections::BTreeMap;

use protocols::avr::registers;

/// Addresses that a request can name: 255 + 127 - 1 is the last.
const SIZE: usize = 382;
/// Position of the current request, and of its data pointer.
const REQUEST: usize = registers::COUNT;
const POINTER: usize = REQUEST + 2;
/// Position of the reply's header.
const REPLY: usize = 59;
/// Position of the receive buffer.
const BUFFER: u16 = 65;
/// Address of the register map in the processor's memory, build b77a6df.
pub(super) const MAP_2015: u16 = 0x02AC;
/// Address of the register map in the processor's memory, build 5f54f4d.
pub(super) const MAP_2014: u16 = 0x02AD;
/// The processor's memory behind its registers.
const RAM: core::ops::Range<u16> = 0x0200..0x2200;
/// Bytes of the task table: right below the map.
const TASK_BYTES: u16 = 24;
/// Readings of the infrared sensors; their distances lie this much farther.
const READINGS: usize = 199;
const DISTANCES: usize = 231;
/// Blocks of infrared sensors that are wanted, and that have been measured, a bit each.
const WANTED: usize = 263;
/// Registers that the main loop refills from a variable of two bytes, and the variable's position.
/// The firmware has a table of four by four distances.
const FED: [(usize, usize); 14] = [
    (1, DISTANCES + 26),
    (3, DISTANCES + 14),
    (5, DISTANCES + 6),
    (7, DISTANCES + 24),
    (9, DISTANCES + 20),
    (11, DISTANCES + 30),
    (15, 195),
    (19, BATTERY),
    (21, DISTANCES + 16),
    (23, DISTANCES + 4),
    (25, 197),
    (27, 193),
    (29, DISTANCES + 12),
    (31, DISTANCES + 18),
];
/// Position of the battery's reading.
const BATTERY: usize = 265;
/// Position of the motors' state.
const MOTORS: core::ops::Range<usize> = 267..313;
/// The start code fills the memory behind the last variable with this byte, up to the stack, for a
/// measurement of the stack's depth.
const UNUSED: u8 = 0xAA;
/// Address in the processor's memory that the stack does not reach: 256 bytes before its start.
const UNUSED_RAM_END: u16 = 0x2100;

/// Registers and the memory around them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Memory {
    bytes: [u8; SIZE],
    /// Address of the map in the processor's memory.
    map: u16,
    /// Bytes written elsewhere, through an overwritten data pointer.
    far: BTreeMap<u16, u8>,
    /// The overwritten bytes of the task table.
    tasks: [bool; TASK_BYTES as usize],
    /// Variables behind the registers of the battery's voltage and percent: they lie below the map.
    battery_mv: u16,
    percent: u8,
}

/// State of the motors as it lies in the memory, left and right.
///
/// ```text
/// 267  count at the last run of the regulator, i32 each
/// 275  power, i16 each
/// 279  left:  speed is, to (i16), count, count of all edges (i32)
/// 291  right: the same
/// 303  switched off, switched off unseen (i8), mean count (i32)
/// 309  sum of errors, i16 each
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Motors {
    pub(super) counted: [i32; 2],
    pub(super) power: [i16; 2],
    pub(super) is: [i16; 2],
    pub(super) to: [i16; 2],
    pub(super) count: [i32; 2],
    pub(super) edges: [i32; 2],
    pub(super) off: u8,
    pub(super) off_unseen: u8,
    pub(super) sum: [i16; 2],
}

/// The remaining task table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tasks {
    Sound,
    /// The next tick meets a task of which a part is overwritten.
    Damaged,
    /// The task table is overwritten; no period ends within a run.
    Gone,
}

impl Memory {
    /// As after a reset: all registers 0. The map lies at `map` in the processor's memory.
    pub(super) fn new(map: u16) -> Self {
        let mut memory = Self {
            bytes: [0; SIZE],
            map,
            far: BTreeMap::new(),
            tasks: [false; TASK_BYTES as usize],
            battery_mv: 0,
            percent: 0,
        };
        memory.bytes[POINTER..][..2].copy_from_slice(&(map + BUFFER).to_le_bytes());
        memory.bytes[WANTED] = 0b111;
        memory.bytes[MOTORS.end..].fill(UNUSED);
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
        let fed = FED.iter().find(|(fed, _)| *fed == usize::from(register));
        if let Some(&(_, place)) = fed {
            self.bytes[place..][..2].copy_from_slice(&value.to_le_bytes());
        }
        self.write(register, &value.to_le_bytes());
    }

    /// Sets the converter's reading of the infrared sensor of `register`.
    pub(super) fn feed_reading(&mut self, register: u8, reading: u16) {
        let fed = FED.iter().find(|(fed, _)| *fed == usize::from(register));
        if let Some(&(_, place)) = fed.filter(|(_, place)| (DISTANCES..WANTED).contains(place)) {
            let place = place - DISTANCES + READINGS;
            self.bytes[place..][..2].copy_from_slice(&reading.to_le_bytes());
        }
    }

    /// Whether a block of infrared sensors is wanted; all are unless the variable was overwritten.
    pub(super) fn wants_block(&self, block: usize) -> bool {
        self.bytes[WANTED] >> block & 1 != 0
    }

    /// Notes that a block of infrared sensors was measured.
    pub(super) fn has_block(&mut self, block: usize) {
        self.bytes[WANTED + 1] |= 1 << block;
    }

    /// The battery's reading, as it lies in the memory.
    pub(super) fn battery_reading(&self) -> i16 {
        i16::from_le_bytes([self.bytes[BATTERY], self.bytes[BATTERY + 1]])
    }

    /// Sets the variables of the battery.
    pub(super) fn feed_battery(&mut self, mv: u16, percent: Option<u8>) {
        self.battery_mv = mv;
        self.percent = percent.unwrap_or(self.percent);
    }

    /// Refills the registers that the base feeds, as the main loop does.
    pub(super) fn refill(&mut self) {
        for (register, variable) in FED {
            // Byte by byte: to move two bytes at once is a call each time.
            self.bytes[register] = self.bytes[variable];
            self.bytes[register + 1] = self.bytes[variable + 1];
        }
    }

    /// Refills the battery's high byte and percent, at their registers in the fielded builds.
    pub(super) fn refill_battery(&mut self) {
        self.set(registers::BATTERY_MV, self.battery_mv.to_le_bytes()[1]);
        self.set(registers::BATTERY_PERCENT, self.percent);
    }

    /// The motors' state as the memory has it.
    pub(super) fn motors(&self) -> Motors {
        let long = |at: usize| {
            let bytes = self.bytes[at..].first_chunk().copied();
            i32::from_le_bytes(bytes.unwrap_or_default())
        };
        let short = |at: usize| {
            let bytes = self.bytes[at..].first_chunk().copied();
            i16::from_le_bytes(bytes.unwrap_or_default())
        };
        Motors {
            counted: [267, 271].map(long),
            power: [275, 277].map(short),
            is: [279, 291].map(short),
            to: [281, 293].map(short),
            count: [283, 295].map(long),
            edges: [287, 299].map(long),
            off: self.bytes[303],
            off_unseen: self.bytes[304],
            sum: [309, 311].map(short),
        }
    }

    /// Stores the motors' state at its position in the memory.
    pub(super) fn hold_motors(&mut self, motors: &Motors) {
        let mut put = |at: usize, bytes: &[u8]| {
            self.bytes[at..][..bytes.len()].copy_from_slice(bytes);
        };
        for side in 0..2 {
            put(267 + 4 * side, &motors.counted[side].to_le_bytes());
            put(275 + 2 * side, &motors.power[side].to_le_bytes());
            put(279 + 12 * side, &motors.is[side].to_le_bytes());
            put(281 + 12 * side, &motors.to[side].to_le_bytes());
            put(283 + 12 * side, &motors.count[side].to_le_bytes());
            put(287 + 12 * side, &motors.edges[side].to_le_bytes());
            put(309 + 2 * side, &motors.sum[side].to_le_bytes());
        }
        put(303, &[motors.off, motors.off_unseen]);
        let mean = motors.count[0] / 2 + motors.count[1] / 2;
        put(305, &mean.to_le_bytes());
    }

    /// Whether `count` bytes from `first` on hold any of the motors' state.
    pub(super) fn reaches_motors(first: u8, count: u8) -> bool {
        let (first, count) = (usize::from(first), usize::from(count));
        first < MOTORS.end && first + count > MOTORS.start
    }

    /// Puts the current request where the fielded builds have it. The data pointer stays unchanged:
    /// the firmware sets it once, when the processor starts.
    pub(super) fn hold_request(&mut self, register: u8, control: u8, checksum: [u8; 2]) {
        let [sum_high, sum_low] = checksum;
        self.bytes[REQUEST..POINTER].copy_from_slice(&[register, control]);
        self.bytes[POINTER + 2..][..2].copy_from_slice(&[sum_low, sum_high]);
    }

    /// Copies the register of the request to the reply.
    pub(super) fn begin_reply(&mut self, register: u8) {
        self.bytes[REPLY] = register;
    }

    /// Copies `count` bytes from the request's data pointer to its register. Pointer, register and
    /// count are loaded once, and addresses count up.
    pub(super) fn copy_data(&mut self, register: u8, count: u8) {
        let pointer = self.pointer();
        for index in 0..u16::from(count) {
            let byte = self.at(pointer.wrapping_add(index));
            self.bytes[usize::from(register) + usize::from(index)] = byte;
        }
    }

    /// Whether the pointer leads to the data of the request. A write may have replaced it by an
    /// address without storage.
    pub(super) fn holds(&self, data: &[u8]) -> bool {
        let pointer = self.pointer();
        let mut places = (0_u16..).map(|index| pointer.wrapping_add(index));
        data.iter().all(|&byte| {
            let place = places.next().expect("without end");
            self.at(place) == byte
        })
    }

    fn pointer(&self) -> u16 {
        u16::from_le_bytes([self.bytes[POINTER], self.bytes[POINTER + 1]])
    }

    /// The byte at an address of the processor.
    fn at(&self, address: u16) -> u8 {
        let place = usize::from(address.wrapping_sub(self.map));
        let near = self.bytes.get(place).copied();
        let found = near.or(self.far.get(&address).copied());
        let unused = SIZE..usize::from(UNUSED_RAM_END - self.map);
        found.unwrap_or(if unused.contains(&place) { UNUSED } else { 0 })
    }

    /// Register of the reply, from its header.
    pub(super) fn reply_register(&self) -> u8 {
        self.bytes[REPLY]
    }

    /// Stores the header of the reply to a read of `register`, without the checksum.
    pub(super) fn hold_reply(&mut self, register: u8, control: u8) {
        let [low, high] = (self.map + u16::from(register)).to_le_bytes();
        self.bytes[REPLY..][..4].copy_from_slice(&[register, control, low, high]);
    }

    /// Stores the header of the reply to a write. It has no data: its pointer stays that of the
    /// last read.
    pub(super) fn hold_acknowledgement(&mut self) {
        self.bytes[REPLY + 1] = 0;
    }

    /// Stores the checksum of a sent reply.
    pub(super) fn hold_reply_checksum(&mut self, checksum: u16) {
        self.bytes[REPLY + 4..][..2].copy_from_slice(&checksum.to_le_bytes());
    }

    /// Stores the header and checksum of a sent error frame.
    pub(super) fn hold_error(&mut self, register: u8, checksum: u16) {
        self.bytes[REPLY..][..2].copy_from_slice(&[register, 0]);
        self.hold_reply_checksum(checksum);
    }

    /// Stores a data byte where the pointer leads, as the receive interrupt does. The index has a
    /// sign, so that the byte may lie below the buffer.
    pub(super) fn store(&mut self, index: i8, byte: u8) {
        let address = self.pointer().wrapping_add_signed(i16::from(index));
        let place = usize::from(address.wrapping_sub(self.map));
        if let Some(near) = self.bytes.get_mut(place) {
            *near = byte;
            return;
        }
        let below = self.map.wrapping_sub(address);
        if below <= TASK_BYTES {
            self.tasks[usize::from(TASK_BYTES - below)] = true;
        } else if RAM.contains(&address) && address > self.map {
            self.far.insert(address, byte);
        }
    }

    /// Count of the request, with W.
    pub(super) fn request_control(&self) -> u8 {
        self.bytes[REQUEST + 1]
    }

    /// Stores the count of a request that begins.
    pub(super) fn hold_control(&mut self, control: u8) {
        self.bytes[REQUEST + 1] = control;
    }

    /// The remaining task table.
    pub(super) fn tasks(&self) -> Tasks {
        match self.tasks.iter().filter(|&&damaged| damaged).count() {
            0 => Tasks::Sound,
            damaged if damaged == self.tasks.len() => Tasks::Gone,
            _ => Tasks::Damaged,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_farthest_address_of_a_request_exists() {
        let mut memory = Memory::new(MAP_2015);
        memory.write(255, &[7; 127]);
        assert_eq!(memory.read(255, 127), [7; 127]);
    }

    /// The 127 bytes of memory from 255 on, as read on the chip with both builds at rest.
    #[test]
    fn f1_unused_memory_is_as_the_start_code_leaves_it() {
        let mut memory = Memory::new(MAP_2015);
        assert_eq!(memory.read(255, 127)[313 - 255..], [0xAA; 69]);
        memory.write(55, &0x1000_u16.to_le_bytes());
        memory.copy_data(10, 2);
        assert_eq!(memory.read(9, 4), [0, 0xAA, 0xAA, 0]);
    }

    #[test]
    fn every_index_of_the_receive_interrupt_is_harmless_here() {
        let mut memory = Memory::new(MAP_2015);
        for index in 0..=i8::MAX {
            memory.store(index, 0x5A);
        }
        assert_eq!(memory.read(65, 127), [0x5A; 127]);
        assert_eq!(memory.tasks(), Tasks::Sound);
        for index in (-128..-64).rev() {
            memory.store(index, 0x5A);
        }
        assert_eq!(memory.tasks(), Tasks::Gone);
    }

    /// `copy_data` follows any pointer, and memory that cannot be stored is not held.
    #[test]
    fn a_pointer_to_anywhere_is_followed() {
        for pointer in (0..=u16::MAX).step_by(97) {
            let mut memory = Memory::new(MAP_2015);
            memory.write(55, &pointer.to_le_bytes());
            for index in i8::MIN..=i8::MAX {
                memory.store(index, 0xA5);
            }
            memory.copy_data(255, 127);
        }
        let held = |pointer: u16| {
            let mut memory = Memory::new(MAP_2015);
            memory.write(55, &pointer.to_le_bytes());
            memory.store(0, 0xA5);
            memory.holds(&[0xA5])
        };
        assert_eq!(
            [0x0010, 0x02ED, 0x0BFB, 0x21FF, 0x2200].map(held),
            [false, true, true, true, false]
        );
    }

    /// Field firmware b77a6df, measured on the chip: the expected addresses of the values were
    /// worked out by hand.
    #[test]
    fn the_motors_lie_where_the_firmware_has_them() {
        let mut memory = Memory::new(MAP_2015);
        let motors = Motors {
            counted: [1, 2],
            power: [-3, 4],
            is: [5, -6],
            to: [7, 8],
            count: [0x0102_0304, -9],
            edges: [10, 11],
            off: 12,
            off_unseen: 13,
            sum: [-14, 15],
        };
        memory.hold_motors(&motors);
        assert_eq!(memory.motors(), motors);
        let at = |address: usize| memory.bytes[address];
        assert_eq!([283, 284, 285, 286].map(at), [4, 3, 2, 1]);
        assert_eq!(
            [279, 291, 303, 304, 309, 267].map(at),
            [5, 0xFA, 12, 13, 0xF2, 1]
        );
        // The mean is 0102_0304 / 2 + -9 / 2, each cut towards zero.
        let mean = i32::from_le_bytes([305, 306, 307, 308].map(at));
        assert_eq!(mean, 0x0081_0182 - 4);
        assert!(Memory::reaches_motors(255, 13) && !Memory::reaches_motors(255, 12));
        assert!(Memory::reaches_motors(199, 127) && !Memory::reaches_motors(140, 127));
    }
}
