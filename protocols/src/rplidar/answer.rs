//! Answers: a descriptor, and behind it the requested payload.

use super::{ANSWER_START, CAPSULE_LEN, DESCRIPTOR_LEN, NODE_LEN, START, ULTRA_LEN};

/// Most payload bytes of an answer that is no stream. The longest known ones are names of scan
/// modes; the format itself allows 30 bits of length.
pub const PAYLOAD_MAX: usize = 128;
/// The longest answer that is no stream.
pub const ANSWER_MAX: usize = DESCRIPTOR_LEN + PAYLOAD_MAX;

/// Kinds of answers, the last byte of a descriptor.
pub mod kind {
    /// [`Info`](super::Info)
    pub const INFO: u8 = 0x04;
    /// [`Health`](super::Health)
    pub const HEALTH: u8 = 0x06;
    /// [`SampleRate`](super::SampleRate)
    pub const SAMPLE_RATE: u8 = 0x15;
    /// [`Conf`](super::Conf)
    pub const CONF: u8 = 0x20;
    /// Stream of [nodes](crate::rplidar::Node).
    pub const NODES: u8 = 0x81;
    /// Stream of [capsules](crate::rplidar::Capsule).
    pub const CAPSULES: u8 = 0x82;
    /// Stream of [capsules of three samples a cabin](crate::rplidar::UltraCapsule); firmware 1.24
    /// and later.
    pub const ULTRA: u8 = 0x84;
    /// Flags of the accessory board, u32; bit 0: it drives the motor. From the vendor's SDK.
    pub const ACC_BOARD: u8 = 0xFF;
}

/// Whether a payload is sent once or repeatedly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// One payload.
    Single,
    /// Payloads of the same length until another request.
    Stream,
}

/// Announces the answer behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Descriptor([u8; DESCRIPTOR_LEN]);

impl Descriptor {
    /// The descriptor of payloads of `length` bytes, cut to 30 bits.
    pub fn new(kind: u8, length: u32, transfer: Transfer) -> Self {
        let mode = match transfer {
            Transfer::Single => 0,
            Transfer::Stream => 1 << 30,
        };
        let [a, b, c, d] = (length & 0x3FFF_FFFF | mode).to_le_bytes();
        Self([START, ANSWER_START, a, b, c, d, kind])
    }

    /// The descriptor of a standard scan.
    pub fn nodes() -> Self {
        Self::new(kind::NODES, length(NODE_LEN), Transfer::Stream)
    }

    /// The descriptor of an express scan.
    pub fn capsules() -> Self {
        Self::new(kind::CAPSULES, length(CAPSULE_LEN), Transfer::Stream)
    }

    /// The descriptor of a scan of the kind 0x84.
    pub fn ultra() -> Self {
        Self::new(kind::ULTRA, length(ULTRA_LEN), Transfer::Stream)
    }

    /// Converts bytes with a checked start; `None` for the modes 2 and 3, which are not defined.
    pub(super) fn from_started(bytes: [u8; DESCRIPTOR_LEN]) -> Option<Self> {
        (bytes[5] & 0x80 == 0).then_some(Self(bytes))
    }

    /// Type of the following answer, see [`kind`].
    pub const fn kind(self) -> u8 {
        self.0[6]
    }

    /// Bytes of a payload.
    pub const fn length(self) -> u32 {
        self.word() & 0x3FFF_FFFF
    }

    /// Whether the payload repeats.
    pub const fn transfer(self) -> Transfer {
        match self.word() >> 30 {
            0 => Transfer::Single,
            _ => Transfer::Stream,
        }
    }

    /// Minimum and maximum payload length of this kind; `None`: not a known kind.
    pub(super) fn lengths(self) -> Option<[u32; 2]> {
        let least = match (self.transfer(), self.kind()) {
            (Transfer::Single, kind::INFO) => 20,
            (Transfer::Single, kind::HEALTH) => 3,
            (Transfer::Single, kind::SAMPLE_RATE | kind::ACC_BOARD) => 4,
            (Transfer::Single, kind::CONF) => return Some([4, length(PAYLOAD_MAX)]),
            (Transfer::Stream, kind::NODES) => length(NODE_LEN),
            (Transfer::Stream, kind::CAPSULES) => length(CAPSULE_LEN),
            (Transfer::Stream, kind::ULTRA) => length(ULTRA_LEN),
            _ => return None,
        };
        Some([least, least])
    }

