//! `telemetry`: escaped frames of the robot yellow's link, in both directions.

mod words;

use protocols::{Decode, FrameError, telemetry};
use telemetry::message::{LinesRequest, Pose, State, Telecommand, Velocities};
use telemetry::{ESCAPE, PAYLOAD_MAX, START};

use super::answers::Answers;
use super::lua::{Lua, LuaField, field};
use super::row::Codec;
use super::wire::{Broken, Choices, Wire, made_again};

/// Frames of the telemetry link.
pub static TELEMETRY: Codec =
    Codec::of::<Telemetry>("Telemetry of the robot yellow, escaped frames behind 7E")
        .with_answers(Answers {
            // The tag of the message's first field.
            kind: |frame| frame.get(3..4).unwrap_or_default(),
            head: 3,
            ..Answers::PLAIN
        })
        .with_lua(Lua {
            source: include_str!("lua/telemetry.lua"),
            judge: "judge_telemetry",
            tell: "tell_telemetry",
            fields: &FIELDS,
        });

const FIELDS: [LuaField; 2] = [
    field(
        "tele_length",
        "uint16",
        "hilrig.telemetry.length",
        "Payload length",
    ),
    field(
        "tele_payload",
        "string",
        "hilrig.telemetry.payload",
        "Payload",
    ),
];

/// The telemetry link.
#[derive(Clone, Copy, Debug)]
pub struct Telemetry;

/// A frame with its escapes.
#[derive(Clone, Debug)]
pub struct Escaped {
    frame: telemetry::Frame,
    bytes: Vec<u8>,
}

/// Values of the first choice of a built frame: from this value on, the frame contains a
/// telecommand; from [`LONG`] on, many arbitrary bytes; below both, a few arbitrary bytes.
const COMMANDS: u8 = 208;
const LONG: u8 = 240;

/// A telecommand with some random fields and small values. It sets no pose, because the robot would
/// have to believe it.
fn command(choices: &mut Choices<'_>) -> Vec<u8> {
    let small = |byte: u8| f32::from(byte.cast_signed()) / 100.0;
    let fields = choices.byte();
    let has = |bit: u8| fields & 1 << bit != 0;
    let state = State::ALL[choices.below(State::ALL.len())];
    let [x, y, turn] = [0; 3].map(|_| small(choices.byte()));
    let pose = Pose { x, y, alpha: turn };
    let velocities = Velocities {
        linear_m_s: x,
        angular_rad_s: turn,
    };
    let lidar_step_deg = u32::from(choices.byte());
    let command = Telecommand {
        timestamp_ms: choices.word().into(),
        lidar_step_deg: has(0).then_some(lidar_step_deg),
        state: has(1).then_some(state),
        velocities: has(1).then_some(velocities),
        desired_pose: has(1).then_some(pose),
        lines: has(2).then_some(LinesRequest::default()),
        ..Telecommand::default()
    };
    let mut payload = vec![0; PAYLOAD_MAX];
    let len = command.encode(&mut payload).unwrap_or_default();
    payload.truncate(len);
    payload
}

/// Finds frames and keeps their escapes.
#[derive(Clone, Debug, Default)]
pub struct Decoder(telemetry::Decoder);

impl Decode for Decoder {
    type Frame = Escaped;

    fn step(&mut self, input: &mut &[u8]) -> Option<Result<Escaped, FrameError>> {
        let outcome = self.0.step(input)?;
        Some(outcome.map(|frame| {
            let bytes = encoded(frame.payload());
            Escaped { frame, bytes }
        }))
    }

    fn idle(&mut self) {
        self.0.idle();
    }

    fn pending(&self) -> usize {
        self.0.pending()
    }

    fn discarded(&self) -> u64 {
        self.0.discarded()
    }
}

impl Wire for Telemetry {
    type Decoder = Decoder;
    const NAME: &'static str = "telemetry";

    fn decoder() -> Decoder {
        Decoder::default()
    }

    fn bytes(frame: &Escaped) -> &[u8] {
        &frame.bytes
    }

    fn words(frame: &Escaped) -> String {
        words::of(frame.frame.payload())
    }

    fn is_plausible(frame: &Escaped) -> bool {
        words::is_message(frame.frame.payload())
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let len = match choices.byte() {
            COMMANDS..LONG => return out.extend(encoded(&command(choices))),
            most @ 0..COMMANDS => usize::from(most % 24),
            most => 200 * usize::from(most - (LONG - 1)),
        };
        let mut payload = choices.take(len).to_vec();
        payload.resize(len, START);
        out.extend(encoded(&payload));
    }

    fn repair(frame: &mut [u8]) {
        let plain = unescaped(frame.get(1..).unwrap_or_default());
        let Some(payload) = plain.len().checked_sub(1).and_then(|end| plain.get(2..end)) else {
            return;
        };
        // A payload that needs more or fewer escapes than the frame has stays unchanged.
        let made = encoded(payload);
        if made.len() == frame.len() {
            frame.copy_from_slice(&made);
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let mut rest = bytes.strip_prefix(&[0x7E])?.iter();
        let mut next = || match rest.next()? {
            0x7E => None,
            0x7D => match rest.next()? {
                0x5E => Some((2, 0x7E)),
                0x5D => Some((2, 0x7D)),
                _ => None,
            },
            &plain => Some((1, plain)),
        };
        let ((high_len, high), (low_len, low)) = (next()?, next()?);
        let payload_len = 256 * usize::from(high) + usize::from(low);
        if payload_len > 3_200 {
            return None;
        }
        let (mut len, mut sum) = (1 + high_len + low_len, 0_u8);
        for _ in 0..=payload_len {
            let (wire_len, plain) = next()?;
            len += wire_len;
            sum = sum.wrapping_add(plain);
        }
        // The payload and the checksum add up to FF.
        (sum == 0xFF).then_some(len)
    }

    fn means_itself(frame: &Escaped) -> Result<(), Broken> {
        let mut decoder = telemetry::Decoder::default();
        let again = decoder.push(&frame.bytes).find_map(Result::ok);
        let payload = again.as_ref().map(telemetry::Frame::payload);
        made_again(frame.frame.payload(), payload.unwrap_or_default())
    }

    fn kind(frame: &Escaped) -> u64 {
        let (len, escapes) = (frame.frame.payload().len(), frame.bytes.len());
        let size = u64::from(usize::BITS - len.leading_zeros());
        size << 8 | u64::from(escapes > len + 4)
    }
}

/// The frame of `payload`; empty if the payload is too long.
fn encoded(payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0; 1 + 2 * (payload.len().min(PAYLOAD_MAX) + 3)];
    let len = telemetry::encode(payload, &mut bytes).unwrap_or_default();
    bytes.truncate(len);
    bytes
}

/// `bytes` without escapes, valid or not.
fn unescaped(bytes: &[u8]) -> Vec<u8> {
    let mut plain = Vec::new();
    let mut bytes = bytes.iter().copied();
    while let Some(byte) = bytes.next() {
        let is_escape = byte == ESCAPE;
        plain.extend(if is_escape {
            bytes.next().map(|byte| byte ^ 0x20)
        } else {
            Some(byte)
        });
    }
    plain
}
