//! Requirements on every row, on frames of real devices or of independent implementations.

use protocols::FrameError;

use super::*;

/// A frame, its words, and the index of a byte; damage there needs a repair of checksum or header.
struct Golden {
    codec: &'static Codec,
    frame: Vec<u8>,
    words: &'static str,
    flip: usize,
}

/// First packet of the capture "hand in box"; a turn with one distance; vectors of the fielded
/// base, in both orders; the fielded robot's row of unknown cells; a pen with an independent CRC;
/// the info of a real A1M8; telemetry by hand: 300 ms, manual, 0.5 m/s and -1 rad/s, whose bytes
/// come to 0x298; outputs by hand, 7500 = 0x1D4C is 4C 3A, 2500 = 0x09C4 is 44 13; a frame that was
/// read from a car's board (269 = 0x010D, 7200 = 0x1C20), its largest commands, a line whose CRC
/// is of an independent CRC-16 with first value FFFF, a marker 1500 mm ahead; the
/// phone's emergency stop, laid out by hand (1.0 is 3F800000).
fn golden() -> [Golden; 14] {
    let write = "46: speed_left_to=20 ticks/40 ms speed_right_to=-20 ticks/40 ms motor_standby=0";
    let mut turn = b"\x5A\xA5\x00\xC0\x94\xD1".to_vec();
    turn.extend(b"\x35\x80\x00\x00".repeat(360));
    turn[34..38].copy_from_slice(&[0xE8, 0x03, 133, 0]);
    let row = |codec, frame: &[u8], words, flip| Golden {
        codec,
        frame: frame.to_vec(),
        words,
        flip,
    };
    [
        row(
            &XV11,
            b"\xFA\xA0\x4E\x4A\x27\x01\x05\x04\x27\x01\xD7\x03\x26\x01\x29\x04\x26\x01\xF0\x03\x3C\x5C",
            "297.22 rpm, from 0 deg: 295 295 294 294 mm",
            5,
        ),
        row(
            &XV11_TURN,
            &turn,
            "turn, period word 0xd194, 1 ok, 0 weak, 359 invalid",
            2,
        ),
        row(&BUS, b"\xAB\x2E\x83\x14\xEC\x00\x5C\x02", write, 3),
        row(&BUS_HIGH_FIRST, b"\xAB\x2E\x83\x14\xEC\x00\x02\x5C", write, 3),
        row(
            &PCUI,
            b"PCUI_MSG\x07\x00\x29\x02\x00\x00MAR\x00\x00\x00\xFF\x7F\x2C\x7F",
            "MAR layer 0 row 0, 299 pixels in 4 bytes",
            18,
        ),
        row(
            &PANEL,
            b"\x7E\x54\x00\x05\x01\x01\x23\x0A\xBC\x0D\xE7",
            "pen down at 291,2748",
            6,
        ),
        row(
            &RPLIDAR,
            b"\xA5\x5A\x14\x00\x00\x00\x04\x18\x1D\x01\x07\x92\xD8\xED\x93\xC0\xEA\x98\xC9\xA5\xE6\x98\
                \xF2\x07\x06\x46\x69",
            "model 18, firmware 1.29, hardware 7, serial 92D8ED93C0EA98C9A5E698F207064669",
            1,
        ),
        row(
            &TELEMETRY,
            b"\x7E\x00\x13\x08\xAC\x02\x12\x02\x08\x02\x1A\x0A\x0D\x00\x00\x00\x3F\x15\x00\x00\
                \x80\xBF\x67",
            "command at 300 ms: manual, drive 0.5 m/s -1 rad/s",
            6,
        ),
        row(
            &PERIPHERALS,
            b"\x81\x4C\x3A\x44\x13\x0A",
            "duty 75 % 25 %, drivers on, ADC 2",
            0,
        ),
        row(
            &CAR_BOARD,
            b"\x00\x0F\x0D\x00\xC8\x00\x96\x00\x00\x0D\x01\x20\x1C",
            "front 13 cm, right 200 cm, left 150 cm, hall 269, 7.2 V",
            1,
        ),
        row(
            &ODOMETER,
            b"1250*500*1500*12345*D147*\r\n",
            "1.250 m, 0.500 rad/s, 1.500 rad, 12.345 s",
            1,
        ),
        row(&CAR_COMMAND, b"\x94\x64", "motor 10, steering 50", 1),
        row(
            &PERCEPTION,
            b"\x4D\x11\x00\xFF\xFF\xFF\xFF\x02\x00\x00\x00\xDC\x05\x00\x00\x00\x00\xF0\xD8",
            "marker 17: 1500 mm ahead, -1 mm to the right",
            0,
        ),
        row(&OSC, b"/1/kill\0,f\0\0\x3F\x80\0\0", "/1/kill 1", 0),
    ]
}

