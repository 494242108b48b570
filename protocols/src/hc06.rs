//! AT command set of the HC-06 Bluetooth module.
//!
//! The module takes commands only without a connection over the air. The three firmware families
//! differ in the end of a command and the wording of replies:
//!
//! | family | a command ends | words | replies |
//! |---|---|---|---|
//! | `linvor-1.8` | after about 1 s of silence | [`Command`] | [`Reply`], e.g. `OKlinvorV1.8` |
//! | `hc01-2.0` | after about 1 s of silence | [`Command`] | [`Reply`], e.g. `hc01.comV2.0` |
//! | `3.0-20170609` | at CR LF | [`LineCommand`] | [`LineReply`]: lines, then `OK` |
//!
//! Sources: module guides and forum measurements collected for the HC-06. The rescue robot of
//! 2014/15 carried `linvor`.

mod lines;
mod reply;

use core::fmt;

pub use lines::{LINE_END, LineCommand, LineReply};
pub use reply::{Led, Reply, Role, Texts};

/// Baud rates by their command digit, `1` to `9`, then `A` to `C`.
pub const BAUD_RATES: [u32; 12] = [
    1_200, 2_400, 4_800, 9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600,
    1_382_400,
];
/// Rate of a module as shipped.
pub const BAUD_DEFAULT: u32 = 9_600;
/// Maximum number of characters in a name.
pub const NAME_MAX: usize = 20;

/// Firmware family of a module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Family {
    /// BC417 modules with linvor firmware, the classic.
    #[default]
    Linvor18,
    /// hc01.com 2.0.
    Hc01V20,
    /// 3.0-20170609, with HC-05 style commands.
    V30,
}

impl Family {
    /// All families.
    pub const ALL: [Self; 3] = [Self::Linvor18, Self::Hc01V20, Self::V30];

    /// Name as in a scenario.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linvor18 => "linvor-1.8",
            Self::Hc01V20 => "hc01-2.0",
            Self::V30 => "3.0-20170609",
        }
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Parity as ordered by `AT+PN`, `AT+PO`, `AT+PE`.
pub use crate::line::Parity;

/// A command of the silence-terminated families.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command<'a> {
    /// `AT`: are you there?
    Attention,
    /// `AT+VERSION`.
    Version,
    /// `AT+NAMExyz`, at most 20 characters.
    Name(&'a [u8]),
    /// `AT+PIN1234`, four digits.
    Pin([u8; 4]),
    /// `AT+BAUDn`; the rate in bits per second.
    Baud(u32),
    /// `AT+PN`, `AT+PO`, `AT+PE`.
    Parity(Parity),
    /// `AT+ROLE=S`, `AT+ROLE=M`; hc01.com 2.0 only.
    Role(Role),
    /// `AT+LED0`, `AT+LED1`; hc01.com 2.0 only.
    Led(Led),
}

