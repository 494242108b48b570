//! Figures of lines with a described format. Formats that a test describes stay known
//! to its process, so these tests have one of their own.

use std::sync::Arc;

use ::description::Description;
use engine::codec::Codec;
use engine::rig::line::Direction;
use engine::scenario::device::description::codec_of;
use hilrig_capture::decode::framed::Framed;
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

/// The sum of 01 02 is 03. Only the silence ends a frame: without the times, all frames are one.
#[test]
fn bytes_in_frames_are_counted_by_the_times() {
    let codec = codec_of(&description("silent", "silence = 3.5, checksum = \"sum8\""));
    let sound = framed(codec, &vec![vec![1, 2, 3]; 30]);
    assert_eq!((sound.bytes, sound.framed, sound.frames), (90, 90, 30));
    assert_eq!(sound.doubt("silent", false), None);

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
