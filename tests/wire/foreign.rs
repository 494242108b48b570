//! Streams of unknown formats: none may be recognised as a format of the table.
//!
//! Public protocols are laid out after their public descriptions, with valid checksums, because
//! their structure resembles that of others. The rest are patterns that short unchecked frames fit.

use hilrig::capture::decode::transcript::Transcript;
use hilrig::capture::{Interface, Kind, Record};
use hilrig::codec;
use hilrig::rig::line::Direction;
use protocols::Instant;

/// Bytes that look random; the same ones every time.
struct Noise(u64);

impl Noise {
    fn byte(&mut self) -> u8 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.0 >> 33).to_le_bytes()[0]
    }
}

fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

fn xor(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}

/// CRC-8 with any polynomial, the highest bit first.
fn crc8(bytes: &[u8], polynomial: u8) -> u8 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc, _| {
            let carry = crc & 0x80 != 0;
            crc << 1 ^ if carry { polynomial } else { 0 }
        })
    })
}

/// CRC-16 of Modbus.
fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| {
            let carry = crc & 1 != 0;
            crc >> 1 ^ if carry { 0xA001 } else { 0 }
        })
    })
}

/// A triangle wave with `step`s of a circle of 1000, between 0 and 2000.
fn wave(step: usize) -> u16 {
    let at = u16::try_from(step * 17 % 4_000).expect("below 4000");
    if at < 2_000 { at } else { 4_000 - at }
}

fn low(value: usize) -> u8 {
    value.to_le_bytes()[0]
}

/// Many messages, each of its number.
fn many(count: usize, message: impl Fn(usize) -> Vec<u8>) -> Vec<u8> {
    (0..count).flat_map(message).collect()
}

fn with_sum(bytes: &[u8]) -> Vec<u8> {
    [bytes, &[sum(bytes)]].concat()
}

/// LD06: 54 2C, speed, angle, twelve readings of distance and strength, angle, time, CRC-8.
fn ld06(n: usize) -> Vec<u8> {
    let mut out = vec![0x54, 0x2C, 0x10, 0x0E];
    out.extend((wave(n) * 9).to_le_bytes());
    for reading in 0..12 {
        out.extend((1_500 + wave(n + reading) / 2).to_le_bytes());
        out.push(200 + low(reading));
    }
    out.extend((wave(n) * 9 + 900).to_le_bytes());
    out.extend([low(n * 3), low(n / 80)]);
    out.push(crc8(&out, 0x4D));
    out
}

/// COIN-D4 and YDLIDAR: AA 55, kind, count, two angles, exclusive or, readings.
fn aa55(n: usize) -> Vec<u8> {
    let mut out = vec![0xAA, 0x55, 0, 40];
    out.extend(((wave(n) * 11) | 1).to_le_bytes());
    out.extend((wave(n) * 11 + 761).to_le_bytes());
    let readings: Vec<u8> = (0..40)
        .flat_map(|at| (3_600 + wave(n + at)).to_le_bytes())
        .collect();
    out.extend([xor(&readings), xor(&out)]);
    out.extend(readings);
    out
}

/// UBX: B5 62, class, number, length, payload, Fletcher's two sums.
fn ubx(n: usize) -> Vec<u8> {
    let mut out = vec![0x01, 0x07, 92, 0];
    out.extend((0..92).map(|at| low(if at < 8 { n * (at + 1) } else { at * 3 })));
    let (mut a, mut b) = (0_u8, 0_u8);
    for byte in &out {
        a = a.wrapping_add(*byte);
        b = b.wrapping_add(a);
    }
    [&[0xB5, 0x62][..], &out, &[a, b]].concat()
}

fn nmea(n: usize) -> Vec<u8> {
    let text = format!(
        "GPGGA,1212{:02}.00,4712.3456,N,00830.1234,E,1,08,1.0,450.{},M,48.0,M,,",
        n % 60,
        n % 10
    );
    format!("${text}*{:02X}\r\n", xor(text.as_bytes())).into_bytes()
}

fn modbus(n: usize) -> Vec<u8> {
    let mut out = vec![1, 3, 8, 0, 230 + low(n % 5), 0, 50, 0, low(n), 3, 0xE8];
    out.extend(crc16(&out).to_le_bytes());
    out
}

