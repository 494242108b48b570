//! Requests of the host.

use super::START;
use crate::{Candidate, Format, FrameError};

/// Command bytes. Those from 80 on carry a payload.
pub mod code {
    /// Ends a scan. The sensor takes no request for 1 ms.
    pub const STOP: u8 = 0x25;
    /// Restarts the sensor. It takes no request for 2 ms.
    pub const RESET: u8 = 0x40;
    /// Standard scan, nodes once the rotation is stable.
    pub const SCAN: u8 = 0x20;
    /// Standard scan, nodes whatever the rotation is.
    pub const FORCE_SCAN: u8 = 0x21;
    /// Model, firmware, hardware and serial number.
    pub const INFO: u8 = 0x50;
    /// Status and error code.
    pub const HEALTH: u8 = 0x52;
    /// Time of a sample, standard and express; firmware 1.17 and later.
    pub const SAMPLE_RATE: u8 = 0x59;
    /// Express scan.
    pub const EXPRESS_SCAN: u8 = 0x82;
    /// Configuration of the scan modes; firmware 1.24 and later.
    pub const CONF: u8 = 0x84;
    /// Speed of the motor, rpm; S series.
    pub const MOTOR_SPEED: u8 = 0xA8;
    /// Duty of the motor, 0 to 1023; A2 and A3 on the accessory board.
    pub const MOTOR_PWM: u8 = 0xF0;
    /// Whether there is an accessory board that drives the motor.
    pub const ACC_BOARD: u8 = 0xFF;
}

/// Bit of the command byte that announces a payload.
pub(super) const PAYLOAD: u8 = 0x80;
/// Bytes around a payload.
const OVERHEAD: usize = 4;
/// Most payload bytes: one byte of size.
const PAYLOAD_MAX: usize = 255;
/// The longest request.
pub const REQUEST_MAX: usize = PAYLOAD_MAX + OVERHEAD;

/// Content of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Command {
    /// [`code::STOP`]
    Stop,
    /// [`code::RESET`]
    Reset,
    /// [`code::SCAN`]
    Scan,
    /// [`code::FORCE_SCAN`]
    ForceScan,
    /// [`code::INFO`]
    Info,
    /// [`code::HEALTH`]
    Health,
    /// [`code::SAMPLE_RATE`]
    SampleRate,
    /// [`code::EXPRESS_SCAN`]; the four bytes behind the mode are zero.
    ExpressScan {
        /// Number of the scan mode, 0 for the legacy express scan.
        mode: u8,
    },
    /// [`code::CONF`]
    Conf {
        /// The requested key, see [`ConfKey`](super::ConfKey).
        key: u32,
        /// Number of the scan mode, for keys that are about one.
        mode: Option<u16>,
    },
    /// [`code::MOTOR_SPEED`]
    MotorSpeed {
        /// Turns per minute, 0 stops.
        rpm: u16,
    },
    /// [`code::MOTOR_PWM`]
    MotorPwm {
        /// Duty in 1023rds, 0 stops; the vendor's default is 660.
        pwm: u16,
    },
    /// [`code::ACC_BOARD`]
    AccBoard,
}

impl Command {
    /// The request with this meaning.
    pub fn request(self) -> Request {
        match self {
            Self::Stop => Request::plain(code::STOP),
            Self::Reset => Request::plain(code::RESET),
            Self::Scan => Request::plain(code::SCAN),
            Self::ForceScan => Request::plain(code::FORCE_SCAN),
            Self::Info => Request::plain(code::INFO),
            Self::Health => Request::plain(code::HEALTH),
            Self::SampleRate => Request::plain(code::SAMPLE_RATE),
            Self::ExpressScan { mode } => {
                Request::with_payload(code::EXPRESS_SCAN, &[mode, 0, 0, 0, 0])
            }
            Self::Conf { key, mode } => {
                let mut payload = [0; 6];
                payload[..4].copy_from_slice(&key.to_le_bytes());
                payload[4..].copy_from_slice(&mode.unwrap_or(0).to_le_bytes());
                let len = if mode.is_some() { 6 } else { 4 };
                Request::with_payload(code::CONF, &payload[..len])
            }
            Self::MotorSpeed { rpm } => {
                Request::with_payload(code::MOTOR_SPEED, &rpm.to_le_bytes())
            }
            Self::MotorPwm { pwm } => Request::with_payload(code::MOTOR_PWM, &pwm.to_le_bytes()),
            Self::AccBoard => Request::with_payload(code::ACC_BOARD, &[0; 4]),
        }
    }
}

