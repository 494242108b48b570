//! `perception`: rows of depths, scans and markers from a camera's program.
//!
//! Messages of a network, one a packet. The bytes of a capture are read as one stream, because each
//! message contains its length. They have no checksum: the network has one.

use core::time::Duration;

use protocols::perception::{DepthRow, MESSAGE_MAX, Marker, Message, Scan, VALUES_MAX};
use protocols::{Candidate, Decoder, Format, FrameError};

use super::floor::Floor;
use super::lua::{Lua, LuaField, field};
use super::row::Codec;
use super::wire::{Broken, Choices, Wire, made_again};

/// Messages of a camera.
pub static PERCEPTION: Codec = Codec::of::<Perception>("Rows of depths, scans and markers")
    .with_idle(GAP)
    .with_floor(Floor {
        frames: 3,
        ..Floor::UNCHECKED
    })
    .with_round(1024)
    .with_lua(Lua {
        source: include_str!("lua/perception.lua"),
        judge: "judge_perception",
        tell: "tell_perception",
        fields: &FIELDS,
    });

/// Two pictures are 33 ms apart, and the longest message takes less than 1 ms.
const GAP: Duration = Duration::from_millis(10);

const FIELDS: [LuaField; 5] = [
    field(
        "perc_count",
        "uint16",
        "hilrig.perception.count",
        "Depths or ranges",
    ),
    field(
        "perc_nearest",
        "uint16",
        "hilrig.perception.nearest",
        "Nearest (mm)",
    ),
    field("perc_id", "uint16", "hilrig.perception.id", "Marker"),
    field(
        "perc_ahead",
        "int32",
        "hilrig.perception.ahead",
        "Ahead (mm)",
    ),
    field(
        "perc_right",
        "int32",
        "hilrig.perception.right",
        "To the right (mm)",
    ),
];

/// The messages.
#[derive(Clone, Copy, Debug)]
pub struct Perception;

/// Consecutive messages.
#[derive(Clone, Copy, Debug, Default)]
pub struct MessageFormat;

/// A message.
#[derive(Clone, Debug)]
pub struct Told(Vec<u8>);

impl Format for MessageFormat {
    type Frame = Told;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        let len = match *bytes {
            [b'M', ..] => 19,
            [b'D' | b'S'] | [b'D' | b'S', _] => return Candidate::Incomplete,
            [kind @ (b'D' | b'S'), low, high, ..] => {
                let count = usize::from(u16::from_le_bytes([low, high]));
                if count > VALUES_MAX {
                    return Candidate::Rejected(FrameError::Length {
                        max: 700,
                        found: u16::from_le_bytes([low, high]).into(),
                    });
                }
                2 * count + if kind == b'D' { 5 } else { 11 }
            }
            _ => return Candidate::Noise,
        };
        match bytes.get(..len).map(Message::decode) {
            None => Candidate::Incomplete,
            Some(Ok(_)) => Candidate::Complete(len),
            Some(Err(_)) => Candidate::Noise,
        }
    }

    fn frame(&self, bytes: &[u8]) -> Told {
        Told(bytes.to_vec())
    }
}

impl Wire for Perception {
    type Decoder = Decoder<MessageFormat, MESSAGE_MAX>;
    const NAME: &'static str = "perception";

    fn decoder() -> Self::Decoder {
        Self::Decoder::default()
    }

    fn bytes(Told(bytes): &Told) -> &[u8] {
        bytes
    }

