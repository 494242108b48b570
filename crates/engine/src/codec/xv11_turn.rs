//! `xv11-turn`: frames of firmware 2.1, one per turn.

use protocols::xv11::{RawReading, Reading, turn};

use super::answers::Answers;
use super::floor::Floor;
use super::lidar::Lidar;
use super::lua::{Lua, LuaField, field};
use super::row::Codec;
use super::wire::{Broken, Choices, Wire, made_again};
use super::xv11;

/// Turns of an XV-11 lidar's old firmware.
pub static XV11_TURN: Codec =
    Codec::of::<Xv11Turns>("XV-11 lidar with the old firmware, one turn per frame")
        .fuzzed_as("xv11-turns")
        // 64 frames are 92 kB.
        .with_round(256)
        .with_answers(Answers {
            head: 6,
            ..Answers::PLAIN
        })
        .with_figures(|bytes| Lidar::of_turns(bytes).to_string())
        .with_floor(Floor {
            check_bits: 40,
            ..Floor::CHECKED
        })
        .with_lua(Lua {
            source: xv11::LUA,
            judge: "judge_turn",
            tell: "tell_turn",
            fields: &FIELDS,
        });

const FIELDS: [LuaField; 6] = [
    field("period", "uint16", "hilrig.xv11.period", "Period word").shown_as("base.HEX"),
    xv11::READING[0],
    xv11::READING[1],
    xv11::READING[2],
    xv11::READING[3],
    xv11::READING[4],
];

/// XV-11 turns of firmware 2.1.
#[derive(Clone, Copy, Debug)]
pub struct Xv11Turns;

impl Wire for Xv11Turns {
    type Decoder = turn::Decoder;
    const NAME: &'static str = "xv11-turn";

    fn decoder() -> turn::Decoder {
        turn::Decoder::default()
    }

    fn bytes(frame: &turn::Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn words(frame: &turn::Frame) -> String {
        words(frame)
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let period = choices.word();
        let reading = RawReading([(); 4].map(|()| choices.byte()));
        out.extend(turn::Frame::new(period, &[reading; 360]).as_bytes());
    }

    fn repair(frame: &mut [u8]) {
        if let Some(header) = frame.first_chunk_mut() {
            *header = [0x5A, 0xA5, 0x00, 0xC0];
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        (bytes.len() >= 1446 && bytes.starts_with(&[0x5A, 0xA5, 0x00, 0xC0])).then_some(1446)
    }

    fn means_itself(frame: &turn::Frame) -> Result<(), Broken> {
        let readings = core::array::from_fn(|degree| frame.raw_reading(degree));
        let made = turn::Frame::new(frame.period(), &readings);
        made_again(frame.as_bytes(), made.as_bytes())
    }
}

/// A turn of the old firmware as text, with counts of its readings.
fn words(frame: &turn::Frame) -> String {
    let (mut ok, mut weak, mut invalid) = (0, 0, 0);
    for degree in 0..360 {
        match frame.reading(degree) {
            Reading::Range { weak: false, .. } => ok += 1,
            Reading::Range { weak: true, .. } => weak += 1,
            Reading::Invalid { .. } => invalid += 1,
        }
    }
    let period = frame.period();
    format!("turn, period word {period:#06x}, {ok} ok, {weak} weak, {invalid} invalid")
}
