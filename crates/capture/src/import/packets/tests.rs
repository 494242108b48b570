use super::*;
use crate::import::{Format, read as read_format};
use crate::{Interface, Record, Section};

const READ: [u8; 5] = [0xAB, 0x24, 0x0A, 0x00, 0xD9];

type Told = Vec<(u64, Direction, Vec<u8>)>;

fn told(file: &[u8]) -> Result<(Told, Vec<String>), String> {
    assert_eq!(Format::detect(file), Some(Format::Pcap));
    let found = read_format(file, Format::Pcap, &Options::default());
    let found = found.map_err(|error| error.to_string())?;
    let tuple = |one: &Record| (one.at.as_nanos() / 1000, one.direction, one.bytes.to_vec());
    Ok((found.records().iter().map(tuple).collect(), found.notes))
}

/// A classic pcap file of packets at 1.5 s and a second later.
fn classic_file(link_type: u32, magic: u32, part: u32, big: bool, packets: &[&[u8]]) -> Vec<u8> {
    let word = |number: u32| {
        if big {
            number.to_be_bytes()
        } else {
            number.to_le_bytes()
        }
    };
    let half = |number: u16| {
        if big {
            number.to_be_bytes()
        } else {
            number.to_le_bytes()
        }
    };
    let mut out = word(magic).to_vec();
    [2, 4].iter().for_each(|&number| out.extend(half(number)));
    [0, 0, 65_535, link_type]
        .iter()
        .for_each(|&number| out.extend(word(number)));
    for (second, packet) in (1..).zip(packets) {
        let len = u32::try_from(packet.len()).expect("short");
        [second, part, len, len]
            .iter()
            .for_each(|&number| out.extend(word(number)));
        out.extend_from_slice(packet);
    }
    out
}

/// Magic numbers of microseconds and nanoseconds, in both byte orders: a million microseconds and a
/// billion nanoseconds are a second.
#[test]
fn a_classic_file_is_read_in_all_four_forms() {
    for (magic, part, big) in [
        (0xA1B2_C3D4, 500_000, false),
        (0xA1B2_C3D4, 500_000, true),
        (0xA1B2_3C4D, 500_000_000, false),
        (0xA1B2_3C4D, 500_000_000, true),
    ] {
        let file = classic_file(147, magic, part, big, &[&READ, b"\x01"]);
        let (told, notes) = told(&file).expect("sound");
        let way = Direction::ToMaster;
        let expected = [(1_500_000, way, READ.to_vec()), (2_500_000, way, vec![1])];
        assert_eq!(told, expected);
        assert!(notes[0].contains("--from program"), "{notes:?}");
    }
}

fn option(code: u16, value: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    pcapng::write_option(&mut out, code, value);
    out
}

/// A pcapng file of one interface; each packet at 1.5 s, with flags if there are any.
fn blocks_file(link_type: u16, interface: &[u8], packets: &[(&[u8], Option<u8>)]) -> Vec<u8> {
    let mut out = Vec::new();
    pcapng::write_block(&mut out, pcapng::SECTION, pcapng::write_section_head);
    pcapng::write_block(&mut out, pcapng::INTERFACE, |out| {
        out.extend(link_type.to_le_bytes());
        out.extend([0; 6]);
        out.extend(interface);
    });
    for (bytes, flags) in packets {
        pcapng::write_block(&mut out, pcapng::PACKET, |out| {
            let len = u32::try_from(bytes.len()).expect("short");
            let numbers = [0, 0, 1_500_000, len, len];
            numbers
                .iter()
                .for_each(|number: &u32| out.extend(number.to_le_bytes()));
            let start = out.len();
            out.extend_from_slice(bytes);
            pcapng::pad(out, start);
            if let Some(flags) = flags {
                out.extend(option(2, &[*flags, 0, 0, 0]));
            }
        });
    }
    out
}

