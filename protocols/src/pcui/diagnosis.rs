//! The robot's report about itself besides pose and map. The seed report plans it (chapter 6,
//! "remote diagnosis") and gives no format; these messages are the rig's own.
//!
//! | id | direction | payload |
//! |---|---|---|
//! | DIA | robot to PC | battery u16 mV, i8 % (-1: not known), conditions u16, search u8, errors u16 of lidar, base, radio |
//! | VIC | robot to PC | per victim x, y i16 mm |
//! | SEN | robot to PC | ten infrared ranges i16 mm (32767: not read), speed of the lidar u16 rpm |
//! | TXT | robot to PC | number u16 of the newest message to the operator, its text in ASCII |

use super::error::MessageError;
use super::{HEADER_LEN, seal};

/// Bytes of a DIA payload.
pub const DIAGNOSIS_LEN: usize = 12;
/// Bytes of a victim.
const VICTIM_LEN: usize = 4;
/// Infrared sensors of the base.
pub const INFRARED: usize = 10;
/// Bytes of a SEN payload.
pub const SENSORS_LEN: usize = 2 * INFRARED + 2;

/// Conditions that concern the operator, one bit each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// The battery is almost empty: the robot goes home slowly.
    BatteryLow,
    /// The base does not answer.
    BaseSilent,
    /// The lidar sends nothing.
    LidarSilent,
    /// The robot does not know its pose.
    Lost,
    /// The robot or its goal is not on its map.
    OffMap,
    /// The stop button is pressed.
    Stopped,
    /// Full drive does not bring the lidar to its speed.
    LidarWeak,
    /// A driven wheel does not count: it is blocked, or its encoder has failed. The robot rests.
    WheelStalled,
}

impl Condition {
    /// All of them, in the order of their bits.
    pub const ALL: [Self; 8] = [
        Self::BatteryLow,
        Self::BaseSilent,
        Self::LidarSilent,
        Self::Lost,
        Self::OffMap,
        Self::Stopped,
        Self::LidarWeak,
        Self::WheelStalled,
    ];

    /// Text for the operator.
    pub const fn text(self) -> &'static str {
        match self {
            Self::BatteryLow => "battery low",
            Self::BaseSilent => "base silent",
            Self::LidarSilent => "lidar silent",
            Self::Lost => "lost",
            Self::OffMap => "off the map",
            Self::Stopped => "stop button",
            Self::LidarWeak => "lidar motor too weak",
            Self::WheelStalled => "wheel stalled",
        }
    }

    const fn bit(self) -> u16 {
        1 << self as u16
    }
}

/// The conditions that hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Conditions(u16);

impl Conditions {
    /// No condition.
    pub const NONE: Self = Self(0);

    /// Adds `condition`, if it holds.
    #[must_use]
    pub const fn with(self, condition: Condition, holds: bool) -> Self {
        if holds {
            Self(self.0 | condition.bit())
        } else {
            self
        }
    }

    /// Whether `condition` holds.
    pub const fn has(self, condition: Condition) -> bool {
        self.0 & condition.bit() != 0
    }

    /// The conditions that hold.
    pub fn iter(self) -> impl Iterator<Item = Condition> {
        let holds = move |condition: &Condition| self.has(*condition);
        Condition::ALL.into_iter().filter(holds)
    }
}

/// Progress of the search of the maze.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Search {
    /// No search was ordered.
    #[default]
    None,
    /// The robot explores unknown space.
    Seeks,
    /// No reachable space is unknown, or the battery is low: the robot goes home.
    GoesHome,
    /// The robot is home.
    IsHome,
}

impl Search {
    const ALL: [Self; 4] = [Self::None, Self::Seeks, Self::GoesHome, Self::IsHome];

    /// Text for the operator.
    pub const fn text(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Seeks => "seeks",
            Self::GoesHome => "goes home",
            Self::IsHome => "is home",
        }
    }
}

/// The robot's knowledge of its own state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Diagnosis {
    /// Voltage of the battery, mV; 0 if it is not known.
    pub battery_mv: u16,
    /// Its charge; -1 if it is not known.
    pub battery_percent: i8,
    /// Unusual conditions.
    pub conditions: Conditions,
    /// The search.
    pub search: Search,
    /// Number of errors so far, up to 65535, on the links to lidar (packets bad or lost), base
    /// (requests that failed) and PC (frames bad or without meaning).
    pub errors: [u16; 3],
}

/// Writes the DIA frame and returns its length; `None` if `frame` is too small.
pub fn encode_diagnosis(told: &Diagnosis, frame: &mut [u8]) -> Option<usize> {
    let payload = frame.get_mut(HEADER_LEN..HEADER_LEN + DIAGNOSIS_LEN)?;
    payload[..2].copy_from_slice(&told.battery_mv.to_le_bytes());
    payload[2] = told.battery_percent.cast_unsigned();
    payload[3..5].copy_from_slice(&told.conditions.0.to_le_bytes());
    payload[5] = told.search as u8;
    for (bytes, errors) in payload[6..].chunks_exact_mut(2).zip(told.errors) {
        bytes.copy_from_slice(&errors.to_le_bytes());
    }
    seal(frame, *b"DIA", DIAGNOSIS_LEN)
}