#[test]
fn every_row_has_its_golden_frame() {
    let golden = golden().map(|one| one.codec.name());
    let rows: Vec<_> = all().into_iter().map(Codec::name).collect();
    assert_eq!(rows, golden);
}

#[test]
fn a_golden_frame_is_guessed_and_put_in_words() {
    for Golden {
        codec,
        frame,
        words,
        ..
    } in golden()
    {
        // A format without a checksum needs several.
        let several = usize::from(codec.floor().frames);
        assert_eq!(guess(&frame.repeat(several)), Some(codec), "{codec:?}");
        let all = 0..frame.len() as u64;
        let what = What::Frame(words.to_owned());
        assert_eq!(codec.found(&frame), [Stretch { bytes: all, what }]);
        assert_eq!(codec.frame_at(&frame), Some(frame.len()), "{codec:?}");
    }
    assert_eq!(guess(b"nothing of ours"), None);
}

#[test]
fn a_damaged_frame_is_none_until_it_is_repaired() {
    for Golden {
        codec,
        mut frame,
        flip,
        ..
    } in golden()
    {
        frame[flip] ^= 0x01;
        assert_eq!(codec.framed(&frame), 0, "{codec:?}");
        codec.repair(&mut frame);
        assert_eq!(codec.framed(&frame), frame.len() as u64, "{codec:?}");
    }
}

/// The decoder waits for the rest of half a frame. A pause discards the half, and the next whole
/// frame is found.
#[test]
fn a_pause_ends_half_a_frame() {
    for Golden { codec, frame, .. } in golden() {
        assert!(!codec.idle().is_zero());
        let half = &frame[..frame.len() / 2];
        let mut stream = Stream::new(codec);
        assert_eq!(stream.push(half), [], "{codec:?}");
        let found = stream.idle();
        let What::Bad(errors) = &found[0].what else {
            panic!("{codec:?}: {found:?}")
        };
        let cut = u32::try_from(half.len()).expect("short");
        assert_eq!(errors[0], FrameError::Truncated { found: cut });
        let mut whole = stream.push(&frame);
        whole.extend(stream.idle());
        assert!(whole.iter().any(Stretch::is_frame), "{codec:?}");
    }
}

/// Sixteen bytes of 25 are in frames: less than three quarters.
#[test]
fn short_frames_are_not_guessed_where_most_bytes_are_none() {
    let pairs = b"\x8C\x3A".repeat(8);
    assert_eq!(guess(&pairs), Some(&CAR_COMMAND));
    let mixed = [&pairs[..], &[0xFE; 9]].concat();
    assert_eq!(CAR_COMMAND.framed(&mixed), 16);
    assert_eq!(guess(&mixed), None);
}

/// One byte in 97 is damaged and one in 151 is lost, after a line of text. The format is recognised
/// nevertheless.
#[test]
fn a_damaged_stream_is_still_told() {
    for Golden { codec, frame, .. } in golden() {
        let frames = 4 + 1_500 / frame.len();
        let bytes = frame.repeat(frames).into_iter().zip(0_usize..);
        let bytes = bytes.filter(|(_, at)| at % 151 != 150);
        let damaged = bytes.map(|(byte, at)| if at % 97 == 96 { byte ^ 0x10 } else { byte });
        let stream: Vec<u8> = b"boot 1.2\r\n".iter().copied().chain(damaged).collect();
        // Turns of 1446 bytes and messages of 1000 bytes would hardly survive this damage, so they
        // stay intact here.
        let stream = if frame.len() > 97 {
            frame.repeat(3)
        } else {
            stream
        };
        assert_eq!(guess(&stream), Some(codec), "{codec:?}");
    }
}

/// A counter counts the frames and errors that the stream reports.
#[test]
fn counting_comes_to_the_same_as_telling() {
    for Golden { codec, frame, .. } in golden() {
        let mut counter = Counter::new(codec);
        // A format without a checksum may wait for the bytes after a frame.
        let counts = [counter.push(&frame.repeat(3)), counter.idle()];
        let sum = |of: fn(&Count) -> u64| counts.iter().map(of).sum::<u64>();
        assert_eq!(
            (sum(|it| it.frames), sum(|it| it.errors)),
            (3, 0),
            "{codec:?}"
        );
        counter.push(&frame[..frame.len().min(6) / 2]);
        let count = counter.idle();
        assert!(count.frames == 0 && count.errors > 0, "{codec:?}");
    }
}

#[test]
fn names_of_rows_and_targets_are_unique() {
    assert_eq!(register(PCUI), Err(NameTaken::new("pcui")));
    let as_rle = Codec::of::<Pcui>("another").fuzzed_as("rle");
    assert_eq!(register(as_rle), Err(NameTaken::new("rle")));
    let mut targets: Vec<_> = targets().iter().map(|target| target.name).collect();
    targets.sort_unstable();
    targets.dedup();
    assert_eq!(targets.len(), all().len() + 2);
    assert_eq!(names()[..2], ["bus", "bus-high-first"]);
}
