//! Register bus of the AVR base: the exchanges of the fielded firmware both ways, both checksum
//! orders, the register map.

use proptest::collection::vec;
use proptest::prelude::*;
use protocols::Decode;
use protocols::avr::{self, ChecksumOrder, Frame, registers};

use crate::hex;
use crate::protocol::{Protocol, Wire};

/// Meaning of a frame, whatever its checksum order.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Says {
    /// A read request for this number of registers; an acknowledgement if the number is 0.
    Read(u8, u8),
    /// A write request, or the reply to a read.
    Write(u8, &'static [u8]),
}

/// Frames seen on the wire of the field firmware b77a6df, run on an emulated ATmega2560, and of
/// its master: high byte of the checksum first.
const GOLDEN: [(&str, Says); 20] = [
    ("AB 24 0A 00 D9", Says::Read(36, 10)),
    (
        "AB 24 8A 00 00 00 00 00 00 00 00 00 00 01 59",
        Says::Write(36, &[0; 10]),
    ),
    (
        // The reply holds the encoders 0x01020304 and -2 and the speeds 20 and -20.
        "AB 24 8A 04 03 02 01 FE FF FF FF 14 EC 06 5E",
        Says::Write(36, &[4, 3, 2, 1, 0xFE, 0xFF, 0xFF, 0xFF, 20, 0xEC]),
    ),
    // Set-points 20 and -20, driver on; its acknowledgement; read back.
    ("AB 2E 83 14 EC 00 02 5C", Says::Write(46, &[20, 0xEC, 0])),
    ("AB 2E 00 00 D9", Says::Read(46, 0)),
    ("AB 2E 03 00 DC", Says::Read(46, 3)),
    // The error frame, which is the acknowledgement of register 255.
    ("AB FF 00 01 AA", Says::Read(255, 0)),
    // Nothing read, nothing written.
    ("AB 24 00 00 CF", Says::Read(36, 0)),
    ("AB 24 80 01 4F", Says::Write(36, &[])),
    ("AB 00 00 00 AB", Says::Read(0, 0)),
    ("AB 00 80 01 2B", Says::Write(0, &[])),
    ("AB 2E 80 01 59", Says::Write(46, &[])),
    // Battery.
    ("AB 21 03 00 CF", Says::Read(33, 3)),
    // One register, and one past the end of the map; the answer holds the memory behind the map.
    ("AB 24 01 00 D0", Says::Read(36, 1)),
    ("AB 35 01 00 E1", Says::Read(53, 1)),
    ("AB 35 81 35 01 96", Says::Write(53, &[0x35])),
    // Acknowledgements with the wrong register, after a write that hit the request itself.
    ("AB 55 00 01 00", Says::Read(0x55, 0)),
    ("AB 11 00 00 BC", Says::Read(0x11, 0)),
    // Arithmetic by hand: the largest count, and a sum that fills both bytes.
    ("AB 00 7F 01 2A", Says::Read(0, 127)),
    ("AB FF 82 FF FF 04 2A", Says::Write(255, &[0xFF, 0xFF])),
];

/// Each golden frame decodes to its known meaning, field by field.
#[test]
fn golden_frames_decode_to_what_was_said() {
    for (bytes, says) in GOLDEN {
        let mut decoder = avr::Decoder::new(ChecksumOrder::HighFirst);
        let frames: Vec<_> = decoder.push(&hex(bytes)).collect();
        let [Ok(frame)] = frames[..] else {
            panic!("{bytes}: {frames:?}")
        };
        let (register, count, data) = match says {
            Says::Read(register, count) => (register, usize::from(count), &[][..]),
            Says::Write(register, data) => (register, data.len(), data),
        };
        assert_eq!(frame.register(), register, "{bytes}");
        assert_eq!(usize::from(frame.count()), count, "{bytes}");
        assert_eq!(frame.is_write(), matches!(says, Says::Write(..)), "{bytes}");
        assert_eq!(frame.data(), data, "{bytes}");
    }
}

fn encode(says: Says, order: ChecksumOrder) -> Frame {
    match says {
        Says::Read(register, count) => Frame::read(register, count, order),
        Says::Write(register, data) => Frame::write(register, data, order),
    }
}

#[test]
fn golden_frames_are_what_their_meaning_encodes_to() {
    for (bytes, says) in GOLDEN {
        let frame = encode(says, ChecksumOrder::HighFirst);
        assert_eq!(frame.as_bytes(), hex(bytes), "{bytes}");
    }
}

/// The seed report sends the low byte first: the same frames, last two bytes swapped, and neither
/// end understands the other unless both bytes are alike.
#[test]
fn the_document_order_swaps_the_checksum_and_nothing_else() {
    for (bytes, says) in GOLDEN {
        let mut swapped = hex(bytes);
        let end = swapped.len();
        swapped.swap(end - 2, end - 1);
        let frame = encode(says, ChecksumOrder::LowFirst);
        assert_eq!(frame.as_bytes(), swapped, "{bytes}");

        let mut decoder = avr::Decoder::new(ChecksumOrder::HighFirst);
        let alike = swapped[end - 2] == swapped[end - 1];
        let understood = decoder.push(&swapped).filter(Result::is_ok).count();
        assert_eq!(understood, usize::from(alike), "{bytes}");
    }
}

