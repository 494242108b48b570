//! No capture and no dump, whatever its content, breaks its readers, decoders or judges.

use core::time::Duration;

use hilrig::capture::decode::diagnose::{Line, diagnose};
use hilrig::capture::decode::transcript::{Said, Transcript};
use hilrig::capture::{Capture, Interface, Kind, Record, Section, Sent};
use hilrig::codec::{self, Codec, Lidar};
use hilrig::rig::line::Direction;
use proptest::prelude::*;
use protocols::{Instant, LineConfig, LineEvent};

use super::captures::capture;
use super::damage::{Damage, damage};

/// Values to which one of the formats reacts.
const TELLING: &[u8] = &[0, 0xFA, 0xAB, 0x5A, b'P', b'\n', 0x80, 0xFF, 0x0A, 0x0D];

/// Frames of all formats, as the tests of each have them from devices.
const FRAMES: [&[u8]; 5] = [
    b"\xFA\xA0\x4E\x4A\x27\x01\x05\x04\x27\x01\xD7\x03\x26\x01\x29\x04\x26\x01\xF0\x03\x3C\x5C",
    b"\xAB\x2E\x83\x14\xEC\x00\x02\x5C",
    b"PCUI_MSG\x07\x00\x29\x02\x00\x00MAR\x00\x00\x00\xFF\x7F\x2C\x7F",
    b"AT+BAUDA",
    b"\x7E\x54\x00\x05\x01\x01\x23\x0A\xBC\x0D\xE7",
];

fn record(index: usize, bytes: &[u8]) -> Record {
    let up = index.is_multiple_of(2);
    Record {
        link: 0,
        sequence: Some(index as u64),
        at: Instant::ZERO + Duration::from_millis(3) * u32::try_from(index).expect("few"),
        direction: [Direction::ToDevice, Direction::ToMaster][usize::from(up)],
        kind: Kind::Data,
        bytes: bytes.to_vec().into(),
        sent: (index == 3).then(|| Sent {
            at: Instant::ZERO,
            bytes: vec![1, 2].into(),
        }),
        pieces: vec![1; bytes.len()],
        comment: String::from(if index == 3 { "fault" } else { "" }),
    }
}

/// A capture of two links with records of all kinds.
fn sample() -> Vec<u8> {
    let mut out = Vec::new();
    let about = "seed=7\nstart_ns=5".to_owned();
    let section = Section {
        about,
        ..Section::default()
    };
    section.write(&mut out);
    Interface::new("a", 115_200).write(&mut out);
    Interface::new("b", 1_000_000).write(&mut out);
    for index in 0..24_usize {
        let frame = FRAMES[index / 2 % 5];
        let interface = u32::try_from(index % 3 % 2).expect("0 or 1");
        record(index, frame).write(interface, &mut out);
    }
    let event = Record {
        kind: Kind::Line(LineEvent::FramingError),
        ..record(30, &[])
    };
    event.write(0, &mut out);
    out
}

/// Applies all readers, decoders and judges to a capture.
fn judge(capture: &Capture) {
    let mut transcript = Transcript::new(None);
    for record in &capture.records {
        let link = &capture.links[record.link];
        let config = LineConfig::new_8n1(link.baud);
        let chunks = record.chunks(config);
        let len: usize = chunks.iter().map(|(_, bytes)| bytes.len()).sum();
        assert_eq!(len, record.bytes.len());
        transcript.record(record, link);
        transcript
            .ready(record.at)
            .for_each(|entry| drop(entry.said.to_string()));
    }
    transcript
        .finish()
        .for_each(|entry| drop(entry.said.to_string()));
    let data = capture
        .records
        .iter()
        .filter(|record| record.kind == Kind::Data);
    let fed: usize = data.map(|record| record.bytes.len()).sum();
    let told: u64 = transcript.sums().map(|sum| sum.bytes).sum();
    assert_eq!(told, fed as u64);
}

