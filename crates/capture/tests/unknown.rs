//! Streams of formats that the tool does not know: none is claimed as known.

use engine::codec::{self, Codec};
use engine::rig::line::Direction;
use hilrig_capture::decode::transcript::Transcript;
use hilrig_capture::{Interface, Kind, Record};
use protocols::Instant;

/// Random numbers, the same in each run.
struct Chance(u64);

impl Chance {
    fn byte(&mut self) -> u8 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        self.0.to_le_bytes()[5]
    }

    fn below(&mut self, limit: u8) -> u8 {
        self.byte() % limit.max(1)
    }

    fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| self.byte()).collect()
    }
}

/// CRC with the lowest bit first.
fn crc_reflected(bytes: &[u8], polynomial: u16, first: u16) -> u16 {
    bytes.iter().fold(first, |sum, &byte| {
        (0..8).fold(sum ^ u16::from(byte), |sum, _| {
            if sum & 1 == 1 {
                sum >> 1 ^ polynomial
            } else {
                sum >> 1
            }
        })
    })
}

/// CRC of eight bits, with the highest bit first.
fn crc8(bytes: &[u8], polynomial: u8) -> u8 {
    bytes.iter().fold(0, |sum, &byte| {
        (0..8).fold(sum ^ byte, |sum: u8, _| {
            let shifted = sum << 1;
            if sum & 0x80 == 0 {
                shifted
            } else {
                shifted ^ polynomial
            }
        })
    })
}

fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// Name of a format and one frame of it.
type Frames = (&'static str, fn(&mut Chance, usize) -> Vec<u8>);

/// Frames after the devices' manuals and the protocols' documents.
const UNKNOWN: [Frames; 34] = [
    ("LD06", |chance, turn| {
        let mut out = vec![0x54, 0x2C, 0x68, 0x08];
        out.extend((u16::try_from(turn % 360).unwrap_or(0) * 100).to_le_bytes());
        (0..12).for_each(|_| out.extend([chance.byte(), chance.below(16), 200 + chance.below(40)]));
        out.extend([0x10, 0x27, 0x55, 0x66]);
        out.push(crc8(&out, 0x4D));
        out
    }),
    ("COIN-D4", |chance, turn| {
        let mut out = vec![0xAA, 0x55, 0, 20];
        out.extend(u16::try_from(turn % 360 * 64).unwrap_or(0).to_le_bytes());
        out.extend([0x12, 0x34, 0x56, 0x78]);
        (0..20).for_each(|_| out.extend([chance.byte(), chance.byte(), chance.below(32)]));
        out
    }),
    ("TFmini", |chance, _| {
        let mut out = vec![
            0x59,
            0x59,
            chance.byte(),
            chance.below(12),
            chance.byte(),
            3,
            0,
            0,
        ];
        out.push(sum(&out));
        out
    }),
    ("UBX", |chance, _| {
        let mut out = vec![0xB5, 0x62, 0x01, 0x07, 92, 0];
        out.extend(chance.bytes(92));
        let (a, b) = out[2..].iter().fold((0_u8, 0_u8), |(a, b), byte| {
            let a = a.wrapping_add(*byte);
            (a, b.wrapping_add(a))
        });
        out.extend([a, b]);
        out
    }),
    ("SBUS", |chance, _| {
        [&[0x0F][..], &chance.bytes(22), &[0, 0]].concat()
    }),
    ("CRSF", |chance, _| {
        let data = [&[0x16][..], &chance.bytes(22)].concat();
        [&[0xC8, 24][..], &data, &[crc8(&data, 0xD5)]].concat()
    }),
    ("Dynamixel 1", |chance, _| {
        let mut out = vec![0xFF, 0xFF, 1 + chance.below(20), 4, 2, 0x24, 2];
        out.push(!sum(&out[2..]));
        out
    }),
    ("Dynamixel 2", |chance, _| {
        let mut out = vec![0xFF, 0xFF, 0xFD, 0, 1, 7, 0, 2, 0x84, 0, chance.byte(), 0];
        out.extend(chance.bytes(2));
        out
    }),
    ("Modbus RTU", |chance, _| {
        let mut out = vec![1, 3, 4, chance.below(8), chance.byte(), 0, chance.byte()];
        out.extend(crc_reflected(&out, 0xA001, 0xFFFF).to_le_bytes());
        out
    }),
    ("MAVLink 1", |chance, turn| {
        let mut out = vec![0xFE, 28, turn.to_le_bytes()[0], 1, 1, 30];
        out.extend(chance.bytes(28));
        out.extend(crc_reflected(&out[1..], 0x8408, 0xFFFF).to_le_bytes());
        out
    }),
    ("MAVLink 2", |chance, turn| {
        let mut out = vec![0xFD, 28, 0, 0, turn.to_le_bytes()[0], 1, 1, 30, 0, 0];
        out.extend(chance.bytes(28));
        out.extend(crc_reflected(&out[1..], 0x8408, 0xFFFF).to_le_bytes());
        out
    }),
    ("NMEA", |chance, _| {
        let body = format!(
            "GPGGA,1235{},4807.0{},N,01131.0,E,1,08,0.9,545.4,M,46.9,M,,",
            10 + chance.below(49),
            10 + chance.below(89)
        );
        let sum = body.bytes().fold(0, |sum, byte| sum ^ byte);
        format!("${body}*{sum:02X}\r\n").into_bytes()
    }),
    ("HDLC", |chance, _| {
        let data = chance.bytes(20);
        let sum = crc_reflected(&data, 0x8408, 0xFFFF).to_le_bytes();
        let body = [&data[..], &sum].concat();
        let stuffed = body.into_iter().flat_map(|byte| match byte {
            0x7D | 0x7E => vec![0x7D, byte ^ 0x20],
            byte => vec![byte],
        });
        [&[0x7E][..], &stuffed.collect::<Vec<u8>>(), &[0x7E]].concat()
    }),
    ("SLIP", |chance, _| {
        let body = chance.bytes(24).into_iter().flat_map(|byte| match byte {
            0xC0 => vec![0xDB, 0xDC],
            0xDB => vec![0xDB, 0xDD],
            byte => vec![byte],
        });
        [&[0xC0][..], &body.collect::<Vec<u8>>(), &[0xC0]].concat()
    }),
    ("PMS5003", |chance, _| {
        let mut out = vec![0x42, 0x4D, 0, 28];
        (0..13).for_each(|_| out.extend([0, chance.below(120)]));
        let sum: u16 = out.iter().map(|byte| u16::from(*byte)).sum();
        out.extend(sum.to_be_bytes());
        out
    }),
    ("MH-Z19", |chance, _| {
        let mut out = vec![
            0xFF,
            0x86,
            2 + chance.below(3),
            chance.byte(),
            0x40 + chance.below(8),
            0,
            0,
            0,
        ];
        out.push((!sum(&out[1..])).wrapping_add(1));
        out
    }),
    ("DMX", |chance, _| [&[0][..], &chance.bytes(64)].concat()),
    ("DMX, dark", |_, _| vec![0; 65]),
    ("MIDI", |chance, _| {
        vec![
            0x90 | chance.below(4),
            40 + chance.below(40),
            chance.below(127),
        ]
    }),
    ("VESC", |chance, _| {
        let data = chance.bytes(30);
        [&[2, 30][..], &data, &chance.bytes(2), &[3]].concat()
    }),
    ("ELM327", |chance, _| {
        format!(
            "010C\r41 0C {:02X} {:02X} \r\r>",
            chance.byte(),
            chance.byte()
        )
        .into_bytes()
    }),
    ("XMODEM", |chance, turn| {
        let number = turn.to_le_bytes()[0];
        let data = chance.bytes(128);
        [&[1, number, !number][..], &data, &[sum(&data)]].concat()
    }),
    ("AT commands", |chance, _| {
        format!("AT+CSQ\r\r\n+CSQ: {},99\r\n\r\nOK\r\n", chance.below(31)).into_bytes()
    }),
    ("JSON lines", |chance, turn| {
        format!("{{\"t\":{turn},\"x\":{}}}\n", chance.byte()).into_bytes()
    }),
    ("numbers of text", |chance, _| {
        format!("{},{},{}\r\n", chance.byte(), chance.byte(), chance.byte()).into_bytes()
    }),
    ("G-code", |chance, _| {
        format!("G1 X{}.5 Y{} F1500\nok\n", chance.byte(), chance.byte()).into_bytes()
    }),
    ("Firmata", |chance, _| {
        vec![0xE0 | chance.below(6), chance.below(127), chance.below(8)]
    }),
    ("ROS serial", |chance, _| {
        let data = chance.bytes(12);
        let head = [0xFF, 0xFE, 12, 0, 0xF3, 125, 0];
        [&head[..], &data, &[255 - sum(&data)]].concat()
    }),
    ("IMU of ten bytes", |chance, _| {
        let mut out = vec![0x55, 0x51];
        out.extend(chance.bytes(8));
        out.push(sum(&out));
        out
    }),
    ("Feetech", |chance, _| {
        let mut out = vec![0xFF, 0xFF, 1, 4, 0, chance.byte(), chance.below(16)];
        out.push(!sum(&out[2..]));
        out
    }),
    ("noise", |chance, _| chance.bytes(64)),
    ("one value", |_, _| vec![0x00; 16]),
    ("idle line", |_, _| vec![0xFF; 16]),
    ("a counter", |_, turn| vec![turn.to_le_bytes()[0]]),
];

/// The formats claimed for `bytes`, delivered in pieces as from a port.
fn claimed(bytes: &[u8]) -> Vec<&'static str> {
    let mut transcript = Transcript::new(None);
    let link = Interface::new("x", 115_200);
    for (piece, turn) in bytes.chunks(48).zip(0_u64..) {
        let record = Record {
            link: 0,
            sequence: None,
            at: Instant::from_millis(10 * turn),
            direction: Direction::ToMaster,
            kind: Kind::Data,
            bytes: piece.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        transcript.record(&record, &link);
    }
    let _ = transcript.finish().count();
    transcript
        .sums()
        .filter_map(|sum| sum.codec)
        .map(Codec::name)
        .collect()
}

#[test]
fn no_unknown_format_is_claimed_as_known() {
    let mut wrong = Vec::new();
    for (name, frame) in UNKNOWN {
        for (seed, frames) in [(1, 3), (2, 20), (3, 150)] {
            let mut chance = Chance(seed);
            let bytes: Vec<u8> = (0..frames)
                .flat_map(|turn| frame(&mut chance, turn))
                .collect();
            let guess = codec::guess(&bytes).map(Codec::name);
            let claimed = claimed(&bytes);
            if guess.is_some() || !claimed.is_empty() {
                wrong.push(format!("{name}, {frames} frames: {guess:?} {claimed:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