/// MAVLink 2's frame of an attitude; the sum's kind does not matter here.
fn mavlink(n: usize) -> Vec<u8> {
    let mut out = vec![0xFD, 28, 0, 0, low(n), 1, 1, 30, 0, 0];
    out.extend((n * 50).to_le_bytes().iter().take(4));
    (0..6).for_each(|at| out.extend((f32::from(wave(n + at)) / 700.0).to_le_bytes()));
    out.extend(crc16(&out).to_le_bytes());
    out
}

/// Sixteen channels of eleven bits behind 0F, two bytes of flags.
fn sbus(n: usize) -> Vec<u8> {
    let mut bits: Vec<bool> = Vec::new();
    for channel in 0..16 {
        let value = 172 + wave(n + 10 * channel) * 4 / 5;
        bits.extend((0..11).map(|bit| value >> bit & 1 == 1));
    }
    let byte = |bits: &[bool]| {
        bits.iter()
            .rev()
            .fold(0_u8, |byte, bit| byte << 1 | u8::from(*bit))
    };
    let mut out = vec![0x0F];
    out.extend(bits.chunks(8).map(byte));
    out.extend([0, 0]);
    out
}

/// The streams, each with its name.
fn streams() -> Vec<(&'static str, Vec<u8>)> {
    let mut noise = Noise(7);
    let random: Vec<u8> = (0..8_192).map(|_| noise.byte()).collect();
    vec![
        ("LD06", many(200, ld06)),
        ("COIN-D4", many(120, aa55)),
        ("UBX", many(60, ubx)),
        ("NMEA", many(120, nmea)),
        ("Modbus RTU", many(200, modbus)),
        ("MAVLink", many(150, mavlink)),
        (
            "DMX512",
            many(12, |n| {
                (0..513)
                    .map(|at| {
                        if at == 0 || at > 40 {
                            0
                        } else {
                            low(at * 3 + n)
                        }
                    })
                    .collect()
            }),
        ),
        ("SBUS", many(200, sbus)),
        (
            "CRSF",
            many(200, |n| {
                let body = [&[0x16], &sbus(n)[1..23]].concat();
                [&[0xC8, 24][..], &body, &[crc8(&body, 0xD5)]].concat()
            }),
        ),
        (
            "TFmini",
            many(400, |n| {
                with_sum(&[0x59, 0x59, low(120 + n % 40), 0, low(n), 11, 0x34, 8])
            }),
        ),
        (
            "Roomba stream",
            many(200, |n| {
                let out = [19, 5, 29, 2, low(25 + n % 3), 13, low(n & 1)];
                [&out[..], &[sum(&out).wrapping_neg()]].concat()
            }),
        ),
        (
            "Roomba commands",
            many(300, |n| {
                vec![
                    137,
                    0,
                    200,
                    0x80,
                    0,
                    145,
                    0,
                    low(n % 200),
                    0,
                    low(n * 3 % 200),
                ]
            }),
        ),
        (
            "Dynamixel",
            many(200, |n| {
                let body = [low(n % 5 + 1), 5, 3, 30, low(n * 5), low(n / 64)];
                [&[0xFF, 0xFF][..], &body, &[!sum(&body)]].concat()
            }),
        ),
        (
            "VESC",
            many(200, |n| {
                let body = [5, 0, 0, low(n / 3), low(n * 100)];
                [&[2, 5][..], &body, &crc16(&body).to_be_bytes(), &[3]].concat()
            }),
        ),
        (
            "hoverboard",
            many(300, |n| {
                vec![
                    0xCD,
                    0xAB,
                    low(n),
                    0,
                    low(n * 2),
                    1,
                    low(n * 3) ^ 0xCD,
                    0xAA,
                ]
            }),
        ),
        (
            "PMS5003",
            many(200, |n| {
                let mut out = vec![0x42, 0x4D, 0, 28];
                (0..13).for_each(|at| out.extend([0, low(10 + n % 5 + at)]));
                let sum: u16 = out.iter().map(|&byte| u16::from(byte)).sum();
                [&out[..], &sum.to_be_bytes()].concat()
            }),
        ),
        (
            "MH-Z19",
            many(300, |n| with_sum(&[0xFF, 0x86, 2, low(n), 60, 0, 0, 0])),
        ),
        (
            "WT901",
            many(600, |n| {
                with_sum(&[0x55, 0x51 + low(n % 3), low(n), 0, 50, 0, 0, 8, 0x28, 10])
            }),
        ),
        (
            "XBee",
            many(200, |n| {
                let body = [0x81, 0, 1, 40, 0, low(n & 127), 5, 6, 7];
                [&[0x7E, 0, 9][..], &body, &[!sum(&body)]].concat()
            }),
        ),
        (
            "MIDI",
            many(600, |n| {
                vec![0x90, 40 + low(n % 40), 64, 0x80, 40 + low(n % 40), 0]
            }),
        ),
        (
            "seven bits behind a mark",
            many(400, |n| {
                let mut out = vec![0x80 | low(n % 16), low(n & 0x7F), low((n * 3) & 0x7F), 0x80];
                out.extend((0..11).map(|at| low((n + at) & 0x7F)));
                out
            }),
        ),
        (
            "COBS",
            many(200, |n| {
                (0..9)
                    .map(|at| {
                        [8, low(1 + n * at % 255), 0][usize::from(at > 0) + usize::from(at == 8)]
                    })
                    .collect()
            }),
        ),
        (
            "SCIP",
            many(200, |n| {
                [
                    (0..64).map(|at| 48 + low((n + at * 7) % 64)).collect(),
                    b"A\n".to_vec(),
                ]
                .concat()
            }),
        ),
        (
            "ROS serial",
            many(200, |n| {
                let body: Vec<u8> = (0..8).map(|at| low(n + at)).collect();
                [
                    &[0xFF, 0xFE, 8, 0, 0xF7, 125, 0][..],
                    &body,
                    &[!sum(&body).wrapping_add(125)],
                ]
                .concat()
            }),
        ),
        (
            "text",
            b"Boot 1.2.3 ok\r\nsensor init: done\r\nmotor: idle, bus 12.3 V\r\n".repeat(40),
        ),
        (
            "table",
            many(400, |n| {
                format!("{n},{},{}.5\r\n", n * 3 % 100, n / 10).into_bytes()
            }),
        ),
        ("zeros", vec![0; 4_096]),
        ("ones", vec![0xFF; 4_096]),
        ("counter", (0..=255).collect::<Vec<u8>>().repeat(16)),
        ("words", many(3_000, |n| vec![low(n), low(n / 256)])),
        (
            "slow wave",
            many(3_000, |n| (wave(n / 20) * 16).to_le_bytes().to_vec()),
        ),
        ("noise", random.clone()),
        (
            "noise of seven bits",
            random.iter().map(|byte| byte & 0x7F).collect(),
        ),
    ]
}