/// The fielded firmware rejected this frame: its checksum is wrong.
#[test]
fn a_request_with_a_wrong_sum_is_refused() {
    let mut decoder = avr::Decoder::new(ChecksumOrder::HighFirst);
    let frames: Vec<_> = decoder.push(&hex("AB 24 0A 00 00")).collect();
    let error = protocols::FrameError::Checksum {
        expected: 0x00D9,
        found: 0,
    };
    assert_eq!(frames, [Err(error)]);
}

/// Noise before a frame, as sent to the fielded firmware, costs its three bytes.
#[test]
fn noise_before_a_frame_is_skipped() {
    let mut decoder = avr::Decoder::new(ChecksumOrder::HighFirst);
    let line = hex("00 11 FF AB 24 0A 00 D9");
    assert_eq!(decoder.push(&line).filter(Result::is_ok).count(), 1);
    assert_eq!(decoder.discarded(), 3);
}

/// Addresses, widths and names of the values a master uses, from the field firmware's table.
#[test]
fn the_register_map_is_the_fielded_one() {
    let expected = [
        (1, "dist_back_right", 2),
        (15, "dist_down", 2),
        (19, "battery_raw", 2),
        (33, "battery_mv", 2),
        (35, "battery_percent", 1),
        (36, "encoder_left", 4),
        (40, "encoder_right", 4),
        (44, "speed_left_is", 1),
        (46, "speed_left_to", 1),
        (48, "motor_standby", 1),
        (52, "led_value", 1),
    ];
    for (address, name, bytes) in expected {
        let register = registers::at(address).expect("in the map");
        assert_eq!((register.address, register.name), (address, name));
        assert_eq!(register.width.bytes(), bytes, "{name}");
    }
    let writable = registers::TABLE
        .iter()
        .filter(|register| register.access == registers::Access::ReadWrite)
        .map(|register| register.address);
    assert_eq!(writable.collect::<Vec<_>>(), [46, 47, 48, 49, 50, 51, 52]);
}

/// The sum of the bytes, kept in whole numbers and cut to 16 bits at the end.
fn slow_frame_at(bytes: &[u8], order: ChecksumOrder) -> Option<usize> {
    if bytes.len() < 5 || bytes[0] != 0xAB {
        return None;
    }
    let data = usize::from(bytes[2] % 128) * usize::from(bytes[2] / 128);
    let sum: usize = bytes
        .get(..3 + data)?
        .iter()
        .map(|&byte| usize::from(byte))
        .sum();
    let (low, high) = (sum % 256, sum / 256 % 256);
    let expected = match order {
        ChecksumOrder::LowFirst => [low, high],
        ChecksumOrder::HighFirst => [high, low],
    };
    let found = bytes.get(3 + data..5 + data)?;
    let holds = found
        .iter()
        .zip(expected)
        .all(|(&byte, part)| usize::from(byte) == part);
    holds.then_some(5 + data)
}

fn frame(order: ChecksumOrder) -> BoxedStrategy<Vec<u8>> {
    let byte = || prop_oneof![any::<u8>(), proptest::sample::select(LowFirst::TELLING)];
    let data = prop_oneof![4 => vec(byte(), 0..12), 1 => vec(byte(), 0..=127)];
    prop_oneof![
        (byte(), 0_u8..128).prop_map(move |(at, count)| Frame::read(at, count, order).wire()),
        (byte(), data).prop_map(move |(at, data)| Frame::write(at, &data, order).wire()),
    ]
    .boxed()
}

impl Wire for Frame {
    fn wire(&self) -> Vec<u8> {
        self.as_bytes().to_vec()
    }
}

/// The bus as the seed report describes it, for the laws.
pub(crate) struct LowFirst;

impl Protocol for LowFirst {
    type Decoder = avr::Decoder;
    const TELLING: &'static [u8] = &[0xAB, 0xFF, 0x83, 0x00];

    fn decoder() -> avr::Decoder {
        avr::Decoder::new(ChecksumOrder::LowFirst)
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        slow_frame_at(bytes, ChecksumOrder::LowFirst)
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        frame(ChecksumOrder::LowFirst)
    }
}

/// The bus as fielded, for the laws.
pub(crate) struct HighFirst;

impl Protocol for HighFirst {
    type Decoder = avr::Decoder;
    const TELLING: &'static [u8] = LowFirst::TELLING;

    fn decoder() -> avr::Decoder {
        avr::Decoder::new(ChecksumOrder::HighFirst)
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        slow_frame_at(bytes, ChecksumOrder::HighFirst)
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        frame(ChecksumOrder::HighFirst)
    }
}
