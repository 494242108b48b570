//! The fast routes of recognition against the slow ones, which golden frames judge.

use std::collections::BTreeSet;

use protocols::{Candidate, Decode as _};

use super::judge::Context;
use super::{Cutter, Framing};
use crate::Description;
use crate::schema::message::From;

/// The ways in which a frame ends, with their markers.
const CUTS: [&str; 14] = [
    "size = 14",
    "sync = [0xFA]\nsize = 15",
    "sync = [0xAA, 0x55]\nend = [0x0D]\nsize = 17",
    "sync = [0xAA]\nend = [0x0D, 0x0A]\nsize = 18",
    "sizes = { 0x11 = 14, 0x22 = 15, 0x33 = 23 }",
    "sync = [0x7F]\nat = 1\nsizes = { 0x11 = 14, 0x22 = 19 }",
    "head = 1\nsize = \"12 + (b0 & 7)\"",
    "sync = [0xA5]\nend = [0x5A]\nhead = 3\nsize = \"b1 == 0x22 ? 14 : 12 + (b2 & 0x0f)\"",
    "sync = [0x7E]\nlength = { at = 1, type = \"u8\" }",
    "start = \":\"\nend = \"\\r\\n\"\nencoding = \"hex\"",
    "stuffing = \"slip\"",
    "stuffing = \"dle\"",
    "stuffing = \"dle\"\nstart = [0x10]\ntail = 1",
    "terminator = \"\\n\"",
];

/// Checksums of each width; some in another place, over another range, or in other bytes.
const CHECKS: [&str; 17] = [
    "",
    "checksum = \"sum8\"",
    "checksum = { algorithm = \"xor\", from = 1 }",
    "checksum = { algorithm = \"sum8\", bits = 6, plus = 0x20 }",
    "checksum = { algorithm = \"sum16\", endian = \"little\" }",
    "checksum = { algorithm = \"CRC-16/MODBUS\", endian = \"big\", from = 2 }",
    "checksum = { algorithm = \"CRC-24/OPENPGP\", endian = \"little\" }",
    "checksum = { algorithm = \"CRC-24/OPENPGP\", endian = \"big\" }",
    "checksum = { algorithm = \"CRC-32/ISO-HDLC\", endian = \"big\", from = 1 }",
    "checksum = { algorithm = \"CRC-32/ISO-HDLC\", endian = \"little\" }",
    "checksum = { algorithm = \"CRC-64/XZ\", endian = \"little\" }",
    "checksum = { algorithm = \"CRC-64/XZ\", endian = \"big\", from = 1 }",
    "checksum = { algorithm = \"CRC-82/DARC\" }",
    "checksum = { algorithm = \"CRC-8/SMBUS\", from = 0, at = 4 }",
    "checksum = { algorithm = \"sum8\", before = [1, 2] }",
    "checksum = { algorithm = \"sum8\", to = 0 }",
    "checksum = [{ algorithm = \"CRC-8/SMBUS\", at = -3 }, { algorithm = \"CRC-16/XMODEM\" }]",
];

/// The formats that these keys describe, and the same without the fast route.
fn formats() -> Vec<(String, Framing, Framing)> {
    let mut all = Vec::new();
    for cut in CUTS {
        for check in CHECKS {
            let text = format!(
                "name = \"x\"\nabout = \"x\"\nendian = \"big\"\nline = {{ baud = 9600 }}\n[frame]\n{cut}\n{check}\n\
                 [[message]]\nname = \"m\"\nfrom = \"both\"\nfields = [{{ name = \"all\", type = \
                 \"bytes\", size = \"rest\" }}]\n[[on]]\nmessage = \"m\"\nreply = \"m\"\n"
            );
            let Ok(description) = Description::parse("x", &text, &|_| Err(String::new())) else {
                continue;
            };
            let fast = description.frames.0[0].clone();
            let mut slow = fast.clone();
            slow.plain = None;
            all.push((format!("{cut}\n{check}"), fast, slow));
        }
    }
    all
}

/// Bodies with each first byte that decides a size.
fn bodies() -> Vec<Vec<u8>> {
    let firsts = [0x11, 0x22, 0x07];
    let bodies = firsts.iter().flat_map(|first| {
        (0..24_u8).map(move |len| {
            let rest = (1..len).map(|at| at.wrapping_mul(37) ^ first);
            [*first]
                .into_iter()
                .chain(rest)
                .take(usize::from(len))
                .collect()
        })
    });
    bodies.collect()
}