    /// The descriptor as on the wire.
    pub const fn as_bytes(&self) -> &[u8; DESCRIPTOR_LEN] {
        &self.0
    }

    const fn word(self) -> u32 {
        let [_, _, a, b, c, d, _] = self.0;
        u32::from_le_bytes([a, b, c, d])
    }
}

/// A length of the format, all of which are small.
fn length(bytes: usize) -> u32 {
    u32::try_from(bytes).expect("lengths of the format are below 256")
}

/// A descriptor and the payload behind it. Only the length protects the payload.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Answer {
    bytes: [u8; ANSWER_MAX],
    len: usize,
}

impl Answer {
    /// The answer of this kind; bytes behind the 128th are left out.
    pub fn new(kind: u8, payload: &[u8]) -> Self {
        let payload = &payload[..payload.len().min(PAYLOAD_MAX)];
        let descriptor = Descriptor::new(kind, length(payload.len()), Transfer::Single);
        let mut bytes = [0; ANSWER_MAX];
        let len = DESCRIPTOR_LEN + payload.len();
        bytes[..DESCRIPTOR_LEN].copy_from_slice(descriptor.as_bytes());
        bytes[DESCRIPTOR_LEN..len].copy_from_slice(payload);
        Self { bytes, len }
    }

    /// Makes it from bytes that were already judged.
    pub(super) fn from_judged(judged: &[u8]) -> Self {
        let mut bytes = [0; ANSWER_MAX];
        bytes[..judged.len()].copy_from_slice(judged);
        let len = judged.len();
        Self { bytes, len }
    }

    /// Type of the answer, see [`kind`].
    pub const fn kind(&self) -> u8 {
        self.bytes[6]
    }

    /// The payload.
    pub fn payload(&self) -> &[u8] {
        &self.bytes[DESCRIPTOR_LEN..self.len]
    }

    /// Its meaning.
    pub fn reply(&self) -> Reply<'_> {
        let payload = self.payload();
        let reply = match self.kind() {
            kind::INFO => Info::parse(payload).map(Reply::Info),
            kind::HEALTH => Health::parse(payload).map(Reply::Health),
            kind::SAMPLE_RATE => SampleRate::parse(payload).map(Reply::SampleRate),
            kind::CONF => Conf::parse(payload).map(Reply::Conf),
            kind::ACC_BOARD => payload
                .first_chunk()
                .map(|flags| Reply::AccBoard(u32::from_le_bytes(*flags))),
            _ => None,
        };
        reply.unwrap_or(Reply::Unknown)
    }

    /// The answer as on the wire.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

impl core::fmt::Debug for Answer {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "rplidar::Answer({:02X?})", self.as_bytes())
    }
}

/// The meaning of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reply<'a> {
    /// Reply to [`Command::Info`](super::Command::Info).
    Info(Info),
    /// Reply to [`Command::Health`](super::Command::Health).
    Health(Health),
    /// Reply to [`Command::SampleRate`](super::Command::SampleRate).
    SampleRate(SampleRate),
    /// Reply to [`Command::Conf`](super::Command::Conf).
    Conf(Conf<'a>),
    /// Reply to [`Command::AccBoard`](super::Command::AccBoard): the board's flags.
    AccBoard(u32),
    /// Of a kind that is not known here.
    Unknown,
}

/// Identity of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Info {
    /// 0x18 for the A1M8.
    pub model: u8,
    /// Firmware as major and minor number.
    pub firmware: (u8, u8),
    /// Revision of the hardware.
    pub hardware: u8,
    /// Serial number, usually shown as hexadecimal digits in this order.
    pub serial: [u8; 16],
}

impl Info {
    /// The answer with this meaning.
    pub fn answer(&self) -> Answer {
        let (major, minor) = self.firmware;
        let mut payload = [0; 20];
        payload[..4].copy_from_slice(&[self.model, minor, major, self.hardware]);
        payload[4..].copy_from_slice(&self.serial);
        Answer::new(kind::INFO, &payload)
    }

