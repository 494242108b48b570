//! Payloads of frames between robot and PC: messages of protocol buffers, version 2.
//!
//! ```text
//! Telemetry    robot -> PC   each 200 ms: time, state, odometry, IR; scan or lines if asked for
//! Telecommand  PC -> robot   state, speeds, poses, requests
//! ```
//!
//! Unknown fields are skipped, missing ones keep their defaults. Numbers of fields and values:
//! published code of the robot yellow, `.proto` files; the schema is the rig's own. The robot's
//! buffer bounds a message: see [`PAYLOAD_MAX`](super::PAYLOAD_MAX).

mod fields;
mod telecommand;
#[cfg(test)]
mod tests;

use core::convert::Infallible;
use core::fmt;

use heapless::Vec;
use micropb::{DecodeError, MessageDecode, PbDecoder, PbEncoder, PbRead, PbWrite};

use fields::{FieldWriter, Fields, read_fields};
pub use telecommand::{LinesRequest, Reactive, Telecommand, Velocities};

/// Maximum number of points of a scan: one a degree.
pub const POINTS_MAX: usize = 360;
/// Maximum number of lines in a message of the robot.
pub const LINES_MAX: usize = 20;
/// Maximum number of IR sensors in a message.
pub const INFRARED_MAX: usize = 6;
/// Maximum number of values of a covariance.
const COVARIANCE_MAX: usize = 9;

/// State of the robot, or the ordered one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// Motors off. The robot also reports it while the drivers are switched on or off, and while
    /// they are on without an order.
    #[default]
    Off = 1,
    /// Speeds of the PC.
    Manual = 2,
    /// Drives by its IR sensors.
    AutoReactive = 3,
    /// Drives to the desired pose.
    AutoPosition = 4,
}

impl State {
    /// All states, by their numbers.
    pub const ALL: [Self; 4] = [
        Self::Off,
        Self::Manual,
        Self::AutoReactive,
        Self::AutoPosition,
    ];

    /// The state of that number.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|state| *state as u32 == number)
    }

    /// Name as in messages to people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Manual => "manual",
            Self::AutoReactive => "auto-reactive",
            Self::AutoPosition => "auto-position",
        }
    }
}

/// A pose, or an end of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Along x: metres of a pose, millimetres of a line's end.
    pub x: f32,
    /// Along y, likewise.
    pub y: f32,
    /// Heading, radians counter-clockwise from x. `123456` of a desired pose: any.
    pub alpha: f32,
}

/// Heading of a desired pose that means: any.
pub const ANY_HEADING: f32 = 123_456.0;

/// Estimated pose of the robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Odometry {
    /// Metres and radians.
    pub pose: Pose,
    /// Row by row; the fielded robot leaves it empty.
    pub covariance: Vec<f32, COVARIANCE_MAX>,
}

/// A reading of the lidar.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LidarPoint {
    /// Degrees, counter-clockwise from ahead.
    pub angle_deg: i32,
    /// Millimetres; 10,000 without a measurement.
    pub distance_mm: i32,
    /// Quality from the lidar.
    pub quality: i32,
}

/// A scan, thinned out as requested.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lidar {
    /// Milliseconds since the robot's start.
    pub timestamp_ms: u32,
    /// In the order of their angles.
    pub points: Vec<LidarPoint, POINTS_MAX>,
}

/// A straight piece of wall in the robot's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Line {
    /// Its start, millimetres.
    pub start: Pose,
    /// Its end, millimetres.
    pub end: Pose,
}

/// Readings of the IR sensors.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Infrared {
    /// Milliseconds since the robot's start, if reported.
    pub timestamp_ms: Option<u32>,
    /// Metres: ahead, right front, left front.
    pub distances_m: Vec<f32, INFRARED_MAX>,
}

