//! Figures and diagnoses of lines with a described format. Formats that a test describes stay known
//! to its process, so these tests have one of their own.

use std::sync::Arc;

use ::description::Description;
use engine::codec::Codec;
use engine::rig::line::Direction;
use engine::scenario::device::description::codec_of;
use hilrig_capture::decode::diagnose::{Change, Damage, Line, diagnose};
use hilrig_capture::decode::framed::Framed;
use hilrig_capture::decode::profile::messages;
use hilrig_capture::decode::transcript::{Known, Transcript};
use hilrig_capture::{Capture, Interface, Kind, Record, Section};
use protocols::Instant;

fn description(name: &str, frame: &str) -> Arc<Description> {
    let text = format!(
        "name = \"{name}\"\nabout = \"a meter\"\nendian = \"little\"\nline = {{ baud = 9600 }}\n\
         frame = {{ {frame} }}\n\
         message = [{{ name = \"all\", from = \"both\", fields = [{{ name = \"data\", type = \
         \"bytes\", size = \"rest\" }}] }}]\non = [{{ message = \"all\", reply = \"all\" }}]\n"
    );
    let none = |_: &str| Err("no file".to_owned());
    Description::parse("own.toml", &text, &none).unwrap_or_else(|error| panic!("{error}"))
}

/// A capture of a device that sends these messages, each 100 ms after the one before.
fn capture(messages: &[Vec<u8>]) -> Capture {
    let mut out = Vec::new();
    Section::default().write(&mut out);
    Interface::new("x", 9_600).write(&mut out);
    for (number, bytes) in (1..).zip(messages) {
        let record = Record {
            link: 0,
            sequence: None,
            at: Instant::from_millis(100 * number),
            direction: Direction::ToMaster,
            kind: Kind::Data,
            bytes: bytes.clone().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        record.write(0, &mut out);
    }
    Capture::of(&out)
}

fn framed(codec: &'static Codec, all: &[Vec<u8>]) -> Framed {
    Framed::of(codec, &capture(all), 0, Direction::ToMaster)
}

fn damages(codec: &'static Codec, all: &[Vec<u8>]) -> Vec<Damage> {
    let capture = capture(all);
    let direction = Direction::ToMaster;
    let framed = Framed::of(codec, &capture, 0, direction);
    diagnose(&Line {
        bytes: &all.concat(),
        codec: Some(codec),
        direction: Some(direction),
        framed: Some(framed.framed),
        messages: &messages(&capture.records, 0, &capture.links[0], direction),
        ..Line::default()
    })
}

/// The sum of 01 02 is 03. Only the silence ends a frame: without the times, all frames are one.
#[test]
fn bytes_in_frames_are_counted_by_the_times() {
    let codec = codec_of(&description("silent", "silence = 3.5, checksum = \"sum8\""));
    let sound = framed(codec, &vec![vec![1, 2, 3]; 30]);
    assert_eq!((sound.bytes, sound.framed, sound.frames), (90, 90, 30));
    assert_eq!(sound.doubt("silent", false), None);
    assert_eq!(damages(codec, &vec![vec![1, 2, 3]; 30]), []);

    let mut all = vec![vec![1, 2, 4]; 20];
    all.extend(vec![vec![1, 2, 3]; 10]);
    let doubt = framed(codec, &all).doubt("silent", false);
    let doubt = doubt.expect("60 of 90 bytes are in no frame");
    assert_eq!(
        doubt,
        "only 30 of the 90 bytes are in valid frames of silent: 20 candidates have a wrong \
         checksum, the first: checksum is 0x0004, expected 0x0003; check the description, the \
         direction and the baud rate"
    );
}

/// Forty frames of SLIP with a CRC, whose bodies contain two or three NUL bytes and XON.
fn slip(of: &Description) -> Vec<Vec<u8>> {
    let frame = |number: u8| {
        let body = [0x81, number, 0, 0x11, number ^ 0x5A, 0, number % 2];
        of.frame_of(0, &body).expect("it fits")
    };
    (1..=40).map(frame).collect()
}

/// A change of all frames of a described format is proved by undoing it: all bytes are then in
/// valid frames.
#[test]
fn a_change_is_named_that_makes_all_frames_valid_if_undone() {
    let of = description("slip", "stuffing = \"slip\", checksum = \"CRC-16/MODBUS\"");
    let codec = codec_of(&of);
    let sound = slip(&of);
    assert_eq!(damages(codec, &sound), []);
    let without = |values: &[u8]| -> Vec<Vec<u8>> {
        let one = |frame: &Vec<u8>| {
            let kept = frame.iter().filter(|byte| !values.contains(byte));
            kept.copied().collect()
        };
        sound.iter().map(one).collect()
    };
    let each = |change: fn(u8) -> u8| -> Vec<Vec<u8>> {
        let one = |frame: &Vec<u8>| frame.iter().copied().map(change).collect();
        sound.iter().map(one).collect()
    };
    for (change, all) in [
        (Change::NulStripped, without(&[0])),
        (Change::FlowControl, without(&[0x11, 0x13])),
        (Change::BitsReversed, each(u8::reverse_bits)),
        (Change::BitsInverted, each(|byte| !byte)),
    ] {
        let bytes = all.concat().len() as u64;
        let expected = Damage::Undone {
            change,
            framed: bytes,
            bytes,
        };
        assert_eq!(damages(codec, &all), [expected]);
    }
    // The second byte of each frame is lost: no known change, but most bytes are in no frame.
    let lost: Vec<Vec<u8>> = sound
        .iter()
        .map(|frame| [&frame[..1], &frame[2..]].concat())
        .collect();
    assert_eq!(damages(codec, &lost), []);
    let doubt = framed(codec, &lost).doubt("slip", false);
    assert!(doubt.is_some_and(|words| words.starts_with("none of the ")));
}

/// The sum of "$Q1" is A6. A terminal turns the CR of each line into LF.
#[test]
fn a_translated_line_end_is_named() {
    let codec = codec_of(&description(
        "lines",
        "terminator = \"\\r\\n\", checksum = { algorithm = \"sum8\", encoding = \"hex\", \
         separator = [0x2A] }",
    ));
    let sound = vec![b"$Q1*A6\r\n".to_vec(); 12];
    assert_eq!(damages(codec, &sound), []);
    let turned = vec![b"$Q1*A6\n\n".to_vec(); 12];
    let expected = Damage::Undone {
        change: Change::CrToLf,
        framed: 96,
        bytes: 96,
    };
    assert_eq!(damages(codec, &turned), [expected]);
    assert_eq!(
        expected.to_string(),
        "the host turns CR into LF (undone, 96 of 96 bytes are in valid frames)"
    );
}

/// The registers of a Modbus frame have names, also those of a reply, which only its request tells.
/// The first request passes before the first byte of the other direction; the protocol of that one
/// is known at once, or only after 64 bytes. CRCs by `frame_of`; 2405 tenths are 240.5 V.
#[test]
fn frames_of_modbus_name_their_registers() {
    let text = ::description::shipped::text("modbus-meter").expect("shipped");
    let none = |_: &str| Err("no file".to_owned());
    let of = Description::parse("meter.toml", text, &none).expect("sound");
    let codec = codec_of(&of);
    let link = Interface::new("bus", 9_600);
    let talk: [(&[u8], &[u8]); 3] = [
        (
            &[1, 4, 0, 9, 0, 3],
            &[1, 4, 6, 0, 7, 0x01, 0x35, 0x29, 0x07],
        ),
        (&[1, 6, 0, 1, 0x09, 0x65], &[1, 6, 0, 1, 0x09, 0x65]),
        (&[1, 1, 0, 0, 0, 1], &[1, 1, 1, 1]),
    ];
    let wanted = [
        [
            "device 1: read input registers 9, 3 of them: energy, serial_number",
            "device 1: read input registers: serial_number 20261127",
        ],
        [
            "device 1: write register 1 = 2405: alarm_voltage 240.5 V",
            "device 1: write register 1 = 2405: alarm_voltage 240.5 V",
        ],
        [
            "device 1: read coils 0, 1 of them: relay",
            "device 1: read coils: relay true",
        ],
    ];
    for (given, known) in [(Some(codec), None), (None, Some(codec))] {
        let lanes = [Direction::ToMaster, Direction::ToDevice].map(|direction| Known {
            link: "bus".to_owned(),
            direction,
            codec: known,
            names: None,
        });
        let mut transcript = Transcript::new(given).knowing(lanes.to_vec());
        let mut at = 0;
        for _ in 0..4 {
            for (request, reply) in talk {
                let both = [(Direction::ToDevice, request), (Direction::ToMaster, reply)];
                for (direction, body) in both {
                    at += 50;
                    let record = Record {
                        link: 0,
                        sequence: None,
                        at: Instant::from_millis(at),
                        direction,
                        kind: Kind::Data,
                        bytes: of.frame_of(0, body).expect("fits").into(),
                        sent: None,
                        pieces: Vec::new(),
                        comment: String::new(),
                    };
                    transcript.record(&record, &link);
                }
            }
        }
        let said: Vec<String> = transcript
            .finish()
            .map(|entry| entry.said.to_string())
            .collect();
        let all: Vec<&str> = (0..4).flat_map(|_| wanted.concat()).collect();
        assert_eq!(said, all);
    }
}
