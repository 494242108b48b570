//! A format that is unknown to the tool, registered from outside as a user's own crate would do.
//!
//! The test needs its own process: the codec table belongs to the process, and other tests iterate
//! over all of it.

use std::sync::Once;

use hilrig::capture::decode::diagnose::{Damage, Line, diagnose};
use hilrig::capture::decode::transcript::{Said, Transcript};
use hilrig::capture::{Capture, Interface, Kind, Record, wireshark};
use hilrig::codec::wire::{Choices, Wire};
use hilrig::codec::{self, Codec, Lua, LuaField, OtherOrder, field};
use hilrig::rig::line::Direction;
use hilrig::search::fuzz::{Behaviour, Subject as _, Wires};
use hilrig::search::shrink::{self, Effort, Repair};
use protocols::{Candidate, Decoder, Format, FrameError, Instant};

/// `C3`, a length of at most 16, as many bytes, and their hash, high byte first.
#[derive(Clone, Copy, Default)]
struct Gripper;

const START: u8 = 0xC3;
const DATA_MAX: usize = 16;

fn sum(data: &[u8]) -> u16 {
    let sum = data.iter().fold(0_u16, |sum, &byte| {
        sum.wrapping_mul(31).wrapping_add(byte.into())
    });
    sum ^ 0xA55A
}

impl Format for Gripper {
    type Frame = Vec<u8>;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        if bytes[0] != START {
            return Candidate::Noise;
        }
        let Some(&len) = bytes.get(1) else {
            return Candidate::Incomplete;
        };
        if usize::from(len) > DATA_MAX {
            let (max, found) = (16, u32::from(len));
            return Candidate::Rejected(FrameError::Length { max, found });
        }
        let end = 2 + usize::from(len);
        match bytes.get(end..end + 2) {
            None => Candidate::Incomplete,
            Some(sent) if sent == sum(&bytes[2..end]).to_be_bytes() => Candidate::Complete(end + 2),
            Some(_) => Candidate::Rejected(FrameError::Checksum {
                expected: 0,
                found: 1,
            }),
        }
    }

    fn frame(&self, bytes: &[u8]) -> Vec<u8> {
        bytes.to_vec()
    }
}

impl Wire for Gripper {
    type Decoder = Decoder<Self, 20>;
    const NAME: &'static str = "gripper";

    fn decoder() -> Self::Decoder {
        Decoder::default()
    }

    fn bytes(frame: &Vec<u8>) -> &[u8] {
        frame
    }

    fn words(frame: &Vec<u8>) -> String {
        format!("grip {:?}", &frame[2..frame.len() - 2])
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let len = choices.below(DATA_MAX + 1);
        let data = choices.take(len);
        out.extend([START, u8::try_from(data.len()).expect("at most 16")]);
        out.extend(data);
        out.extend(sum(data).to_be_bytes());
    }

    fn repair(frame: &mut [u8]) {
        let Some(len) = frame.len().checked_sub(4).filter(|&len| len <= DATA_MAX) else {
            return;
        };
        frame[0] = START;
        frame[1] = u8::try_from(len).expect("at most 16");
        let sum = sum(&frame[2..2 + len]);
        frame[2 + len..].copy_from_slice(&sum.to_be_bytes());
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let len = usize::from(*bytes.get(1)?);
        let sent = bytes.get(2 + len..4 + len)?;
        let holds = sent == sum(&bytes[2..2 + len]).to_be_bytes();
        (bytes[0] == START && len <= DATA_MAX && holds).then_some(len + 4)
    }
}

/// Number of frames whose checksum is correct in the other byte order, and in the expected one.
fn other_order(bytes: &[u8]) -> [u64; 2] {
    let mut counts = [0; 2];
    for at in 0..bytes.len() {
        let mut frame = bytes[at..].to_vec();
        counts[1] += u64::from(Gripper::frame_at(&frame).is_some());
        let end = 2 + usize::from(frame.get(1).copied().unwrap_or(0));
        if end + 2 <= frame.len() {
            frame.swap(end, end + 1);
            counts[0] += u64::from(Gripper::frame_at(&frame).is_some());
        }
    }
    counts
}

const FIELDS: [LuaField; 1] = [field("force", "uint8", "hilrig.gripper.force", "Force")];

/// The row, registered once.
fn gripper() -> &'static Codec {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let row = Codec::of::<Gripper>("Gripper of our own")
            .with_other_order(OtherOrder::Wrong(other_order))
            .with_lua(Lua {
                source: "local function judge_gripper(s) return 0 end\n\
                         local function tell_gripper(s) return \"Grip\", {} end\n",
                judge: "judge_gripper",
                tell: "tell_gripper",
                fields: &FIELDS,
            });
        codec::register(row).expect("a new name");
    });
    codec::find("gripper").expect("registered")
}