/// Flags 1 and 2 mean received and sent by the host; USER0 to USER15 are 147 to 162.
#[test]
fn packets_of_private_link_types_are_the_bytes_of_the_line() {
    for link_type in [147, 150, 162] {
        let interface = option(2, b"base");
        let packets: [(&[u8], _); 2] = [(&READ, Some(2)), (b"\x01", Some(1))];
        let file = blocks_file(link_type, &interface, &packets);
        let (told, notes) = told(&file).expect("sound");
        let expected = [
            (1_500_000, Direction::ToDevice, READ.to_vec()),
            (1_500_000, Direction::ToMaster, vec![1]),
        ];
        assert_eq!((told, notes), (expected.to_vec(), vec![]));
    }
}

/// A capture of this tool is read back unchanged.
#[test]
fn serial_packets_lose_their_head() {
    let mut file = Vec::new();
    Section::default().write(&mut file);
    Interface::new("base", 1_000_000).write(&mut file);
    let record = Record {
        link: 0,
        sequence: Some(0),
        at: protocols::Instant::from_micros(7),
        direction: Direction::ToDevice,
        kind: Kind::Data,
        bytes: READ.to_vec().into(),
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    };
    record.write(0, &mut file);
    let (told, _) = told(&file).expect("sound");
    assert_eq!(told, [(7, Direction::ToDevice, READ.to_vec())]);
    let found = read_format(&file, Format::Pcap, &Options::default()).expect("sound");
    assert_eq!(
        (found.links()[0].name.as_str(), found.links()[0].baud),
        ("base", 1_000_000)
    );
}

#[test]
fn packets_of_networks_are_refused_with_the_next_step() {
    for (link_type, step) in [
        (1, "tshark -r FILE -Y tcp.payload"),
        (113, "tshark"),
        (227, "CAN"),
        (201, "btrfcomm"),
        (288, "usbmon"),
        (300, "link type 300"),
    ] {
        let file = blocks_file(link_type, &[], &[(&[0; 60], None)]);
        let error = told(&file).expect_err("no serial bytes");
        assert!(error.contains(step), "{error}");
    }
    let empty = blocks_file(147, &[], &[]);
    assert!(told(&empty).expect_err("empty").contains("no packets"));
}

#[test]
fn a_cut_file_or_packet_is_told() {
    let file = classic_file(147, 0xA1B2_C3D4, 0, false, &[&READ, &READ]);
    let (found, notes) = told(&file[..file.len() - 3]).expect("the first is whole");
    assert_eq!(found.len(), 1);
    assert!(notes[0].contains("18 bytes at its end"), "{notes:?}");
    let mut short = file.clone();
    short[24 + 12] = 9;
    assert!(
        told(&short)
            .expect_err("cut")
            .contains("cut 4 bytes off a packet")
    );
    let mut blocks = blocks_file(147, &[], &[(&READ, None)]);
    let last = blocks.len() - 1;
    blocks[last] = 0xFF;
    assert!(
        told(&blocks)
            .expect_err("damaged")
            .contains("pcapng file is damaged")
    );
}

/// The name of the only interface is that of the tool; a given name replaces it.
#[test]
fn a_given_name_replaces_that_of_the_only_interface() {
    let interface = option(2, b"Fake IF, text2pcap");
    let file = blocks_file(147, &interface, &[(&READ, None)]);
    for (given, name) in [(None, "Fake IF, text2pcap"), (Some("hoist"), "hoist")] {
        let mut options = Options::default();
        if let Some(given) = given {
            options.link = given.to_owned();
        }
        let found = read_format(&file, Format::Pcap, &options).expect("sound");
        assert_eq!(found.links()[0].name, name);
    }
}

/// A power of ten, or of two with the highest bit.
#[test]
fn the_resolution_of_an_interface_is_a_power() {
    assert_eq!(
        (nanos(1_500, 3), nanos(1_500_000, 6)),
        (1_500_000_000, 1_500_000_000)
    );
    assert_eq!(
        (nanos(3, 0x81), nanos(7, 9), nanos(7, 0)),
        (1_500_000_000, 7, 7_000_000_000)
    );
    assert_eq!((units(1, 2), units(0, 9)), (0x1_0000_0002, 9));
}

