//! `xv11`: packets of four readings.

use core::fmt::Write as _;

use protocols::xv11::{self, RawReading, Reading, SpeedWord};

use super::answers::Answers;
use super::floor::Floor;
use super::lidar::Lidar;
use super::lua::{Lua, LuaField, field};
use super::row::{Codec, OtherOrder};
use super::wire::{Broken, Choices, Wire, made_again};

/// Packets of an XV-11 lidar.
pub static XV11: Codec = Codec::of::<Xv11>("XV-11 lidar, frames of four readings")
    .with_answers(Answers {
        head: 4,
        ..Answers::PLAIN
    })
    .with_other_order(OtherOrder::Wrong(other_order))
    .with_figures(|bytes| Lidar::of_packets(bytes).to_string())
    .with_floor(Floor {
        check_bits: 24,
        ..Floor::CHECKED
    })
    .with_lua(Lua {
        source: LUA,
        judge: "judge_xv11",
        tell: "tell_xv11",
        fields: &FIELDS,
    });

/// Both generations of the lidar in Lua: their readings are the same.
pub(super) const LUA: &str = include_str!("lua/xv11.lua");
/// Fields of a reading in Wireshark, for all frame types.
pub(super) const READING: [LuaField; 5] = [
    field("angle", "uint16", "hilrig.xv11.angle", "Angle (deg)"),
    field(
        "distance",
        "uint16",
        "hilrig.xv11.distance",
        "Distance (mm)",
    ),
    field("strength", "uint16", "hilrig.xv11.strength", "Strength"),
    field("weak", "bool", "hilrig.xv11.weak", "Strength warning"),
    field("code", "uint8", "hilrig.xv11.code", "Error code").shown_as("base.HEX"),
];
const FIELDS: [LuaField; 7] = [
    field("index", "uint8", "hilrig.xv11.index", "Index"),
    field("rpm", "float", "hilrig.xv11.rpm", "Speed (rpm)"),
    READING[0],
    READING[1],
    READING[2],
    READING[3],
    READING[4],
];

/// XV-11 packets.
#[derive(Clone, Copy, Debug)]
pub struct Xv11;

impl Wire for Xv11 {
    type Decoder = xv11::Decoder;
    const NAME: &'static str = "xv11";

    fn decoder() -> xv11::Decoder {
        xv11::Decoder::default()
    }

    fn bytes(frame: &xv11::Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn words(frame: &xv11::Frame) -> String {
        words(frame)
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let (index, speed) = (choices.byte(), choices.word());
        let readings = [(); 4].map(|()| RawReading([(); 4].map(|()| choices.byte())));
        out.extend(xv11::Frame::new(index, SpeedWord(speed), readings).as_bytes());
    }

    fn repair(frame: &mut [u8]) {
        if let Some(frame) = frame.first_chunk_mut() {
            let sum = xv11::checksum(frame);
            frame[20..].copy_from_slice(&sum.to_le_bytes());
        }
    }

    /// The checksum as publicly documented, computed byte by byte.
    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let frame = bytes.get(..22)?;
        if frame[0] != 0xFA || !(0xA0..=0xF9).contains(&frame[1]) {
            return None;
        }
        let mut sum = 0_u32;
        for word in 0..10 {
            sum = sum * 2 + u32::from(frame[2 * word]) + 256 * u32::from(frame[2 * word + 1]);
        }
        let folded = ((sum % 32_768) + sum / 32_768) % 32_768;
        (folded == u32::from(frame[20]) + 256 * u32::from(frame[21])).then_some(22)
    }

    fn kind(frame: &xv11::Frame) -> u64 {
        let valid = frame.readings().map(|reading| match reading {
            Reading::Range { weak: false, .. } => 0,
            Reading::Range { .. } => 1,
            _ => 2,
        });
        valid.iter().fold(0, |kind, reading| kind * 3 + reading)
    }

    fn means_itself(frame: &xv11::Frame) -> Result<(), Broken> {
        let made = xv11::Frame::new(frame.index(), frame.speed(), frame.raw_readings());
        made_again(frame.as_bytes(), made.as_bytes())?;
        for raw in frame.raw_readings() {
            let reading = Reading::from(raw);
            let again = Reading::from(RawReading::from(reading));
            if again != reading {
                let detail = format!("{reading:?} written and read is {again:?}");
                return Err(Broken::new("reading-means-itself", detail));
            }
        }
        Ok(())
    }
}

/// A lidar's packet: speed and four readings; `?` marks a strength warning, brackets a code.
fn words(frame: &xv11::Frame) -> String {
    let degree = u32::from(frame.index()) * 4;
    let mut out = format!("{:.2} rpm, from {degree} deg:", frame.speed_rpm());
    for reading in frame.readings() {
        match reading {
            Reading::Range {
                distance_mm, weak, ..
            } => {
                let mark = if weak { "?" } else { "" };
                write!(out, " {distance_mm}{mark}")
            }
            Reading::Invalid { code, .. } => write!(out, " ({code:02X})"),
        }
        .expect("a string takes everything");
    }
    out + " mm"
}

/// Counts of packets whose checksum is valid with swapped bytes, and in the right order.
fn other_order(bytes: &[u8]) -> [u64; 2] {
    let (mut other, mut expected) = (0, 0);
    for window in bytes.windows(xv11::FRAME_LEN) {
        let frame: &[u8; xv11::FRAME_LEN] = window.try_into().expect("as long as that");
        if frame[0] != xv11::START || !(xv11::FIRST_INDEX..=xv11::LAST_INDEX).contains(&frame[1]) {
            continue;
        }
        let sum = xv11::checksum(frame);
        let sent = [frame[20], frame[21]];
        expected += u64::from(u16::from_le_bytes(sent) == sum);
        other += u64::from(u16::from_be_bytes(sent) == sum);
    }
    [other, expected]
}
