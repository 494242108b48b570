//! Tests of the learner with streams of known formats, and with random bytes.

use super::corpus::Corpus;
use super::format::{Coding, Format};
use super::seeds::{Gathered, Spoken};
use super::*;
use emulators::rng::Rng;

/// An example line of the NMEA 0183 standard, as printed in manuals of receivers.
const RMC: &[u8] = b"$GPRMC,081836,A,3751.65,S,14507.36,E,000.0,360.0,130998,011.3,E*62\r\n";

pub(crate) fn chance(rng: &mut Rng, len: u64) -> Vec<u8> {
    (0..len).map(|_| rng.next_u64().to_be_bytes()[0]).collect()
}

/// Frames of a fictional sensor: a number, 8 bytes of values, a 16-bit count with as many bytes,
/// then CRC-16/IBM-3740, low byte first; coded with COBS.
pub(crate) fn sensor_frames(count: u8) -> Vec<Vec<u8>> {
    let crc = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
    let stuffed = Format {
        end: vec![0],
        coding: Coding::Cobs,
        ..Format::unknown()
    };
    let rng = &mut Rng::stream(3, "sensor");
    let frame = |number: u8| {
        let mut body = vec![number];
        body.extend(chance(rng, 8));
        let note = rng.below(5);
        body.extend([note.to_le_bytes()[0], 0]);
        body.extend(chance(rng, note));
        body.extend(crc.checksum(&body).to_le_bytes());
        stuffed.frame(&body, 0)
    };
    (0..count).map(frame).collect()
}

/// Sets of random frames with equal and with different lengths: no checksum is found.
#[test]
fn random_bytes_have_no_checksum() {
    for seed in 1..40 {
        let rng = &mut Rng::stream(seed, "chance");
        let (count, len, is_fixed) = (1 + rng.below(30), 2 + rng.below(40), rng.below(2) == 0);
        let chunks: Vec<Vec<u8>> = (0..count)
            .map(|_| {
                let len = if is_fixed { len } else { 1 + rng.below(40) };
                chance(rng, len)
            })
            .collect();
        let (format, _) = framing::infer(&chunks);
        let claimed = format.checksum.filter(|checksum| checksum.is_sure);
        assert!(claimed.is_none(), "seed {seed}: {format}");
    }
}

/// Like `random_bytes_have_no_checksum`, for frames with common parts: a counter, zeros.
#[test]
fn frames_that_hardly_differ_have_no_checksum() {
    let counted: Vec<Vec<u8>> = (0..60)
        .map(|at| vec![0xAA, at, at, 0, 0, 0, 0x55])
        .collect();
    let zeros: Vec<Vec<u8>> = (2..20).map(|len| vec![0; len]).collect();
    for chunks in [counted, zeros] {
        let (format, _) = framing::infer(&chunks);
        let claimed = format.checksum.filter(|checksum| checksum.is_sure);
        assert!(claimed.is_none(), "{format}");
    }
}

/// The star before the sum makes one line sufficient; the sum of the example is that of the
/// standard.
#[test]
fn the_sum_of_a_line_is_learned_from_one_line() {
    let (format, _) = framing::infer(&[RMC.to_vec()]);
    assert!(format.is_text);
    assert_eq!(format.is_sound(RMC), Some(true));
    let content = format.content(RMC).expect("sound");
    assert_eq!(format.frame(&content, 0), RMC);
    // 62 with another digit in the line: '8' for '0' in the first field changes the sum by 08.
    let other = RMC.strip_prefix(b"$GPRMC,0").expect("as above");
    let other = [b"$GPRMC,8", other].concat();
    assert_eq!(format.is_sound(&other), Some(false));
    let repaired = format.frame(&format.content(&other).expect("a line"), 0);
    assert!(
        repaired.ends_with(b"*6A\r\n"),
        "{}",
        repaired.escape_ascii()
    );
}

/// Frames in one stream or one by one: stuffing, checksum and count are the same.
#[test]
fn a_stuffed_frame_with_a_count_is_learned() {
    let frames = sensor_frames(6);
    for chunks in [frames.clone(), vec![frames.concat()]] {
        let (format, _) = framing::infer(&chunks);
        assert_eq!(format.coding, Coding::Cobs);
        let count = format.lengths.first().expect("a count");
        assert_eq!(
            (count.at, count.bytes, count.is_big, count.rest),
            (9, 2, false, 11)
        );
        assert!(format.checksum.is_some_and(|checksum| checksum.is_sure));
        for frame in &frames {
            assert_eq!(format.is_sound(frame), Some(true));
            let content = format.content(frame).expect("sound");
            assert_eq!(&format.frame(&content, 0), frame);
            assert_eq!(format.is_sound(&format.frame(&content, 1)), Some(false));
        }
    }
}

