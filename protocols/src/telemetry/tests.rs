//! Frames by hand, the fielded defects, and the laws of the decoder.

extern crate std;

use std::vec;
use std::vec::Vec;

use proptest::collection::vec as bytes;
use proptest::prelude::*;
use proptest::sample::Index;

use super::*;
use crate::{Decode, FrameError};

/// By hand: FF - (01 + 02) = FC.
const PLAIN: [u8; 6] = [0x7E, 0x00, 0x02, 0x01, 0x02, 0xFC];
/// By hand: 7E -> 7D 5E, 7D -> 7D 5D; FF - FB = 04.
const ESCAPED: [u8; 8] = [0x7E, 0x00, 0x02, 0x7D, 0x5E, 0x7D, 0x5D, 0x04];

fn encoded(payload: &[u8]) -> Vec<u8> {
    let mut out = vec![0xA5; FRAME_MAX];
    let len = encode(payload, &mut out).expect("fits");
    out.truncate(len);
    out
}

fn payloads(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Vec<u8>> {
    let frames = decoder.push(bytes).flatten();
    frames.map(|frame| frame.payload().to_vec()).collect()
}

/// Start, and escaped: two bytes of length, 3,200 of payload, the checksum.
#[test]
fn the_longest_frame_has_6407_bytes() {
    assert_eq!(FRAME_MAX, 6_407);
}

#[test]
fn frames_are_laid_out_by_hand() {
    assert_eq!(encoded(&[1, 2]), PLAIN);
    assert_eq!(encoded(&[0x7E, 0x7D]), ESCAPED);
    assert_eq!(encoded(&[]), [0x7E, 0, 0, 0xFF]);
    // FF - 82 = 7D: the checksum is escaped as well. So is a length of 7E.
    assert_eq!(encoded(&[0x82]), [0x7E, 0, 1, 0x82, 0x7D, 0x5D]);
    assert_eq!(encoded(&[0; 0x7E])[..4], [0x7E, 0x00, 0x7D, 0x5E]);
    let mut decoder = Decoder::default();
    let both = [&PLAIN[..], &ESCAPED].concat();
    assert_eq!(payloads(&mut decoder, &both), [[1, 2], [0x7E, 0x7D]]);
}

/// After an escape byte, only 5E and 5D are valid (7E and 7D with a flipped bit).
#[test]
fn only_two_bytes_may_follow_an_escape() {
    let outcome = |byte: u8| Decoder::default().push(&[0x7E, 0, 9, 0x7D, byte]).next();
    assert_eq!([0x5E, 0x5D].map(outcome), [None, None]);
    for found in [0x00, 0x5C, 0x5F, 0x7C, 0x7D, 0x7F] {
        assert_eq!(outcome(found), Some(Err(FrameError::Escape { found })));
    }
}

#[test]
fn what_does_not_fit_is_not_written() {
    let found = PAYLOAD_MAX + 1;
    let long = vec![0; found];
    let mut out = vec![0; FRAME_MAX];
    assert_eq!(encode(&long, &mut out), Err(EncodeError::TooLong { found }));
    let no_room = EncodeError::NoRoom { room: 5 };
    assert_eq!(encode(&[1, 2], &mut out[..5]), Err(no_room));
    assert_eq!(encode(&[1, 2], &mut out[..6]), Ok(6));
}

/// The length 3201 is 0C81 hex.
#[test]
fn a_length_beyond_the_buffer_is_rejected() {
    let mut decoder = Decoder::default();
    let outcome: Vec<_> = decoder.push(&[0x7E, 0x0C, 0x81]).collect();
    let (max, found) = (3_200, 3_201);
    assert_eq!(outcome, [Err(FrameError::Length { max, found })]);
    assert_eq!(decoder.discarded(), 3);
}

#[test]
fn an_escape_before_a_plain_byte_is_rejected() {
    let mut decoder = Decoder::default();
    let outcome: Vec<_> = decoder.push(&[0x7E, 0, 1, 0x7D, 0x41]).collect();
    assert_eq!(outcome, [Err(FrameError::Escape { found: 0x41 })]);
    assert_eq!((decoder.pending(), decoder.discarded()), (0, 5));
}

#[test]
fn a_pause_ends_a_frame_that_was_cut_off() {
    let mut decoder = Decoder::default();
    assert_eq!(decoder.push(&PLAIN[..4]).count(), 0);
    decoder.idle();
    let outcome: Vec<_> = decoder.push(&PLAIN).collect();
    assert_eq!(outcome[0], Err(FrameError::Truncated { found: 4 }));
    assert!(matches!(&outcome[1], Ok(frame) if frame.payload() == [1, 2]));
}

/// Defect 1: the state ERROR is overwritten by DONE, so a corrupt frame is delivered. By YE1, a
/// sound end drops the frame.
#[test]
fn ye1_corrupt_frames_are_delivered_only_with_the_defect() {
    let mut corrupt = PLAIN;
    corrupt[3] = 9;
    // The checksum should be FF - (09 + 02) = F4.
    let (expected, found) = (0xF4, 0xFC);
    let outcome: Vec<_> = Decoder::default().push(&corrupt).collect();
    assert_eq!(outcome, [Err(FrameError::Checksum { expected, found })]);
    let deliver_corrupt = true;
    let mut fielded = Decoder::new(Defects {
        deliver_corrupt,
        ..Defects::default()
    });
    let frame = fielded
        .push(&corrupt)
        .next()
        .expect("delivered")
        .expect("as a frame");
    assert_eq!((frame.payload(), frame.is_sound()), (&[9, 2][..], false));
    let mut out = [0; 6];
    assert_eq!((frame.encode(&mut out), out), (Ok(6), corrupt));
}

/// Defect 2: behind a lost byte the next start byte is data; the frame behind it is lost, too.
#[test]
fn a_lost_byte_costs_two_frames_only_with_the_defect() {
    let lost = [&PLAIN[..3], &PLAIN[4..]].concat();
    let stream = [&lost[..], &PLAIN, &encoded(&[7])].concat();
    assert_eq!(
        payloads(&mut Decoder::default(), &stream),
        [&[1, 2][..], &[7]]
    );
    let ignore_start = true;
    let mut fielded = Decoder::new(Defects {
        ignore_start,
        ..Defects::default()
    });
    assert_eq!(payloads(&mut fielded, &stream), [[7]]);
}

/// Defect 3: bytes that arrive while a frame waits are lost.
#[test]
fn bytes_behind_an_unread_frame_are_lost_only_with_the_defect() {
    let twice = [&PLAIN[..], &PLAIN].concat();
    assert_eq!(payloads(&mut Decoder::default(), &twice).len(), 2);
    let deaf_while_done = true;
    let mut fielded = Decoder::new(Defects {
        deaf_while_done,
        ..Defects::default()
    });
    assert_eq!(payloads(&mut fielded, &twice).len(), 1);
    assert_eq!(fielded.discarded(), 6);
    fielded.read_done();
    assert_eq!(payloads(&mut fielded, &PLAIN).len(), 1);
}

/// Outcomes of `stream` in pieces; every byte is in a frame, discarded or pending.
fn outcome(
    stream: &[u8],
    defects: Defects,
    mut cuts: Vec<usize>,
) -> Vec<Result<Frame, FrameError>> {
    cuts.push(stream.len());
    cuts.sort_unstable();
    let mut decoder = Decoder::new(defects);
    let (mut all, mut from, mut framed) = (Vec::new(), 0, 0);
    let mut out = vec![0; FRAME_MAX];
    for cut in cuts {
        for one in decoder.push(&stream[from..cut]).collect::<Vec<_>>() {
            let len = one
                .as_ref()
                .map_or(0, |frame| frame.encode(&mut out).expect("fits"));
            framed += len;
            all.push(one);
        }
        from = cut;
        if defects == Defects::default() {
            let discarded = usize::try_from(decoder.discarded()).expect("short");
            assert_eq!(
                framed + discarded + decoder.pending(),
                cut,
                "bytes are lost"
            );
        }
    }
    decoder.idle();
    all.extend(decoder.push(&[]));
    assert_eq!(decoder.pending(), 0);
    all
}

/// Bytes that are often special.
fn byte() -> impl Strategy<Value = u8> {
    prop_oneof![3 => any::<u8>(), 1 => Just(START), 1 => Just(ESCAPE), 1 => 0..4_u8]
}

fn stream() -> impl Strategy<Value = Vec<u8>> {
    let frame = bytes(byte(), 0..40).prop_map(|payload| encoded(&payload));
    let noise = bytes(byte(), 0..30);
    bytes(prop_oneof![frame, noise], 1..6).prop_map(|parts| parts.concat())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4 * ProptestConfig::default().cases))]

    #[test]
    fn any_cut_gives_the_same_frames(
        stream in stream(),
        cuts in bytes(any::<Index>(), 0..12),
        switches in any::<[bool; 2]>(),
    ) {
        let [deliver_corrupt, ignore_start] = switches;
        let defects = Defects { deliver_corrupt, ignore_start, deaf_while_done: false };
        let cuts = cuts.iter().map(|cut| cut.index(stream.len() + 1)).collect();
        prop_assert_eq!(outcome(&stream, defects, cuts), outcome(&stream, defects, Vec::new()));
    }

    /// YE1: any payload comes back.
    #[test]
    fn any_payload_comes_back(payload in bytes(byte(), 0..=PAYLOAD_MAX)) {
        let frame = encoded(&payload);
        prop_assert!(!frame[1..].contains(&START));
        prop_assert_eq!(payloads(&mut Decoder::default(), &frame), [payload]);
    }

    /// YE1: one damaged byte costs its frame. The next frame is decoded, unless the damage made a
    /// new start byte. A sum misses damage with an equal sum, but one flipped byte changes the sum.
    #[test]
    fn ye1_one_damaged_byte_costs_one_frame(
        payload in bytes(byte(), 1..60),
        at in any::<Index>(),
        flip in 1_u8..,
    ) {
        let mut stream = encoded(&payload);
        let at = at.index(stream.len());
        stream[at] ^= flip;
        let behind = encoded(&[1, 2, 3]);
        let got = payloads(&mut Decoder::default(), &[stream, behind].concat());
        prop_assert_eq!(got.last(), Some(&vec![1, 2, 3]));
        prop_assert!(!got.contains(&payload));
    }

    #[test]
    fn the_next_sound_frame_is_found_behind_noise(
        noise in bytes(byte(), 0..200),
        payload in bytes(byte(), 0..60),
    ) {
        let got = payloads(&mut Decoder::default(), &[noise, encoded(&payload)].concat());
        prop_assert_eq!(got.last(), Some(&payload));
    }
}