/// Both routes judge the same: for each frame, each of its beginnings, each of its bytes changed,
/// and bytes behind it. Both write the same bytes.
#[test]
fn the_fast_route_judges_as_the_slow_one() {
    let (mut widths, mut several, mut sound) = (BTreeSet::new(), 0, 0);
    for (keys, fast, slow) in formats() {
        if let Some(plain) = &fast.plain {
            several += usize::from(plain.len() > 1);
            widths.extend(fast.checks.iter().map(|check| check.width));
        }
        let same = |bytes: &[u8]| {
            for is_last in [false, true] {
                let found = fast.judge(bytes, is_last, Context::default());
                assert_eq!(
                    found,
                    slow.judge_all(bytes, is_last, Context::default()),
                    "{keys}\n{bytes:02X?}"
                );
            }
        };
        let mut made = 0;
        for body in bodies() {
            let frame = fast.frame(&body);
            assert_eq!(frame, slow.frame(&body), "{keys}\n{body:02X?}");
            let Some(frame) = frame else { continue };
            made += 1;
            sound += usize::from(
                fast.judge(&frame, false, Context::default()) == Candidate::Complete(frame.len()),
            );
            (0..=frame.len()).for_each(|end| same(&frame[..end]));
            same(&[&frame[..], &[0x11, 0]].concat());
            for at in 0..frame.len() {
                for change in [0x01, 0xFE] {
                    let mut damaged = frame.clone();
                    damaged[at] ^= change;
                    same(&damaged);
                }
            }
        }
        assert!(made > 0, "{keys}: no frame");
    }
    assert_eq!(widths, BTreeSet::from([1, 2, 3, 4, 8]));
    assert!(several > 0 && sound > 500, "{several} {sound}");
}

/// The decoder treats a whole frame at once like the same bytes one by one, also with two formats.
#[test]
fn a_whole_delivery_is_taken_as_single_bytes() {
    let text = "name = \"x\"\nabout = \"x\"\nendian = \"little\"\nline = { baud = 9600 }\n\
        frame = [{ name = \"a\", sync = [0x55], size = 9, checksum = \"sum8\" }, \
        { name = \"b\", sync = [0x55], length = { at = 1, type = \"u8\" }, checksum = \"CRC-16/MODBUS\" }]\n\
        message = [{ name = \"m\", from = \"both\", frame = \"a\", fields = [{ name = \"x\", type = \
        \"bytes\", size = \"rest\" }] }, { name = \"n\", from = \"both\", frame = \"b\", fields = [{ name \
        = \"x\", type = \"bytes\", size = \"rest\" }] }]\non = [{ message = \"m\", reply = \"n\" }]\n";
    let description = Description::parse("x", text, &|_| Err(String::new()));
    let description = description.unwrap_or_else(|error| panic!("{error}"));
    for (format, body) in [(0, &[7; 7][..]), (1, &[7; 3]), (1, &[5; 5]), (1, &[4; 8])] {
        let frame = description.frame_of(format, body).expect("it fits");
        let whole = description.cutter().whole(&frame);
        let mut cutter = description.cutter();
        let mut single: Vec<_> = frame
            .iter()
            .flat_map(|byte| cutter.push(&[*byte]).collect::<Vec<_>>())
            .collect();
        if let Some(whole) = whole {
            assert_eq!(single, [Ok(whole)], "{format} {body:02X?}");
        }
        cutter.idle();
        single.extend(cutter.push(&[]));
        assert_eq!(single.iter().flatten().count(), 1, "{format} {body:02X?}");
    }
}

/// The frames in `bytes`, and the number of rejected candidates.
fn decoded(framing: &str, bytes: &[u8]) -> (Vec<Vec<u8>>, usize) {
    let text = format!(
        "name = \"x\"\nabout = \"x\"\nline = {{ baud = 9600 }}\n[frame]\n{framing}\n\
         checksum = \"sum8\"\n[[message]]\nname = \"m\"\nfrom = \"both\"\n\
         fields = [{{ name = \"all\", type = \"bytes\", size = \"rest\" }}]\n\
         [[on]]\nmessage = \"m\"\nreply = \"m\"\n"
    );
    let description = Description::parse("x", &text, &|_| Err(String::new()));
    let mut cutter: Cutter = description
        .unwrap_or_else(|error| panic!("{error}"))
        .cutter();
    let mut all: Vec<_> = cutter.push(bytes).collect();
    cutter.idle();
    all.extend(cutter.push(&[]));
    let errors = all.iter().filter(|one| one.is_err()).count();
    let frames = all.into_iter().flatten().map(|one| one.bytes.to_vec());
    (frames.collect(), errors)
}

/// The sum of 01 02 is 03, and that of 02 alone is 02: behind a damaged first byte, the rest of a
/// frame can have a correct sum, but no frame begins within another one.
#[test]
fn no_frame_begins_within_a_damaged_one() {
    for (framing, mark) in [("stuffing = \"slip\"", 0xC0), ("stuffing = \"hdlc\"", 0x7E)] {
        let sound = [mark, 1, 2, 3, mark];
        let shared = [1, 2, 3, mark];
        let inner = [2, 2, mark];
        for (bytes, frames, errors) in [
            // Two frames with a marker between them, or with a marker each.
            ([&sound[..], &shared].concat(), vec![&sound[..], &shared], 0),
            ([&sound[..], &sound].concat(), vec![&sound[..], &sound], 0),
            // A byte too many behind the marker; a damaged marker.
            (
                [&[mark, 0x40], &inner[..], &sound].concat(),
                vec![&sound[..]],
                1,
            ),
            (
                [&sound[..], &[0x40], &inner, &sound].concat(),
                vec![&sound[..]; 2],
                1,
            ),
            // The marker behind a rejected frame is not a cut frame.
            ([&sound[..], &[0x40], &inner].concat(), vec![&sound[..]], 1),
            (vec![mark, 1, 2, 4, mark], vec![], 1),
            // The stream begins within a frame, or with one.
            ([&[0x40], &inner[..], &sound].concat(), vec![&sound[..]], 0),
            ([&shared[..], &sound].concat(), vec![&shared[..], &sound], 0),
        ] {
            let (found, bad) = decoded(framing, &bytes);
            assert_eq!(found, frames, "{bytes:02X?}");
            assert_eq!(bad, errors, "{bytes:02X?}");
        }
    }
}