/// Messages of the robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Telemetry {
    /// Milliseconds since the robot's start.
    pub timestamp_ms: u32,
    /// The measured value.
    pub state: Option<State>,
    /// Estimated pose.
    pub odometry: Option<Odometry>,
    /// The scan, if one was requested.
    pub lidar: Option<Lidar>,
    /// The lines, if requested.
    pub lines: Option<Vec<Line, LINES_MAX>>,
    /// The IR sensors.
    pub infrared: Option<Infrared>,
}

/// Error when a message was not written or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MessageError {
    /// The message is longer than the space for it.
    NoRoom {
        /// Bytes of the message.
        len: usize,
        /// Bytes of the space.
        room: usize,
    },
    /// The message ends inside a field.
    Cut,
    /// Bytes that are no field: an unknown wire type, a number without an end, a length that does
    /// not fit.
    Malformed,
    /// More of a repeated field than there is room for.
    TooMany,
}

impl fmt::Display for MessageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoRoom { len, room } => {
                write!(f, "message has {len} bytes and does not fit into {room}")
            }
            Self::Cut => write!(f, "message ends inside a field"),
            Self::Malformed => write!(f, "message holds bytes that are no field"),
            Self::TooMany => write!(f, "message repeats a field too often"),
        }
    }
}

impl core::error::Error for MessageError {}

impl From<DecodeError<Infallible>> for MessageError {
    fn from(error: DecodeError<Infallible>) -> Self {
        match error {
            DecodeError::UnexpectedEof => Self::Cut,
            DecodeError::Capacity => Self::TooMany,
            _ => Self::Malformed,
        }
    }
}

impl Telemetry {
    /// Writes the message to the front of `out`; returns its length.
    ///
    /// # Errors
    /// If the message is longer than `out`; `out` is then unchanged.
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, MessageError> {
        fields::encode(self, out)
    }

    /// Decodes the message in `payload`.
    ///
    /// # Errors
    /// If the payload is no such message.
    pub fn decode(payload: &[u8]) -> Result<Self, MessageError> {
        fields::decode(payload)
    }
}

impl Fields for Telemetry {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        to.number(1, self.timestamp_ms)?;
        if let Some(state) = self.state {
            to.message(2, &StateField(Some(state)))?;
        }
        if let Some(odometry) = &self.odometry {
            to.message(3, odometry)?;
        }
        if let Some(lidar) = &self.lidar {
            to.message(4, lidar)?;
        }
        if let Some(lines) = &self.lines {
            to.message(5, &LinesField(lines))?;
        }
        match &self.infrared {
            Some(infrared) => to.message(6, infrared),
            None => Ok(()),
        }
    }
}

impl MessageDecode for Telemetry {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::NUMBER_1 => self.timestamp_ms = from.decode_varint32()?,
                fields::MESSAGE_2 => self.state = fields::read::<StateField, _>(from)?.0,
                fields::MESSAGE_3 => {
                    from.decode_submessage_delimited(self.odometry.get_or_insert_default())?;
                }
                fields::MESSAGE_4 => {
                    from.decode_submessage_delimited(self.lidar.get_or_insert_default())?;
                }
                fields::MESSAGE_5 => {
                    let lines = self.lines.get_or_insert_default();
                    from.decode_submessage_delimited(&mut LinesReader(lines))?;
                }
                fields::MESSAGE_6 => {
                    from.decode_submessage_delimited(self.infrared.get_or_insert_default())?;
                }
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

/// The message that holds a state; `None` if its number is unknown or missing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StateField(Option<State>);

impl Fields for StateField {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        match self.0 {
            Some(state) => to.number(1, state as u32),
            None => Ok(()),
        }
    }
}

impl MessageDecode for StateField {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            if field.key() != fields::NUMBER_1 {
                return Ok(false);
            }
            self.0 = State::from_number(from.decode_varint32()?);
            Ok(true)
        })
    }
}

impl Fields for Pose {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        to.float(1, self.x)?;
        to.float(2, self.y)?;
        to.float(3, self.alpha)
    }
}

