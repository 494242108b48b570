//! The registers, and in the fielded builds the memory that lies behind them.
//!
//! ```text
//!   0..=52   register map
//!  53..=58   the request being worked on: register, count with W, data pointer, checksum
//!  59..=259  further variables; nothing depends on them
//! 260..=261  period of the timer task, 1
//! 262..=381  further variables; the farthest address that a request can name
//! ```
//!
//! Nothing checks an address in those builds, so a request reads and writes all of it. The place
//! of the request was seen on the wire; that a write to 255..=268 kills the timer task too; where
//! exactly in that range the task's period lies is a guess.

use core::ops::Range;

use protocols::avr::registers;

/// Addresses that a request can name: 255 + 127 - 1 is the last.
const SIZE: usize = 382;
/// Where the request being worked on lies.
const REQUEST: usize = registers::COUNT;
/// Address of the receive buffer that the request's pointer shows, low byte first. A guess.
const DATA_POINTER: [u8; 2] = [0x60, 0x03];
/// Where the period of the timer task lies.
const TIMER_TASK: Range<usize> = 260..262;
/// What lies there while all is well.
const TIMER_PERIOD: [u8; 2] = [1, 0];

/// Registers and what is behind them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Memory([u8; SIZE]);

impl Memory {
    /// As after a reset: all registers 0.
    pub(super) fn new() -> Self {
        let mut bytes = [0; SIZE];
        bytes[TIMER_TASK].copy_from_slice(&TIMER_PERIOD);
        Self(bytes)
    }

    /// One byte; beyond the end 0.
    pub(super) fn get(&self, address: u8) -> u8 {
        self.0[usize::from(address)]
    }

    /// Sets one byte.
    pub(super) fn set(&mut self, address: u8, value: u8) {
        self.0[usize::from(address)] = value;
    }

    /// Sets a value of two registers, low byte first.
    pub(super) fn set_i16(&mut self, address: u8, value: i16) {
        self.write(address, &value.to_le_bytes());
    }

    /// Sets a value of four registers, low byte first.
    pub(super) fn set_i32(&mut self, address: u8, value: i32) {
        self.write(address, &value.to_le_bytes());
    }

    /// `count` bytes from `address` on.
    pub(super) fn read(&self, address: u8, count: u8) -> &[u8] {
        &self.0[usize::from(address)..][..usize::from(count)]
    }

    /// Writes `data`, at most 127 bytes, from `address` on.
    pub(super) fn write(&mut self, address: u8, data: &[u8]) {
        self.0[usize::from(address)..][..data.len()].copy_from_slice(data);
    }

    /// Puts the request that is worked on where the fielded builds have it.
    pub(super) fn hold_request(&mut self, register: u8, control: u8, checksum: [u8; 2]) {
        let [low, high] = DATA_POINTER;
        let [sum_high, sum_low] = checksum;
        let request = [register, control, low, high, sum_low, sum_high];
        self.0[REQUEST..][..request.len()].copy_from_slice(&request);
    }

    /// The register of the request that is worked on, as the reply is made from it.
    pub(super) fn held_register(&self) -> u8 {
        self.0[REQUEST]
    }

    /// Whether the task that counts ticks still runs: encoders and all time-outs hang on it.
    pub(super) fn timer_task_runs(&self) -> bool {
        self.0[TIMER_TASK] == TIMER_PERIOD
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

    /// Seen on field firmware b77a6df: 14 bytes FF to register 255 stop the timer task, one does
    /// not.
    #[test]
    fn only_a_long_write_behind_the_registers_stops_the_timer_task() {
        let mut memory = Memory::new();
        memory.write(255, &[0x55]);
        assert!(memory.timer_task_runs());
        memory.write(53, &[0x11; 126]);
        assert!(memory.timer_task_runs());
        memory.write(255, &[0xFF; 14]);
        assert!(!memory.timer_task_runs());
    }
}