impl<'a> Command<'a> {
    /// The command with exactly these `bytes`, if any: upper case only, no line end.
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        let rest = bytes.strip_prefix(b"AT")?;
        match rest {
            b"" => return Some(Self::Attention),
            b"+VERSION" => return Some(Self::Version),
            b"+PN" => return Some(Self::Parity(Parity::None)),
            b"+PO" => return Some(Self::Parity(Parity::Odd)),
            b"+PE" => return Some(Self::Parity(Parity::Even)),
            b"+ROLE=S" => return Some(Self::Role(Role::Slave)),
            b"+ROLE=M" => return Some(Self::Role(Role::Master)),
            b"+LED0" => return Some(Self::Led(Led::Off)),
            b"+LED1" => return Some(Self::Led(Led::On)),
            _ => {}
        }
        if let Some(name) = rest.strip_prefix(b"+NAME") {
            (1..=NAME_MAX)
                .contains(&name.len())
                .then_some(Self::Name(name))
        } else if let Some(pin) = rest.strip_prefix(b"+PIN") {
            let pin = <[u8; 4]>::try_from(pin).ok()?;
            pin.iter().all(u8::is_ascii_digit).then_some(Self::Pin(pin))
        } else if let Some([digit]) = rest.strip_prefix(b"+BAUD") {
            baud_of(*digit).map(Self::Baud)
        } else {
            None
        }
    }

    /// Writes the command into the front of `out` and returns its length. `None` if `out` is too
    /// small or an argument is not allowed, such as a name that is too long.
    pub fn encode(self, out: &mut [u8]) -> Option<usize> {
        let len = match self {
            Self::Attention => put(out, &[b"AT"]),
            Self::Version => put(out, &[b"AT+VERSION"]),
            Self::Name(name) => put(out, &[b"AT+NAME", name]),
            Self::Pin(pin) => put(out, &[b"AT+PIN", &pin]),
            Self::Baud(rate) => put(out, &[b"AT+BAUD", &[digit_of(rate)?]]),
            Self::Parity(Parity::None) => put(out, &[b"AT+PN"]),
            Self::Parity(Parity::Odd) => put(out, &[b"AT+PO"]),
            Self::Parity(Parity::Even) => put(out, &[b"AT+PE"]),
            Self::Role(Role::Slave) => put(out, &[b"AT+ROLE=S"]),
            Self::Role(Role::Master) => put(out, &[b"AT+ROLE=M"]),
            Self::Led(Led::Off) => put(out, &[b"AT+LED0"]),
            Self::Led(Led::On) => put(out, &[b"AT+LED1"]),
        }?;
        (Command::parse(&out[..len]) == Some(self)).then_some(len)
    }

    /// Whether modules of `family` know the command.
    pub const fn is_known_to(self, family: Family) -> bool {
        match (family, self) {
            (Family::V30, _) | (Family::Linvor18, Self::Role(_) | Self::Led(_)) => false,
            (Family::Linvor18 | Family::Hc01V20, _) => true,
        }
    }
}

/// The rate of a command digit.
pub fn baud_of(digit: u8) -> Option<u32> {
    let index = match digit {
        b'1'..=b'9' => digit - b'1',
        b'A'..=b'C' => digit - b'A' + 9,
        _ => return None,
    };
    Some(BAUD_RATES[usize::from(index)])
}

/// The command digit of a rate.
pub fn digit_of(rate: u32) -> Option<u8> {
    let index = BAUD_RATES.iter().position(|&known| known == rate)?;
    Some(b"123456789ABC"[index])
}

