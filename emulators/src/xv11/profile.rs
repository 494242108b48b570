//! Firmware generations: their texts and their packets.

use core::time::Duration;

/// A firmware generation, named as scenarios name it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Profile {
    /// Pre-production units of 3.3 V: whole turns of 1446 bytes without a checksum.
    Fw21,
    /// V2.4.13386: the generation of the "hand in box" capture. It is the only one whose states are
    /// all known from real bytes.
    #[default]
    Fw24,
    /// V2.6.15295: the unit of the seed project. Packets as 2.4; its behaviour at low speed was
    /// never captured and is taken from 2.4.
    Fw26,
}

impl Profile {
    /// Every profile.
    pub const ALL: [Self; 3] = [Self::Fw21, Self::Fw24, Self::Fw26];

    /// The profile with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|profile| profile.name() == name)
    }

    /// Stable name, as in scenario files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fw21 => "fw2.1",
            Self::Fw24 => "fw2.4.13386",
            Self::Fw26 => "fw2.6.15295",
        }
    }

    /// Text at power-on and after a restart, prompt included. The text of 2.4 ends the "hand in
    /// box" capture; line ends are LF CR. Of 2.1 only the three versions are known: its serial and
    /// calibration lines are made up in the form of the other two.
    pub const fn banner(self) -> &'static str {
        match self {
            Self::Fw21 => concat!(
                "OK\n\rPiccolo Laser Distance Scanner\n\r",
                "Copyright (c) 2009-2010 Neato Robotics, Inc.\n\rAll Rights Reserved\n\r\n\r",
                "Loader\tV2.1.11383\n\rCPU\tF2802x/cd00\n\rSerial\tAAA00010AA-0000001\n\r",
                "LastCal\t[2010010100]\n\rRuntime\tV2.1.12813\n\r#",
            ),
            Self::Fw24 => concat!(
                "OK\n\rPiccolo Laser Distance Scanner\n\r",
                "Copyright (c) 2009-2010 Neato Robotics, Inc.\n\rAll Rights Reserved\n\r\n\r",
                "Loader\tV2.4.13386\n\rCPU\tF2802x/c600\n\rSerial\tAAA42410AA-0004165\n\r",
                "LastCal\t[2010140429]\n\rRuntime\tV2.4.13386\n\r#",
            ),
            Self::Fw26 => concat!(
                ":)\n\rPiccolo Laser Distance Scanner\n\r",
                "Copyright (c) 2009-2011 Neato Robotics, Inc.\n\rAll Rights Reserved\n\r\n\r",
                "Loader\tV2.5.15295\n\rCPU\tF2802x/c001\n\rSerial\tKSH42612AA-0070252\n\r",
                "LastCal\t[5371726C]\n\rRuntime\tV2.6.15295\n\r#",
            ),
        }
    }

    /// Text while the device waits for its head to turn. Dots follow one by one.
    pub const fn spin_text(self) -> &'static str {
        match self {
            Self::Fw21 | Self::Fw24 => "Spin...press ESC 3 times to abort",
            Self::Fw26 => "Spin...3 ESCs or BREAK to abort",
        }
    }

    /// Whether the first slot of every turn is skipped: in 21 of 21 turns of the 2.1 capture, and
    /// in none of 2.4.
    pub(super) const fn skips_mark(self) -> bool {
        matches!(self, Self::Fw21)
    }

    /// Whether a turn is one frame without checksum (2.1) instead of 90 packets.
    pub(super) const fn whole_turns(self) -> bool {
        matches!(self, Self::Fw21)
    }
}

/// Power-on or restart to the first character of the banner. A guess.
pub(super) const BOOT_TIME: Duration = Duration::from_millis(50);
/// Prompt to the spin text. A guess.
pub(super) const PROMPT_TIME: Duration = Duration::from_millis(100);
/// Time between the dots behind the spin text. A guess: unit reports show one to three dots before
/// a restart cut them off ("abort.OK", "abort...OK").
pub(super) const DOT_TIME: Duration = Duration::from_millis(500);
/// Dots behind the spin text.
pub(super) const DOTS: u8 = 3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_profile_is_found_by_its_name() {
        assert_eq!(Profile::from_name("fw2.1"), Some(Profile::Fw21));
        assert_eq!(Profile::from_name("fw2.4.13386"), Some(Profile::Fw24));
        assert_eq!(Profile::from_name("fw2.6.15295"), Some(Profile::Fw26));
        assert_eq!(Profile::from_name("fw2.4"), None);
    }

    /// The boot text of the "hand in box" capture is its last 211 bytes (offset 251,935 of
    /// 252,146).
    #[test]
    fn the_banner_of_2_4_is_as_long_as_the_captured_one() {
        assert_eq!(Profile::Fw24.banner().len(), 252_146 - 251_935);
        assert!(Profile::ALL.iter().all(|p| p.banner().ends_with("\n\r#")));
    }

    /// Wrong resynchronisation on text would show as packets: no text may hold a start byte.
    #[test]
    fn no_text_holds_a_start_byte() {
        for profile in Profile::ALL {
            assert!(profile.banner().is_ascii() && profile.spin_text().is_ascii());
        }
    }
}