/// Reads the payload of a DIA frame; unknown bits and states are left out.
pub(super) fn diagnosis(payload: &[u8; DIAGNOSIS_LEN]) -> Diagnosis {
    let word = |at: usize| u16::from_le_bytes([payload[at], payload[at + 1]]);
    let search = Search::ALL.get(usize::from(payload[5])).copied();
    Diagnosis {
        battery_mv: word(0),
        battery_percent: payload[2].cast_signed(),
        conditions: Conditions(word(3)),
        search: search.unwrap_or_default(),
        errors: [word(6), word(8), word(10)],
    }
}

/// Places of victims, millimetres in the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VictimList<'a>(&'a [[u8; VICTIM_LEN]]);

impl<'a> VictimList<'a> {
    /// The places, in the order in which they were found.
    pub fn iter(self) -> impl Iterator<Item = [i16; 2]> + 'a {
        self.0
            .iter()
            .map(|&[x, x_high, y, y_high]| [[x, x_high], [y, y_high]].map(i16::from_le_bytes))
    }
}

/// Reads the payload of a VIC frame.
pub(super) fn victims(payload: &[u8]) -> Result<VictimList<'_>, MessageError> {
    match payload.as_chunks() {
        (places, []) => Ok(VictimList(places)),
        (places, _) => Err(MessageError::Length {
            expected: VICTIM_LEN * (places.len() + 1),
            found: payload.len(),
        }),
    }
}

/// Writes the VIC frame and returns its length; `None` if `frame` is too small.
pub fn encode_victims(
    places: impl ExactSizeIterator<Item = [i16; 2]>,
    frame: &mut [u8],
) -> Option<usize> {
    let len = VICTIM_LEN * places.len();
    let payload = frame.get_mut(HEADER_LEN..HEADER_LEN + len)?;
    for (bytes, place) in payload.chunks_exact_mut(VICTIM_LEN).zip(places) {
        bytes[..2].copy_from_slice(&place[0].to_le_bytes());
        bytes[2..].copy_from_slice(&place[1].to_le_bytes());
    }
    seal(frame, *b"VIC", len)
}

/// Readings of the sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Readings {
    /// Ranges of the infrared sensors in the order of the base's registers, mm; [`i16::MAX`] if the
    /// program does not read them.
    pub infrared_mm: [i16; INFRARED],
    /// Speed of the lidar, revolutions per minute.
    pub lidar_rpm: u16,
}

impl Readings {
    /// No sensor was read.
    pub const NONE: Self = Self {
        infrared_mm: [i16::MAX; INFRARED],
        lidar_rpm: 0,
    };
}

/// Writes the SEN frame and returns its length; `None` if `frame` is too small.
pub fn encode_readings(readings: &Readings, frame: &mut [u8]) -> Option<usize> {
    let payload = frame.get_mut(HEADER_LEN..HEADER_LEN + SENSORS_LEN)?;
    let (ranges, rpm) = payload.split_at_mut(2 * INFRARED);
    for (bytes, range) in ranges.chunks_exact_mut(2).zip(readings.infrared_mm) {
        bytes.copy_from_slice(&range.to_le_bytes());
    }
    rpm.copy_from_slice(&readings.lidar_rpm.to_le_bytes());
    seal(frame, *b"SEN", SENSORS_LEN)
}

/// Reads the payload of a SEN frame.
pub(super) fn readings(payload: &[u8; SENSORS_LEN]) -> Readings {
    let word = |at: usize| [payload[2 * at], payload[2 * at + 1]];
    Readings {
        infrared_mm: core::array::from_fn(|at| i16::from_le_bytes(word(at))),
        lidar_rpm: u16::from_le_bytes(word(INFRARED)),
    }
}

/// A message to the operator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Text<'a> {
    /// Number of the message since the start; the newest message is repeated.
    pub number: u16,
    /// Its text; ASCII, if the robot is sound.
    pub text: &'a [u8],
}

/// Writes the TXT frame and returns its length; `None` if `frame` is too small.
pub fn encode_text(told: Text<'_>, frame: &mut [u8]) -> Option<usize> {
    let len = 2 + told.text.len();
    let payload = frame.get_mut(HEADER_LEN..HEADER_LEN + len)?;
    payload[..2].copy_from_slice(&told.number.to_le_bytes());
    payload[2..].copy_from_slice(told.text);
    seal(frame, *b"TXT", len)
}

