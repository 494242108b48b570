//! `car-board` and `car-command`: the two directions of the line to a model car's board.
//!
//! Two rows, because no byte distinguishes the directions for a decoder: the start of a frame,
//! `00 0F`, is also two steering values.

use core::time::Duration;

use protocols::car_board::{
    BATTERY_MV, Command, FRAME_LEN, Frame, IDLE_GAP, Readings, SYNC, ULTRASONIC_MAX_CM,
};
use protocols::{Candidate, Decoder, Format, FrameError};

use super::floor::Floor;
use super::lua::{Lua, LuaField, field};
use super::row::Codec;
use super::wire::{Broken, Choices, Wire, made_again};

/// Frames of the board.
pub static CAR_BOARD: Codec =
    Codec::of::<CarBoard>("Sensors of a model car's board: ultrasound, line, hall, battery")
        .with_idle(IDLE_GAP)
        .with_floor(Floor {
            check_bits: 24,
            share: 50,
            ..Floor::CHECKED
        })
        .with_lua(Lua {
            source: SOURCE,
            judge: "judge_car_board",
            tell: "tell_car_board",
            fields: &BOARD_FIELDS,
        });

/// Commands to the board.
pub static CAR_COMMAND: Codec =
    Codec::of::<CarCommand>("Commands to a model car's board: a motor byte, a steering byte")
        .with_idle(PAIR_GAP)
        .with_floor(Floor {
            check_bits: 4,
            frames: 6,
            ..Floor::UNCHECKED
        })
        .with_lua(Lua {
            source: SOURCE,
            judge: "judge_car_command",
            tell: "tell_car_command",
            fields: &COMMAND_FIELDS,
        });

const SOURCE: &str = include_str!("lua/car_board.lua");
/// Both bytes of a pair leave together, 87 us apart; the car's program sends the next pair 1 ms or
/// 20 ms later.
const PAIR_GAP: Duration = Duration::from_millis(5);

const BOARD_FIELDS: [LuaField; 4] = [
    field(
        "car_range",
        "uint16",
        "hilrig.car_board.range",
        "Ultrasonic range (cm)",
    ),
    field("car_line", "bool", "hilrig.car_board.line", "Over a line"),
    field("car_hall", "uint16", "hilrig.car_board.hall", "Hall pulses"),
    field(
        "car_battery",
        "uint16",
        "hilrig.car_board.battery",
        "Battery (mV)",
    ),
];

const COMMAND_FIELDS: [LuaField; 2] = [
    field("car_level", "int8", "hilrig.car_board.level", "Motor level"),
    field(
        "car_steering",
        "int8",
        "hilrig.car_board.steering",
        "Steering value",
    ),
];

/// Frames of the board.
#[derive(Clone, Copy, Debug)]
pub struct CarBoard;

impl Wire for CarBoard {
    type Decoder = protocols::car_board::Decoder;
    const NAME: &'static str = "car-board";

    fn decoder() -> Self::Decoder {
        Self::Decoder::default()
    }