fn frame(data: &[u8]) -> Vec<u8> {
    let mut frame = [&[START, 0], data, &[0, 0]].concat();
    Gripper::repair(&mut frame);
    frame
}

fn stream() -> Vec<u8> {
    let frames = (0..40_u8).flat_map(|n| frame(&[n, n.wrapping_mul(37), 200 - n]));
    frames.collect()
}

fn record(millis: u64, bytes: &[u8]) -> Record {
    Record {
        link: 0,
        sequence: None,
        at: Instant::from_millis(millis),
        direction: Direction::ToMaster,
        kind: Kind::Data,
        bytes: bytes.to_vec().into(),
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    }
}

#[test]
fn it_comes_behind_what_is_built_in_and_only_once() {
    let row = gripper();
    assert_eq!(codec::all().last(), Some(&row));
    assert_eq!((row.name(), row.about()), ("gripper", "Gripper of our own"));
    let again = codec::register(Codec::of::<Gripper>("twice"));
    let error = again.expect_err("the name is taken").to_string();
    assert_eq!(error, "the name \"gripper\" is already taken");
}

/// The format of the line is not given: the decoder recognises it by the bytes.
#[test]
fn decode_guesses_it_and_tells_it_in_its_words() {
    let row = gripper();
    assert_eq!(codec::guess(&stream()), Some(row));
    let mut transcript = Transcript::new(None);
    transcript.record(&record(1, &stream()), &Interface::new("hand", 9600));
    let told: Vec<Said> = transcript.finish().map(|entry| entry.said).collect();
    assert_eq!(told.len(), 40);
    assert_eq!(told[1], Said::Frame("grip [1, 37, 199]".to_owned()));
    let sum = transcript.sums().next().expect("a lane");
    assert_eq!((sum.codec, sum.framed), (Some(row), sum.bytes));
}

#[test]
fn diagnose_names_its_swapped_checksum() {
    let row = gripper();
    let mut bytes = stream();
    for frame in bytes.chunks_exact_mut(7) {
        frame.swap(5, 6);
    }
    for codec in [None, Some(row)] {
        let line = Line {
            bytes: &bytes,
            codec,
            ..Line::default()
        };
        let (other, expected) = (40, 0);
        assert_eq!(diagnose(&line), [Damage::ChecksumOrder { other, expected }]);
    }
}

/// Only a valid frame whose second byte is 37 matters: shrinking removes all other bytes and
/// recomputes the checksum.
#[test]
fn shrink_cuts_it_out_and_repairs_its_checksum() {
    let row = gripper();
    let capture = Capture {
        links: vec![Interface::new("hand", 9600)],
        records: vec![record(1, b"noise"), record(2, &stream())],
        ..Capture::default()
    };
    let units = shrink::units(&capture);
    let frames = units.iter().filter(|unit| unit.frame == Some(row));
    assert_eq!(frames.count(), 40);
    let fails = |units: &[shrink::Unit]| {
        units.iter().any(|unit| {
            let bytes = &unit.record.bytes;
            Gripper::frame_at(bytes).is_some() && bytes[3] == 37
        })
    };
    let small = shrink::capture(&units, fails, &mut Effort::tries(5000), Repair::Checksums);
    assert_eq!(small.len(), 1);
    assert_eq!(small[0].record.bytes, frame(&[0, 37, 0]));
}

#[test]
fn fuzz_has_it_as_a_target_whose_decoder_keeps_the_laws() {
    let row = gripper();
    let subject = Wires::all().find(|wire| wire.name() == "gripper");
    let subject = subject.expect("a target");
    for seed in 0..=255 {
        let choices: Vec<u8> = (0..200).map(|n: u8| n.wrapping_mul(seed) ^ seed).collect();
        let judged = subject.run(&choices, &mut Behaviour::default());
        assert_eq!(judged, Ok(()));
    }
    assert_eq!(
        codec::target("gripper").map(|target| target.name),
        Some(row.name())
    );
}

#[test]
fn the_dissector_has_its_functions_its_fields_and_its_name() {
    gripper();
    let lua = wireshark::dissector();
    for line in [
        "local function judge_gripper(s) return 0 end",
        "  force = ProtoField.uint8(\"hilrig.gripper.force\", \"Force\"),",
        "  { \"gripper\", judge_gripper, tell_gripper, 0.05, 0 },",
    ] {
        assert_eq!(lua.lines().filter(|one| *one == line).count(), 1, "{line}");
    }
}