    fn parse(payload: &[u8]) -> Option<Self> {
        let [model, minor, major, hardware, ref serial @ ..] = *payload else {
            return None;
        };
        Some(Self {
            model,
            firmware: (major, minor),
            hardware,
            serial: serial.try_into().ok()?,
        })
    }
}

/// Health status of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Status {
    /// Works.
    #[default]
    Good,
    /// Works, and may soon not.
    Warning,
    /// Protection Stop: does not scan until it is reset.
    Error,
    /// Not defined.
    Unknown(u8),
}

/// Status, and why.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Health {
    /// The health status.
    pub status: Status,
    /// Error code; the vendor does not document the figures.
    pub error: u16,
}

impl Health {
    /// The answer with this meaning.
    pub fn answer(self) -> Answer {
        let status = match self.status {
            Status::Good => 0,
            Status::Warning => 1,
            Status::Error => 2,
            Status::Unknown(status) => status,
        };
        let [low, high] = self.error.to_le_bytes();
        Answer::new(kind::HEALTH, &[status, low, high])
    }

    fn parse(payload: &[u8]) -> Option<Self> {
        let &[status, low, high] = payload else {
            return None;
        };
        let status = match status {
            0 => Status::Good,
            1 => Status::Warning,
            2 => Status::Error,
            other => Status::Unknown(other),
        };
        let error = u16::from_le_bytes([low, high]);
        Some(Self { status, error })
    }
}

/// Time of one sample, microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleRate {
    /// Time of a sample in a standard scan.
    pub standard_us: u16,
    /// Time of a sample in an express scan.
    pub express_us: u16,
}

impl SampleRate {
    /// The answer with this meaning.
    pub fn answer(self) -> Answer {
        let mut payload = [0; 4];
        payload[..2].copy_from_slice(&self.standard_us.to_le_bytes());
        payload[2..].copy_from_slice(&self.express_us.to_le_bytes());
        Answer::new(kind::SAMPLE_RATE, &payload)
    }

    fn parse(payload: &[u8]) -> Option<Self> {
        let &[a, b, c, d] = payload else {
            return None;
        };
        Some(Self {
            standard_us: u16::from_le_bytes([a, b]),
            express_us: u16::from_le_bytes([c, d]),
        })
    }
}

/// Keys of [`Command::Conf`](super::Command::Conf).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ConfKey {
    /// Desired speed and duty of the motor.
    DesiredRotation = 0x01,
    /// Number of scan modes, u16.
    ModeCount = 0x70,
    /// Microseconds of a sample in a mode, u32 with 8 fractional bits.
    SampleTime = 0x71,
    /// Greatest distance of a mode in metres, u32 with 8 fractional bits.
    MaxDistance = 0x74,
    /// Kind of the answer of a mode, u8, see [`kind`].
    AnswerKind = 0x75,
    /// The mode that the vendor recommends, u16.
    TypicalMode = 0x7C,
    /// Name of a mode, ended by NUL.
    ModeName = 0x7F,
}

impl ConfKey {
    /// All keys.
    pub const ALL: [Self; 7] = [
        Self::DesiredRotation,
        Self::ModeCount,
        Self::SampleTime,
        Self::MaxDistance,
        Self::AnswerKind,
        Self::TypicalMode,
        Self::ModeName,
    ];

    /// The key with this number.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|&key| key as u32 == number)
    }
}

/// A piece of configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conf<'a> {
    /// Number of the requested key.
    pub key: u32,
    /// The value; empty if the sensor does not know it.
    pub value: &'a [u8],
}

impl<'a> Conf<'a> {
    /// The answer with this meaning; of the value at most 124 bytes.
    pub fn answer(&self) -> Answer {
        let mut payload = [0; PAYLOAD_MAX];
        let len = self.value.len().min(PAYLOAD_MAX - 4);
        payload[..4].copy_from_slice(&self.key.to_le_bytes());
        payload[4..4 + len].copy_from_slice(&self.value[..len]);
        Answer::new(kind::CONF, &payload[..4 + len])
    }

    fn parse(payload: &'a [u8]) -> Option<Self> {
        let (key, value) = payload.split_first_chunk()?;
        let key = u32::from_le_bytes(*key);
        Some(Self { key, value })
    }
}
