//! Firmware versions: their requests and their answers.

use core::time::Duration;

use protocols::rplidar::{ConfKey, Info, SampleRate, kind};

/// A firmware version, named as scenarios name it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Profile {
    /// 1.20: without configuration requests. About the version in the robot yellow.
    #[default]
    Fw120,
    /// 1.24, hardware 5: knows configuration requests.
    Fw124,
    /// 1.29, hardware 7: the quality is 47 or 0.
    Fw129,
}

/// A scan mode.
#[derive(Clone, Copy, Debug)]
struct ScanMode {
    name: &'static str,
    sample_us: u32,
    answer_kind: u8,
}

const fn mode(name: &'static str, sample_us: u32, answer_kind: u8) -> ScanMode {
    ScanMode {
        name,
        sample_us,
        answer_kind,
    }
}

/// Modes of firmware 1.24, as drivers list them: 2.0, 4.0 and 8.0 thousand samples a second.
/// Firmware 1.20 has the first two and no request that lists them.
const MODES_124: [ScanMode; 3] = [
    mode("Standard", 500, kind::NODES),
    mode("Express", 250, kind::CAPSULES),
    mode("Boost", 125, kind::ULTRA),
];
/// Modes of firmware 1.29, as an A1M8 with hardware 7 reports them (published by a user who queried
/// each key of each mode).
const MODES_129: [ScanMode; 5] = [
    mode("Standard", 508, kind::NODES),
    mode("Express", 254, kind::CAPSULES),
    mode("Boost", 127, kind::ULTRA),
    mode("Sensitivity", 127, kind::ULTRA),
    mode("Stability", 201, kind::ULTRA),
];
/// Speed and duty in conf 01: LD108's typical 5.5 turns a second, the SDK's usual duty.
const DESIRED_ROTATION: [u16; 2] = [330, 660];

impl Profile {
    /// Every profile.
    pub const ALL: [Self; 3] = [Self::Fw120, Self::Fw124, Self::Fw129];

