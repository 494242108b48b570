//! Each damage is applied to a sound stream and must be diagnosed; the sound stream must not be.

use emulators::rng::Rng;
use protocols::avr::ChecksumOrder::{HighFirst, LowFirst};
use protocols::avr::{self, ChecksumOrder};
use protocols::xv11::{self, RawReading, Reading, SpeedWord};

use super::*;
use engine::codec::{BUS, BUS_HIGH_FIRST};

/// Thousands of packets of a lidar, with all distances that occur in a room.
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

/// Bytes that a receiver reads at `factor` times the sender's rate, bit by bit.
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
        // All frames are counted; a checksum with two equal bytes is correct in both orders.
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

/// Text may lack any value: 19 of 20 bytes must be printable characters, tabs or line ends.
#[test]
fn a_twentieth_of_text_may_be_anything() {
    let is_text = |bytes: &[u8]| Counts::of(bytes).is_text();
    let edges = [0x08, 0x09, 0x0A, 0x0B, 0x0D, 0x1F, 0x20, 0x7E, 0x7F, 0x80];
    let expected = [
        false, true, true, false, true, false, true, true, false, false,
    ];
    assert_eq!(edges.map(|byte| is_text(&[byte])), expected);
    let mixed = |other: usize| [vec![b'a'; 20 - other], vec![0; other]].concat();
    assert_eq!([1, 2].map(|other| is_text(&mixed(other))), [true, false]);
}

/// The neighbours of 13 and 17 occur 1, 2, 3 and 6 times: 3 on average.
#[test]
fn values_are_counted_one_by_one() {
    let around = [
        vec![12; 1],
        vec![14; 2],
        vec![16; 3],
        vec![18; 6],
        vec![13; 9],
    ]
    .concat();
    let counts = Counts::of(&around);
    assert_eq!(
        (counts.len(), counts.of_value(13), counts.around(13, 17)),
        (21, 9, 3)
    );
    assert_eq!(Counts::of(&[0x7F, 0x80, 0xFF]).high(), 2);
}

/// 95 of 100 pairs consist of equal bytes, with at least four values; the pairs may begin with the
/// second byte.
#[test]
fn nearly_all_bytes_are_doubled() {
    let pairs = |values: u8, unequal: u8| -> Vec<u8> {
        let pair = |at: u8| [at % values, at % values + if at < unequal { 99 } else { 0 }];
        (0..100).flat_map(pair).collect()
    };
    let found = |equal| Some(Damage::Doubled { equal, pairs: 100 });
    assert_eq!(
        [5, 6].map(|unequal| doubled(&pairs(4, unequal))),
        [found(95), None]
    );
    assert_eq!(
        [3, 4].map(|values| doubled(&pairs(values, 0))),
        [None, found(100)]
    );
    assert_eq!(doubled(&[&[77], &pairs(4, 0)[..]].concat()), found(100));
}

/// Swapped pairs are diagnosed if the swap gives frames of four fifths of all bytes, although a
/// fifth has valid frames without it.
#[test]
fn places_are_changed_where_that_makes_a_stream_sound() {
    let mut frames = lidar()[..2_200].to_vec();
    frames.chunks_exact_mut(2).for_each(|pair| pair.swap(0, 1));
    let swapped = |noise: usize, framed| {
        let bytes = [&frames[..], &vec![1; noise]].concat();
        swapped(&bytes, framed)
    };
    let found = |bytes| {
        let framed = 2_200;
        Some(Damage::Swapped { framed, bytes })
    };
    assert_eq!(
        [440, 441].map(|framed| swapped(0, framed)),
        [found(2_200), None]
    );
    assert_eq!(
        [550, 552].map(|noise| swapped(noise, 0)),
        [found(2_750), None]
    );
}

/// At least eight frames are correct in the other order, more than ten times as many as in the
/// expected order.
#[test]
fn a_checksum_has_the_other_order_if_ten_times_as_many_hold() {
    let frames = lidar();
    let found = |wrong: usize, right: usize| {
        let mut bytes = frames[..22 * (wrong + right)].to_vec();
        let frames = bytes.chunks_exact_mut(22).take(wrong);
        frames.for_each(|frame| frame.swap(20, 21));
        other_order(&bytes, None).is_some()
    };
    assert_eq!([found(7, 0), found(8, 0)], [false, true]);
    assert_eq!(
        [found(10, 1), found(11, 1), found(20, 2), found(21, 2)],
        [false, true, false, true]
    );
}