#[test]
fn a_foreign_link_type_is_named_with_the_next_step() {
    for (link_types, name, step) in [
        (&[0][..], "loopback", "tcp.payload"),
        (&[1], "Ethernet", "tcp.payload"),
        (&[101, 228, 229], "IP", "tcp.payload"),
        (&[113, 276], "\"any\" of Linux", "tcp.payload"),
        (&[187, 201], "Bluetooth HCI", "btrfcomm.data"),
        (&[288, 293, 294, 295], "raw USB packets", "usbmon1"),
        (&[227], "CAN", "no CAN"),
        (&[105, 127], "WLAN", "data.data"),
        (&[195, 215, 230, 283], "IEEE 802.15.4", "data.data"),
        (&[251, 256], "Bluetooth Low Energy", "data.data"),
    ] {
        for &link_type in link_types {
            let words = refusal(&[link_type, 1]);
            let begin = format!("link type {link_type} ({name}) carries no serial bytes; ");
            assert!(words.starts_with(&begin) && words.contains(step), "{words}");
        }
    }
    assert!(refusal(&[9_999]).starts_with("link type 9999 carries"));
    assert_eq!(refusal(&[]), "the file has no packets");
}

/// Types of events of RTAC serial: bytes from either end, line errors, and control lines, of which
/// bit 4 is DTR.
#[test]
fn events_of_rtac_serial_have_kinds() {
    for (event, lines, expected, is_sent) in [
        (0, 0x00, Kind::Line(LineEvent::Closed), None),
        (0, 0x0F, Kind::Line(LineEvent::Closed), None),
        (0, 0x10, Kind::Line(LineEvent::Opened), None),
        (1, 0, Kind::Data, Some(true)),
        (2, 0, Kind::Data, Some(false)),
        (3, 0, Kind::Data, Some(true)),
        (4, 0, Kind::Data, Some(false)),
        (5, 0, Kind::Other(5), None),
        (7, 0, Kind::Line(LineEvent::FramingError), None),
        (8, 0, Kind::Line(LineEvent::ParityError), None),
        (9, 0, Kind::Line(LineEvent::Break), None),
        (10, 0, Kind::Line(LineEvent::Overrun), None),
        (11, 0, Kind::Other(11), None),
    ] {
        assert_eq!(
            (kind(event, lines), sent_by(event)),
            (expected, is_sent),
            "{event}"
        );
    }
}

/// Two ports: the first is unnamed, so that its name has its number.
#[test]
fn several_interfaces_are_several_links() {
    let mut file = blocks_file(147, &[], &[(&READ, Some(2))]);
    let second = blocks_file(147, &option(2, b"base"), &[(b"\x01", Some(1))]);
    file.extend(&second);
    let found = read_format(&file, Format::Pcap, &Options::default()).expect("sound");
    let names: Vec<&str> = found.links().iter().map(|link| &*link.name).collect();
    assert_eq!(names, ["line-0", "base"]);
    let links: Vec<usize> = found.records().iter().map(|one| one.link).collect();
    assert_eq!(links, [0, 1]);
}

/// A file that ends within a block; invalid blocks, and packets of a network beside serial ones.
#[test]
fn what_is_no_packet_is_noted() {
    let whole = blocks_file(147, &[], &[(&READ, Some(1)), (&READ, Some(1))]);
    assert!(told(&whole).expect("sound").1.is_empty());
    let (found, notes) = told(&whole[..whole.len() - 5]).expect("the first is whole");
    assert_eq!(found.len(), 1);
    assert!(notes[0].starts_with("the file was cut: "), "{notes:?}");
    let mut other = whole.clone();
    pcapng::write_block(&mut other, pcapng::PACKET, |out| {
        out.extend(
            [9_u32, 0, 0, 0, 0]
                .iter()
                .flat_map(|word| word.to_le_bytes()),
        );
    });
    let (_, notes) = told(&other).expect("sound");
    assert_eq!(notes, ["1 blocks of the file are invalid and are skipped"]);
    let mut both = whole;
    both.extend(blocks_file(1, &[], &[(&[0; 60], None)]));
    let (found, notes) = told(&both).expect("sound");
    assert_eq!(found.len(), 2);
    assert_eq!(
        notes,
        ["1 packets of link type 1 (Ethernet) are skipped: they contain no serial bytes"]
    );
}

