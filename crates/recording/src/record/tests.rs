use super::*;

/// A request of seven bytes at 1 Mbaud, 10 us each. The receiver got the first five one by one and
/// the last two together.
#[test]
fn joined_chunks_come_apart_again_at_their_times() {
    let record = Record {
        link: 0,
        sequence: Some(1),
        at: Instant::from_micros(1_070),
        direction: Direction::ToDevice,
        kind: Kind::Data,
        bytes: vec![1, 2, 3, 4, 5, 6, 7].into(),
        sent: None,
        pieces: vec![1, 1, 1, 1, 1, 2],
        comment: String::new(),
    };
    let mut file = Vec::new();
    Section::default().write(&mut file);
    Interface::new("base", 1_000_000).write(&mut file);
    record.write(0, &mut file);
    let capture = crate::Capture::of(&file);
    assert_eq!(capture.records, [record]);
    let chunks = capture.records[0].chunks(LineConfig::new_8n1(1_000_000));
    let told: Vec<_> = chunks
        .iter()
        .map(|(at, bytes)| (at.as_nanos(), bytes.len()))
        .collect();
    let expected = [
        (1_010_000, 1),
        (1_020_000, 1),
        (1_030_000, 1),
        (1_040_000, 1),
    ];
    assert_eq!(told[..4], expected);
    assert_eq!(told[4..], [(1_050_000, 1), (1_070_000, 2)]);
    let joined: Vec<u8> = chunks
        .iter()
        .flat_map(|(_, bytes)| bytes.to_vec())
        .collect();
    assert_eq!(joined, [1, 2, 3, 4, 5, 6, 7]);
}

/// Six bytes cannot arrive in chunks of four and four; the reader ignores such lengths.
#[test]
fn lengths_that_do_not_add_up_are_not_believed() {
    assert_eq!(lengths(&[4, 2], 6), Vec::<u8>::new());
    assert_eq!(lengths(&[4, 1, 2, 1], 6), [4, 2]);
    assert_eq!(lengths(&[0, 255, 6, 1, 9], 6), [6]);
}

/// Each event of a link has the number that Wireshark's `rtacser` uses: 1 and 2 are data sent and
/// received, 7 to 10 are line errors, 0 is a change of control lines.
#[test]
fn each_event_has_the_number_of_the_link_type() {
    use LineEvent::{Break, Closed, FramingError, Opened, Overrun, ParityError};
    let (to_device, to_master) = (Direction::ToDevice, Direction::ToMaster);
    let kinds = [
        (Kind::Data, to_device, 1, 0x10),
        (Kind::Data, to_master, 2, 0x10),
        (Kind::Line(Opened), to_master, 0, 0x10),
        (Kind::Line(Closed), to_master, 0, 0),
        (Kind::Line(FramingError), to_device, 7, 0x10),
        (Kind::Line(ParityError), to_device, 8, 0x10),
        (Kind::Line(Break), to_device, 9, 0x10),
        (Kind::Line(Overrun), to_device, 10, 0x10),
        (Kind::Other(77), to_device, 77, 0x10),
    ];
    for (kind, direction, number, lines) in kinds {
        assert_eq!(kind.number(direction), number, "{kind:?}");
        assert_eq!(kind.control_lines(), lines, "{kind:?}");
        assert_eq!(Kind::read(number, lines), kind);
    }
    // Intercepted data of other tools.
    assert_eq!([3, 4].map(|number| Kind::read(number, 0)), [Kind::Data; 2]);
    assert_eq!(
        [5, 6, 11].map(|number| Kind::read(number, 0)),
        [5, 6, 11].map(Kind::Other)
    );
    assert_eq!(Kind::read(0, 0xEF), Kind::Line(Closed));
}

fn with_resolution(resolution: u8) -> Interface {
    Interface {
        resolution,
        ..Interface::new("x", 9600)
    }
}

