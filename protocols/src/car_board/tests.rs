//! Vectors by hand and the laws of the decoder.

extern crate std;

use std::vec::Vec;

use proptest::collection::vec;
use proptest::prelude::*;

use super::*;
use crate::tty::InputMode;
use crate::{Decode, FrameError};

fn decode(bytes: &[u8]) -> Vec<Frame> {
    let mut decoder = Decoder::default();
    let mut frames: Vec<_> = decoder.push(bytes).filter_map(Result::ok).collect();
    decoder.idle();
    frames.extend(decoder.push(&[]).filter_map(Result::ok));
    frames
}

fn fielded(bytes: &[u8]) -> Vec<Frame> {
    let mut decoder = FieldedDecoder::default();
    bytes
        .iter()
        .filter_map(|byte| decoder.push(*byte))
        .collect()
}

/// All 21 levels are 80 to 94, all 101 steering values 00 to 64: the offsets are 10 and 50.
#[test]
fn ap1_every_command_is_one_byte_and_comes_back() {
    for (byte, level) in (0x80..=0x94).zip(-10..=10) {
        let command = Command::Motor(Level::new(level).unwrap());
        assert_eq!(command.encode(), byte);
        assert_eq!(Command::decode(byte), Ok(command));
    }
    for (byte, value) in (0x00..=0x64).zip(-50..=50) {
        let command = Command::Steering(Steering::new(value).unwrap());
        assert_eq!(command.encode(), byte);
        assert_eq!(Command::decode(byte), Ok(command));
    }
    assert_eq!(Command::Motor(Level::STOP).encode(), 0x8A);
    assert_eq!(Command::Steering(Steering::default()).encode(), 0x32);
}

#[test]
fn figures_out_of_range_are_told() {
    use CommandError as E;
    assert_eq!(Level::new(11), Err(E::Level { found: 11 }));
    assert_eq!(Level::new(-11), Err(E::Level { found: -11 }));
    assert_eq!(Level::new(256), Err(E::Level { found: 256 }));
    assert_eq!(Steering::new(51), Err(E::Steering { found: 51 }));
    assert_eq!(Steering::new(-51), Err(E::Steering { found: -51 }));
    assert_eq!(Command::decode(0x95), Err(E::Level { found: 11 }));
    assert_eq!(Command::decode(0xFF), Err(E::Level { found: 117 }));
    assert_eq!(Command::decode(0x65), Err(E::Steering { found: 51 }));
    assert_eq!(Command::decode(0x7F), Err(E::Steering { found: 77 }));
    let text = std::format!("{}", E::Level { found: 11 });
    assert_eq!(text, "motor level is 11, expected -10 to 10");
}

/// The values at both ends of the range and in its middle.
#[test]
fn a_steering_value_keeps_its_number() {
    let kept = |value| Steering::new(value).map(Steering::get);
    assert_eq!([-50, -1, 0, 50].map(kept), [-50, -1, 0, 50].map(Ok));
    assert!(kept(51).is_err() && kept(-51).is_err());
}

/// A frame with ranges of 13 cm, 200 cm and 150 cm, no line, 269 pulses and 7200 mV.
const VECTOR: [u8; FRAME_LEN] = [
    0x00, 0x0F, 0x0D, 0x00, 0xC8, 0x00, 0x96, 0x00, 0x00, 0x0D, 0x01, 0x20, 0x1C,
];
const VECTOR_READINGS: Readings = Readings {
    front_cm: 13,
    right_cm: 200,
    left_cm: 150,
    line: 0,
    hall: 269,
    battery_mv: 7_200,
};

#[test]
fn a_frame_is_laid_out_by_hand() {
    assert_eq!(VECTOR_READINGS.encode().as_bytes(), &VECTOR);
    let frames = decode(&VECTOR);
    assert_eq!(frames.len(), 1);
    assert_eq!(frames[0].readings(), VECTOR_READINGS);
    assert_eq!(fielded(&VECTOR), frames);
}

