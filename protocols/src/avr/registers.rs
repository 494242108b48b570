//! The register map of the AVR base as one table.
//!
//! Source: field firmware b77a6df, 53 registers of one byte; two- and four-byte values lie in
//! consecutive registers, low byte first.

/// Registers in the map.
pub const COUNT: usize = 53;

/// The side that may write a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// The slave overwrites it all the time: a write is acknowledged and lost.
    ReadOnly,
    /// The master sets it.
    ReadWrite,
    /// No source: the register keeps the written value.
    Scratch,
}

/// Type of a register's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// One unsigned byte.
    U8,
    /// One signed byte.
    I8,
    /// Two bytes, signed.
    I16,
    /// Four bytes, signed.
    I32,
}

impl Width {
    /// Registers that a value takes.
    pub const fn bytes(self) -> u8 {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::I16 => 2,
            Self::I32 => 4,
        }
    }
}

/// One value of the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// Its first register.
    pub address: u8,
    /// Short name in snake case.
    pub name: &'static str,
    /// Type of its value.
    pub width: Width,
    /// The side that may write it.
    pub access: Access,
    /// Unit of the value, empty if it has none.
    pub unit: &'static str,
}

/// System status; the fielded firmware always reports 0.
pub const SYSTEM_STATUS: u8 = 0;
/// First of six infrared distances in a row, two bytes each.
pub const DIST_BACK_RIGHT: u8 = 1;
/// First of the other four, which lie in 12 bytes.
pub const DIST_FRONT_LEFT: u8 = 21;
/// Battery voltage in mV, two bytes.
pub const BATTERY_MV: u8 = 33;
/// Battery charge in percent.
pub const BATTERY_PERCENT: u8 = 35;
/// Left wheel encoder, four bytes.
pub const ENCODER_LEFT: u8 = 36;
/// Right wheel encoder, four bytes.
pub const ENCODER_RIGHT: u8 = 40;
/// Measured speed of the left wheel.
pub const SPEED_LEFT_IS: u8 = 44;
/// Measured speed of the right wheel.
pub const SPEED_RIGHT_IS: u8 = 45;
/// Set-point of the left wheel.
pub const SPEED_LEFT_TO: u8 = 46;
/// Set-point of the right wheel.
pub const SPEED_RIGHT_TO: u8 = 47;
/// Motor driver: 0 active, anything else stand-by.
pub const MOTOR_STANDBY: u8 = 48;
/// LED: 0 the slave decides, 1 the colour comes from the master.
pub const LED_MODE: u8 = 49;

/// Reading of the left thermometer, tenths of a degree Celsius, two bytes. Not in the report; on a
/// converter channel that the fielded base has free.
pub const HEAT_LEFT: u8 = 13;
/// Reading of the right thermometer, in the same format.
pub const HEAT_RIGHT: u8 = 17;
/// Number of rescue kits that have left the magazine; it survives restarts. A write sets the number
/// to reach, so that a repeated write drops no kit twice. Not in the report; behind the fielded
/// map.
pub const KITS: u8 = 53;
/// Turn of the base by its gyroscope, hundredths of a degree, counter-clockwise, four bytes. Not in
/// the report; behind the kits.
pub const YAW: u8 = 54;

const fn reg(
    address: u8,
    name: &'static str,
    width: Width,
    access: Access,
    unit: &'static str,
) -> Register {
    Register {
        address,
        name,
        width,
        access,
        unit,
    }
}

use Access::{ReadOnly, ReadWrite, Scratch};
use Width::{I8, I16, I32, U8};

/// All values in order of their address, without gaps.
pub const TABLE: [Register; 30] = [
    reg(SYSTEM_STATUS, "system_status", U8, ReadOnly, ""),
    reg(DIST_BACK_RIGHT, "dist_back_right", I16, ReadOnly, "mm"),
    reg(3, "dist_right_back", I16, ReadOnly, "mm"),
    reg(5, "dist_left_back", I16, ReadOnly, "mm"),
    reg(7, "dist_back_left", I16, ReadOnly, "mm"),
    reg(9, "dist_front_front", I16, ReadOnly, "mm"),
    reg(11, "dist_back_back", I16, ReadOnly, "mm"),
    reg(13, "adc6", I16, Scratch, ""),
    reg(15, "dist_down", I16, ReadOnly, "adc"),
    reg(17, "adc8", I16, Scratch, ""),
    reg(19, "battery_raw", I16, ReadOnly, "adc"),
    reg(DIST_FRONT_LEFT, "dist_front_left", I16, ReadOnly, "mm"),
    reg(23, "dist_left_front", I16, ReadOnly, "mm"),
    reg(25, "impasse_1", I16, ReadOnly, ""),
    reg(27, "impasse_2", I16, ReadOnly, ""),
    reg(29, "dist_right_front", I16, ReadOnly, "mm"),
    reg(31, "dist_front_right", I16, ReadOnly, "mm"),
    reg(BATTERY_MV, "battery_mv", I16, ReadOnly, "mV"),
    reg(BATTERY_PERCENT, "battery_percent", I8, ReadOnly, "%"),
    reg(ENCODER_LEFT, "encoder_left", I32, ReadOnly, "ticks"),
    reg(ENCODER_RIGHT, "encoder_right", I32, ReadOnly, "ticks"),
    reg(SPEED_LEFT_IS, "speed_left_is", I8, ReadOnly, "ticks/40 ms"),
    reg(
        SPEED_RIGHT_IS,
        "speed_right_is",
        I8,
        ReadOnly,
        "ticks/40 ms",
    ),
    reg(SPEED_LEFT_TO, "speed_left_to", I8, ReadWrite, "ticks/40 ms"),
    reg(
        SPEED_RIGHT_TO,
        "speed_right_to",
        I8,
        ReadWrite,
        "ticks/40 ms",
    ),
    reg(MOTOR_STANDBY, "motor_standby", U8, ReadWrite, ""),
    reg(LED_MODE, "led_mode", U8, ReadWrite, ""),
    reg(50, "led_hue", U8, ReadWrite, ""),
    reg(51, "led_saturation", U8, ReadWrite, ""),
    reg(52, "led_value", U8, ReadWrite, ""),
];

/// The value that `address` is part of.
pub fn at(address: u8) -> Option<&'static Register> {
    TABLE
        .iter()
        .rfind(|register| register.address <= address)
        .filter(|register| {
            u16::from(address) < u16::from(register.address) + u16::from(register.width.bytes())
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_covers_each_register_once() {
        let next = TABLE.iter().fold(0, |next, register| {
            assert_eq!(register.address, next, "{}", register.name);
            next + register.width.bytes()
        });
        assert_eq!(usize::from(next), COUNT);
    }

    #[test]
    fn a_byte_inside_a_value_belongs_to_it() {
        assert_eq!(at(39).map(|register| register.name), Some("encoder_left"));
        assert_eq!(at(52).map(|register| register.name), Some("led_value"));
        assert_eq!(at(53), None);
    }
}
