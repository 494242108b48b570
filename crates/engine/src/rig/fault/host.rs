//! Changes to a byte stream by a host port in text mode.

/// A terminal setting, or a program, that is unsuitable for binary data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum HostDamage {
    /// NUL never arrives.
    StripNul,
    /// CR arrives as LF (`icrnl`).
    CrToLf,
    /// XON and XOFF never arrive (`ixon`).
    EatXonXoff,
    /// The highest bit of each byte is 0 (`istrip`, a line of seven bits).
    ClearBit7,
}

const NUL: u8 = 0x00;
const LF: u8 = 0x0A;
const CR: u8 = 0x0D;
const XON: u8 = 0x11;
const XOFF: u8 = 0x13;

impl HostDamage {
    /// The bytes that arrive for `byte`.
    pub const fn of(self, byte: u8) -> Option<u8> {
        match (self, byte) {
            (Self::StripNul, NUL) | (Self::EatXonXoff, XON | XOFF) => None,
            (Self::CrToLf, CR) => Some(LF),
            (Self::ClearBit7, _) => Some(byte & 0x7F),
            _ => Some(byte),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Codes as in ASCII; the names in brackets are those of stty(1).
    #[test]
    fn each_setting_touches_its_own_bytes_only() {
        let all: Vec<u8> = (0..=255).collect();
        let through = |damage: HostDamage| -> Vec<u8> {
            all.iter().filter_map(|&byte| damage.of(byte)).collect()
        };
        assert_eq!(through(HostDamage::StripNul), all[1..]);
        let eaten: Vec<u8> = (0..=255).filter(|byte| ![17, 19].contains(byte)).collect();
        assert_eq!(through(HostDamage::EatXonXoff), eaten);
        let mut translated = all.clone();
        translated[13] = 10;
        assert_eq!(through(HostDamage::CrToLf), translated);
        let seven: Vec<u8> = (0..=127).chain(0..=127).collect();
        assert_eq!(through(HostDamage::ClearBit7), seven);
    }
}