/// The vector was read through a pseudo-terminal with the fielded program's settings: 13 cm become
/// 10 cm, 269 pulses 266.
#[test]
fn ap2_a_carriage_return_becomes_a_newline_unless_the_terminal_is_raw() {
    let mut bytes = VECTOR;
    InputMode::CrToNl.apply(&mut bytes);
    let expected = [
        0x00, 0x0F, 0x0A, 0x00, 0xC8, 0x00, 0x96, 0x00, 0x00, 0x0A, 0x01, 0x20, 0x1C,
    ];
    assert_eq!(bytes, expected);
    let readings = decode(&bytes)[0].readings();
    assert_eq!((readings.front_cm, readings.hall), (10, 266));
    let mut bytes = VECTOR;
    InputMode::Raw.apply(&mut bytes);
    assert_eq!(decode(&bytes)[0].readings().front_cm, 13);
}

/// Of `00 00 0F` the fielded decoder loses the frame; ours does not.
#[test]
fn a_zero_before_the_sync_costs_the_fielded_decoder_the_frame() {
    let bytes = [&[0][..], &VECTOR, &VECTOR].concat();
    assert_eq!(decode(&bytes).len(), 2);
    assert_eq!(fielded(&bytes).len(), 1);
}

/// A front range of 40 cm before 15 cm to the right puts a sync at offset 3. From the middle of a
/// frame the fielded decoder stays there; ours detects the implausible values.
#[test]
fn a_sync_inside_a_frame_holds_the_fielded_decoder_for_ever() {
    let readings = Readings {
        front_cm: 40,
        right_cm: 15,
        ..VECTOR_READINGS
    };
    let frame = readings.encode();
    let stream: Vec<u8> = [frame; 8].iter().flat_map(|f| *f.as_bytes()).collect();
    let begun = &stream[1..];
    assert!(fielded(begun).iter().all(|found| *found != frame));
    assert_eq!(decode(begun), [frame; 7]);
}

/// A frame in which another valid frame begins three bytes later: 258 cm are 02 01, so the front
/// reads 0200 and the right 0001; a battery of 0x1C01, 7169 mV, makes the line 1; the next frame's
/// 28 cm make 0x1C0F.
const TWOFOLD: Readings = Readings {
    front_cm: 0x1C,
    right_cm: 15,
    left_cm: 258,
    line: 0,
    hall: 269,
    battery_mv: 0x1C01,
};

/// The frame's first byte is lost. The next frame shows the error, because it does not begin where
/// the decoder expects the end.
#[test]
fn the_next_frame_tells_where_the_one_before_ended() {
    let (twofold, other) = (TWOFOLD.encode(), VECTOR_READINGS.encode());
    let like = Readings {
        front_cm: 0x1C,
        ..VECTOR_READINGS
    };
    let frames = [twofold, like.encode(), other];
    let stream: Vec<u8> = frames.iter().flat_map(|f| *f.as_bytes()).collect();
    assert_eq!(decode(&stream[1..]), frames[1..]);
}

/// In a parked car all frames are equal: bytes alone do not show where frames begin, a pause does.
#[test]
fn a_pause_tells_where_frames_begin() {
    let frame = TWOFOLD.encode();
    let stream: Vec<u8> = [frame; 4].iter().flat_map(|f| *f.as_bytes()).collect();
    let begun = &stream[1..];
    assert!(!decode(begun).contains(&frame));
    let mut decoder = Decoder::default();
    let mut found = Vec::new();
    for piece in [&begun[..12], &begun[12..25], &begun[25..38], &begun[38..]] {
        found.extend(decoder.push(piece).filter_map(Result::ok));
        decoder.idle();
    }
    found.extend(decoder.push(&[]).filter_map(Result::ok));
    assert_eq!(found, [frame; 3]);
}