/// A request whose start and checksum were verified. Keeps every bit.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Request {
    bytes: [u8; REQUEST_MAX],
    len: usize,
}

impl Request {
    /// A request without payload; bit 7 of `code` is cleared.
    pub fn plain(code: u8) -> Self {
        Self::from_bytes(&[START, code & !PAYLOAD])
    }

    /// A request with payload; bit 7 of `code` is set. Bytes behind the 255th do not fit the format
    /// and are left out.
    pub fn with_payload(code: u8, payload: &[u8]) -> Self {
        let payload = &payload[..payload.len().min(PAYLOAD_MAX)];
        let size = u8::try_from(payload.len()).expect("at most 255");
        let mut request = Self::from_bytes(&[START, code | PAYLOAD, size]);
        let end = 3 + payload.len();
        request.bytes[3..end].copy_from_slice(payload);
        request.bytes[end] = checksum(&request.bytes[..end]);
        request.len = end + 1;
        request
    }

    /// The command byte.
    pub const fn code(&self) -> u8 {
        self.bytes[1]
    }

    /// The payload; empty for commands below 80.
    pub fn payload(&self) -> &[u8] {
        match self.bytes[1] & PAYLOAD {
            0 => &[],
            _ => &self.bytes[3..self.len - 1],
        }
    }

    /// Its content; `None` for unknown commands and payloads of the wrong size.
    pub fn command(&self) -> Option<Command> {
        Some(match (self.code(), self.payload()) {
            (code::STOP, _) => Command::Stop,
            (code::RESET, _) => Command::Reset,
            (code::SCAN, _) => Command::Scan,
            (code::FORCE_SCAN, _) => Command::ForceScan,
            (code::INFO, _) => Command::Info,
            (code::HEALTH, _) => Command::Health,
            (code::SAMPLE_RATE, _) => Command::SampleRate,
            (code::EXPRESS_SCAN, &[mode, _, _, _, _]) => Command::ExpressScan { mode },
            (code::CONF, &[a, b, c, d, ref rest @ ..]) => Command::Conf {
                key: u32::from_le_bytes([a, b, c, d]),
                mode: rest.first_chunk().copied().map(u16::from_le_bytes),
            },
            (code::MOTOR_SPEED, &[low, high]) => Command::MotorSpeed {
                rpm: u16::from_le_bytes([low, high]),
            },
            (code::MOTOR_PWM, &[low, high]) => Command::MotorPwm {
                pwm: u16::from_le_bytes([low, high]),
            },
            (code::ACC_BOARD, _) => Command::AccBoard,
            _ => return None,
        })
    }

    /// The request as on the wire.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }

    pub(super) fn from_bytes(bytes: &[u8]) -> Self {
        let mut request = Self {
            bytes: [0; REQUEST_MAX],
            len: bytes.len(),
        };
        request.bytes[..bytes.len()].copy_from_slice(bytes);
        request
    }
}

impl core::fmt::Debug for Request {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "rplidar::Request({:02X?})", self.as_bytes())
    }
}

/// Exclusive or of all bytes before the checksum, start byte included.
fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}

/// The format of requests, for [`crate::Decoder`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Requests;

/// Finds requests in the byte stream. A damaged size swallows up to 255 bytes until its owner
/// reports an idle line; the sensor itself gives a request up after 5 s.
pub type RequestDecoder = crate::Decoder<Requests, REQUEST_MAX>;

impl Format for Requests {
    type Frame = Request;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        match *bytes {
            [START] | [START, PAYLOAD..=u8::MAX] => Candidate::Incomplete,
            [START, command, ..] if command & PAYLOAD == 0 => Candidate::Complete(2),
            [START, _, size, ..] => {
                let end = 3 + usize::from(size);
                let Some(&found) = bytes.get(end) else {
                    return Candidate::Incomplete;
                };
                let expected = checksum(&bytes[..end]);
                if expected == found {
                    return Candidate::Complete(end + 1);
                }
                Candidate::Rejected(FrameError::Checksum {
                    expected: u32::from(expected),
                    found: u32::from(found),
                })
            }
            _ => Candidate::Noise,
        }
    }

    fn frame(&self, bytes: &[u8]) -> Request {
        Request::from_bytes(bytes)
    }
}