/// A damaged frame among 20 does not hide the checksum.
#[test]
fn a_damaged_frame_is_no_reason_to_give_up() {
    let mut frames = sensor_frames(20);
    frames[7][3] ^= 0x10;
    let (format, _) = framing::infer(&frames);
    assert!(format.checksum.is_some_and(|checksum| checksum.is_sure));
    let damaged: Vec<usize> = (0..20)
        .filter(|&at| format.is_sound(&frames[at]) == Some(false))
        .collect();
    assert_eq!(damaged, [7]);
}

/// Every algorithm in both byte orders, behind a header that it does not cover: frames that are
/// rebuilt with the learned checksum are correct.
#[test]
fn every_checksum_is_found() {
    for sum in sums::ALL.iter() {
        for is_big in [false, true] {
            let rng = &mut Rng::stream(5, sum.name);
            let frame = |at: u64| {
                let content = chance(rng, 6 + at % 5);
                let content: Vec<u8> = [&[0xAA, 0x55][..], &content].concat();
                let value = sum.of([&content[2..]]);
                let mut field = value.to_le_bytes()[..sum.bytes].to_vec();
                if is_big {
                    field.reverse();
                }
                [content, field].concat()
            };
            let frames: Vec<Vec<u8>> = (0..8).map(frame).collect();
            let checksum = checksum::infer(&frames);
            let checksum = checksum.expect(sum.name);
            // The high bytes of a sum of 32 bits are 0: 16 bits before two zeros fit as well.
            let is_sure = checksum.is_sure || sum.bytes == 4;
            assert!(
                is_sure && checksum.is_present(),
                "{}: {checksum:?}",
                sum.name
            );
            for frame in &frames {
                let content = checksum.without(frame).expect("long enough");
                assert_eq!(&checksum.put(&content, 0), frame, "{}", sum.name);
            }
        }
    }
}

/// The name in descriptions of the checksum of `frames`, if it is sure, its words and its content
/// of the last frame.
fn found(frames: &[Vec<u8>]) -> (Option<String>, String, Vec<u8>) {
    let checksum = checksum::infer(frames).expect("a checksum");
    let name = checksum.described();
    let name = name.unwrap_or_else(|| panic!("{checksum:?}"));
    let last = frames.last().expect("frames");
    let content = checksum.without(last).expect("long enough");
    let words = checksum.to_string();
    (checksum.is_sure.then_some(name), words, content)
}

/// `content` with `sum` of its bytes from `from`.
fn with_sum(from: usize, content: &[u8], sum: fn(u8) -> u8) -> Vec<u8> {
    let total = content[from..]
        .iter()
        .fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    [content, &[sum(total)]].concat()
}

/// Sums over small values have at most 7 bits. If a sum of 8 bits with a name fits all frames as
/// well, neither is sure, and both are named. The sums: a Sabertooth motor driver, VBus, Roland.
#[test]
fn a_sum_of_small_values_is_not_sure_if_another_width_fits() {
    let driver = |top: u8| {
        let frame = |at: u8| {
            let content = [
                0x80,
                [0, 1, 4, 5][usize::from(at % 4)],
                at.wrapping_mul(7) % top,
            ];
            with_sum(0, &content, |sum| sum & 0x7F)
        };
        found(&(0..60).map(frame).collect::<Vec<_>>())
    };
    let small = |head: u8, count: u8, sum| {
        let frame = |at: u8| {
            let content = [
                0xAA,
                head,
                at % 16,
                at.wrapping_mul(5) % 16,
                at.wrapping_mul(11) % 13,
            ];
            with_sum(1, &content, sum)
        };
        found(&(0..count).map(frame).collect::<Vec<_>>())
    };
    let twos: fn(u8) -> u8 = |sum| sum.wrapping_neg() & 0x7F;
    let ones: fn(u8) -> u8 = |sum| 0x7F - (sum & 0x7F);
    let (name, words, _) = driver(101);
    assert_eq!(name, None, "{words}");
    assert_eq!(
        words,
        "sum of bytes, 7 bits, at the end; or sum of bytes, of the bytes from 1: both fit \
         all frames"
    );
    assert_eq!(driver(128).0.as_deref(), Some("sum7"));
    assert_eq!(small(1, 20, ones).0.as_deref(), Some("ones-complement7"));
    assert_eq!(small(1, 20, twos).0.as_deref(), Some("twos-complement7"));
    // The sums are 129 to 255: 256 - sum is the negative sum of 7 and of 8 bits.
    let (name, words, _) = small(0x90, 20, twos);
    assert_eq!(name, None, "{words}");
    assert_eq!(
        words,
        "negative sum of bytes, at the end, of the bytes from 1; or negative sum of bytes, 7 bits, \
         of the bytes from 1: both fit all frames"
    );
    // A sum that sets the high bit has 8 bits.
    assert_eq!(small(0x70, 20, |sum| sum).0.as_deref(), Some("sum8"));
}