/// A range of 1101 cm, a line byte of 2, and voltages outside the band are rejected; values at the
/// limits are accepted.
#[test]
fn values_that_no_sensor_has_are_rejected_with_their_place() {
    let good = Readings {
        front_cm: 1_100,
        right_cm: 1_100,
        left_cm: 1_100,
        line: 1,
        hall: u16::MAX,
        battery_mv: 10_000,
    };
    assert_eq!(decode(good.encode().as_bytes()), [good.encode()]);
    let low = Readings {
        battery_mv: 4_000,
        ..good
    };
    assert_eq!(decode(low.encode().as_bytes()), [low.encode()]);
    let bad = [
        (
            2,
            1_101,
            Readings {
                front_cm: 1_101,
                ..good
            },
        ),
        (
            4,
            1_101,
            Readings {
                right_cm: 1_101,
                ..good
            },
        ),
        (
            6,
            1_101,
            Readings {
                left_cm: 1_101,
                ..good
            },
        ),
        (8, 2, Readings { line: 2, ..good }),
        (
            11,
            10_001,
            Readings {
                battery_mv: 10_001,
                ..good
            },
        ),
        (
            11,
            3_999,
            Readings {
                battery_mv: 3_999,
                ..good
            },
        ),
    ];
    for (at, found, readings) in bad {
        let mut decoder = Decoder::default();
        let frame = readings.encode();
        let outcome = decoder.push(frame.as_bytes()).next();
        assert_eq!(outcome, Some(Err(FrameError::Implausible { at, found })));
        assert_eq!(fielded(frame.as_bytes()), [frame], "nothing is checked");
    }
}

/// Values of a drive, with those that put a sync inside a frame as often as others.
fn readings() -> impl Strategy<Value = Readings> {
    let range = || prop_oneof![Just(15_u16), Just(13), 0..256_u16, 0..=ULTRASONIC_MAX_CM];
    (
        range(),
        range(),
        range(),
        0..=1_u8,
        any::<u16>(),
        6_400..=8_400_u16,
    )
        .prop_map(
            |(front_cm, right_cm, left_cm, line, hall, battery_mv)| Readings {
                front_cm,
                right_cm,
                left_cm,
                line,
                hall,
                battery_mv,
            },
        )
}

#[derive(Clone, Copy, Debug)]
enum Damage {
    Insert(u8),
    Delete,
    Flip(u8),
}

fn damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        any::<u8>().prop_map(Damage::Insert),
        Just(Damage::Delete),
        (1..=u8::MAX).prop_map(Damage::Flip),
    ]
}

fn damaged(frames: &[Frame], at: usize, damage: Damage) -> Vec<u8> {
    let mut bytes: Vec<u8> = frames.iter().flat_map(|f| *f.as_bytes()).collect();
    match damage {
        Damage::Insert(byte) => bytes.insert(at, byte),
        Damage::Delete => drop(bytes.remove(at)),
        Damage::Flip(mask) => bytes[at] ^= mask,
    }
    bytes
}

proptest! {
    /// After any damage to one byte, all frames from the second one behind the damaged frame are
    /// right, and the decoder returns no more frames than were sent.
    #[test]
    fn ap1_one_damaged_byte_costs_at_most_two_frames(
        readings in vec(readings(), 8),
        at in 26..52_usize,
        damage in damage(),
    ) {
        let frames: Vec<_> = readings.iter().map(Readings::encode).collect();
        let found = decode(&damaged(&frames, at, damage));
        let hit = at / FRAME_LEN;
        prop_assert!(found.len() <= frames.len());
        prop_assert!(found.ends_with(&frames[hit + 2..]), "{found:?}");
        prop_assert!(found.starts_with(&frames[..hit - 1]), "{found:?}");
    }

    #[test]
    fn ap1_pieces_do_not_matter(
        readings in vec(readings(), 1..5),
        at in 0..13_usize,
        damage in damage(),
        cuts in vec(1..20_usize, 1..30),
    ) {
        let frames: Vec<_> = readings.iter().map(Readings::encode).collect();
        let bytes = damaged(&frames, at, damage);
        let mut decoder = Decoder::default();
        let (mut rest, mut found) = (&bytes[..], Vec::new());
        for cut in cuts.into_iter().cycle() {
            let (piece, behind) = rest.split_at(cut.min(rest.len()));
            found.extend(decoder.push(piece).filter_map(Result::ok));
            rest = behind;
            if rest.is_empty() { break; }
        }
        decoder.idle();
        found.extend(decoder.push(&[]).filter_map(Result::ok));
        let discarded = usize::try_from(decoder.discarded()).unwrap();
        prop_assert_eq!(found.len() * FRAME_LEN + discarded, bytes.len());
        prop_assert_eq!(found, decode(&bytes));
    }

    #[test]
    fn ap1_no_bytes_make_a_decoder_panic(
        bytes in vec(prop_oneof![Just(0), Just(15), any::<u8>()], 0..200),
    ) {
        let _ = (decode(&bytes), fielded(&bytes));
        for byte in bytes {
            if let Ok(command) = Command::decode(byte) {
                prop_assert_eq!(command.encode(), byte);
            }
        }
    }
}

