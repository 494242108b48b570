//! Commands: the top bit distinguishes motor and steering, the other seven contain the value.

use core::fmt;

/// The top bit: a motor level.
const MOTOR: u8 = 0x80;
/// Added to a level on the wire.
const LEVEL_OFFSET: i8 = 10;
/// Added to a steering value on the wire.
const STEERING_OFFSET: i8 = 50;

/// Speed of the motor: -10 (backwards) to 10; 0 stops.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Level(i8);

impl Level {
    /// Standing still.
    pub const STOP: Self = Self(0);
    /// The least and the greatest.
    pub const RANGE: [i8; 2] = [-10, 10];

    /// The level with this number.
    ///
    /// # Errors
    /// If the number is not within -10 to 10.
    pub const fn new(level: i16) -> Result<Self, CommandError> {
        match small(level, Self::RANGE) {
            Some(level) => Ok(Self(level)),
            None => Err(CommandError::Level { found: level }),
        }
    }

    /// Its number.
    pub const fn get(self) -> i8 {
        self.0
    }
}

/// Direction of the front wheels: -50 (left) to 50 (right), in steps of the servo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Steering(i8);

impl Steering {
    /// The least and the greatest.
    pub const RANGE: [i8; 2] = [-50, 50];

    /// The steering value with this number.
    ///
    /// # Errors
    /// If the number is not within -50 to 50.
    pub const fn new(value: i16) -> Result<Self, CommandError> {
        match small(value, Self::RANGE) {
            Some(value) => Ok(Self(value)),
            None => Err(CommandError::Steering { found: value }),
        }
    }

    /// Its number.
    pub const fn get(self) -> i8 {
        self.0
    }
}

/// `value` if it is within `range`.
const fn small(value: i16, range: [i8; 2]) -> Option<i8> {
    if value < range[0] as i16 || value > range[1] as i16 {
        return None;
    }
    Some(value.to_le_bytes()[0].cast_signed())
}

/// One command; each is one byte, so a lost or added byte costs no other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Sets the motor.
    Motor(Level),
    /// Sets the steering.
    Steering(Steering),
}

impl Command {
    /// The byte.
    pub const fn encode(self) -> u8 {
        match self {
            Self::Motor(Level(level)) => MOTOR | (level + LEVEL_OFFSET).cast_unsigned(),
            Self::Steering(Steering(value)) => (value + STEERING_OFFSET).cast_unsigned(),
        }
    }

    /// Meaning of a byte.
    ///
    /// # Errors
    /// If the level (95 to FF) or the steering value (65 to 7F) is beyond its range. The error has
    /// the number.
    pub const fn decode(byte: u8) -> Result<Self, CommandError> {
        let figure = (byte & !MOTOR) as i16;
        if byte & MOTOR == 0 {
            match Steering::new(figure - STEERING_OFFSET as i16) {
                Ok(steering) => Ok(Self::Steering(steering)),
                Err(error) => Err(error),
            }
        } else {
            match Level::new(figure - LEVEL_OFFSET as i16) {
                Ok(level) => Ok(Self::Motor(level)),
                Err(error) => Err(error),
            }
        }
    }
}

/// A figure that no command can carry, or that the board does not accept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum CommandError {
    /// A level of the motor.
    Level {
        /// The given level.
        found: i16,
    },
    /// A value of the steering.
    Steering {
        /// The given value.
        found: i16,
    },
}

impl fmt::Display for CommandError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, found, [least, greatest]) = match *self {
            Self::Level { found } => ("motor level", found, Level::RANGE),
            Self::Steering { found } => ("steering value", found, Steering::RANGE),
        };
        write!(f, "{what} is {found}, expected {least} to {greatest}")
    }
}

impl core::error::Error for CommandError {}