/// Resolutions are powers of ten, or powers of two with the highest bit set: 3 s in each. A time
/// beyond the clock's range is the maximum time.
#[test]
fn times_are_in_the_units_of_their_interface() {
    let of = |resolution, units| with_resolution(resolution).instant(units).as_nanos();
    assert_eq!(of(9, 3_000_000_007), 3_000_000_007);
    assert_eq!(of(6, 3_000_007), 3_000_007_000);
    assert_eq!(of(0, 3), 3_000_000_000);
    assert_eq!(of(12, 3_000_000_007_999), 3_000_000_007);
    assert_eq!(of(0x80, 3), 3_000_000_000);
    assert_eq!(of(0x8A, 3 * 1024 + 512), 3_500_000_000);
    assert_eq!(of(0, u64::MAX), u64::MAX);
    assert_eq!(of(0x7F, 3), 0);
}

/// Chunks lie back to back: at 1 Mbaud, 10 us a byte. If the file lacks the baud rate, all chunks
/// have the time of the last one. Lengths that exceed the bytes, or are zero, are used as far as
/// possible.
#[test]
fn pieces_lie_back_to_back_before_their_record() {
    let told = |baud: u32, bytes: &[u8], pieces: &[u8]| -> Vec<(u64, Vec<u8>)> {
        let record = Record {
            link: 0,
            sequence: None,
            at: Instant::from_micros(1_000),
            direction: Direction::ToDevice,
            kind: Kind::Data,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: pieces.to_vec(),
            comment: String::new(),
        };
        let line = LineConfig {
            baud,
            ..LineConfig::new_8n1(1)
        };
        let chunks = record.chunks(line).into_iter();
        chunks
            .map(|(at, bytes)| (at.as_micros(), bytes.to_vec()))
            .collect()
    };
    let whole = [(1000, vec![1, 2, 3])];
    assert_eq!(told(1_000_000, &[1, 2, 3], &[]), whole);
    assert_eq!(told(1_000_000, &[1, 2, 3], &[3]), whole);
    assert_eq!(told(1_000_000, &[1, 2, 3], &[9]), whole);
    let two = [(980, vec![1]), (1000, vec![2, 3])];
    assert_eq!(told(1_000_000, &[1, 2, 3], &[1, 2]), two);
    assert_eq!(told(1_000_000, &[1, 2, 3], &[7, 2]), two);
    assert_eq!(
        told(0, &[1, 2, 3], &[1, 2]),
        [(1000, vec![1]), (1000, vec![2, 3])]
    );
    assert_eq!(told(1_000_000, &[1, 2, 3], &[4, 7, 2]), two);
    assert_eq!(told(1_000_000, &[], &[]), []);
    assert_eq!(told(1_000_000, &[], &[5]), []);
}

/// Equal lengths in a row are counted, up to 255 at a time.
#[test]
fn equal_lengths_are_one_pair() {
    assert_eq!(runs(&[1, 1, 1, 2, 1]), [1, 3, 2, 1, 1, 1]);
    assert_eq!(runs(&[4; 300]), [4, 255, 4, 45]);
    assert_eq!(lengths(&runs(&[4; 300]), 1200), [4; 300]);
    assert_eq!(runs(&[]), [0; 0]);
}

/// The facts of a section are the lines of its description; the start time is one of them.
#[test]
fn a_section_knows_its_facts() {
    let section = |about: &str| Section {
        about: about.to_owned(),
        ..Section::default()
    };
    let own = section("seed=7\nname=a=b\nclock=virtual");
    assert_eq!(own.fact("name"), Some("a=b"));
    assert_eq!((own.fact("seed"), own.fact("see")), (Some("7"), None));
    assert!(own.is_of_own_program() && !section("clock=utc").is_of_own_program());
    let imported = |format: &str| section(&format!("imported={format}\nclock=virtual"));
    assert!(!imported("log").is_of_own_program() && imported("csv").is_of_own_program());
    assert_eq!(own.start(), Instant::ZERO);
    assert_eq!(section("start_ns=12").start(), Instant::from_nanos(12));
    assert_eq!(section("start_ns=x").start(), Instant::ZERO);
}