/// A simple packet has no time; an old one has the number of its interface in 16 bits. Both are of
/// the interfaces of their own section.
#[test]
fn simple_and_old_packets_are_read() {
    let block = |kind: u32, body: &[u8]| {
        let mut out = Vec::new();
        pcapng::write_block(&mut out, kind, |out| {
            let start = out.len();
            out.extend_from_slice(body);
            pcapng::pad(out, start);
        });
        out
    };
    let words =
        |list: &[u32]| -> Vec<u8> { list.iter().flat_map(|word| word.to_le_bytes()).collect() };
    let mut file = blocks_file(147, &option(2, b"first"), &[(b"\x01", Some(1))]);
    file.extend(blocks_file(148, &option(2, b"second"), &[]));
    file.extend(block(3, &[&words(&[5])[..], &READ].concat()));
    file.extend(block(
        2,
        &[&words(&[0, 0, 2_500_000, 5, 5])[..], &READ].concat(),
    ));
    let found = read_format(&file, Format::Pcap, &Options::default()).expect("sound");
    let records = found.records().iter();
    let records: Vec<_> = records
        .map(|one| (one.at.as_micros(), one.link, one.bytes.to_vec()))
        .collect();
    let names: Vec<&str> = found.links().iter().map(|link| &*link.name).collect();
    assert_eq!(names, ["first", "second"]);
    assert_eq!(
        records,
        [
            (0, 1, READ.to_vec()),
            (1_500_000, 0, vec![1]),
            (2_500_000, 1, READ.to_vec())
        ]
    );
    assert!(
        found.notes.iter().all(|note| !note.contains("invalid")),
        "{:?}",
        found.notes
    );
}

/// The second interface of the second section; bits 0 and 1 of the flags are the direction, other
/// bits mean other things.
#[test]
fn interfaces_of_a_section_are_numbered() {
    let mut file = blocks_file(147, &option(2, b"first"), &[(b"\x01", Some(1))]);
    file.extend(blocks_file(148, &option(2, b"second"), &[]));
    pcapng::write_block(&mut file, pcapng::INTERFACE, |out| {
        out.extend(149_u16.to_le_bytes());
        out.extend([0; 6]);
        out.extend(option(2, b"third"));
    });
    for (interface, flags, byte) in [(1_u32, 0x06_u8, 7), (0, 0x09, 8), (1, 0x0B, 9)] {
        pcapng::write_block(&mut file, pcapng::PACKET, |out| {
            let words = [interface, 0, 2_000_000, 1, 1];
            out.extend(words.iter().flat_map(|word| word.to_le_bytes()));
            out.extend([byte, 0, 0, 0]);
            out.extend(option(2, &[flags, 0, 0, 0]));
        });
    }
    let found = read_format(&file, Format::Pcap, &Options::default()).expect("sound");
    let records = found.records().iter().map(|one| {
        let name = &*found.links()[one.link].name;
        (name, one.direction, one.bytes[0])
    });
    let (to, from) = (Direction::ToDevice, Direction::ToMaster);
    assert_eq!(
        records.collect::<Vec<_>>(),
        [
            ("first", from, 1),
            ("third", to, 7),
            ("second", from, 8),
            // 3 is no direction: such packets are taken as received.
            ("third", from, 9),
        ]
    );
}