/// Applies all readers, decoders and judges to the bytes of a line.
fn judge_dump(bytes: &[u8], opposite: &[u8]) {
    for codec in [None].into_iter().chain(codec::all().into_iter().map(Some)) {
        diagnose(&Line {
            bytes,
            opposite,
            codec,
            ..Line::default()
        });
    }
    let figures = [Lidar::of_packets(bytes), Lidar::of_turns(bytes)];
    figures.iter().for_each(|lidar| drop(lidar.to_string()));
    Capture::of(bytes);
}

/// The report on `bytes` in pieces of `size`, without times.
fn told(bytes: &[u8], size: usize, protocol: Option<&'static Codec>) -> Vec<(u64, Said)> {
    let mut transcript = Transcript::new(protocol);
    let link = Interface::new("raw", 0);
    for piece in bytes.chunks(size) {
        let one = Record {
            at: Instant::ZERO,
            direction: Direction::ToMaster,
            pieces: Vec::new(),
            sent: None,
            comment: String::new(),
            ..record(0, piece)
        };
        transcript.record(&one, &link);
    }
    let entries = transcript.finish();
    entries.map(|entry| (entry.place, entry.said)).collect()
}

/// A line that begins with 10,000 bytes of noise, e.g. at a wrong rate, and then has frames. A
/// frame is recognised after the noise, at most 4096 bytes late.
#[test]
fn a_line_that_begins_with_noise_is_recognised_later() {
    let mut bytes = vec![0x55; 10_000];
    bytes.extend(FRAMES[0].repeat(300));
    let told = told(&bytes, 7, None);
    let frames = told
        .iter()
        .filter(|(_, said)| matches!(said, Said::Frame(_)));
    assert!(frames.count() >= 300 - 4096_usize.div_ceil(22));
}

fn damages() -> impl Strategy<Value = Vec<Damage>> {
    prop::collection::vec(damage(TELLING), 0..12)
}

proptest! {
    #![proptest_config(crate::thorough::cases(1000))]

    #[test]
    fn a_damaged_capture_is_read_and_told(damages in damages(), cut: prop::sample::Index) {
        let mut bytes = sample();
        damages.into_iter().for_each(|damage| damage.apply(&mut bytes));
        judge(&Capture::of(&bytes));
        bytes.truncate(cut.index(bytes.len()));
        judge(&Capture::of(&bytes));
    }

    #[test]
    fn any_bytes_are_read_and_judged(bytes: Vec<u8>, opposite: Vec<u8>) {
        judge_dump(&bytes, &opposite);
        judge(&Capture::of(&bytes));
    }

    /// Frames of all formats, damaged and mixed.
    #[test]
    fn a_damaged_dump_is_judged_and_told_the_same_in_all_pieces(
        order in prop::collection::vec(0_usize..5, 1..60),
        damages in damages(),
        size in 1_usize..50,
    ) {
        let mut bytes: Vec<u8> = order.iter().flat_map(|&one| FRAMES[one]).copied().collect();
        damages.into_iter().for_each(|damage| damage.apply(&mut bytes));
        judge_dump(&bytes, &bytes);
        for protocol in [None].into_iter().chain(codec::all().into_iter().map(Some)) {
            let whole = told(&bytes, bytes.len().max(1), protocol);
            prop_assert_eq!(told(&bytes, size, protocol), whole);
        }
    }
}

proptest! {
    #![proptest_config(crate::thorough::cases(40))]

    /// Pieces of the real captures, damaged.
    #[test]
    fn a_damaged_real_capture_is_judged(
        name in prop::sample::select(&[
            "xv11/xevel_hand_in_box_fw24.bin",
            "xv11/xevel_sparkfun_noshield_fw21.bin",
            "xv11/xevel_onerun_noshield_fw21.bin",
        ][..]),
        start: prop::sample::Index,
        damages in damages(),
    ) {
        let Some(bytes) = capture(name) else { return Ok(()) };
        let start = start.index(bytes.len());
        let mut bytes = bytes[start..bytes.len().min(start + 6000)].to_vec();
        damages.into_iter().for_each(|damage| damage.apply(&mut bytes));
        judge_dump(&bytes, &[]);
        for protocol in [None, codec::guess(&bytes)] {
            let whole = told(&bytes, bytes.len().max(1), protocol);
            prop_assert_eq!(told(&bytes, 1, protocol), whole);
        }
    }
}
