//! Each damage is done to a sound stream, and must be named; the sound stream must not.

use emulators::rng::Rng;
use protocols::avr::ChecksumOrder::{HighFirst, LowFirst};
use protocols::avr::{self, ChecksumOrder};
use protocols::xv11::{self, RawReading, Reading, SpeedWord};

use super::*;
use crate::codec::{BUS, BUS_HIGH_FIRST};

/// Thousands of packets of a lidar, with all distances a room has.
fn lidar() -> Vec<u8> {
    let mut rng = Rng::stream(1, "lidar");
    let mut below = |n| u16::try_from(rng.below(n)).expect("small");
    let frames = (0..6000_u16).flat_map(|index| {
        let index = u8::try_from(index % 90).expect("below 90");
        let speed = SpeedWord(19_200 + below(64));
        let readings = core::array::from_fn(|_| match below(8) {
            0 => RawReading::from(Reading::Invalid {
                code: 0x35,
                strength: 0,
            }),
            _ => RawReading::from(Reading::Range {
                distance_mm: 150 + below(5000),
                strength: below(1000),
                weak: false,
            }),
        });
        *xv11::Frame::new(index, speed, readings).as_bytes()
    });
    frames.collect()
}

/// Requests to a base, and its replies.
fn base(order: ChecksumOrder) -> [Vec<u8>; 2] {
    let mut rng = Rng::stream(1, "base");
    let (mut requests, mut replies) = (Vec::new(), Vec::new());
    for _ in 0..200 {
        let data: [u8; 10] = core::array::from_fn(|_| rng.below(256).to_le_bytes()[0]);
        requests.extend_from_slice(avr::Frame::read(36, 10, order).as_bytes());
        requests.extend_from_slice(avr::Frame::write(46, &data[..3], order).as_bytes());
        replies.extend_from_slice(avr::Frame::write(36, &data, order).as_bytes());
        replies.extend_from_slice(avr::Frame::read(46, 0, order).as_bytes());
    }
    [requests, replies]
}

fn of(bytes: &[u8]) -> Vec<Damage> {
    diagnose(&Line {
        bytes,
        ..Line::default()
    })
}

/// What a receiver reads whose rate is `factor` times the sender's: bit by bit.
fn read_fast(bytes: &[u8], factor: usize) -> Vec<u8> {
    let characters = bytes.iter().map(|&byte| u16::from(byte) << 1 | 0x200);
    let bits: Vec<bool> = characters
        .flat_map(|bits| (0..10).map(move |at| bits >> at & 1 == 1))
        .flat_map(|bit| core::iter::repeat_n(bit, factor))
        .collect();
    let (mut out, mut at) = (Vec::new(), 0);
    while at + 10 <= bits.len() {
        let falls = !bits[at] && (at == 0 || bits[at - 1]);
        if !falls {
            at += 1;
        } else if bits[at + 9] {
            let data = bits[at + 1..at + 9].iter().rev();
            out.push(data.fold(0, |byte, &bit| byte << 1 | u8::from(bit)));
            at += 9;
        } else {
            at += 1;
        }
    }
    out
}

#[test]
fn sound_streams_are_not_accused() {
    assert_eq!(of(&lidar()), []);
    for order in [LowFirst, HighFirst] {
        let [requests, replies] = base(order);
        for (bytes, opposite) in [(&requests, &replies), (&replies, &requests)] {
            let line = Line {
                bytes,
                opposite,
                ..Line::default()
            };
            assert_eq!(diagnose(&line), []);
        }
    }
    let boot = b"Piccolo Laser Distance Scanner\n\rCopyright (c) 2009-2010 Neato\n\r".repeat(200);
    assert_eq!(of(&boot), []);
    assert_eq!(of(&[]), []);
    assert_eq!(of(&[0xFA; 5000]), [], "a stuck line has no damage to show");
}