/// The format that a transcript recognises in the bytes, fed in pieces with pauses or without.
fn taken_for(bytes: &[u8], piece: usize, pause_ms: u64) -> Option<&'static str> {
    let mut transcript = Transcript::new(None);
    let link = Interface::new("x", 115_200);
    for (bytes, number) in bytes.chunks(piece).zip(1..) {
        let record = Record {
            link: 0,
            sequence: None,
            at: Instant::from_millis(number * pause_ms),
            direction: Direction::ToMaster,
            kind: Kind::Data,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        transcript.record(&record, &link);
    }
    let _ = transcript.finish().count();
    let sum = transcript.sums().next().expect("a lane");
    sum.codec.map(|codec| codec.name())
}

#[test]
fn no_foreign_stream_is_taken_for_a_known_format() {
    let streams = streams();
    assert!(streams.len() >= 20);
    for (name, bytes) in &streams {
        for len in [64, 256, 1_024, bytes.len()] {
            let guess = codec::guess(&bytes[..len.min(bytes.len())]);
            assert_eq!(guess, None, "{name}, the first {len} bytes");
        }
        // Together, and in pieces that are far apart as of a poll each 100 ms.
        for (piece, pause, len) in [(37, 3, 5_000), (29, 100, 1_500)] {
            let bytes = &bytes[..len.min(bytes.len())];
            assert_eq!(
                taken_for(bytes, piece, pause),
                None,
                "{name}, pieces of {piece}"
            );
        }
    }
}

/// Proof of the recognition's minimum share: without it most of the streams have frames of some
/// format.
#[test]
fn foreign_streams_have_frames_of_known_formats_by_chance() {
    let has_frames = |bytes: &[u8]| codec::all().iter().any(|row| row.framed(bytes) > 0);
    let with = streams()
        .iter()
        .filter(|(_, bytes)| has_frames(bytes))
        .count();
    assert!(
        with >= 15,
        "only {with} streams have any frame: they prove nothing"
    );
}