/// Small random numbers by which a stream is made and damaged: as the proptests above, but a
/// hundred thousand of them.
struct Dice(u64);

impl Dice {
    fn below(&mut self, most: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % most
    }

    /// Ranges of which many have the bytes of a sync.
    fn range(&mut self) -> u16 {
        let most = [16, 256, 1_101][usize::try_from(self.below(3)).unwrap()];
        u16::try_from(self.below(most)).unwrap()
    }

    fn readings(&mut self) -> Readings {
        Readings {
            front_cm: self.range(),
            right_cm: self.range(),
            left_cm: self.range(),
            line: u8::try_from(self.below(2)).unwrap(),
            hall: u16::try_from(self.below(65_536)).unwrap(),
            battery_mv: 6_800 + u16::try_from(self.below(1_600)).unwrap(),
        }
    }

    fn damage(&mut self) -> Damage {
        let byte = u8::try_from(self.below(256)).unwrap();
        match self.below(3) {
            0 => Damage::Insert(byte),
            1 => Damage::Delete,
            _ => Damage::Flip(byte.max(1)),
        }
    }
}

/// AP1: in the required number of streams, all frames from the second behind the damaged one are
/// right.
#[test]
fn ap1_a_hundred_thousand_damaged_streams_are_read_on() {
    let mut dice = Dice(0x9E37_79B9_7F4A_7C15);
    for case in 0..100_000 {
        let frames: Vec<Frame> = (0..6).map(|_| dice.readings().encode()).collect();
        let at = usize::try_from(26 + dice.below(26)).unwrap();
        let damage = dice.damage();
        let found = decode(&damaged(&frames, at, damage));
        let hit = at / FRAME_LEN;
        assert!(
            found.len() <= frames.len() && found.ends_with(&frames[hit + 2..]),
            "case {case}, {damage:?} at {at} of {frames:?}: {found:?}"
        );
    }
}

#[test]
fn levels_and_steering_values_are_their_numbers() {
    for number in -10..=10_i8 {
        assert_eq!(Level::new(number.into()).map(Level::get), Ok(number));
    }
    for number in -50..=50_i8 {
        assert_eq!(Steering::new(number.into()).map(Steering::get), Ok(number));
    }
}

/// Behind 13 bytes 00 0F must follow: the error names the position of the first other byte.
#[test]
fn a_frame_is_refused_where_no_other_follows() {
    let frame = *Readings {
        battery_mv: 7_400,
        ..Readings::default()
    }
    .encode()
    .as_bytes();
    let outcome = |behind: &[u8]| {
        let bytes = [&frame[..], behind].concat();
        Decoder::default().push(&bytes).next()
    };
    let (at, found) = (13, 0x01);
    assert_eq!(
        outcome(&[0x01]),
        Some(Err(FrameError::Implausible { at, found }))
    );
    let (at, found) = (14, 0x0E);
    assert_eq!(
        outcome(&[0x00, 0x0E]),
        Some(Err(FrameError::Implausible { at, found }))
    );
    assert_eq!(outcome(&[0x00]), None);
    assert_eq!(outcome(&SYNC), Frame::from_bytes(frame).map(Ok));
}
