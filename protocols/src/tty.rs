//! Changes to bytes by the host's terminal driver before a program reads them.
//!
//! A serial port of a Unix host is a terminal. Its input mode flag `ICRNL` (POSIX, General Terminal
//! Interface) turns each carriage return into a newline, which is right for a keyboard and wrong
//! for binary frames. A program that clears some flags and forgets this one reads 13 as 10.

/// Input mode of the driver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InputMode {
    /// Bytes as received: the mode of `cfmakeraw`.
    #[default]
    Raw,
    /// `ICRNL`: 0D is read as 0A.
    CrToNl,
}

impl InputMode {
    /// Bytes that a program reads for `byte`.
    pub const fn read(self, byte: u8) -> u8 {
        match (self, byte) {
            (Self::CrToNl, b'\r') => b'\n',
            _ => byte,
        }
    }

    /// The same for bytes in place.
    pub fn apply(self, bytes: &mut [u8]) {
        for byte in bytes {
            *byte = self.read(*byte);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All 256 bytes: one of them changes, in one of the modes.
    #[test]
    fn only_the_carriage_return_changes() {
        for byte in 0..=u8::MAX {
            assert_eq!(InputMode::Raw.read(byte), byte);
            let expected = if byte == 13 { 10 } else { byte };
            assert_eq!(InputMode::CrToNl.read(byte), expected);
        }
    }
}