    /// The profile with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|profile| profile.name() == name)
    }

    /// Stable name, as in scenario files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fw120 => "fw1.20",
            Self::Fw124 => "fw1.24",
            Self::Fw129 => "fw1.29",
        }
    }

    /// Its identity. The serial number is that of a real sensor with firmware 1.29.
    pub const fn info(self) -> Info {
        let (minor, hardware) = match self {
            Self::Fw120 => (20, 0),
            Self::Fw124 => (24, 5),
            Self::Fw129 => (29, 7),
        };
        Info {
            model: 0x18,
            firmware: (1, minor),
            hardware,
            serial: [
                0xEB, 0xB3, 0x99, 0xF6, 0xC9, 0xE5, 0x9A, 0xD2, 0xC5, 0xE5, 0x9C, 0xF7, 0x17, 0x61,
                0x34, 0x12,
            ],
        }
    }

    /// Printed after a reset and on power-up, as users of each firmware show it.
    pub const fn start_text(self) -> &'static str {
        match self {
            Self::Fw120 => "RP LIDAR System.\r\nFirmware Ver 1.20 - rtm, HW Ver 0\r\nModel: 18\r\n",
            Self::Fw124 => "RP LIDAR System.\r\nFirmware Ver 1.24 - rc0, HW Ver 5\r\nModel: 18\r\n",
            Self::Fw129 => "RP LIDAR System.\r\nFirmware Ver 1.29 - rtm, HW Ver 7\r\nModel: 18\r\n",
        }
    }

    /// Greatest distance, millimetres: 6 m by LD108, 12 m in later firmware.
    pub const fn range_max_mm(self) -> f64 {
        match self {
            Self::Fw120 => 6_000.0,
            Self::Fw124 | Self::Fw129 => 12_000.0,
        }
    }

    /// Quality of a valid node that has `light` times the minimum light; an invalid one has 0. Old
    /// firmware reports 10 to 31, as in turns that users published. Its relation to the light is a
    /// guess.
    pub fn quality(self, light: f64) -> u8 {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "10 to 31, and a cast saturates"
        )]
        match self {
            Self::Fw120 => (31.5 - 21.0 / libm::sqrt(light.max(1.0))) as u8,
            Self::Fw124 => 15,
            Self::Fw129 => 47,
        }
    }

    /// Answer to the sample rate request.
    pub fn sample_rate(self) -> SampleRate {
        let told = |mode: usize| u16::try_from(self.modes()[mode].sample_us).unwrap_or(u16::MAX);
        SampleRate {
            standard_us: told(0),
            express_us: told(1),
        }
    }

    /// Time from one sample to the next in a scan of this mode. Samples of 1.20 and 1.24 come a
    /// little sooner than reported: 2,005 a second; LD108 has 2,000 to 2,010.
    pub(super) fn sample_time(self, mode: u8) -> Duration {
        let mode = self.modes().get(usize::from(mode));
        let told = Duration::from_micros(mode.map_or(500, |mode| mode.sample_us).into());
        match self {
            Self::Fw129 => told,
            Self::Fw120 | Self::Fw124 => told * 498_753 / 500_000,
        }
    }

    /// The scan modes, in the order of their numbers.
    const fn modes(self) -> &'static [ScanMode] {
        match self {
            Self::Fw120 | Self::Fw124 => &MODES_124,
            Self::Fw129 => &MODES_129,
        }
    }

    /// The recommended mode: known for 1.29 (Sensitivity), a guess for 1.24.
    const fn typical_mode(self) -> u16 {
        match self {
            Self::Fw120 | Self::Fw124 => 1,
            Self::Fw129 => 3,
        }
    }

    /// Whether the firmware knows configuration requests.
    pub const fn has_conf(self) -> bool {
        !matches!(self, Self::Fw120)
    }

    /// The mode that an express scan of this number is streamed in, and the kind of its answer.
    /// Number 0 is the legacy express scan, which is mode 1.
    pub(super) fn express(self, number: u8) -> Option<(u8, u8)> {
        let is_known = number == 0 || self.has_conf();
        let number = number.max(1);
        let mode = self.modes().get(usize::from(number)).filter(|_| is_known)?;
        Some((number, mode.answer_kind))
    }

    /// The value of a configuration key; empty for unknown keys and modes. `last` is a mode beyond
    /// the last one; the sensor reports it with the values of the last one.
    pub(super) fn conf(self, key: u32, mode: Option<u16>, last: Option<u16>) -> Vec<u8> {
        let modes = self.modes();
        let known = modes.get(usize::from(mode.unwrap_or(0)));
        let mode = known.or(modes.last().filter(|_| mode.is_some() && mode == last));
        let of_mode = |value: fn(&ScanMode) -> Vec<u8>| mode.map(value).unwrap_or_default();
        let q8 = |value: u32| (value << 8).to_le_bytes().to_vec();
        match ConfKey::from_number(key) {
            Some(ConfKey::DesiredRotation) => DESIRED_ROTATION
                .map(u16::to_le_bytes)
                .as_flattened()
                .to_vec(),
            Some(ConfKey::ModeCount) => {
                let count = u16::try_from(modes.len()).expect("3 or 5");
                count.to_le_bytes().to_vec()
            }
            Some(ConfKey::SampleTime) => {
                of_mode(|mode| (mode.sample_us << 8).to_le_bytes().to_vec())
            }
            Some(ConfKey::MaxDistance) if mode.is_some() => q8(12),
            Some(ConfKey::AnswerKind) => of_mode(|mode| vec![mode.answer_kind]),
            Some(ConfKey::TypicalMode) => {
                let mode = last.unwrap_or(self.typical_mode());
                mode.to_le_bytes().to_vec()
            }
            Some(ConfKey::ModeName) => of_mode(|mode| [mode.name.as_bytes(), &[0]].concat()),
            Some(ConfKey::MaxDistance) | None => Vec::new(),
        }
    }
}