/// Each byte is the negative sum of the others. The replies of an MH-Z19, of which the low byte of
/// the CO2 value changes more than the checksum: the checksum is at the end.
#[test]
fn a_negative_sum_is_found_at_the_end() {
    let replies = |of: fn(u8) -> [u8; 2]| -> Vec<Vec<u8>> {
        let reply = |at: u8| {
            let [high, warm] = of(at);
            let content = [0xFF, 0x86, high, 10 + at, warm, 0, 0, 0];
            with_sum(1, &content, u8::wrapping_neg)
        };
        (0..40).map(reply).collect()
    };
    let slow: fn(u8) -> [u8; 2] = |at| [2, 69 - at / 2 - at % 2];
    for (of, is_sure) in [
        (slow, false),
        (|at| [2 + at / 20 * 0x60, 69 - at / 8], true),
    ] {
        let frames = replies(of);
        let (name, words, content) = found(&frames);
        assert_eq!(content, frames[39][..8], "{words}");
        assert_eq!(name.is_some(), is_sure, "{words}");
    }
}

/// A Roland message with one value: its checksum skips 5 of 11 bytes.
#[test]
fn the_checksum_of_a_message_for_a_synthesizer_is_found() {
    let message = |at: u8| {
        let content = [
            0xF0,
            0x41,
            0x10,
            0x42,
            0x12,
            0x40,
            at % 3,
            at,
            at.wrapping_mul(37) % 128,
        ];
        let mut frame = with_sum(5, &content, |sum| sum.wrapping_neg() & 0x7F);
        frame.push(0xF7);
        frame
    };
    let frames: Vec<Vec<u8>> = (0..60).map(message).collect();
    assert_eq!(found(&frames).0.as_deref(), Some("twos-complement7"));
}

/// A request, its reply 5 ms later, an unsolicited line 2 s later.
#[test]
fn a_conversation_is_requests_with_replies_and_what_comes_by_itself() {
    let spoken = |is_program, at_ms: u64, bytes: &[u8]| Spoken {
        is_program,
        at: at_ms * 1_000_000,
        bytes: bytes.to_vec(),
    };
    let mut gathered = Gathered::default();
    gathered.conversation(&[
        spoken(true, 0, b"re"),
        spoken(true, 1, b"ad\n"),
        spoken(false, 6, b"mm="),
        spoken(false, 7, b"12\n"),
        spoken(false, 2007, b"alive\n"),
        spoken(true, 2100, b"read\n"),
        spoken(false, 2105, b"mm=17\n"),
    ]);
    let seeds = gathered.learned(None);
    let replies = vec![b"mm=12\n".to_vec(), b"mm=17\n".to_vec()];
    assert_eq!(seeds.exchanges, [(b"read\n".to_vec(), replies)]);
    assert_eq!(seeds.unasked, [b"alive\n".to_vec()]);
    assert!(seeds.asks && seeds.format.is_text());
}

