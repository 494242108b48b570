//! Line settings of a terminal's client: differences from a raw line, and the bytes that they
//! change.

use super::terminal::{Code, Settings};

/// Modes of `termios` as Linux numbers them on most processors.
const IGNCR: u32 = 0o200;
const INLCR: u32 = 0o100;
const ICRNL: u32 = 0o400;
const ISTRIP: u32 = 0o40;
const IXON: u32 = 0o2000;
const CSIZE: u32 = 0o60;
const CS8: u32 = 0o60;
const PARENB: u32 = 0o400;
const OPOST: u32 = 0o1;
const ONLCR: u32 = 0o4;
const OCRNL: u32 = 0o10;
const ISIG: u32 = 0o1;
const ICANON: u32 = 0o2;
const ECHO: u32 = 0o10;

/// A setting that changes bytes, holds them back, or lets a read end without any.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Setting {
    /// A read ends only at the end of a line.
    Canonical,
    /// Bytes of the device are sent back to it.
    Echo,
    /// XON and XOFF of the device start and stop the client's output.
    XonXoff,
    /// The highest bit of received bytes is lost.
    Strip,
    /// Characters have fewer than eight bits, in both directions.
    FewBits,
    /// Characters have a parity bit, which a port without bits cannot check.
    Parity,
    /// CR is read as LF.
    CrToLf,
    /// LF is read as CR.
    LfToCr,
    /// CR is not read.
    IgnoreCr,
    /// Control characters of the device act as signals.
    Signals,
    /// LF is sent as CR LF.
    LfToCrLf,
    /// CR is sent as LF.
    CrSentAsLf,
    /// A read may end without a byte: VMIN is 0.
    MayReadNothing,
}

impl Setting {
    /// All settings.
    pub const ALL: [Self; 13] = [
        Self::Canonical,
        Self::Echo,
        Self::XonXoff,
        Self::Strip,
        Self::FewBits,
        Self::Parity,
        Self::CrToLf,
        Self::LfToCr,
        Self::IgnoreCr,
        Self::Signals,
        Self::LfToCrLf,
        Self::CrSentAsLf,
        Self::MayReadNothing,
    ];

    /// Its name in `termios`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Canonical => "ICANON",
            Self::Echo => "ECHO",
            Self::XonXoff => "IXON",
            Self::Strip => "ISTRIP",
            Self::FewBits => "CSIZE (not CS8)",
            Self::Parity => "PARENB",
            Self::CrToLf => "ICRNL",
            Self::LfToCr => "INLCR",
            Self::IgnoreCr => "IGNCR",
            Self::Signals => "ISIG",
            Self::LfToCrLf => "OPOST with ONLCR",
            Self::CrSentAsLf => "OPOST with OCRNL",
            Self::MayReadNothing => "VMIN 0",
        }
    }

    const fn is_in(self, settings: &Settings) -> bool {
        let Settings {
            input,
            output,
            control,
            local,
            ..
        } = *settings;
        match self {
            Self::Canonical => local & ICANON != 0,
            Self::Echo => local & ECHO != 0,
            Self::XonXoff => input & IXON != 0,
            Self::Strip => input & ISTRIP != 0,
            Self::FewBits => control & CSIZE != CS8,
            Self::Parity => control & PARENB != 0,
            Self::CrToLf => input & ICRNL != 0 && input & IGNCR == 0,
            Self::LfToCr => input & INLCR != 0,
            Self::IgnoreCr => input & IGNCR != 0,
            Self::Signals => local & ISIG != 0,
            Self::LfToCrLf => output & OPOST != 0 && output & ONLCR != 0,
            Self::CrSentAsLf => output & OPOST != 0 && output & OCRNL != 0,
            Self::MayReadNothing => local & ICANON == 0 && settings.code(Code::Least) == 0,
        }
    }
}

/// Settings of a client; by default those of a raw line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Modes(u16);

impl Modes {
    /// The settings of a terminal.
    pub(crate) fn of(settings: &Settings) -> Self {
        let bits = Setting::ALL.into_iter().enumerate();
        let set = bits.filter(|(_, setting)| setting.is_in(settings));
        Self(set.fold(0, |all, (bit, _)| all | 1 << bit))
    }

    /// Whether `setting` is on.
    pub fn has(self, setting: Setting) -> bool {
        self.all().any(|on| on == setting)
    }

    /// All settings that are on.
    pub fn all(self) -> impl Iterator<Item = Setting> {
        let bits = Setting::ALL.into_iter().enumerate();
        bits.filter_map(move |(bit, setting)| (self.0 >> bit & 1 == 1).then_some(setting))
    }

    /// Settings that are on in at least one of both.
    #[must_use]
    pub const fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// Counts of the bytes of one direction that settings may change or hold back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Special {
    /// All of them.
    pub all: u64,
    /// CR, 0x0D.
    pub cr: u64,
    /// LF, 0x0A.
    pub lf: u64,
    /// XON and XOFF, 0x11 and 0x13.
    pub flow: u64,
    /// Ctrl-C, Ctrl-\ and Ctrl-Z: 0x03, 0x1C and 0x1A.
    pub signals: u64,
    /// Bytes with the highest bit set.
    pub high: u64,
    /// Bytes, of both directions, that lost bits because the client's characters have fewer than
    /// eight.
    pub cut: u64,
}

impl Special {
    /// Adds `bytes` to the counts.
    pub fn count(&mut self, bytes: &[u8]) {
        self.all += bytes.len() as u64;
        for &byte in bytes {
            match byte {
                b'\r' => self.cr += 1,
                b'\n' => self.lf += 1,
                0x11 | 0x13 => self.flow += 1,
                0x03 | 0x1A | 0x1C => self.signals += 1,
                0x80.. => self.high += 1,
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rustix::pty::{OpenptFlags, openpt};
    use rustix::termios::{SpecialCodeIndex, Termios, tcgetattr};

    use super::*;

    /// A new terminal has the settings for a shell, which differ from a raw one in all of these.
    #[test]
    fn a_terminal_as_the_system_makes_it_is_told_from_a_raw_one() {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("Linux has some");
        let mut termios = tcgetattr(&master).expect("a terminal");
        let of = |termios: &Termios| Modes::of(&Settings::of_kernel(termios));
        let found: Vec<Setting> = of(&termios).all().collect();
        let expected = [
            Setting::Canonical,
            Setting::Echo,
            Setting::XonXoff,
            Setting::CrToLf,
            Setting::Signals,
            Setting::LfToCrLf,
        ];
        assert_eq!(found, expected);
        termios.make_raw();
        assert_eq!(of(&termios), Modes::default());
        termios.special_codes[SpecialCodeIndex::VMIN] = 0;
        assert!(of(&termios).has(Setting::MayReadNothing));
    }

    #[test]
    fn bytes_that_settings_change_are_counted() {
        let mut special = Special::default();
        special.count(b"ab\r\n\r\x11\x03\x80\xFF");
        let expected = Special {
            all: 9,
            cut: 0,
            cr: 2,
            lf: 1,
            flow: 1,
            signals: 1,
            high: 2,
        };
        assert_eq!(special, expected);
    }
}