/// RTAC serial has twelve bytes before those of the line, with the event in byte 8 and the control
/// lines in byte 9. A shorter packet, and data without a byte, are left out.
#[test]
fn a_packet_of_rtac_serial_has_a_head() {
    let packet = |event: u8, lines: u8, bytes: &[u8]| {
        let head = [
            0xA1, 0xA2, 0xA3, 0xA4, 0xA5, 0xA6, 0xA7, 0xA8, event, lines, 0xAB, 0xAC,
        ];
        [&head[..], bytes].concat()
    };
    let packets = [
        packet(1, 0, b"out"),
        packet(2, 0, b"in"),
        packet(0, 0x10, b""),
        packet(0, 0x0F, b""),
        packet(4, 0, b""),
        packet(3, 0, b"x")[..11].to_vec(),
        packet(7, 0, b""),
    ];
    let slices: Vec<&[u8]> = packets.iter().map(|packet| &packet[..]).collect();
    let file = classic_file(250, 0xA1B2_C3D4, 0, false, &slices);
    for from in [Options::default().direction, Direction::ToDevice] {
        let options = Options {
            direction: from,
            ..Options::default()
        };
        let found = read_format(&file, Format::Pcap, &options).expect("sound");
        let (to, from) = (Direction::ToDevice, Direction::ToMaster);
        let mut records = found.records().iter();
        let records: Vec<_> = records
            .by_ref()
            .map(|one| {
                (
                    one.at.as_millis() / 1_000,
                    one.direction,
                    one.kind,
                    &one.bytes[..],
                )
            })
            .take(2)
            .collect();
        let expected = [
            (1, to, Kind::Data, &b"out"[..]),
            (2, from, Kind::Data, b"in"),
        ];
        assert_eq!(records, expected);
        let kinds: Vec<Kind> = found.records()[2..].iter().map(|one| one.kind).collect();
        let events = [
            LineEvent::Opened,
            LineEvent::Closed,
            LineEvent::FramingError,
        ];
        assert_eq!(kinds, events.map(Kind::Line));
    }
}

/// A packet has 16 MiB at most.
#[test]
fn a_packet_has_a_limit() {
    let count = |len: usize| {
        let file = classic_file(147, 0xA1B2_C3D4, 0, false, &[&READ, &vec![7; len]]);
        let head = classic(&file).expect("a classic file");
        let found = read_classic(&file, head);
        (found.packets.len(), found.notes.len())
    };
    assert_eq!((count(PACKET_MAX), count(PACKET_MAX + 1)), ((2, 0), (1, 1)));
}

/// A packet of a private link type has the direction of the host; `--from` reverses it. RTAC serial
/// names both ends itself.
#[test]
fn the_direction_of_a_private_link_type_may_be_reversed() {
    let file = blocks_file(147, &[], &[(&READ, Some(2)), (b"\x01", Some(1))]);
    let (to, from) = (Direction::ToDevice, Direction::ToMaster);
    for (direction, expected) in [(from, [to, from]), (to, [from, to])] {
        let options = Options {
            direction,
            ..Options::default()
        };
        let found = read_format(&file, Format::Pcap, &options).expect("sound");
        let found = found.records().iter().map(|one| one.direction);
        assert_eq!(found.collect::<Vec<_>>(), expected);
    }
}

/// The block of an interface has eight bytes or more. One that is shorter is counted, and is none.
#[test]
fn a_short_interface_is_counted() {
    let mut file = Vec::new();
    pcapng::write_block(&mut file, pcapng::SECTION, pcapng::write_section_head);
    pcapng::write_block(&mut file, pcapng::INTERFACE, |out| out.extend([0; 4]));
    let whole = blocks_file(147, &[], &[(&READ, Some(1))]);
    file.extend(whole);
    let (found, notes) = told(&file).expect("sound");
    assert_eq!(found.len(), 1);
    assert_eq!(notes, ["1 blocks of the file are invalid and are skipped"]);
}