/// A folder with binary files and with hexadecimal text, one frame per line; an empty folder is
/// rejected.
#[test]
fn frames_are_read_from_a_folder() {
    let dir = std::env::temp_dir().join(format!("hilrig-corpus-{}", std::process::id()));
    std::fs::create_dir_all(&dir).expect("room");
    let error = Corpus::read(&dir).expect_err("nothing there").to_string();
    assert!(
        error.contains("no bytes there; expected captures"),
        "{error}"
    );
    std::fs::write(dir.join("a.txt"), "# two\nAB 01 02\nAB 03\n").expect("room");
    std::fs::write(dir.join("b.bin"), [0xAB, 0x04]).expect("room");
    let mut gathered = Gathered::default();
    Corpus::read(&dir)
        .expect("frames")
        .teach("any", &[], &mut gathered);
    std::fs::remove_dir_all(&dir).expect("ours");
    let expected = [vec![0xAB, 1, 2], vec![0xAB, 3], vec![0xAB, 4]];
    assert_eq!(gathered.learned(None).unasked, expected);
}

/// A driver counts its requests. The capture has its requests in the wrong direction: they are
/// known by their other bytes.
#[test]
fn the_directions_of_a_corpus_are_those_of_the_requests() {
    let spoken = |number: u8| Spoken {
        is_program: true,
        at: u64::from(number) * 1_000_000_000,
        bytes: vec![0xAA, 0x10, 0x20, number],
    };
    let mut gathered = Gathered::default();
    gathered.conversation(&[spoken(1), spoken(2)]);
    let dir = std::env::temp_dir().join(format!("hilrig-roles-{}", std::process::id()));
    std::fs::create_dir_all(&dir).expect("room");
    for (names, is_swapped) in [(["TX", "RX"], false), (["RX", "TX"], true)] {
        let [requests, replies] = names;
        let log = format!(
            "[12:00:01.000] {requests}: AA 10 20 77\n[12:00:01.010] {replies}: 01 02\n\
             [12:00:02.000] {requests}: AA 10 20 78\n[12:00:02.010] {replies}: 01 03\n"
        );
        std::fs::write(dir.join("field.log"), log).expect("room");
        let corpus = Corpus::read(&dir).expect("a dump");
        let answers = false;
        let expected = Role {
            is_swapped,
            answers,
        };
        assert_eq!(corpus.roles("any", &gathered), [expected], "{names:?}");
    }
    std::fs::remove_dir_all(&dir).expect("ours");
}

/// Frames of a lidar with a CRC of 8 bits that no catalogue has (LDROBOT: polynomial 4D), computed
/// bit by bit. A tenth of them, which come first in order, are damaged.
#[test]
fn a_polynomial_without_a_name_is_found_among_damaged_frames() {
    let crc = |bytes: &[u8]| {
        bytes.iter().fold(0_u8, |sum, byte| {
            (0..8).fold(sum ^ byte, |sum, _| {
                (sum << 1) ^ if sum & 0x80 == 0 { 0 } else { 0x4D }
            })
        })
    };
    let frame = |at: u8| {
        let mut frame = vec![
            0x54,
            0x2C,
            at.wrapping_mul(37),
            at.wrapping_mul(11) ^ 0x5A,
            at,
        ];
        frame.push(crc(&frame));
        match at % 10 {
            3 => vec![at, 0x2C, 0x11, 0x22, 0x33, 0x44],
            _ => frame,
        }
    };
    let frames: Vec<Vec<u8>> = (0..60).map(frame).collect();
    assert_eq!(crc(&[1]), 0x4D);
    let (name, words, _) = found(&frames);
    assert_eq!(
        name.as_deref(),
        Some("CRC-8 with polynomial 0x4D"),
        "{words}"
    );
    assert_eq!(
        sums::key(&name.expect("named")),
        "polynomial = { width = 8, poly = 0x4D }"
    );
}

/// On a single wire the program hears its request 05 00 6F, in two pieces, before the reply 05 FF;
/// a later request loses its echo.
#[test]
fn the_echo_of_a_single_wire_is_no_reply() {
    let one = |is_program, at, bytes: &[u8]| Spoken {
        is_program,
        at,
        bytes: bytes.to_vec(),
    };
    let heard = [
        one(false, 10, &[5, 0]),
        one(true, 10, &[5, 0, 0x6F]),
        one(false, 12, &[0x6F, 5, 0xFF]),
        one(true, 20, &[5, 0, 0x70]),
        one(false, 30, &[7]),
        one(true, 40, &[7]),
        one(false, 40, &[7]),
    ];
    let expected = [
        one(true, 10, &[5, 0, 0x6F]),
        one(false, 12, &[5, 0xFF]),
        one(true, 20, &[5, 0, 0x70]),
        one(false, 30, &[7]),
        one(true, 40, &[7]),
    ];
    assert_eq!(without_echo(heard.to_vec()), expected);
}