    fn bytes(frame: &Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn words(frame: &Frame) -> String {
        let readings = frame.readings();
        let shown = |cm: u16| match cm {
            0 => "-".to_owned(),
            cm => format!("{cm} cm"),
        };
        let words = [readings.front_cm, readings.right_cm, readings.left_cm];
        let [front, right, left] = words.map(shown);
        let line = if readings.line == 1 { ", line" } else { "" };
        let (hall, volts) = (readings.hall, f64::from(readings.battery_mv) / 1e3);
        format!("front {front}, right {right}, left {left}, hall {hall}, {volts} V{line}")
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let [front_cm, right_cm, left_cm] = core::array::from_fn(|_| range(choices));
        let [least, greatest] = BATTERY_MV;
        let readings = Readings {
            front_cm,
            right_cm,
            left_cm,
            line: choices.byte() & 1,
            hall: choices.word(),
            battery_mv: least + choices.word() % (greatest - least + 1),
        };
        out.extend(readings.encode().as_bytes());
    }

    /// Clamps values to the sensors' ranges.
    fn repair(frame: &mut [u8]) {
        let Some(frame) = frame.first_chunk_mut::<FRAME_LEN>() else {
            return;
        };
        frame[..SYNC.len()].copy_from_slice(&SYNC);
        for at in [2, 4, 6] {
            put_within(&mut frame[at..at + 2], [0, ULTRASONIC_MAX_CM]);
        }
        frame[8] &= 1;
        put_within(&mut frame[11..], BATTERY_MV);
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let frame = bytes.first_chunk::<13>()?;
        let word = |at: usize| u32::from(frame[at]) + 256 * u32::from(frame[at + 1]);
        let is_sound = frame.starts_with(&[0x00, 0x0F])
            && [2, 4, 6].iter().all(|&at| word(at) <= 1_100)
            && frame[8] < 2
            && (4_000..=10_000).contains(&word(11));
        let is_followed = matches!(bytes[13..], [] | [0x00] | [0x00, 0x0F, ..]);
        (is_sound && is_followed).then_some(13)
    }

    fn means_itself(frame: &Frame) -> Result<(), Broken> {
        made_again(frame.as_bytes(), frame.readings().encode().as_bytes())
    }

    /// The kind of a frame: the sensors with new values, and whether a line is seen.
    fn kind(frame: &Frame) -> u64 {
        let readings = frame.readings();
        let words = [readings.front_cm, readings.right_cm, readings.left_cm];
        let new = words
            .into_iter()
            .fold(0, |new, cm| 2 * new + u64::from(cm > 0));
        2 * new + u64::from(readings.line)
    }
}

/// A range in centimetres; often 15, because its low byte equals a sync byte.
fn range(choices: &mut Choices<'_>) -> u16 {
    match choices.byte() {
        0..64 => 15,
        low @ 64..128 => low.into(),
        _ => choices.word() % (ULTRASONIC_MAX_CM + 1),
    }
}

/// Clamps the word in `bytes` to `least` to `greatest`.
fn put_within(bytes: &mut [u8], [least, greatest]: [u16; 2]) {
    if let [low, high] = bytes {
        let word = u16::from_le_bytes([*low, *high]);
        [*low, *high] = word.clamp(least, greatest).to_le_bytes();
    }
}

/// Commands to the board.
#[derive(Clone, Copy, Debug)]
pub struct CarCommand;

/// A motor byte followed by a steering byte, as the car's program always sends them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pair([u8; 2]);

/// Finds pairs.
#[derive(Clone, Copy, Debug, Default)]
pub struct PairFormat;

impl Format for PairFormat {
    type Frame = Pair;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        match (bytes.first().map(|it| Command::decode(*it)), bytes.get(1)) {
            (Some(Ok(Command::Motor(_))), None) => Candidate::Incomplete,
            (Some(Ok(Command::Motor(_))), Some(second)) => match Command::decode(*second) {
                Ok(Command::Steering(_)) => Candidate::Complete(2),
                _ => Candidate::Rejected(FrameError::Implausible {
                    at: 1,
                    found: (*second).into(),
                }),
            },
            _ => Candidate::Noise,
        }
    }

    fn frame(&self, bytes: &[u8]) -> Pair {
        bytes.try_into().map(Pair).unwrap_or_default()
    }
}

impl Wire for CarCommand {
    type Decoder = Decoder<PairFormat, 2>;
    const NAME: &'static str = "car-command";

    fn decoder() -> Self::Decoder {
        Self::Decoder::default()
    }

    fn bytes(Pair(bytes): &Pair) -> &[u8] {
        bytes
    }

    fn words(Pair(bytes): &Pair) -> String {
        let told = bytes.map(|byte| match Command::decode(byte) {
            Ok(Command::Motor(level)) => format!("motor {}", level.get()),
            Ok(Command::Steering(value)) => format!("steering {}", value.get()),
            Err(error) => error.to_string(),
        });
        told.join(", ")
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        out.extend([0x80 + choices.byte() % 21, choices.byte() % 101]);
    }

    fn repair(frame: &mut [u8]) {
        for (at, byte) in frame.iter_mut().enumerate() {
            *byte = match at % 2 {
                0 => (*byte | 0x80).min(0x94),
                _ => (*byte & 0x7F).min(0x64),
            };
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        matches!(bytes, [0x80..=0x94, 0x00..=0x64, ..]).then_some(2)
    }

    fn means_itself(Pair(bytes): &Pair) -> Result<(), Broken> {
        let made = bytes.map(|byte| Command::decode(byte).map_or(0xFF, Command::encode));
        made_again(bytes, &made)
    }

    /// The signs of speed and steering identify the kind of a command.
    fn kind(Pair(bytes): &Pair) -> u64 {
        let order = |byte: u8, middle: u8| match byte.cmp(&middle) {
            core::cmp::Ordering::Less => 0,
            core::cmp::Ordering::Equal => 1,
            core::cmp::Ordering::Greater => 2,
        };
        3 * order(bytes[0], 0x8A) + order(bytes[1], 0x32)
    }
}
