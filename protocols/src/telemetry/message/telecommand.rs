//! Commands of the PC to the robot.

use micropb::{DecodeError, MessageDecode, PbDecoder, PbEncoder, PbRead, PbWrite};

use super::fields::{self, FieldWriter, Fields, read_fields};
use super::{MessageError, Pose, State, StateField};

/// Speeds for [`State::Manual`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Velocities {
    /// Ahead, m/s.
    pub linear_m_s: f32,
    /// To the left, rad/s.
    pub angular_rad_s: f32,
}

/// A request for the lines that the lidar sees, with the figures for their extraction; 0 selects
/// the robot's own figure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinesRequest {
    /// Gap between neighbouring points that ends a region, mm.
    pub gap_mm: u32,
    /// Maximum distance of a point from its line, mm.
    pub tolerance_mm: u32,
    /// Minimum interior angle at which two lines are one, degrees.
    pub merge_deg: u32,
}

/// Figures for [`State::AutoReactive`]; `None` or below 0: the robot's own figures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reactive {
    /// Nearer than this the robot backs away, metres.
    pub distance_min_m: Option<f32>,
    /// An object farther away than this is no obstacle, metres.
    pub distance_max_m: Option<f32>,
    /// Nominal speed, m/s.
    pub speed_m_s: Option<f32>,
    /// Turn rate away from the obstacle, rad/s a metre.
    pub turn_gain: Option<f32>,
}

/// Message of the PC. A new state of [`State::AutoPosition`] counts only together with a desired
/// pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Telecommand {
    /// Milliseconds since the PC's program began.
    pub timestamp_ms: u32,
    /// The robot's order.
    pub state: Option<State>,
    /// Speeds by hand.
    pub velocities: Option<Velocities>,
    /// True pose of the robot: its odometry continues from there.
    pub corrected_pose: Option<Pose>,
    /// The goal.
    pub desired_pose: Option<Pose>,
    /// A request for the scan, with one point per this number of degrees.
    pub lidar_step_deg: Option<u32>,
    /// A request for the lines.
    pub lines: Option<LinesRequest>,
    /// Figures for the reactive drive.
    pub reactive: Option<Reactive>,
}

impl Telecommand {
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

impl Fields for Telecommand {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        to.number(1, self.timestamp_ms)?;
        if let Some(state) = self.state {
            to.message(2, &StateField(Some(state)))?;
        }
        if let Some(velocities) = &self.velocities {
            to.message(3, velocities)?;
        }
        if let Some(pose) = &self.corrected_pose {
            to.message(4, pose)?;
        }
        if let Some(pose) = &self.desired_pose {
            to.message(5, pose)?;
        }
        if let Some(step) = self.lidar_step_deg {
            to.number(6, step)?;
        }
        if let Some(lines) = &self.lines {
            to.message(7, lines)?;
        }
        match &self.reactive {
            Some(reactive) => to.message(8, reactive),
            None => Ok(()),
        }
    }
}

impl MessageDecode for Telecommand {
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
                    from.decode_submessage_delimited(self.velocities.get_or_insert_default())?;
                }
                fields::MESSAGE_4 => {
                    from.decode_submessage_delimited(self.corrected_pose.get_or_insert_default())?;
                }
                fields::MESSAGE_5 => {
                    from.decode_submessage_delimited(self.desired_pose.get_or_insert_default())?;
                }
                fields::NUMBER_6 => self.lidar_step_deg = Some(from.decode_varint32()?),
                fields::MESSAGE_7 => {
                    from.decode_submessage_delimited(self.lines.get_or_insert_default())?;
                }
                fields::MESSAGE_8 => {
                    from.decode_submessage_delimited(self.reactive.get_or_insert_default())?;
                }
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

impl Fields for Velocities {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        to.float(1, self.linear_m_s)?;
        to.float(2, self.angular_rad_s)
    }
}

impl MessageDecode for Velocities {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::FLOAT_1 => self.linear_m_s = from.decode_float()?,
                fields::FLOAT_2 => self.angular_rad_s = from.decode_float()?,
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

impl Fields for LinesRequest {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        to.number(1, self.gap_mm)?;
        to.number(2, self.tolerance_mm)?;
        to.number(3, self.merge_deg)
    }
}

impl MessageDecode for LinesRequest {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::NUMBER_1 => self.gap_mm = from.decode_varint32()?,
                fields::NUMBER_2 => self.tolerance_mm = from.decode_varint32()?,
                fields::NUMBER_3 => self.merge_deg = from.decode_varint32()?,
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}

impl Fields for Reactive {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error> {
        let values = [
            self.distance_min_m,
            self.distance_max_m,
            self.speed_m_s,
            self.turn_gain,
        ];
        for (field, value) in (1..).zip(values) {
            if let Some(value) = value {
                to.float(field, value)?;
            }
        }
        Ok(())
    }
}

impl MessageDecode for Reactive {
    fn decode<R: PbRead>(
        &mut self,
        from: &mut PbDecoder<R>,
        len: usize,
    ) -> Result<(), DecodeError<R::Error>> {
        read_fields(from, len, |field, from| {
            match field.key() {
                fields::FLOAT_1 => self.distance_min_m = Some(from.decode_float()?),
                fields::FLOAT_2 => self.distance_max_m = Some(from.decode_float()?),
                fields::FLOAT_3 => self.speed_m_s = Some(from.decode_float()?),
                fields::FLOAT_4 => self.turn_gain = Some(from.decode_float()?),
                _ => return Ok(false),
            }
            Ok(true)
        })
    }
}
