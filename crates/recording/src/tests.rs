use proptest::prelude::*;

use protocols::{Instant, LineEvent};

use super::record::{Kind, Record, Sent};
use super::*;
use engine::rig::line::Direction;

fn record(sequence: u64, kind: Kind, bytes: &[u8]) -> Record {
    Record {
        link: 1,
        sequence: Some(sequence),
        at: Instant::from_nanos(5_000_000_123 + sequence % 1000),
        direction: Direction::ToMaster,
        kind,
        bytes: bytes.to_vec().into(),
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    }
}

fn damaged() -> Record {
    Record {
        direction: Direction::ToDevice,
        sent: Some(Sent {
            at: Instant::from_nanos(4_999_999_000),
            bytes: vec![1, 2, 3, 4, 5].into(),
        }),
        comment: "fault: byte 7 drop".to_owned(),
        ..record(2, Kind::Data, &[1, 2, 4, 5])
    }
}

fn sample() -> (Vec<u8>, Vec<Record>) {
    let mut out = Vec::new();
    let about = "scenario=test\nseed=7\nclock=virtual".to_owned();
    let tool = "hilrig 0".to_owned();
    let scenario = String::new();
    let section = Section {
        tool,
        about,
        scenario,
    };
    section.write(&mut out);
    Interface::new("lidar", 115_200).write(&mut out);
    Interface::new("base", 1_000_000).write(&mut out);
    let records = vec![
        record(0, Kind::Data, &[0xFA, 0xA0, 0x00]),
        record(1, Kind::Line(LineEvent::Break), &[]),
        damaged(),
        record(3, Kind::Line(LineEvent::Closed), &[]),
        record(4, Kind::Line(LineEvent::Opened), &[]),
    ];
    records.iter().for_each(|record| record.write(1, &mut out));
    (out, records)
}

#[test]
fn what_was_written_is_read() {
    let (bytes, records) = sample();
    let capture = Capture::of(&bytes);
    assert_eq!(capture.records, records);
    assert_eq!(capture.sections[0].fact("seed"), Some("7"));
    assert_eq!(capture.sections[0].tool, "hilrig 0");
    let links: Vec<_> = capture.links.iter().map(|l| (&*l.name, l.baud)).collect();
    assert_eq!(links, [("lidar", 115_200), ("base", 1_000_000)]);
    assert_eq!((capture.broken, capture.cut, capture.skipped), (None, 0, 0));
}

/// Records are numbered across files; the last number of a damaged file may have any value.
#[test]
fn files_of_a_recording_follow_by_number() {
    let of = |sequence| Capture {
        records: vec![record(sequence, Kind::Data, &[1])],
        ..Capture::default()
    };
    assert!(of(4).leads_to(&of(5)));
    assert!(!of(4).leads_to(&of(6)) && !of(4).leads_to(&of(4)));
    assert!(!of(u64::MAX).leads_to(&of(0)));
    assert!(!of(4).leads_to(&Capture::default()) && !Capture::default().leads_to(&of(0)));
}

/// An option of pcapng holds less than 64 KiB.
#[test]
fn a_scenario_longer_than_an_option_comes_in_several() {
    let section = Section {
        scenario: "# long\n".repeat(20_000),
        ..Section::default()
    };
    let mut out = Vec::new();
    section.write(&mut out);
    assert_eq!(Capture::of(&out).sections, [section]);
}

/// pcapng draft, section 4.3, with the RTAC header as Wireshark's dissector reads it. The bytes are
/// written by hand, so that the test finds an error common to reader and writer.
#[test]
fn a_packet_has_the_bytes_of_the_standard() {
    let mut out = Vec::new();
    record(9, Kind::Data, &[0xAB]).write(1, &mut out);
    #[rustfmt::skip]
    let expected = [
        6, 0, 0, 0, 80, 0, 0, 0, 1, 0, 0, 0,
        // 5,000,000,132 = 1 * 2^32 + 0x2A05F284
        1, 0, 0, 0, 0x84, 0xF2, 0x05, 0x2A, 13, 0, 0, 0, 13, 0, 0, 0,
        // 5 s, 0 us, receive start, DTR; one byte, padded.
        0, 0, 0, 5, 0, 0, 0, 0, 2, 0x10, 0, 0, 0xAB, 0, 0, 0,
        // Inbound.
        2, 0, 4, 0, 1, 0, 0, 0,
        // Private: 32473, mark, number 9.
        0xAD, 0x0B, 16, 0, 0xD9, 0x7E, 0, 0, b'h', b's', b'e', b'q', 9, 0, 0, 0, 0, 0, 0, 0,
        0, 0, 0, 0, 80, 0, 0, 0,
    ];
    assert_eq!(out, expected);
}

