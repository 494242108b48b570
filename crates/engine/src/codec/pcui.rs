//! `pcui`: messages between robot and PC.

use core::fmt::Write as _;

use protocols::pcui::diagnosis::Condition;
use protocols::pcui::message::MapRow;
use protocols::pcui::{self, Message};
use protocols::{Decode, rle};

use super::answers::Answers;
use super::floor::Floor;
use super::lua::{Lua, LuaField, field};
use super::row::{Codec, OtherOrder};
use super::wire::{Broken, Choices, Wire, made_again};

/// Messages between robot and PC.
pub static PCUI: Codec = Codec::of::<Pcui>("Messages between robot and PC")
    .with_answers(Answers {
        // The three letters of a message.
        kind: |frame| &frame[14..17],
        head: pcui::HEADER_LEN,
        ..Answers::PLAIN
    })
    .with_other_order(OtherOrder::Wrong(other_order))
    .with_floor(Floor {
        check_bits: 64,
        ..Floor::CHECKED
    })
    .with_lua(Lua {
        source: include_str!("lua/pcui.lua"),
        judge: "judge_pcui",
        tell: "tell_pcui",
        fields: &FIELDS,
    });

const FIELDS: [LuaField; 10] = [
    field("id", "string", "hilrig.pcui.id", "Message"),
    field("length", "uint16", "hilrig.pcui.length", "Payload length"),
    field("mode", "uint8", "hilrig.pcui.mode", "Mode").shown_as(
        "base.DEC, { [0] = \"stop\", \"exploration\", \"waypoint\", \"manual\", \"explore\" }",
    ),
    field("layer", "uint8", "hilrig.pcui.layer", "Layer"),
    field("row", "uint16", "hilrig.pcui.row", "Row"),
    field("pixels", "uint32", "hilrig.pcui.pixels", "Pixels"),
    field("x", "int16", "hilrig.pcui.x", "x (mm)"),
    field("y", "int16", "hilrig.pcui.y", "y (mm)"),
    field("psi", "int16", "hilrig.pcui.psi", "psi (deg)"),
    field("waypoint", "int16", "hilrig.pcui.waypoint", "Waypoint"),
];

/// The PC link.
#[derive(Clone, Copy, Debug)]
pub struct Pcui;

const IDS: [[u8; 3]; 8] = [
    *b"MPD", *b"MAP", *b"MAR", *b"LWP", *b"STA", *b"STA", *b"LWP", *b"???",
];

impl Wire for Pcui {
    type Decoder = pcui::Decoder;
    const NAME: &'static str = "pcui";

    fn decoder() -> pcui::Decoder {
        pcui::Decoder::default()
    }