/// The frames of `from` in bytes that a silence ends, delivered byte by byte or at once.
fn modbus_frames(of: &Description, from: From, bytes: &[u8], is_whole: bool) -> Vec<Vec<u8>> {
    [of.cutter_of(from), of.cutter_for(from)]
        .map(|mut cutter| {
            let size = if is_whole { bytes.len() } else { 1 };
            let pieces = bytes.chunks(size);
            let mut all: Vec<_> = pieces
                .flat_map(|piece| cutter.push(piece).collect::<Vec<_>>())
                .collect();
            cutter.idle();
            all.extend(cutter.push(&[]));
            let frames = all.into_iter().flatten();
            frames.map(|one| one.bytes.to_vec()).collect::<Vec<_>>()
        })
        .into_iter()
        .reduce(|one, other| {
            assert_eq!(one, other, "{bytes:02X?}");
            one
        })
        .expect("two decoders")
}

/// A frame whose CRC ends with 0 has a correct CRC without its last byte, too. A reply to a read
/// with 4 bytes is then also a request. The same holds for each length that one of the ends can
/// send.
#[test]
fn the_end_that_sends_decides_about_the_length_of_a_modbus_frame() {
    let text = "name = \"x\"\nabout = \"x\"\nprotocol = \"modbus-rtu\"\nregisters.holding = [{ at \
        = 0, name = \"a\" }]\nline = { baud = 9600 }\n";
    let of = Description::parse("x", text, &|_| Err(String::new()));
    let of = of.unwrap_or_else(|error| panic!("{error}"));
    let mut judged = 0;
    for number in 0..=u16::MAX {
        let [a, b] = number.to_be_bytes();
        let bodies: [(From, &[u8]); 9] = [
            (From::Device, &[1, 4, 4, 0x43, 0x63, a, b]),
            (From::Device, &[1, 3, 6, 1, 2, 3, 4, a, b]),
            (From::Device, &[1, 1, 4, 1, 2, a, b]),
            (From::Device, &[1, 1, 1, b]),
            (From::Device, &[1, 0x17, 2, a, b]),
            (From::Host, &[1, 3, 1, a, 0, b]),
            (From::Host, &[1, 16, 0, 1, 0, 1, 2, a, b]),
            (From::Host, &[1, 0x17, 8, 0, a, b, 0, 1, 0, 1, 2, 5, 5]),
            (From::Host, &[1, 6, 0, 1, a, b]),
        ];
        for (from, body) in bodies {
            let frame = of.frame_of(0, body).expect("it fits");
            if frame.last() != Some(&0) {
                continue;
            }
            judged += 1;
            for is_whole in [true, false] {
                let found = modbus_frames(&of, from, &frame, is_whole);
                assert_eq!(found, [&frame[..]], "{from:?}");
                // The frame of the other end, if the line echoes or a capture mixed up its ends.
                let other = match from {
                    From::Host => From::Device,
                    _ => From::Host,
                };
                let found = modbus_frames(&of, other, &frame, is_whole);
                let is_cut = frame.ends_with(&[0, 0]) || frame.len() == 9 && from == From::Device;
                assert!(is_cut || found == [&frame[..]], "{other:?} {frame:02X?}");
                // A damaged last byte leaves no frame, unless the two before it are superfluous.
                if frame.ends_with(&[0, 0]) {
                    continue;
                }
                let damaged = [&frame[..frame.len() - 1], &[0x80]].concat();
                let found = modbus_frames(&of, from, &damaged, is_whole);
                assert!(found.is_empty(), "{found:02X?}");
            }
        }
    }
    assert!(judged > 1_000, "{judged}");
}

/// A request to read from 0x0300 on has the form of a response with 3 bytes.
#[test]
fn a_read_from_the_address_of_a_count_is_a_request_in_words() {
    let all = [(3, From::Both), (4, From::Device), (1, From::Host)];
    let words = all.map(|(function, from)| crate::modbus::words(&[1, function, 3, 0, 0, 2], from));
    assert_eq!(
        words,
        [
            "device 1: read holding registers 768, 2 of them",
            "device 1: read input registers 768, 2 of them",
            "device 1: read coils 768, 2 of them",
        ]
    );
    let reply = crate::modbus::words(&[1, 1, 3, 0, 0, 2], From::Device);
    assert_eq!(reply, "device 1: read coils: [00, 00, 02]");
}