/// Reads the payload of a TXT frame.
pub(super) fn text(payload: &[u8]) -> Result<Text<'_>, MessageError> {
    let (number, text) = payload.split_first_chunk().ok_or(MessageError::Length {
        expected: 2,
        found: payload.len(),
    })?;
    Ok(Text {
        number: u16::from_le_bytes(*number),
        text,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Decode as _;
    use crate::pcui::{Decoder, Message};

    /// 12000 mV is 2EE0 hex; the conditions are bits 0 and 4; the sum of the payload is 2E + E0 +
    /// 51 + 11 + 2 + 7 + 1 + 1 = 17B hex.
    #[test]
    fn a_diagnosis_has_its_bytes() {
        let told = Diagnosis {
            battery_mv: 12_000,
            battery_percent: 81,
            conditions: Conditions::NONE
                .with(Condition::BatteryLow, true)
                .with(Condition::Lost, false)
                .with(Condition::OffMap, true),
            search: Search::GoesHome,
            errors: [7, 256, 1],
        };
        let mut frame = [0xA5; 64];
        let len = encode_diagnosis(&told, &mut frame).expect("fits");
        let golden =
            b"PCUI_MSG\x0C\x00\x7B\x01\x00\x00DIA\xE0\x2E\x51\x11\x00\x02\x07\x00\x00\x01\x01\x00";
        assert_eq!(frame[..len], golden[..]);
        let decoded = Decoder::default().push(golden).next().expect("whole");
        let decoded = decoded.expect("sound");
        assert_eq!(decoded.message(), Ok(Message::Diagnosis(told)));
        let texts: [_; 2] = core::array::from_fn(|at| told.conditions.iter().nth(at));
        assert_eq!(
            texts,
            [Some(Condition::BatteryLow), Some(Condition::OffMap)]
        );
    }

    /// 515 mm is 0203 hex, -2 mm is FFFE, 300 rpm is 012C. A text of one byte has no number.
    #[test]
    fn readings_and_messages_have_their_bytes() {
        let mut frame = [0; 64];
        let mut told = Readings::NONE;
        (told.infrared_mm[0], told.infrared_mm[9]) = (515, -2);
        told.lidar_rpm = 300;
        let len = encode_readings(&told, &mut frame).expect("fits");
        let payload = &frame[HEADER_LEN..len];
        assert_eq!(payload[..4], [0x03, 0x02, 0xFF, 0x7F]);
        assert_eq!(payload[18..], [0xFE, 0xFF, 0x2C, 0x01]);
        let decoded = |frame: &[u8]| Decoder::default().push(frame).find_map(Result::ok);
        let sent = decoded(&frame[..len]).expect("sound");
        assert_eq!(sent.message(), Ok(Message::Sensors(told)));

        let told = Text {
            number: 258,
            text: b"reset",
        };
        let len = encode_text(told, &mut frame).expect("fits");
        assert_eq!(frame[HEADER_LEN..len], *b"\x02\x01reset");
        let sent = decoded(&frame[..len]).expect("sound");
        assert_eq!(sent.message(), Ok(Message::Text(told)));
        let error = MessageError::Length {
            expected: 2,
            found: 1,
        };
        assert_eq!(text(b"1"), Err(error));
        assert_eq!(encode_readings(&Readings::NONE, &mut frame[..38]), None);
        assert_eq!(encode_text(told, &mut frame[..23]), None);
    }

    #[test]
    fn victims_are_places_and_half_a_place_is_none() {
        let mut frame = [0; 64];
        let places = [[258, -1], [3, 4]];
        let len = encode_victims(places.into_iter(), &mut frame).expect("fits");
        assert_eq!(frame[HEADER_LEN..len], [2, 1, 0xFF, 0xFF, 3, 0, 4, 0]);
        let list = victims(&frame[HEADER_LEN..len]).expect("sound");
        assert!(list.iter().eq(places));
        let error = MessageError::Length {
            expected: 8,
            found: 6,
        };
        assert_eq!(victims(&frame[..6]), Err(error));
        assert_eq!(encode_victims(places.into_iter(), &mut frame[..24]), None);
    }

    /// A condition set twice still holds; there are eight, one bit each from the lowest.
    #[test]
    fn conditions_are_bits_from_the_lowest() {
        let all = Condition::ALL;
        let with = |conditions: Conditions, condition| conditions.with(condition, true);
        let twice = all.into_iter().chain(all).fold(Conditions::NONE, with);
        assert_eq!(twice, Conditions(0b1111_1111));
        assert!(twice.iter().eq(all));
        let bits = all.map(|condition| Conditions::NONE.with(condition, true).0);
        assert_eq!(bits, [1, 2, 4, 8, 16, 32, 64, 128]);
    }

    #[test]
    fn states_and_conditions_are_said_in_words() {
        let states = Search::ALL.map(Search::text);
        assert_eq!(states, ["none", "seeks", "goes home", "is home"]);
        let conditions = Condition::ALL.map(Condition::text);
        assert_eq!(
            conditions[..3],
            ["battery low", "base silent", "lidar silent"]
        );
        assert_eq!(conditions[3..5], ["lost", "off the map"]);
        assert_eq!(conditions[5..7], ["stop button", "lidar motor too weak"]);
        assert_eq!(conditions[7..], ["wheel stalled"]);
    }

    /// An unknown state of the search, perhaps of a later robot, is read as no search.
    #[test]
    fn what_is_not_known_is_left_out() {
        let told = diagnosis(&[0, 0, 0xFF, 0, 0x80, 9, 0, 0, 0, 0, 0, 0]);
        assert_eq!((told.search, told.battery_percent), (Search::None, -1));
        assert_eq!(told.conditions.iter().count(), 0);
    }
}