/// The bytes of the block are written by hand: header, head of the link type, payload padded to
/// four bytes, flags, sequence number, end of the options, and the repeated length.
#[test]
fn a_record_is_written_to_the_byte() {
    let record = Record {
        link: 0,
        sequence: Some(0x0102),
        at: Instant::from_nanos(0x1_0000_0000 + 7_000),
        direction: Direction::ToDevice,
        kind: Kind::Data,
        bytes: vec![0xAB].into(),
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    };
    let mut out = Vec::new();
    record.write(3, &mut out);
    // 2^32 ns and 7 us are 4.294974296 s: seconds 4, microseconds 294974 = 0x04803E.
    let expected = [
        &[6, 0, 0, 0, 80, 0, 0, 0, 3, 0, 0, 0][..],
        &[1, 0, 0, 0, 0x58, 0x1B, 0, 0, 13, 0, 0, 0, 13, 0, 0, 0],
        &[0, 0, 0, 4, 0, 4, 0x80, 0x3E, 1, 0x10, 0, 0, 0xAB, 0, 0, 0],
        &[2, 0, 4, 0, 2, 0, 0, 0],
        &[0xAD, 0x0B, 16, 0, 0xD9, 0x7E, 0, 0, b'h', b's', b'e', b'q'],
        &[2, 1, 0, 0, 0, 0, 0, 0],
        &[0, 0, 0, 0, 80, 0, 0, 0],
    ];
    assert_eq!(out, expected.concat());
}

/// Private options of this tool have the example enterprise 32473 (RFC 5612), then the mark, then
/// any bytes.
#[test]
fn a_private_option_of_others_is_not_ours() {
    let is_ours = |enterprise: u32, mark: &[u8]| {
        let value = [&enterprise.to_le_bytes(), mark].concat();
        is_private(Order::Little, &value, b"hscn")
    };
    assert!(is_ours(32_473, b"hscn") && is_ours(32_473, b"hscn more"));
    assert!(!is_ours(32_474, b"hscn") && !is_ours(32_473, b"hscm"));
    assert!(!is_ours(32_473, b"hsc") && !is_ours(32_473, b""));
    assert!(!is_private(Order::Little, &[], b"hscn"));
}

/// A block of another tool, written by hand. Two comments become two lines. If the flags give the
/// direction (1 in, 2 out), the direction in the link type's head (1 sent, 2 received) is ignored.
#[test]
fn a_record_of_another_tool_is_read_with_all_its_options() {
    let read = |number: u8, flags: u8| {
        let options = [
            &[1, 0, 3, 0, b'o', b'n', b'e', 0][..],
            &[1, 0, 4, 0, b'm', b'o', b'r', b'e'],
            &[2, 0, 4, 0, flags, 0, 0, 0],
            &[0, 0, 0, 0],
        ];
        let block = [
            &[6, 0, 0, 0, 76, 0, 0, 0, 0, 0, 0, 0][..],
            &[0, 0, 0, 0, 7, 0, 0, 0, 13, 0, 0, 0, 13, 0, 0, 0],
            &[0, 0, 0, 0, 0, 0, 0, 0, number, 0x10, 0, 0, 0xAB, 0, 0, 0],
            &options.concat(),
            &[76, 0, 0, 0],
        ];
        let mut file = Vec::new();
        Section::default().write(&mut file);
        Interface::new("base", 9600).write(&mut file);
        file.extend(block.concat());
        let mut capture = crate::Capture::of(&file);
        assert_eq!((capture.broken, capture.cut, capture.skipped), (None, 0, 0));
        let record = capture.records.remove(0);
        assert_eq!(
            (&*record.bytes, &*record.comment),
            (&[0xAB][..], "one\nmore")
        );
        record.direction
    };
    let (to_device, to_master) = (Direction::ToDevice, Direction::ToMaster);
    assert_eq!([1, 2].map(|number| read(number, 0)), [to_device, to_master]);
    assert_eq!([1, 2].map(|number| read(number, 1)), [to_master; 2]);
    assert_eq!([1, 2].map(|number| read(number, 2)), [to_device; 2]);
}