    fn bytes(frame: &pcui::Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn words(frame: &pcui::Frame) -> String {
        words(frame)
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let id = IDS[choices.below(IDS.len())];
        let len = match (&id, choices.byte()) {
            (b"MPD", 0..250) => 13,
            (b"STA", most @ 0..250) => {
                if most % 2 == 0 {
                    3
                } else {
                    9
                }
            }
            (b"LWP", most @ 0..250) => 2 + 9 * usize::from(most % 8),
            (_, most) => usize::from(most) * 2,
        };
        let start = out.len();
        out.resize(start + pcui::HEADER_LEN, 0);
        out.extend(choices.take(len));
        out.resize(start + pcui::HEADER_LEN + len, 0);
        if &id == b"LWP" && len >= 2 && (len - 2).is_multiple_of(9) {
            let count = u16::try_from((len - 2) / 9).expect("at most 56");
            out[start + pcui::HEADER_LEN..][..2].copy_from_slice(&count.to_le_bytes());
        }
        let sealed = pcui::seal(&mut out[start..], id, len);
        debug_assert!(sealed.is_some(), "at most 510 bytes");
    }

    fn repair(frame: &mut [u8]) {
        if let Some(len) = frame.len().checked_sub(pcui::HEADER_LEN) {
            let id = [frame[14], frame[15], frame[16]];
            // A payload that has become too long stays unchanged.
            let _ = pcui::seal(frame, id, len);
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let header = bytes.get(..17)?;
        let len = usize::from(header[8]) + 256 * usize::from(header[9]);
        if !header.starts_with(b"PCUI_MSG") || len > pcui::PAYLOAD_MAX {
            return None;
        }
        let payload = bytes.get(17..17 + len)?;
        let sum: u32 = payload.iter().map(|&byte| u32::from(byte)).sum();
        (sum.to_le_bytes() == header[10..14]).then_some(17 + len)
    }

    fn kind(frame: &pcui::Frame) -> u64 {
        let len = frame.payload().len();
        let size = u64::from(usize::BITS - len.leading_zeros());
        let message = match frame.message() {
            Ok(Message::Map(_)) => 1,
            Ok(Message::Row(_)) => 2,
            Ok(Message::CodedRow(_)) => 3,
            Ok(Message::Waypoints(_)) => 4,
            Ok(Message::Order(_)) => 5,
            Ok(Message::State(_)) => 6,
            Ok(Message::Diagnosis(_)) => 8,
            Ok(Message::Victims(_)) => 9,
            Ok(Message::Sensors(_)) => 10,
            Ok(Message::Text(_)) => 11,
            Err(_) => 7,
        };
        message << 8 | size
    }

    fn means_itself(frame: &pcui::Frame) -> Result<(), Broken> {
        use pcui::{diagnosis, message};
        let mut made = [0; pcui::FRAME_MAX];
        let len = match frame.message() {
            Err(_) => return Ok(()),
            Ok(Message::Map(map)) => message::encode_map_properties(&map, &mut made),
            Ok(Message::Waypoints(list)) => {
                let list: Vec<_> = list.iter().collect();
                message::encode_waypoints(list.into_iter(), &mut made)
            }
            Ok(Message::Order(order)) => message::encode_order(&order, &mut made),
            Ok(Message::State(state)) => message::encode_state(&state, &mut made),
            // Unknown bits and states are not printed.
            Ok(Message::Diagnosis(_)) => return Ok(()),
            Ok(Message::Victims(list)) => {
                let places: Vec<_> = list.iter().collect();
                diagnosis::encode_victims(places.into_iter(), &mut made)
            }
            Ok(Message::Sensors(told)) => diagnosis::encode_readings(&told, &mut made),
            Ok(Message::Text(told)) => diagnosis::encode_text(told, &mut made),
            Ok(Message::Row(row)) => return row_means_itself(&row, row.data),
            Ok(Message::CodedRow(row)) => {
                let mut pixels = [0; 300];
                return match rle::decode(row.data, &mut pixels) {
                    Ok(len) => row_means_itself(&row, &pixels[..len]),
                    Err(_) => Ok(()),
                };
            }
        };
        made_again(frame.as_bytes(), &made[..len.unwrap_or(0)])
    }
}

/// A row has several encodings: encoded again, it must show the same pixels at the same position.
fn row_means_itself(row: &MapRow<'_>, pixels: &[u8]) -> Result<(), Broken> {
    let mut made = [0; pcui::FRAME_MAX];
    let dialect = rle::Dialect::Lossless;
    let len = pcui::message::encode_row(row.layer, row.y, pixels, dialect, &mut made);
    let mut decoder = pcui::Decoder::default();
    let mut again = [0; pcui::PAYLOAD_MAX];
    let frame = decoder.push(&made[..len.unwrap_or(0)]).find_map(Result::ok);
    let shown = match frame.as_ref().map(|frame| frame.message()) {
        Some(Ok(Message::Row(other))) if (other.layer, other.y) == (row.layer, row.y) => {
            Some(other.data)
        }
        Some(Ok(Message::CodedRow(other))) if (other.layer, other.y) == (row.layer, row.y) => {
            rle::decode(other.data, &mut again).map_or(None, |len| Some(&again[..len]))
        }
        _ => None,
    };
    if shown == Some(pixels) {
        return Ok(());
    }
    let detail = format!("row {} of {pixels:?} encoded again shows {shown:?}", row.y);
    Err(Broken::new("rows-mean-themselves", detail))
}

/// A message between robot and PC.
fn words(frame: &pcui::Frame) -> String {
    let id = frame.id();
    let id = id.escape_ascii();
    match frame.message() {
        Err(error) => format!("{id}: {error}"),
        Ok(Message::Map(map)) => {
            let [x, y] = map.position_mm;
            let [width, height] = map.size_mm;
            let (cell, psi) = (map.resolution_mm, map.psi_deg);
            format!("{id} map {width} x {height} mm of {cell} mm, robot at {x},{y} mm {psi} deg")
        }
        Ok(Message::Row(row)) => {
            let (layer, y, len) = (row.layer, row.y, row.data.len());
            format!("{id} layer {layer} row {y}, {len} pixels")
        }
        Ok(Message::CodedRow(row)) => {
            let (layer, y, len) = (row.layer, row.y, row.data.len());
            let pixels = rle::decode(row.data, &mut [0; 0x10000]);
            let pixels = pixels.map_or_else(|e| e.to_string(), |n| format!("{n} pixels"));
            format!("{id} layer {layer} row {y}, {pixels} in {len} bytes")
        }
        Ok(Message::Waypoints(list)) => {
            let mut out = format!("{id} {} waypoints", list.len());
            for point in list.iter() {
                let [x, y] = point.position_mm;
                write!(out, " {}:{x},{y}", point.id).expect("a string takes everything");
            }
            out
        }
        Ok(Message::Order(order)) => {
            let [left, right] = order.set_point;
            format!("{id} order {:?}, set-points {left} {right}", order.mode)
        }
        Ok(Message::State(state)) => {
            let ([left, right], [l, r]) = (state.speed_mm_s, state.set_point);
            let mode = state.mode;
            format!("{id} state {mode:?}, speed {left} {right} mm/s, set-points {l} {r}")
        }
        Ok(Message::Diagnosis(told)) => {
            let (mv, percent) = (told.battery_mv, told.battery_percent);
            let [lidar, base, radio] = told.errors;
            let conditions: Vec<&str> = told.conditions.iter().map(Condition::text).collect();
            let conditions = conditions.join(", ");
            format!(
                "{id} battery {mv} mV {percent} %, search {}, errors {lidar} {base} {radio}; \
                 {conditions}",
                told.search.text()
            )
        }
        Ok(Message::Victims(list)) => {
            let mut out = format!("{id} victims");
            for [x, y] in list.iter() {
                write!(out, " {x},{y}").expect("a string takes everything");
            }
            out
        }
        Ok(Message::Sensors(told)) => {
            let (ranges, rpm) = (told.infrared_mm, told.lidar_rpm);
            format!("{id} infrared {ranges:?} mm, lidar {rpm} rpm")
        }
        Ok(Message::Text(told)) => {
            let (number, text) = (told.number, told.text.escape_ascii());
            format!("{id} message {number}: {text}")
        }
    }
}

/// Counts of messages whose checksum is valid with swapped bytes, and in the right order.
fn other_order(bytes: &[u8]) -> [u64; 2] {
    let (mut other, mut expected) = (0, 0);
    for (at, window) in bytes.windows(pcui::HEADER_LEN).enumerate() {
        if window[..8] != pcui::MAGIC {
            continue;
        }
        let len = usize::from(u16::from_le_bytes([window[8], window[9]]));
        let Some(payload) = bytes[at + pcui::HEADER_LEN..].get(..len) else {
            continue;
        };
        let sum = pcui::checksum(payload);
        let sent = [window[10], window[11], window[12], window[13]];
        expected += u64::from(u32::from_le_bytes(sent) == sum);
        other += u64::from(u32::from_be_bytes(sent) == sum && sum > 0);
    }
    [other, expected]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The fielded robot's row of unknown cells: 255 + 44 of 300.
    #[test]
    fn a_coded_row_is_told_by_its_pixels() {
        let bytes = b"PCUI_MSG\x07\x00\x29\x02\x00\x00MAR\x00\x00\x00\xFF\x7F\x2C\x7F";
        let mut decoder = pcui::Decoder::default();
        let frame = decoder.push(bytes).find_map(Result::ok).expect("sound");
        assert_eq!(words(&frame), "MAR layer 0 row 0, 299 pixels in 4 bytes");
    }
}