#[test]
fn a_stripped_nul_is_named() {
    let bytes: Vec<u8> = lidar().into_iter().filter(|&byte| byte != 0).collect();
    let expected = bytes.len() as u64 / 256;
    assert_eq!(of(&bytes), [Damage::NulStripped { expected }]);
}

#[test]
fn a_translated_carriage_return_is_named() {
    let turned = |byte| if byte == 0x0D { 0x0A } else { byte };
    let bytes: Vec<u8> = lidar().into_iter().map(turned).collect();
    assert!(matches!(of(&bytes)[..], [Damage::CrToLf { .. }]));
}

#[test]
fn eaten_flow_control_is_named() {
    let eaten = |byte: &u8| !matches!(byte, 0x11 | 0x13);
    let bytes: Vec<u8> = lidar().into_iter().filter(eaten).collect();
    assert!(matches!(of(&bytes)[..], [Damage::FlowControl { .. }]));
}

#[test]
fn a_line_of_seven_bits_is_named() {
    let bytes: Vec<u8> = lidar().into_iter().map(|byte| byte & 0x7F).collect();
    let len = bytes.len() as u64;
    assert_eq!(of(&bytes), [Damage::SevenBits { bytes: len }]);
}

#[test]
fn a_wrong_rate_is_named_by_its_factor_or_by_framing_errors() {
    for factor in [2_u32, 3, 4] {
        let bytes = read_fast(&lidar(), factor as usize);
        let found = of(&bytes);
        let is = |one: &Damage| matches!(one, Damage::SlowSender { factor: f, .. } if *f == factor);
        assert!(found.len() == 1 && is(&found[0]), "{factor}: {found:?}");
    }
    let line = Line {
        bytes: &lidar()[..1000],
        framing_errors: 300,
        ..Line::default()
    };
    let (errors, bytes) = (300, 1000);
    assert_eq!(diagnose(&line), [Damage::FramingErrors { errors, bytes }]);
}

#[test]
fn an_echo_is_named() {
    let [requests, replies] = base(LowFirst);
    let both = requests.chunks(13).zip(replies.chunks(20));
    let bytes: Vec<u8> = both.flat_map(|(a, b)| [a, b].concat()).collect();
    let line = Line {
        bytes: &bytes,
        opposite: &requests,
        ..Line::default()
    };
    let (back, sent) = (400, 400);
    assert_eq!(diagnose(&line), [Damage::Echo { back, sent }]);
}

#[test]
fn doubled_bytes_are_named() {
    let bytes: Vec<u8> = lidar().into_iter().flat_map(|byte| [byte, byte]).collect();
    let pairs = SAMPLE as u64 / 2;
    let equal = pairs;
    assert_eq!(of(&bytes), [Damage::Doubled { equal, pairs }]);
}

#[test]
fn swapped_bytes_are_named() {
    let mut bytes = lidar();
    bytes.chunks_exact_mut(2).for_each(|pair| pair.swap(0, 1));
    assert!(matches!(of(&bytes)[..], [Damage::Swapped { .. }]));
    bytes.insert(0, 0x55);
    assert!(
        matches!(of(&bytes)[..], [Damage::Swapped { .. }]),
        "one byte later"
    );
}

#[test]
fn a_checksum_the_other_way_round_is_named() {
    let mut bytes = lidar();
    bytes
        .chunks_exact_mut(22)
        .for_each(|frame| frame.swap(20, 21));
    assert!(matches!(of(&bytes)[..], [Damage::ChecksumOrder { .. }]));

    for (order, codec) in [(LowFirst, &BUS_HIGH_FIRST), (HighFirst, &BUS)] {
        let [requests, _] = base(order);
        let line = Line {
            bytes: &requests,
            codec: Some(codec),
            ..Line::default()
        };
        // All of them; a sum whose bytes are equal holds both ways.
        let found = diagnose(&line);
        let [
            Damage::ChecksumOrder {
                other: 400,
                expected,
            },
        ] = found[..]
        else {
            panic!("{}: {found:?}", codec.name())
        };
        assert!(expected < 8, "{expected} sums of two equal bytes");
    }
}