/// Nine of ten frames come back, at least eight, each within the next sixteen received frames.
#[test]
fn an_echo_is_nearly_all_that_was_sent() {
    let frames = |register: u8, count: u8| -> Vec<Vec<u8>> {
        let frame = |n: u8| avr::Frame::write(register, &[n, 200 - n, 3], LowFirst);
        (0..count).map(|n| frame(n).as_bytes().to_vec()).collect()
    };
    let replies = frames(36, 60);
    let echo = |before: usize, lost: usize, sent: u8| {
        let requests = frames(46, sent);
        let arrived = [&replies[..before], &requests[lost..], &replies[before..]].concat();
        echoed(&arrived.concat(), &requests.concat())
    };
    let found = |back, sent| Some(Damage::Echo { back, sent });
    assert_eq!([echo(0, 0, 7), echo(0, 0, 8)], [None, found(8, 8)]);
    assert_eq!(
        [echo(0, 2, 11), echo(0, 1, 10), echo(0, 2, 20)],
        [None, found(9, 10), found(18, 20)]
    );
    assert_eq!([echo(15, 0, 10), echo(16, 0, 10)], [found(10, 10), None]);
}

/// Start bit and zeros make a run of 8, 6, 4, 3 or 2 bits, and ones the rest; a slower sender makes
/// no runs of 7 and 5. This holds for 95 of 100 bytes with at least two values.
#[test]
fn a_slow_sender_stretches_nearly_all_bytes() {
    let found = |stretched: &[u8], other: usize| {
        let stretched = stretched.iter().copied().cycle().take(100 - other);
        let bytes: Vec<u8> = stretched.chain(vec![0x55; other]).collect();
        slow_sender(&bytes)
    };
    let slow = |factor| {
        Some(Damage::SlowSender {
            factor,
            stretched: 95,
            bytes: 100,
        })
    };
    let runs = [0x80, 0xC0, 0xE0, 0xF0, 0xF8, 0xFC, 0xFE, 0xFF].map(|byte| found(&[byte], 5));
    let factors = [
        Some(8),
        None,
        Some(6),
        None,
        Some(4),
        Some(3),
        Some(2),
        None,
    ];
    assert_eq!(runs, factors.map(|factor| factor.and_then(slow)));
    // Bytes with runs of 2, 2, 2, and of 2, 4, 2 equal bits.
    assert_eq!(
        [5, 6].map(|other| found(&[0xE6, 0x9E], other)),
        [slow(2), None]
    );
    assert_eq!(found(&[0xE6], 0), None);
}

/// A line end counts as replaced if its neighbours occur 20 times or more, and the other line end
/// occurs half as often again. With rarer neighbours there is no diagnosis.
#[test]
fn what_is_missing_is_told_from_its_limits_on() {
    let of = |counts: &[(u8, usize)]| {
        let bytes = counts.iter().map(|(value, count)| vec![*value; *count]);
        missing(&Counts::of(&bytes.collect::<Vec<_>>().concat()))
    };
    let ends = |beside: usize, feeds: usize, returns: usize| {
        let sides = [0x09, 0x0B, 0x0C, 0x0E].map(|value| (value, beside));
        of(&[&sides[..], &[(0x0A, feeds), (0x0D, returns)]].concat())
    };
    let to_feed = |found, expected| vec![Damage::CrToLf { found, expected }];
    assert_eq!(ends(40, 60, 0), to_feed(60, 40));
    assert_eq!(ends(20, 30, 0), to_feed(30, 20));
    assert!(
        [ends(40, 59, 0), ends(40, 60, 1), ends(19, 60, 0)]
            .iter()
            .all(Vec::is_empty)
    );
    let flow = |beside: usize, on: usize, off: usize| {
        let sides = [0x10, 0x12, 0x14].map(|value| (value, beside));
        of(&[&sides[..], &[(0x11, on), (0x13, off)]].concat())
    };
    assert_eq!(flow(20, 0, 0), [Damage::FlowControl { expected: 20 }]);
    assert!(
        [flow(19, 0, 0), flow(20, 1, 0), flow(20, 0, 1)]
            .iter()
            .all(Vec::is_empty)
    );
    let high = |count: usize, nuls: usize| of(&[(0xF0, count), (0, nuls)]);
    assert_eq!(high(5_120, 0), [Damage::NulStripped { expected: 20 }]);
    assert!([high(5_119, 0), high(5_120, 1)].iter().all(Vec::is_empty));
    let low = |count: usize, high: usize| of(&[(1, count), (0x80, high)]);
    assert_eq!(low(512, 0), [Damage::SevenBits { bytes: 512 }]);
    assert!([low(511, 0), low(511, 1)].iter().all(Vec::is_empty));
}

/// 62 bytes are too few for a diagnosis, 64 are enough.
#[test]
fn a_few_bytes_have_no_diagnosis() {
    let doubled = |pairs: u8| -> Vec<u8> { (0..pairs).flat_map(|n| [0x80 + n; 2]).collect() };
    assert_eq!(of(&doubled(31)), []);
    let (equal, pairs) = (32, 32);
    assert_eq!(of(&doubled(32)), [Damage::Doubled { equal, pairs }]);
}

/// The neighbours of 13 and 17 occur 4, 8, 12 and 20 times: 11 on average.
#[test]
fn each_neighbour_counts_once() {
    let around = [12, 14, 16, 18].into_iter().zip([4, 8, 12, 20]);
    let bytes: Vec<u8> = around
        .flat_map(|(value, count)| vec![value; count])
        .collect();
    assert_eq!(Counts::of(&bytes).around(13, 17), 11);
}