/// By hand: FF - (01 + 02) = FC, and 00 is not.
#[test]
fn a_frame_knows_whether_its_checksum_holds() {
    let mut decoder = Decoder::new(Defects {
        deliver_corrupt: true,
        ..Defects::default()
    });
    let mut damaged = PLAIN;
    damaged[5] = 0x00;
    let bytes = [PLAIN, damaged].concat();
    let frames: Vec<Frame> = decoder.push(&bytes).map(Result::unwrap).collect();
    assert_eq!([frames[0].is_sound(), frames[1].is_sound()], [true, false]);
    let shown = std::format!("{:?}", frames[1]);
    assert_eq!(shown, "telemetry::Frame([01, 02], 00)");
}

/// The longest payload, 3,200 bytes, is 0C80 hex.
#[test]
fn the_longest_payload_is_waited_for_and_one_byte_more_is_not() {
    let outcome = |low: u8| Decoder::default().push(&[0x7E, 0x0C, low]).next();
    assert_eq!(outcome(0x80), None);
    let (max, found) = (3_200, 3_201);
    assert_eq!(outcome(0x81), Some(Err(FrameError::Length { max, found })));
}

/// Either fielded defect takes any byte behind an escape: 41 is 61 with a flipped bit.
#[test]
fn a_fielded_end_takes_any_byte_behind_an_escape() {
    for (deliver_corrupt, ignore_start) in [(true, false), (false, true)] {
        let mut decoder = Decoder::new(Defects {
            deliver_corrupt,
            ignore_start,
            deaf_while_done: false,
        });
        // FF - 61 = 9E.
        let bytes = [0x7E, 0x00, 0x01, 0x7D, 0x41, 0x9E];
        assert_eq!(payloads(&mut decoder, &bytes), [[0x61]]);
    }
}

#[test]
fn errors_of_writing_tell_what_was_found() {
    let shown = |error: EncodeError| std::format!("{error}");
    assert_eq!(
        shown(EncodeError::TooLong { found: 3_201 }),
        "payload has 3201 bytes, at most 3200 allowed"
    );
    let no_room = EncodeError::NoRoom { room: 5 };
    assert_eq!(shown(no_room), "frame does not fit into 5 bytes");
}

#[test]
fn a_quiet_line_with_nothing_pending_is_no_error() {
    let mut decoder = Decoder::default();
    decoder.idle();
    assert_eq!(decoder.push(&[]).next(), None);
    assert_eq!(decoder.push(&PLAIN[..3]).next(), None);
    decoder.idle();
    let found = 3;
    assert_eq!(
        decoder.push(&[]).next(),
        Some(Err(FrameError::Truncated { found }))
    );
}