impl MessageDecode for Pose {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::FLOAT_1 => self.x = from.decode_float()?,
                fields::FLOAT_2 => self.y = from.decode_float()?,
                fields::FLOAT_3 => self.alpha = from.decode_float()?,
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

impl Fields for Odometry {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        to.message(1, &self.pose)?;
        if self.covariance.is_empty() {
            return Ok(());
        }
        to.message(2, &CovarianceField(&self.covariance))
    }
}

impl MessageDecode for Odometry {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::MESSAGE_1 => from.decode_submessage_delimited(&mut self.pose)?,
                fields::MESSAGE_2 => {
                    let mut reader = CovarianceReader(&mut self.covariance);
                    from.decode_submessage_delimited(&mut reader)?;
                }
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

struct CovarianceField<'a>(&'a [f32]);

impl Fields for CovarianceField<'_> {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        self.0.iter().try_for_each(|value| to.float(1, *value))
    }
}

struct CovarianceReader<'a>(&'a mut Vec<f32, COVARIANCE_MAX>);

impl MessageDecode for CovarianceReader<'_> {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::FLOAT_1 => fields::push(self.0, from.decode_float()?)?,
                // As newer libraries may write it: all values in one field.
                fields::MESSAGE_1 => {
                    let mut values = from.decode_varint32()?;
                    while values >= 4 {
                        fields::push(self.0, from.decode_float()?)?;
                        values -= 4;
                    }
                    from.skip_bytes(usize::try_from(values).unwrap_or(0))?;
                }
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

impl Fields for Lidar {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        to.number(1, self.timestamp_ms)?;
        self.points
            .iter()
            .try_for_each(|point| to.message(2, point))
    }
}

impl MessageDecode for Lidar {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::NUMBER_1 => self.timestamp_ms = from.decode_varint32()?,
                fields::MESSAGE_2 => fields::push(&mut self.points, fields::read(from)?)?,
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

impl Fields for LidarPoint {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        to.signed(1, self.angle_deg)?;
        to.signed(2, self.distance_mm)?;
        to.signed(3, self.quality)
    }
}

impl MessageDecode for LidarPoint {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::NUMBER_1 => self.angle_deg = from.decode_int32()?,
                fields::NUMBER_2 => self.distance_mm = from.decode_int32()?,
                fields::NUMBER_3 => self.quality = from.decode_int32()?,
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

struct LinesField<'a>(&'a [Line]);

impl Fields for LinesField<'_> {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        self.0.iter().try_for_each(|line| to.message(1, line))
    }
}

struct LinesReader<'a>(&'a mut Vec<Line, LINES_MAX>);

impl MessageDecode for LinesReader<'_> {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            if field.key() != fields::MESSAGE_1 {
                return Ok(false);
            }
            fields::push(self.0, fields::read(from)?)?;
            Ok(true)
        })
    }
}

impl Fields for Line {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        to.message(1, &self.start)?;
        to.message(2, &self.end)
    }
}

impl MessageDecode for Line {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::MESSAGE_1 => from.decode_submessage_delimited(&mut self.start)?,
                fields::MESSAGE_2 => from.decode_submessage_delimited(&mut self.end)?,
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

impl Fields for Infrared {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        if let Some(timestamp_ms) = self.timestamp_ms {
            to.number(1, timestamp_ms)?;
        }
        let mut distances = self.distances_m.iter();
        distances.try_for_each(|metres| to.message(2, &RangeField(*metres)))
    }
}

impl MessageDecode for Infrared {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::NUMBER_1 => self.timestamp_ms = Some(from.decode_varint32()?),
                fields::MESSAGE_2 => {
                    let RangeField(metres) = fields::read(from)?;
                    fields::push(&mut self.distances_m, metres)?;
                }
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct RangeField(f32);

impl Fields for RangeField {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        to.float(1, self.0)
    }
}

impl MessageDecode for RangeField {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            if field.key() != fields::FLOAT_1 {
                return Ok(false);
            }
            self.0 = from.decode_float()?;
            Ok(true)
        })
    }
}
