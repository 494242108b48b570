//! Pauses within and between frames, by the clock of a capture. Formats that a test describes stay
//! known to its process, so these tests have one of their own.

use engine::codec::Codec;
use engine::rig::line::Direction;
use engine::scenario::device::description::codec_of;
use hilrig_capture::decode::pause::Pauses;
use hilrig_capture::decode::transcript::Transcript;
use hilrig_capture::{Interface, Kind, Record, Section};
use protocols::Instant;

fn codec(name: &str, framing: &str) -> &'static Codec {
    let text = format!(
        "name = \"{name}\"\nabout = \"a meter\"\nline = {{ baud = 9600 }}\n\
         frame = {{ {framing} }}\n\
         message = [{{ name = \"value\", from = \"device\", fields = \
         [{{ type = \"u8\", value = 1 }}, {{ type = \"u16be\", name = \"x\", calc = \"1\" }}] }}]\n\
         every = [{{ period = \"1s\", send = [\"value\"] }}]\n"
    );
    let none = |_: &str| Err("no file".to_owned());
    let description = ::description::Description::parse("own.toml", &text, &none);
    codec_of(&description.expect("a sound description"))
}

/// Number of frames in two records with this pause between.
fn frames(codec: &'static Codec, clock: &str, millis: u64, bytes: [&[u8]; 2]) -> usize {
    let section = Section {
        about: format!("clock={clock}"),
        ..Section::default()
    };
    let mut transcript = Transcript::new(Some(codec)).pausing(Pauses::of(&[section]));
    let link = Interface::new("x", 9_600);
    for (at, bytes) in [10, 10 + millis].into_iter().zip(bytes) {
        let record = Record {
            link: 0,
            sequence: None,
            at: Instant::from_millis(at),
            direction: Direction::ToMaster,
            kind: Kind::Data,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        transcript.record(&record, &link);
    }
    let all = transcript.finish();
    all.filter(|one| one.said.to_string().contains("value"))
        .count()
}

/// An FTDI adapter delivers a frame of 4 bytes in two records 16 ms apart. The bytes tell its
/// length, so it is one frame, except by an exact clock or after a long silence. Where only a
/// silence ends a frame, it remains the end.
#[test]
fn a_pause_of_an_adapter_does_not_cut_a_frame() {
    let halves: [&[u8]; 2] = [&[1, 0], &[5, 6]];
    let fixed = codec(
        "fixed-meter",
        "idle = \"4ms\", size = 4, checksum = \"sum8\"",
    );
    assert_eq!(frames(fixed, "unix", 16, halves), 1);
    assert_eq!(frames(fixed, "unix", 2_000, halves), 0);
    assert_eq!(frames(fixed, "virtual", 16, halves), 0);
    assert_eq!(frames(fixed, "virtual", 5, halves), 1);
    let silent = codec("silent-meter", "silence = 3.5, checksum = \"sum8\"");
    assert_eq!(
        frames(silent, "unix", 16, [&[1, 0, 5, 6], &[1, 0, 5, 6]]),
        2
    );
}