    fn words(Told(bytes): &Told) -> String {
        match Message::decode(bytes) {
            Ok(Message::DepthRow(row)) => {
                let measured = measured(row.depths_mm());
                format!("{} depths, {measured}", row.depths_mm().len())
            }
            Ok(Message::Scan(scan)) => {
                let first = f64::from(scan.first_urad) / 1e6;
                let measured = measured(scan.ranges_mm());
                let count = scan.ranges_mm().len();
                format!("{count} ranges from {first:.3} rad, {measured}")
            }
            Ok(Message::Marker(marker)) => {
                let [right, _, ahead] = marker.place_mm;
                let id = marker.id;
                format!("marker {id}: {ahead} mm ahead, {right} mm to the right")
            }
            Err(error) => error.to_string(),
        }
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let kind = choices.byte();
        let count = match choices.byte() {
            few @ 0..240 => usize::from(few % 12),
            many => 40 * usize::from(many - 239),
        };
        let mut message = [0; MESSAGE_MAX];
        let values: Vec<u16> = (0..count).map(|_| choices.word()).collect();
        let first = u32::from(choices.word()) << 16 | u32::from(choices.word());
        let len = match kind % 3 {
            0 => {
                let place = first.cast_signed();
                let marker = Marker {
                    id: choices.word(),
                    place_mm: [place, place / 2, place / 3],
                    normal: [choices.word(), choices.word()].map(u16::cast_signed),
                };
                return out.extend(marker.encode());
            }
            1 => DepthRow::encode(choices.word(), &values, &mut message),
            _ => Scan::encode(first.cast_signed(), 1_000, &values, &mut message),
        };
        out.extend(&message[..len]);
    }

    /// Makes a message of the given length: a marker, or as many values as fit.
    fn repair(frame: &mut [u8]) {
        let len = frame.len();
        let head = match frame.first() {
            Some(b'S') if len >= 11 && len % 2 == 1 => 11,
            Some(b'D') if len >= 5 && len % 2 == 1 => 5,
            Some(_) if len == 19 => {
                frame[0] = b'M';
                return;
            }
            Some(_) if len >= 5 && len % 2 == 1 => 5,
            _ => return,
        };
        if let Ok(count) = u16::try_from((len - head) / 2) {
            frame[0] = if head == 11 { b'S' } else { b'D' };
            frame[1..3].copy_from_slice(&count.to_le_bytes());
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let count = || Some(usize::from(*bytes.get(1)?) + 256 * usize::from(*bytes.get(2)?));
        let len = match bytes.first()? {
            0x4D => 19,
            0x44 => 5 + 2 * count().filter(|count| *count <= 700)?,
            0x53 => 11 + 2 * count().filter(|count| *count <= 700)?,
            _ => return None,
        };
        (bytes.len() >= len).then_some(len)
    }

    /// No camera measures beyond thirty metres, and a row or scan has several values.
    fn is_plausible(Told(bytes): &Told) -> bool {
        const FAR_MM: u16 = 30_000;
        let are = |values: Vec<u16>| values.len() >= 4 && values.iter().all(|&mm| mm <= FAR_MM);
        match Message::decode(bytes) {
            Ok(Message::DepthRow(row)) => are(row.depths_mm().collect()),
            Ok(Message::Scan(scan)) => are(scan.ranges_mm().collect()),
            Ok(Message::Marker(marker)) => marker
                .place_mm
                .iter()
                .all(|mm| mm.unsigned_abs() <= FAR_MM.into()),
            Err(_) => false,
        }
    }

    fn means_itself(Told(bytes): &Told) -> Result<(), Broken> {
        let mut made = [0; MESSAGE_MAX];
        let len = match Message::decode(bytes) {
            Ok(Message::DepthRow(row)) => {
                let values: Vec<u16> = row.depths_mm().collect();
                DepthRow::encode(row.focal_tenths, &values, &mut made)
            }
            Ok(Message::Scan(scan)) => {
                let values: Vec<u16> = scan.ranges_mm().collect();
                Scan::encode(scan.first_urad, scan.step_urad, &values, &mut made)
            }
            Ok(Message::Marker(marker)) => {
                made[..19].copy_from_slice(&marker.encode());
                19
            }
            Err(_) => 0,
        };
        made_again(bytes, &made[..len])
    }

    /// Type and size of the message.
    fn kind(Told(bytes): &Told) -> u64 {
        let first = bytes.first().copied().unwrap_or_default();
        u64::from(first) << 8 | u64::from(usize::BITS - bytes.len().leading_zeros())
    }
}

/// Number of measured values, and the smallest.
fn measured(values: impl Iterator<Item = u16>) -> String {
    let values: Vec<u16> = values.filter(|mm| *mm > 0).collect();
    match values.iter().min() {
        Some(nearest) => format!("{} measured, nearest {nearest} mm", values.len()),
        None => "none measured".to_owned(),
    }
}
