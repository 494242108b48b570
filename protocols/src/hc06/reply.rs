//! Replies of the families whose commands end by silence: texts without a line end.
//!
//! The wording differs between firmware builds and even between reports about one build, so it is
//! data ([`Texts`]) and not code.

use super::{Family, Parity, put};

/// Role of a module on the air.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Role {
    /// Waits to be connected; all that an HC-06 as sold can do.
    #[default]
    Slave,
    /// Connects on its own.
    Master,
}

/// Whether the status LED may light up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Led {
    /// Always dark.
    Off,
    /// Shows the state of the connection.
    #[default]
    On,
}

/// Wording of a firmware's replies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Texts {
    /// All of the reply to `AT+VERSION`; for the line-terminated family the version alone.
    pub version: &'static str,
    /// The reply to a new name.
    pub name_set: &'static str,
    /// The reply to a new PIN; some builds say `OKsetpin`.
    pub pin_set: &'static str,
    /// The replies to no, even and odd parity; other reports have `OK NONE`, `OK EVEN`, `OK ODD`.
    pub parity: [&'static str; 3],
}

impl Texts {
    /// linvor 1.8; 1.5 and 1.6 differ in the number only.
    pub const LINVOR: Self = Self {
        version: "OKlinvorV1.8",
        name_set: "OKsetname",
        pin_set: "OKsetPIN",
        parity: ["OK None", "OK Even", "OK Odd"],
    };
    /// hc01.com 2.0; other modules with the same version say `OKname`.
    pub const HC01: Self = Self {
        version: "hc01.comV2.0",
        name_set: "OKsetname",
        pin_set: "OKsetPIN",
        parity: ["OK NONE", "OK EVEN", "OK ODD"],
    };
    /// 3.0-20170609, of which only the version is used.
    pub const V30: Self = Self {
        version: "3.0-20170609",
        ..Self::HC01
    };

    /// The usual wording of a family.
    pub const fn of(family: Family) -> Self {
        match family {
            Family::Linvor18 => Self::LINVOR,
            Family::Hc01V20 => Self::HC01,
            Family::V30 => Self::V30,
        }
    }
}

/// A reply of a silence-terminated family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reply {
    /// `OK`: I am there.
    Attention,
    /// The firmware's version.
    Version,
    /// The name was taken.
    NameSet,
    /// The PIN was taken.
    PinSet,
    /// `OK9600`: this is the new rate.
    Baud(u32),
    /// The new parity.
    Parity(Parity),
    /// `OK+ROLE:S`: this is the new role.
    Role(Role),
    /// `LED OFF`, `LED ON`: wording of the maker's command sheet, not confirmed by bytes.
    Led(Led),
}

impl Reply {
    /// Writes the reply into the front of `out`; its length, or `None` if `out` is too small.
    pub fn encode(self, texts: &Texts, out: &mut [u8]) -> Option<usize> {
        let text = match self {
            Self::Attention => "OK",
            Self::Version => texts.version,
            Self::NameSet => texts.name_set,
            Self::PinSet => texts.pin_set,
            Self::Baud(rate) => {
                let mut digits = [0; DIGITS_MAX];
                return put(out, &[b"OK", decimal(rate, &mut digits)]);
            }
            Self::Parity(Parity::None) => texts.parity[0],
            Self::Parity(Parity::Even) => texts.parity[1],
            Self::Parity(Parity::Odd) => texts.parity[2],
            Self::Role(Role::Slave) => "OK+ROLE:S",
            Self::Role(Role::Master) => "OK+ROLE:M",
            Self::Led(Led::Off) => "LED OFF",
            Self::Led(Led::On) => "LED ON",
        };
        put(out, &[text.as_bytes()])
    }
}

/// Decimal digits of the largest rate there could be.
pub(super) const DIGITS_MAX: usize = 10;

/// Writes `number` to the end of `digits` and returns the part that was written.
pub(super) fn decimal(mut number: u32, digits: &mut [u8; DIGITS_MAX]) -> &[u8] {
    let mut start = DIGITS_MAX;
    loop {
        start -= 1;
        digits[start] = b"0123456789"[(number % 10) as usize];
        number /= 10;
        if number == 0 {
            return &digits[start..];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_replies(replies: &[Reply], texts: &Texts, expected: &str) {
        let mut out = [0xA5; 64];
        let len = replies.iter().fold(0, |len, reply| {
            len + reply.encode(texts, &mut out[len..]).expect("fits")
        });
        assert_eq!(str::from_utf8(&out[..len]), Ok(expected));
    }

    /// The transcript of a public configuration tool: five replies without any separator.
    #[test]
    fn replies_run_together_as_in_the_public_transcript() {
        let texts = Texts {
            version: "OKlinvorV1.5",
            ..Texts::LINVOR
        };
        let replies = [
            Reply::Attention,
            Reply::Version,
            Reply::PinSet,
            Reply::NameSet,
            Reply::Baud(57_600),
        ];
        assert_replies(&replies, &texts, "OKOKlinvorV1.5OKsetPINOKsetnameOK57600");
    }

    /// The 2.0 firmware names itself without an OK in front.
    #[test]
    fn the_2_0_firmware_states_its_version_without_ok() {
        assert_replies(&[Reply::Version], &Texts::HC01, "hc01.comV2.0");
        assert_replies(&[Reply::Role(Role::Slave)], &Texts::HC01, "OK+ROLE:S");
    }

    #[test]
    fn a_reply_that_does_not_fit_is_not_cut() {
        let reply = Reply::Baud(1_382_400);
        assert_eq!(reply.encode(&Texts::LINVOR, &mut [0; 8]), None);
        assert_replies(&[reply], &Texts::LINVOR, "OK1382400");
    }

    #[test]
    fn decimal_covers_both_ends_of_the_range() {
        assert_eq!(decimal(0, &mut [0; DIGITS_MAX]), b"0");
        assert_eq!(decimal(u32::MAX, &mut [0; DIGITS_MAX]), b"4294967295");
    }

    /// Words of the sheets, family by family.
    #[test]
    fn each_reply_has_its_words() {
        let parities = [Parity::None, Parity::Even, Parity::Odd].map(Reply::Parity);
        assert_replies(&parities, &Texts::LINVOR, "OK NoneOK EvenOK Odd");
        assert_replies(&parities, &Texts::HC01, "OK NONEOK EVENOK ODD");
        let rest = [Led::Off, Led::On].map(Reply::Led);
        assert_replies(&rest, &Texts::HC01, "LED OFFLED ON");
        assert_replies(&[Reply::Role(Role::Master)], &Texts::HC01, "OK+ROLE:M");
        let versions = Family::ALL.map(|family| Texts::of(family).version);
        assert_eq!(versions, ["OKlinvorV1.8", "hc01.comV2.0", "3.0-20170609"]);
    }
}