fn put(out: &mut [u8], parts: &[&[u8]]) -> Option<usize> {
    let mut len = 0;
    for part in parts {
        out.get_mut(len..len + part.len())?.copy_from_slice(part);
        len += part.len();
    }
    Some(len)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `A` is 460800, the setting of the rescue robot's radio.
    #[test]
    fn baud_digits_go_on_with_letters() {
        assert_eq!(Command::parse(b"AT+BAUDA"), Some(Command::Baud(460_800)));
        assert_eq!(Command::parse(b"AT+BAUD4"), Some(Command::Baud(9_600)));
        assert_eq!(Command::parse(b"AT+BAUDD"), None);
        assert_eq!(digit_of(1_382_400), Some(b'C'));
    }

    #[test]
    fn a_family_is_shown_by_its_name() {
        extern crate std;
        let shown = Family::ALL.map(|family| std::format!("{family}"));
        assert_eq!(shown, ["linvor-1.8", "hc01-2.0", "3.0-20170609"]);
    }

    #[test]
    fn a_command_is_exact_or_none() {
        assert_eq!(Command::parse(b"AT"), Some(Command::Attention));
        assert_eq!(Command::parse(b"AT\r\n"), None);
        assert_eq!(Command::parse(b"at+version"), None);
        assert_eq!(Command::parse(b"AT+PIN12345"), None);
        assert_eq!(Command::parse(b"AT+NAME"), None);
        assert_eq!(
            Command::parse(b"AT+NAMErescue"),
            Some(Command::Name(b"rescue"))
        );
    }

    /// Every command of the two older families, as their sheets spell it.
    #[test]
    fn each_command_has_its_words() {
        let cases: [(&[u8], Command<'_>); 12] = [
            (b"AT", Command::Attention),
            (b"AT+VERSION", Command::Version),
            (b"AT+NAMEa b", Command::Name(b"a b")),
            (b"AT+PIN0079", Command::Pin(*b"0079")),
            (b"AT+BAUD1", Command::Baud(1_200)),
            (b"AT+PN", Command::Parity(Parity::None)),
            (b"AT+PO", Command::Parity(Parity::Odd)),
            (b"AT+PE", Command::Parity(Parity::Even)),
            (b"AT+ROLE=S", Command::Role(Role::Slave)),
            (b"AT+ROLE=M", Command::Role(Role::Master)),
            (b"AT+LED0", Command::Led(Led::Off)),
            (b"AT+LED1", Command::Led(Led::On)),
        ];
        for (bytes, command) in cases {
            assert_eq!(Command::parse(bytes), Some(command));
            let mut out = [0; 40];
            let len = command.encode(&mut out).expect("fits");
            assert_eq!(&out[..len], bytes);
            assert_eq!(command.encode(&mut out[..bytes.len() - 1]), None);
        }
    }

    /// Names of 20 characters, PINs of four digits; arguments beyond are not written.
    #[test]
    fn arguments_have_their_limits() {
        assert_eq!(
            Command::parse(b"AT+NAME01234567890123456789"),
            Some(Command::Name(b"01234567890123456789"))
        );
        assert_eq!(Command::parse(b"AT+NAME012345678901234567890"), None);
        assert_eq!(Command::parse(b"AT+PIN123"), None);
        assert_eq!(Command::parse(b"AT+PIN12a4"), None);
        assert_eq!(Command::parse(b"AT+BAUD0"), None);
        assert_eq!(Command::parse(b"AT+BAUD12"), None);
        let mut out = [0; 60];
        assert_eq!(Command::Name(&[b'x'; 21]).encode(&mut out), None);
        assert_eq!(Command::Pin(*b"12a4").encode(&mut out), None);
        assert_eq!(Command::Baud(9_601).encode(&mut out), None);
    }

    /// The digits of the sheets, each with its rate.
    #[test]
    fn each_digit_is_a_rate() {
        let digits = *b"123456789ABC";
        let rates = digits.map(|digit| baud_of(digit).expect("a digit"));
        assert_eq!(rates[..4], [1_200, 2_400, 4_800, 9_600]);
        assert_eq!(rates[4..8], [19_200, 38_400, 57_600, 115_200]);
        assert_eq!(rates[8..], [230_400, 460_800, 921_600, 1_382_400]);
        assert_eq!(rates.map(|rate| digit_of(rate).expect("a rate")), digits);
        assert_eq!([b'0', b':', b'@', b'D', b'a'].map(baud_of), [None; 5]);
    }

    /// Finding T2: names as a scenario spells them.
    #[test]
    fn families_have_names() {
        let names = Family::ALL.map(Family::name);
        assert_eq!(names, ["linvor-1.8", "hc01-2.0", "3.0-20170609"]);
    }

    /// Role and LED exist from 2.0 on; 3.0 supports none of these commands.
    #[test]
    fn commands_are_known_to_their_families() {
        let known = |command: Command<'_>| Family::ALL.map(|family| command.is_known_to(family));
        assert_eq!(known(Command::Attention), [true, true, false]);
        assert_eq!(known(Command::Name(b"x")), [true, true, false]);
        assert_eq!(known(Command::Role(Role::Slave)), [false, true, false]);
        assert_eq!(known(Command::Led(Led::Off)), [false, true, false]);
    }
}