/// A section of another machine: most significant byte first, microseconds, no sequence numbers, an
/// unknown block in between. The bytes are written by hand.
#[test]
fn a_big_endian_file_with_unknown_blocks_is_read() {
    #[rustfmt::skip]
    let bytes = [
        0x0A, 0x0D, 0x0D, 0x0A, 0, 0, 0, 28, 0x1A, 0x2B, 0x3C, 0x4D, 0, 1, 0, 0,
        255, 255, 255, 255, 255, 255, 255, 255, 0, 0, 0, 28,
        0, 0, 0, 1, 0, 0, 0, 20, 0, 250, 0, 0, 0, 0, 0, 0, 0, 0, 0, 20,
        0, 0, 0, 99, 0, 0, 0, 16, 1, 2, 3, 4, 0, 0, 0, 16,
        0, 0, 0, 6, 0, 0, 0, 48, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 14, 0, 0, 0, 14,
        0, 0, 0, 0, 0, 0, 0, 2, 1, 0, 0, 0, 0x55, 0xAA, 0, 0, 0, 0, 0, 48,
    ];
    let capture = Capture::of(&bytes);
    assert_eq!((capture.broken, capture.cut, capture.skipped), (None, 0, 1));
    let [record] = &capture.records[..] else {
        panic!("{:?}", capture.records)
    };
    assert_eq!(record.bytes[..], [0x55, 0xAA]);
    assert_eq!(record.at, Instant::from_micros(2));
    assert_eq!(record.direction, Direction::ToDevice);
}

/// A failed machine leaves a cut file. The reader finds all whole blocks, wherever the cut is.
#[test]
fn a_file_cut_at_any_byte_yields_all_whole_blocks() {
    let (bytes, records) = sample();
    let mut ends = Vec::new();
    let mut reader = Reader::default();
    reader.push(&bytes);
    while let Some(item) = reader.next_item() {
        if let Ok(Item::Record(_)) = item {
            ends.push(reader.blocks.offset);
        }
    }
    for cut in 0..=bytes.len() {
        let whole = ends.iter().filter(|&&end| end <= cut as u64).count();
        let capture = Capture::of(&bytes[..cut]);
        assert_eq!(capture.records, records[..whole], "cut at {cut}");
        assert_eq!(capture.broken, None);
    }
}

#[test]
fn an_error_names_its_offset() {
    let (mut bytes, _) = sample();
    let text = |bytes: &[u8]| Capture::of(bytes).broken.map(|error| error.to_string());
    let second = usize::from(bytes[4]);
    bytes[second + 4] = 3;
    let expected = format!("at byte {second}: block length 3 is impossible");
    assert_eq!(text(&bytes), Some(expected));
    let expected = "at byte 0: no pcapng section header".to_owned();
    assert_eq!(text(b"PCUI_MSG"), Some(expected));
}

proptest! {
    /// Any bytes, in pieces of any size: no panic, and the same items.
    #[test]
    fn garbage_is_read_the_same_in_all_pieces(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        size in 1_usize..40,
    ) {
        let (mut bytes, _) = sample();
        for (at, value) in damage {
            *at.get_mut(&mut bytes) = value;
        }
        let whole = Capture::of(&bytes);
        let (mut pieces, mut reader) = (Capture::default(), Reader::default());
        bytes.chunks(size).for_each(|piece| pieces.feed(&mut reader, piece));
        prop_assert_eq!(pieces.records, whole.records);
        prop_assert_eq!(pieces.broken, whole.broken);
    }

    #[test]
    fn no_bytes_panic(bytes: Vec<u8>) {
        let (mut file, _) = sample();
        file.extend(&bytes);
        Capture::of(&file);
        Capture::of(&bytes);
    }
}
